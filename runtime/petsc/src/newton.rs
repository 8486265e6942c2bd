//! Newton's method and linear systems.

use crate::engine::Engine;
use crate::error::EngineError;
use crate::ffi::{Ended, RawNewton, Rows, Solved};
use crate::rows::BlockRows;

/// Why a callback of a [`Problem`] has no result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Nothing is defined at these displacements: the line search takes a shorter step. One rank may find
    /// this alone; it says so after the exchanges in which other ranks take part.
    Outside,
    /// The solve is to end, with these words on all ranks. A rank that fails before an exchange in which
    /// others wait for it ends the whole run ten seconds later, with these words on stderr.
    Failed(String),
}

impl From<EngineError> for Refusal {
    fn from(error: EngineError) -> Refusal {
        Refusal::Failed(error.message)
    }
}

/// What is to be solved: `r(u) = 0`, seen from one rank, which knows `d` numbers for each owned point.
///
/// All ranks are called at the same time: callbacks but [`row`](Problem::row) may exchange halos and sums. A panic
/// in a callback is [`Refusal::Failed`] with its message.
pub trait Problem {
    /// Computes the residual `r` at the displacements `u`, both of owned points. Rows of prescribed degrees
    /// of freedom hold `u` minus what is prescribed.
    ///
    /// # Errors
    /// Why there is none.
    fn residual(&mut self, u: &[f64], r: &mut [f64]) -> Result<(), Refusal>;

    /// Computes the derivative of the residual at `u`, for [`row`](Problem::row).
    ///
    /// # Errors
    /// Why there is none.
    fn tangent(&mut self, u: &[f64]) -> Result<(), Refusal>;

    /// Writes all blocks of one row of the last tangent ([`BlockRows`]), the row of the owned point with this number
    /// among the owned ones. What was in `values` is anything. Called once for each owned point where this rank has a
    /// tangent, so it must exchange nothing with other ranks.
    fn row(&mut self, row: usize, values: &mut [f64]);

    /// Whether the displacements of the last call of [`residual`](Problem::residual) that was no trial of a
    /// line search solve the problem, with the 2-norm of the residual over all ranks. Called before the first
    /// iteration, with 0, and after each; it is solved where all ranks say so.
    fn is_converged(&mut self, iteration: usize, norm: f64) -> bool;
}

/// How [`Newton::solve`] ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Whether [`Problem::is_converged`] said so.
    pub converged: bool,
    /// PETSc's name for why it ended, as `DIVERGED_LINE_SEARCH`; behind a linear solver that failed its own
    /// reason in brackets: `DIVERGED_LINEAR_SOLVE (DIVERGED_ITS)`.
    pub reason: String,
    /// Steps of Newton's method.
    pub iterations: u64,
    /// Steps of the linear solver, in all of them together.
    pub linear_iterations: u64,
    /// The 2-norm of the residual over all ranks, where the last step led.
    pub residual: f64,
}

/// How [`Newton::solve_linear`] ended.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearOutcome {
    /// Whether the residual became as small as the tolerance asks.
    pub converged: bool,
    /// PETSc's name for why it ended, as `CONVERGED_RTOL` or `DIVERGED_ITS`.
    pub reason: String,
    /// Steps of the linear solver.
    pub iterations: u64,
}

/// A solver for problems of one pattern, with its matrix: made once, and used for every load step.
///
/// Without options it is Newton's method with a line search that goes back, at most 50 steps; flexible GMRES
/// with restart 100 to a relative residual of 1e-8; and algebraic multigrid that knows the rigid motions. All
/// of it follows PETSc's options (`-snes_type`, `-ksp_type`, `-pc_type` and what belongs to them), but for the
/// test of convergence, which is the problem's own: `-snes_atol`, `-snes_rtol` and `-snes_stol` do nothing.
///
/// On one rank a solution has the same bits in every run. On several, PETSc's multigrid adds what ranks send in
/// the order in which it arrives, and the last digits differ from run to run; `-matptap_via backend`, which
/// makes its coarse matrices more slowly, or another preconditioner (`-pc_type bjacobi`) keeps them.
///
/// Coarse spaces of multigrid are those of the first tangent (`-pc_gamg_reuse_interpolation false` finds them
/// anew every time). A pattern that changes needs a new solver.
pub struct Newton<'e> {
    raw: RawNewton,
    engine: &'e Engine,
    /// What an earlier solve ended with: PETSc is then in the middle of things.
    broken: Option<EngineError>,
}

impl<'e> Newton<'e> {
    /// Rank `r` owns the points `ranges[r]..ranges[r + 1]`, with `d` numbers each; `pattern` are their rows.
    /// `modes` are motions that cost no energy, as rigid ones, by their displacements of owned points: they
    /// need not be orthogonal or independent. All ranks give equally many. Collective.
    ///
    /// # Errors
    /// On every rank where on one the ranges, the pattern or the modes are not as they should be; an option
    /// whose value PETSc does not know, by its name; and what else PETSc reports.
    pub fn new(
        engine: &'e Engine,
        ranges: &[u64],
        pattern: &BlockRows,
        d: usize,
        modes: &[Vec<f64>],
    ) -> Result<Newton<'e>, EngineError> {
        let checked = pattern.check(engine, ranges, d).and_then(|()| {
            let unknowns = (pattern.starts.len() - 1) * d;
            let fit = modes.iter().all(|mode| mode.len() == unknowns);
            if fit { Ok(()) } else { Err(format!("a mode is not of {unknowns} numbers")) }
        });
        engine.agree(checked)?;
        let counts = engine.all_gather(modes.len() as u64);
        if counts.iter().any(|&count| count != counts[0]) {
            return Err(EngineError::new("ranks give different numbers of modes"));
        }
        let starts: Vec<i64> = pattern.starts.iter().map(|&start| start as i64).collect();
        let columns: Vec<i64> = pattern.columns.iter().map(|&column| column as i64).collect();
        let rows = Rows {
            own: starts.len() - 1,
            first: ranges[engine.rank()],
            all: ranges[engine.ranks()],
            d,
            starts: &starts,
            columns: &columns,
        };
        let raw = RawNewton::new(engine.running(), &rows, modes)?;
        Ok(Newton { raw, engine, broken: None })
    }

    /// Solves a problem from `u`, the displacements of owned points, which are then where the method ended,
    /// converged or not. Collective.
    ///
    /// # Errors
    /// What a callback failed with, with its rank, on all ranks; what PETSc reports. The solver is of no more
    /// use then: it gives the same error again.
    ///
    /// # Panics
    /// If `u` is not of the length that the pattern says: a mistake of the caller, not of a user.
    pub fn solve(
        &mut self,
        problem: &mut dyn Problem,
        u: &mut [f64],
    ) -> Result<Outcome, EngineError> {
        self.is_whole()?;
        let result = self.raw.solve(problem, u);
        self.heard(result).map(outcome)
    }

    /// Solves one linear system: the tangent that the problem computed last, by its [`row`](Problem::row)s, times `x`
    /// is `right`, both of owned points. `x` need not be set before. Collective.
    ///
    /// # Errors
    /// As [`solve`](Newton::solve).
    ///
    /// # Panics
    /// If an array is not of the length that the pattern says: a mistake of the caller, not of a user.
    pub fn solve_linear(
        &mut self,
        problem: &mut dyn Problem,
        right: &[f64],
        x: &mut [f64],
    ) -> Result<LinearOutcome, EngineError> {
        self.is_whole()?;
        let result = self.raw.solve_linear(problem, right, x);
        let Ended { converged, linear_iterations, reason, .. } = self.heard(result)?;
        Ok(LinearOutcome { converged, reason, iterations: linear_iterations })
    }

    fn is_whole(&self) -> Result<(), EngineError> {
        self.broken.clone().map_or(Ok(()), Err)
    }

    /// What a solve came to; where a callback failed, with the words of the rank whose it was. Collective.
    fn heard<T>(&mut self, result: Solved<T>) -> Result<T, EngineError> {
        let result = result.and_then(|solved| {
            solved.map_err(|own| {
                let failed = self.engine.agree(own.map_or(Ok(()), Err));
                let unknown = || EngineError::new("a callback failed");
                failed.err().map_or_else(unknown, EngineError::from)
            })
        });
        self.broken = result.as_ref().err().cloned();
        result
    }
}

fn outcome(ended: Ended) -> Outcome {
    let Ended { converged, iterations, linear_iterations, residual, reason, linear_reason } = ended;
    let reason = match linear_reason {
        Some(linear) => format!("{reason} ({linear})"),
        None => reason,
    };
    Outcome { converged, reason, iterations, linear_iterations, residual }
}
