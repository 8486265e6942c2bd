//! What a scene leads to, and nothing written: what comparisons of settings run.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use piola_mechanics::energy::{Energy as _, EnergyParts};
use piola_solvers::march::State;
use piola_solvers::steps::{Drive, NotGiven, StepError, StepRecord, run_steps};
use piola_solvers::{Event, Observer, Watch};

use super::motion;
use super::run::{SceneDrive, check_held, failed, settings};
use crate::case::{Case, CaseError};
use crate::scene::boundary::BoundaryConditions;
use crate::scene::selection::Selection;

/// A vector of a set or a probe.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedVector {
    /// The name of the set or the probe.
    pub name: String,
    /// One entry per dimension.
    pub value: Vec<f64>,
}

/// A body at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moment {
    /// Stored energy by kind of interaction, in J.
    pub energy: EnergyParts,
    /// Kinetic energy in J; 0 of an equilibrium.
    pub kinetic: f64,
    /// For every set the sum of dE/du minus the loads, in N.
    pub reactions: Vec<NamedVector>,
    /// For every probe its displacement in m.
    pub probes: Vec<NamedVector>,
}

/// How the bonds of a body broke while it moved.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Failure {
    /// When the first bond broke, in s; the end of the motion if none did.
    pub first: f64,
    /// When half of those were broken that are at the end, in s: the crack is about half way.
    pub half: f64,
    /// How many broke, without those that cracks cut.
    pub bonds: usize,
    /// What they held, in J.
    pub released: f64,
    /// For every set the largest reaction at any step, in N: one entry each.
    pub peaks: Vec<NamedVector>,
}

/// What a scene leads to: the equilibrium at its end, or a motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Course {
    /// The end; of a motion the start and moments at even times before it, too.
    pub moments: Vec<Moment>,
    /// How its bonds broke, of a motion of a body that breaks.
    pub failure: Option<Failure>,
    /// Displacements at the end, `n x d`, in m, in the body's order.
    pub displacements: Vec<f64>,
    /// 2-norm of the free residual over the larger of those of reactions and loads; of a motion what is left
    /// over in the account of energy, over its largest column.
    pub residual: f64,
    /// Estimated condition of the tangent, where there are factors of it.
    pub condition: Option<f64>,
    /// Converged steps, sub-steps included, or steps in time.
    pub steps: usize,
    /// Iterations of Newton's method in all load steps.
    pub iterations: usize,
    /// Iterations of iterative methods in all of them.
    pub linear_iterations: usize,
    /// How often an increment was halved.
    pub cut_backs: usize,
}

impl Moment {
    /// From a state and its energies in J.
    pub(super) fn new(
        case: &Case,
        selection: &Selection,
        state: &State<'_>,
        energy: EnergyParts,
        kinetic: f64,
    ) -> Moment {
        let d = case.body.dimension();
        let residual: Vec<f64> =
            state.internal_forces.iter().zip(state.loads).map(|(g, f)| g - f).collect();
        let sets = selection.sets.iter();
        let reactions =
            sets.map(|set| NamedVector { name: set.name.clone(), value: set.sum(&residual, d) });
        let at = |point: usize| state.displacements[d * point..d * (point + 1)].to_vec();
        let probes = selection.probes.iter();
        let probes =
            probes.map(|probe| NamedVector { name: probe.name.clone(), value: at(probe.point) });
        Moment { energy, kinetic, reactions: reactions.collect(), probes: probes.collect() }
    }
}

/// What came of an attempt to solve a case.
#[derive(Clone, Debug, PartialEq)]
pub enum Attempt {
    /// The end of the scene was reached.
    Reached(Box<Course>),
    /// No equilibrium was found at some time, or a motion could not go on; the reason in words.
    NotConverged(String),
    /// The time was up after the step at this `t`.
    OutOfTime(f64),
}

/// Compiles and assembles a case and follows its load steps or its motion; gives up soon after `limit`.
///
/// # Errors
/// A case that cannot start, as for [`run`](super::run()).
pub fn solve(case: &Case, limit: Duration) -> Result<Attempt, CaseError> {
    let watch = Watch::by(Arc::new(Deadline { start: Instant::now(), limit }));
    match &case.scene.motion {
        // Moments at even times, which are compared.
        Some(scene) => motion::solve(case, scene, &watch, true),
        None => solve_watched(case, &watch),
    }
}

/// The same until `watch` wants an end, with the steps that [`run`](super::run()) takes.
///
/// # Errors
/// As [`solve`].
pub fn solve_watched(case: &Case, watch: &Watch) -> Result<Attempt, CaseError> {
    if let Some(scene) = &case.scene.motion {
        return motion::solve(case, scene, watch, false);
    }
    follow(case, watch, &|_, _| {}, &mut |_, _| ControlFlow::Continue(()))
}

/// Follows the load steps of a case; `more` adds loads in N (`n x d`, in the body's order) to those of the
/// scene at a load parameter, `observer` sees each converged step and may end the run.
///
/// # Errors
/// As [`solve`].
pub fn follow(
    case: &Case,
    watch: &Watch,
    more: &(dyn Fn(f64, &mut [f64]) + Sync),
    observer: &mut dyn FnMut(&StepRecord, &State<'_>) -> ControlFlow<()>,
) -> Result<Attempt, CaseError> {
    let (energy, fields) = case.solved_energy(case.compile()?)?;
    let selection = case.selection()?;
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection)?;
    check_held(case, energy.bonds(), &boundary)?;
    let scene = SceneDrive::new(&boundary, &fields);
    let drive = WithLoads { scene: &scene, more };
    let mut reached = Course::default();
    let mut observer = |record: &StepRecord, state: &State<'_>| {
        reached.note(record);
        if record.t >= case.scene.steps.end {
            let energy = record.energy_parts.clone();
            reached.moments = vec![Moment::new(case, &selection, state, energy, 0.0)];
        }
        observer(record, state)
    };
    match run_steps(&energy, &drive, &settings(&case.scene), watch, &mut observer) {
        Ok(outcome) if outcome.stopped => {
            Ok(Attempt::OutOfTime(outcome.records.last().map_or(0.0, |record| record.t)))
        }
        Ok(outcome) => {
            reached.displacements = outcome.displacements;
            Ok(Attempt::Reached(Box::new(reached)))
        }
        Err(StepError::NotConverged(failure)) => {
            Ok(Attempt::NotConverged(failed(case, &failure).1))
        }
        Err(error) => Err(scene.explain(case, error)),
    }
}

/// The conditions of a scene, and loads beside its own.
struct WithLoads<'a> {
    scene: &'a SceneDrive<'a>,
    more: &'a (dyn Fn(f64, &mut [f64]) + Sync),
}

impl Drive for WithLoads<'_> {
    fn fixed(&self) -> &[usize] {
        self.scene.fixed()
    }

    fn begin(&self, t: f64) -> Result<bool, NotGiven> {
        self.scene.begin(t)
    }

    fn prescribed(&self, t: f64, values: &mut [f64]) {
        self.scene.prescribed(t, values);
    }

    fn loads(&self, t: f64, loads: &mut [f64]) {
        self.scene.loads(t, loads);
        (self.more)(t, loads);
    }
}

/// Wants an end once the time is up, also in the middle of a step that does not converge.
struct Deadline {
    start: Instant,
    limit: Duration,
}

impl Observer for Deadline {
    fn notice(&self, _: Event<'_>) {}

    fn wants_end(&self) -> bool {
        self.start.elapsed() > self.limit
    }
}

impl Course {
    /// The stored energy at the end in J.
    pub fn energy(&self) -> f64 {
        self.moments.last().map_or(f64::NAN, |moment| moment.energy.total())
    }

    /// Takes the step in; the last one stays.
    fn note(&mut self, record: &StepRecord) {
        self.residual = record.residual_over_reaction.last().copied().unwrap_or(0.0);
        self.condition = record.condition;
        self.steps += 1;
        self.iterations += record.iterations;
        self.linear_iterations += record.linear.iter().map(|l| l.iterations).sum::<usize>();
        self.cut_backs += record.cut_backs;
    }
}
