//! Load steps: the march of `t` from 0 to the end, one equilibrium after another.
//!
//! Nominal times divide the way evenly and are reached exactly. Where Newton's method fails the
//! increment is halved, down to 1/1024 of the nominal one, and it doubles again after two easy
//! steps. Times within an increment are counted in its 1024ths, so no rounding accumulates.

mod start;

use std::ops::ControlFlow;

use piola_mechanics::energy::{Energy, EnergyParts};
use piola_mechanics::words::Words;

use super::clock::{Counters, PhaseTimes};
use super::constraint::{ConstraintError, Constraints};
use super::increment::{Increment, TICKS};
use super::linear::{Definiteness, LinearError, LinearMethod, LinearOptions, LinearReport};
use super::march::{Advance, March, State, march};
use super::newton::{Newton, NewtonError, NewtonFailure, NewtonReport, NewtonSettings};
use super::watch::{Event, Watch};
pub use start::Start;

/// What drives the body: prescribed values and loads as functions of `t`.
pub trait Drive: Sync {
    /// The fixed degrees of freedom, ascending; the same for all `t`.
    fn fixed(&self) -> &[usize];

    /// Gives the energy what it takes of `t`, as parameters that change in time; whether it is another one
    /// from then on.
    ///
    /// # Errors
    /// Nothing that the energy could be given.
    fn begin(&self, _t: f64) -> Result<bool, NotGiven> {
        Ok(false)
    }

    /// Fills in the displacements of the fixed degrees of freedom at `t`, in m.
    fn prescribed(&self, t: f64, values: &mut [f64]);

    /// Fills in the loads (`n x d`) at `t`, in N.
    fn loads(&self, t: f64, loads: &mut [f64]);
}

/// What an energy takes of a time cannot be had: the drive knows why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotGiven;

/// Choices for a run of load steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSettings {
    /// The last `t`; positive.
    pub end: f64,
    /// How many nominal increments lead there; at least 1.
    pub increments: usize,
    /// How an equilibrium is found.
    pub find: Find,
    /// Where Newton's method starts.
    pub start: Start,
    /// Newton's method.
    pub newton: NewtonSettings,
    /// Linear systems.
    pub linear: LinearOptions,
}

impl Default for StepSettings {
    fn default() -> Self {
        StepSettings {
            end: 1.0,
            increments: 1,
            find: Find::default(),
            start: Start::default(),
            newton: NewtonSettings::default(),
            linear: LinearOptions::default(),
        }
    }
}

/// How an equilibrium is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Find {
    /// By Newton's method.
    #[default]
    Newton,
    /// By dynamic relaxation, in at most [`RELAXATION_STEPS`] times as many steps as there may be
    /// iterations; its tangent is not judged.
    Relaxation,
}

impl Words for Find {
    const WORDS: &'static [(&'static str, Find)] =
        &[("newton", Find::Newton), ("relaxation", Find::Relaxation)];
}

/// Steps of a relaxation in the place of an iteration of Newton's method.
pub const RELAXATION_STEPS: usize = 2000;

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

/// Follows the drive from rest at `t = 0` to the end; `observer` sees each converged step and may
/// end the run, `watch` sees what goes on within steps and may end it there.
///
/// # Errors
/// As [`LoadSteps::new`] and [`LoadSteps::advance`].
pub fn run_steps(
    energy: &dyn Energy,
    drive: &dyn Drive,
    settings: &StepSettings,
    watch: &Watch,
    observer: &mut dyn FnMut(&StepRecord, &State<'_>) -> ControlFlow<()>,
) -> Result<Outcome, StepError> {
    let mut steps = LoadSteps::new(energy, drive, settings, watch)?;
    let see = &mut |step: &_, steps: &LoadSteps<'_>| observer(step, &steps.state());
    let stopped = march(&mut steps, see)?.is_break();
    Ok(steps.outcome(stopped))
}

fn check(settings: &StepSettings) -> Result<(), StepError> {
    let requirements = [
        (settings.end.is_finite() && settings.end > 0.0, "end", "positive", settings.end),
        (settings.increments > 0, "increments", "at least 1", settings.increments as f64),
        (
            settings.newton.tolerance > 0.0 && settings.newton.tolerance < 1.0,
            "tolerance",
            "between 0 and 1",
            settings.newton.tolerance,
        ),
    ];
    for (holds, what, must, value) in requirements {
        if !holds {
            return Err(StepError::Settings { what, must, value });
        }
    }
    Ok(())
}

/// Load steps by Newton's method: the march from rest through equilibria.
pub struct LoadSteps<'a> {
    newton: Newton<'a>,
    watch: Watch,
    dimension: usize,
    constraints: Constraints,
    drive: &'a dyn Drive,
    settings: StepSettings,
    /// The last converged state.
    t: f64,
    u: Vec<f64>,
    loads: Vec<f64>,
    /// The converged state before the last.
    before: Option<(f64, Vec<f64>)>,
    /// The nominal increment at work, how far it is, in ticks, and how far the next attempt goes.
    nominal: usize,
    position: u32,
    increment: Increment,
    records: Vec<StepRecord>,
    /// Since the last converged step, and in all.
    cut_backs: usize,
    all_cut_backs: usize,
    times: PhaseTimes,
}

impl<'a> LoadSteps<'a> {
    /// At rest; `watch` sees what goes on within steps and may end them.
    ///
    /// # Errors
    /// Settings and degrees of freedom that cannot be used, a solver that cannot start.
    pub fn new(
        energy: &'a dyn Energy,
        drive: &'a dyn Drive,
        settings: &StepSettings,
        watch: &Watch,
    ) -> Result<LoadSteps<'a>, StepError> {
        check(settings)?;
        let n_dofs = energy.positions().len();
        let constraints = Constraints::new(n_dofs, drive.fixed())?;
        let mut linear = settings.linear;
        if settings.find == Find::Relaxation {
            // Nothing is solved, so nothing is stored.
            linear.method = LinearMethod::MatrixFree;
        }
        let mut newton = Newton::new(energy, &constraints, settings.newton, linear)?;
        newton.watched(watch);
        Ok(LoadSteps {
            newton,
            watch: watch.clone(),
            dimension: energy.dimension(),
            constraints,
            drive,
            settings: *settings,
            t: 0.0,
            u: vec![0.0; n_dofs],
            loads: vec![0.0; n_dofs],
            before: None,
            nominal: 0,
            position: 0,
            increment: Increment::nominal(),
            records: Vec::new(),
            cut_backs: 0,
            all_cut_backs: 0,
            times: PhaseTimes::default(),
        })
    }

    /// Where the next attempt ends: in ticks of the nominal increment, and its time.
    fn target(&self) -> (u32, f64) {
        let end = self.position + self.increment.ticks.min(TICKS - self.position);
        let (from, to) = (self.nominal_time(self.nominal), self.nominal_time(self.nominal + 1));
        let inside = || from + (to - from) * (f64::from(end) / f64::from(TICKS));
        (end, if end == TICKS { to } else { inside() })
    }

    fn nominal_time(&self, number: usize) -> f64 {
        if number == self.settings.increments {
            return self.settings.end;
        }
        self.settings.end * (number as f64 / self.settings.increments as f64)
    }

    /// One equilibrium at `t`; the state changes only if it is found.
    fn attempt(&mut self, t: f64, nominal: bool) -> Result<Attempt, StepError> {
        self.watch.notice(Event::Attempt(t));
        if self.drive.begin(t).map_err(|NotGiven| StepError::Given { t })? {
            self.newton.forget();
        }
        let loads = self.loads(t)?;
        let last = self.last(t)?;
        let found = self.search(last, &loads, t);
        self.times.add(&self.newton.take_times());
        let Found { u, start, report, judged } = match found {
            Ok(found) => found,
            Err(cause) => return Ok(Attempt::Failed(cause)),
        };
        let record = self.record(t, nominal, start, report, judged);
        self.before = Some((self.t, std::mem::replace(&mut self.u, u)));
        (self.t, self.loads) = (t, loads);
        self.watch.notice(Event::Step(&record));
        self.records.push(record.clone());
        Ok(Attempt::Converged(Box::new(record)))
    }

    /// The equilibrium at `t`: from a good guess by full steps, else from the last state. Where a
    /// guess leads astray the way bends, and the last state is closer.
    fn search(&mut self, last: Vec<f64>, loads: &[f64], t: f64) -> Result<Found, NewtonError> {
        if self.settings.find == Find::Relaxation {
            return self.relax(last, loads, t);
        }
        if let Some((u, start)) = self.guess(&last, loads, t) {
            match self.equilibrium(u, loads, Newton::solve_by_full_steps) {
                Ok(found) => return Ok(Found { start, ..found }),
                Err(cause) if !smaller_may_help(&cause.failure) => return Err(cause),
                Err(_) => {}
            }
        }
        self.equilibrium(last, loads, Newton::solve)
    }

    /// The equilibrium at `t` by relaxation, from the line through the last two where that leads, else
    /// from the last state.
    fn relax(&mut self, last: Vec<f64>, loads: &[f64], t: f64) -> Result<Found, NewtonError> {
        let start = self.by_line(&last, t).filter(|u| self.newton.check_jump(&self.u, u).is_ok());
        let mut u = start.unwrap_or(last);
        self.watch.notice(Event::Start);
        self.newton.check_jump(&self.u, &u)?;
        let most = RELAXATION_STEPS * self.settings.newton.max_iterations;
        let report = self.newton.relax(&mut u, loads, most)?;
        let method = "relaxation: not judged".to_owned();
        let definiteness = Definiteness { positive_definite: None, negative_pivots: None, method };
        Ok(Found { u, start: None, report, judged: (definiteness, None) })
    }

    /// The equilibrium with these loads from some displacements, and the judgement of its tangent.
    fn equilibrium(
        &mut self,
        mut u: Vec<f64>,
        loads: &[f64],
        solve: impl Fn(&mut Newton<'a>, &mut [f64], &[f64]) -> Result<NewtonReport, NewtonError>,
    ) -> Result<Found, NewtonError> {
        self.watch.notice(Event::Start);
        self.newton.check_jump(&self.u, &u)?;
        let report = solve(&mut self.newton, &mut u, loads)?;
        match self.judge() {
            Ok(judged) => Ok(Found { u, start: None, report, judged }),
            Err(failure) => Err(NewtonError { failure, history: report.history }),
        }
    }

    /// Definiteness and condition of the tangent at the equilibrium found.
    fn judge(&mut self) -> Result<Judged, NewtonFailure> {
        Ok((self.newton.judge()?, self.newton.condition()?))
    }

    fn record(
        &mut self,
        t: f64,
        nominal: bool,
        start: Option<LinearReport>,
        report: NewtonReport,
        (definiteness, condition): Judged,
    ) -> StepRecord {
        StepRecord {
            t,
            nominal,
            iterations: report.iterations,
            residual: report.history.residual,
            residual_over_reaction: report.history.residual_over_reaction,
            energy_parts: report.energy,
            definiteness,
            condition,
            rounding_floor: report.rounding_floor,
            start,
            linear: report.linear,
            step_lengths: report.step_lengths,
            cut_backs: std::mem::take(&mut self.cut_backs),
            notes: report.notes,
            times: std::mem::take(&mut self.times),
        }
    }

    fn loads(&self, t: f64) -> Result<Vec<f64>, StepError> {
        let mut loads = vec![0.0; self.u.len()];
        self.drive.loads(t, &mut loads);
        match loads.iter().position(|x| !x.is_finite()) {
            Some(dof) => Err(self.drive_error("load", dof, loads[dof], t)),
            None => Ok(loads),
        }
    }

    /// The last state with the fixed displacements of `t`.
    fn last(&self, t: f64) -> Result<Vec<f64>, StepError> {
        let fixed = self.constraints.fixed();
        let mut values = vec![0.0; fixed.len()];
        self.drive.prescribed(t, &mut values);
        if let Some(k) = values.iter().position(|x| !x.is_finite()) {
            return Err(self.drive_error("prescribed displacement", fixed[k], values[k], t));
        }
        let mut u = self.u.clone();
        self.constraints.scatter_fixed(&values, &mut u);
        Ok(u)
    }

    fn drive_error(&self, what: &'static str, dof: usize, value: f64, t: f64) -> StepError {
        let (point, component) = (dof / self.dimension, dof % self.dimension);
        StepError::Drive { what, point, component, value, t }
    }

    /// Hands the run over; nothing is left to follow.
    fn outcome(&mut self, stopped: bool) -> Outcome {
        let linear = self.newton.linear();
        let systems =
            self.records.iter().flat_map(|record| record.start.iter().chain(&record.linear));
        Outcome {
            linear: LinearSummary {
                method: linear.method(),
                reason: linear.choice().reason.clone(),
                stores_matrix: linear.stores_matrix(),
                preconditioner: linear.preconditioner(),
                iterations: systems.map(|system| system.iterations).sum(),
            },
            records: std::mem::take(&mut self.records),
            displacements: std::mem::take(&mut self.u),
            counters: self.newton.counters(),
            stopped,
        }
    }

    fn not_converged(&mut self, t_failed: f64, cause: NewtonError) -> StepError {
        StepError::NotConverged(Box::new(NotConverged {
            t_converged: self.t,
            t_failed,
            cut_backs: self.all_cut_backs,
            cause,
            outcome: self.outcome(true),
        }))
    }
}

/// Definiteness and condition of a tangent.
type Judged = (Definiteness, Option<f64>);

/// An equilibrium.
struct Found {
    /// Displacements, `n x d` in m.
    u: Vec<f64>,
    /// The linear system that led to the start.
    start: Option<LinearReport>,
    /// How Newton's method went on from there.
    report: NewtonReport,
    judged: Judged,
}

enum Attempt {
    Converged(Box<StepRecord>),
    Failed(NewtonError),
}

impl March for LoadSteps<'_> {
    type Step = StepRecord;
    type Stop = StepError;

    fn advance(&mut self) -> Result<Advance<StepRecord>, StepError> {
        while self.nominal < self.settings.increments {
            if self.watch.wants_end() {
                return Ok(Advance::Interrupted);
            }
            let (end, t) = self.target();
            match self.attempt(t, end == TICKS)? {
                Attempt::Converged(record) => {
                    self.increment.note_success(record.iterations);
                    let is_nominal = end == TICKS;
                    self.nominal += usize::from(is_nominal);
                    self.position = if is_nominal { 0 } else { end };
                    return Ok(Advance::Step(*record));
                }
                Attempt::Failed(cause) if cause.failure == NewtonFailure::Interrupted => {
                    return Ok(Advance::Interrupted);
                }
                Attempt::Failed(cause) => {
                    let tried = end - self.position;
                    if !smaller_may_help(&cause.failure) || !self.increment.halve(tried) {
                        return Err(self.not_converged(t, cause));
                    }
                    self.watch.notice(Event::CutBack { t, cause: &cause });
                    self.cut_backs += 1;
                    self.all_cut_backs += 1;
                }
            }
        }
        Ok(Advance::End)
    }

    fn state(&self) -> State<'_> {
        State {
            t: self.t,
            displacements: &self.u,
            velocities: &[],
            internal_forces: self.newton.internal_forces(),
            loads: &self.loads,
        }
    }
}

/// Rounding and memory do not improve with smaller increments, and an end that is wanted is one.
fn smaller_may_help(failure: &NewtonFailure) -> bool {
    !matches!(
        failure,
        NewtonFailure::RoundingFloor { .. }
            | NewtonFailure::Interrupted
            | NewtonFailure::Linear(LinearError::TooLarge { .. } | LinearError::OutOfMemory)
    )
}

#[cfg(test)]
#[path = "steps_tests.rs"]
mod tests;
