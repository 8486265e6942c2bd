//! The largest stable step of explicit integration, `2/omega_max`, with lumped masses.
//!
//! The largest eigenvalue `omega_max^2` of `M^-1 K` is found by Lanczos' method with exact products:
//! an eigenvalue lies within the residual of the one found, and it is the largest unless the start
//! has nothing of its eigenvector. The sums of the rows of `K` bound it for certain, from above.

use nalgebra::{DMatrix, SymmetricEigen};
use piola_mechanics::energy::{Energy, NonFinite};
use piola_mechanics::matrix::BlockMatrix;
use piola_mechanics::vector::dot;

use crate::constraint::Constraints;

/// How far the largest eigenvalue is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precision {
    /// It is known when the residual is at most this part of it.
    pub tolerance: f64,
    /// Most products with the Hessian.
    pub products: usize,
}

impl Default for Precision {
    fn default() -> Self {
        Precision { tolerance: 1e-4, products: 200 }
    }
}

/// The largest stable step at some displacements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CriticalStep {
    /// In s: 2 over the largest angular frequency.
    pub seconds: f64,
    /// The largest angular frequency in 1/s; the residual of its square is added, so that the step
    /// errs on the safe side.
    pub frequency: f64,
    /// The residual over the eigenvalue.
    pub uncertainty: f64,
    /// Products with the Hessian.
    pub products: usize,
}

impl CriticalStep {
    /// By Lanczos' method on `M^-1/2 K M^-1/2` of the free degrees of freedom, from a vector that
    /// nothing distinguishes. `u` is `n x d` in m, `masses` has one entry per point, in kg. Nothing
    /// where the largest eigenvalue is not positive.
    ///
    /// # Errors
    /// Second derivatives that are not finite.
    pub fn find(
        energy: &dyn Energy,
        u: &[f64],
        masses: &[f64],
        constraints: &Constraints,
        precision: Precision,
    ) -> Result<Option<CriticalStep>, NonFinite> {
        let d = energy.dimension();
        let n = masses.len() * d;
        // Fixed degrees of freedom are scaled away, before and after the product.
        let scale: Vec<f64> = (0..n)
            .map(|dof| if constraints.is_fixed(dof) { 0.0 } else { 1.0 / masses[dof / d].sqrt() })
            .collect();
        let hessian = energy.hessian(u)?;
        let mut vector = start(&scale);
        let [mut before, mut product, mut scaled] = [(); 3].map(|()| vec![0.0; n]);
        let (mut diagonal, mut beside): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        let mut found = (0.0, f64::INFINITY);
        let most = precision.products.min(constraints.n_free());
        while diagonal.len() < most {
            for dof in 0..n {
                scaled[dof] = vector[dof] * scale[dof];
            }
            hessian.multiply(&scaled, &mut product);
            product.iter_mut().zip(&scale).for_each(|(x, s)| *x *= s);
            let along = dot(&product, &vector);
            let last = beside.last().copied().unwrap_or(0.0);
            for dof in 0..n {
                product[dof] -= along * vector[dof] + last * before[dof];
            }
            let norm = dot(&product, &product).sqrt();
            diagonal.push(along);
            let (k, ends) = (diagonal.len(), norm <= 1e-12 * along.abs());
            if k.is_multiple_of(10) || k == most || ends {
                found = largest(&diagonal, &beside, norm);
                if found.1 <= precision.tolerance * found.0 || ends {
                    break;
                }
            }
            beside.push(norm);
            std::mem::swap(&mut before, &mut vector);
            for dof in 0..n {
                vector[dof] = product[dof] / norm;
            }
        }
        let (eigenvalue, residual) = found;
        if !(eigenvalue > 0.0 && eigenvalue.is_finite()) {
            return Ok(None);
        }
        let frequency = (eigenvalue + residual).sqrt();
        Ok(Some(CriticalStep {
            seconds: 2.0 / frequency,
            frequency,
            uncertainty: residual / eigenvalue,
            products: diagonal.len(),
        }))
    }
}

/// A step in s that is stable for certain: `2/sqrt(max_i sum_j |K_ij|/m_i)` over the free degrees of
/// freedom (Gershgorin); infinite without stiffness. Takes the whole tangent into memory.
///
/// # Errors
/// Second derivatives that are not finite.
pub fn step_by_row_sums(
    energy: &dyn Energy,
    u: &[f64],
    masses: &[f64],
    constraints: &Constraints,
) -> Result<f64, NonFinite> {
    let (d, pattern) = (energy.dimension(), energy.pattern());
    let mut tangent = BlockMatrix::zeros(pattern);
    energy.tangent(u, &mut vec![0.0; u.len()], &mut tangent)?;
    let mut sums = vec![0.0; u.len()];
    for row in 0..pattern.n_rows() {
        for place in pattern.row_start[row]..pattern.row_start[row + 1] {
            let column = pattern.columns[place] as usize;
            for (r, c) in (0..d).flat_map(|r| (0..d).map(move |c| (r, c))) {
                let (one, other) = (row * d + r, column * d + c);
                if constraints.is_fixed(one) || constraints.is_fixed(other) {
                    continue;
                }
                let entry = tangent.values[(place * d + r) * d + c].abs();
                sums[one] += entry;
                // Of two blocks that mirror each other one is stored.
                if column != row {
                    sums[other] += entry;
                }
            }
        }
    }
    let over_mass = sums.iter().enumerate().map(|(dof, sum)| sum / masses[dof / d]);
    Ok(2.0 / over_mass.fold(0.0, f64::max).sqrt())
}

/// The largest eigenvalue of the tridiagonal matrix and the residual of its vector in the space
/// that goes on with `norm`.
fn largest(diagonal: &[f64], beside: &[f64], norm: f64) -> (f64, f64) {
    let n = diagonal.len();
    let matrix = DMatrix::from_fn(n, n, |r, c| match r.abs_diff(c) {
        0 => diagonal[r],
        1 => beside[r.min(c)],
        _ => 0.0,
    });
    if matrix.iter().any(|x| !x.is_finite()) {
        return (f64::NAN, f64::INFINITY);
    }
    let eigen = SymmetricEigen::new(matrix);
    let (value, place) = (eigen.eigenvalues.max(), eigen.eigenvalues.imax());
    (value, norm * eigen.eigenvectors[(n - 1, place)].abs())
}

/// Reproducible numbers (Knuth's MMIX generator), zero where the scale is, of unit length.
fn start(scale: &[f64]) -> Vec<f64> {
    let mut state = 1u64;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let mut vector: Vec<f64> =
        scale.iter().map(|scale| if *scale == 0.0 { 0.0 * next() } else { next() }).collect();
    let norm = dot(&vector, &vector).sqrt();
    vector.iter_mut().for_each(|x| *x /= norm);
    vector
}
