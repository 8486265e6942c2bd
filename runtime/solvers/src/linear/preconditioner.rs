//! Preconditioners: symmetric positive definite approximations of `K_ff^-1`.

use nalgebra::{Cholesky, Const, SMatrix};
use rayon::prelude::*;

use crate::constraint::Constraints;

/// Points per task.
const POINTS: usize = 1024;

/// Something that makes a residual more like an error.
pub(super) trait Preconditioner {
    /// `z = M^-1 r`; entries of `r` at fixed degrees of freedom are 0, and those of `z` become 0.
    fn apply(&mut self, r: &[f64], z: &mut [f64]);
}

/// How a matrix is made positive definite by its diagonal blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Blocks {
    /// As they are; one that is not positive definite proves that the matrix is not.
    AsTheyAre,
    /// With the absolute values of their eigenvalues, for indefinite matrices.
    Absolute,
}

/// The inverses of the diagonal blocks, rows and columns of fixed degrees of freedom left out.
#[derive(Clone, Debug)]
pub(super) struct BlockJacobi {
    dimension: usize,
    inverses: Vec<f64>,
}

impl BlockJacobi {
    /// From the diagonal blocks, `d x d` row by row; `None` when one is not positive definite.
    pub(super) fn new(
        dimension: usize,
        diagonal: &[f64],
        constraints: &Constraints,
        blocks: Blocks,
    ) -> Option<BlockJacobi> {
        let inverses = match dimension {
            2 => inverses::<2>(diagonal, constraints, blocks),
            _ => inverses::<3>(diagonal, constraints, blocks),
        };
        Some(BlockJacobi { dimension, inverses: inverses? })
    }

    fn multiply<const D: usize>(&self, r: &[f64], z: &mut [f64]) {
        let chunks = r.par_chunks(POINTS * D).zip(self.inverses.par_chunks(POINTS * D * D));
        z.par_chunks_mut(POINTS * D).zip(chunks).for_each(|(z, (r, inverses))| {
            let rows = z.chunks_exact_mut(D).zip(r.chunks_exact(D));
            for ((z, r), inverse) in rows.zip(inverses.chunks_exact(D * D)) {
                for a in 0..D {
                    z[a] = (0..D).fold(0.0, |sum, b| sum + inverse[a * D + b] * r[b]);
                }
            }
        });
    }
}

impl Preconditioner for BlockJacobi {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        match self.dimension {
            2 => self.multiply::<2>(r, z),
            _ => self.multiply::<3>(r, z),
        }
    }
}

fn inverses<const D: usize>(
    diagonal: &[f64],
    constraints: &Constraints,
    blocks: Blocks,
) -> Option<Vec<f64>> {
    let mut inverses = vec![0.0; diagonal.len()];
    for (point, out) in inverses.chunks_exact_mut(D * D).enumerate() {
        let is_fixed = |a: usize| constraints.is_fixed(point * D + a);
        let block =
            SMatrix::<f64, D, D>::from_fn(|a, b| match (is_fixed(a) || is_fixed(b), a == b) {
                (false, _) => diagonal[point * D * D + a * D + b],
                (true, true) => 1.0,
                (true, false) => 0.0,
            });
        let inverse = match blocks {
            Blocks::AsTheyAre => inverse_if_definite(block)?,
            Blocks::Absolute => absolute_inverse(block)?,
        };
        for a in 0..D {
            for b in 0..D {
                out[a * D + b] = if is_fixed(a) || is_fixed(b) { 0.0 } else { inverse[(a, b)] };
            }
        }
    }
    Some(inverses)
}

/// The inverse of a symmetric block; `None` when it is not positive definite.
fn inverse_if_definite<const D: usize>(block: SMatrix<f64, D, D>) -> Option<SMatrix<f64, D, D>> {
    // Unit diagonal first: the entries may be 1e100 or 1e-100.
    let scales = block.diagonal().map(f64::sqrt);
    if !scales.iter().all(|&s| s > 0.0 && s.is_finite()) {
        return None;
    }
    let scaled = SMatrix::<f64, D, D>::from_fn(|a, b| block[(a, b)] / scales[a] / scales[b]);
    let inverse = Cholesky::<f64, Const<D>>::new(scaled)?.inverse();
    Some(SMatrix::from_fn(|a, b| inverse[(a, b)] / scales[a] / scales[b]))
}

/// Eigenvalues smaller than this part of the largest are taken as that: a block may be singular
/// where the matrix is not.
const SMALLEST_EIGENVALUE: f64 = 1e-3;

/// The inverse of the block with the absolute values of its eigenvalues; `None` for a block of
/// zeros.
fn absolute_inverse<const D: usize>(block: SMatrix<f64, D, D>) -> Option<SMatrix<f64, D, D>> {
    let largest = block.amax();
    if largest == 0.0 {
        return None;
    }
    // The eigenvalues of 2 x 2 and 3 x 3 blocks by Jacobi's rotations: each sweep squares what is
    // left off the diagonal, so a few reach rounding.
    let mut scaled = block / largest;
    let mut vectors = SMatrix::<f64, D, D>::identity();
    for _ in 0..8 {
        for p in 0..D {
            for q in p + 1..D {
                let coupling = scaled[(p, q)];
                if coupling == 0.0 {
                    continue;
                }
                let theta = (scaled[(q, q)] - scaled[(p, p)]) / (2.0 * coupling);
                let tan = 1f64.copysign(theta) / (theta.abs() + (theta * theta + 1.0).sqrt());
                let cos = 1.0 / (tan * tan + 1.0).sqrt();
                let mut rotation = SMatrix::<f64, D, D>::identity();
                (rotation[(p, p)], rotation[(q, q)]) = (cos, cos);
                (rotation[(p, q)], rotation[(q, p)]) = (tan * cos, -tan * cos);
                scaled = rotation.transpose() * scaled * rotation;
                vectors *= rotation;
            }
        }
    }
    let eigenvalues = scaled.diagonal().map(f64::abs);
    let least = SMALLEST_EIGENVALUE * eigenvalues.max();
    Some(SMatrix::from_fn(|a, b| {
        let term = |k: usize| vectors[(a, k)] * vectors[(b, k)] / eigenvalues[k].max(least);
        (0..D).fold(0.0, |sum, k| sum + term(k)) / largest
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Matrix3};

    fn apply(dimension: usize, diagonal: &[f64], fixed: &[usize], blocks: Blocks) -> Vec<f64> {
        let n = diagonal.len() / dimension;
        let constraints = Constraints::new(n, fixed).unwrap();
        let mut m = BlockJacobi::new(dimension, diagonal, &constraints, blocks).unwrap();
        let mut r = vec![1.0; n];
        fixed.iter().for_each(|&dof| r[dof] = 0.0);
        let mut z = vec![f64::NAN; n];
        m.apply(&r, &mut z);
        z
    }

    #[test]
    fn blocks_are_inverted_without_what_is_fixed() {
        let diagonal = [2.0, 1.0, 1.0, 3.0, 4.0, 1.0, 1.0, 5.0];
        let z = apply(2, &diagonal, &[3], Blocks::AsTheyAre);
        let expected = [0.4, 0.2, 0.25, 0.0];
        assert!(z.iter().zip(&expected).all(|(z, e)| (z - e).abs() < 1e-15), "{z:?}");
        let constraints = Constraints::new(2, &[]).unwrap();
        let indefinite = [1.0, 2.0, 2.0, 1.0];
        assert!(BlockJacobi::new(2, &indefinite, &constraints, Blocks::AsTheyAre).is_none());
    }

    #[test]
    fn absolute_blocks_are_definite_and_invert_definite_ones() {
        let definite = Matrix3::new(4.0, 1.0, -1.0, 1.0, 3.0, 0.5, -1.0, 0.5, 5.0) * 1e120;
        let inverse = absolute_inverse(definite).unwrap();
        assert!((inverse * definite - Matrix3::identity()).amax() < 1e-14);
        let indefinite = Matrix2::new(1.0, 2.0, 2.0, 1.0);
        // Eigenvalues 3 and -1 with (1, 1) and (1, -1).
        let expected = Matrix2::new(2.0, -1.0, -1.0, 2.0) / 3.0;
        assert!((absolute_inverse(indefinite).unwrap() - expected).amax() < 1e-15);
        assert!(absolute_inverse(Matrix2::zeros()).is_none());
    }
}
