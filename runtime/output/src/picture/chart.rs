//! A rectangle with two axes.

use super::canvas::{Anchor, Canvas, DARK, GREY, LIGHT, Rgb, Text, viridis};
use super::ticks::{self, power_of_ten, with_unit};

/// A rectangle on the page, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Area {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

impl Area {
    pub(super) fn width(&self) -> f64 {
        self.right - self.left
    }

    pub(super) fn height(&self) -> f64 {
        self.bottom - self.top
    }

    pub(super) fn centre(&self) -> [f64; 2] {
        [(self.left + self.right) / 2.0, (self.top + self.bottom) / 2.0]
    }

    /// The outline.
    pub(super) fn frame(&self, canvas: &mut Canvas, stroke: Rgb) {
        let Area { left, top, right, bottom } = *self;
        let corners = [[left, top], [right, top], [right, bottom], [left, bottom]];
        for side in 0..4 {
            canvas.line(corners[side], corners[(side + 1) % 4], stroke, 1.0);
        }
    }
}

/// Nearer than this, in pixels, two numbers beside a bar of colours hide each other.
const APART: f64 = 18.0;

/// Draws a bar of the colours from `low` to `high` with its ticks and the numbers at its ends; its name with
/// unit and power of ten.
pub(super) fn with_colour_bar(
    canvas: &mut Canvas,
    bar: Area,
    (name, unit): (&str, &str),
    [low, high]: [f64; 2],
    wanted: usize,
) -> String {
    const STRIPES: usize = 102; // five whole pixels each on the page of a run
    let height = bar.height() / STRIPES as f64;
    for stripe in (0..STRIPES).rev() {
        let colour = viridis((stripe as f64 + 0.5) / STRIPES as f64);
        let y = bar.bottom - (stripe + 1) as f64 * height;
        // Each stripe reaches under the one below it, so that no seam shows.
        let reach = if stripe > 0 { 1.0 } else { 0.0 };
        canvas.rectangle(bar.left, y, bar.width(), height + reach, colour);
    }
    bar.frame(canvas, GREY);
    let ticks = ticks::linear(low, high, wanted);
    let at = |value: f64| bar.bottom - (value - low) / (high - low) * bar.height();
    let mut mark = |value: f64, label: &str, colour: Rgb| {
        let y = at(value);
        canvas.line([bar.right, y], [bar.right + 5.0, y], GREY, 1.0);
        canvas.text(bar.right + 9.0, y + 4.5, label, Text::new(13, Anchor::Start, colour));
    };
    for (value, label) in ticks.values.iter().zip(&ticks.labels) {
        mark(*value, label, DARK);
    }
    for end in [low, high] {
        if ticks.values.iter().all(|value| (at(*value) - at(end)).abs() > APART) {
            mark(end, &ticks.between(end), GREY);
        }
    }
    with_unit(name, unit, ticks.exponent)
}

/// What an axis measures, between which values.
#[derive(Clone, Debug)]
pub(super) struct Axis<'a> {
    pub(super) name: &'a str,
    pub(super) unit: &'a str,
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) kind: AxisKind,
}

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum AxisKind {
    /// Evenly, with about this many ticks.
    Linear(usize),
    /// Evenly, ticks at whole numbers only.
    Whole,
    /// By powers of ten: `low` and `high` are exponents, and so is what is placed.
    Decades,
    /// The same over few powers of ten: ticks at 1, 2 and 5 times each, written out.
    Logarithmic,
}

impl Axis<'_> {
    /// Where `value` is: 0 at the low end, 1 at the high end.
    fn fraction(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    /// Places and labels of the ticks, and the axis label.
    fn ticks(&self) -> (Vec<f64>, Vec<String>, String) {
        match self.kind {
            AxisKind::Linear(wanted) => {
                let ticks = ticks::linear(self.low, self.high, wanted);
                (ticks.values, ticks.labels, with_unit(self.name, self.unit, ticks.exponent))
            }
            AxisKind::Whole => {
                let step = ticks::round_step((self.high - self.low) / 8.0).max(1.0) as usize;
                let low = self.low.max(0.0).ceil() as usize;
                let values: Vec<usize> =
                    (low..=self.high.max(0.0) as usize).step_by(step.max(1)).collect();
                let labels = values.iter().map(usize::to_string).collect();
                let values = values.into_iter().map(|v| v as f64).collect();
                (values, labels, with_unit(self.name, self.unit, 0))
            }
            AxisKind::Decades => {
                let decades = ticks::decades(self.low.ceil() as i32, self.high.floor() as i32, 6);
                let labels = decades.iter().map(|&decade| power_of_ten(decade)).collect();
                let values = decades.into_iter().map(f64::from).collect();
                (values, labels, with_unit(self.name, self.unit, 0))
            }
            AxisKind::Logarithmic => {
                let ticks = ticks::one_two_five(self.low, self.high, 7);
                let labels = ticks.iter().map(|&tick| ticks::short(tick)).collect();
                let values = ticks.iter().map(|&tick| libm::log10(tick)).collect();
                (values, labels, with_unit(self.name, self.unit, 0))
            }
        }
    }
}

/// Two axes around an area.
#[derive(Clone, Debug)]
pub(super) struct Chart<'a> {
    pub(super) area: Area,
    pub(super) x: Axis<'a>,
    pub(super) y: Axis<'a>,
    /// Whether lines lead from the ticks across the area.
    pub(super) grid: bool,
}

impl Chart<'_> {
    /// The place of a pair of values on the page.
    pub(super) fn place(&self, x: f64, y: f64) -> [f64; 2] {
        [
            self.area.left + self.x.fraction(x) * self.area.width(),
            self.area.bottom - self.y.fraction(y) * self.area.height(),
        ]
    }

    /// Frame, ticks, labels; to be drawn before the content.
    pub(super) fn draw_axes(&self, canvas: &mut Canvas) {
        let area = self.area;
        let (x_values, x_labels, x_name) = self.x.ticks();
        for (value, label) in x_values.iter().zip(&x_labels) {
            let [x, _] = self.place(*value, self.y.low);
            if self.grid {
                canvas.line([x, area.top], [x, area.bottom], LIGHT, 1.0);
            }
            canvas.line([x, area.bottom], [x, area.bottom + 5.0], GREY, 1.0);
            canvas.text(x, area.bottom + 20.0, label, Text::new(13, Anchor::Middle, DARK));
        }
        let (y_values, y_labels, y_name) = self.y.ticks();
        for (value, label) in y_values.iter().zip(&y_labels) {
            let [_, y] = self.place(self.x.low, *value);
            if self.grid {
                canvas.line([area.left, y], [area.right, y], LIGHT, 1.0);
            }
            canvas.line([area.left - 5.0, y], [area.left, y], GREY, 1.0);
            canvas.text(area.left - 9.0, y + 4.5, label, Text::new(13, Anchor::End, DARK));
        }
        area.frame(canvas, GREY);
        let [x, _] = area.centre();
        canvas.text(x, area.bottom + 44.0, &x_name, Text::new(15, Anchor::Middle, DARK));
        // Above the axis, not along it: nobody has to tilt their head.
        let (x, y) = (area.left - 40.0, area.top - 14.0);
        canvas.text(x, y, &y_name, Text::new(15, Anchor::Start, DARK));
    }

    /// Names lines at the right edge, each beside its end, moved apart so that none overlap.
    pub(super) fn label_ends(&self, canvas: &mut Canvas, mut labels: Vec<EndLabel>) {
        const SIZE: u32 = 13;
        let gap = f64::from(SIZE) * 1.35;
        labels.sort_by(|p, q| p.y.total_cmp(&q.y));
        let wanted: Vec<f64> = labels.iter().map(|label| label.y).collect();
        let placed = moved_apart(&wanted, gap, self.area.top, self.area.bottom);
        for (label, y) in labels.iter().zip(placed) {
            let x = self.area.right + 10.0;
            canvas.line([x, y], [x + 14.0, y], label.colour, 2.5);
            canvas.text(x + 20.0, y + 4.5, &label.text, Text::new(SIZE, Anchor::Start, DARK));
        }
    }

    /// A sentence instead of lines.
    pub(super) fn say(&self, canvas: &mut Canvas, sentence: &str) {
        let [x, y] = self.area.centre();
        canvas.text(x, y, sentence, Text::new(14, Anchor::Middle, GREY));
    }
}

/// The name of a line.
#[derive(Clone, Debug)]
pub(super) struct EndLabel {
    /// Where the line ends on the page.
    pub(super) y: f64,
    pub(super) text: String,
    pub(super) colour: Rgb,
}

/// Ascending positions close to `wanted` (ascending), at least `gap` apart, between the ends as
/// far as there is room.
fn moved_apart(wanted: &[f64], gap: f64, low: f64, high: f64) -> Vec<f64> {
    let mut placed: Vec<f64> = Vec::with_capacity(wanted.len());
    for &position in wanted {
        let least = placed.last().map_or(low, |last| last + gap);
        placed.push(position.max(least));
    }
    let mut most = high;
    for position in placed.iter_mut().rev() {
        *position = position.min(most);
        most = *position - gap;
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_move_apart_and_stay_inside() {
        assert_eq!(moved_apart(&[10.0, 50.0], 10.0, 0.0, 100.0), [10.0, 50.0]);
        assert_eq!(moved_apart(&[50.0, 50.0, 51.0], 10.0, 0.0, 100.0), [50.0, 60.0, 70.0]);
        assert_eq!(moved_apart(&[99.0, 99.0, 100.0], 10.0, 0.0, 100.0), [80.0, 90.0, 100.0]);
        assert_eq!(moved_apart(&[-5.0, 3.0], 10.0, 0.0, 100.0), [0.0, 10.0]);
    }

    #[test]
    fn values_are_placed_on_the_page() {
        let axis = |low, high| Axis { name: "x", unit: "m", low, high, kind: AxisKind::Linear(4) };
        let area = Area { left: 100.0, top: 50.0, right: 300.0, bottom: 150.0 };
        let chart = Chart { area, x: axis(0.0, 2.0), y: axis(-1.0, 1.0), grid: true };
        assert_eq!(chart.place(0.0, -1.0), [100.0, 150.0]);
        assert_eq!(chart.place(2.0, 1.0), [300.0, 50.0]);
        assert_eq!(chart.place(1.0, 0.0), [200.0, 100.0]);
    }
}
