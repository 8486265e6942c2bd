//! What is left of an error where rounding the inputs alone changes a value by many units.
//!
//! A kernel gets a measure and its change since rest, `m` and `e = (m - M)/M`, each rounded once. Near rest
//! the change tells more, elsewhere the measure, and in compression by far: what rounding leaves unknown of
//! the measure is `u*min(abs(m - M), abs(m))`. How much that changes a value is worked out, not estimated:
//! from true values so far on both sides. An error counts in that only where no form could do better:
//! beside a zero, and where the value jumps. Far from zeros a form that magnifies roundings can be replaced.

use super::in_units;
use crate::kernel::WrittenEnergy;
use crate::verify::UNIT_ROUNDOFF;
use crate::verify::sample::Point;
use crate::verify::truth::truth_beside;

/// A value so much smaller than beside it stands in a dip that ends at zero, or as good as. Twice
/// Newton's step takes an exponential down to exp(-2) = 0.14 and so does a high power, while zeros of
/// order 1 to 7 come out of it below 0.1, or on the other side.
const DIP: f64 = 0.1;

/// A change by this much of the value, for one rounding of the input, is a jump; or a zero is that near.
const JUMP: f64 = 1e-6;

/// The error of psi, psi' or psi'' (`order` 0, 1, 2), in units of what rounding the inputs once changes
/// the true value by, at least `u` of the value, if that passes through zero or jumps beside this point;
/// else in `u` of the value.
pub(super) fn error_left(
    written: &WrittenEnergy,
    point: Point,
    order: usize,
    found: f64,
    expected: f64,
) -> f64 {
    let known_to = (point.measure - point.reference).abs().min(point.measure.abs());
    let beside = |by: f64| truth_beside(written, point, by).map(|values| values[order]);
    let rounding = UNIT_ROUNDOFF * known_to;
    let change = [-rounding, rounding]
        .into_iter()
        .filter_map(beside)
        .fold(0.0, |change: f64, value| change.max((value - expected).abs()));
    let scale = expected.abs();
    let is_excused = change > JUMP * scale || passes_zero(beside, expected, known_to);
    let scale = if is_excused { scale.max(change / UNIT_ROUNDOFF) } else { scale };
    in_units(found, expected, scale)
}

/// Whether a value of this size belongs to a passage through zero, or a touch of it, that begins there.
fn passes_zero(beside: impl Fn(f64) -> Option<f64>, value: f64, known_to: f64) -> bool {
    let small = |other: f64| other * value < 0.0 || other.abs() < DIP * value.abs();
    let step = libm::ldexp(known_to, -20);
    let (Some(left), Some(right)) = (beside(-step), beside(step)) else { return false };
    let is_dip = value.abs() < DIP * left.abs().min(right.abs());
    if value == 0.0 || is_dip || small(left) || small(right) {
        return true;
    }
    let newton = -value * 2.0 * step / (right - left);
    newton.is_finite() && beside(2.0 * newton).is_some_and(small)
}
