//! Why a motion cannot start or go on.

use piola_mechanics::energy::NonFinite;

use super::MotionSettings;
use crate::constraint::ConstraintError;
use crate::newton::NewtonFailure;
use crate::singular::SmallFamilies;

/// More steps than these are a mistake: at a microsecond each they take 30 years.
pub(super) const MOST_STEPS: f64 = 1e15;

/// A motion that cannot start or go on; points are in the body's order.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MotionError {
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
    /// A point without mass.
    #[error("the mass of point {point} must be positive (it is {mass} kg)")]
    Mass {
        /// The point.
        point: usize,
        /// In kg.
        mass: f64,
    },
    /// What is prescribed cannot be used.
    #[error(transparent)]
    Constraint(#[from] ConstraintError),
    /// A prescribed value or a load is not finite.
    #[error("the {what} of component {component} of point {point} is {value} at t = {t} s")]
    Drive {
        /// "prescribed displacement", "prescribed velocity", "prescribed acceleration" or "load".
        what: &'static str,
        /// The point.
        point: usize,
        /// The component, from 0.
        component: usize,
        /// The number that is not finite.
        value: f64,
        /// The time in s.
        t: f64,
    },
    /// A parameter of the energy cannot be what it is given; whoever gave it knows why.
    #[error("a parameter of the energy cannot have the value that it is given at t = {t} s")]
    Parameters {
        /// The time in s.
        t: f64,
    },
    /// No step was given, and none is critical.
    #[error("the body has no stiffness at the start, so no step is critical: give one in s")]
    NoStiffness,
    /// No step was given, and nothing moves by itself.
    #[error("nothing is free to move, so no step is critical: give one in s")]
    NothingFree,
    /// Bonds dissipate by their rates, and the rule is implicit.
    #[error(
        "the implicit midpoint rule takes no dissipation of bonds: choose an explicit rule of integration"
    )]
    ImplicitDissipation,
    /// The step is beyond the critical one.
    #[error(
        "the step {step:e} s is beyond the critical one, {critical:.6e} s: the motion would grow without bound"
    )]
    TooLong {
        /// In s.
        step: f64,
        /// In s.
        critical: f64,
    },
    /// Nobody lives that long.
    #[error("{count:e} steps of {step:e} s are too many")]
    TooMany {
        /// How many steps lead to the end.
        count: f64,
        /// In s.
        step: f64,
    },
    /// A snapshot is not one of this motion.
    #[error("this is not the motion that the checkpoint was made of: {what}")]
    OtherMotion {
        /// By what that is known.
        what: &'static str,
    },
    /// An energy that is not finite on the way.
    #[error("at t = {t:e} s, after {step} steps{}: {cause}", beyond(*.unstable))]
    NonFinite {
        /// The time in s.
        t: f64,
        /// How many steps led there.
        step: usize,
        /// The critical step in s, where the step is beyond it.
        unstable: Option<f64>,
        /// What is not finite.
        cause: NonFinite,
    },
    /// The equations of an implicit step have no solution near.
    #[error(
        "no way on from t = {t:e} s, after {step} steps of {dt:e} s: {failure}; a shorter step may help"
    )]
    NoStep {
        /// The time in s.
        t: f64,
        /// How many steps led there.
        step: usize,
        /// The step in s.
        dt: f64,
        /// Why Newton's method failed.
        failure: Box<NewtonFailure>,
    },
    /// Breaking has left families too small, and the motion is to end there.
    #[error("at t = {t:e} s, after {step} steps, {families}")]
    Singular {
        /// The time in s.
        t: f64,
        /// How many steps led there.
        step: usize,
        /// The points of the families.
        families: SmallFamilies,
    },
    /// A point flies off.
    #[error(transparent)]
    FlownOff(Box<FlownOff>),
    /// Another part of the body, which another process moves, has found something.
    #[error("another part of the body cannot start or go on")]
    Elsewhere,
}

/// A point that goes further in one step than the body is large.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "point {point} flies off at t = {t:e} s, after {step} steps of {dt:e} s{}: it would go {way:e} m \
     in one step, and the body is {extent:e} m large",
    beyond(*.critical)
)]
pub struct FlownOff {
    /// The time in s.
    pub t: f64,
    /// How many steps led there.
    pub step: usize,
    /// The point.
    pub point: usize,
    /// How far it would go in the next step, in m.
    pub way: f64,
    /// How large the body is at rest, in m.
    pub extent: f64,
    /// The step in s.
    pub dt: f64,
    /// The critical step in s, where the step is beyond it: the motion is unstable.
    pub critical: Option<f64>,
}

fn beyond(critical: Option<f64>) -> String {
    let beyond = |critical| format!(" (unstable: the critical step is {critical:.6e} s)");
    critical.map_or_else(String::new, beyond)
}

pub(super) fn check(settings: &MotionSettings, masses: &[f64]) -> Result<(), MotionError> {
    let is_positive = |x: f64| x.is_finite() && x > 0.0;
    let requirements = [
        (is_positive(settings.end), "end", "positive", settings.end),
        (settings.step.is_none_or(is_positive), "step", "positive", settings.step.unwrap_or(0.0)),
        (
            is_positive(settings.safety) && settings.safety <= 1.0,
            "safety",
            "greater than 0 and at most 1",
            settings.safety,
        ),
        (
            settings.damping >= 0.0 && settings.damping.is_finite(),
            "damping",
            "at least 0",
            settings.damping,
        ),
        (
            settings.tolerance > 0.0 && settings.tolerance < 1.0,
            "tolerance",
            "between 0 and 1",
            settings.tolerance,
        ),
    ];
    for (holds, what, must, value) in requirements {
        if !holds {
            return Err(MotionError::Settings { what, must, value });
        }
    }
    match masses.iter().position(|mass| !is_positive(*mass)) {
        Some(point) => Err(MotionError::Mass { point, mass: masses[point] }),
        None => Ok(()),
    }
}
