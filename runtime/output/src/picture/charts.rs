//! The charts: reactions against the load parameter, residuals against the iteration; of a body in motion
//! what changes with time.

use super::Series;
use super::canvas::{Anchor, Canvas, DARK, GREY, Rgb, Text, shortened, text_width, viridis};
use super::chart::{Area, Axis, AxisKind, Chart, EndLabel};
use super::ticks;
use crate::{History, StepRecord};

/// Colours that differ for all kinds of colour vision (Okabe and Ito 2008), dark ones first.
pub(super) const LINES: [Rgb; 7] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
    [38, 38, 38],
];

/// Most steps whose residuals are drawn; more lines than this hide each other.
const MOST_STEPS: usize = 30;

/// Residuals below this are drawn here.
const SMALLEST_EXPONENT: f64 = -17.0;

/// Reaction against `t`: for every set that is prescribed the component that grows largest.
pub(super) fn reactions(canvas: &mut Canvas, area: Area, history: &History) {
    let mut lines = reaction_lines(history);
    let largest = |line: &ReactionLine| line.largest;
    // Supports that hold what nothing pulls at.
    let are_rounding = !lines.is_empty()
        && lines.iter().map(largest).fold(0.0, f64::max) < ROUNDING * forces(history);
    if are_rounding {
        lines.clear();
    }
    lines.sort_by(|p, q| largest(q).total_cmp(&largest(p)));
    lines.truncate(LINES.len());
    lines.sort_by_key(|line| line.set);

    let all = lines.iter().flat_map(|line| line.points.iter().map(|point| point.1));
    let (low, high) = padded_range(all.chain([0.0]), 0.06);
    let end = history.steps.iter().map(|step| step.t).fold(0.0, f64::max);
    let chart = Chart {
        area,
        x: Axis {
            name: "load parameter t",
            unit: "",
            low: 0.0,
            high: if end > 0.0 { end } else { 1.0 },
            kind: AxisKind::Linear(5),
        },
        y: Axis { name: "reaction", unit: "N", low, high, kind: AxisKind::Linear(5) },
        grid: true,
    };
    chart.draw_axes(canvas);
    if lines.is_empty() {
        let reason = match (history.steps.is_empty(), are_rounding) {
            (true, _) => "no converged step",
            (_, true) => "the reactions of every set sum up to 0, but for rounding",
            _ => "no prescribed set",
        };
        return chart.say(canvas, reason);
    }
    let zero = chart.place(0.0, 0.0)[1];
    canvas.line([area.left, zero], [area.right, zero], GREY, 1.0);
    let mut labels = Vec::new();
    for (line, colour) in lines.iter().zip(LINES) {
        let places: Vec<[f64; 2]> = line.points.iter().map(|&(t, r)| chart.place(t, r)).collect();
        draw_line(canvas, &places, colour, 2.0, 60);
        if let Some(last) = places.last() {
            let text = format!("{}, {}", shortened(&history.sets[line.set], 12), line.axis);
            labels.push(EndLabel { y: last[1], text, colour });
        }
    }
    mark_unstable(canvas, &chart, history, &lines);
    chart.label_ends(canvas, labels);
}

/// Sums of reactions below this part of the reactions themselves are nothing but rounding.
const ROUNDING: f64 = 1e-9;

/// The largest 2-norm of reactions and loads, in N: what residuals were compared with.
fn forces(history: &History) -> f64 {
    let pairs = |step: &StepRecord| {
        let pairs = step.residual.iter().zip(&step.residual_over_reaction);
        pairs
            .map(|(residual, ratio)| residual / ratio)
            .filter(|force| force.is_finite())
            .fold(0.0, f64::max)
    };
    history.steps.iter().map(pairs).fold(0.0, f64::max)
}

/// What marks states that are not stable.
const ALARM: Rgb = [179, 0, 0];

/// Crosses at these places of a chart, and what they mean.
pub(super) fn mark(canvas: &mut Canvas, chart: &Chart<'_>, places: impl Iterator<Item = [f64; 2]>) {
    let mut none = true;
    for [x, y] in places {
        canvas.line([x - 5.0, y - 5.0], [x + 5.0, y + 5.0], ALARM, 1.6);
        canvas.line([x - 5.0, y + 5.0], [x + 5.0, y - 5.0], ALARM, 1.6);
        none = false;
    }
    if !none {
        let text = Text::new(12, Anchor::End, ALARM);
        canvas.text(chart.area.right, chart.area.top - 12.0, "crosses: not stable", text);
    }
}

/// Crosses on the lines where an equilibrium is not stable.
fn mark_unstable(
    canvas: &mut Canvas,
    chart: &Chart<'_>,
    history: &History,
    lines: &[ReactionLine],
) {
    let steps = history.steps.iter().filter(|s| s.definiteness.positive_definite == Some(false));
    let unstable: Vec<f64> = steps.map(|step| step.t).collect();
    let points = lines.iter().flat_map(|line| &line.points);
    let marked = points.filter(|(t, _)| unstable.contains(t));
    mark(canvas, chart, marked.map(|&(t, reaction)| chart.place(t, reaction)));
}

/// Lines against time; at most as many as there are colours, those that go furthest.
pub(super) fn times(
    canvas: &mut Canvas,
    area: Area,
    (name, unit): (&'static str, &'static str),
    series: &[Series],
) {
    let finite = |one: &Series| -> Vec<(f64, f64)> {
        let points = one.points.iter().copied();
        points.filter(|(t, value)| t.is_finite() && value.is_finite()).collect()
    };
    let mut lines: Vec<(usize, Vec<(f64, f64)>)> =
        series.iter().map(finite).enumerate().filter(|(_, points)| !points.is_empty()).collect();
    let largest =
        |points: &[(f64, f64)]| points.iter().fold(0.0_f64, |most, point| most.max(point.1.abs()));
    lines.sort_by(|p, q| largest(&q.1).total_cmp(&largest(&p.1)));
    lines.truncate(LINES.len());
    lines.sort_by_key(|(place, _)| *place);
    let all = || lines.iter().flat_map(|(_, points)| points.iter());
    let (low, high) = padded_range(all().map(|point| point.1).chain([0.0]), 0.06);
    let end = all().map(|point| point.0).fold(0.0, f64::max);
    let chart = Chart {
        area,
        x: Axis {
            name: "time t",
            unit: "s",
            low: 0.0,
            high: if end > 0.0 { end } else { 1.0 },
            kind: AxisKind::Linear(5),
        },
        y: Axis { name, unit, low, high, kind: AxisKind::Linear(5) },
        grid: true,
    };
    chart.draw_axes(canvas);
    if lines.is_empty() {
        return chart.say(canvas, "none");
    }
    let mut labels = Vec::new();
    for ((place, points), colour) in lines.iter().zip(LINES) {
        let places: Vec<[f64; 2]> = spread(points.len(), MOST_TIMES)
            .into_iter()
            .map(|place| chart.place(points[place].0, points[place].1))
            .collect();
        draw_line(canvas, &places, colour, 1.6, 1);
        if let Some(last) = places.last() {
            let text = shortened(&series[*place].name, 16);
            labels.push(EndLabel { y: last[1], text: text.to_string(), colour });
        }
    }
    chart.label_ends(canvas, labels);
}

/// Most points of a line against time: more than pixels show nothing.
const MOST_TIMES: usize = 2000;

/// The dominant reaction component of one set.
struct ReactionLine {
    set: usize,
    axis: char,
    largest: f64,
    /// `(t, reaction)`, finite only.
    points: Vec<(f64, f64)>,
}

fn reaction_lines(history: &History) -> Vec<ReactionLine> {
    let line = |set: usize| {
        let component = |axis: usize| {
            let at_rest = history.at_rest.iter().map(move |at| (0.0, at.reactions[set][axis]));
            let all = history.steps.iter().map(move |step| (step.t, step.reactions[set][axis]));
            at_rest.chain(all).filter(|(t, reaction)| t.is_finite() && reaction.is_finite())
        };
        let largest = |axis: &usize| component(*axis).map(|(_, r)| r.abs()).fold(0.0, f64::max);
        let mut axes: Vec<usize> = (0..history.dimension).collect();
        axes.sort_by(|p, q| largest(q).total_cmp(&largest(p)));
        ReactionLine {
            set,
            axis: ['x', 'y', 'z'][axes[0]],
            largest: largest(&axes[0]),
            points: component(axes[0]).collect(),
        }
    };
    if history.steps.is_empty() {
        return Vec::new();
    }
    (0..history.sets.len())
        .filter(|set| history.prescribed[*set])
        .map(line)
        .filter(|line| !line.points.is_empty())
        .collect()
}

/// Residual over reaction against the iteration, one line per step, few of them named.
pub(super) fn residuals(
    canvas: &mut Canvas,
    area: Area,
    history: &History,
    (tolerance, entry): (f64, &'static str),
) {
    let drawn = spread(history.steps.len(), MOST_STEPS);
    let exponent = |r: f64| if r > 0.0 { libm::log10(r).max(SMALLEST_EXPONENT) } else { r };
    let lines: Vec<(usize, Vec<(f64, f64)>)> = drawn
        .into_iter()
        .map(|step| {
            let residuals = history.steps[step].residual_over_reaction.iter().enumerate();
            // A residual of exactly zero has no place on this axis: it is drawn at the bottom.
            let point = |(k, &r): (usize, &f64)| {
                (k as f64, if r == 0.0 { SMALLEST_EXPONENT } else { exponent(r) })
            };
            (step, residuals.filter(|(_, r)| r.is_finite() && **r >= 0.0).map(point).collect())
        })
        .filter(|(_, points): &(usize, Vec<_>)| !points.is_empty())
        .collect();

    let tolerance_exponent =
        if tolerance > 0.0 && tolerance.is_finite() { Some(libm::log10(tolerance)) } else { None };
    let heights = lines.iter().flat_map(|(_, points)| points.iter().map(|point| point.1));
    let (low, high) = range(heights.chain(tolerance_exponent));
    let iterations = lines.iter().flat_map(|(_, points)| points.iter().map(|point| point.0));
    let most_iterations = iterations.fold(1.0, f64::max);
    let chart = Chart {
        area,
        x: Axis {
            name: entry,
            unit: "",
            low: -0.15,
            high: most_iterations + 0.15,
            kind: AxisKind::Whole,
        },
        y: Axis {
            name: "residual / reaction",
            unit: "",
            low: (low - 0.3).floor(),
            high: (high + 0.3).ceil(),
            kind: AxisKind::Decades,
        },
        grid: true,
    };
    chart.draw_axes(canvas);
    if let Some(height) = tolerance_exponent {
        let y = chart.place(0.0, height)[1];
        canvas.dashed([area.left, y], [area.right, y], DARK, 1.0);
    }
    let tolerance_named = |canvas: &mut Canvas| {
        let Some(height) = tolerance_exponent else { return };
        let text = format!("tolerance {}", ticks::short(tolerance));
        let middle = area.left + 8.0 + text_width(&text, 12) / 2.0;
        canvas.tag([middle, chart.place(0.0, height)[1] - 10.0], &text, 12);
    };
    if lines.is_empty() {
        tolerance_named(canvas);
        return chart.say(canvas, "no converged step");
    }
    let last_step = history.steps.len().saturating_sub(1).max(1) as f64;
    let named = spread(lines.len(), 4);
    let mut labels = Vec::new();
    for (place, (step, points)) in lines.iter().enumerate() {
        // Viridis up to 0.9: its yellow end is too pale for a line on white.
        let colour = viridis(0.9 * *step as f64 / last_step);
        let places: Vec<[f64; 2]> = points.iter().map(|&(k, r)| chart.place(k, r)).collect();
        draw_line(canvas, &places, colour, 1.6, 60);
        if let (true, Some(end)) = (named.contains(&place), places.last()) {
            let text = format!("t = {}", ticks::short(history.steps[*step].t));
            labels.push(EndLabel { y: end[1], text, colour });
        }
    }
    tolerance_named(canvas);
    chart.label_ends(canvas, labels);
}

/// A line with a dot at every point, unless there are more than `most_dots`.
pub(super) fn draw_line(
    canvas: &mut Canvas,
    places: &[[f64; 2]],
    colour: Rgb,
    width: f64,
    most_dots: usize,
) {
    if places.len() > 1 {
        canvas.polyline(places, colour, width);
    }
    if places.len() <= most_dots {
        for &place in places {
            canvas.disc(place, width + 1.2, colour, None);
        }
    }
}

/// At most `most` of the numbers `0..count`, evenly spread, the first and the last among them.
pub(super) fn spread(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    let last = (most - 1).max(1);
    (0..=last).map(|i| (i * (count - 1) + last / 2) / last).collect()
}

/// The smallest and the largest of finite numbers; never equal.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in values.filter(|value| value.is_finite()) {
        low = low.min(value);
        high = high.max(value);
    }
    match (low <= high, low == high) {
        (false, _) => (0.0, 1.0),
        (true, true) => (low - 1.0, high + 1.0),
        (true, false) => (low, high),
    }
}

pub(super) fn padded_range(values: impl Iterator<Item = f64>, padding: f64) -> (f64, f64) {
    let (low, high) = range(values);
    let margin = padding * (high - low);
    (low - margin, high + margin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_of_many_with_first_and_last() {
        assert_eq!(spread(3, 4), [0, 1, 2]);
        assert_eq!(spread(25, 4), [0, 8, 16, 24]);
        assert_eq!(spread(0, 4), [0; 0]);
        let many = spread(1000, 30);
        assert_eq!((many.len(), many[0], many[29]), (30, 0, 999));
        assert!(many.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn ranges_are_never_empty() {
        assert_eq!(range([].into_iter()), (0.0, 1.0));
        assert_eq!(range([2.0, f64::NAN].into_iter()), (1.0, 3.0));
        assert_eq!(range([2.0, -1.0, f64::INFINITY].into_iter()), (-1.0, 2.0));
    }
}
