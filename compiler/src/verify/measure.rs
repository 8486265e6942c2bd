//! Energies of measures; where one also runs as a function of the squared measure, that form as well,
//! against the same energy as written.
//!
//! Machine code must agree with hyper-dual numbers of the energy as written to `1e-14 + 8 u/|l/L - 1|`
//! of the value: the second term is what the formula as written loses by subtracting numbers that are
//! nearly equal. Where that is missed, a value may also be off by as much as it changes when the measure,
//! or its change from rest, changes by `8 u` of itself: far out, `exp(-3*(l/L - 1))` magnifies the
//! rounding of its argument a hundred times. Where that is missed too, the energy as written has lost its
//! digits, and numbers of any precision decide, to `1e-14`.

use super::cause::cause;
use super::sample::{self, Point};
use super::{Columns, Miss, Subject, UNIT_ROUNDOFF, Verification, Ways, Witness, same_bits, truth};
use crate::kernel::{Kernel, Level, Mode, WrittenEnergy};
use crate::measure::Argument;
use crate::model::{Model, Variant};
use crate::specialise::{CompileError, Form, ScalarEnergy};
use crate::values::Values;

/// Largest relative error where hyper-dual numbers of the energy as written have lost the digits.
const PRECISE: f64 = 1e-14;

/// Verifies the energies of measures at about `2 n` points each.
pub(super) fn verify(
    model: &Model,
    variant: &Variant,
    values: &Values,
    ways: &Ways,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let energies = model.specialise(values)?.energies;
    let mut found = Vec::new();
    for (k, graph) in ways.interpreted.kernels.iter().enumerate() {
        let measure = graph.measure();
        let points = sample::points(variant, measure, values, n);
        let written = model.written(values, measure);
        let kernels = [&ways.strict.kernels[k], &ways.fast.kernels[k], graph];
        let mut of_measure =
            verify_kernels(Argument::Measure(measure), (kernels, &[]), &written, &points);
        find_causes(&mut of_measure, model, &energies[k]);
        found.push(of_measure);
        let [Some(strict), Some(fast), Some(graph)] = kernels.map(Kernel::squared) else {
            continue;
        };
        let points: Vec<Point> = points.into_iter().map(Point::squared).collect();
        let kernels = [strict, fast, graph];
        let written = written.of_square();
        let mut of_square =
            verify_kernels(Argument::Square(measure), (kernels, &[]), &written, &points);
        if let Some(energy) = model.squared(values, measure) {
            find_causes(&mut of_square, model, &energy);
        }
        found.push(of_square);
    }
    Ok(found)
}

/// Verifies energies of bonds that take the direction of a bond as an input, each in several directions.
pub(super) fn verify_directed(
    model: &Model,
    values: &Values,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let directions = super::directions(model, values.dimension);
    let (Some(variant), 2..) = (model.variant(values.dimension), directions.len()) else {
        return Ok(Vec::new());
    };
    let compiled = |mode| model.compile(values, mode, Form::Accurate).map(|all| all.kernels);
    let strict = compiled(Mode::Jit(Level::Strict))?;
    let fast = compiled(Mode::Jit(Level::Fast))?;
    let interpreted = compiled(Mode::Interpreter)?;
    let mut found = Vec::new();
    for (k, graph) in interpreted.iter().enumerate().filter(|(_, all)| !all.fields().is_empty()) {
        let measure = graph.measure();
        let points = sample::points(variant, measure, values, n);
        let squares: Vec<Point> = points.iter().map(|point| point.squared()).collect();
        for direction in &directions {
            let at = values.clone().with_direction(model, direction);
            let fields: Vec<f64> = at.typical().map(|(_, value)| value).collect();
            let (kernels, written) = ([&strict[k], &fast[k], graph], model.written(&at, measure));
            let (argument, fields) = (Argument::Measure(measure), &fields[..]);
            found.push(verify_kernels(argument, (kernels, fields), &written, &points));
            let [Some(strict), Some(fast), Some(graph)] = kernels.map(Kernel::squared) else {
                continue;
            };
            let (argument, kernels) = (Argument::Square(measure), [strict, fast, graph]);
            let written = written.of_square();
            found.push(verify_kernels(argument, (kernels, fields), &written, &squares));
        }
    }
    Ok(found)
}

/// Where each order loses its digits, at the place where it keeps the fewest.
fn find_causes(found: &mut Verification, model: &Model, energy: &ScalarEnergy) {
    for order in 0..3 {
        let Some(worst) = found.worst(order) else { continue };
        let point = Point { measure: worst.place[0], reference: worst.place[1] };
        found.causes.extend(cause(model, energy, order, point));
    }
}

/// Verifies machine code at the strict level, at the fast one, and the interpreter, with some values of their
/// fields.
fn verify_kernels(
    argument: Argument,
    (kernels, fields): ([&Kernel; 3], &[f64]),
    written: &WrittenEnergy,
    points: &[Point],
) -> Verification {
    let columns = Columns::new(points);
    let [strict, fast, interpreted] = kernels.map(|kernel| columns.derivatives_at(kernel, fields));
    let subject = Subject::Argument(argument);
    let mut verification = Verification::new(subject, &[(Witness::HyperDual, 1.0)]);
    for (i, &point) in points.iter().enumerate() {
        let [strict, fast, interpreted] =
            [&strict, &fast, &interpreted].map(|all| [all.psi[i], all.dpsi[i], all.d2psi[i]]);
        verification.count(&strict, &interpreted);
        let expected: [f64; 3] = written.derivatives(point.measure, point.reference).into();
        // A term that was dropped for its zero coefficient is 0 or, outside the domain, not a
        // number in the written form; points lie in the domain, so the values can be compared.
        compare(&mut verification, written, point, strict, expected);
        if !fast.iter().zip(&strict).all(|(x, y)| same_bits(*x, *y)) {
            compare(&mut verification, written, point, fast, expected);
        }
    }
    verification
}

pub(super) fn compare(
    found: &mut Verification,
    written: &WrittenEnergy,
    point: Point,
    compiled: [f64; 3],
    expected: [f64; 3],
) {
    // At rest nothing is subtracted but equal numbers, and no digit is lost.
    let change = point.change().abs();
    let lost = if change > 0.0 { 8.0 * UNIT_ROUNDOFF / change } else { 0.0 };
    let relative = 1e-14 + lost;
    let m = point.measure.abs();
    let size = |order: usize| expected[order].abs().max(compiled[order].abs());
    // Where a derivative passes through zero its rounding is set by the order below it.
    let scales = [size(0), size(1) + size(0) / m, size(2) + size(1) / m];
    let mut truth = None;
    for order in 0..3 {
        let (x, y) = (compiled[order], expected[order]);
        let mut tolerance = relative * scales[order] + f64::MIN_POSITIVE;
        let magnified = if error_over_tolerance(x, y, tolerance) > 1.0 {
            conditioning(written, point, expected)[order]
        } else {
            0.0
        };
        tolerance += magnified;
        let dual = y;
        let mut y = y;
        if error_over_tolerance(x, y, tolerance) > 1.0 {
            truth = truth.or_else(|| truth::truth(written, point));
            if let Some(truth) = truth {
                y = truth[order];
                tolerance = PRECISE * y.abs() + magnified + f64::MIN_POSITIVE;
            } else if !dual.is_finite() {
                // Nobody can say.
                found.undecided += 1;
                continue;
            }
        }
        let error = |value: f64| (value - y).abs() / (y.abs() + f64::MIN_POSITIVE);
        found.see(0, order, error_over_tolerance(x, y, tolerance), |_| Miss {
            place: vec![point.measure, point.reference],
            order,
            compiled: vec![x],
            expected: vec![y],
            tolerance,
            is_wrong: Miss::is_wrong(error(x), error(dual)),
        });
    }
    // Numbers of any precision had the last word.
    let overruled = |truth: [f64; 3]| {
        let off = |k: usize| error_over_tolerance(expected[k], truth[k], relative * truth[k].abs());
        (0..3).any(|k| off(k) > 1.0)
    };
    found.undecided += usize::from(truth.is_some_and(overruled));
}

/// How much psi, psi' and psi'' change when the measure changes by `8 u` of itself, or by `8 u` of
/// its change from rest; 0 where that is not a number, as beside a pole.
fn conditioning(written: &WrittenEnergy, point: Point, expected: [f64; 3]) -> [f64; 3] {
    let mut largest = [0.0_f64; 3];
    for size in [point.measure, point.measure - point.reference] {
        for step in [-8.0 * UNIT_ROUNDOFF, 8.0 * UNIT_ROUNDOFF] {
            let moved: [f64; 3] =
                written.derivatives(point.measure + step * size, point.reference).into();
            for order in 0..3 {
                let change = (moved[order] - expected[order]).abs();
                if change.is_finite() {
                    largest[order] = largest[order].max(change);
                }
            }
        }
    }
    largest
}

pub(super) fn error_over_tolerance(x: f64, y: f64, tolerance: f64) -> f64 {
    match (x.is_finite(), y.is_finite()) {
        // Where all that the tolerance is made of is beyond the range of numbers.
        (true, true) if tolerance.is_infinite() || tolerance.is_nan() => 0.0,
        (true, true) => (x - y).abs() / tolerance,
        // Beyond the range of numbers the order of operations decides between inf and NaN.
        (false, false) => 0.0,
        _ => f64::INFINITY,
    }
}
