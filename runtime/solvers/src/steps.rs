//! Load steps: the march of `t` from 0 to the end, one equilibrium after another.
//!
//! Nominal times divide the way evenly and are reached exactly. Where Newton's method fails the
//! increment is halved, down to 1/1024 of the nominal one, and it doubles again after two easy
//! steps. Times within an increment are counted in its 1024ths, so no rounding accumulates.

mod arc_length;
mod breaking;
mod events;
mod loose;
mod memory;
mod outcome;
mod start;

use std::ops::ControlFlow;

use piola_mechanics::energy::Energy;
use piola_mechanics::words::Words;

use super::clock::PhaseTimes;
use super::constraint::Constraints;
use super::increment::{Increment, TICKS};
use super::linear::{Definiteness, LinearError, LinearMethod, LinearOptions, LinearReport};
use super::march::{Advance, March, State, march};
use super::newton::{Newton, NewtonError, NewtonFailure, NewtonReport, NewtonSettings};
use super::singular::Watched;
use super::watch::{Event, Watch};
use breaking::Fracturing;
pub use breaking::{Account, BreakSettings, Breaking, Broken, Control, Loose};
pub use outcome::{LinearSummary, NotConverged, Outcome, StepError, StepRecord};
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
    /// How bonds break.
    pub breaking: BreakSettings,
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
            breaking: BreakSettings::default(),
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
        (
            settings.breaking.tie >= 0.0 && settings.breaking.tie < 1.0,
            "tie",
            "not less than 0, and less than 1",
            settings.breaking.tie,
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
    energy: &'a dyn Energy,
    newton: Newton<'a>,
    watch: Watch,
    dimension: usize,
    /// What is prescribed, and what of loose parts is held.
    constraints: Constraints,
    /// What breaks, where something can.
    fracture: Option<Fracturing<'a>>,
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
    /// Of steps by the length of the way: what they go by, once something has moved.
    way: Option<arc_length::Way>,
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
        if energy.fracture().is_some_and(|status| status.n_states() > 0) {
            newton.without_potential();
        }
        let families = Watched::new(energy, settings.breaking.singular);
        let fracture = energy.fracture().map(|status| Fracturing::new(status, families, n_dofs));
        let mut steps = LoadSteps {
            energy,
            newton,
            watch: watch.clone(),
            dimension: energy.dimension(),
            constraints,
            fracture,
            drive,
            settings: *settings,
            t: 0.0,
            u: vec![0.0; n_dofs],
            loads: vec![0.0; n_dofs],
            before: None,
            nominal: 0,
            position: 0,
            increment: Increment::nominal(),
            way: None,
            records: Vec::new(),
            cut_backs: 0,
            all_cut_backs: 0,
            times: PhaseTimes::default(),
        };
        // Cracks that are there from the start may have cut something off.
        let nothing = vec![0.0; n_dofs];
        match steps.hold_loose(&nothing, &nothing)? {
            Some(parts) => Err(StepError::Loose { t: 0.0, parts }),
            None => Ok(steps),
        }
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

    /// How many nominal times there are up to `t`: those that it passes again after it fell are not new.
    fn passed(&self, t: f64) -> usize {
        (1..=self.settings.increments).filter(|number| self.nominal_time(*number) <= t).count()
    }

    /// A shorter step after one of so many ticks to `t` has failed.
    ///
    /// # Errors
    /// No step, where a shorter one does not help.
    fn cut_back(&mut self, t: f64, cause: NewtonError, tried: u32) -> Result<(), StepError> {
        if !smaller_may_help(&cause.failure) || !self.increment.halve(tried) {
            return Err(self.not_converged(t, cause));
        }
        self.watch.notice(Event::CutBack { t, cause: &cause });
        self.cut_backs += 1;
        self.all_cut_backs += 1;
        Ok(())
    }

    /// One equilibrium at `t`; the state changes only if it is found.
    fn attempt(&mut self, t: f64, nominal: bool) -> Result<Attempt, StepError> {
        self.watch.notice(Event::Attempt(t));
        if self.drive.begin(t).map_err(|NotGiven| StepError::Given { t })? {
            self.newton.forget();
        }
        let loads = self.loads(t)?;
        let last = self.last(t)?;
        let found = self.settled(last, &loads, t)?;
        self.times.add(&self.newton.take_times());
        match found {
            Ok(found) => self.take(found, loads, t, nominal),
            Err(cause) => Ok(Attempt::Failed(cause)),
        }
    }

    /// Makes an equilibrium the present state.
    fn take(
        &mut self,
        found: Found,
        loads: Vec<f64>,
        t: f64,
        nominal: bool,
    ) -> Result<Attempt, StepError> {
        let Found { u, start, report, judged } = found;
        let record = self.record(t, nominal, start, report, judged);
        let old = std::mem::replace(&mut self.u, u);
        // No line leads through equilibria of bodies that are not the same.
        let is_same = record.broken.as_ref().is_none_or(|broken| broken.rounds == 0);
        self.before = is_same.then_some((self.t, old));
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
        Ok(Found { u, start: None, report, judged: breaking::not_judged("relaxation") })
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
        let (broken, mut notes) = self.take_broken();
        notes.extend(report.notes);
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
            broken,
            notes,
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
        self.with_prescribed(&self.u, t)
    }

    /// Displacements with what is prescribed at `t`.
    fn with_prescribed(&self, u: &[f64], t: f64) -> Result<Vec<f64>, StepError> {
        let fixed = self.drive.fixed();
        let mut values = vec![0.0; fixed.len()];
        self.drive.prescribed(t, &mut values);
        if let Some(k) = values.iter().position(|x| !x.is_finite()) {
            return Err(self.drive_error("prescribed displacement", fixed[k], values[k], t));
        }
        let mut u = u.to_vec();
        fixed.iter().zip(&values).for_each(|(dof, value)| u[*dof] = *value);
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
        match self.settings.breaking.control {
            Control::Event if self.fracture.is_some() => return self.advance_by_events(),
            Control::ArcLength => return self.advance_along(),
            Control::Event | Control::Load => {}
        }
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
                Attempt::Failed(cause) => self.cut_back(t, cause, end - self.position)?,
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

/// Rounding and memory do not improve with smaller increments, and an end that is wanted is one: what comes
/// loose, or leaves families too small, ends a run, and is not sought more closely.
fn smaller_may_help(failure: &NewtonFailure) -> bool {
    !matches!(
        failure,
        NewtonFailure::RoundingFloor { .. }
            | NewtonFailure::Interrupted
            | NewtonFailure::Loose { .. }
            | NewtonFailure::Singular { .. }
            | NewtonFailure::Linear(LinearError::TooLarge { .. } | LinearError::OutOfMemory)
    )
}

#[cfg(test)]
#[path = "steps_tests.rs"]
mod tests;
