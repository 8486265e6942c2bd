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
//! | the same, matrix-free | too large to be stored, or an energy that reaches beyond its bonds | for `auto` Cholesky on a stored tangent where that costs less (`reconsider`); minimum residuals at negative curvature |
//! | GMRES | products that are not symmetric; sees no signs | Cholesky without convergence, where the tangent is stored |
//!
//! Every fallback is noted in the [`LinearReport`]. The bits do not depend on the number of
//! threads.

mod aggregates;
mod choice;
mod condition;
mod conjugate_gradients;
mod dense;
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
mod reconsider;
mod report;
mod tangent;
mod two_level;

use std::sync::Arc;

use piola_mechanics::energy::{Energy, Products};
use piola_mechanics::matrix::BlockPattern;

use super::constraint::Constraints;
use super::watch::Watch;
use choice::iterations_worth;
use conjugate_gradients::CgLimits;
use direct::{Inertia, LuFactors, SymmetricFactors};
use extraction::FreeTriangle;
use iterative::Iterative;

pub use choice::{Choice, Circumstances, MEMORY_SHARE, choose, products_before_stored, settled};
pub use dense::DenseCholesky;
pub use estimate::{FactorizationEstimate, estimate_factorization};
pub use factor_of_bonds::OPERATIONS_PER_BLOCK;
pub use gmres::RESTART;
pub use iterative::BLOCK_JACOBI;
pub use lanczos::RitzValues;
pub use report::{
    Definiteness, LinearError, LinearMethod, LinearOptions, LinearReport, PreconditionerChoice,
};
pub use tangent::Tangent;
pub(super) use tangent::absolute_of_diagonal;

/// Factors are dear from so many operations per non-zero on, of which a solve takes four. An event of a body that breaks
/// saves a factorisation by some six solves and passes of forces: together these took longer than the factorisation in
/// a plane body of 1,000 points (100 operations per non-zero), as long in one of 12,000 (300), less in a bar in space
/// (250).
const DEAR: f64 = 200.0;

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
    choice: Choice,
    limits: CgLimits,
    /// Whether a stored tangent may take over from products.
    may_store: bool,
    /// The cost of its factorisation, once it is asked for.
    wide: Option<FactorizationEstimate>,
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
        let choice = settled(options.method, false, Products::Exact);
        LinearSolver::of_choice(pattern, positions, constraints, options, choice)
    }

    /// With a method that is settled, or the one that suits its cost.
    fn of_choice(
        pattern: &Arc<BlockPattern>,
        positions: &[f64],
        constraints: &Constraints,
        options: LinearOptions,
        choice: Option<Choice>,
    ) -> Result<LinearSolver, LinearError> {
        let mut estimate = None;
        let mut limits = CgLimits {
            tolerance: options.cg_tolerance,
            max_iterations: most_iterations(constraints),
        };
        let choice = match choice {
            Some(choice) => choice,
            None => {
                let circumstances = Circumstances {
                    dimension: pattern.dimension,
                    unknowns: constraints.n_free(),
                    matrix_bytes: matrix_bytes(pattern),
                    memory_limit: options.memory_limit,
                };
                choose(&circumstances, || {
                    let found = estimate.insert(estimate_factorization(pattern, constraints)?);
                    let worth = iterations_worth(found.operations, circumstances.matrix_bytes);
                    limits.max_iterations = limits.max_iterations.min((worth as usize).max(100));
                    Ok((found.operations, found.bytes()))
                })?
            }
        };
        let mut solver =
            LinearSolver::made(pattern, positions, constraints, options, (choice, estimate));
        solver.limits = limits;
        if !solver.iterates() {
            solver.check_memory()?;
        }
        Ok(solver)
    }

    /// With a method, and what a factorisation costs if that is known.
    fn made(
        pattern: &Arc<BlockPattern>,
        positions: &[f64],
        constraints: &Constraints,
        options: LinearOptions,
        (choice, estimate): (Choice, Option<FactorizationEstimate>),
    ) -> LinearSolver {
        LinearSolver {
            pattern: Arc::clone(pattern),
            positions: positions.to_vec(),
            constraints: constraints.clone(),
            options,
            choice,
            limits: CgLimits {
                tolerance: options.cg_tolerance,
                max_iterations: most_iterations(constraints),
            },
            may_store: false,
            wide: None,
            estimate,
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
        }
    }

    /// The solver for the tangent of an energy: without a matrix where that reaches further than the
    /// bonds, or where products are all there is of it.
    ///
    /// # Errors
    /// As [`LinearSolver::new`], and a method that needs the matrix where there are products only.
    pub fn of_energy(
        energy: &dyn Energy,
        constraints: &Constraints,
        options: LinearOptions,
    ) -> Result<LinearSolver, LinearError> {
        let (bonds, products) = (energy.bond_pattern(), energy.products());
        let choice = settled(options.method, bonds.is_some(), products);
        let without = choice.as_ref().filter(|choice| !choice.stores_matrix);
        if products != Products::Exact && without.is_none() {
            return Err(LinearError::ProductsOnly { method: options.method.name() });
        }
        let pattern = bonds.filter(|_| without.is_some()).unwrap_or_else(|| energy.pattern());
        LinearSolver::of_choice(pattern, energy.positions(), constraints, options, choice)
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
        self.method().iterates()
    }

    /// Whether it holds factors of a stored tangent that are worth more solves than a change of the energy by a few
    /// interactions makes necessary. To solve with them needs no further evaluation of the energy.
    pub fn has_dear_factors(&self) -> bool {
        let is_dear = |cost: &FactorizationEstimate| cost.operations > DEAR * cost.factor_nonzeros;
        matches!(self.factor, Factor::Cholesky | Factor::Ldlt(_) | Factor::Lu)
            && self.estimate.as_ref().is_some_and(is_dear)
    }

    /// Whether it works on a stored tangent.
    pub fn stores_matrix(&self) -> bool {
        self.choice.stores_matrix
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
            (LinearMethod::Ldlt, Tangent::Stored(matrix, _)) => self.factorize_ldlt(matrix),
            (LinearMethod::Lu, Tangent::Stored(matrix, _)) => self.factorize_lu(matrix),
            (LinearMethod::Cholesky | LinearMethod::Auto, Tangent::Stored(matrix, _)) => {
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
        if let (Some(triangle), Tangent::Stored(matrix, _)) = (&mut self.triangle, tangent) {
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
        if let (Factor::Cholesky | Factor::Ldlt(_) | Factor::Lu, Tangent::Stored(matrix, _)) =
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

/// Conjugate gradients that need more iterations have lost their way: twice the unknowns cover the loss
/// of orthogonality of ill-conditioned systems.
fn most_iterations(constraints: &Constraints) -> usize {
    (2 * constraints.n_free()).clamp(1000, 20_000)
}

/// Bytes of the upper triangle of a tangent.
fn matrix_bytes(pattern: &BlockPattern) -> f64 {
    (8 * pattern.n_blocks() * pattern.dimension * pattern.dimension) as f64
}

#[cfg(test)]
mod iterative_tests;
#[cfg(test)]
mod tests;
