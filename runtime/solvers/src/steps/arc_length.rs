//! Load steps by the length of the way: `t` is an unknown, and how far the body goes is given.
//!
//! Where a body softens or snaps through, `t` rises to a maximum and falls; equilibria beyond it cannot be
//! found at given `t`. They are found at a given distance from the last ([`search`]). The first step is one by
//! `t`, and its length, the 2-norm of the displacements, is that of all others where they are found as easily
//! (Riks 1979; the sphere of displacements alone is that of Crisfield 1981).
//!
//! A body whose bonds soften could always go back the way it came, unloading: that, too, is an equilibrium at
//! any distance. So bonds that remember are made to dissipate: once they do, a step goes as far as a given
//! energy is dissipated (Gutierrez 2004), the largest that was stored over the number of increments.

mod search;

use piola_mechanics::vector::norm_of;

use super::breaking::{Fracturing, NOTHING};
use super::{Attempt, Event, Found, LoadSteps, StepError, StepRecord, smaller_may_help};
use crate::increment::TICKS;
use crate::march::Advance;
use crate::newton::{NewtonError, NewtonFailure};
use search::{Far, Full, Reached, plus};

/// A step goes by what it dissipates where the last one dissipated this share of what a full step does.
const DISSIPATES: f64 = 0.1;

/// The way of the last step.
pub(super) struct Way {
    /// How far the body goes in a full step, in m: 2-norm of the displacements.
    length: f64,
    /// The last step in `t`, and in m.
    t: f64,
    u: Vec<f64>,
    /// What it dissipated, in J.
    dissipated: f64,
}

impl LoadSteps<'_> {
    /// The next equilibrium on the way.
    pub(super) fn advance_along(&mut self) -> Result<Advance<StepRecord>, StepError> {
        while !self.way_is_over() {
            if self.watch.wants_end() {
                return Ok(Advance::Interrupted);
            }
            let tried = self.increment.ticks;
            match self.attempt_part(f64::from(tried) / f64::from(TICKS))? {
                Attempt::Converged(record) => {
                    self.increment.note_success(record.iterations);
                    return Ok(Advance::Step(*record));
                }
                Attempt::Failed(cause) if cause.failure == NewtonFailure::Interrupted => {
                    return Ok(Advance::Interrupted);
                }
                Attempt::Failed(cause) => {
                    let t = self.t;
                    self.cut_back(t, cause, tried)?;
                }
            }
        }
        Ok(Advance::End)
    }

    /// Whether `t` has come to the end or gone as far the other way, there were as many steps as there may be,
    /// or the body carries nothing any more.
    fn way_is_over(&self) -> bool {
        let is_empty = self.fracture.as_ref().is_some_and(|Fracturing { ledger, .. }| {
            ledger.most > 0.0 && ledger.energy <= NOTHING * ledger.most
        });
        self.t.abs() >= self.settings.end
            || self.records.len() >= self.settings.breaking.arcs
            || is_empty
    }

    /// A part of a full step.
    fn attempt_part(&mut self, part: f64) -> Result<Attempt, StepError> {
        let Some(way) = &self.way else { return self.attempt_first(part) };
        let by_length = Far { part, full: Full::Length(way.length) };
        let full = self.dissipated_by_full_step();
        if full == 0.0 {
            return self.attempt_along(by_length);
        }
        let dissipates = way.dissipated >= DISSIPATES * full;
        // Where nothing is to be dissipated near, the body may have to be loaded anew; and where loading ends at
        // once, as at a sharp peak, something has to be dissipated.
        let mut ways = [by_length, Far { part, full: Full::Dissipated(full) }];
        ways.rotate_left(usize::from(dissipates));
        match self.attempt_along(ways[0])? {
            Attempt::Failed(cause) if smaller_may_help(&cause.failure) => {
                self.attempt_along(ways[1])
            }
            attempt => Ok(attempt),
        }
    }

    /// In J; 0 of bodies that remember nothing.
    fn dissipated_by_full_step(&self) -> f64 {
        match &self.fracture {
            Some(Fracturing { ledger, .. }) if self.remembers() => {
                ledger.most / self.settings.increments as f64
            }
            _ => 0.0,
        }
    }

    /// A step by `t`, from rest or where nothing has moved yet.
    fn attempt_first(&mut self, part: f64) -> Result<Attempt, StepError> {
        let t = (self.t + part * self.nominal_time(1)).min(self.settings.end);
        let (t_before, before) = (self.t, self.u.clone());
        let passed = self.passed(t);
        let attempt = self.attempt(t, passed > self.nominal)?;
        if matches!(attempt, Attempt::Converged(_)) {
            self.nominal = self.nominal.max(passed);
            let u = plus(&self.u, -1.0, &before);
            let length = norm_of(&u) / part;
            let way = Way { length, t: t - t_before, u, dissipated: 0.0 };
            self.way = (length > 0.0).then_some(way);
        }
        Ok(attempt)
    }

    /// A step along the way.
    fn attempt_along(&mut self, far: Far) -> Result<Attempt, StepError> {
        self.watch.notice(Event::Attempt(self.t));
        self.follow_memory(Some(0.0));
        let attempt = self.attempt_following(far);
        self.hold_memory();
        self.times.add(&self.newton.take_times());
        attempt
    }

    /// The same where bonds follow what they come to remember.
    fn attempt_following(&mut self, far: Far) -> Result<Attempt, StepError> {
        let reached = match self.reach(far)? {
            Ok(reached) => self.no_further_than_the_end(reached)?,
            Err(cause) => return Ok(Attempt::Failed(cause)),
        };
        let (t, loads, dissipated) = (reached.t, reached.loads.clone(), reached.dissipated);
        let found = match self.arrive(reached) {
            Ok(found) => found,
            Err(cause) => return Ok(Attempt::Failed(cause)),
        };
        let (step, way) = (t - self.t, plus(&found.u, -1.0, &self.u));
        let found = match self.settle(found, &loads, t)? {
            Ok(found) => found,
            Err(cause) => return Ok(Attempt::Failed(cause)),
        };
        let passed = self.passed(t);
        let attempt = self.take(found, loads, t, passed > self.nominal)?;
        self.nominal = self.nominal.max(passed);
        if let Some(last) = &mut self.way {
            (last.t, last.u, last.dissipated) = (step, way, dissipated);
        }
        Ok(attempt)
    }

    /// The end is met exactly: from where the line to an equilibrium beyond it crosses it.
    fn no_further_than_the_end(&self, reached: Reached) -> Result<Reached, StepError> {
        if reached.t.abs() <= self.settings.end {
            return Ok(reached);
        }
        let t = self.settings.end.copysign(reached.t);
        let part = (t - self.t) / (reached.t - self.t);
        let u = plus(&self.u, part, &plus(&reached.u, -1.0, &self.u));
        Ok(Reached { t, u: self.with_prescribed(&u, t)?, loads: self.loads(t)?, ..reached })
    }

    /// Takes an equilibrium as one of Newton's method, which finds it so, and judges its tangent.
    fn arrive(&mut self, reached: Reached) -> Result<Found, NewtonError> {
        let mut u = reached.u;
        let mut report = self.newton.solve_by_full_steps(&mut u, &reached.loads)?;
        report.iterations += reached.linear.len();
        report.linear = [reached.linear, report.linear].concat();
        report.step_lengths = [reached.step_lengths, report.step_lengths].concat();
        report.history = reached.history.followed_by(report.history);
        match self.judge() {
            Ok(judged) => Ok(Found { u, start: None, report, judged }),
            Err(failure) => Err(NewtonError { failure, history: report.history }),
        }
    }
}

#[cfg(test)]
mod tests;
