//! How Newton's method ended: a converged state, or why it stopped short.

use piola_mechanics::energy::{EnergyParts, NonFinite};

use super::linear::{LinearError, LinearReport};
use super::rigid_modes::UnderConstrained;
use super::singular::SmallFamilies;

/// How the residual fell; the first entries belong to the state before any iteration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// 2-norm of the free residual in N.
    pub residual: Vec<f64>,
    /// The same over the larger of the 2-norms of reactions and loads; infinite where both are 0.
    pub residual_over_reaction: Vec<f64>,
}

impl History {
    /// With another behind it, which begins where this ends: the last entry is that of the other.
    pub(crate) fn followed_by(mut self, next: History) -> History {
        self.residual.pop();
        self.residual.extend(next.residual);
        self.residual_over_reaction.pop();
        self.residual_over_reaction.extend(next.residual_over_reaction);
        self
    }
}

/// A converged state.
#[derive(Clone, Debug, PartialEq)]
pub struct NewtonReport {
    /// Iterations, that is, linear systems solved.
    pub iterations: usize,
    /// How the residual fell.
    pub history: History,
    /// Energy of the converged state.
    pub energy: EnergyParts,
    /// The linear systems, one per iteration.
    pub linear: Vec<LinearReport>,
    /// The accepted parts of the Newton steps; 1 for a full step, 0 for one that a tangent kept too
    /// long led nowhere.
    pub step_lengths: Vec<f64>,
    /// How far rounding the displacements changes the forces, over the larger of the 2-norms of
    /// reactions and loads: smaller tolerances are met by luck.
    pub rounding_floor: f64,
    /// What the reader should know.
    pub notes: Vec<String>,
}

/// Why Newton's method stopped short.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NewtonFailure {
    /// Too many iterations.
    #[error("no convergence in {limit} iterations")]
    Iterations {
        /// The limit.
        limit: usize,
    },
    /// The residual has reached what rounding permits, above the tolerance.
    #[error(
        "the tolerance {tolerance:.1e} is below what rounding leaves of the forces here, {within:.0e}: the residual \
         {residual:.2e} N is at its rounding floor of {floor:.1e} N"
    )]
    RoundingFloor {
        /// 2-norm of the free residual in N.
        residual: f64,
        /// Estimated rounding error of the residual in N.
        floor: f64,
        /// What was asked for, over the forces.
        tolerance: f64,
        /// The rounding error over the forces.
        within: f64,
    },
    /// No part of the Newton step decreases the potential or the residual.
    #[error("no part of the Newton step lowers the potential or the residual{}", indefinite(*.negative_pivots))]
    LineSearch {
        /// Negative eigenvalues of the tangent, if known.
        negative_pivots: Option<usize>,
    },
    /// The energy is not finite at the start of the step, or along the whole Newton step.
    #[error(transparent)]
    NonFinite(#[from] NonFinite),
    /// A linear system could not be solved.
    #[error(transparent)]
    Linear(LinearError),
    /// Parts of the body have come loose, and are not to be held.
    #[error("at t = {t} parts of the body have come loose: {parts}")]
    Loose {
        /// The time.
        t: f64,
        /// The parts.
        parts: UnderConstrained,
    },
    /// Nothing but the way back was found at some distance from the last equilibrium.
    #[error("the way of equilibria goes on nowhere that is found")]
    WayLost,
    /// Breaking has left families too small, and the run is to end there.
    #[error("at t = {t} {families}")]
    Singular {
        /// The time.
        t: f64,
        /// The points of the families, in the body's order.
        families: SmallFamilies,
    },
    /// Whoever looked on wanted an end.
    #[error("the solution was interrupted")]
    Interrupted,
}

impl From<LinearError> for NewtonFailure {
    fn from(error: LinearError) -> NewtonFailure {
        match error {
            LinearError::Interrupted => NewtonFailure::Interrupted,
            error => NewtonFailure::Linear(error),
        }
    }
}

fn indefinite(negative_pivots: Option<usize>) -> String {
    match negative_pivots {
        Some(n) if n > 0 => {
            let s = if n == 1 { "" } else { "s" };
            format!("; the tangent has {n} negative eigenvalue{s}: the state is unstable")
        }
        _ => String::new(),
    }
}

/// Newton's method failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{failure}{}", last_residual(.history))]
pub struct NewtonError {
    /// Why.
    pub failure: NewtonFailure,
    /// How far it came.
    pub history: History,
}

impl From<NonFinite> for NewtonError {
    fn from(cause: NonFinite) -> NewtonError {
        NewtonError { failure: cause.into(), history: History::default() }
    }
}

fn last_residual(history: &History) -> String {
    match (history.residual.last(), history.residual_over_reaction.last()) {
        (Some(residual), Some(ratio)) => format!(
            " (residual {residual:.2e} N, {ratio:.1e} of the reaction, after {} iterations)",
            history.residual.len() - 1
        ),
        _ => String::new(),
    }
}
