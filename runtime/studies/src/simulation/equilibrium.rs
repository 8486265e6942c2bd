//! The last equilibrium of a case, and nothing written: what comparisons of settings run.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use piola_mechanics::energy::{Energy, EnergyParts};
use piola_solvers::march::State;
use piola_solvers::steps::{StepError, StepRecord, run_steps};
use piola_solvers::{Event, Observer, Watch};

use super::motion;
use super::run::{SceneDrive, check_held, failed, settings};
use crate::case::{Case, CaseError};
use crate::scene::boundary::BoundaryConditions;

/// A vector of a set or a probe.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedVector {
    /// The name of the set or the probe.
    pub name: String,
    /// One entry per dimension.
    pub value: Vec<f64>,
}

/// The equilibrium at the end of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Equilibrium {
    /// Energy by kind of interaction.
    pub energy: EnergyParts,
    /// Displacements, `n x d`, in m, in the body's order.
    pub displacements: Vec<f64>,
    /// For every set the sum of dE/du minus the loads, in N.
    pub reactions: Vec<NamedVector>,
    /// For every probe its displacement in m.
    pub probes: Vec<NamedVector>,
    /// 2-norm of the free residual over the larger of those of reactions and loads.
    pub residual: f64,
    /// Estimated condition of the tangent, where there are factors of it.
    pub condition: Option<f64>,
    /// Converged steps, sub-steps included.
    pub steps: usize,
    /// Iterations of Newton's method in all of them.
    pub iterations: usize,
    /// Iterations of iterative methods in all of them.
    pub linear_iterations: usize,
    /// How often an increment was halved.
    pub cut_backs: usize,
}

/// What came of an attempt to solve a case.
#[derive(Clone, Debug, PartialEq)]
pub enum Attempt {
    /// The end of the scene was reached.
    Reached(Box<Equilibrium>),
    /// No equilibrium was found at some time; the reason in words.
    NotConverged(String),
    /// The time was up after the step at this `t`.
    OutOfTime(f64),
}

/// Compiles and assembles a case and follows its load steps; gives up soon after `limit`.
///
/// # Errors
/// A case that cannot start, as for [`run`](super::run()).
pub fn solve(case: &Case, limit: Duration) -> Result<Attempt, CaseError> {
    motion::refuse(case)?;
    let start = Instant::now();
    let (energy, fields) = case.solved_energy(case.compile()?)?;
    let selection = case.selection()?;
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection)?;
    check_held(case, energy.bonds(), &boundary)?;
    let drive = SceneDrive::new(&boundary, &fields);
    let mut reached = Equilibrium::default();
    let mut observer = |record: &StepRecord, state: &State<'_>| {
        reached.note(record);
        if record.t < case.scene.steps.end {
            return ControlFlow::Continue(());
        }
        let d = case.body.dimension();
        let residual: Vec<f64> =
            state.internal_forces.iter().zip(state.loads).map(|(g, f)| g - f).collect();
        let sets = selection.sets.iter();
        reached.reactions = sets
            .map(|set| NamedVector { name: set.name.clone(), value: set.sum(&residual, d) })
            .collect();
        let probes = selection.probes.iter();
        let at = |point: usize| state.displacements[d * point..d * (point + 1)].to_vec();
        reached.probes = probes
            .map(|probe| NamedVector { name: probe.name.clone(), value: at(probe.point) })
            .collect();
        ControlFlow::Continue(())
    };
    let watch = Watch::by(Arc::new(Deadline { start, limit }));
    match run_steps(&energy, &drive, &settings(&case.scene), &watch, &mut observer) {
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
        Err(error) => Err(drive.explain(case, error)),
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

impl Equilibrium {
    /// Takes the step in; the last one stays.
    fn note(&mut self, record: &StepRecord) {
        self.energy = record.energy_parts.clone();
        self.residual = record.residual_over_reaction.last().copied().unwrap_or(0.0);
        self.condition = record.condition;
        self.steps += 1;
        self.iterations += record.iterations;
        self.linear_iterations += record.linear.iter().map(|l| l.iterations).sum::<usize>();
        self.cut_backs += record.cut_backs;
    }
}
