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
//! | conjugate gradients | large in three dimensions | LDLT at negative curvature, minimum residuals where that would be too large, Cholesky without convergence |
//! | the same, matrix-free | too large to be stored, or an energy that reaches beyond its bonds | minimum residuals at negative curvature |
//! | GMRES | products that are not symmetric; sees no signs | Cholesky without convergence, where the tangent is stored |
//!
//! Every fallback is noted in the [`LinearReport`]. The bits do not depend on the number of
//! threads.

mod aggregates;
mod choice;
mod condition;
mod conjugate_gradients;
mod direct;
mod estimate;
mod extraction;
mod factor_of_bonds;
mod fallback;
mod gmres;
mod iterative;
mod judgement;
mod lanczos;
mod minimum_residual;
mod operator;
mod preconditioner;
mod report;
mod tangent;
mod two_level;

use std::sync::Arc;

use super::constraint::Constraints;
use super::watch::Watch;
use crate::energy::{Products, TotalEnergy};
use crate::matrix::BlockPattern;
use conjugate_gradients::CgLimits;
use direct::{Inertia, LuFactors, SymmetricFactors};
use extraction::FreeTriangle;
use iterative::Iterative;

pub use choice::{
    AUTO_OPERATIONS_2D, AUTO_OPERATIONS_3D, AUTO_UNKNOWNS_3D, Choice, Circumstances, MEMORY_SHARE,
    choose,
};
pub use estimate::{FactorizationEstimate, estimate_factorization};
pub(crate) use factor_of_bonds::OPERATIONS_PER_BLOCK;
pub use gmres::RESTART;
pub use iterative::BLOCK_JACOBI;
pub use lanczos::RitzValues;
pub use report::{
    Definiteness, LinearError, LinearMethod, LinearOptions, LinearReport, PreconditionerChoice,
};
pub use tangent::Tangent;
pub(super) use tangent::absolute_of_diagonal;

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
    MinimumResidual,
    Gmres,
}

/// Solves systems with one pattern and one set of free degrees of freedom.
pub struct LinearSolver {
    pattern: Arc<BlockPattern>,
    positions: Vec<f64>,
    constraints: Constraints,
    options: LinearOptions,
    /// `Auto` decided.
    choice: Choice,
    stores_matrix: bool,
    limits: CgLimits,
    /// The cost of a factorisation, once it is asked for.
    estimate: Option<FactorizationEstimate>,
    triangle: Option<FreeTriangle>,
    symmetric: Option<SymmetricFactors>,
    lu: Option<LuFactors>,
    iterative: Option<Iterative>,
    factor: Factor,
    /// What conjugate gradients saw in the last run with the present matrix.
    seen: Option<(usize, Option<RitzValues>)>,
    /// The probe of the last judgement and the solution for it.
    probe: Option<(Vec<f64>, Vec<f64>)>,
    notes: Vec<String>,
    n_factorizations: usize,
    watch: Watch,
}

impl LinearSolver {
    /// Decides on the method and, for a direct one, orders the points and refuses what exceeds the
    /// memory limit. `positions` are those at rest, `n x d`, in m.
    pub fn new(
        pattern: &Arc<BlockPattern>,
        positions: &[f64],
        constraints: &Constraints,
        options: LinearOptions,
    ) -> Result<LinearSolver, LinearError> {
        let mut solver = LinearSolver {
            pattern: Arc::clone(pattern),
            positions: positions.to_vec(),
            constraints: constraints.clone(),
            options,
            choice: Choice { method: options.method, reason: "the scene says so".to_string() },
            stores_matrix: true,
            limits: CgLimits {
                tolerance: options.cg_tolerance,
                // Twice the unknowns cover the loss of orthogonality of ill-conditioned systems.
                max_iterations: (2 * constraints.n_free()).clamp(1000, 20_000),
            },
            estimate: None,
            triangle: None,
            symmetric: None,
            lu: None,
            iterative: None,
            factor: Factor::None,
            seen: None,
            probe: None,
            notes: Vec::new(),
            n_factorizations: 0,
            watch: Watch::default(),
        };
        if options.method == LinearMethod::Auto {
            solver.choose()?;
        }
        solver.stores_matrix = solver.method() != LinearMethod::MatrixFree;
        if !solver.iterates() {
            solver.check_memory()?;
        }
        Ok(solver)
    }

    /// The same without a matrix, for a reason; `pattern` is that of the bonds. Conjugate gradients,
    /// unless GMRES are asked for.
    pub fn without_matrix(
        pattern: &Arc<BlockPattern>,
        positions: &[f64],
        constraints: &Constraints,
        options: LinearOptions,
        reason: &str,
    ) -> Result<LinearSolver, LinearError> {
        let method = match options.method {
            LinearMethod::Gmres => LinearMethod::Gmres,
            _ => LinearMethod::MatrixFree,
        };
        let options = LinearOptions { method, ..options };
        let mut solver = LinearSolver::new(pattern, positions, constraints, options)?;
        solver.choice.reason = reason.to_string();
        solver.stores_matrix = false;
        Ok(solver)
    }

    /// The solver for the tangent of an energy: without a matrix where that reaches further than the
    /// bonds, or where products are all there is of it.
    ///
    /// # Errors
    /// As [`LinearSolver::new`], and a method that needs the matrix where there are products only.
    pub fn of_energy(
        energy: &dyn TotalEnergy,
        constraints: &Constraints,
        options: LinearOptions,
    ) -> Result<LinearSolver, LinearError> {
        let positions = energy.positions();
        let products_only = energy.products() != Products::Exact;
        let (method, reason) = match options.method {
            LinearMethod::Auto if products_only => {
                (LinearMethod::Gmres, "products by finite differences are not symmetric")
            }
            LinearMethod::Auto => (options.method, "the tangent reaches further than the bonds"),
            method => (method, "the scene says so"),
        };
        let may_do_without = matches!(
            options.method,
            LinearMethod::Auto | LinearMethod::MatrixFree | LinearMethod::Gmres
        );
        let options = LinearOptions { method, ..options };
        match energy.bond_pattern() {
            Some(pattern) if may_do_without => {
                LinearSolver::without_matrix(pattern, positions, constraints, options, reason)
            }
            _ if products_only && !may_do_without => {
                Err(LinearError::ProductsOnly { method: method.name() })
            }
            _ if products_only => {
                let pattern = energy.pattern();
                LinearSolver::without_matrix(pattern, positions, constraints, options, reason)
            }
            _ => LinearSolver::new(energy.pattern(), positions, constraints, options),
        }
    }

    /// `Auto` decides.
    fn choose(&mut self) -> Result<(), LinearError> {
        let (dimension, unknowns) = (self.pattern.dimension, self.constraints.n_free());
        let matrix_bytes = self.matrix_bytes();
        let may_be_cheap = dimension == 2 || unknowns <= AUTO_UNKNOWNS_3D;
        let factorization = if may_be_cheap && matrix_bytes <= self.options.memory_limit {
            let estimate = self.estimate()?;
            Some((estimate.operations, estimate.bytes()))
        } else {
            None
        };
        self.choice = choose(&Circumstances {
            dimension,
            unknowns,
            factorization,
            matrix_bytes,
            memory_limit: self.options.memory_limit,
        });
        if let Some((operations, _)) = factorization {
            let worth = choice::iterations_worth(operations, matrix_bytes) as usize;
            self.limits.max_iterations = self.limits.max_iterations.min(worth.max(100));
        }
        Ok(())
    }

    /// The method it starts with, never `Auto`, and why.
    pub fn choice(&self) -> &Choice {
        &self.choice
    }

    /// The method it starts with; never `Auto`.
    pub fn method(&self) -> LinearMethod {
        self.choice.method
    }

    /// The preconditioner in words, once there is one.
    pub fn preconditioner(&self) -> Option<String> {
        self.iterative.as_ref().map(Iterative::preconditioner)
    }

    /// Whether it starts with conjugate gradients or GMRES.
    pub fn iterates(&self) -> bool {
        matches!(self.method(), LinearMethod::Cg | LinearMethod::MatrixFree | LinearMethod::Gmres)
    }

    /// Whether it works on a stored tangent.
    pub fn stores_matrix(&self) -> bool {
        self.stores_matrix
    }

    /// From now on iterative methods stop at this residual relative to the right-hand side.
    pub fn set_tolerance(&mut self, tolerance: f64) {
        self.limits.tolerance = tolerance;
    }

    /// From now on someone looks on: sees every product, and may end iterations.
    pub fn watched(&mut self, watch: Watch) {
        self.watch = watch;
    }

    /// Cost of one factorisation; orders the points at the first call.
    pub fn estimate(&mut self) -> Result<&FactorizationEstimate, LinearError> {
        if self.estimate.is_none() {
            self.estimate = Some(estimate_factorization(&self.pattern, &self.constraints)?);
        }
        Ok(self.estimate.as_ref().expect("made in the lines above"))
    }

    /// How many factorisations were tried.
    pub fn n_factorizations(&self) -> usize {
        self.n_factorizations
    }

    fn matrix_bytes(&self) -> f64 {
        (8 * self.pattern.n_blocks() * self.pattern.dimension * self.pattern.dimension) as f64
    }

    /// Factorises and solves.
    pub fn solve<'a>(
        &mut self,
        tangent: impl Into<Tangent<'a>>,
        rhs: &[f64],
        solution: &mut [f64],
    ) -> Result<LinearReport, LinearError> {
        let tangent = tangent.into();
        self.factorize(tangent)?;
        self.solve_factorized(tangent, rhs, solution)
    }

    /// Prepares a tangent, the method's fallbacks included.
    pub fn factorize<'a>(&mut self, tangent: impl Into<Tangent<'a>>) -> Result<(), LinearError> {
        let tangent = tangent.into();
        if self.start(tangent)? {
            return Ok(());
        }
        match (self.method(), tangent) {
            (LinearMethod::Ldlt, Tangent::Stored(matrix)) => self.factorize_ldlt(matrix),
            (LinearMethod::Lu, Tangent::Stored(matrix)) => self.factorize_lu(matrix),
            (LinearMethod::Cholesky | LinearMethod::Auto, Tangent::Stored(matrix)) => {
                self.factorize_cholesky(matrix)
            }
            _ => self.prepare_iterations(tangent),
        }
    }

    /// Forgets the matrix before; whether there is nothing to do for this one.
    fn start(&mut self, tangent: Tangent<'_>) -> Result<bool, LinearError> {
        self.notes.clear();
        self.factor = Factor::None;
        (self.seen, self.probe) = (None, None);
        if !tangent.is_finite() {
            return Err(LinearError::NotFinite { what: "tangent stiffness" });
        }
        if self.constraints.n_free() == 0 {
            self.factor = Factor::Nothing;
            return Ok(true);
        }
        if let (Some(triangle), Tangent::Stored(matrix)) = (&mut self.triangle, tangent) {
            triangle.update(matrix);
        }
        Ok(false)
    }

    /// Solves with the tangent last given to [`LinearSolver::factorize`].
    pub fn solve_factorized<'a>(
        &mut self,
        tangent: impl Into<Tangent<'a>>,
        rhs: &[f64],
        solution: &mut [f64],
    ) -> Result<LinearReport, LinearError> {
        let tangent = tangent.into();
        solution.fill(0.0);
        let b = self.constraints.free_part(rhs);
        if !b.iter().all(|x| x.is_finite()) {
            return Err(LinearError::NotFinite { what: "residual" });
        }
        let (mut iterations, mut residual) = (0, 0.0);
        if self.factor == Factor::Cg {
            (iterations, residual) = self.solve_cg(tangent, rhs, solution)?;
        }
        if self.factor == Factor::MinimumResidual {
            let more;
            (more, residual) = self.solve_minimum_residual(tangent, rhs, solution)?;
            iterations += more;
        }
        if self.factor == Factor::Gmres {
            (iterations, residual) = self.solve_gmres(tangent, rhs, solution)?;
        }
        if let (Factor::Cholesky | Factor::Ldlt(_) | Factor::Lu, Tangent::Stored(matrix)) =
            (self.factor, tangent)
        {
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
                Factor::MinimumResidual => LinearMethod::MinimumResidual,
                Factor::Gmres => LinearMethod::Gmres,
                Factor::Cg | Factor::None | Factor::Nothing => self.method(),
            },
            iterations,
            ritz: self.seen.and_then(|(_, ritz)| ritz),
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

    fn check_memory(&mut self) -> Result<(), LinearError> {
        let (needed, limit) = (self.estimate()?.bytes(), self.options.memory_limit);
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

#[cfg(test)]
mod iterative_tests;
#[cfg(test)]
mod tests;
