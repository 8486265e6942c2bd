//! What load steps leave: a record for each, and how the run ended.

use piola_mechanics::energy::EnergyParts;

use super::breaking::Broken;
use crate::clock::{Counters, PhaseTimes};
use crate::constraint::ConstraintError;
use crate::linear::{Definiteness, LinearError, LinearMethod, LinearReport};
use crate::newton::NewtonError;
use crate::rigid_modes::UnderConstrained;

/// One converged step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepRecord {
    /// The time of the step.
    pub t: f64,
    /// Whether it is a nominal time; if not, a cut-back led here.
    pub nominal: bool,
    /// Iterations of Newton's method.
    pub iterations: usize,
    /// 2-norm of the free residual in N, before any iteration and after each.
    pub residual: Vec<f64>,
    /// The same over the larger of the 2-norms of reactions and loads.
    pub residual_over_reaction: Vec<f64>,
    /// Energy by kind of interaction.
    pub energy_parts: EnergyParts,
    /// Whether the tangent is positive definite, and how that is known.
    pub definiteness: Definiteness,
    /// An estimate of the condition of the tangent on the free degrees of freedom (1-norm), where
    /// it was factorised or conjugate gradients converged.
    pub condition: Option<f64>,
    /// How far rounding the displacements changes the forces, relative to reactions or loads.
    pub rounding_floor: f64,
    /// The linear system that led to the start of Newton's method, where one did.
    pub start: Option<LinearReport>,
    /// The linear systems of its iterations, one each.
    pub linear: Vec<LinearReport>,
    /// The accepted parts of the Newton steps; 1 for a full step.
    pub step_lengths: Vec<f64>,
    /// How often the increment was halved on the way from the last converged step.
    pub cut_backs: usize,
    /// What broke, of a body that can break.
    pub broken: Option<Broken>,
    /// What the reader should know.
    pub notes: Vec<String>,
    /// Time by phase, failed attempts included.
    pub times: PhaseTimes,
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The converged steps, sub-steps included.
    pub records: Vec<StepRecord>,
    /// Displacements of the last one in m.
    pub displacements: Vec<f64>,
    /// What was evaluated and solved.
    pub counters: Counters,
    /// How linear systems were solved.
    pub linear: LinearSummary,
    /// Whether the run ended before its end: by who looked on, or without convergence.
    pub stopped: bool,
}

/// How the linear systems of a run were solved, and why so.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearSummary {
    /// The method that the last one started with.
    pub method: LinearMethod,
    /// Why, a sentence without its full stop.
    pub reason: String,
    /// Whether it worked on a stored tangent.
    pub stores_matrix: bool,
    /// The preconditioner in words, where one was made.
    pub preconditioner: Option<String>,
    /// Iterations of all systems that belong to converged steps.
    pub iterations: usize,
}

/// A run that did not reach its end.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// The settings cannot be used.
    #[error("{what} must be {must} (it is {value})")]
    Settings {
        /// The setting.
        what: &'static str,
        /// What it must be.
        must: &'static str,
        /// Its value.
        value: f64,
    },
    /// The drive's list of fixed degrees of freedom cannot be used.
    #[error(transparent)]
    Constraint(#[from] ConstraintError),
    /// A prescribed value or a load is not finite.
    #[error("the {what} of component {component} of point {point} is {value} at t = {t}")]
    Drive {
        /// "prescribed displacement" or "load".
        what: &'static str,
        /// The point in the body's order.
        point: usize,
        /// The component, from 0.
        component: usize,
        /// The number that is not finite.
        value: f64,
        /// The time.
        t: f64,
    },
    /// What the energy takes of a time cannot be had.
    #[error("a parameter has no value at t = {t}")]
    Given {
        /// The time.
        t: f64,
    },
    /// Parts of the body have come loose, and must not.
    #[error("at t = {t} parts of the body have come loose: {parts}")]
    Loose {
        /// The time.
        t: f64,
        /// The parts.
        parts: UnderConstrained,
    },
    /// The linear solver cannot start.
    #[error(transparent)]
    Linear(#[from] LinearError),
    /// Newton's method failed, also with the smallest increment where smaller ones may help.
    #[error(transparent)]
    NotConverged(Box<NotConverged>),
}

/// No equilibrium was found at some time, however small the increment.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "no equilibrium at t = {t_failed}, the last is at t = {t_converged} ({cut_backs} cut-backs): {cause}"
)]
pub struct NotConverged {
    /// The last converged time.
    pub t_converged: f64,
    /// The time that was tried last.
    pub t_failed: f64,
    /// How often the increment was halved during the run.
    pub cut_backs: usize,
    /// The last failure, with its residuals.
    pub cause: NewtonError,
    /// The run up to the last converged time.
    pub outcome: Outcome,
}
