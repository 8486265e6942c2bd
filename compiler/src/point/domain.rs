//! Where an energy of the deformation gradient may be used: the declared bounds of `J = det F`, and of any other
//! quantity of it.

use super::kernel::{GradientBatch, GradientKernel};
use super::{MOST, Subject};
use crate::expression::graph::dimension;
use crate::kernel::Mode;
use crate::measure::Argument;
use crate::model::{Interval, Model, Variant};
use crate::specialise::{CompileError, Form};
use crate::values::{MAX_FIELDS, Values};

/// So many places are looked at together.
const PLACES: usize = 64;

/// The open interval of `J` that is inside; without one, every gradient is.
#[derive(Clone, Copy, Debug, Default)]
struct VolumeDomain {
    between: Option<(f64, f64)>,
}

impl VolumeDomain {
    /// What all declared intervals hold.
    fn of(variant: &Variant) -> VolumeDomain {
        let declared = of_gradient(variant).filter(|interval| interval.of_volume_ratio);
        let between = declared.map(|interval| {
            let ((lower, with_lower), (upper, with_upper)) = (interval.lower, interval.upper);
            let lower = if with_lower { lower.next_down() } else { lower };
            (lower, if with_upper { upper.next_up() } else { upper })
        });
        VolumeDomain { between: between.reduce(|x, y| (x.0.max(y.0), x.1.min(y.1))) }
    }

    /// Whether a gradient, row by row, is inside.
    fn contains(&self, gradient: &[f64]) -> bool {
        let j = determinant(dimension(gradient.len()), |k| gradient[k]);
        self.between.is_none_or(|(lower, upper)| lower < j && j < upper)
    }

    /// Makes psi no number at the places outside, one per entry of `psi`; gradients are given
    /// component by component.
    fn restrict(&self, d: usize, gradient: &[f64], psi: &mut [f64]) {
        let Some((lower, upper)) = self.between else { return };
        let n_places = psi.len();
        // Few places at a time, component by component: loops without branches.
        let mut j = [0.0; PLACES];
        for start in (0..n_places).step_by(PLACES) {
            let n = PLACES.min(n_places - start);
            let columns: [&[f64]; 9] = std::array::from_fn(|k| {
                let first = if k < d * d { k * n_places + start } else { start };
                &gradient[first..first + n]
            });
            for (p, j) in j[..n].iter_mut().enumerate() {
                *j = determinant(d, |k| columns[k][p]);
            }
            for (psi, j) in psi[start..start + n].iter_mut().zip(&j) {
                *psi = if (lower < *j) & (*j < upper) { *psi } else { f64::NAN };
            }
        }
    }
}

/// The declared intervals of quantities of `F`.
fn of_gradient(variant: &Variant) -> impl Iterator<Item = &Interval> {
    variant.domains.iter().filter(|interval| interval.argument == Argument::Gradient)
}

/// A quantity of the deformation gradient with the interval that is inside.
#[derive(Debug)]
struct Bounded {
    quantity: GradientKernel,
    interval: Interval,
}

/// All declared bounds of quantities of the deformation gradient: `J`, which is worked out by hand, and others,
/// which are compiled as energies are.
#[derive(Debug, Default)]
pub(crate) struct Domain {
    volume: VolumeDomain,
    others: Vec<Bounded>,
}

impl Domain {
    /// What a potential declares, for these values.
    ///
    /// # Errors
    /// A quantity that is too large.
    pub(super) fn of(
        model: &Model,
        variant: &Variant,
        values: &Values,
        (mode, form): (Mode, Form),
    ) -> Result<Domain, CompileError> {
        let mut domain = Domain { volume: VolumeDomain::of(variant), others: Vec::new() };
        for interval in of_gradient(variant).filter(|interval| !interval.of_volume_ratio) {
            let subject = Subject::of_function(variant, interval.root, interval.span);
            let (quantity, _) = model.gradient_function(subject, values, mode, form)?;
            domain.others.push(Bounded { quantity, interval: interval.clone() });
        }
        Ok(domain)
    }

    /// Typical values of the fields that bounded quantities depend on; nothing where they depend on none.
    pub(super) fn fields(&self) -> &[f64] {
        let mut all = self.others.iter().map(|bounded| bounded.quantity.fields());
        all.find(|fields| !fields.is_empty()).unwrap_or(&[])
    }

    /// Whether a gradient, row by row, is inside, with fields at their typical values.
    pub(crate) fn contains(&self, gradient: &[f64]) -> bool {
        let d = dimension(gradient.len());
        let change: Vec<f64> = (0..d * d).map(|k| gradient[k] - unit(d, k)).collect();
        let is_inside = |bounded: &Bounded| {
            let fields = bounded.quantity.fields();
            let at = GradientBatch { n: 1, gradient, change: &change, fields };
            let mut value = [0.0];
            bounded.quantity.evaluate(at, &mut value, &mut []);
            bounded.interval.contains(value[0])
        };
        self.volume.contains(gradient) && self.others.iter().all(is_inside)
    }

    /// Makes psi no number at the places outside, one per entry of `psi`.
    pub(crate) fn restrict(&self, d: usize, at: GradientBatch<'_>, psi: &mut [f64]) {
        self.volume.restrict(d, at.gradient, psi);
        for bounded in &self.others {
            bounded.restrict(d, at, psi);
        }
    }
}

impl Bounded {
    fn restrict(&self, d: usize, at: GradientBatch<'_>, psi: &mut [f64]) {
        let n_fields = self.quantity.fields().len();
        let (mut gradient, mut change) = ([0.0; MOST * PLACES], [0.0; MOST * PLACES]);
        let (mut fields, mut value) = ([0.0; MAX_FIELDS * PLACES], [0.0; PLACES]);
        for start in (0..at.n).step_by(PLACES) {
            let n = PLACES.min(at.n - start);
            for (room, all, rows) in [
                (&mut gradient[..], at.gradient, d * d),
                (&mut change[..], at.change, d * d),
                (&mut fields[..], at.fields, n_fields),
            ] {
                for k in 0..rows {
                    room[k * n..][..n].copy_from_slice(&all[k * at.n + start..][..n]);
                }
            }
            let part = GradientBatch {
                n,
                gradient: &gradient[..d * d * n],
                change: &change[..d * d * n],
                fields: &fields[..n_fields * n],
            };
            self.quantity.evaluate(part, &mut value[..n], &mut []);
            for (psi, value) in psi[start..start + n].iter_mut().zip(&value) {
                *psi = if self.interval.contains(*value) { *psi } else { f64::NAN };
            }
        }
    }
}

/// Of the unit tensor, row by row.
fn unit(d: usize, k: usize) -> f64 {
    if k / d == k % d { 1.0 } else { 0.0 }
}

/// Of a tensor given by its components, row by row.
fn determinant(d: usize, f: impl Fn(usize) -> f64) -> f64 {
    let minor = |a: usize, b: usize, c: usize, e: usize| f(a) * f(b) - f(c) * f(e);
    if d == 2 {
        return minor(0, 3, 1, 2);
    }
    f(0) * minor(4, 8, 5, 7) - f(1) * minor(3, 8, 5, 6) + f(2) * minor(3, 7, 4, 6)
}
