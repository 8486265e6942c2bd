//! Linear systems with the free part of the tangent, `K_ff x = b`.
//!
//! A [`LinearSolver`] belongs to one pattern and one set of fixed degrees of freedom; it does the
//! symbolic work once. Vectors are full (one entry per degree of freedom); entries of right-hand
//! sides at fixed degrees of freedom are ignored, entries of solutions there are 0.
//!
//! | method | when | falls back to |
//! |---|---|---|
//! | Cholesky | positive definite | LDLT when a pivot is not positive |
//! | LDLT | indefinite: its pivots count the negative eigenvalues | LU when a pivot vanishes or the solution is inaccurate |
//! | LU | the last resort | nothing |
//! | conjugate gradients | large in three dimensions | LDLT at negative curvature, Cholesky without convergence |
//!
//! Every fallback is noted in the [`LinearReport`]. The bits do not depend on the number of
//! threads.

mod condition;
mod conjugate_gradients;
mod direct;
mod estimate;
mod extraction;
mod report;

use std::sync::Arc;

use super::constraint::Constraints;
use super::vector::norm_of;
use crate::matrix::{BlockMatrix, BlockPattern};
use conjugate_gradients::{CgOutcome, ConjugateGradients};
use direct::{Inertia, LuFactors, SymmetricFactors};
use extraction::FreeTriangle;

pub use estimate::{
    AUTO_OPERATIONS_2D, AUTO_OPERATIONS_3D, FactorizationEstimate, estimate_factorization,
};
pub use report::{Definiteness, LinearError, LinearMethod, LinearOptions, LinearReport};

/// A direct solution with a larger relative residual is refined: a few units of rounding.
const ROUNDING_RESIDUAL: f64 = 1e-14;

/// Steps of refinement. The first brings the backward error to rounding, where it was not.
const REFINEMENTS: usize = 2;

/// A direct solution is inaccurate when its residual exceeds this times `|K| |x| + |b|` (norms).
/// Backward stable solves reach 1e-15; what is 1e5 times worse has lost its pivots.
const INACCURATE: f64 = 1e-10;

/// What the solver holds for the matrix it was last given.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Factor {
    None,
    /// No degree of freedom is free.
    Nothing,
    Cholesky,
    Ldlt(Inertia),
    Lu,
    Cg,
}

/// Solves systems with one pattern and one set of free degrees of freedom.
pub struct LinearSolver {
    pattern: Arc<BlockPattern>,
    constraints: Constraints,
    options: LinearOptions,
    /// `Auto` decided.
    method: LinearMethod,
    estimate: FactorizationEstimate,
    triangle: Option<FreeTriangle>,
    symmetric: Option<SymmetricFactors>,
    lu: Option<LuFactors>,
    cg: Option<ConjugateGradients>,
    factor: Factor,
    notes: Vec<String>,
    n_factorizations: usize,
}

impl LinearSolver {
    /// Orders the points, decides on the method and, for a direct one, refuses what exceeds the
    /// memory limit.
    pub fn new(
        pattern: &Arc<BlockPattern>,
        constraints: &Constraints,
        options: LinearOptions,
    ) -> Result<LinearSolver, LinearError> {
        let estimate = estimate_factorization(pattern, constraints)?;
        let method = match options.method {
            LinearMethod::Auto => automatic(pattern.dimension, &estimate, &options),
            method => method,
        };
        let solver = LinearSolver {
            pattern: Arc::clone(pattern),
            constraints: constraints.clone(),
            options,
            method,
            estimate,
            triangle: None,
            symmetric: None,
            lu: None,
            cg: None,
            factor: Factor::None,
            notes: Vec::new(),
            n_factorizations: 0,
        };
        if method != LinearMethod::Cg {
            solver.check_memory()?;
        }
        Ok(solver)
    }

    /// The method it starts with; never `Auto`.
    pub fn method(&self) -> LinearMethod {
        self.method
    }

    /// Cost of one factorisation.
    pub fn estimate(&self) -> &FactorizationEstimate {
        &self.estimate
    }

    /// How many factorisations were tried.
    pub fn n_factorizations(&self) -> usize {
        self.n_factorizations
    }

    /// Factorises and solves.
    pub fn solve(
        &mut self,
        matrix: &BlockMatrix,
        rhs: &[f64],
        solution: &mut [f64],
    ) -> Result<LinearReport, LinearError> {
        self.factorize(matrix)?;
        self.solve_factorized(matrix, rhs, solution)
    }

    /// Prepares `matrix`, the method's fallbacks included.
    pub fn factorize(&mut self, matrix: &BlockMatrix) -> Result<(), LinearError> {
        self.notes.clear();
        self.factor = Factor::None;
        if !matrix.values.iter().all(|x| x.is_finite()) {
            return Err(LinearError::NotFinite { what: "tangent stiffness" });
        }
        if self.constraints.n_free() == 0 {
            self.factor = Factor::Nothing;
            return Ok(());
        }
        if let Some(triangle) = &mut self.triangle {
            triangle.update(matrix);
        }
        match self.method {
            LinearMethod::Auto | LinearMethod::Cholesky => self.factorize_cholesky(matrix),
            LinearMethod::Ldlt => self.factorize_ldlt(matrix),
            LinearMethod::Lu => self.factorize_lu(matrix),
            LinearMethod::Cg => self.prepare_cg(matrix),
        }
    }

    /// Solves with the `matrix` last given to [`LinearSolver::factorize`].
    pub fn solve_factorized(
        &mut self,
        matrix: &BlockMatrix,
        rhs: &[f64],
        solution: &mut [f64],
    ) -> Result<LinearReport, LinearError> {
        solution.fill(0.0);
        let b = self.constraints.free_part(rhs);
        if !b.iter().all(|x| x.is_finite()) {
            return Err(LinearError::NotFinite { what: "residual" });
        }
        let mut iterations = 0;
        let mut residual = f64::INFINITY;
        if self.factor == Factor::Cg {
            match self.solve_cg(matrix, rhs, solution)? {
                Some((count, relative)) => (iterations, residual) = (count, relative),
                None => solution.fill(0.0),
            }
        }
        if self.factor == Factor::Nothing {
            residual = 0.0;
        } else if self.factor != Factor::Cg {
            residual = self.solve_direct(matrix, &b, solution)?;
        }
        Ok(self.report(iterations, residual))
    }

    fn report(&self, iterations: usize, relative_residual: f64) -> LinearReport {
        let definiteness = self.definiteness();
        LinearReport {
            method: match self.factor {
                Factor::Cholesky => LinearMethod::Cholesky,
                Factor::Ldlt(_) => LinearMethod::Ldlt,
                Factor::Lu => LinearMethod::Lu,
                Factor::Cg => LinearMethod::Cg,
                Factor::None | Factor::Nothing => self.method,
            },
            iterations,
            relative_residual,
            positive_definite: definiteness.positive_definite,
            negative_pivots: definiteness.negative_pivots,
            factor_nonzeros: match self.factor {
                Factor::Cholesky | Factor::Ldlt(_) => {
                    self.symmetric.as_ref().map(SymmetricFactors::n_values)
                }
                _ => None,
            },
            notes: self.notes.clone(),
        }
    }

    /// What the factorisation of the current matrix says about the signs of its eigenvalues.
    pub fn definiteness(&self) -> Definiteness {
        let (positive_definite, negative_pivots, method) = match self.factor {
            Factor::Cholesky => (Some(true), Some(0), "Cholesky".to_string()),
            Factor::Nothing => (Some(true), Some(0), "nothing is free".to_string()),
            Factor::Ldlt(Inertia { negative, zero }) => {
                let singular = zero > 0 || (negative == 0 && self.cholesky_failed());
                let definite = negative == 0 && !singular;
                let found = if singular && negative == 0 {
                    "LDLT: singular to rounding".to_string()
                } else {
                    format!("LDLT: {negative} negative pivots")
                };
                (Some(definite), Some(negative), found)
            }
            Factor::Lu => (None, None, "LU: signs unknown".to_string()),
            Factor::Cg => {
                (None, None, "conjugate gradients: no negative curvature met".to_string())
            }
            Factor::None => (None, None, "no factorisation".to_string()),
        };
        Definiteness { positive_definite, negative_pivots, method }
    }

    /// Judges `matrix` by factorisation: Cholesky, then the inertia of LDLT.
    ///
    /// With a direct method the factors serve the next [`LinearSolver::solve_factorized`] as well.
    pub fn judge(&mut self, matrix: &BlockMatrix) -> Result<Definiteness, LinearError> {
        self.notes.clear();
        if self.constraints.n_free() == 0 {
            self.factor = Factor::Nothing;
            return Ok(self.definiteness());
        }
        if let Some(triangle) = &mut self.triangle {
            triangle.update(matrix);
        }
        self.factorize_cholesky_or_ldlt(matrix)?;
        Ok(self.definiteness())
    }

    fn cholesky_failed(&self) -> bool {
        self.notes.iter().any(|note| note == CHOLESKY_FAILED)
    }

    fn check_memory(&self) -> Result<(), LinearError> {
        let (needed, limit) = (self.estimate.bytes(), self.options.memory_limit);
        if needed <= limit {
            return Ok(());
        }
        let because = self.notes.last().map(|note| format!("{note}: ")).unwrap_or_default();
        Err(LinearError::TooLarge { because, needed, limit })
    }

    fn singular(&self) -> LinearError {
        LinearError::Singular { free: self.constraints.n_free() }
    }
}

/// The residual that conjugate gradients carry along drifts from the true one in ill-conditioned
/// systems; a true relative residual above this is of no use to Newton's method.
const CG_LOST: f64 = 1e-4;

const CHOLESKY_FAILED: &str = "Cholesky met a pivot that is not positive";

fn automatic(
    dimension: usize,
    estimate: &FactorizationEstimate,
    options: &LinearOptions,
) -> LinearMethod {
    let limit = if dimension == 2 { AUTO_OPERATIONS_2D } else { AUTO_OPERATIONS_3D };
    if estimate.operations <= limit && estimate.bytes() <= options.memory_limit {
        LinearMethod::Cholesky
    } else {
        LinearMethod::Cg
    }
}

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
            let factors = SymmetricFactors::new(triangle, &self.estimate, &self.constraints, d)?;
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

    fn factorize_cholesky(&mut self, matrix: &BlockMatrix) -> Result<(), LinearError> {
        self.factorize_cholesky_or_ldlt(matrix)?;
        self.lu_if_pivots_vanish(matrix)
    }

    fn factorize_cholesky_or_ldlt(&mut self, matrix: &BlockMatrix) -> Result<(), LinearError> {
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

    fn factorize_ldlt(&mut self, matrix: &BlockMatrix) -> Result<(), LinearError> {
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

    fn factorize_lu(&mut self, matrix: &BlockMatrix) -> Result<(), LinearError> {
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

    fn prepare_cg(&mut self, matrix: &BlockMatrix) -> Result<(), LinearError> {
        let tolerance = self.options.cg_tolerance;
        let cg = self.cg.get_or_insert_with(|| {
            ConjugateGradients::new(&self.pattern, &self.constraints, tolerance)
        });
        if cg.update(matrix) {
            self.factor = Factor::Cg;
            return Ok(());
        }
        self.notes.push("a diagonal block of the tangent is not positive definite".to_string());
        self.factorize_ldlt(matrix)
    }

    /// Iterations and relative residual; or `None` after factorising where iterating failed.
    fn solve_cg(
        &mut self,
        matrix: &BlockMatrix,
        rhs: &[f64],
        solution: &mut [f64],
    ) -> Result<Option<(usize, f64)>, LinearError> {
        let cg = self.cg.as_ref().expect("prepared by factorize");
        match cg.solve(rhs, solution)? {
            CgOutcome::Converged { iterations } => {
                let residual = self.residual(matrix, &self.constraints.free_part(rhs), solution).0;
                if residual <= CG_LOST {
                    return Ok(Some((iterations, residual)));
                }
                self.notes.push(format!("conjugate gradients lost the residual ({residual:.1e})"));
                self.factorize_cholesky(matrix)?;
            }
            CgOutcome::NegativeCurvature => {
                self.notes.push("conjugate gradients met negative curvature".to_string());
                self.factorize_ldlt(matrix)?;
            }
            CgOutcome::NotConverged => {
                self.notes.push("conjugate gradients did not converge".to_string());
                self.factorize_cholesky(matrix)?;
            }
        }
        Ok(None)
    }

    /// Solves with the factors at hand, LU after an inaccurate LDLT; the relative residual.
    fn solve_direct(
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

    fn apply_factors(&mut self, x: &mut [f64]) -> Result<(), LinearError> {
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

#[cfg(test)]
mod tests;
