//! Load steps by events: `t` is found where the next bond, triangle or tetrahedron breaks, and falls where a
//! body snaps back.
//!
//! Between two events the status does not change, and the largest margin is a smooth function of `t` along
//! the equilibria. It is 0 at the event. Behind it, at the same `t`, what is left of the body has other
//! margins: where one is above 0 the next event lies at a smaller `t`, else at a larger one. The body
//! linearised at the last equilibrium says where, which is exact where the response is linear; the equilibrium
//! there says how exactly, and so on, with the event between the two last `t` once it has been passed.

use super::breaking::{Before, NOTHING, Rested, Tried, not_judged};
use super::memory::Evolved;
use super::{Attempt, Event, Found, LoadSteps, NotGiven, StepError, StepRecord, smaller_may_help};
use crate::march::Advance;
use crate::newton::{History, NewtonError, NewtonFailure};

/// A margin is 0 where its amount is at most this of that at rest.
const ON_THRESHOLD: f64 = 1e-9;

/// Equilibria on the way to an event, at most.
const MOST_EQUILIBRIA: usize = 60;

/// How close two `t` are, relative to the larger, where a margin jumps between them.
const JUMP: f64 = 1e-13;

/// How often a way to an equilibrium is halved where Newton's method fails.
const MOST_HALVINGS: usize = 10;

/// Halvings on the way to where a margin is 0 in the linearised body.
const HALVINGS: usize = 60;

/// An equilibrium on the way.
struct Place {
    t: f64,
    u: Vec<f64>,
    loads: Vec<f64>,
    /// The largest margin; below all others where nothing can break.
    margin: f64,
}

/// Where a search ends.
struct Reached {
    place: Place,
    rested: Option<Rested>,
    /// Whether anything breaks there; else it is a nominal time.
    is_event: bool,
}

impl<'a> LoadSteps<'a> {
    /// The next event, or the next nominal time where nothing breaks before.
    pub(super) fn advance_by_events(&mut self) -> Result<Advance<StepRecord>, StepError> {
        if self.is_over() {
            return Ok(Advance::End);
        }
        if self.watch.wants_end() {
            return Ok(Advance::Interrupted);
        }
        let Some(before) = self.before_breaking() else { return Ok(Advance::End) };
        let found = self.next_event(before);
        self.times.add(&self.newton.take_times());
        match found? {
            Ok((found, loads, t, is_event)) => {
                let passed = if is_event { 0 } else { self.passed(t) };
                let is_new = passed > self.nominal;
                self.nominal = self.nominal.max(passed);
                match self.take(found, loads, t, is_new)? {
                    Attempt::Converged(record) => Ok(Advance::Step(*record)),
                    Attempt::Failed(cause) => Err(self.not_converged(t, cause)),
                }
            }
            Err(cause) if cause.failure == NewtonFailure::Interrupted => Ok(Advance::Interrupted),
            Err(cause) => {
                let t = self.t;
                Err(self.not_converged(t, cause))
            }
        }
    }

    fn is_over(&self) -> bool {
        let Some(fracture) = &self.fracture else { return true };
        let ledger = &fracture.ledger;
        self.nominal >= self.settings.increments
            || ledger.events >= self.settings.breaking.events
            || ledger.events > 0 && ledger.energy <= NOTHING * ledger.most
    }

    /// The state behind the next event, with its loads and its time, and whether anything broke there.
    fn next_event(&mut self, before: Before) -> Tried<(Found, Vec<f64>, f64, bool)> {
        let reached = match self.locate()? {
            Ok(reached) => reached,
            Err(cause) => return self.undo(before, cause),
        };
        let Reached { place, rested, is_event } = reached;
        let rested = rested.map_or_else(|| self.rest_here(&place), Ok);
        let (u, report) = match rested {
            Ok(rested) => rested,
            Err(cause) => return self.undo(before, cause),
        };
        self.follow(&u, &report, (&place.loads, Evolved::default()));
        let mut found = Found { u, start: None, report, judged: not_judged("event") };
        if is_event {
            match self.break_foremost(&found, &place)? {
                Ok((u, report)) => (found.u, found.report) = (u, report),
                Err(cause) => return self.undo(before, cause),
            }
        }
        match self.judge() {
            Ok(judged) => found.judged = judged,
            Err(failure) => {
                return self.undo(before, NewtonError { failure, history: History::default() });
            }
        }
        Ok(Ok((found, place.loads, place.t, is_event)))
    }

    /// Breaks the foremost at an equilibrium; that of what is left.
    fn break_foremost(&mut self, found: &Found, place: &Place) -> Tried<Rested> {
        let (tie, most) = (self.settings.breaking.tie, self.settings.breaking.events);
        let Some(fracture) = &mut self.fracture else {
            return Ok(Ok((found.u.clone(), found.report.clone())));
        };
        let status = fracture.status;
        let foremost = status.foremost(&found.u, tie);
        let release = foremost.and_then(|first| match first {
            Some(first) => status.break_at(&found.u, &first.which),
            None => Ok(Default::default()),
        });
        let release = match release {
            Ok(release) => release,
            Err(cause) => return Ok(Err(cause.into())),
        };
        fracture.ledger.events += 1;
        if fracture.ledger.events == most {
            let note = format!("the run ends after {most} events, the most that `events` allows");
            fracture.ledger.notes.push(note);
        }
        let rested = self.rest_again(&found.u, release, &place.loads, place.t)?;
        if let (Ok((_, report)), Some(fracture)) = (&rested, &mut self.fracture)
            && report.energy.total() <= NOTHING * fracture.ledger.most
        {
            fracture.ledger.notes.push("the body is cut through: it carries nothing".to_owned());
        }
        Ok(rested)
    }

    /// A present state as an equilibrium: nothing moves.
    fn rest_here(&mut self, place: &Place) -> Result<Rested, NewtonError> {
        let mut u = place.u.clone();
        let report = self.newton.solve(&mut u, &place.loads)?;
        Ok((u, report))
    }

    /// Finds where the next event is.
    fn locate(&mut self) -> Tried<Reached> {
        let mut here = Place {
            t: self.t,
            u: self.u.clone(),
            loads: self.loads.clone(),
            margin: match self.margin(&self.u) {
                Ok(margin) => margin,
                Err(cause) => return Ok(Err(cause)),
            },
        };
        let rises = here.margin <= ON_THRESHOLD;
        let limit = if rises { self.nominal_after(here.t) } else { 0.0 };
        // Where nothing breaks, and where something does, as far as is known.
        let mut within: [Option<f64>; 2] =
            if rises { [Some(here.t), None] } else { [None, Some(here.t)] };
        let mut rested = None;
        for k in 0..MOST_EQUILIBRIA {
            // Where behind an event the margin is 0 at once, the next one breaks at the same t.
            let jumps = matches!(within, [Some(low), Some(high)] if (high - low).abs() <= JUMP * high.abs());
            let is_at = here.margin.abs() <= ON_THRESHOLD || jumps && here.margin > 0.0;
            let is_first = k == 0 && rises && here.margin < -ON_THRESHOLD;
            if is_at && !is_first || here.t == 0.0 && here.margin > 0.0 {
                return Ok(Ok(Reached { place: here, rested, is_event: true }));
            }
            let is_below = here.margin <= 0.0;
            if k > 0 && rises && is_below && here.t == limit {
                return Ok(Ok(Reached { place: here, rested, is_event: false }));
            }
            let far = within[usize::from(is_below)];
            match self.approach(&here, far.unwrap_or(limit), far.is_some())? {
                Ok((place, found)) => (here, rested) = (place, Some(found)),
                Err(cause) => return Ok(Err(cause)),
            }
            within[usize::from(here.margin > 0.0)] = Some(here.t);
        }
        Ok(Err(NewtonError {
            failure: NewtonFailure::Iterations { limit: MOST_EQUILIBRIA },
            history: History::default(),
        }))
    }

    /// The equilibrium where, on the way to `far`, the largest margin of the linearised body is 0; at `far`,
    /// or halfway where that `is_known`, if it is 0 nowhere.
    fn approach(&mut self, from: &Place, far: f64, is_known: bool) -> Tried<(Place, Rested)> {
        let end = self.with_prescribed(&from.u, far)?;
        let jump: Vec<f64> = end.iter().zip(&from.u).map(|(new, old)| new - old).collect();
        let loads = self.loads(far)?;
        let step = match self.newton.response(&from.u, &jump, &loads) {
            Ok((answer, _)) => jump.iter().zip(&answer).map(|(p, q)| p + q).collect::<Vec<f64>>(),
            Err(failure) => {
                return Ok(Err(NewtonError { failure, history: History::default() }));
            }
        };
        let mut part = match self.zero_along(from, &step) {
            Ok(Some(part)) => part,
            Ok(None) => {
                if is_known {
                    0.5
                } else {
                    1.0
                }
            }
            Err(cause) => return Ok(Err(cause)),
        };
        let mut failed = None;
        for _ in 0..MOST_HALVINGS {
            let t = if part == 1.0 { far } else { from.t + part * (far - from.t) };
            match self.rest_at(from, &step, part, t)? {
                Ok(found) => return Ok(Ok(found)),
                Err(cause) if !smaller_may_help(&cause.failure) => return Ok(Err(cause)),
                Err(cause) => {
                    self.watch.notice(Event::CutBack { t, cause: &cause });
                    failed = Some(cause);
                }
            }
            self.cut_backs += 1;
            self.all_cut_backs += 1;
            part *= 0.5;
        }
        Ok(Err(failed.unwrap_or_else(|| NewtonError {
            failure: NewtonFailure::Iterations { limit: MOST_HALVINGS },
            history: History::default(),
        })))
    }

    /// The part of a step at which the largest margin is 0, on the last stretch before that; nothing where it
    /// has the same sign at both ends.
    fn zero_along(&self, from: &Place, step: &[f64]) -> Result<Option<f64>, NewtonError> {
        let at = |part: f64| {
            let u: Vec<f64> = from.u.iter().zip(step).map(|(u, step)| u + part * step).collect();
            self.margin(&u)
        };
        let (mut low, mut high) = ((0.0, from.margin), (1.0, at(1.0)?));
        if (low.1 > 0.0) == (high.1 > 0.0) {
            return Ok(None);
        }
        // The rule of false position; where one end stays, its value counts half (Illinois).
        let mut kept = 0_i32;
        for _ in 0..HALVINGS {
            let share = low.1 / (low.1 - high.1);
            let part = low.0 + share.clamp(1e-3, 1.0 - 1e-3) * (high.0 - low.0);
            let margin = at(part)?;
            if margin.abs() <= 0.1 * ON_THRESHOLD || high.0 - low.0 <= JUMP {
                return Ok(Some(part));
            }
            if (margin > 0.0) == (low.1 > 0.0) {
                low = (part, margin);
                high.1 *= if kept == 1 { 0.5 } else { 1.0 };
                kept = 1;
            } else {
                high = (part, margin);
                low.1 *= if kept == -1 { 0.5 } else { 1.0 };
                kept = -1;
            }
        }
        Ok(Some(high.0))
    }

    /// The equilibrium at `t`, looked for from a part of a step.
    fn rest_at(&mut self, from: &Place, step: &[f64], part: f64, t: f64) -> Tried<(Place, Rested)> {
        self.watch.notice(Event::Attempt(t));
        if self.drive.begin(t).map_err(|NotGiven| StepError::Given { t })? {
            self.newton.forget();
        }
        let loads = self.loads(t)?;
        let guess: Vec<f64> = from.u.iter().zip(step).map(|(u, step)| u + part * step).collect();
        let mut u = self.with_prescribed(&guess, t)?;
        self.watch.notice(Event::Start);
        let solved = self.newton.check_jump(&from.u, &u);
        let solved = solved.and_then(|()| self.newton.solve(&mut u, &loads));
        let report = match solved {
            Ok(report) => report,
            Err(cause) => return Ok(Err(cause)),
        };
        let margin = match self.margin(&u) {
            Ok(margin) => margin,
            Err(cause) => return Ok(Err(cause)),
        };
        Ok(Ok((Place { t, u: u.clone(), loads, margin }, (u, report))))
    }

    /// The largest margin of all that is left.
    fn margin(&self, u: &[f64]) -> Result<f64, NewtonError> {
        let Some(fracture) = &self.fracture else { return Ok(f64::NEG_INFINITY) };
        let first = fracture.status.foremost(u, 0.0)?;
        Ok(first.map_or(f64::NEG_INFINITY, |first| first.margin))
    }

    /// The first nominal time beyond `t`.
    fn nominal_after(&self, t: f64) -> f64 {
        let all = 1..=self.settings.increments;
        let mut later = all.map(|k| self.nominal_time(k)).filter(|nominal| *nominal > t);
        later.next().unwrap_or(self.settings.end)
    }
}
