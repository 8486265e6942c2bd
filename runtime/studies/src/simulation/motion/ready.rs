//! A case made ready to move.

use piola_mechanics::energy::Total;
use piola_solvers::motion::{Initial, MotionError, MotionSettings};

use crate::case::{Case, CaseError, Compiled};
use crate::scene::Motion;
use crate::scene::boundary::BoundaryConditions;
use crate::scene::drive::{MotionConditions, initial};

use super::driven::Driven;
use crate::scene::selection::Selection;
use piola_output::summary::ExitReason;

/// A body with its energy, its masses, what drives it and where it starts.
pub(in crate::simulation) struct Ready<'a> {
    pub(in crate::simulation) energy: &'a Total<'a>,
    pub(in crate::simulation) selection: &'a Selection,
    /// One per point in kg, in the body's order.
    pub(in crate::simulation) masses: &'a [f64],
    pub(in crate::simulation) drive: &'a Driven<'a>,
    pub(in crate::simulation) start: Initial,
}

/// Assembles a case with its compiled energies, and hands it on.
///
/// # Errors
/// What is wrong with the body, the energies or the conditions.
pub(in crate::simulation) fn with_ready<T>(
    case: &Case,
    compiled: Vec<Compiled>,
    then: impl FnOnce(Ready<'_>) -> T,
) -> Result<T, CaseError> {
    let (energy, fields) = case.solved_energy(compiled)?;
    let selection = case.selection()?;
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection)?;
    let masses = case.masses().ok_or_else(|| no_density(case))?;
    let drive = Driven::new(MotionConditions::new(&boundary, &masses)?, &fields);
    let start = initial(&boundary)?;
    let (energy, selection) = (&energy, &selection);
    Ok(then(Ready { energy, selection, masses: &masses, drive: &drive, start }))
}

impl Case {
    /// The mass of every point in kg, in the body's order; of a body in two dimensions per metre of
    /// thickness, unless the scene states one. Nothing where a material has no density.
    pub fn masses(&self) -> Option<Vec<f64>> {
        let density = |law: usize| {
            let own = self.scene.materials.iter().find(|material| material.law == law)?;
            Some(own.density?.value * self.thickness())
        };
        let of_point = |(point, volume): (usize, &f64)| {
            let law = self.materials.as_ref().map_or(0, |materials| materials.of(point).into());
            Some(density(law)? * volume)
        };
        self.body.volumes().iter().enumerate().map(of_point).collect()
    }
}

/// How a motion is integrated.
pub(in crate::simulation) fn settings(case: &Case, scene: &Motion) -> MotionSettings {
    let output = &case.scene.output;
    MotionSettings {
        method: scene.method,
        end: scene.end,
        step: scene.step,
        safety: scene.safety,
        damping: scene.damping,
        unstable: scene.unstable,
        tolerance: case.scene.solver.tolerance,
        // Frames are rows, too.
        rows: output.rows.max(frames(case, scene).ceil() as usize),
        even: false,
        singular: case.scene.fracture.singular,
    }
}

/// How many frames lead to the end.
pub(in crate::simulation) fn frames(case: &Case, scene: &Motion) -> f64 {
    let output = &case.scene.output;
    output.every.map_or(output.frames as f64, |every| scene.end / every)
}

/// A scene that was changed after it was read: the reader wants a density of every material.
fn no_density(case: &Case) -> CaseError {
    let name = case.potentials.first().map_or("", |potential| potential.model.name());
    CaseError::Body {
        message: format!("a body that moves needs the density of its material ({name})"),
    }
}

/// Why a motion cannot start, in the scene's words.
pub(in crate::simulation) fn refused(
    case: &Case,
    drive: &Driven<'_>,
    error: MotionError,
) -> CaseError {
    let message = match error {
        MotionError::Drive { .. } => match drive.problem() {
            Some(problem) => return problem.into(),
            None => error.to_string(),
        },
        MotionError::Parameters { .. } => match drive.wrong_parameter() {
            Some(wrong) => return case.wrong_field(wrong),
            None => error.to_string(),
        },
        MotionError::TooLong { .. } => format!(
            "{error}; leave `step` out, or write a smaller one in [motion] (unstable = true takes it \
             all the same)"
        ),
        MotionError::NonFinite { ref cause, .. } => case.describe(cause),
        _ => in_users_order(case, error).to_string(),
    };
    CaseError::Body { message }
}

/// Why a motion does not go on, in the scene's words.
pub(in crate::simulation) fn stopped(
    case: &Case,
    drive: &Driven<'_>,
    error: MotionError,
) -> (ExitReason, String) {
    match &error {
        MotionError::Drive { .. } => {
            let message = drive.problem().map_or_else(|| error.to_string(), |p| p.to_string());
            (ExitReason::NonFinite, message)
        }
        MotionError::Parameters { .. } => {
            let wrong = drive.wrong_parameter();
            let message = wrong.map_or_else(|| error.to_string(), |wrong| wrong.to_string());
            (ExitReason::NonFinite, message)
        }
        MotionError::NonFinite { t, step, cause, unstable } => {
            let unstable = match unstable {
                Some(critical) => format!(" (unstable: the critical step is {critical:.6e} s)"),
                None => String::new(),
            };
            let place = case.describe(cause);
            (
                ExitReason::NonFinite,
                format!("at t = {t:e} s, after {step} steps{unstable}: {place}"),
            )
        }
        MotionError::Singular { .. } => {
            (ExitReason::Singular, in_users_order(case, error).to_string())
        }
        _ => (ExitReason::Failed, in_users_order(case, error).to_string()),
    }
}

/// The same with the number that the user knows the point by.
fn in_users_order(case: &Case, error: MotionError) -> MotionError {
    let number = |point: usize| case.body.user_index()[point] as usize;
    match error {
        MotionError::FlownOff(mut found) => {
            found.point = number(found.point);
            MotionError::FlownOff(found)
        }
        MotionError::Singular { t, step, families } => {
            MotionError::Singular { t, step, families: case.numbered(&families) }
        }
        MotionError::Mass { point, mass } => MotionError::Mass { point: number(point), mass },
        other => other,
    }
}
