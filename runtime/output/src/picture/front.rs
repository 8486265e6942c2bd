//! Error against time to solution: every setting a dot, those that none beats joined and numbered.

use super::canvas::{Anchor, Canvas, DARK, GREY, Rgb, Text, shortened};
use super::chart::{Area, Axis, AxisKind, Chart, EndLabel};
use super::charts::LINES;
use super::encode_png;
use crate::OutputError;

/// Width and height of the page in pixels.
const PAGE: (f64, f64) = (1240.0, 640.0);
/// Where the chart goes.
const CHART: Area = Area { left: 90.0, top: 96.0, right: 640.0, bottom: 560.0 };
/// Where the names start.
const NAMES: f64 = 880.0;
/// Distance of names in pixels.
const ROW: f64 = 19.0;
/// Most names beside the chart.
const MOST_NAMES: usize = 18;

const FRONT: Rgb = LINES[0];
const MARKED: Rgb = LINES[1];
const NEAR: Rgb = LINES[5];
const QUESTION: Rgb = LINES[3];
const BEATEN: Rgb = [176, 176, 176];

/// How a setting stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DotKind {
    /// None is as fast and as accurate.
    Front,
    /// Another is, within noise.
    Near,
    /// Another is.
    Dominated,
    /// It answers another question, and its error says how far apart the answers are.
    Question,
}

/// A setting in the picture.
#[derive(Clone, Debug)]
pub struct Dot {
    /// Its name.
    pub name: String,
    /// Shortest, middle and longest time in s.
    pub times: [f64; 3],
    /// Its relative error; 0 is drawn at the least error of the page, open.
    pub error: f64,
    /// How it stands.
    pub kind: DotKind,
    /// Whether it is named and coloured however it stands.
    pub marked: bool,
}

/// A page with one chart.
#[derive(Clone, Debug, Default)]
pub struct FrontPicture {
    /// The headline.
    pub title: String,
    /// What the error is of.
    pub error: String,
    /// The settings.
    pub dots: Vec<Dot>,
    /// Dashed lines: their names and errors.
    pub lines: Vec<(String, f64)>,
    /// The least error that is drawn: that of one rounding.
    pub least: f64,
}

impl FrontPicture {
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
        let mut canvas = Canvas::new(PAGE.0, PAGE.1);
        canvas.text(CHART.left, 38.0, &self.title, Text::new(20, Anchor::Start, DARK));
        canvas.text(CHART.left, 62.0, &self.error, Text::new(13, Anchor::Start, GREY));
        let chart = self.chart();
        chart.draw_axes(&mut canvas);
        self.draw_lines(&chart, &mut canvas);
        self.draw_front(&chart, &mut canvas);
        // The beaten first, so that nothing that matters lies under them.
        for kind in [DotKind::Dominated, DotKind::Question, DotKind::Near, DotKind::Front] {
            for dot in self.dots.iter().filter(|dot| dot.kind == kind) {
                self.draw_dot(dot, &chart, &mut canvas);
            }
        }
        self.draw_names(&chart, &mut canvas);
        canvas
    }

    fn exponent(&self, error: f64) -> f64 {
        libm::log10(error.max(self.least))
    }

    fn chart(&self) -> Chart<'_> {
        // Whole steps of `step` around the exponents.
        let axis = |name, unit, step: f64, kind, values: &mut dyn Iterator<Item = f64>| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for value in values.filter(|value| value.is_finite()) {
                (low, high) = (low.min(value), high.max(value));
            }
            if low > high {
                (low, high) = (-1.0, 0.0);
            }
            let (low, high) = ((low / step - 0.1).floor(), (high / step + 0.1).ceil());
            Axis { name, unit, low: step * low, high: step * high, kind }
        };
        let times = self.dots.iter().flat_map(|dot| dot.times);
        let lines = self.lines.iter().map(|line| line.1);
        let errors = self.dots.iter().map(|dot| dot.error).chain(lines).chain([self.least]);
        Chart {
            area: CHART,
            x: axis(
                "time to solution",
                "s",
                0.25,
                AxisKind::Logarithmic,
                &mut times.map(libm::log10),
            ),
            y: axis(
                "relative error",
                "",
                1.0,
                AxisKind::Decades,
                &mut errors.map(|error| self.exponent(error)),
            ),
            grid: true,
        }
    }

    fn place(&self, dot: &Dot, chart: &Chart) -> [f64; 2] {
        chart.place(libm::log10(dot.times[1]), self.exponent(dot.error))
    }

    fn draw_lines(&self, chart: &Chart, canvas: &mut Canvas) {
        let mut labels = Vec::new();
        for ((name, error), colour) in self.lines.iter().zip([LINES[2], LINES[4], GREY]) {
            let y = chart.place(chart.x.low, self.exponent(*error))[1];
            canvas.dashed([CHART.left, y], [CHART.right, y], colour, 1.5);
            labels.push(EndLabel { y, text: shortened(name, 30), colour });
        }
        chart.label_ends(canvas, labels);
    }

    /// The dots of the front by time.
    fn front(&self) -> Vec<&Dot> {
        let mut front: Vec<&Dot> =
            self.dots.iter().filter(|dot| dot.kind == DotKind::Front).collect();
        front.sort_by(|p, q| p.times[1].total_cmp(&q.times[1]));
        front
    }

    fn draw_front(&self, chart: &Chart, canvas: &mut Canvas) {
        let places: Vec<[f64; 2]> = self.front().iter().map(|dot| self.place(dot, chart)).collect();
        if places.len() > 1 {
            canvas.polyline(&places, FRONT, 2.0);
        }
    }

    fn draw_dot(&self, dot: &Dot, chart: &Chart, canvas: &mut Canvas) {
        let colour = match dot.kind {
            _ if dot.marked => MARKED,
            DotKind::Front => FRONT,
            DotKind::Near => NEAR,
            DotKind::Dominated => BEATEN,
            DotKind::Question => QUESTION,
        };
        let [from, place, to] =
            dot.times.map(|time| chart.place(libm::log10(time), self.exponent(dot.error)));
        canvas.line(from, to, colour, 1.0);
        let radius = if dot.kind == DotKind::Front || dot.marked { 5.0 } else { 3.5 };
        if dot.error < self.least {
            canvas.disc(place, radius, colour, None);
            canvas.disc(place, radius - 1.5, [255, 255, 255], None);
        } else {
            canvas.disc(place, radius, colour, None);
        }
    }

    /// Numbers at the dots of the front, letters at those that are marked, names beside the chart.
    fn draw_names(&self, chart: &Chart, canvas: &mut Canvas) {
        let numbered =
            self.front().into_iter().enumerate().map(|(i, dot)| ((i + 1).to_string(), dot));
        let off_front = |dot: &&Dot| dot.marked && dot.kind != DotKind::Front;
        let lettered = self.dots.iter().filter(off_front).zip(["A", "B", "C"]);
        let all: Vec<(String, &Dot)> =
            numbered.chain(lettered.map(|(dot, letter)| (letter.to_string(), dot))).collect();
        let mut y = CHART.top;
        canvas.text(NAMES, y - 14.0, "not beaten by any", Text::new(15, Anchor::Start, DARK));
        for (tag, dot) in all.iter().take(MOST_NAMES) {
            let [x, at] = self.place(dot, chart);
            canvas.text(x + 6.0, at - 7.0, tag, Text::new(13, Anchor::Start, DARK));
            let text = format!("{tag}  {}", shortened(&dot.name, 44));
            let colour = if dot.marked { MARKED } else { DARK };
            y += ROW;
            canvas.text(NAMES, y - 8.0, &text, Text::new(13, Anchor::Start, colour));
        }
        y += ROW;
        let kinds = [
            (FRONT, "not beaten"),
            (NEAR, "beaten within noise"),
            (BEATEN, "beaten"),
            (QUESTION, "another body: how far its answer is"),
        ];
        let is_there = |kind: DotKind| self.dots.iter().any(|dot| dot.kind == kind && !dot.marked);
        let shown =
            [DotKind::Front, DotKind::Near, DotKind::Dominated, DotKind::Question].map(is_there);
        for ((colour, text), _) in kinds.into_iter().zip(shown).filter(|(_, shown)| *shown) {
            y += ROW;
            canvas.disc([NAMES + 5.0, y - 4.0], 4.0, colour, None);
            canvas.text(NAMES + 18.0, y, text, Text::new(13, Anchor::Start, GREY));
        }
        if self.dots.iter().any(|dot| dot.error < self.least) {
            y += ROW;
            canvas.disc([NAMES + 5.0, y - 4.0], 4.0, GREY, None);
            canvas.disc([NAMES + 5.0, y - 4.0], 2.5, [255, 255, 255], None);
            let text = "less than one rounding, or the same bits";
            canvas.text(NAMES + 18.0, y, text, Text::new(13, Anchor::Start, GREY));
        }
        let text = "bars: shortest to longest of interleaved runs";
        canvas.text(NAMES, y + 1.5 * ROW, text, Text::new(13, Anchor::Start, GREY));
    }
}
