//! Influence functions: how much a neighbour counts, from its distance at rest.

use rayon::prelude::*;

use super::DeformationError;
use crate::body::Body;
use crate::neighborhood::{HORIZON_TOLERANCE, Neighborhood};

/// An influence function `w(L)` of the length of a bond at rest.
///
/// Its unit cancels from deformation gradients and bond weights. Closures are influence functions.
pub trait Influence: Sync {
    /// The value at a bond of this length in m.
    fn value(&self, length: f64) -> f64;
}

impl<F: Fn(f64) -> f64 + Sync> Influence for F {
    fn value(&self, length: f64) -> f64 {
        self(length)
    }
}

/// `w = 1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constant;

impl Influence for Constant {
    fn value(&self, _length: f64) -> f64 {
        1.0
    }
}

/// `w = 1/L`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseLength;

impl Influence for InverseLength {
    fn value(&self, length: f64) -> f64 {
        1.0 / length
    }
}

/// The cubic B-spline of unit integral (partmann2026 4.35): 0 at the horizon with its first two
/// derivatives. Its factor is `8/(pi delta^3)` in space and `40/(7 pi delta^2)` in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CubicSpline {
    /// 2 or 3.
    pub dimension: usize,
    /// In m.
    pub horizon: f64,
}

impl Influence for CubicSpline {
    fn value(&self, length: f64) -> f64 {
        let q = length / self.horizon;
        let delta = self.horizon;
        let factor = match self.dimension {
            2 => 40.0 / (7.0 * std::f64::consts::PI * delta * delta),
            _ => 8.0 / (std::f64::consts::PI * delta * delta * delta),
        };
        // Bonds as long as the horizon to within rounding count nothing, and are not evaluated: the energy of
        // one may be infinite where those of all that count are not.
        let rest = if q < 1.0 - HORIZON_TOLERANCE { 1.0 - q } else { 0.0 };
        factor * if q <= 0.5 { 1.0 - 6.0 * q * q * rest } else { 2.0 * rest * rest * rest }
    }
}

/// `w = exp(-(L/width)^2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    /// In m.
    pub width: f64,
}

impl Influence for Gaussian {
    fn value(&self, length: f64) -> f64 {
        let q = length / self.width;
        libm::exp(-q * q)
    }
}

/// The influence function at each directed bond.
pub(super) fn influences(
    body: &Body,
    neighborhood: &Neighborhood,
    influence: &dyn Influence,
) -> Result<Vec<f64>, DeformationError> {
    let length = |i: usize, j: usize| {
        let ends = body.position(i).iter().zip(body.position(j));
        ends.fold(0.0, |sum, (x, y)| sum + (y - x) * (y - x)).sqrt()
    };
    let row = |i: usize| {
        let row = neighborhood.row(i).iter();
        row.map(move |j| influence.value(length(i, j as usize)))
    };
    let values: Vec<f64> =
        (0..neighborhood.n_points()).into_par_iter().flat_map_iter(row).collect();
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(values),
        Some(place) => {
            let rows = 0..neighborhood.n_points();
            let point =
                rows.into_iter().find(|&i| neighborhood.places(i).contains(&place)).unwrap_or(0);
            let k = place - neighborhood.places(point).start;
            let length = length(point, neighborhood.row(point).at(k) as usize);
            Err(DeformationError::Influence { length, value: values[place] })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn influence_functions_are_what_they_are_called() {
        assert_eq!([0.25, 4.0].map(|length| Constant.value(length)), [1.0, 1.0]);
        assert_eq!([0.25, 1.0, 4.0].map(|length| InverseLength.value(length)), [4.0, 1.0, 0.25]);
        let gaussian = Gaussian { width: 0.5 };
        assert_eq!([0.0, 0.5].map(|length| gaussian.value(length)), [1.0, libm::exp(-1.0)]);
        // The cubic B-spline has a quarter of its largest value half way to the horizon, its pieces
        // meet there with equal slopes, and a 32nd is left after three quarters.
        let spline = CubicSpline { dimension: 3, horizon: 2.0 };
        let of_largest = |length: f64| spline.value(length) / spline.value(0.0);
        assert_eq!([1.0, 1.5, 2.0].map(of_largest), [0.25, 1.0 / 32.0, 0.0]);
        // Second differences of a function with a continuous slope are of the second order.
        let step = 1e-4;
        let kink = of_largest(1.0 + step) - 2.0 * of_largest(1.0) + of_largest(1.0 - step);
        assert!(kink.abs() < 10.0 * step * step, "{kink:e}");
    }

    #[test]
    fn the_spline_has_unit_integral_and_ends_at_the_horizon() {
        for dimension in [2usize, 3] {
            let spline = CubicSpline { dimension, horizon: 0.7 };
            let n = 4000;
            let integral: f64 = (0..n)
                .map(|k| {
                    let r = (f64::from(k) + 0.5) / f64::from(n) * 0.7;
                    let shell = if dimension == 2 { 2.0 * r } else { 4.0 * r * r };
                    spline.value(r) * shell * std::f64::consts::PI * 0.7 / f64::from(n)
                })
                .sum();
            assert!((integral - 1.0).abs() < 1e-6, "{integral}");
            for rounded in [1.0 + 1e-7, 1.0, 1.0 - 1e-15, 1.0 - 1e-7] {
                assert_eq!(spline.value(0.7 * rounded), 0.0);
            }
            assert!(spline.value(0.7 * (1.0 - 1e-5)) > 0.0);
        }
    }
}
