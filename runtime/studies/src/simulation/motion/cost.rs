//! What a motion costs: its start, and its steps by phase.

use std::time::Instant;

use piola_mechanics::energy::{Energy as _, Wanted};
use piola_mechanics::words::Words as _;
use piola_output::summary::PhaseClock;
use piola_solvers::Watch;
use piola_solvers::march::{Advance, March as _};
use piola_solvers::motion::{self, MotionDrive as _};

use super::ready::{Ready, refused, settings, stopped, with_ready};
use crate::case::{Case, CaseError};
use crate::machine::Rates;
use crate::scene::Motion;
use crate::simulation::cost::{MotionCost, SceneCost};
use crate::simulation::work::{Pass, Terms};

/// Runs of everything that is timed; the least time counts.
const ROUNDS: usize = 5;

/// Steps of a run last so many seconds together, as far as there are so many.
const STRETCH: f64 = 0.1;

/// Measures a case that moves, as [`cost`](crate::simulation::cost()) does one that stands.
///
/// # Errors
/// What is wrong with the body, the energies or the conditions.
pub(in crate::simulation) fn cost(
    case: &Case,
    scene: &Motion,
    mut clock: PhaseClock,
    rates: impl FnOnce() -> Rates,
) -> Result<SceneCost, CaseError> {
    clock.enter("compile");
    let compiled = case.compile()?;
    let terms = Terms::of(case, &compiled);
    clock.enter("interactions");
    with_ready(case, compiled, |ready| measured(case, scene, &terms, ready, clock, rates))?
}

fn measured(
    case: &Case,
    scene: &Motion,
    terms: &Terms,
    ready: Ready<'_>,
    mut clock: PhaseClock,
    rates: impl FnOnce() -> Rates,
) -> Result<SceneCost, CaseError> {
    let Ready { energy, drive, .. } = ready;
    let fixed = [drive.displaced(), drive.driven(), drive.accelerated()].concat().len();
    clock.enter("critical step");
    let settings = settings(case, scene);
    let watch = Watch::default();
    let made = motion::Motion::new(energy, ready.masses, ready.start, drive, &settings, &watch);
    let mut motion = made.map_err(|error| refused(case, drive, error))?;
    clock.enter("steps");
    let mut notes = Vec::new();
    let mut forces = vec![0.0; energy.positions().len()];
    let mut loads = forces.clone();
    let mut times = Times::default();
    for _ in 0..ROUNDS {
        match times.go(&mut motion) {
            Ok(true) => {}
            Ok(false) => break,
            Err(error) => {
                notes.push(stopped(case, drive, error).1);
                break;
            }
        }
        // Behind steps: some energies cost less at rest.
        let u = motion.state().displacements;
        let start = Instant::now();
        // It was evaluated there before.
        let _ = energy.evaluate(u, Wanted::Forces(&mut forces), &mut []);
        times.forces = times.forces.min(start.elapsed().as_secs_f64());
        if drive.loads_change() {
            let start = Instant::now();
            drive.loads(motion.time_reached(), &mut loads);
            times.loads = times.loads.min(start.elapsed().as_secs_f64());
        }
    }
    clock.leave();
    let report = energy.report();
    let work = |pass| terms.work(pass, energy, &report, 0);
    let steps = motion.n_steps();
    let cost = MotionCost {
        method: scene.method.word(),
        step_seconds: motion.step(),
        critical_step_seconds: motion.critical().map(|found| found.seconds),
        steps,
        wall_seconds: Some(times.step * steps as f64).filter(|seconds| seconds.is_finite()),
    };
    let common = SceneCost::of(case, &report, &times.found(), &work, rates);
    Ok(SceneCost {
        unknowns: energy.positions().len() - fixed,
        phases: clock.phases().to_vec(),
        motion: Some(cost),
        notes,
        ..common
    })
}

/// The least times in s.
#[derive(Clone, Copy, Debug)]
struct Times {
    forces: f64,
    loads: f64,
    step: f64,
    row: f64,
}

impl Default for Times {
    fn default() -> Self {
        let none = f64::INFINITY;
        Times { forces: none, loads: none, step: none, row: none }
    }
}

impl Times {
    /// A step with a row, then a stretch of steps of which the last has one; whether there are more.
    fn go(&mut self, motion: &mut motion::Motion<'_>) -> Result<bool, motion::MotionError> {
        let left = motion.n_steps() - motion.step_reached();
        if left < 3 {
            return Ok(false);
        }
        let row = time(motion, 1)?;
        self.row = self.row.min(row);
        let share = STRETCH / if self.step.is_finite() { self.step } else { row };
        let stretch = (share as usize).clamp(2, left - 1);
        let all = time(motion, stretch)?;
        self.step = self.step.min((all - self.row).max(0.0) / (stretch - 1) as f64);
        Ok(true)
    }

    fn found(&self) -> Vec<(Pass, f64)> {
        let all = [
            (Pass::Forces, self.forces),
            (Pass::Loads, self.loads),
            (Pass::Step, self.step),
            (Pass::Row, self.row),
        ];
        all.into_iter().filter(|(_, seconds)| seconds.is_finite()).collect()
    }
}

/// How long so many steps take, of which the last has a row, in s.
fn time(motion: &mut motion::Motion<'_>, steps: usize) -> Result<f64, motion::MotionError> {
    let (start, end) = (Instant::now(), motion.step_reached() + steps);
    while motion.step_reached() < end {
        if let Advance::End = motion.advance_to(end)? {
            break;
        }
    }
    Ok(start.elapsed().as_secs_f64())
}
