//! Where an energy of the deformation gradient may be used: the declared bounds of `J = det F`.

use super::kernel::GradientBatch;
use super::sample::dimension;
use crate::measure::Argument;
use crate::model::{Interval, Variant};

/// The bounds of `J`; without any, every deformation gradient is inside.
#[derive(Clone, Debug, Default)]
pub(crate) struct VolumeDomain {
    bounds: Vec<Interval>,
}

impl VolumeDomain {
    /// The bounds that a potential declares.
    pub(crate) fn of(variant: &Variant) -> VolumeDomain {
        let bounds = variant.domains.iter().filter(|d| d.argument == Argument::Gradient);
        VolumeDomain { bounds: bounds.cloned().collect() }
    }

    /// Whether a gradient, row by row, is inside.
    pub(crate) fn contains(&self, gradient: &[f64]) -> bool {
        self.holds(determinant(dimension(gradient.len()), |k| gradient[k]))
    }

    fn holds(&self, j: f64) -> bool {
        self.bounds.iter().all(|interval| interval.contains(j))
    }

    /// Makes psi no number at the places outside.
    pub(crate) fn restrict(&self, d: usize, at: GradientBatch<'_>, psi: &mut [f64]) {
        if self.bounds.is_empty() {
            return;
        }
        for (p, psi) in psi.iter_mut().enumerate() {
            if !self.holds(determinant(d, |k| at.gradient[k * at.n + p])) {
                *psi = f64::NAN;
            }
        }
    }
}

/// Of a tensor given by its components, row by row.
fn determinant(d: usize, f: impl Fn(usize) -> f64) -> f64 {
    let minor = |a: usize, b: usize, c: usize, e: usize| f(a) * f(b) - f(c) * f(e);
    if d == 2 {
        return minor(0, 3, 1, 2);
    }
    f(0) * minor(4, 8, 5, 7) - f(1) * minor(3, 8, 5, 6) + f(2) * minor(3, 7, 4, 6)
}
