//! An equilibrium at a given distance from the last.
//!
//! Equilibrium and distance are solved by Newton's method together: the body answers to the residual by `a`
//! and to the rate of what drives it by `b`, so a step is `a + b dt`, with `dt` by the linearised distance.

use piola_mechanics::energy::NonFinite;
use piola_mechanics::vector::{dot, norm_of};

use super::Way;
use crate::Event;
use crate::line_search::{LineSearch, Trial};
use crate::linear::LinearReport;
use crate::newton::{Distance, History, NewtonError, NewtonFailure};
use crate::steps::breaking::{Fracturing, Tried};
use crate::steps::{LoadSteps, StepError, smaller_may_help};

/// Rates by `t` are differences over this share of the end.
const STEP_OF_RATES: f64 = 1e-6;

/// How far a step goes need not be exact: within this share.
const HOW_FAR: f64 = 0.01;

/// Derivatives of what is dissipated are differences over this part of the way.
const STEP_OF_DISSIPATION: f64 = 1e-4;

/// A start goes at most so many times as far as the last step.
const FARTHEST_START: f64 = 2.0;

/// A step by what it dissipates goes at most so many times as far as one by its length.
const FARTHEST: f64 = 4.0;

/// How far a step goes.
#[derive(Clone, Copy)]
pub(super) struct Far {
    /// The part of a full step.
    pub(super) part: f64,
    pub(super) full: Full,
}

/// How far a full step goes.
#[derive(Clone, Copy)]
pub(super) enum Full {
    /// 2-norm of the displacements from the last equilibrium, in m.
    Length(f64),
    /// What bonds that remember lose on the way, in J.
    Dissipated(f64),
}

/// How far steps of Newton's method go.
#[derive(Clone, Copy, PartialEq)]
enum Steps {
    Full,
    /// As far as they lead closer.
    Closer,
}

/// An equilibrium on the way, and what led to it.
pub(super) struct Reached {
    pub(super) t: f64,
    pub(super) u: Vec<f64>,
    pub(super) loads: Vec<f64>,
    /// In J.
    pub(super) dissipated: f64,
    pub(super) history: History,
    pub(super) linear: Vec<LinearReport>,
    pub(super) step_lengths: Vec<f64>,
}

/// A state on the way to an equilibrium.
struct Place {
    t: f64,
    u: Vec<f64>,
    loads: Vec<f64>,
    distance: Distance,
    /// How far it is from the last equilibrium, over how far it is to be.
    part: f64,
}

impl Place {
    /// How far it is from an equilibrium at the distance that is wanted, in N.
    fn missed(&self) -> f64 {
        let Distance { residual, force, .. } = self.distance;
        libm::hypot(residual, force * (self.part - 1.0))
    }

    fn is_there(&self) -> bool {
        self.distance.is_small && (self.part - 1.0).abs() <= HOW_FAR
    }

    fn over_force(&self) -> f64 {
        let Distance { residual, force, .. } = self.distance;
        if residual == 0.0 { 0.0 } else { residual / force }
    }
}

/// A step of Newton's method, in `t` and in m.
type Step = (f64, Vec<f64>);

/// What may be had, or why not; or else an input that is wrong.
type Searched<T> = Result<Result<T, NewtonFailure>, StepError>;

impl LoadSteps<'_> {
    /// The equilibrium so far from the last one, onwards: by full steps, which find the way around sharp bends,
    /// else by steps that lead closer, which settle which bonds soften and which are unloaded.
    pub(super) fn reach(&mut self, far: Far) -> Tried<Reached> {
        match self.reach_by(far, Steps::Full)? {
            Err(cause) if smaller_may_help(&cause.failure) => self.reach_by(far, Steps::Closer),
            reached => Ok(reached),
        }
    }

    fn reach_by(&mut self, far: Far, steps: Steps) -> Tried<Reached> {
        let (mut history, mut linear, mut step_lengths) =
            (History::default(), Vec::new(), Vec::new());
        let way = (far, steps);
        let reached = self.iterate(way, &mut history, &mut linear, &mut step_lengths)?;
        let reached = reached.and_then(|Place { t, u, loads, .. }| {
            let dissipated = self.dissipated(&u)?;
            self.goes_on(far, t, &u, dissipated)?;
            Ok((t, u, loads, dissipated))
        });
        Ok(match reached {
            Ok((t, u, loads, dissipated)) => {
                Ok(Reached { t, u, loads, dissipated, history, linear, step_lengths })
            }
            Err(failure) => Err(NewtonError { failure, history }),
        })
    }

    fn iterate(
        &mut self,
        (far, steps): (Far, Steps),
        history: &mut History,
        linear: &mut Vec<LinearReport>,
        step_lengths: &mut Vec<f64>,
    ) -> Searched<Place> {
        self.watch.notice(Event::Start);
        let (t, u) = self.onwards(far);
        let mut place = match self.place((t, &u), &self.u.clone(), far)? {
            Ok(place) => place,
            Err(failure) => return Ok(Err(failure)),
        };
        let most = self.settings.newton.max_iterations;
        for iterations in 0..=most {
            let over_reaction = place.over_force();
            history.residual.push(place.distance.residual);
            history.residual_over_reaction.push(over_reaction);
            self.watch.notice(Event::Residual { iterations, over_reaction });
            if place.is_there() {
                return Ok(Ok(place));
            }
            if self.watch.wants_end() {
                return Ok(Err(NewtonFailure::Interrupted));
            }
            let step = match self.step_along(&place, far, linear)? {
                Ok(step) => step,
                Err(failure) => return Ok(Err(failure)),
            };
            match self.go(&place, &step, (far, steps))? {
                Ok((gone, length)) => {
                    place = gone;
                    step_lengths.push(length);
                }
                Err(failure) => return Ok(Err(failure)),
            }
        }
        Ok(Err(NewtonFailure::Iterations { limit: most }))
    }

    /// Where the line through the last two equilibria leads.
    fn onwards(&self, far: Far) -> (f64, Vec<f64>) {
        let Some(Way { t, u, dissipated, .. }) = &self.way else {
            return (self.t, self.u.clone());
        };
        let scale = match far.full {
            Full::Length(length) => far.part * length / norm_of(u),
            Full::Dissipated(energy) => match far.part * energy / dissipated {
                scale if scale <= FARTHEST_START => scale,
                // The last one dissipated next to nothing.
                _ => far.part,
            },
        };
        (self.t + scale * t, plus(&self.u, scale, u))
    }

    /// Refuses the way back: a step in the other direction, and one on which bonds that remember are unloaded;
    /// and another way, which begins far off.
    fn goes_on(&self, far: Far, t: f64, u: &[f64], dissipated: f64) -> Result<(), NewtonFailure> {
        let Some(last) = &self.way else { return Ok(()) };
        let way = plus(u, -1.0, &self.u);
        let is_onwards = match far.full {
            Full::Length(_) => {
                let is_loaded = !self.remembers() || dissipated > 0.0 || t > self.t;
                is_loaded && dot(&way, &last.u) > 0.0
            }
            Full::Dissipated(_) => norm_of(&way) <= FARTHEST * last.length,
        };
        if is_onwards { Ok(()) } else { Err(NewtonFailure::WayLost) }
    }

    /// A state near the way, reached from displacements `from`.
    fn place(&mut self, (t, u): (f64, &[f64]), from: &[f64], far: Far) -> Searched<Place> {
        let (loads, u) = (self.loads(t)?, self.with_prescribed(u, t)?);
        let placed = self.newton.check_jump(from, &u).map_err(|cause| cause.failure);
        let placed = placed.and_then(|()| {
            let distance = self.newton.distance(&u, &loads)?;
            let part = match far.full {
                Full::Length(length) => norm_of(&plus(&u, -1.0, &self.u)) / length,
                Full::Dissipated(energy) => self.dissipated(&u)? / energy,
            };
            Ok(Place { t, u, loads, distance, part: part / far.part })
        });
        Ok(placed)
    }

    /// What bonds that remember lose on the way from the last equilibrium to displacements `u`, in J.
    fn dissipated(&self, u: &[f64]) -> Result<f64, NonFinite> {
        let Some(memory) = self.fracture.as_ref().and_then(Fracturing::memory) else {
            return Ok(0.0);
        };
        let states = memory.states();
        let release = memory.evolve([&self.u, u], 0.0);
        memory.remember(&states);
        memory.follow(Some(0.0));
        Ok(release?.dissipated)
    }

    /// A step of Newton's method for equilibrium and distance.
    fn step_along(
        &mut self,
        place: &Place,
        far: Far,
        linear: &mut Vec<LinearReport>,
    ) -> Searched<Step> {
        let Place { t, u, loads, .. } = place;
        // Inwards, where nothing is known of what is prescribed beyond the end.
        let h = (STEP_OF_RATES * self.settings.end).copysign(-t);
        let (after, loads_after) = (self.with_prescribed(u, t + h)?, self.loads(t + h)?);
        let (jump, change) = (plus(&after, -1.0, u), plus(&loads_after, -1.0, loads));
        let step = self.newton.answers(u, loads, (&jump, &change)).and_then(|answers| {
            linear.push(answers.linear);
            let driven = answers.driven.iter().zip(&jump);
            let rate: Vec<f64> = driven.map(|(free, jump)| (free + jump) / h).collect();
            let closer = answers.closer;
            let slopes = [&closer, &rate].map(|direction| self.slope(place, far, direction));
            let [by_closer, by_rate] = slopes;
            let dt = (1.0 - place.part - by_closer?) / by_rate?;
            match dt.is_finite() {
                true => Ok((dt, plus(&closer, dt, &rate))),
                false => Err(NewtonFailure::WayLost),
            }
        });
        Ok(step)
    }

    /// The derivative in a direction of how far a place is, over how far it is to be.
    fn slope(&self, place: &Place, far: Far, direction: &[f64]) -> Result<f64, NonFinite> {
        let way = plus(&place.u, -1.0, &self.u);
        match far.full {
            Full::Length(length) => Ok(dot(&way, direction) / (norm_of(&way) * far.part * length)),
            Full::Dissipated(energy) => {
                let size = norm_of(direction);
                if size == 0.0 {
                    return Ok(0.0);
                }
                let h = STEP_OF_DISSIPATION * norm_of(&way) / size;
                let beyond = self.dissipated(&plus(&place.u, h, direction))? / (far.part * energy);
                Ok((beyond - place.part) / h)
            }
        }
    }

    /// Goes along a step, as far as it leads closer where that is asked for: where that is, and which part it is.
    fn go(
        &mut self,
        from: &Place,
        (dt, step): &Step,
        (far, steps): (Far, Steps),
    ) -> Searched<(Place, f64)> {
        let trial = |residual| Trial { potential: f64::NAN, slope: 0.0, residual };
        let mut search = LineSearch::new(trial(from.missed()), 0.0, from.distance.floor);
        let mut failure = NewtonFailure::LineSearch { negative_pivots: None };
        while let Some(length) = search.next_length() {
            let u = plus(&from.u, length, step);
            let placed = self.place((from.t + length * dt, &u), &from.u, far)?;
            let is_enough = steps == Steps::Full
                || search.accepts(placed.as_ref().ok().map(|place| trial(place.missed())));
            if is_enough {
                return Ok(placed.map(|place| (place, length)));
            }
            if let Err(cause) = placed {
                failure = cause;
            }
        }
        Ok(Err(failure))
    }
}

/// `x + factor y`.
pub(super) fn plus(x: &[f64], factor: f64, y: &[f64]) -> Vec<f64> {
    x.iter().zip(y).map(|(x, y)| x + factor * y).collect()
}
