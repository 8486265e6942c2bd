//! Slices through lattices, side by side: a square per point, coloured by a number.

use super::canvas::{Anchor, Canvas, DARK, GREY, NOT_A_NUMBER, Text, viridis};
use super::chart::{Area, with_colour_bar};
use super::encode_png;
use crate::OutputError;

/// Width and height of a panel with its labels, in pixels.
const PANEL: (f64, f64) = (480.0, 456.0);
/// Height of the headline in pixels.
const HEAD: f64 = 56.0;
/// Edge of a slice in pixels.
const EDGE: f64 = 340.0;
/// Most panels in a row.
const ROW: usize = 3;

/// A page of slices.
#[derive(Clone, Debug, Default)]
pub struct SlicePlot {
    /// The headline.
    pub title: String,
    /// From left to right, in rows of up to three.
    pub panels: Vec<Slice>,
}

/// A number at each point of a plane of a lattice.
#[derive(Clone, Debug)]
pub struct Slice {
    /// What it shows.
    pub title: String,
    /// A line under the slice.
    pub note: String,
    /// Name and unit of the number.
    pub quantity: (&'static str, &'static str),
    /// The ends of the colour bar; numbers beyond have the colours of the ends.
    pub range: [f64; 2],
    /// Points per row.
    pub columns: usize,
    /// Row by row, the lowest first; grey where not finite.
    pub values: Vec<f64>,
}

impl SlicePlot {
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
        let columns = self.panels.len().clamp(1, ROW);
        let rows = self.panels.len().div_ceil(columns).max(1);
        let mut canvas = Canvas::new(PANEL.0 * columns as f64, HEAD + PANEL.1 * rows as f64);
        canvas.text(40.0, 38.0, &self.title, Text::new(20, Anchor::Start, DARK));
        for (number, slice) in self.panels.iter().enumerate() {
            let left = PANEL.0 * (number % columns) as f64 + 40.0;
            let top = PANEL.1 * (number / columns) as f64 + HEAD + 56.0;
            slice.draw(&mut canvas, Area { left, top, right: left + EDGE, bottom: top + EDGE });
        }
        canvas
    }
}

impl Slice {
    fn draw(&self, canvas: &mut Canvas, area: Area) {
        let [low, high] = self.range;
        let columns = self.columns.max(1);
        let rows = self.values.len().div_ceil(columns).max(1);
        let edge = (area.width() / columns as f64).min(area.height() / rows as f64);
        // Whole pixels, so that no seam shows.
        let edge = if edge > 1.0 { edge.floor() } else { edge };
        let area = Area { top: area.bottom - edge * rows as f64, ..area };
        let area = Area { right: area.left + edge * columns as f64, ..area };
        for (number, value) in self.values.iter().enumerate() {
            let fill = if value.is_finite() {
                viridis(((value - low) / (high - low)).clamp(0.0, 1.0))
            } else {
                NOT_A_NUMBER
            };
            let (x, y) = ((number % columns) as f64, (number / columns) as f64);
            let (x, y) = (area.left + x * edge, area.bottom - (y + 1.0) * edge);
            canvas.rectangle(x, y, edge, edge, fill);
        }
        area.frame(canvas, GREY);
        canvas.text(area.left, area.top - 30.0, &self.title, Text::new(16, Anchor::Start, DARK));
        canvas.text(area.left, area.bottom + 24.0, &self.note, Text::new(14, Anchor::Start, DARK));
        let bar = Area { left: area.right + 16.0, right: area.right + 34.0, ..area };
        let name = with_colour_bar(canvas, bar, self.quantity, self.range, 5);
        canvas.text(bar.right, area.top - 9.0, &name, Text::new(13, Anchor::End, GREY));
    }
}
