//! Where an energy of the deformation gradient may be used: the declared bounds of `J = det F`.

use crate::expression::graph::dimension;
use crate::measure::Argument;
use crate::model::Variant;

/// So many places are looked at together.
const PLACES: usize = 64;

/// The open interval of `J` that is inside; without one, every gradient is.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct VolumeDomain {
    between: Option<(f64, f64)>,
}

impl VolumeDomain {
    /// What all declared intervals hold.
    pub(crate) fn of(variant: &Variant) -> VolumeDomain {
        let declared = variant.domains.iter().filter(|d| d.argument == Argument::Gradient);
        let between = declared.map(|interval| {
            let ((lower, with_lower), (upper, with_upper)) = (interval.lower, interval.upper);
            let lower = if with_lower { lower.next_down() } else { lower };
            (lower, if with_upper { upper.next_up() } else { upper })
        });
        VolumeDomain { between: between.reduce(|x, y| (x.0.max(y.0), x.1.min(y.1))) }
    }

    /// Whether a gradient, row by row, is inside.
    pub(crate) fn contains(&self, gradient: &[f64]) -> bool {
        let j = determinant(dimension(gradient.len()), |k| gradient[k]);
        self.between.is_none_or(|(lower, upper)| lower < j && j < upper)
    }

    /// Makes psi no number at the places outside, one per entry of `psi`; gradients are given
    /// component by component.
    pub(crate) fn restrict(&self, d: usize, gradient: &[f64], psi: &mut [f64]) {
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

/// Of a tensor given by its components, row by row.
fn determinant(d: usize, f: impl Fn(usize) -> f64) -> f64 {
    let minor = |a: usize, b: usize, c: usize, e: usize| f(a) * f(b) - f(c) * f(e);
    if d == 2 {
        return minor(0, 3, 1, 2);
    }
    f(0) * minor(4, 8, 5, 7) - f(1) * minor(3, 8, 5, 6) + f(2) * minor(3, 7, 4, 6)
}
