//! The body of a run alone, read back from its frames: at one time, or at all of them as a film.
//!
//! A film is an animated PNG: colours are not reduced, browsers play it, and who knows no animation shows
//! the first picture. Axes, colours and magnification are those of the whole run, so that nothing but the
//! body moves, and a picture has only the rectangle that differs from the one before.

use std::sync::Arc;

use rayon::prelude::*;

use super::body::{BodyView, Shared};
use super::canvas::{Anchor, Canvas, DARK, GREY, Text, shortened};
use super::chart::Area;
use super::{Colour, NamedPoints, encode_png, ticks};
use crate::mesh::{Mesh, PointsAre};
use crate::results::frame::{Array, ReadFrame, decode_cells};
use crate::results::{Listed, Results, ResultsError, decoded};
use crate::{Frame, Points};

/// Pictures of a film at most; of more frames so many, evenly.
pub const MOST_PICTURES: usize = 250;

/// How much longer the last picture stands, in ms.
const REST: f64 = 1000.0;

/// Width and height of the page in pixels.
const PAGE: (f64, f64) = (1060.0, 800.0);
const BODY: Area = Area { left: 80.0, top: 84.0, right: 760.0, bottom: 700.0 };
const BAR: Area = Area { left: 815.0, top: 140.0, right: 837.0, bottom: 650.0 };

/// The body of a run, to be drawn.
#[derive(Debug)]
pub struct BodyFilm<'a> {
    results: &'a Results,
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
                found: "none: `[output] frames = 0`, or the run broke off".to_owned(),
            });
        };
        let read = last.read()?;
        colour_of(&read, field, last)?;
        let title = results.summary()["title"].as_str().unwrap_or_default().to_owned();
        let points = points_of(results, last, &read)?;
        Ok(BodyFilm { results, field, points, sets: sets_of(&read), title })
    }

    /// The picture of the frame that is nearest to this time or load parameter, the last if there is none, as
    /// PNG or SVG.
    ///
    /// # Errors
    /// Frames that cannot be read.
    pub fn still(&self, at: Option<f64>, as_svg: bool) -> Result<Vec<u8>, ResultsError> {
        let frames = self.results.frames();
        let distance = |frame: &Listed, at: f64| (frame.t - at).abs();
        let found = match at {
            Some(at) => frames.iter().min_by(|p, q| distance(p, at).total_cmp(&distance(q, at))),
            None => frames.last(),
        };
        let Some(listed) = found else { return Ok(Vec::new()) };
        let canvas = self.page(listed, None)?;
        Ok(if as_svg { canvas.to_svg().into_bytes() } else { encode_png(&canvas)? })
    }

    /// All frames, or [`MOST_PICTURES`] of them, within so many seconds, as an animated PNG.
    ///
    /// # Errors
    /// Frames that cannot be read.
    pub fn film(&self, seconds: f64) -> Result<Vec<u8>, ResultsError> {
        let frames = self.results.frames();
        let n = frames.len().min(MOST_PICTURES);
        let chosen: Vec<&Listed> =
            (0..n).map(|k| &frames[k * (frames.len() - 1) / (n - 1).max(1)]).collect();
        let shared = self.shared(&chosen)?;
        let draw = |frame: &&Listed| Ok(encode_png(&self.page(frame, Some(shared))?)?);
        let pictures =
            chosen.par_iter().map(draw).collect::<Result<Vec<Vec<u8>>, ResultsError>>()?;
        let delay = (1000.0 * seconds / n.max(1) as f64).clamp(1.0, f64::from(u16::MAX));
        animated(&pictures, delay).map_err(|error| {
            let reason = error.to_string();
            crate::OutputError::Picture { file: "film.png", reason }.into()
        })
    }

    /// What all pictures share.
    fn shared(&self, frames: &[&Listed]) -> Result<Shared, ResultsError> {
        let range = |listed: &&Listed| {
            let (frame, colour) = self.load(listed)?;
            let view = BodyView::new(&self.points, &frame, &[], colour.as_ref(), None);
            Ok((view.largest(), view.shades()))
        };
        let found = frames.par_iter().map(range).collect::<Result<Vec<_>, ResultsError>>()?;
        let largest = found.iter().map(|(largest, _)| *largest).fold(0.0, f64::max);
        let low = found.iter().map(|(_, [low, _])| *low).fold(f64::INFINITY, f64::min);
        let high = found.iter().map(|(_, [_, high])| *high).fold(f64::NEG_INFINITY, f64::max);
        let shared = Shared { largest, shades: [low, high], bounds: None };
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
            let (vertices, cells) = decoded(file, decode_cells)?;
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
        cells: Vec::new(),
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
    let Some(field) = field.filter(|field| *field != "displacement") else { return Ok(None) };
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

/// The unit of a field of frames; empty of pure numbers and of what has none that is known here.
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

/// Pictures of one size after each other, each for so many ms.
fn animated(pictures: &[Vec<u8>], delay: f64) -> Result<Vec<u8>, png::EncodingError> {
    let mut out = Vec::new();
    let Some(first) = pictures.first() else { return Ok(out) };
    let mut before = Pixels::read(first)?;
    let mut encoder = png::Encoder::new(&mut out, before.width as u32, before.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_animated(pictures.len() as u32, 0)?;
    encoder.set_frame_delay(delay as u16, 1000)?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&before.rgb)?;
    for (place, picture) in pictures.iter().enumerate().skip(1) {
        let now = Pixels::read(picture)?;
        let [left, top, width, height] = now.difference(&before);
        if place + 1 == pictures.len() {
            writer.set_frame_delay((delay + REST).min(f64::from(u16::MAX)) as u16, 1000)?;
        }
        writer.reset_frame_position()?;
        writer.set_frame_dimension(width as u32, height as u32)?;
        writer.set_frame_position(left as u32, top as u32)?;
        writer.write_image_data(&now.cut(left, top, width, height))?;
        before = now;
    }
    writer.finish()?;
    Ok(out)
}

/// A picture as its pixels.
struct Pixels {
    width: usize,
    height: usize,
    /// Row by row.
    rgb: Vec<u8>,
}

impl Pixels {
    fn read(encoded: &[u8]) -> Result<Pixels, png::EncodingError> {
        let wrong = |error: png::DecodingError| std::io::Error::other(error.to_string());
        let mut decoder = png::Decoder::new(std::io::Cursor::new(encoded));
        decoder.set_transformations(png::Transformations::normalize_to_color8());
        let mut reader = decoder.read_info().map_err(wrong)?;
        let mut pixels = vec![0; reader.output_buffer_size().unwrap_or(0)];
        let info = reader.next_frame(&mut pixels).map_err(wrong)?;
        let samples = info.color_type.samples();
        // The page is white and hides what is behind it: nothing is transparent.
        let rgb = match samples {
            3 => pixels,
            n => pixels.chunks_exact(n).flat_map(|pixel| [0, 1, 2].map(|k| pixel[k % n])).collect(),
        };
        Ok(Pixels { width: info.width as usize, height: info.height as usize, rgb })
    }

    fn row(&self, y: usize) -> &[u8] {
        &self.rgb[3 * self.width * y..3 * self.width * (y + 1)]
    }

    /// The rectangle outside of which both are the same: left, top, width, height, each of the last two at
    /// least 1.
    fn difference(&self, other: &Pixels) -> [usize; 4] {
        let differs = |y: &usize| self.row(*y) != other.row(*y);
        let rows: Vec<usize> = (0..self.height).filter(differs).collect();
        let (Some(&top), Some(&bottom)) = (rows.first(), rows.last()) else { return [0, 0, 1, 1] };
        let (mut left, mut right) = (self.width, 0);
        for y in rows {
            let pixels = self.row(y).chunks_exact(3).zip(other.row(y).chunks_exact(3));
            for (x, _) in pixels.enumerate().filter(|(_, (p, q))| p != q) {
                (left, right) = (left.min(x), right.max(x));
            }
        }
        [left, top, right + 1 - left, bottom + 1 - top]
    }

    fn cut(&self, left: usize, top: usize, width: usize, height: usize) -> Vec<u8> {
        let part = |y| &self.row(y)[3 * left..3 * (left + width)];
        (top..top + height).flat_map(part).copied().collect()
    }
}
