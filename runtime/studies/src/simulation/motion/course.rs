//! A motion of which nothing is written: what comparisons of settings run.

use piola_solvers::Watch;
use piola_solvers::march::{Advance, March as _};
use piola_solvers::motion::{self, MotionSettings, Row};

use super::ready::{Ready, refused, settings, stopped, with_ready};
use crate::case::{Case, CaseError};
use crate::scene::Motion;
use crate::simulation::course::{Attempt, Course, Moment};

/// How many moments of a course are compared, besides the start.
const MOMENTS: usize = 20;

/// Follows a motion to its end, or until it is no longer waited for.
///
/// # Errors
/// A case that cannot start.
pub(in crate::simulation) fn solve(
    case: &Case,
    scene: &Motion,
    watch: &Watch,
) -> Result<Attempt, CaseError> {
    with_ready(case, case.compile()?, |ready| follow(case, scene, ready, watch))?
}

fn follow(
    case: &Case,
    scene: &Motion,
    ready: Ready<'_>,
    watch: &Watch,
) -> Result<Attempt, CaseError> {
    let Ready { energy, selection, masses, drive, start } = ready;
    let settings = MotionSettings { rows: MOMENTS, even: true, ..settings(case, scene) };
    let made = motion::Motion::new(energy, masses, start, drive, &settings, watch);
    let mut motion = made.map_err(|error| refused(case, drive, error))?;
    let mut course = Course::default();
    let mut unclosed = Unclosed::default();
    let mut next = motion.advance_to(0);
    loop {
        match next {
            Ok(Advance::Step(row)) => {
                unclosed.note(&row);
                let energy = row.energy.clone();
                let moment = Moment::new(case, selection, &motion.state(), energy, row.kinetic);
                course.moments.push(moment);
            }
            Ok(Advance::Pause) => {}
            Ok(Advance::End) => break,
            Ok(Advance::Interrupted) => return Ok(Attempt::OutOfTime(motion.time_reached())),
            Err(error) => return Ok(Attempt::NotConverged(stopped(case, drive, error).1)),
        }
        next = motion.advance();
    }
    course.displacements = motion.state().displacements.to_vec();
    course.steps = motion.step_reached();
    course.residual = unclosed.share();
    Ok(Attempt::Reached(Box::new(course)))
}

/// The largest part of an account of energy that does not close, and the largest of its energies, in J.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Unclosed {
    pub(super) rounding: f64,
    pub(super) largest: f64,
}

impl Unclosed {
    pub(super) fn note(&mut self, row: &Row) {
        let energies = [row.kinetic, row.external, row.prescribed, row.damping];
        let largest = energies.iter().fold(row.energy.magnitude(), |most, x| most.max(x.abs()));
        self.largest = self.largest.max(largest);
        self.rounding = self.rounding.max(row.rounding.abs());
    }

    /// One over the other.
    pub(super) fn share(self) -> f64 {
        if self.largest > 0.0 { self.rounding / self.largest } else { 0.0 }
    }
}
