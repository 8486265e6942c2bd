//! What a body does against a value that is varied: a chart per quantity.

use super::canvas::{Anchor, Canvas, DARK, GREY, Text, shortened};
use super::chart::{Area, Axis, AxisKind, Chart, EndLabel};
use super::charts::{LINES, draw_line, padded_range};
use super::encode_png;
use crate::OutputError;

/// Height of the page and width of one chart with its labels, in pixels.
const HEIGHT: f64 = 560.0;
const WIDTH: f64 = 620.0;

/// Most charts of a page.
const MOST_CHARTS: usize = 4;

/// Values from the least to the greatest grow by this much before powers of ten are shown.
const WIDE: f64 = 30.0;

/// Values that differ by a smaller part of the largest do so by rounding.
const ROUNDING: f64 = 1e-9;

/// A part of a line without gaps.
type Piece = Vec<(f64, f64)>;

/// A line of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepLine {
    /// Its name.
    pub name: String,
    /// Values that were varied and what was found; a line has a gap at what is not finite.
    pub points: Vec<(f64, f64)>,
}

/// One quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepChart {
    /// What it is, and its unit.
    pub name: String,
    /// The unit; empty where there is none.
    pub unit: String,
    /// Its lines; those that go furthest are drawn where there are more than colours.
    pub lines: Vec<SweepLine>,
}

/// A page with a chart per quantity.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SweepPicture {
    /// The headline.
    pub title: String,
    /// What is varied.
    pub varied: String,
    /// Whether its values are numbers of the runs, because they are no numbers themselves.
    pub counts: bool,
    /// The charts, at least one.
    pub charts: Vec<SweepChart>,
    /// Under them: how many runs there were, and what became of others.
    pub note: String,
}

impl SweepPicture {
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
        let n = self.charts.len().clamp(1, MOST_CHARTS);
        let mut canvas = Canvas::new(WIDTH * n as f64, HEIGHT);
        canvas.text(80.0, 38.0, &self.title, Text::new(20, Anchor::Start, DARK));
        canvas.text(80.0, HEIGHT - 12.0, &self.note, Text::new(13, Anchor::Start, GREY));
        for (place, chart) in self.charts.iter().take(MOST_CHARTS).enumerate() {
            let left = WIDTH * place as f64 + 90.0;
            let area = Area { left, top: 96.0, right: left + WIDTH - 250.0, bottom: HEIGHT - 84.0 };
            self.draw_chart(&mut canvas, area, chart);
        }
        canvas
    }

    fn draw_chart(&self, canvas: &mut Canvas, area: Area, chart: &SweepChart) {
        let values = || self.charts.iter().flat_map(|c| &c.lines).flat_map(|line| &line.points);
        let least = values().map(|point| point.0).fold(f64::INFINITY, f64::min);
        let most = values().map(|point| point.0).fold(f64::NEG_INFINITY, f64::max);
        let by_factors = !self.counts && least > 0.0 && most / least >= WIDE;
        let along = |x: f64| if by_factors { libm::log10(x) } else { x };
        let (low, high) = padded_range([along(least), along(most)].into_iter(), 0.04);
        let kind = match (by_factors, self.counts) {
            (true, _) => AxisKind::Decades,
            (false, true) => AxisKind::Whole,
            (false, false) => AxisKind::Linear(5),
        };
        // A line goes on beyond what was not found, and not across it.
        let pieces = |line: &SweepLine| -> Vec<Piece> {
            let pieces = line.points.split(|(_, y)| !y.is_finite());
            pieces.filter(|piece| !piece.is_empty()).map(<[_]>::to_vec).collect()
        };
        let mut lines: Vec<(usize, Vec<Piece>)> =
            chart.lines.iter().map(pieces).enumerate().filter(|(_, p)| !p.is_empty()).collect();
        let largest =
            |pieces: &[Piece]| pieces.iter().flatten().fold(0.0_f64, |most, p| most.max(p.1.abs()));
        lines.sort_by(|p, q| largest(&q.1).total_cmp(&largest(&p.1)));
        lines.truncate(LINES.len());
        lines.sort_by_key(|(place, _)| *place);
        let heights = lines.iter().flat_map(|(_, pieces)| pieces.iter().flatten().map(|p| p.1));
        let (floor, roof) = heights_shown(heights);
        let drawn = Chart {
            area,
            x: Axis { name: &self.varied, unit: "", low, high, kind },
            y: Axis {
                name: &chart.name,
                unit: &chart.unit,
                low: floor,
                high: roof,
                kind: AxisKind::Linear(5),
            },
            grid: true,
        };
        drawn.draw_axes(canvas);
        if lines.is_empty() {
            return drawn.say(canvas, "no run reached its end");
        }
        let mut labels = Vec::new();
        for ((place, pieces), colour) in lines.iter().zip(LINES) {
            let mut end = 0.0;
            for piece in pieces {
                let places: Vec<[f64; 2]> =
                    piece.iter().map(|(x, y)| drawn.place(along(*x), *y)).collect();
                draw_line(canvas, &places, colour, 2.0, 100);
                end = places.last().map_or(end, |last| last[1]);
            }
            let text = shortened(&chart.lines[*place].name, 18);
            labels.push(EndLabel { y: end, text, colour });
        }
        drawn.label_ends(canvas, labels);
    }
}

/// From where to where an axis goes; values that differ by rounding alone are shown as one.
fn heights_shown(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let most = values.clone().fold(0.0_f64, |most, x| most.max(x.abs()));
    let (low, high) = padded_range(values, 0.06);
    if high - low > ROUNDING * most {
        return (low, high);
    }
    let middle = 0.5 * (low + high);
    (middle - 0.1 * most.max(f64::MIN_POSITIVE), middle + 0.1 * most.max(f64::MIN_POSITIVE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_shows_its_lines_and_says_where_there_are_none() {
        let line = |name: &str, points: &[(f64, f64)]| SweepLine {
            name: name.to_string(),
            points: points.to_vec(),
        };
        let chart = |lines: Vec<SweepLine>| SweepChart {
            name: "energy".to_string(),
            unit: "J".to_string(),
            lines,
        };
        let mut page = SweepPicture {
            title: "plate".to_string(),
            varied: "C2".to_string(),
            counts: false,
            charts: vec![chart(vec![line("one", &[(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)])])],
            note: "3 runs".to_string(),
        };
        let svg = page.to_svg();
        for part in ["plate", "C2", "energy (J)", "one", "3 runs"] {
            assert!(svg.contains(part), "no {part} in {svg}");
        }
        assert!(!svg.contains("NaN"));
        page.charts = vec![chart(vec![line("none", &[(1.0, f64::NAN)])]); 6];
        assert!(page.to_svg().contains("no run reached its end"));
        assert!(!page.to_png().unwrap().is_empty());
        // Over decades by powers of ten.
        page.charts = vec![chart(vec![line("one", &[(1e3, 1.0), (1e6, 2.0)])])];
        assert!(page.to_svg().contains("10⁴") || page.to_svg().contains("10⁵"));
    }
}
