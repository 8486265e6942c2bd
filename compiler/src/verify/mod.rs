//! Generated derivatives against independent ones, over the declared domain; where an energy also runs
//! as a function of the squared measure, that form as well, against the same energy as written.
//!
//! Machine code at the strict level must equal the interpreter bit for bit; machine code at every level
//! must agree with hyper-dual numbers of the energy as written to `1e-14 + 8 u/|l/L - 1|` of the value: the second term is what the formula
//! as written loses by subtracting numbers that are nearly equal. Where that is missed, a value may
//! also be off by as much as it changes when the measure, or its change from rest, changes by `8 u`
//! of itself: far out, `exp(-3*(l/L - 1))` magnifies the rounding of its argument a hundred times.
//! Where that is missed too, the energy as written has lost its digits, and numbers of any precision
//! decide, to `1e-14`.

pub mod sample;
pub mod truth;

use crate::kernel::{Batch, Kernel, Level, Mode, WrittenEnergy};
use crate::measure::Argument;
use crate::model::Model;
use crate::specialise::{CompileError, Dropped, Form};
use crate::values::Values;
use sample::Point;

/// Half the distance from 1 to the next number.
pub const UNIT_ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// Largest relative error where hyper-dual numbers of the energy as written have lost the digits.
const PRECISE: f64 = 1e-14;

/// What was found for one energy.
#[derive(Clone, Debug)]
pub struct Verification {
    /// What it is a function of: a measure, or the square of one.
    pub argument: Argument,
    /// How many points were tried.
    pub n_points: usize,
    /// Where machine code at the strict level and interpreter differ in some bit.
    pub different_bits: Vec<Point>,
    /// Where psi, psi' or psi'' misses its tolerance, at the strict level or the fast one.
    pub misses: Vec<Miss>,
    /// Largest error over tolerance of psi, psi', psi''; at most 1 where nothing misses.
    pub worst: [f64; 3],
}

/// A value outside its tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Miss {
    /// Where.
    pub point: Point,
    /// 0, 1, 2 for psi, psi', psi''.
    pub order: usize,
    /// The compiled value.
    pub compiled: f64,
    /// The hyper-dual value of the energy as written.
    pub expected: f64,
    /// Largest difference allowed.
    pub tolerance: f64,
}

impl Verification {
    /// Whether nothing was found.
    pub fn passed(&self) -> bool {
        self.n_points > 0 && self.different_bits.is_empty() && self.misses.is_empty()
    }
}

/// Verifies every energy of a model for these values at about `2 n` points each, and once more where
/// it has a kernel for the squared measure.
///
/// # Errors
/// Energies that cannot be compiled.
pub fn verify(
    model: &Model,
    values: &Values,
    n: usize,
) -> Result<(Vec<Verification>, Vec<Dropped>), CompileError> {
    let strict = model.compile(values, Mode::Jit(Level::Strict), Form::Accurate)?;
    let fast = model.compile(values, Mode::Jit(Level::Fast), Form::Accurate)?;
    let interpreted = model.compile(values, Mode::Interpreter, Form::Accurate)?;
    let variant =
        model.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
    let mut found = Vec::new();
    for (k, graph) in interpreted.kernels.iter().enumerate() {
        let measure = graph.measure();
        let points = sample::points(variant, measure, values, n);
        let written = model.written(values, measure);
        let kernels = [&strict.kernels[k], &fast.kernels[k], graph];
        found.push(verify_kernels(Argument::Measure(measure), kernels, &written, &points));
        let [Some(strict), Some(fast), Some(graph)] = kernels.map(Kernel::squared) else {
            continue;
        };
        let points: Vec<Point> = points.into_iter().map(Point::squared).collect();
        let kernels = [strict, fast, graph];
        let written = written.of_square();
        found.push(verify_kernels(Argument::Square(measure), kernels, &written, &points));
    }
    Ok((found, interpreted.dropped))
}

/// Verifies machine code at the strict level, at the fast one, and the interpreter.
fn verify_kernels(
    argument: Argument,
    kernels: [&Kernel; 3],
    written: &WrittenEnergy,
    points: &[Point],
) -> Verification {
    let columns = Columns::new(points);
    let [strict, fast, interpreted] = kernels.map(|kernel| kernel.derivatives(columns.batch()));
    let mut verification = Verification {
        argument,
        n_points: points.len(),
        different_bits: Vec::new(),
        misses: Vec::new(),
        worst: [0.0; 3],
    };
    for (i, &point) in points.iter().enumerate() {
        let [strict, fast, interpreted] =
            [&strict, &fast, &interpreted].map(|all| [all.psi[i], all.dpsi[i], all.d2psi[i]]);
        if !strict.iter().zip(&interpreted).all(|(x, y)| same_bits(*x, *y)) {
            verification.different_bits.push(point);
        }
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

fn compare(
    found: &mut Verification,
    written: &WrittenEnergy,
    point: Point,
    compiled: [f64; 3],
    expected: [f64; 3],
) {
    let relative = 1e-14 + 8.0 * UNIT_ROUNDOFF / point.change().abs();
    let m = point.measure.abs();
    let size = |order: usize| expected[order].abs().max(compiled[order].abs());
    // Where a derivative passes through zero its rounding is set by the order below it.
    let scales = [size(0), size(1) + size(0) / m, size(2) + size(1) / m];
    for order in 0..3 {
        let (x, y) = (compiled[order], expected[order]);
        let mut tolerance = relative * scales[order] + f64::MIN_POSITIVE;
        let magnified = if error_over_tolerance(x, y, tolerance) > 1.0 {
            conditioning(written, point, expected)[order]
        } else {
            0.0
        };
        tolerance += magnified;
        let mut y = y;
        if error_over_tolerance(x, y, tolerance) > 1.0
            && let Some(truth) = truth::truth(written, point)
        {
            y = truth[order];
            tolerance = PRECISE * y.abs() + magnified;
        }
        let ratio = error_over_tolerance(x, y, tolerance);
        found.worst[order] = found.worst[order].max(ratio);
        if ratio > 1.0 {
            found.misses.push(Miss { point, order, compiled: x, expected: y, tolerance });
        }
    }
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

fn error_over_tolerance(x: f64, y: f64, tolerance: f64) -> f64 {
    match (x.is_finite(), y.is_finite()) {
        (true, true) if tolerance.is_infinite() => 0.0,
        (true, true) => (x - y).abs() / tolerance,
        // Beyond the range of numbers the order of operations decides between inf and NaN.
        (false, false) => 0.0,
        _ => f64::INFINITY,
    }
}

/// Equal to the last bit, or both not a number.
pub fn same_bits(x: f64, y: f64) -> bool {
    x.to_bits() == y.to_bits() || (x.is_nan() && y.is_nan())
}

/// Points as the columns a kernel reads.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    measure: Vec<f64>,
    reference: Vec<f64>,
    change: Vec<f64>,
}

impl Columns {
    /// The columns of these points.
    pub fn new(points: &[Point]) -> Columns {
        Columns {
            measure: points.iter().map(|p| p.measure).collect(),
            reference: points.iter().map(|p| p.reference).collect(),
            change: points.iter().map(|p| p.change()).collect(),
        }
    }

    /// As the input of a kernel.
    pub fn batch(&self) -> Batch<'_> {
        Batch { measure: &self.measure, reference: &self.reference, change: &self.change }
    }
}

#[cfg(test)]
mod tests;
