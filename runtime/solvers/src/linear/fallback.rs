//! The steps of the methods, and who takes over where one fails.

use piola_mechanics::matrix::BlockMatrix;
use piola_mechanics::vector::norm_of;

use super::conjugate_gradients::{CgLimits, CgOutcome};
use super::direct::{LuFactors, SymmetricFactors};
use super::extraction::FreeTriangle;
use super::gmres::{GmresOutcome, GmresReport};
use super::iterative::{Iterative, Prepared, lost};
use super::{Choice, Factor, LinearError, LinearMethod, LinearSolver, Tangent};

/// A direct solution with a larger relative residual is refined: a few units of rounding.
const ROUNDING_RESIDUAL: f64 = 1e-14;

/// Steps of refinement. The first brings the backward error to rounding, where it was not.
const REFINEMENTS: usize = 2;

/// A direct solution is inaccurate when its residual exceeds this times `|K| |x| + |b|` (norms).
/// Backward stable solves reach 1e-15; what is 1e5 times worse has lost its pivots.
const INACCURATE: f64 = 1e-10;

/// An indefinite tangent is factorised up to this many operations (about a minute); beyond it is
/// solved by minimum residuals, without the number of its negative eigenvalues.
pub(super) const FALLBACK_OPERATIONS: f64 = 1e12;

/// Indefinite systems converge slowly.
const MINIMUM_RESIDUAL_ITERATIONS: usize = 20_000;

/// Newton's method makes good use of a solution by minimum residuals or GMRES with no more than this
/// residual, relative to the right-hand side.
const ROUGH_ENOUGH: f64 = 1e-3;

pub(super) const CHOLESKY_FAILED: &str = "Cholesky met a pivot that is not positive";

/// The steps of the methods and of their fallbacks.
impl LinearSolver {
    /// Builds the free triangle and the symbolic factorisation at the first need.
    fn symmetric(
        &mut self,
        matrix: &BlockMatrix,
    ) -> Result<(&FreeTriangle, &mut SymmetricFactors), LinearError> {
        if self.symmetric.is_none() {
            self.check_memory()?;
        }
        self.triangle(matrix)?;
        let triangle = self.triangle.as_ref().expect("built in the line above");
        if self.symmetric.is_none() {
            let d = self.pattern.dimension;
            let estimate = self.estimate.as_ref().expect("made by the check of memory");
            let factors = SymmetricFactors::new(triangle, estimate, &self.constraints, d)?;
            self.symmetric = Some(factors);
        }
        Ok((triangle, self.symmetric.as_mut().expect("built in the lines above")))
    }

    fn triangle(&mut self, matrix: &BlockMatrix) -> Result<&FreeTriangle, LinearError> {
        if self.triangle.is_none() {
            let mut triangle = FreeTriangle::new(&self.pattern, &self.constraints)?;
            triangle.update(matrix);
            self.triangle = Some(triangle);
        }
        Ok(self.triangle.as_ref().expect("built in the lines above"))
    }

    pub(super) fn factorize_cholesky(&mut self, matrix: &BlockMatrix) -> Result<(), LinearError> {
        self.factorize_cholesky_or_ldlt(matrix)?;
        self.lu_if_pivots_vanish(matrix)
    }

    pub(super) fn factorize_cholesky_or_ldlt(
        &mut self,
        matrix: &BlockMatrix,
    ) -> Result<(), LinearError> {
        self.n_factorizations += 1;
        let (triangle, factors) = self.symmetric(matrix)?;
        if factors.cholesky(triangle) {
            self.factor = Factor::Cholesky;
            return Ok(());
        }
        self.notes.push(CHOLESKY_FAILED.to_string());
        self.n_factorizations += 1;
        let (triangle, factors) = self.symmetric(matrix)?;
        self.factor = Factor::Ldlt(factors.ldlt(triangle));
        Ok(())
    }

    pub(super) fn factorize_ldlt(&mut self, matrix: &BlockMatrix) -> Result<(), LinearError> {
        self.n_factorizations += 1;
        let (triangle, factors) = self.symmetric(matrix)?;
        self.factor = Factor::Ldlt(factors.ldlt(triangle));
        self.lu_if_pivots_vanish(matrix)
    }

    fn lu_if_pivots_vanish(&mut self, matrix: &BlockMatrix) -> Result<(), LinearError> {
        if matches!(self.factor, Factor::Ldlt(inertia) if inertia.zero > 0) {
            self.notes.push("LDLT met a pivot that is zero".to_string());
            self.factorize_lu(matrix)?;
        }
        Ok(())
    }

    pub(super) fn factorize_lu(&mut self, matrix: &BlockMatrix) -> Result<(), LinearError> {
        self.n_factorizations += 1;
        self.triangle(matrix)?;
        let triangle = self.triangle.as_ref().expect("built in the line above");
        if self.lu.is_none() {
            self.lu = Some(LuFactors::new(triangle)?);
        }
        let lu = self.lu.as_mut().expect("built in the lines above");
        if !lu.factorize(triangle)? {
            return Err(self.singular());
        }
        self.factor = Factor::Lu;
        Ok(())
    }

    /// Makes the preconditioner, or goes on without conjugate gradients where that shows that the
    /// tangent is not positive definite.
    pub(super) fn prepare_iterations(&mut self, tangent: Tangent<'_>) -> Result<(), LinearError> {
        match self.iterative(tangent)?.prepare(tangent) {
            Prepared::Ready if self.method() == LinearMethod::Gmres => self.factor = Factor::Gmres,
            Prepared::Ready => self.factor = Factor::Cg,
            Prepared::Indefinite(why) => {
                self.notes.push(why.to_string());
                self.prepare_indefinite(tangent)?;
            }
        }
        Ok(())
    }

    fn iterative(&mut self, tangent: Tangent<'_>) -> Result<&mut Iterative, LinearError> {
        if self.iterative.is_none() {
            let (positions, constraints) = (&self.positions, &self.constraints);
            let iterative = Iterative::new(
                &self.pattern,
                positions,
                constraints,
                &self.options,
                tangent,
                self.watch.clone(),
            )?;
            self.iterative = Some(iterative);
        }
        Ok(self.iterative.as_mut().expect("made in the lines above"))
    }

    /// LDLT, which counts negative eigenvalues, or minimum residuals where that is too large. GMRES
    /// stay, with another preconditioner.
    fn prepare_indefinite(&mut self, tangent: Tangent<'_>) -> Result<(), LinearError> {
        let stays = self.method() == LinearMethod::Gmres;
        if let Tangent::Stored(matrix, _) = tangent
            && !stays
            && self.may_factorize()?
        {
            return self.factorize_ldlt(matrix);
        }
        if self.may_store {
            let because = self.notes.join(", ");
            return Err(LinearError::GivenUp { because, iterations: None });
        }
        if !self.iterative(tangent)?.prepare_indefinite(tangent) {
            return Err(self.singular());
        }
        self.factor = if stays { Factor::Gmres } else { Factor::MinimumResidual };
        Ok(())
    }

    /// Whether a factorisation fits into the memory and ends within a minute.
    pub(super) fn may_factorize(&mut self) -> Result<bool, LinearError> {
        let memory_limit = self.options.memory_limit;
        let estimate = self.estimate()?;
        Ok(estimate.bytes() <= memory_limit && estimate.operations <= FALLBACK_OPERATIONS)
    }

    /// Iterations and relative residual; where iterating failed another method is prepared.
    pub(super) fn solve_cg(
        &mut self,
        tangent: Tangent<'_>,
        rhs: &[f64],
        solution: &mut [f64],
    ) -> Result<(usize, f64), LinearError> {
        let limits = self.limits;
        let report =
            self.iterative(tangent)?.conjugate_gradients(tangent, rhs, limits, solution)?;
        self.seen = Some((report.iterations, report.ritz));
        match (report.outcome, lost(&report, limits)) {
            (CgOutcome::Converged { residual }, None) => return Ok((report.iterations, residual)),
            (CgOutcome::NegativeCurvature, _) => {
                self.notes.push("conjugate gradients met negative curvature".to_string());
                self.prepare_indefinite(tangent)?;
            }
            (_, lost) => {
                let because = match lost {
                    Some(residual) => {
                        format!("conjugate gradients lost the residual ({residual:.1e})")
                    }
                    None => {
                        format!(
                            "conjugate gradients did not converge in {} iterations",
                            report.iterations
                        )
                    }
                };
                let residual = lost.unwrap_or(f64::INFINITY);
                self.factorize_instead(tangent, because, report.iterations, residual)?;
            }
        }
        solution.fill(0.0);
        Ok((report.iterations, f64::INFINITY))
    }

    /// Cholesky where iterating failed, for a reason; `auto` stays with it.
    fn factorize_instead(
        &mut self,
        tangent: Tangent<'_>,
        because: String,
        iterations: usize,
        residual: f64,
    ) -> Result<(), LinearError> {
        match tangent {
            Tangent::Stored(matrix, _) => {
                self.notes.push(because.clone());
                if self.options.method == LinearMethod::Auto {
                    let reason = format!("{because}, the time of a factorisation");
                    self.choice = Choice::new(LinearMethod::Cholesky, reason);
                }
                self.factorize_cholesky(matrix)
            }
            _ if self.may_store => {
                Err(LinearError::GivenUp { because, iterations: Some(iterations) })
            }
            Tangent::MatrixFree { .. } | Tangent::Bonds { .. } => {
                Err(LinearError::NotConverged { because, iterations, residual })
            }
        }
    }

    /// Iterations and relative residual; where GMRES failed another method is prepared.
    pub(super) fn solve_gmres(
        &mut self,
        tangent: Tangent<'_>,
        rhs: &[f64],
        solution: &mut [f64],
    ) -> Result<(usize, f64), LinearError> {
        let limits = self.limits;
        let GmresReport { outcome, iterations, residual } =
            self.iterative(tangent)?.gmres(tangent, rhs, limits, solution)?;
        if residual <= ROUGH_ENOUGH.max(2.0 * limits.tolerance) {
            return Ok((iterations, residual));
        }
        let because = match outcome {
            GmresOutcome::NotConverged => {
                format!("GMRES did not converge in {iterations} iterations")
            }
            _ => format!("GMRES stagnated at a residual of {residual:.1e}"),
        };
        self.factorize_instead(tangent, because, iterations, residual)?;
        solution.fill(0.0);
        Ok((iterations, f64::INFINITY))
    }

    /// Iterations and relative residual.
    pub(super) fn solve_minimum_residual(
        &mut self,
        tangent: Tangent<'_>,
        rhs: &[f64],
        solution: &mut [f64],
    ) -> Result<(usize, f64), LinearError> {
        let limits = CgLimits { max_iterations: MINIMUM_RESIDUAL_ITERATIONS, ..self.limits };
        let (iterations, residual) =
            self.iterative(tangent)?.minimum_residual(tangent, rhs, limits, solution)?;
        // Not a number fails, too.
        if residual <= ROUGH_ENOUGH {
            return Ok((iterations, residual));
        }
        let because = format!("minimum residuals, since {}", self.notes.join(", "));
        Err(LinearError::NotConverged { because, iterations, residual })
    }

    /// Solves with the factors at hand, LU after an inaccurate LDLT; the relative residual.
    pub(super) fn solve_direct(
        &mut self,
        matrix: &BlockMatrix,
        b: &[f64],
        solution: &mut [f64],
    ) -> Result<f64, LinearError> {
        loop {
            let (relative, backward) = self.solve_and_refine(matrix, b, solution)?;
            // Not a number fails, too.
            if backward <= INACCURATE {
                return Ok(relative);
            }
            match self.factor {
                Factor::Lu => return Err(self.singular()),
                _ => {
                    let name = self.report(0, relative).method.name();
                    self.notes.push(format!("the solution by {name} was inaccurate"));
                    self.factorize_lu(matrix)?;
                }
            }
        }
    }

    /// One solve and, while the residual is above rounding, steps of iterative refinement, kept if
    /// they help. Returns the residual relative to `b` and the backward error.
    fn solve_and_refine(
        &mut self,
        matrix: &BlockMatrix,
        b: &[f64],
        solution: &mut [f64],
    ) -> Result<(f64, f64), LinearError> {
        let mut x = b.to_vec();
        self.apply_factors(&mut x)?;
        self.constraints.scatter_free(&x, solution);
        let (mut relative, mut backward, mut residual) = self.residual(matrix, b, solution);
        for _ in 0..REFINEMENTS {
            if relative <= ROUNDING_RESIDUAL || !relative.is_finite() {
                break;
            }
            self.apply_factors(&mut residual)?;
            let refined: Vec<f64> = x.iter().zip(&residual).map(|(x, c)| x + c).collect();
            self.constraints.scatter_free(&refined, solution);
            let found = self.residual(matrix, b, solution);
            if found.0 < relative {
                x = refined;
                (relative, backward, residual) = found;
            } else {
                self.constraints.scatter_free(&x, solution);
                break;
            }
        }
        Ok((relative, backward))
    }

    pub(super) fn apply_factors(&mut self, x: &mut [f64]) -> Result<(), LinearError> {
        match self.factor {
            Factor::Lu => self.lu.as_mut().expect("factorised").solve_in_place(x),
            _ => {
                self.symmetric.as_mut().expect("factorised").solve_in_place(x);
                Ok(())
            }
        }
    }

    /// `norm(b - K x)/norm(b)`, `norm(b - K x)/norm(|K| |x| + |b|)` and `b - K x` on the free
    /// degrees of freedom; 0 where there is nothing to divide by.
    fn residual(&self, matrix: &BlockMatrix, b: &[f64], x: &[f64]) -> (f64, f64, Vec<f64>) {
        let product = self.constraints.free_part(&matrix.multiply(x));
        let magnitude = self.constraints.free_part(&matrix.multiply_absolute(x));
        let residual: Vec<f64> = b.iter().zip(&product).map(|(b, p)| b - p).collect();
        let scale: Vec<f64> = b.iter().zip(&magnitude).map(|(b, m)| b.abs() + m).collect();
        let norm = norm_of(&residual);
        let over = |scale: f64| if norm == 0.0 { 0.0 } else { norm / scale };
        (over(norm_of(b)), over(norm_of(&scale)), residual)
    }
}
