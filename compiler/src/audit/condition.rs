//! What is left of an error where rounding the inputs alone changes a value by many units.
//!
//! A kernel gets a measure and its change since rest, `m` and `e = (m - M)/M`, each rounded once. Near rest
//! the change tells more, elsewhere the measure, and in compression by far: what rounding leaves unknown of
//! the measure is `u*min(abs(m - M), abs(m))`. How much that changes a value is worked out, not estimated:
//! from true values so far on both sides. No form of the energy could do better.

use super::in_units;
use crate::kernel::WrittenEnergy;
use crate::verify::UNIT_ROUNDOFF;
use crate::verify::sample::Point;
use crate::verify::truth::truth_beside;

/// Where a value jumps at rest the one beside it is as good, as near as numbers of 256 bits tell it.
const BESIDE: f64 = 1e-60;

/// What changes by this part of itself for a rounding of the measure is a few roundings from a pole.
const POLE: f64 = 0.05;

/// The error of psi, psi' or psi'' (`order` 0, 1, 2), in units of what rounding the inputs once changes
/// the true value by, at least `u` of the value.
pub(super) fn error_left(
    written: &WrittenEnergy,
    point: Point,
    order: usize,
    found: f64,
    expected: f64,
) -> f64 {
    let known_to = (point.measure - point.reference).abs().min(point.measure.abs());
    let rounding = (UNIT_ROUNDOFF * known_to).max(BESIDE * point.reference);
    let mut change = 0.0_f64;
    for by in [-rounding, rounding] {
        // Where the energy ends or has a pole so near there is no saying.
        let ends = [1.0, 2.0, 4.0].map(|times| truth_beside(written, point, times * by));
        let [Some(beside), Some(_), Some(_)] = ends else { return 0.0 };
        change = change.max((beside[order] - expected).abs());
    }
    if !found.is_finite() && change > POLE * expected.abs() {
        return 0.0;
    }
    in_units(found, expected, expected.abs().max(change / UNIT_ROUNDOFF))
}
