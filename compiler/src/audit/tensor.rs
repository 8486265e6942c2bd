//! What is left of an error of psi, P or dP where rounding the components of `F` alone changes it by
//! many units.
//!
//! A kernel gets `F`, near rest `F - I`, and every component may be off by a rounding of its own size.
//! What that changes a value by follows from its derivatives. An error counts in that where no form could
//! do better, and nowhere else: in a dip of the norm, where the value jumps, and where `F` is nearly
//! singular, so that its determinant is a small difference of products.

use super::SMALLEST;
use crate::expression::graph::dimension;
use crate::point::WrittenGradientEnergy;
use crate::point::sample::Sample;
use crate::point::truth::{derivatives, norm, parts, unit};
use crate::verify::UNIT_ROUNDOFF;

/// A norm so much smaller than on both sides is in a dip that ends at a zero, or as good as; a determinant
/// so much smaller than its products is that of a nearly singular `F`.
const SMALL: f64 = 0.1;

/// Parts of its size by which a component changes to either side of a dip. Powers and exponentials grow
/// to one side alone.
const BESIDE: [f64; 4] = [0.5, 0.03, 1e-3, 1e-6];

/// A change by this much of the value, for one rounding of the components, is a jump; or a zero is that
/// near.
const JUMP: f64 = 1e-6;

/// An error of psi, P or dP (`order` 0, 1, 2) in units of what rounding the components once changes the
/// true value by, at least `u` of its norm, if a zero, a jump or a singular `F` is beside this sample;
/// else in `u` of the norm.
pub(super) fn error_left(
    written: &WrittenGradientEnergy,
    sample: &Sample,
    truth: &[f64],
    order: usize,
    difference: f64,
) -> f64 {
    let size = norm(truth[parts(sample.gradient.len())[order].clone()].iter().copied());
    let mut change = change(written, sample, truth, order).unwrap_or(0.0);
    let of_direction =
        if order == 2 { along_components(written, sample, &sample.direction) } else { None };
    let of_direction = of_direction.unwrap_or(0.0);
    // As good as at right angles to what changes P.
    let is_across = SMALL * of_direction > size;
    if is_across {
        change += of_direction;
    }
    let is_excused = is_across
        || UNIT_ROUNDOFF * change > JUMP * size
        || is_nearly_singular(sample)
        || is_in_dip(written, sample, order, size);
    let scale = if is_excused { size.max(change) } else { size };
    tensor_in_units(difference, size, scale)
}

/// The norm of a difference in `u` of a scale.
pub(super) fn tensor_in_units(difference: f64, size: f64, scale: f64) -> f64 {
    if !difference.is_finite() {
        return f64::INFINITY;
    }
    // What is smaller may be lost to underflow.
    if difference < SMALLEST && size < SMALLEST {
        return 0.0;
    }
    difference / scale / UNIT_ROUNDOFF
}

/// How much psi, P or dP changes when every given component changes by its own size, from its derivatives.
fn change(
    written: &WrittenGradientEnergy,
    sample: &Sample,
    truth: &[f64],
    order: usize,
) -> Option<f64> {
    let given = sample.given();
    let n = given.len();
    if order == 1 {
        return along_components(written, sample, given);
    }
    let mut change = 0.0;
    for k in (0..n).filter(|&k| given[k] != 0.0) {
        change += match order {
            0 => (given[k] * truth[1 + k]).abs(),
            // The third derivative from differences of true values.
            _ => {
                let step = libm::ldexp(1.0, -20);
                let beside = |by: f64| {
                    let mut moved = given.to_vec();
                    moved[k] *= 1.0 + by;
                    let beside = derivatives(written, &sample.moved(moved), &sample.direction)?;
                    Some(beside[1 + n..].to_vec())
                };
                let (right, left) = (beside(step)?, beside(-step)?);
                norm(right.iter().zip(&left).map(|(x, y)| x - y)) / (2.0 * step)
            }
        };
    }
    Some(change)
}

/// The sum over components of the norm of dP for that component alone, each times its size here: how much P
/// changes where these are given components, dP where they are those of its direction.
fn along_components(
    written: &WrittenGradientEnergy,
    sample: &Sample,
    sizes: &[f64],
) -> Option<f64> {
    let n = sizes.len();
    let mut change = 0.0;
    for k in (0..n).filter(|&k| sizes[k] != 0.0) {
        let own: Vec<f64> = (0..n).map(|j| unit(j, k)).collect();
        let product = derivatives(written, sample, &own)?.split_off(1 + n);
        change += sizes[k].abs() * norm(product);
    }
    Some(change)
}

/// Whether the products of the determinant cancel.
fn is_nearly_singular(sample: &Sample) -> bool {
    let f = &sample.gradient;
    let d = dimension(f.len());
    // Products along the diagonals that go down to the right, and to the left.
    let along = |start: usize, step: usize| -> f64 {
        (0..d).map(|row| f[d * row + (start + step * row) % d]).product()
    };
    let products: Vec<f64> = match d {
        2 => vec![f[0] * f[3], -f[1] * f[2]],
        _ => (0..d).flat_map(|start| [along(start, 1), -along(start, d - 1)]).collect(),
    };
    let sum: f64 = products.iter().sum();
    sum.abs() < SMALL * products.iter().map(|x| x.abs()).sum::<f64>()
}

/// Whether the norm is smaller than on both sides of a component by far.
fn is_in_dip(written: &WrittenGradientEnergy, sample: &Sample, order: usize, size: f64) -> bool {
    let given = sample.given();
    let part = &parts(given.len())[order];
    let is_larger = |k: usize, by: f64| {
        let mut moved = given.to_vec();
        moved[k] *= 1.0 + by;
        let beside = derivatives(written, &sample.moved(moved), &sample.direction);
        beside.is_some_and(|all| size < SMALL * norm(all[part.clone()].iter().copied()))
    };
    let components = (0..given.len()).filter(|&k| given[k] != 0.0);
    let mut steps = components.flat_map(|k| BESIDE.map(|by| (k, by)));
    steps.any(|(k, by)| is_larger(k, by) && is_larger(k, -by))
}
