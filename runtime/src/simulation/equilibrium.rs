//! The last equilibrium of a case, and nothing written: what comparisons of settings run.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use super::run::{SceneDrive, check_held, failed, settings, strained, sum_over};
use super::{Case, CaseError};
use crate::energy::{EnergyParts, FromPositions};
use crate::scene::boundary::BoundaryConditions;
use crate::solve::steps::{State, StepError, StepRecord, run_steps};

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
    /// Iterations of conjugate gradients in all of them.
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

/// Compiles and assembles a case and follows its load steps; gives up after the first step that
/// ends later than `limit`.
///
/// # Errors
/// A case that cannot start, as for [`run`](super::run()).
pub fn solve(case: &Case, limit: Duration) -> Result<Attempt, CaseError> {
    let start = Instant::now();
    let energy = case.energy(case.compile()?.elements)?;
    let selection = case.selection()?;
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection)?;
    check_held(case, &energy, &boundary)?;
    let drive = SceneDrive::new(&boundary);
    let rounded = FromPositions::new(&energy, case.body.positions());
    let mut reached = Equilibrium::default();
    let mut late = None;
    let mut observer = |record: &StepRecord, state: &State<'_>| {
        reached.note(record);
        if record.t < case.scene.steps.end {
            return if start.elapsed() <= limit {
                ControlFlow::Continue(())
            } else {
                late = Some(record.t);
                ControlFlow::Break(())
            };
        }
        let d = case.body.dimension();
        let residual: Vec<f64> =
            state.internal_forces.iter().zip(state.loads).map(|(g, f)| g - f).collect();
        let sets = selection.sets.iter();
        reached.reactions = sets
            .map(|set| NamedVector {
                name: set.name.clone(),
                value: sum_over(&set.points, &residual, d),
            })
            .collect();
        let probes = selection.probes.iter();
        let at = |point: usize| state.displacements[d * point..d * (point + 1)].to_vec();
        reached.probes = probes
            .map(|probe| NamedVector { name: probe.name.clone(), value: at(probe.point) })
            .collect();
        ControlFlow::Continue(())
    };
    let whole = strained(case, &energy, &rounded);
    match run_steps(whole, &drive, &settings(&case.scene), &mut observer) {
        Ok(outcome) => Ok(match late {
            Some(t) => Attempt::OutOfTime(t),
            None => {
                reached.displacements = outcome.displacements;
                Attempt::Reached(Box::new(reached))
            }
        }),
        Err(StepError::NotConverged(failure)) => {
            Ok(Attempt::NotConverged(failed(case, &failure).1))
        }
        Err(error) => Err(drive.explain(&error)),
    }
}

impl Equilibrium {
    /// Takes the step in; the last one stays.
    fn note(&mut self, record: &StepRecord) {
        self.energy = record.energy_parts;
        self.residual = record.residual_over_reaction.last().copied().unwrap_or(0.0);
        self.condition = record.condition;
        self.steps += 1;
        self.iterations += record.iterations;
        self.linear_iterations += record.linear.iter().map(|l| l.iterations).sum::<usize>();
        self.cut_backs += record.cut_backs;
    }
}
