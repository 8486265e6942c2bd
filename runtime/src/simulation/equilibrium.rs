//! The last equilibrium of a case, and nothing written: what comparisons of settings run.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::run::{SceneDrive, check_held, differences, failed, settings, strained, sum_over};
use super::{Case, CaseError};
use crate::energy::{
    Argument, EnergyParts, FromPositions, Inversion, NonFinite, Products, TotalEnergy,
};
use crate::kernel::Measure;
use crate::matrix::{BlockMatrix, BlockPattern};
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
    let start = Instant::now();
    let energy = case.energy(case.compile()?)?;
    let selection = case.selection()?;
    let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection)?;
    check_held(case, &energy, &boundary)?;
    let drive = SceneDrive::new(&boundary);
    let rounded = FromPositions::new(energy.total(), case.body.positions());
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
    let strained = strained(case, energy.total(), &rounded);
    let differences = differences(case, strained);
    let energy = differences.as_ref().map_or(strained, |energy| energy as &dyn TotalEnergy);
    let watched = Watched { energy, start, limit };
    let result = run_steps(&watched, &drive, &settings(&case.scene), &mut observer);
    match result {
        Ok(outcome) => Ok(match late {
            Some(t) => Attempt::OutOfTime(t),
            None => {
                reached.displacements = outcome.displacements;
                Attempt::Reached(Box::new(reached))
            }
        }),
        Err(StepError::NotConverged(failure)) => Ok(if watched.is_late() {
            Attempt::OutOfTime(failure.t_converged)
        } else {
            Attempt::NotConverged(failed(case, &failure).1)
        }),
        Err(error) => Err(drive.explain(&error)),
    }
}

/// An energy that cannot be evaluated any more once the time is up: the solver then gives up, also
/// in the middle of a step that does not converge.
struct Watched<'a> {
    energy: &'a dyn TotalEnergy,
    start: Instant,
    limit: Duration,
}

impl Watched<'_> {
    fn is_late(&self) -> bool {
        self.start.elapsed() > self.limit
    }

    fn check(&self) -> Result<(), NonFinite> {
        if !self.is_late() {
            return Ok(());
        }
        // Never shown: who sees that the time is up asks no further.
        Err(NonFinite {
            argument: Argument::Measure(Measure::Length),
            points: Vec::new(),
            displacements: Vec::new(),
            value: f64::NAN,
            reference: f64::NAN,
            inverted: false,
        })
    }
}

impl TotalEnergy for Watched<'_> {
    fn dimension(&self) -> usize {
        self.energy.dimension()
    }

    fn positions(&self) -> &[f64] {
        self.energy.positions()
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        self.energy.pattern()
    }

    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        self.energy.bond_pattern()
    }

    fn bond_tangent(&self, u: &[f64], tangent: &mut BlockMatrix) {
        self.energy.bond_tangent(u, tangent);
    }

    fn products(&self) -> Products {
        self.energy.products()
    }

    fn energy(&self, u: &[f64]) -> Result<EnergyParts, NonFinite> {
        self.check()?;
        self.energy.energy(u)
    }

    fn gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<EnergyParts, NonFinite> {
        self.check()?;
        self.energy.gradient(u, gradient)
    }

    fn tangent(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        tangent: &mut BlockMatrix,
    ) -> Result<EnergyParts, NonFinite> {
        self.check()?;
        self.energy.tangent(u, gradient, tangent)
    }

    fn tangent_diagonal(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        diagonal: &mut [f64],
    ) -> Result<EnergyParts, NonFinite> {
        self.check()?;
        self.energy.tangent_diagonal(u, gradient, diagonal)
    }

    fn tangent_product(&self, u: &[f64], p: &[f64], product: &mut [f64]) -> Result<(), NonFinite> {
        self.check()?;
        self.energy.tangent_product(u, p, product)
    }

    fn first_inversion(&self, u: &[f64], step: &[f64]) -> Option<Inversion> {
        self.energy.first_inversion(u, step)
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
