//! The largest stable step of central differences.

use nalgebra::{DMatrix, SymmetricEigen};
use piola_mechanics::energy::{Energy, NonFinite};
use serde::Serialize;

/// Most products with the tangent.
const MOST_PRODUCTS: usize = 200;

/// The largest eigenvalue is known when the residual is below this part of it.
const TOLERANCE: f64 = 1e-4;

/// The largest stable step of central differences at rest, with lumped masses.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimeStep {
    /// In s: 2 over the largest angular frequency.
    pub seconds: f64,
    /// The largest angular frequency in 1/s; the residual of the eigenvalue is added, so that the
    /// step errs on the safe side.
    pub frequency: f64,
    /// The residual over the eigenvalue.
    pub uncertainty: f64,
    /// Products with the tangent.
    pub products: usize,
    /// Points of the body.
    pub points: usize,
}

impl TimeStep {
    /// By Lanczos' method on `M^-1/2 K M^-1/2` of the whole free body, from displacements that
    /// nothing distinguishes. `masses` has one entry per point, in kg. Nothing for a body whose
    /// largest eigenvalue is not positive.
    pub(super) fn new(energy: &dyn Energy, masses: &[f64]) -> Result<Option<TimeStep>, NonFinite> {
        let d = energy.dimension();
        let n = masses.len() * d;
        let scale: Vec<f64> = (0..n).map(|dof| 1.0 / masses[dof / d].sqrt()).collect();
        let hessian = energy.hessian(&vec![0.0; n])?;
        let mut vector = start(n);
        normalise(&mut vector);
        let mut before = vec![0.0; n];
        let mut product = vec![0.0; n];
        let (mut diagonal, mut beside): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        let mut found = (0.0, f64::INFINITY);
        let most = MOST_PRODUCTS.min(n);
        while diagonal.len() < most {
            let scaled: Vec<f64> = vector.iter().zip(&scale).map(|(x, s)| x * s).collect();
            hessian.multiply(&scaled, &mut product);
            product.iter_mut().zip(&scale).for_each(|(x, s)| *x *= s);
            let along = dot(&product, &vector);
            let last = beside.last().copied().unwrap_or(0.0);
            for dof in 0..n {
                product[dof] -= along * vector[dof] + last * before[dof];
            }
            let norm = dot(&product, &product).sqrt();
            diagonal.push(along);
            let k = diagonal.len();
            if k % 10 == 0 || k == most || norm <= 1e-12 * along.abs() {
                found = largest(&diagonal, &beside, norm);
                if found.1 <= TOLERANCE * found.0 || norm <= 1e-12 * along.abs() {
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
        Ok(Some(TimeStep {
            seconds: 2.0 / frequency,
            frequency,
            uncertainty: residual / eigenvalue,
            products: diagonal.len(),
            points: masses.len(),
        }))
    }
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

/// Reproducible numbers between -1 and 1 (Knuth's MMIX generator).
fn start(n: usize) -> Vec<f64> {
    let mut state = 1u64;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..n).map(|_| next()).collect()
}

fn normalise(vector: &mut [f64]) {
    let norm = dot(vector, vector).sqrt();
    vector.iter_mut().for_each(|x| *x /= norm);
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
