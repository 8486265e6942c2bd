//! Reproducing kernel weights of one family: the derivative at its centre of the polynomial that
//! fits the neighbours (partmann2026 3.44 to 3.53).
//!
//! Before: offsets in horizons and signed strengths `s_j = V_j w_ij`. After: coefficients `B` by which
//! `V_j Psi_ij = s_j B q_j` in 1/m reproduce every polynomial of the basis to rounding.

use nalgebra::{DMatrix, SymmetricEigen};

/// The polynomials whose derivatives are exact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OperatorOrder {
    /// `Q = dX` (3.47): linear fields are exact. The operator of correspondence peridynamics, with
    /// the shape tensor `K`.
    #[default]
    First,
    /// `Q = (1, dX)`: linear fields are exact, and the fit need not pass through the point.
    FirstWithConstant,
    /// All monomials of first and second order (3.52): quadratic fields are exact. At least 9
    /// neighbours in space, 5 in the plane.
    Second,
}

impl OperatorOrder {
    /// How many functions there are.
    pub fn n_functions(self, dimension: usize) -> usize {
        match self {
            OperatorOrder::First => dimension,
            OperatorOrder::FirstWithConstant => dimension + 1,
            OperatorOrder::Second => dimension * (dimension + 3) / 2,
        }
    }
}

/// The functions at an offset, `d` linear ones first; which they are follows from their number.
#[inline(always)]
pub(super) fn functions(offset: &[f64], values: &mut [f64]) {
    let d = offset.len();
    values[..d].copy_from_slice(offset);
    if values.len() == d + 1 {
        values[d] = 1.0;
    } else if values.len() > d {
        let mut place = d;
        for a in 0..d {
            for b in a..d {
                values[place] = offset[a] * offset[b];
                place += 1;
            }
        }
    }
}

/// Moment matrices of a larger condition number are refused: the weights of their families
/// magnify the rounding of displacements by its root, a million.
pub(super) const MOST_CONDITION: f64 = 1e12;

/// Steps of refinement: each brings what is left of the reproduction down by the rounding of the
/// inverse.
const REFINEMENTS: usize = 2;

/// `sum_j s_j q_j x q_j` over rows of `m` functions with their strengths; at first order, of offsets
/// in m and `V_j w_ij`, the shape tensor `K`.
pub(super) fn moment_matrix<'a>(
    m: usize,
    rows: impl Iterator<Item = (&'a [f64], f64)>,
) -> DMatrix<f64> {
    let mut moments = DMatrix::zeros(m, m);
    for (q, strength) in rows {
        for a in 0..m {
            for b in 0..m {
                moments[(a, b)] += strength * q[a] * q[b];
            }
        }
    }
    moments
}

/// What is known of one family.
#[derive(Debug)]
pub(super) struct Fit {
    /// `d x m` numbers in 1/m: weights are `s_j` times their product with the functions.
    pub(super) coefficients: DMatrix<f64>,
    /// `sum_j s_j q_j`, `m` numbers.
    pub(super) sums: Vec<f64>,
    /// Of the moment matrix.
    pub(super) condition: f64,
}

/// The coefficients of the weights of one family.
///
/// `offsets` are in horizons (`n x d`), `strengths` are `V_j w_ij` in any unit; `per_length` is one over
/// the horizon. `Err` holds the condition number of the moment matrix.
pub(super) fn fit(
    order: OperatorOrder,
    dimension: usize,
    per_length: f64,
    offsets: &[f64],
    strengths: &[f64],
) -> Result<Fit, f64> {
    let (d, m, n) = (dimension, order.n_functions(dimension), strengths.len());
    let largest = strengths.iter().fold(0.0, |largest: f64, s| largest.max(s.abs()));
    if n < m || largest == 0.0 || !largest.is_finite() {
        return Err(f64::INFINITY);
    }
    let mut values = vec![0.0; n * m];
    for (values, offset) in values.chunks_exact_mut(m).zip(offsets.chunks_exact(d)) {
        functions(offset, values);
    }
    let rows = || values.chunks_exact(m).zip(strengths.iter().copied());
    let moments = moment_matrix(m, rows().map(|(q, s)| (q, s / largest)));
    if !moments.iter().all(|x| x.is_finite()) {
        return Err(f64::INFINITY);
    }
    let eigen = SymmetricEigen::new(moments);
    let sizes = eigen.eigenvalues.abs();
    let condition = sizes.max() / sizes.min();
    // Not a number is refused, too.
    if !matches!(condition.partial_cmp(&MOST_CONDITION), Some(std::cmp::Ordering::Less)) {
        return Err(if condition.is_nan() { f64::INFINITY } else { condition });
    }
    let inverse = &eigen.eigenvectors
        * DMatrix::from_diagonal(&eigen.eigenvalues.map(|x| 1.0 / (x * largest)))
        * eigen.eigenvectors.transpose();
    // Row a: the coefficients of the derivative along axis a.
    let mut coefficients = inverse.rows(0, d) * per_length;
    for _ in 0..REFINEMENTS {
        let mut missing = DMatrix::<f64>::identity(d, m) * per_length;
        for (q, strength) in rows() {
            for a in 0..d {
                // As the weight is worked out where it is used.
                let sum = (0..m).fold(0.0, |sum, k| sum + coefficients[(a, k)] * q[k]);
                let weight = strength * sum;
                for k in 0..m {
                    missing[(a, k)] -= weight * q[k];
                }
            }
        }
        coefficients += missing * &inverse;
    }
    let sum = |k: usize| rows().fold(0.0, |sum, (q, strength)| sum + strength * q[k]);
    Ok(Fit { coefficients, sums: (0..m).map(sum).collect(), condition })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::pseudo_random;

    #[test]
    fn polynomials_of_the_basis_are_differentiated_to_rounding() {
        for d in [2, 3] {
            for order in
                [OperatorOrder::First, OperatorOrder::FirstWithConstant, OperatorOrder::Second]
            {
                let offsets = pseudo_random(40 * d, 3);
                // Volumes over six decades.
                let strengths: Vec<f64> =
                    pseudo_random(40, 4).iter().map(|x| 1e-30 * libm::pow(10.0, 3.0 * x)).collect();
                let fit = fit(order, d, 1.0, &offsets, &strengths).unwrap();
                let condition = fit.condition;
                assert!(condition < 1e8, "{condition:e}");
                let m = order.n_functions(d);
                let mut q = vec![0.0; m];
                let mut sums = vec![0.0; d * m];
                for (offset, strength) in offsets.chunks_exact(d).zip(&strengths) {
                    functions(offset, &mut q);
                    for a in 0..d {
                        let g = (0..m).fold(0.0, |sum, k| sum + fit.coefficients[(a, k)] * q[k]);
                        for k in 0..m {
                            sums[a * m + k] += strength * g * q[k];
                        }
                    }
                }
                for a in 0..d {
                    for k in 0..m {
                        let exact = if a == k { 1.0 } else { 0.0 };
                        let error = (sums[a * m + k] - exact).abs();
                        assert!(error < 1e-13, "{d} {order:?} {a} {k}: {error:e} {condition:e}");
                    }
                }
            }
        }
    }

    #[test]
    fn flat_families_are_refused_with_their_condition() {
        let mut offsets = pseudo_random(60, 5);
        offsets.iter_mut().skip(2).step_by(3).for_each(|z| *z = 0.0);
        let flat = fit(OperatorOrder::First, 3, 1.0, &offsets, &[1.0; 20]).unwrap_err();
        assert!(flat > 1e15, "{flat:e}");
        offsets[2] = 1e-7;
        let nearly = fit(OperatorOrder::First, 3, 1.0, &offsets, &[1.0; 20]).unwrap_err();
        assert!(nearly > 1e13 && nearly < 1e16, "{nearly:e}");
        let few = fit(OperatorOrder::Second, 3, 1.0, &offsets[..24], &[1.0; 8]);
        assert_eq!(few.unwrap_err(), f64::INFINITY);
    }
}
