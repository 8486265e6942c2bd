//! How far rounding may carry a solution: an estimate of the condition of the tangent.
//!
//! Hager's method in Higham's form (Higham, Accuracy and Stability of Numerical Algorithms, 2002,
//! algorithm 15.4): `norm(K^-1)` is the largest `norm(K^-1 x)` over unit vectors `x`, and a few
//! solves climb to a local maximum. The estimate is never too large, and seldom less than a third
//! of the truth.
//!
//! With conjugate gradients the climb starts at the probe by which the tangent was judged and takes
//! two more solves, to a thousandth each. The estimate is then right to the same factor, but for
//! what the rough solutions add or leave out. (The Ritz values bound `cond(K)` by
//! `cond(M^-1 K) cond(M)`, but with a coarse system in `M` the second factor is as hard to get.)

use super::{Factor, LinearError, LinearSolver, Tangent};

/// Unit vectors that are tried; two suffice nearly always.
const MOST_VECTORS: usize = 5;

impl LinearSolver {
    /// The condition `norm(K) norm(K^-1)` of the free part of the tangent in the 1-norm, with the
    /// factors of the tangent at hand: some five solves. After conjugate gradients, by the probe of
    /// [`LinearSolver::judge`] and two more solves. `None` where there is neither; infinite where a
    /// pivot vanished.
    ///
    /// # Errors
    /// Memory for a solve.
    pub fn condition<'a>(
        &mut self,
        tangent: impl Into<Tangent<'a>>,
    ) -> Result<Option<f64>, LinearError> {
        let tangent = tangent.into();
        let inverse = match self.factor {
            Factor::None | Factor::Nothing | Factor::MinimumResidual | Factor::Gmres => {
                return Ok(None);
            }
            Factor::Ldlt(inertia) if inertia.zero > 0 => return Ok(Some(f64::INFINITY)),
            Factor::Cholesky | Factor::Ldlt(_) | Factor::Lu => Some(self.inverse_norm()?),
            Factor::Cg => self.inverse_norm_by_probe(tangent)?,
        };
        let mut ones = vec![0.0; self.constraints.n_dofs()];
        self.constraints.free().iter().for_each(|&dof| ones[dof] = 1.0);
        // The matrix is symmetric: its rows are its columns.
        let rows = self.constraints.free_part(&tangent.multiply_absolute(&ones));
        let norm = rows.iter().fold(0.0f64, |largest, &sum| largest.max(sum));
        Ok(inverse.map(|inverse| norm * inverse))
    }

    /// The 1-norm of the inverse from below, which is also the norm of the largest component: from
    /// the probe a step uphill, and from there a unit vector.
    fn inverse_norm_by_probe(&mut self, tangent: Tangent<'_>) -> Result<Option<f64>, LinearError> {
        let Some((probe, solution)) = self.probe.take() else { return Ok(None) };
        let signs: Vec<f64> = solution.iter().map(|x| 1f64.copysign(*x)).collect();
        let mut largest =
            sum_of_absolutes(&solution) / sum_of_absolutes(&self.constraints.free_part(&probe));
        self.probe = Some((probe, solution));
        let Some(uphill) = self.solve_roughly(tangent, &signs)? else { return Ok(None) };
        let mut steepest = self.constraints.free()[0];
        for &dof in self.constraints.free() {
            steepest = if uphill[dof].abs() > uphill[steepest].abs() { dof } else { steepest };
        }
        largest = largest.max(uphill[steepest].abs());
        let mut unit = vec![0.0; signs.len()];
        unit[steepest] = 1.0;
        let reached = self.solve_roughly(tangent, &unit)?;
        Ok(Some(largest.max(reached.map_or(0.0, |x| sum_of_absolutes(&x)))))
    }

    /// The 1-norm of the inverse.
    fn inverse_norm(&mut self) -> Result<f64, LinearError> {
        let n = self.constraints.n_free();
        let mut x = vec![1.0 / n as f64; n];
        let mut largest = 0.0;
        for _ in 0..MOST_VECTORS {
            self.apply_factors(&mut x)?;
            let reached = sum_of_absolutes(&x);
            if reached <= largest {
                break;
            }
            largest = reached;
            // The slope of the norm; a unit vector along its largest component climbs fastest.
            x.iter_mut().for_each(|x| *x = 1f64.copysign(*x));
            self.apply_factors(&mut x)?;
            let steepest =
                (0..n).fold(0, |best, k| if x[k].abs() > x[best].abs() { k } else { best });
            x.fill(0.0);
            x[steepest] = 1.0;
        }
        // A vector that finds what cancels by symmetry in the others.
        let spread = (n.max(2) - 1) as f64;
        for (k, x) in x.iter_mut().enumerate() {
            let size = 1.0 + k as f64 / spread;
            *x = if k % 2 == 0 { size } else { -size };
        }
        self.apply_factors(&mut x)?;
        Ok(f64::max(largest, 2.0 * sum_of_absolutes(&x) / (3.0 * n as f64)))
    }
}

fn sum_of_absolutes(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |sum, x| sum + x.abs())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::{LinearMethod, LinearOptions};
    use super::*;
    use crate::constraint::Constraints;
    use piola_mechanics::matrix::{BlockMatrix, BlockPattern};

    /// Blocks on the diagonal alone, the entries given.
    fn diagonal(entries: &[f64]) -> BlockMatrix {
        let n = entries.len() / 2;
        let pattern = BlockPattern {
            dimension: 2,
            row_start: (0..=n).collect(),
            columns: (0..n as u32).collect(),
        };
        let values = entries.chunks_exact(2).flat_map(|d| [d[0], 0.0, 0.0, d[1]]).collect();
        BlockMatrix { pattern: Arc::new(pattern), values }
    }

    fn condition(matrix: &BlockMatrix, fixed: &[usize], method: LinearMethod) -> Option<f64> {
        let n = 2 * matrix.pattern.n_rows();
        let constraints = Constraints::new(n, fixed).unwrap();
        let options = LinearOptions { method, ..LinearOptions::default() };
        let positions: Vec<f64> = (0..n).map(|dof| dof as f64).collect();
        let mut solver =
            LinearSolver::new(&matrix.pattern, &positions, &constraints, options).unwrap();
        solver.factorize(matrix).unwrap();
        solver.condition(matrix).unwrap()
    }

    #[test]
    fn of_a_diagonal_it_is_exact() {
        let entries = [3.0, 1e-9, 2.0, 7.0, 1e-5, 4e3];
        let matrix = diagonal(&entries);
        for method in [LinearMethod::Cholesky, LinearMethod::Ldlt, LinearMethod::Lu] {
            let found = condition(&matrix, &[], method).unwrap();
            assert!((found / 4e12 - 1.0).abs() < 1e-14, "{} {found:e}", method.name());
            // What is fixed has no part in it.
            let found = condition(&matrix, &[1], method).unwrap();
            assert!((found / 4e8 - 1.0).abs() < 1e-14, "{} {found:e}", method.name());
        }
        let indefinite = diagonal(&[1.0, -1e-6, 10.0, 5.0]);
        let found = condition(&indefinite, &[], LinearMethod::Cholesky).unwrap();
        assert!((found / 1e7 - 1.0).abs() < 1e-14, "{found:e}");
        assert_eq!(condition(&matrix, &[], LinearMethod::Cg), None);
        assert_eq!(condition(&matrix, &[0, 1, 2, 3, 4, 5], LinearMethod::Cholesky), None);
        assert_eq!(
            condition(&diagonal(&[1e300, 1e-300]), &[], LinearMethod::Ldlt),
            Some(f64::INFINITY)
        );
    }
}
