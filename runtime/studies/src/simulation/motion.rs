//! A body in motion: integration in time, and everything it leaves in the output folder.

use std::ops::ControlFlow;

use piola_mechanics::energy::{Energy, Total};
use piola_mechanics::interaction::Inverted;
use piola_mechanics::words::Words;
use piola_output::motion::{MotionColumns, MotionEnergies, MotionRow, MotionSummary, MotionTables};
use piola_output::pvd::FrameSeries;
use piola_output::summary::{ExitReason, Number, PhaseClock};
use piola_output::{Frame, OutputError, OutputFile, OutputFolder, Points, table};
use piola_solvers::Watch;
use piola_solvers::march::{March, State, march};
use piola_solvers::motion::{self, MotionError, MotionSettings, Row};

use super::run::{Ending, RunError, RunOptions, enter, frame, sum_over, summary};
use crate::case::{Case, CaseError};
use crate::scene::Motion;
use crate::scene::boundary::BoundaryConditions;
use crate::scene::drive::{MotionConditions, initial};
use crate::scene::selection::Selection;

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

/// Refuses a body that moves where equilibria are asked for.
pub(super) fn refuse(case: &Case) -> Result<(), CaseError> {
    match case.scene.motion {
        None => Ok(()),
        Some(_) => Err(CaseError::Body {
            message:
                "this looks at equilibria, and the scene has [motion]: write [steps] in its place"
                    .to_string(),
        }),
    }
}

/// How a motion is integrated.
pub(super) fn settings(case: &Case, scene: &Motion) -> MotionSettings {
    let output = &case.scene.output;
    MotionSettings {
        method: scene.method,
        end: scene.end,
        step: scene.step,
        safety: scene.safety,
        damping: scene.damping,
        unstable: scene.unstable,
        // Frames are rows, too.
        rows: output.rows.max(frames(case, scene).ceil() as usize),
    }
}

/// How many frames lead to the end.
fn frames(case: &Case, scene: &Motion) -> f64 {
    let output = &case.scene.output;
    output.every.map_or(output.frames as f64, |every| scene.end / every)
}

/// Runs a case that moves and fills the folder.
pub(super) fn run(
    case: &Case,
    scene: &Motion,
    folder: &OutputFolder,
    options: RunOptions<'_>,
    watch: &Watch,
) -> Result<Ending, RunError> {
    case.check_rest()?;
    let mut clock = PhaseClock::new();
    enter(&mut clock, watch, "compile");
    let compiled = case.compile()?;
    enter(&mut clock, watch, "interactions");
    let (energy, fields) = case.solved_energy(compiled)?;
    fields.must_be_steady()?;
    let selection = case.selection()?;
    let boundary =
        BoundaryConditions::new(&case.scene, &case.body, &selection).map_err(CaseError::from)?;
    let masses = case.masses().ok_or_else(|| no_density(case))?;
    let drive = MotionConditions::new(&boundary, &masses).map_err(CaseError::from)?;
    let start = initial(&boundary).map_err(CaseError::from)?;
    enter(&mut clock, watch, "critical step");
    let settings = settings(case, scene);
    let mut motion = motion::Motion::new(&energy, &masses, start, &drive, &settings, watch)
        .map_err(|error| refused(case, &drive, error))?;

    // From here on there is something to keep.
    let resolved = case.scene.resolved_toml();
    folder.write(OutputFile::ResolvedScene, resolved.as_bytes())?;
    enter(&mut clock, watch, "move");
    let points = Points::of(&case.body);
    let mut recorder = Recorder::new(case, &energy, &selection, folder, &points)?;
    let first = motion.advance_to(0);
    let result = first.and_then(|first| {
        if let piola_solvers::march::Advance::Step(row) = first
            && recorder.record(&row, &motion.state()).is_break()
        {
            return Ok(ControlFlow::Break(()));
        }
        march(&mut motion, &mut |row, state| recorder.record(row, state))
    });
    if let Some(error) = recorder.failed.take() {
        return Err(error.into());
    }
    enter(&mut clock, watch, "output");
    let (reason, message) = match result {
        Ok(ControlFlow::Continue(())) => (ExitReason::Completed, String::new()),
        Ok(ControlFlow::Break(())) => {
            let message = format!("interrupted; the motion has come to t = {:e} s", recorder.t());
            (ExitReason::Interrupted, message)
        }
        Err(error) => {
            let (reason, message) = stopped(case, &drive, error);
            (reason, format!("{message}; the last row is that of t = {:e} s", recorder.t()))
        }
    };
    let mut warnings: Vec<String> = motion.notes().to_vec();
    if scene.unstable && motion.step() > motion.least_critical() {
        warnings.push(format!(
            "the step {:e} s is beyond the critical one, {:.6e} s: the motion is unstable",
            motion.step(),
            motion.least_critical()
        ));
    }
    let ending = Ending {
        reason,
        message,
        done: format!("{} steps of {:.6e} s", recorder.steps(), motion.step()),
        steps: recorder.steps(),
        indefinite: 0,
        fails: false,
        inverted: recorder.inverted(&energy),
        warnings,
    };
    let told = recorder.summary(&motion, &masses, scene);
    recorder.finish()?;
    let summary = summary(case, &energy, &ending, options.warnings, &resolved, &mut clock);
    piola_output::summary::Summary { motion: told, ..summary }.write(folder)?;
    Ok(ending)
}

/// A scene that was changed after it was read: the reader wants a density of every material.
fn no_density(case: &Case) -> CaseError {
    let name = case.potentials.first().map_or("", |potential| potential.model.name());
    CaseError::Body {
        message: format!("a body that moves needs the density of its material ({name})"),
    }
}

/// Why a motion cannot start, in the scene's words.
fn refused(case: &Case, drive: &MotionConditions<'_>, error: MotionError) -> CaseError {
    let message = match error {
        MotionError::Drive { .. } => match drive.problem() {
            Some(problem) => return problem.into(),
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
fn stopped(case: &Case, drive: &MotionConditions<'_>, error: MotionError) -> (ExitReason, String) {
    match &error {
        MotionError::Drive { .. } => {
            let message = drive.problem().map_or_else(|| error.to_string(), |p| p.to_string());
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
        MotionError::Mass { point, mass } => MotionError::Mass { point: number(point), mass },
        other => other,
    }
}

/// Writes what the rows bring.
struct Recorder<'a> {
    case: &'a Case,
    selection: &'a Selection,
    folder: &'a OutputFolder,
    points: &'a Points,
    frames: FrameSeries<'a>,
    tables: MotionTables,
    last: Option<(Row, Frame)>,
    /// When the last frame was written.
    framed: Option<f64>,
    /// The largest part of the account that did not close, over the largest energy.
    rounding: f64,
    largest: f64,
    failed: Option<OutputError>,
}

impl<'a> Recorder<'a> {
    fn new(
        case: &'a Case,
        energy: &Total<'_>,
        selection: &'a Selection,
        folder: &'a OutputFolder,
        points: &'a Points,
    ) -> Result<Recorder<'a>, OutputError> {
        let columns = MotionColumns {
            dimension: case.body.dimension(),
            parts: energy.parts().to_vec(),
            sets: selection.sets.iter().map(|set| set.name.clone()).collect(),
            probes: selection.probes.iter().map(|probe| probe.name.clone()).collect(),
        };
        Ok(Recorder {
            case,
            selection,
            folder,
            points,
            frames: FrameSeries::new(folder, points)?,
            tables: MotionTables::new(folder, &columns)?,
            last: None,
            framed: None,
            rounding: 0.0,
            largest: 0.0,
            failed: None,
        })
    }

    fn t(&self) -> f64 {
        self.last.as_ref().map_or(0.0, |(row, _)| row.t)
    }

    fn steps(&self) -> usize {
        self.last.as_ref().map_or(0, |(row, _)| row.step)
    }

    fn record(&mut self, row: &Row, state: &State<'_>) -> ControlFlow<()> {
        let (body, d) = (&self.case.body, self.case.body.dimension());
        let residual: Vec<f64> =
            state.internal_forces.iter().zip(state.loads).map(|(g, f)| g - f).collect();
        let written = MotionRow {
            step: row.step,
            t: row.t,
            kinetic: row.kinetic,
            kinetic_leapfrog: row.kinetic_leapfrog,
            parts: row.energy.iter().map(|(_, value)| value).collect(),
            damping: row.damping,
            external: row.external,
            prescribed: row.prescribed,
            quadrature: row.quadrature,
            rounding: row.rounding,
            momentum: row.momentum.clone(),
            angular_momentum: row.angular_momentum.clone(),
            reactions: self
                .selection
                .sets
                .iter()
                .map(|set| sum_over(&set.points, &residual, d))
                .collect(),
            probes: self
                .selection
                .probes
                .iter()
                .map(|probe| state.displacements[d * probe.point..d * (probe.point + 1)].to_vec())
                .collect(),
        };
        let energies = [row.kinetic, row.external, row.prescribed, row.damping];
        let largest = energies.iter().fold(row.energy.magnitude(), |most, x| most.max(x.abs()));
        self.largest = self.largest.max(largest);
        self.rounding = self.rounding.max(row.rounding.abs());
        let is_due = self.is_due(row.t);
        let mut now = frame(self.case, row.t, state.displacements, &residual);
        now.velocity = body.to_user_order(state.velocities, d);
        let done = self.tables.push(&written).and_then(|()| match is_due {
            true => self.frames.push(&now),
            false => Ok(()),
        });
        if is_due {
            self.framed = Some(row.t);
        }
        self.last = Some((row.clone(), now));
        match done {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                self.failed = Some(error);
                ControlFlow::Break(())
            }
        }
    }

    /// Frames are written at the first rows at or behind times that divide the way evenly.
    fn is_due(&self, t: f64) -> bool {
        let Some(motion) = &self.case.scene.motion else { return false };
        let frames = frames(self.case, motion);
        // The last row meets the end exactly, the others up to rounding.
        let reached = (t / motion.end * frames * (1.0 + 1e-12)).floor() as usize;
        reached >= self.frames.n_frames()
    }

    fn summary(
        &self,
        motion: &motion::Motion<'_>,
        masses: &[f64],
        scene: &Motion,
    ) -> Option<MotionSummary> {
        let (row, _) = self.last.as_ref()?;
        let finite = |x: f64| x.is_finite().then_some(Number(x));
        Some(MotionSummary {
            method: scene.method.word().to_string(),
            step_seconds: Number(motion.step()),
            critical_step_seconds: motion.critical().map(|found| Number(found.seconds)),
            least_critical_step_seconds: finite(motion.least_critical()),
            steps: motion.n_steps(),
            steps_made: row.step,
            t: Number(row.t),
            mass: Number(masses.iter().fold(0.0, |sum, mass| sum + mass)),
            energies: MotionEnergies {
                kinetic: Number(row.kinetic),
                stored: Number(row.energy.total()),
                damping: Number(row.damping),
                external: Number(row.external),
                prescribed: Number(row.prescribed),
                quadrature: Number(row.quadrature),
            },
            rounding: Number(if self.largest > 0.0 { self.rounding / self.largest } else { 0.0 }),
        })
    }

    /// What is turned inside out at the last row.
    fn inverted(&self, energy: &Total<'_>) -> Inverted {
        let Some((_, last)) = &self.last else { return Inverted::default() };
        let body = &self.case.body;
        energy.inverted(&body.from_user_order(&last.displacement, body.dimension()))
    }

    /// The frame of the last row, which may not be due, and the displacements at the end.
    fn finish(mut self) -> Result<(), OutputError> {
        match &self.last {
            Some((row, last)) => {
                if self.framed.is_none_or(|t| t < row.t) {
                    self.frames.push(last)?;
                }
                table::write_displacement(self.folder, self.points, &last.displacement)
            }
            None => Ok(()),
        }
    }
}
