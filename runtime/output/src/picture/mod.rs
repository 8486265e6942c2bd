//! `picture.svg` and `picture.png`: what a run did, on one page.
//!
//! Left the deformed body coloured by the magnitude of the displacement or by a field; right top the
//! reactions against the load parameter, right bottom the Newton residuals against the iteration; of a
//! body in motion its energies and what its probes do against time. Both files are drawn from the same shapes. kuva turns shapes into SVG and pixels and brings the font; the
//! shapes are placed here, because a body of deformed cells is none of its plots.
//!
//! However large the body, at most [`MOST_SHAPES`] cells or points are drawn; a note under the
//! body says so.

mod apng;
mod body;
mod canvas;
mod cells;
mod chart;
mod charts;
mod discs;
mod film;
mod force;
mod front;
mod logarithmic;
mod motion;
mod solid;
mod sweep;
mod ticks;

pub use film::{BodyFilm, MOST_PICTURES, unit_of};
pub use force::ForcePicture;
pub use front::{Dot, DotKind, FrontPicture};
pub use logarithmic::{LogarithmicPanel, LogarithmicPlot};
pub use sweep::{SweepChart, SweepLine, SweepPicture};

use piola_grammar::counted;

use super::{Frame, History, OutputError, OutputFile, OutputFolder, Points};
use canvas::{Anchor, Canvas, DARK, GREY, Text};
use chart::Area;

/// Most cells, faces or points in a picture: an SVG of about two megabytes.
pub const MOST_SHAPES: usize = 12_000;

/// Width and height of the page in pixels.
const PAGE: (f64, f64) = (1600.0, 800.0);

/// Where the body goes, with its axes.
const BODY: Area = Area { left: 80.0, top: 84.0, right: 760.0, bottom: 700.0 };
/// Where the colour bar goes.
const BAR: Area = Area { left: 815.0, top: 140.0, right: 837.0, bottom: 650.0 };
/// Where the charts go.
const UPPER: Area = Area { left: 1020.0, top: 84.0, right: 1460.0, bottom: 345.0 };
const LOWER: Area = Area { left: 1020.0, top: 454.0, right: 1460.0, bottom: 715.0 };

/// What a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// In the headline, for instance the scene's name.
    pub title: &'a str,
    /// The body, or some of its points.
    pub points: &'a Points,
    /// How many points the body has.
    pub n_points: usize,
    /// Its state, usually at the last converged step.
    pub frame: &'a Frame,
    /// Sets to mark on the body.
    pub sets: &'a [NamedPoints],
    /// What colours show; the magnitude of the displacement where there is nothing.
    pub colour: Option<&'a Colour>,
    /// What stands beside the body.
    pub charts: Charts<'a>,
}

/// What colours show: a number of every point, in the user's order.
#[derive(Clone, Debug, PartialEq)]
pub struct Colour {
    /// Its name.
    pub name: String,
    /// The unit; empty of pure numbers.
    pub unit: &'static str,
    /// Point by point.
    pub values: Vec<f64>,
}

/// Two charts.
#[derive(Clone, Copy, Debug)]
pub enum Charts<'a> {
    /// The converged steps, the solver's tolerance on the residual over the reaction, and what an entry of a
    /// step's residuals belongs to.
    Steps(&'a History, f64, &'static str),
    /// Energies in J, and displacements at probes in m, against time in s.
    Times {
        /// By name.
        energies: &'a [Series],
        /// By name.
        probes: &'a [Series],
    },
}

/// What changes with time.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Its name.
    pub name: String,
    /// Pairs of time in s and value.
    pub points: Vec<(f64, f64)>,
}

/// A named set of points.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedPoints {
    /// The set's name.
    pub name: String,
    /// Its points, as places in the user's order.
    pub points: Vec<usize>,
}

impl Picture<'_> {
    /// The picture as SVG.
    pub fn to_svg(&self) -> String {
        self.draw().to_svg()
    }

    /// The picture as PNG, 1600 x 800 pixels.
    pub fn to_png(&self) -> Result<Vec<u8>, OutputError> {
        encode_png(&self.draw())
    }

    /// Writes `picture.svg` and `picture.png`.
    pub fn write(&self, folder: &OutputFolder) -> Result<(), OutputError> {
        let canvas = self.draw();
        folder.write(OutputFile::PictureSvg, canvas.to_svg().as_bytes())?;
        folder.write(OutputFile::PicturePng, &encode_png(&canvas)?)
    }

    fn draw(&self) -> Canvas {
        let mut canvas = Canvas::new(PAGE.0, PAGE.1);
        let t = ticks::short(self.frame.t);
        let title = if self.title.is_empty() {
            format!("t = {t}")
        } else {
            format!("{}, t = {t}", canvas::shortened(self.title, 110))
        };
        canvas.text(BODY.left, 38.0, &title, Text::new(20, Anchor::Start, DARK));
        let view = body::BodyView::new(self.points, self.frame, self.sets, self.colour, None);
        view.draw(&mut canvas, BODY);
        view.draw_colour_bar(&mut canvas, BAR);
        let mut note = view.note();
        if self.n_points > self.points.n_points() {
            note = format!("of {}: {note}", counted(self.n_points, "point"));
        }
        canvas.text(BODY.left, 778.0, &note, Text::new(13, Anchor::Start, GREY));
        match self.charts {
            Charts::Steps(history, tolerance, entry) => {
                charts::reactions(&mut canvas, UPPER, history);
                charts::residuals(&mut canvas, LOWER, history, (tolerance, entry));
            }
            // Without probes there is more room for energies.
            Charts::Times { energies, probes: [] } => {
                let all = Area { bottom: LOWER.bottom, ..UPPER };
                charts::times(&mut canvas, all, ("energy", "J"), energies);
            }
            Charts::Times { energies, probes } => {
                charts::times(&mut canvas, UPPER, ("energy", "J"), energies);
                charts::times(&mut canvas, LOWER, ("displacement at probes", "m"), probes);
            }
        }
        canvas
    }
}

fn encode_png(canvas: &Canvas) -> Result<Vec<u8>, OutputError> {
    canvas.to_png().map_err(|reason| OutputError::Picture { file: "picture.png", reason })
}

#[cfg(test)]
mod tests;
