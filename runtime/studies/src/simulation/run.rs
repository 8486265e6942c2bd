//! A whole run: load steps, and everything they leave in the output folder.

mod advice;
pub(super) mod frames;
mod told;

use std::ops::ControlFlow;
use std::sync::Mutex;

use piola_grammar::counted;
use piola_mechanics::energy::{Energy, Total};
use piola_mechanics::interaction::Inverted;
use piola_mechanics::matrix::BlockPattern;
use piola_output::fracture::FractureTable;
use piola_output::picture::{Charts, Picture};
use piola_output::pvd::FrameSeries;
use piola_output::summary::{ExitReason, PhaseClock, step_summaries};
use piola_output::{
    Definiteness, Frame, History, OutputError, OutputFile, OutputFolder, Points, SetsAtRest, table,
};
use piola_solvers::constraint::Constraints;
use piola_solvers::linear::{self, BLOCK_JACOBI, LinearOptions, PreconditionerChoice};
use piola_solvers::march::State;
use piola_solvers::newton::{NewtonFailure, NewtonSettings, NewtonVariant};
use piola_solvers::rigid_modes::check_rigid_motions;
use piola_solvers::steps::{
    self, BreakSettings, Drive, Find, NotConverged, NotGiven, StepError, StepRecord, StepSettings,
    run_steps,
};
use piola_solvers::{Event, Watch};

use crate::case::{Case, CaseError, FieldsInTime, WrongField, explain};
use crate::plan::available_memory;
use crate::scene::boundary::{BoundaryConditions, NonFiniteCondition};
use crate::scene::selection::Selection;
use crate::scene::{Scene, Unstable};

use super::point_fields::PointFields;
use super::tracks::Tracks;
use super::{breaking, motion};
use told::solver_summary;
pub(super) use told::{hash, summary};

/// What a run is told beside the scene.
#[derive(Clone, Debug, Default)]
pub struct RunOptions<'a> {
    /// In the headline of the picture.
    pub title: &'a str,
    /// What the user was warned of, for the summary.
    pub warnings: Vec<String>,
    /// Where the scene comes from, for who takes up the run again.
    pub origin: Origin<'a>,
    /// Whether a motion goes on from the checkpoint in its folder.
    pub resumes: bool,
}

/// What a scene was read from.
#[derive(Clone, Copy, Debug, Default)]
pub struct Origin<'a> {
    /// The path of its file; empty where there is none.
    pub scene: &'a str,
    /// What was overridden, `KEY=VALUE`.
    pub settings: &'a [String],
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Ending {
    /// Why it ended.
    pub reason: ExitReason,
    /// The reason in words; empty if all went well.
    pub message: String,
    /// What may be done about it.
    pub helps: Vec<String>,
    /// What was done, in words: how many steps of which kind.
    pub done: String,
    /// Converged steps, or steps in time.
    pub steps: usize,
    /// How many of them are not stable equilibria.
    pub indefinite: usize,
    /// Whether the last of them is not, and the scene does not accept that.
    pub fails: bool,
    /// Interactions turned inside out at the last of them.
    pub inverted: Inverted,
    /// What the user was warned of during the run; the summary has it, too.
    pub warnings: Vec<String>,
}

/// Why a run could not start or could not write.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RunError {
    /// The scene.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// The output.
    #[error("{0}")]
    Output(String),
}

impl From<OutputError> for RunError {
    fn from(error: OutputError) -> Self {
        let help = error.help().map(|help| format!("; {help}")).unwrap_or_default();
        RunError::Output(format!("{error}{help}"))
    }
}

/// Runs a case and fills the folder; `watch` sees what goes on and may end the run.
///
/// # Errors
/// A case that cannot start, a file that cannot be written. A solver that does not converge is no
/// error, nor is one that was interrupted: what converged is written and the ending says so.
pub fn run(
    case: &Case,
    folder: &OutputFolder,
    options: RunOptions<'_>,
    watch: &Watch,
) -> Result<Ending, RunError> {
    if let Some(scene) = &case.scene.motion {
        return motion::run(case, scene, folder, options, watch);
    }
    if options.resumes {
        let path = folder.path().to_owned();
        return Err(OutputError::NoCheckpoint { path }.into());
    }
    case.check_rest()?;
    let mut clock = PhaseClock::new();
    enter(&mut clock, watch, "compile");
    let compiled = case.compile()?;
    enter(&mut clock, watch, "interactions");
    let (energy, fields) = case.solved_energy(compiled)?;
    let selection = case.selection()?;
    let boundary =
        BoundaryConditions::new(&case.scene, &case.body, &selection).map_err(CaseError::from)?;
    check_held(case, energy.bonds(), &boundary)?;

    // From here on there is something to keep.
    let resolved = case.scene.resolved_toml();
    folder.write(OutputFile::ResolvedScene, resolved.as_bytes())?;
    enter(&mut clock, watch, "solve");
    let drive = SceneDrive::new(&boundary, &fields);
    let points = Points::of(&case.body)
        .with_mesh(case.mesh.clone())
        .with_held(&case.body, boundary.fixed_dofs());
    let fields = PointFields { case, energy: &energy, selection: &selection, masses: None };
    let at_rest = AtRest::of(&energy, &drive, points.positions.len());
    let mut recorder = Recorder::new(fields, folder, &points, clock, at_rest)?;
    let result = run_steps(&energy, &drive, &settings(&case.scene), watch, &mut |record, state| {
        recorder.record(record, state)
    });
    watch.notice(Event::Phase("output"));
    recorder.return_to_last(&drive);
    if let Some(error) = recorder.failed.take() {
        return Err(error.into());
    }
    let (mut ending, outcome) =
        ending(case, result, &drive, &recorder.history, &recorder.warnings)?;
    ending.warnings.extend(idle_choices(&case.scene, &outcome));
    ending.warnings.extend(breaking::before_the_end(&case.scene, &outcome));
    recorder.finish(&outcome, &ending, &resolved, options)?;
    Ok(ending)
}

pub(super) fn enter(clock: &mut PhaseClock, watch: &Watch, phase: &'static str) {
    clock.enter(phase);
    watch.notice(Event::Phase(phase));
}

/// The body at rest, before the first step, in N.
struct AtRest {
    /// `dE/du`.
    forces: Vec<f64>,
    /// The same minus the loads.
    residual: Vec<f64>,
}

impl AtRest {
    /// Nothing where loads or forces are not finite there: the steps go without.
    fn of(energy: &Total<'_>, drive: &SceneDrive<'_>, n: usize) -> Option<AtRest> {
        let (mut forces, mut loads) = (vec![0.0; n], vec![0.0; n]);
        let begun = drive.begin(0.0);
        drive.loads(0.0, &mut loads);
        // What is not given at rest is no reason for what happens later.
        drive.forget();
        begun.ok()?;
        energy.forces(&vec![0.0; n], &mut forces).ok()?;
        let residual: Vec<f64> =
            forces.iter().zip(&loads).map(|(force, load)| force - load).collect();
        residual.iter().all(|x| x.is_finite()).then_some(AtRest { forces, residual })
    }
}

/// Refuses a body that can move without force.
pub(super) fn check_held(
    case: &Case,
    bonds: &BlockPattern,
    boundary: &BoundaryConditions<'_>,
) -> Result<(), CaseError> {
    let n_dofs = case.body.n_points() * case.body.dimension();
    let constraints = Constraints::new(n_dofs, boundary.fixed_dofs())?;
    check_rigid_motions(bonds, case.body.positions(), &constraints)
        .map_err(|error| explain::free_motion(&case.scene, &error))
}

/// How the steps are solved.
pub(super) fn settings(scene: &Scene) -> StepSettings {
    let solver = &scene.solver;
    let mut options = LinearOptions {
        method: solver.linear,
        preconditioner: solver.preconditioner,
        ..LinearOptions::default()
    };
    if let Some(available) = available_memory() {
        options.memory_limit = linear::MEMORY_SHARE * available as f64;
    }
    StepSettings {
        end: scene.steps.end,
        increments: scene.steps.increments,
        find: scene.steps.find,
        start: solver.start,
        newton: NewtonSettings {
            tolerance: solver.tolerance,
            max_iterations: solver.max_iterations,
            variant: solver.newton,
        },
        linear: options,
        breaking: BreakSettings {
            control: scene.steps.control,
            breaking: scene.steps.breaking,
            tie: scene.steps.tie,
            events: scene.steps.events,
            arcs: scene.steps.arcs,
            loose: scene.fracture.loose,
            singular: scene.fracture.singular,
        },
    }
}

/// The boundary conditions of a scene as the solver asks for them.
pub(super) struct SceneDrive<'a> {
    boundary: &'a BoundaryConditions<'a>,
    fields: &'a FieldsInTime<'a>,
    /// The first condition that is not finite, or parameter that cannot be: the solver only sees that.
    problem: Mutex<Option<Problem>>,
}

enum Problem {
    Condition(NonFiniteCondition),
    Field(WrongField),
}

impl<'a> SceneDrive<'a> {
    pub(super) fn new(
        boundary: &'a BoundaryConditions<'a>,
        fields: &'a FieldsInTime<'a>,
    ) -> SceneDrive<'a> {
        SceneDrive { boundary, fields, problem: Mutex::new(None) }
    }

    /// What the solver could not start with, in the scene's words where it is a condition.
    pub(super) fn explain(&self, case: &Case, error: StepError) -> CaseError {
        match self.problem.lock().unwrap_or_else(|e| e.into_inner()).take() {
            Some(Problem::Condition(problem)) => problem.into(),
            Some(Problem::Field(problem)) => case.wrong_field(problem),
            None => error.into(),
        }
    }

    /// Takes nothing for the reason of what happens later that was not given so far.
    fn forget(&self) {
        *self.problem.lock().unwrap_or_else(|e| e.into_inner()) = None;
    }

    fn note(&self, problem: Problem) {
        *self.problem.lock().unwrap_or_else(|e| e.into_inner()) = Some(problem);
    }

    fn fill(&self, values: &mut [f64], result: Result<Vec<f64>, NonFiniteCondition>) {
        match result {
            Ok(given) => values.copy_from_slice(&given),
            Err(problem) => {
                values.fill(f64::NAN);
                self.note(Problem::Condition(problem));
            }
        }
    }
}

impl Drive for SceneDrive<'_> {
    fn fixed(&self) -> &[usize] {
        self.boundary.fixed_dofs()
    }

    fn begin(&self, t: f64) -> Result<bool, NotGiven> {
        self.fields.advance(t).map_err(|problem| {
            self.note(Problem::Field(problem));
            NotGiven
        })
    }

    fn prescribed(&self, t: f64, values: &mut [f64]) {
        self.fill(values, self.boundary.prescribed(t));
    }

    fn loads(&self, t: f64, loads: &mut [f64]) {
        self.fill(loads, self.boundary.loads(t));
    }
}

/// Choices of the scene that made no difference.
fn idle_choices(scene: &Scene, outcome: &steps::Outcome) -> Vec<String> {
    let mut found = Vec::new();
    let method = outcome.linear.method;
    let solver = &scene.solver;
    if solver.newton == NewtonVariant::Inexact && !method.iterates() {
        let name = method.name();
        found.push(format!(
            "newton = \"inexact\" makes no difference with {name}: its solutions are exact"
        ));
    }
    if solver.preconditioner == PreconditionerChoice::TwoLevel
        && !outcome.linear.stores_matrix
        && outcome.linear.preconditioner.as_deref() == Some(BLOCK_JACOBI)
    {
        found.push(
            "preconditioner = \"two-level\" needs a stored tangent: block Jacobi was used"
                .to_string(),
        );
    }
    found
}

/// How the steps ended, and what they left.
fn ending(
    case: &Case,
    result: Result<steps::Outcome, StepError>,
    drive: &SceneDrive<'_>,
    history: &History,
    warnings: &[String],
) -> Result<(Ending, steps::Outcome), RunError> {
    let indefinite =
        history.steps.iter().filter(|s| s.definiteness.positive_definite == Some(false)).count();
    let fails = case.scene.solver.unstable == Unstable::Fail
        && history.steps.last().is_some_and(|s| s.definiteness.positive_definite == Some(false));
    let steps = history.steps.len();
    let inverted = history.steps.last().map_or(Inverted::default(), |step| step.inverted);
    let done = format!("{} converged", counted(steps, "step"));
    let end = |reason, message, helps| {
        let (warnings, done) = (warnings.to_vec(), done.clone());
        Ending { reason, message, helps, done, steps, indefinite, fails, inverted, warnings }
    };
    match result {
        // Only who looks on stops a run whose output could be written.
        Ok(outcome) if outcome.stopped => {
            let t = outcome.records.last().map_or(0.0, |record| record.t);
            let message = format!("interrupted; the last equilibrium is at t = {t}");
            Ok((end(ExitReason::Interrupted, message, Vec::new()), outcome))
        }
        Ok(outcome) => {
            let helps = if fails { advice::unstable(history) } else { Vec::new() };
            Ok((end(ExitReason::Completed, String::new(), helps), outcome))
        }
        Err(StepError::NotConverged(failure)) => {
            let (reason, message) = failed(case, &failure);
            let helps = advice::not_found(&case.scene, &failure.cause.failure);
            Ok((end(reason, message, helps), failure.outcome))
        }
        Err(error) => Err(drive.explain(case, error).into()),
    }
}

/// Why no equilibrium was found, in words.
pub(super) fn failed(case: &Case, failure: &NotConverged) -> (ExitReason, String) {
    match &failure.cause.failure {
        NewtonFailure::NonFinite(found) => {
            let place = case.describe(found);
            let (last, tried) = (failure.t_converged, failure.t_failed);
            let message =
                format!("no equilibrium at t = {tried}, the last is at t = {last}: {place}");
            (ExitReason::NonFinite, message)
        }
        loose @ NewtonFailure::Loose { .. } => {
            let message =
                format!("{loose}; the last equilibrium is at t = {}", failure.t_converged);
            (ExitReason::CameLoose, message)
        }
        NewtonFailure::Singular { t, families } => {
            let (families, last) = (case.numbered(families), failure.t_converged);
            let message = format!("at t = {t} {families}; the last equilibrium is at t = {last}");
            (ExitReason::Singular, message)
        }
        _ => (ExitReason::NotConverged, failure.to_string()),
    }
}

/// Writes what the steps bring.
struct Recorder<'a> {
    fields: PointFields<'a>,
    tracks: Option<Tracks<'a>>,
    folder: &'a OutputFolder,
    points: &'a Points,
    clock: PhaseClock,
    frames: FrameSeries<'a>,
    history: History,
    warnings: Vec<String>,
    last: Frame,
    /// How many steps there were at the last frame.
    framed: usize,
    nominal: usize,
    failed: Option<OutputError>,
}

impl<'a> Recorder<'a> {
    fn new(
        fields: PointFields<'a>,
        folder: &'a OutputFolder,
        points: &'a Points,
        clock: PhaseClock,
        at_rest: Option<AtRest>,
    ) -> Result<Recorder<'a>, OutputError> {
        let PointFields { case, energy, selection, .. } = fields;
        let mut frames = FrameSeries::new(folder, points)?;
        let zero = vec![0.0; points.positions.len()];
        let mut last = frame(case, 0.0, &zero, at_rest.as_ref().map_or(&zero, |at| &at.residual));
        fields.fill(&mut last);
        frames.push(&last)?;
        let mut history = history(case, selection, energy.parts());
        let d = case.body.dimension();
        history.at_rest = at_rest.map(|at| SetsAtRest {
            reactions: selection.reactions(&at.residual, d),
            forces: selection.reactions(&at.forces, d),
        });
        let tracks = Tracks::new(case, energy, selection, false);
        let table = |tracks: &Tracks<'_>| FractureTable {
            columns: tracks.columns(),
            ..FractureTable::default()
        };
        history.fracture = tracks.as_ref().map(table);
        let nominal = 0;
        Ok(Recorder {
            fields,
            tracks,
            folder,
            points,
            clock,
            frames,
            history,
            warnings: Vec::new(),
            last,
            framed: 0,
            nominal,
            failed: None,
        })
    }

    fn record(&mut self, record: &StepRecord, state: &State<'_>) -> ControlFlow<()> {
        self.clock.enter("output");
        let PointFields { case, energy, selection, .. } = self.fields;
        let d = case.body.dimension();
        let residual: Vec<f64> =
            state.internal_forces.iter().zip(state.loads).map(|(g, f)| g - f).collect();
        self.history.push(piola_output::StepRecord {
            t: record.t,
            iterations: record.iterations,
            residual: record.residual.clone(),
            residual_over_reaction: record.residual_over_reaction.clone(),
            energy_parts: record.energy_parts.clone(),
            reactions: selection.reactions(&residual, d),
            forces: selection.reactions(state.internal_forces, d),
            moved: selection.means(state.displacements, case.body.volumes(), d),
            probes: selection.displacements(state.displacements, d),
            definiteness: Definiteness {
                positive_definite: record.definiteness.positive_definite,
                method: record.definiteness.method.clone(),
            },
            condition: record.condition,
            inverted: energy.inverted(state.displacements),
            broken: breaking::told(record),
        });
        if let (Some(tracks), Some(table)) = (&mut self.tracks, &mut self.history.fracture) {
            let released = record.broken.map_or(0.0, |broken| broken.account.released);
            table.rows.push(tracks.row(record.t, released));
        }
        self.warn_of_rounding(record);
        self.warnings.extend(breaking::notes(record, self.warnings.len()));
        self.last = frame(case, record.t, state.displacements, &residual);
        let written = self.write_step(record.nominal);
        self.clock.enter("solve");
        match written {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                self.failed = Some(error);
                ControlFlow::Break(())
            }
        }
    }

    /// Warns once of a tolerance that rounding does not let the residual meet but by luck.
    fn warn_of_rounding(&mut self, record: &StepRecord) {
        let (tolerance, floor) = (self.fields.case.scene.solver.tolerance, record.rounding_floor);
        if tolerance < floor && self.warnings.is_empty() {
            self.warnings.push(format!(
                "the tolerance {tolerance:e} is below the rounding of the forces, {floor:.0e} of the \
                 reaction at t = {}: a smaller residual is luck and makes nothing more exact",
                record.t
            ));
        }
    }

    fn finish(
        mut self,
        outcome: &steps::Outcome,
        ending: &Ending,
        resolved: &str,
        options: RunOptions<'_>,
    ) -> Result<(), OutputError> {
        self.clock.enter("output");
        self.write_last_frame()?;
        let PointFields { case, energy, .. } = self.fields;
        let (body, title) = (&case.body, options.title);
        if self.history.steps.is_empty() {
            table::write_history(self.folder, &self.history)?;
        }
        let displacement = body.to_user_order(&outcome.displacements, body.dimension());
        table::write_displacement(self.folder, self.points, &displacement)?;
        let mut summary = summary(case, energy, (ending, options), resolved, &mut self.clock);
        summary.solver = Some(solver_summary(outcome, case.scene.steps.find));
        summary.steps = step_summaries(&self.history);
        // Before the picture: that takes longer, and is the smaller loss.
        summary.write(self.folder)?;
        self.draw(title)
    }

    fn draw(&self, title: &str) -> Result<(), OutputError> {
        let scene = &self.fields.case.scene;
        let entry = match scene.steps.find {
            Find::Newton => "Newton iteration",
            Find::Relaxation => "hundreds of steps",
        };
        let (sets, colour) = (self.fields.named_sets(), self.fields.colour(&self.last));
        let title = &self.fields.case.headline(title, self.fields.energy.parts());
        let picture = Picture {
            title,
            points: self.points,
            n_points: self.points.n_points(),
            frame: &self.last,
            sets: &sets,
            colour: colour.as_ref(),
            charts: Charts::Steps(&self.history, scene.solver.tolerance, entry),
        };
        picture.write(self.folder)
    }
}

/// A history without steps, of sets and probes of a scene and the parts of an energy.
pub(super) fn history(case: &Case, selection: &Selection, parts: &[String]) -> History {
    let sets = selection.sets.iter().map(|set| set.name.clone()).collect();
    let probes = selection.probes.iter().map(|probe| probe.name.clone()).collect();
    let mut history = History::new(case.body.dimension(), parts.to_vec(), sets, probes);
    let prescribed = &case.scene.prescriptions;
    history.prescribed = (0..selection.sets.len())
        .map(|set| prescribed.iter().any(|given| given.set.value == set))
        .collect();
    history
}

/// A frame of the body, with the materials of its points where there are several; its own fields are
/// filled in where it is written.
pub(super) fn frame(case: &Case, t: f64, displacement: &[f64], residual: &[f64]) -> Frame {
    let frame = Frame::of(&case.body, t, displacement, residual);
    let Some(materials) = &case.materials else { return frame };
    let numbers: Vec<f64> =
        (0..case.body.n_points()).map(|point| f64::from(materials.of(point))).collect();
    frame.with_scalar(&case.body, "material", &numbers)
}
