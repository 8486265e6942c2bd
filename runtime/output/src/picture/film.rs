//! The body of a run alone, read back from its frames: at one time, or at all of them as a film.
//!
//! A film is an animated PNG: colours are not reduced, browsers play it, and who knows no animation shows
//! the first picture. Axes, colours and magnification are those of the whole run, so that nothing but the
//! body moves.

use std::sync::Arc;

use piola_meshes::Shape;
use rayon::prelude::*;

use super::apng::animated;
use super::body::{BodyView, Shared};
use super::canvas::{Anchor, Canvas, DARK, GREY, Text, shortened};
use super::chart::Area;
use super::charts::spread;
use super::{Colour, NamedPoints, encode_png, ticks};
use crate::mesh::{Mesh, PointsAre};
use crate::results::frame::{Array, ReadFrame, read_cells};
use crate::results::{Listed, Results, ResultsError};
use crate::{Frame, Points};

/// Pictures of a film at most; of more frames so many, evenly.
pub const MOST_PICTURES: usize = 250;

/// Pictures a second at most: browsers play faster ones slowly.
const MOST_A_SECOND: f64 = 50.0;

/// Width and height of the page in pixels.
const PAGE: (f64, f64) = (1060.0, 800.0);
const BODY: Area = Area { left: 80.0, top: 84.0, right: 760.0, bottom: 700.0 };
const BAR: Area = Area { left: 815.0, top: 140.0, right: 837.0, bottom: 650.0 };

/// The body of a run, to be drawn.
#[derive(Debug)]
pub struct BodyFilm<'a> {
    results: &'a Results,
    last: &'a Listed,
    /// What colours show beside the displacement.
    field: Option<&'a str>,
    points: Points,
    sets: Vec<NamedPoints>,
    title: String,
}

impl<'a> BodyFilm<'a> {
    /// The body of a run; colours show a field of its frames, or the displacement. A vector or a tensor is shown
    /// by its size, or by a component, as `velocity_x` or `stress_xy`.
    ///
    /// # Errors
    /// A run without frames, a field that they have not, files that cannot be read.
    pub fn new(results: &'a Results, field: Option<&'a str>) -> Result<BodyFilm<'a>, ResultsError> {
        let Some(last) = results.frames().last() else {
            return Err(ResultsError::Missing {
                path: results.folder().to_owned(),
                wanted: "frame".to_owned(),
                found: "none: the run broke off before the first".to_owned(),
            });
        };
        let field = field.filter(|field| *field != "displacement");
        let read = last.read()?;
        colour_of(&read, field, last)?;
        let title = results.summary()["title"].as_str().unwrap_or_default().to_owned();
        let points = points_of(results, last, &read)?;
        Ok(BodyFilm { results, last, field, points, sets: sets_of(&read), title })
    }

    /// The picture of the frame that is nearest to this time or load parameter, the last if there is none, as
    /// PNG or SVG.
    ///
    /// # Errors
    /// Frames that cannot be read.
    pub fn still(&self, at: Option<f64>, as_svg: bool) -> Result<Vec<u8>, ResultsError> {
        let distance = |frame: &Listed, at: f64| (frame.t - at).abs();
        let nearest = at.and_then(|at| {
            let frames = self.results.frames().iter();
            frames.min_by(|p, q| distance(p, at).total_cmp(&distance(q, at)))
        });
        let canvas = self.page(nearest.unwrap_or(self.last), None)?;
        Ok(if as_svg { canvas.to_svg().into_bytes() } else { encode_png(&canvas)? })
    }

    /// All frames, or [`MOST_PICTURES`] of them, within so many seconds, as an animated PNG.
    ///
    /// # Errors
    /// Frames that cannot be read.
    pub fn film(&self, seconds: f64) -> Result<Vec<u8>, ResultsError> {
        let frames = self.results.frames();
        let most = ((seconds * MOST_A_SECOND) as usize).clamp(2, MOST_PICTURES);
        let chosen: Vec<&Listed> =
            spread(frames.len(), most).into_iter().map(|k| &frames[k]).collect();
        let shared = self.shared(&chosen)?;
        let draw = |frame: &&Listed| Ok(encode_png(&self.page(frame, Some(shared))?)?);
        let pictures =
            chosen.par_iter().map(draw).collect::<Result<Vec<Vec<u8>>, ResultsError>>()?;
        let delay = 1000.0 * seconds / pictures.len().max(1) as f64;
        animated(&pictures, delay).map_err(|error| {
            let reason = error.to_string();
            crate::OutputError::Picture { file: "film.png", reason }.into()
        })
    }

    /// What all pictures share.
    fn shared(&self, frames: &[&Listed]) -> Result<Shared, ResultsError> {
        let range = |listed: &&Listed| {
            let (frame, colour) = self.load(listed)?;
            let d = self.points.dimension;
            let lengths = frame.displacement.chunks_exact(d);
            let length = |u: &[f64]| libm::sqrt(u.iter().map(|x| x * x).sum());
            let lengths: Vec<f64> = lengths.map(length).filter(|u: &f64| u.is_finite()).collect();
            let largest = lengths.iter().copied().fold(0.0, f64::max);
            let values = colour.map_or(lengths, |colour| colour.values);
            let finite = || values.iter().copied().filter(|x| x.is_finite());
            let low = finite().fold(f64::INFINITY, f64::min);
            Ok((largest, [low, finite().fold(f64::NEG_INFINITY, f64::max)]))
        };
        let found = frames.par_iter().map(range).collect::<Result<Vec<_>, ResultsError>>()?;
        let largest = found.iter().map(|(largest, _)| *largest).fold(0.0, f64::max);
        let low = found.iter().map(|(_, [low, _])| *low).fold(f64::INFINITY, f64::min);
        let high = found.iter().map(|(_, [_, high])| *high).fold(f64::NEG_INFINITY, f64::max);
        let shared = Shared {
            largest,
            shades: if self.field.is_some() { [low, high] } else { [0.0, high] },
            bounds: None,
        };
        let bounds = |listed: &&Listed| {
            let (frame, colour) = self.load(listed)?;
            let view = BodyView::new(&self.points, &frame, &[], colour.as_ref(), Some(shared));
            Ok(view.own_bounds())
        };
        let found = frames.par_iter().map(bounds).collect::<Result<Vec<_>, ResultsError>>()?;
        let corner = |pick: fn(f64, f64) -> f64, from: f64, of: fn(&Box3) -> [f64; 3]| {
            [0, 1, 2].map(|axis| found.iter().map(|own| of(own)[axis]).fold(from, pick))
        };
        let low = corner(f64::min, f64::INFINITY, |own| own.0);
        let high = corner(f64::max, f64::NEG_INFINITY, |own| own.1);
        Ok(Shared { bounds: Some((low, high)), ..shared })
    }

    fn load(&self, listed: &Listed) -> Result<(Frame, Option<Colour>), ResultsError> {
        let read = listed.read()?;
        if read.positions.len() != 3 * self.points.n_points() {
            return Err(ResultsError::Broken { path: listed.file.clone() });
        }
        let colour = colour_of(&read, self.field, listed)?;
        let frame = Frame {
            t: listed.t,
            displacement: flat(&read.arrays[0].values, self.points.dimension),
            residual: Vec::new(),
            velocity: Vec::new(),
            fields: Vec::new(),
        };
        Ok((frame, colour))
    }

    fn page(&self, listed: &Listed, shared: Option<Shared>) -> Result<Canvas, ResultsError> {
        let (frame, colour) = self.load(listed)?;
        let view = BodyView::new(&self.points, &frame, &self.sets, colour.as_ref(), shared);
        let mut canvas = Canvas::new(PAGE.0, PAGE.1);
        let title = shortened(&self.title, 70);
        canvas.text(BODY.left, 38.0, &title, Text::new(20, Anchor::Start, DARK));
        let t = format!("t = {}", ticks::short(frame.t));
        canvas.text(PAGE.0 - 30.0, 38.0, &t, Text::new(20, Anchor::End, DARK));
        view.draw(&mut canvas, BODY);
        view.draw_colour_bar(&mut canvas, BAR);
        canvas.text(BODY.left, 778.0, &view.note(), Text::new(13, Anchor::Start, GREY));
        Ok(canvas)
    }
}

type Box3 = ([f64; 3], [f64; 3]);

/// The first `dimension` of every three numbers.
fn flat(values: &[f64], dimension: usize) -> Vec<f64> {
    values.chunks_exact(3).flat_map(|row| &row[..dimension]).copied().collect()
}

/// The body as its frames have it.
fn points_of(results: &Results, last: &Listed, read: &ReadFrame) -> Result<Points, ResultsError> {
    let dimension = results.dimension();
    let spacing = results.summary()["spacing"].as_f64();
    let volumes = read.arrays.iter().find(|array| array.name == "volume");
    let volumes = volumes.ok_or_else(|| ResultsError::Broken { path: last.file.clone() })?;
    // Of lattices cells are drawn around points; the cells of their frames are between them.
    let mesh = match (&last.cells, spacing) {
        (Some(cells), _) => Some((cells, PointsAre::Cells)),
        (None, None) => Some((&last.file, PointsAre::Vertices)),
        (None, Some(_)) => None,
    };
    let held = read.arrays.iter().find(|array| array.name == "held");
    let mesh = match mesh {
        Some((file, points_are)) => {
            let (vertices, cells) = read_cells(file)?;
            let n = match points_are {
                PointsAre::Cells => cells.len(),
                PointsAre::Vertices => vertices.len() / 3,
            };
            let fits = |shape: &Shape| shape.dimension() <= dimension;
            if n != volumes.values.len() || !cells.iter().all(|(shape, _)| fits(shape)) {
                return Err(ResultsError::Broken { path: file.clone() });
            }
            let cells = cells.iter().map(|(shape, corners)| (*shape, &corners[..]));
            Some(Mesh::new(dimension, flat(&vertices, dimension), cells, points_are))
        }
        None => None,
    };
    Ok(Points {
        dimension,
        positions: flat(&read.positions, dimension),
        volumes: volumes.values.clone(),
        spacing,
        mesh: mesh.filter(|mesh| mesh.n_cells() > 0).map(Arc::new),
        held: held.map_or_else(Vec::new, |held| held.values.iter().map(|x| *x > 0.5).collect()),
    })
}

/// The sets that frames name, `[output] fields = ["sets"]`.
fn sets_of(read: &ReadFrame) -> Vec<NamedPoints> {
    let named = |array: &Array| {
        let name = array.name.strip_prefix("set ")?.to_owned();
        let members = array.values.iter().enumerate().filter(|(_, value)| **value > 0.5);
        Some(NamedPoints { name, points: members.map(|(point, _)| point).collect() })
    };
    read.arrays.iter().filter_map(named).collect()
}

/// What colours show of a frame; nothing for the displacement.
fn colour_of(
    read: &ReadFrame,
    field: Option<&str>,
    listed: &Listed,
) -> Result<Option<Colour>, ResultsError> {
    let Some(field) = field else { return Ok(None) };
    let of = |name: &str| read.arrays.iter().find(|array| array.name == name);
    let component = || {
        let (name, axes) = field.rsplit_once('_')?;
        let places: Vec<usize> = axes.chars().map(|c| "xyz".find(c)).collect::<Option<_>>()?;
        let array = of(name)?;
        let place = match (places[..].len(), array.components) {
            (1, 3) => places[0],
            (2, 9) => 3 * places[0] + places[1],
            _ => return None,
        };
        let values = array.values.chunks_exact(array.components).map(|row| row[place]).collect();
        Some((field.to_owned(), name, values))
    };
    let size = |array: &'_ Array| match array.components {
        1 => (field.to_owned(), array.values.clone()),
        n => {
            let row = |row: &[f64]| libm::sqrt(row.iter().map(|x| x * x).sum());
            (format!("|{field}|"), array.values.chunks_exact(n).map(row).collect())
        }
    };
    let whole = || of(field).map(size).map(|(label, values)| (label, field, values));
    let Some((label, name, values)) = whole().or_else(component) else {
        let found: Vec<&str> = read.arrays.iter().map(|array| &array.name[..]).collect();
        return Err(ResultsError::Missing {
            path: listed.file.clone(),
            wanted: format!("field `{field}`"),
            found: format!(
                "{}; `[output] fields` in the scene adds others, and `_x` or `_xy` behind a name takes a component",
                found.join(", ")
            ),
        });
    };
    Ok(Some(Colour { name: label, unit: unit_of(name), values }))
}

/// The unit of a field of frames; empty of pure numbers, of states, and of volumes, which are areas in the
/// plane.
pub fn unit_of(field: &str) -> &'static str {
    match field {
        "displacement" => "m",
        "velocity" => "m/s",
        "acceleration" => "m/s^2",
        "residual" => "N",
        "energy_density" => "J/m^3",
        "stress" | "piola_stress" | "von_mises" | "principal_stresses" => "Pa",
        _ => "",
    }
}
