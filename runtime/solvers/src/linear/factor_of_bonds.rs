//! The factors of a sparse matrix like the tangent as its preconditioner: the iterations that are
//! left do not grow with the body.

use piola_mechanics::matrix::{BlockMatrix, BlockPattern};

use super::LinearError;
use super::direct::SymmetricFactors;
use super::estimate::estimate_factorization;
use super::extraction::FreeTriangle;
use super::preconditioner::Preconditioner;
use crate::constraint::Constraints;

/// A matrix is factorised up to this many operations for each of its blocks; beyond two levels take
/// over. They need some 30 iterations more, a product takes some 150 ns for each block, and
/// factorisations make 2e10 operations in a second.
pub const OPERATIONS_PER_BLOCK: f64 = 3e4;

/// Cholesky factors of the matrix last given.
pub(super) struct FactorOfBonds {
    constraints: Constraints,
    triangle: FreeTriangle,
    factors: SymmetricFactors,
    reduced: Vec<f64>,
}

impl FactorOfBonds {
    /// Orders the points; `None` where factors would take too long or too much memory (bytes).
    pub(super) fn new(
        pattern: &BlockPattern,
        constraints: &Constraints,
        memory_limit: f64,
    ) -> Result<Option<FactorOfBonds>, LinearError> {
        let estimate = estimate_factorization(pattern, constraints)?;
        let most = OPERATIONS_PER_BLOCK * pattern.n_blocks() as f64;
        if estimate.operations > most || estimate.bytes() > memory_limit {
            return Ok(None);
        }
        let triangle = FreeTriangle::new(pattern, constraints)?;
        let factors = SymmetricFactors::new(&triangle, &estimate, constraints, pattern.dimension)?;
        let reduced = vec![0.0; constraints.n_free()];
        Ok(Some(FactorOfBonds { constraints: constraints.clone(), triangle, factors, reduced }))
    }

    /// Factorises; `false` when a pivot is not positive.
    pub(super) fn update(&mut self, matrix: &BlockMatrix) -> bool {
        self.triangle.update(matrix);
        self.factors.cholesky(&self.triangle)
    }
}

impl Preconditioner for FactorOfBonds {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        for (value, &dof) in self.reduced.iter_mut().zip(self.constraints.free()) {
            *value = r[dof];
        }
        self.factors.solve_in_place(&mut self.reduced);
        z.fill(0.0);
        self.constraints.scatter_free(&self.reduced, z);
    }
}
