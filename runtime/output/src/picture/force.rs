//! Force against displacement, from the tables of a run.

use super::canvas::{Anchor, Canvas, DARK, Text, shortened};
use super::chart::{Area, Axis, AxisKind, Chart};
use super::charts::{LINES, draw_line, mark, padded_range};
use super::encode_png;
use crate::OutputFile;
use crate::read::read_numbers;
use crate::results::{Results, ResultsError};
use crate::table::{AXES, COMPONENTS};

/// Width and height of the page in pixels.
const PAGE: (f64, f64) = (980.0, 640.0);
const CHART: Area = Area { left: 110.0, top: 84.0, right: 920.0, bottom: 560.0 };

/// The force on a set against the displacement of it, of another set or of a probe.
#[derive(Clone, Debug, PartialEq)]
pub struct ForcePicture {
    title: String,
    names: [String; 2],
    /// Of every step t, displacement in m and force in N, the body at rest before them.
    points: Vec<[f64; 3]>,
    /// Steps that are no stable equilibria, by their t.
    unstable: Vec<f64>,
}

impl ForcePicture {
    /// The force on `set` along the axis in which it is largest, its reaction and the loads on it, against the
    /// displacement of `against`, a set or a probe, along the same axis; against its own if nothing is named. Of a
    /// body in motion it is the reaction alone, against a probe: tables have no displacements of sets there.
    ///
    /// # Errors
    /// A run without tables, a set or a probe that it has not.
    pub fn new(
        results: &Results,
        set: &str,
        against: Option<&str>,
    ) -> Result<ForcePicture, ResultsError> {
        let d = results.dimension();
        let moves = !results.summary()["motion"].is_null();
        let (forces, what) = match moves {
            true => (OutputFile::Reactions, "reaction"),
            false => (OutputFile::Forces, "force"),
        };
        if moves && against.is_none() {
            return Err(ResultsError::Missing {
                path: results.folder().to_owned(),
                wanted: format!("displacement of `{set}`"),
                found: "those of probes, as of every body in motion: name one, `--against PROBE`"
                    .to_owned(),
            });
        }
        let suffixed = |name: &str, suffixes: &[&str]| -> Vec<String> {
            suffixes[..d].iter().map(|suffix| format!("{name}_{suffix}")).collect()
        };
        let all = columns(results, forces, &suffixed(set, &AXES), set)?;
        let largest = |axis: &usize| all.iter().map(|row| row[axis + 1].abs()).fold(0.0, f64::max);
        let axis = (0..d).rev().max_by(|p, q| largest(p).total_cmp(&largest(q))).unwrap_or(0);
        let other = against.unwrap_or(set);
        let wanted = suffixed(other, &COMPONENTS);
        let probes = || columns(results, OutputFile::Probes, &wanted, other);
        // Probes have no row of the body at rest, where displacements are 0.
        let of_sets = if moves { None } else { columns(results, forces, &wanted, other).ok() };
        let mut moved = of_sets.map_or_else(probes, Ok)?;
        if moved.len() < all.len() {
            moved.insert(0, vec![0.0; d + 1]);
        }
        let pairs = all.iter().zip(&moved).map(|(f, u)| [f[0], u[axis + 1], f[axis + 1]]);
        let finite = pairs.filter(|point| point.iter().all(|x| x.is_finite()));
        let steps = results.summary()["steps"].as_array().into_iter().flatten();
        let unstable = steps.filter(|step| step["positive_definite"] == false);
        let along = AXES[axis];
        Ok(ForcePicture {
            title: results.summary()["title"].as_str().unwrap_or_default().to_owned(),
            names: [
                format!("displacement of {other} along {along}"),
                format!("{what} on {set} along {along}"),
            ],
            points: finite.collect(),
            unstable: unstable.filter_map(|step| step["t"].as_f64()).collect(),
        })
    }

    /// The picture as PNG or SVG.
    ///
    /// # Errors
    /// A page that cannot be encoded.
    pub fn to_bytes(&self, as_svg: bool) -> Result<Vec<u8>, ResultsError> {
        let canvas = self.draw();
        Ok(if as_svg { canvas.to_svg().into_bytes() } else { encode_png(&canvas)? })
    }

    fn draw(&self) -> Canvas {
        let mut canvas = Canvas::new(PAGE.0, PAGE.1);
        let title = shortened(&self.title, 80);
        canvas.text(CHART.left, 38.0, &title, Text::new(20, Anchor::Start, DARK));
        let along = |place: usize| self.points.iter().map(move |point| point[place]);
        let (left, right) = padded_range(along(1).chain([0.0]), 0.04);
        let (low, high) = padded_range(along(2).chain([0.0]), 0.06);
        let kind = AxisKind::Linear(6);
        let chart = Chart {
            area: CHART,
            x: Axis { name: &self.names[0], unit: "m", low: left, high: right, kind },
            y: Axis { name: &self.names[1], unit: "N", low, high, kind },
            grid: true,
        };
        chart.draw_axes(&mut canvas);
        let places: Vec<[f64; 2]> =
            self.points.iter().map(|[_, u, force]| chart.place(*u, *force)).collect();
        draw_line(&mut canvas, &places, LINES[0], 2.0, 80);
        let unstable =
            self.points.iter().zip(&places).filter(|([t, ..], _)| self.unstable.contains(t));
        mark(&mut canvas, &chart, unstable.map(|(_, place)| *place));
        canvas
    }
}

/// `t` and the named columns of a table.
fn columns(
    results: &Results,
    file: OutputFile,
    names: &[String],
    wanted: &str,
) -> Result<Vec<Vec<f64>>, ResultsError> {
    let path = results.folder().join(file.relative());
    let text = results.text(file)?.unwrap_or_default();
    let all: Vec<&str> = ["t"].into_iter().chain(names.iter().map(String::as_str)).collect();
    let header = text.lines().next().unwrap_or("no table").to_owned();
    // Names with commas stand in quotes there.
    let are_there = names.iter().all(|name| header.contains(name.replace('"', "\"\"").as_str()));
    read_numbers(&text, &all, |_| None).map_err(|errors| match errors.first() {
        Some(error) if are_there => ResultsError::Unreadable { path, reason: error.to_string() },
        _ => {
            ResultsError::Missing { path, wanted: format!("columns of `{wanted}`"), found: header }
        }
    })
}
