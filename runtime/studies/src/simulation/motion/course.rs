//! A motion of which nothing is written: what comparisons of settings run.

use std::time::Duration;

use piola_mechanics::energy::Energy as _;
use piola_solvers::Watch;
use piola_solvers::march::{Advance, March as _, State};
use piola_solvers::motion::{self, MotionSettings, Row};

use super::ready::{Ready, refused, settings, stopped, with_ready};
use crate::case::{Case, CaseError};
use crate::scene::Motion;
use crate::scene::selection::{PointSet, Selection};
use crate::simulation::course::{Attempt, Course, Failure, Moment, NamedVector};

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
    even: bool,
) -> Result<Attempt, CaseError> {
    with_ready(case, case.compile()?, |ready| follow(case, scene, ready, watch, even))?
}

fn follow(
    case: &Case,
    scene: &Motion,
    ready: Ready<'_>,
    watch: &Watch,
    even: bool,
) -> Result<Attempt, CaseError> {
    let Ready { energy, selection, masses, drive, start } = ready;
    let own = settings(case, scene);
    let settings = if even { MotionSettings { rows: MOMENTS, even, ..own } } else { own };
    let made = motion::Motion::new(energy, masses, start, drive, &settings, watch);
    let mut motion = made.map_err(|error| refused(case, drive, error))?;
    let fracture = energy.fracture();
    let mut failing = fracture.map(|_| Failing::new(case, selection));
    if failing.is_some() {
        // Every step is looked at.
        motion.pause_every(Duration::ZERO);
    }
    let mut course = Course::default();
    let mut unclosed = Unclosed::default();
    let mut released = 0.0;
    let mut next = motion.advance_to(0);
    loop {
        if let (Some(failing), Some(fracture)) = (&mut failing, fracture) {
            failing.note(&motion.state(), fracture.counts()[1]);
        }
        match next {
            Ok(Advance::Step(row)) => {
                unclosed.note(&row);
                released = row.released;
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
    course.failure = failing.map(|failing| failing.end(scene.end, released));
    Ok(Attempt::Reached(Box::new(course)))
}

/// How bonds break, step by step.
struct Failing<'a> {
    d: usize,
    selection: &'a Selection,
    /// The times at which the number of broken bonds was another, and that number.
    broken: Vec<(f64, usize)>,
    /// The largest reaction of each set so far, in N.
    peaks: Vec<f64>,
}

impl<'a> Failing<'a> {
    fn new(case: &Case, selection: &'a Selection) -> Failing<'a> {
        let peaks = vec![0.0; selection.sets.len()];
        Failing { d: case.body.dimension(), selection, broken: Vec::new(), peaks }
    }

    fn note(&mut self, state: &State<'_>, n_broken: usize) {
        if self.broken.last().is_none_or(|(_, before)| *before != n_broken) {
            self.broken.push((state.t, n_broken));
        }
        for (peak, set) in self.peaks.iter_mut().zip(&self.selection.sets) {
            let along = |axis: usize| {
                let own = set.points.iter().map(|point| self.d * point + axis);
                own.fold(0.0, |sum, k| sum + state.internal_forces[k] - state.loads[k])
            };
            let square = (0..self.d).map(|axis| along(axis) * along(axis)).sum::<f64>();
            *peak = peak.max(square.sqrt());
        }
    }

    /// At the end of the motion in s, with what all bonds released in J.
    fn end(self, end: f64, released: f64) -> Failure {
        let at = |place: Option<&(f64, usize)>| place.map_or(0, |(_, count)| *count);
        let (cut, last) = (at(self.broken.first()), at(self.broken.last()));
        let when = |least: usize| {
            let reached = self.broken.iter().find(|(_, count)| *count >= least);
            reached.filter(|_| last > cut).map_or(end, |(t, _)| *t)
        };
        let (first, half) = (when(cut + 1), when(cut + (last - cut).div_ceil(2)));
        let peak = |(set, peak): (&PointSet, f64)| NamedVector {
            name: set.name.clone(),
            value: vec![peak],
        };
        let peaks = self.selection.sets.iter().zip(self.peaks).map(peak).collect();
        Failure { first, half, bonds: last - cut, released, peaks }
    }
}

/// The largest part of an account of energy that does not close, and the largest of its energies, in J.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::simulation) struct Unclosed {
    pub(in crate::simulation) rounding: f64,
    pub(in crate::simulation) largest: f64,
}

impl Unclosed {
    pub(in crate::simulation) fn note(&mut self, row: &Row) {
        let energies = [row.kinetic, row.external, row.prescribed, row.damping];
        let largest = energies.iter().fold(row.energy.magnitude(), |most, x| most.max(x.abs()));
        self.largest = self.largest.max(largest);
        self.rounding = self.rounding.max(row.rounding.abs());
    }

    /// One over the other.
    pub(in crate::simulation) fn share(self) -> f64 {
        if self.largest > 0.0 { self.rounding / self.largest } else { 0.0 }
    }
}
