//! Conditions under which bonds, triangles and tetrahedra break: whether they are judged as written, up to a
//! few roundings of the measure around where they change.

use super::{Columns, Subject, Verification, Witness, sample, threshold};
use crate::expression::number::Number as _;
use crate::expression::precise::Precise;
use crate::kernel::{Kernel, Level, Mode, WrittenEnergy};
use crate::measure::{Argument, Measure};
use crate::model::{Model, Variant};
use crate::specialise::{CompileError, Form};
use crate::values::Values;
use sample::Point;

/// How far from a threshold one may be misjudged, in units in the last place of its measure.
const BAR: f64 = 4.0;

/// How far from a threshold they are judged, in such units.
const AROUND: i32 = 16;

/// Verifies every condition at about `2 n` points, and around every threshold between them.
pub(super) fn verify(
    model: &Model,
    variant: &Variant,
    values: &Values,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let criteria = |mode| model.criteria(values, mode, Form::Accurate);
    let strict = criteria(Mode::Jit(Level::Strict))?;
    let fast = criteria(Mode::Jit(Level::Fast))?;
    let interpreted = criteria(Mode::Interpreter)?;
    let of_measures = Measure::ALL.map(|measure| {
        let is_held = variant.breaks.iter().any(|one| one.of == measure);
        let mut points = match is_held {
            true => sample::points(variant, measure, values, n),
            false => Vec::new(),
        };
        points.sort_by(|p, q| (p.measure / p.reference).total_cmp(&(q.measure / q.reference)));
        points
    });
    let written = model.written_margins(values);
    let mut found = Vec::new();
    for (k, written) in written.iter().enumerate() {
        let kernels = [&strict[k].margin, &fast[k].margin, &interpreted[k].margin];
        let subject =
            Subject::Margin(Some(Argument::Measure(strict[k].measure())), strict[k].text.clone());
        let verification = Verification::new(subject, &[(Witness::TruthFar, BAR)]);
        let points = &of_measures[strict[k].measure() as usize];
        found.push(judge(verification, kernels, written, points));
    }
    Ok(found)
}

fn judge(
    mut found: Verification,
    kernels: [&Kernel; 3],
    written: &WrittenEnergy,
    points: &[Point],
) -> Verification {
    let mut all: Vec<(Point, f64)> = points.iter().map(|point| (*point, f64::INFINITY)).collect();
    for pair in points.windows(2) {
        let at = |point: &Point| truth(written, *point).map(|margin| margin > 0.0);
        // The same interaction at two values of its measure.
        let other =
            Point { measure: pair[1].measure / pair[1].reference * pair[0].reference, ..pair[0] };
        if let (Some(one), Some(two)) = (at(&pair[0]), at(&other))
            && one != two
        {
            all.extend(around(written, pair[0], other.measure));
        }
    }
    let places: Vec<Point> = all.iter().map(|(point, _)| *point).collect();
    let columns = Columns::new(&places);
    let [strict, fast, interpreted] = kernels.map(|kernel| kernel.derivatives(columns.batch()).psi);
    let margins = [&strict[..], &fast, &interpreted];
    let numbers = |point: &Point| vec![point.measure, point.reference];
    threshold::judge(&mut found, &all, margins, |point| truth(written, *point), numbers);
    found
}

/// The margin as written to many digits, where it is a number.
fn truth(written: &WrittenEnergy, point: Point) -> Option<f64> {
    let measure = Precise::<512>::line(point.measure, 1.0, 0.0);
    let reference = Precise::constant(point.reference);
    let margin = written.evaluate(measure, reference);
    margin.parts().map(|_| margin.rounded()[0])
}

/// Values of the measure around the threshold between two, with how far they are from it in units in the last place.
fn around(written: &WrittenEnergy, from: Point, to: f64) -> Vec<(Point, f64)> {
    let at = |measure: f64| truth(written, Point { measure, ..from }).map(|margin| margin > 0.0);
    let [low, high] = threshold::between(at, [from.measure, to]);
    let unit = (high - low).abs().max(f64::EPSILON * 0.5 * low.abs());
    let place = |k: i32| (Point { measure: low + f64::from(k) * unit, ..from }, f64::from(k.abs()));
    (-AROUND..=AROUND).map(place).collect()
}
