//! Lines over powers of ten: errors against strain, errors against step.

use super::canvas::{Anchor, Canvas, DARK, Text};
use super::chart::{Area, Axis, AxisKind, Chart, EndLabel};
use super::charts::{LINES, draw_line};
use super::encode_png;
use crate::OutputError;

/// Width and height of a panel with its labels, in pixels.
const PANEL: (f64, f64) = (760.0, 510.0);
/// Height of the headline in pixels.
const HEAD: f64 = 50.0;
/// Most panels in a row.
const ROW: usize = 3;

/// A page of charts; both axes of each count powers of ten.
#[derive(Clone, Debug, Default)]
pub struct LogarithmicPlot {
    /// The headline.
    pub title: String,
    /// From left to right, in rows of up to three and of equal length where they can be.
    pub panels: Vec<LogarithmicPanel>,
}

/// A chart of a page.
#[derive(Clone, Debug)]
pub struct LogarithmicPanel {
    /// What it shows.
    pub title: String,
    /// What the horizontal axis measures.
    pub x: &'static str,
    /// What the vertical axis measures.
    pub y: &'static str,
    /// At most seven lines: name and points; those that are not positive are left out.
    pub lines: Vec<(String, Vec<(f64, f64)>)>,
}

impl LogarithmicPlot {
    /// The page as SVG.
    pub fn to_svg(&self) -> String {
        self.draw().to_svg()
    }

    /// The page as PNG.
    ///
    /// # Errors
    /// A page too large for the encoder.
    pub fn to_png(&self) -> Result<Vec<u8>, OutputError> {
        encode_png(&self.draw())
    }

    fn draw(&self) -> Canvas {
        let rows = self.panels.len().div_ceil(ROW).max(1);
        let columns = self.panels.len().div_ceil(rows).max(1);
        let size = (PANEL.0 * columns as f64, HEAD + PANEL.1 * rows as f64);
        let mut canvas = Canvas::new(size.0, size.1);
        canvas.text(80.0, 38.0, &self.title, Text::new(20, Anchor::Start, DARK));
        for (number, panel) in self.panels.iter().enumerate() {
            let left = PANEL.0 * (number % columns) as f64 + 80.0;
            let top = PANEL.1 * (number / columns) as f64 + HEAD;
            let bottom = top + PANEL.1 - 80.0;
            panel.draw(&mut canvas, Area { left, top: top + 70.0, right: left + 470.0, bottom });
        }
        canvas
    }
}

impl LogarithmicPanel {
    fn draw(&self, canvas: &mut Canvas, area: Area) {
        let exponents = |(x, y): &(f64, f64)| (libm::log10(*x), libm::log10(*y));
        let lines: Vec<(&str, Vec<(f64, f64)>)> = self
            .lines
            .iter()
            .map(|(name, points)| (name.as_str(), points.iter().map(exponents).collect()))
            .map(|(name, points): (&str, Vec<(f64, f64)>)| {
                let finite = points.into_iter().filter(|(x, y)| x.is_finite() && y.is_finite());
                (name, finite.collect())
            })
            .collect();
        let all = || lines.iter().flat_map(|(_, points)| points.iter().copied());
        let axis = |name: &'static str, values: Vec<f64>| {
            let low = values.iter().copied().fold(f64::INFINITY, f64::min).floor();
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max).ceil();
            let (low, high) = if low < high { (low, high) } else { (low - 1.0, low + 1.0) };
            let (low, high) = if low.is_finite() { (low, high) } else { (-1.0, 0.0) };
            Axis { name, unit: "", low, high, kind: AxisKind::Decades }
        };
        let chart = Chart {
            area,
            x: axis(self.x, all().map(|point| point.0).collect()),
            y: axis(self.y, all().map(|point| point.1).collect()),
            grid: true,
        };
        canvas.text(area.left, area.top - 44.0, &self.title, Text::new(15, Anchor::Start, DARK));
        chart.draw_axes(canvas);
        let mut labels = Vec::new();
        for (number, ((name, points), colour)) in lines.iter().zip(LINES).enumerate() {
            let places: Vec<[f64; 2]> = points.iter().map(|&(x, y)| chart.place(x, y)).collect();
            // What lies under others is wider than they are, and so can be seen.
            let width = 2.0 + 0.5 * (lines.len() - 1 - number) as f64;
            draw_line(canvas, &places, colour, width, 60);
            let last = places.iter().max_by(|p, q| p[0].total_cmp(&q[0]));
            if let Some(last) = last {
                labels.push(EndLabel { y: last[1], text: name.to_string(), colour });
            }
        }
        if labels.is_empty() {
            chart.say(canvas, "nothing to show");
        }
        chart.label_ends(canvas, labels);
    }
}
