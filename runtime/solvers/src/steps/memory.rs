//! Bonds that remember, at load steps.
//!
//! On the way to an equilibrium bonds come to remember something else with every step of Newton's method
//! ([`Fracture::follow`]), and remember it once it is found. Where none is found that way, as where softening
//! bonds carry less the further they are stretched, they take turns: an equilibrium with what bonds
//! remember, then what they come to remember there, and again, at the same loads. So does all that energies
//! cannot follow: what is remembered with deformation gradients, or by points.

use piola_mechanics::fracture::Release;

use super::breaking::{Control, Fracturing, Rested, Tried};
use super::{Found, LoadSteps, smaller_may_help};
use crate::newton::{NewtonError, NewtonReport};

/// Most turns at one load.
const MOST_ROUNDS: usize = 10_000;

/// After so many rounds of turns, and after twice as many each time, the equilibrium is looked for once more
/// with bonds that follow.
const FIRST_TRY: usize = 4;

/// What bonds that remember lost at an equilibrium, in J.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Evolved {
    pub(super) dissipated: f64,
    /// How much less is stored than was found at the equilibrium.
    pub(super) behind: f64,
}

impl Fracturing<'_> {
    /// Whether bonds have another turn after an equilibrium: some came to remember something else there, and
    /// it is not where the one before was.
    pub(super) fn goes_on(&mut self, report: &NewtonReport, round: usize) -> bool {
        let is_another = report.iterations > 0 || round == 1;
        let moves = self.takes_turns && self.has_changed && is_another;
        if moves && round == MOST_ROUNDS {
            let residual = report.history.residual.last().copied().unwrap_or_default();
            self.ledger.notes.push(format!(
                "what is remembered does not settle in {MOST_ROUNDS} rounds: the last began with a residual of {residual:.2e} N"
            ));
        }
        moves && round < MOST_ROUNDS
    }
}

impl LoadSteps<'_> {
    /// Whether bonds remember anything.
    pub(super) fn remembers(&self) -> bool {
        self.fracture.as_ref().and_then(Fracturing::memory).is_some()
    }

    /// Whether energies follow all that is remembered.
    fn can_follow(&self) -> bool {
        self.fracture.as_ref().is_none_or(|fracture| fracture.status.can_follow())
    }

    /// What passes until `t`; nothing along the way, on which `t` is what drives the body alone.
    pub(super) fn elapsed(&self, t: f64) -> f64 {
        match self.settings.breaking.control {
            Control::ArcLength => 0.0,
            Control::Load | Control::Event => t - self.t,
        }
    }

    /// Lets bonds come to remember something else in `dt` s on the way to the next equilibrium, or hold what
    /// they remember.
    pub(super) fn follow_memory(&mut self, dt: Option<f64>) {
        if let Some(memory) = self.fracture.as_ref().and_then(Fracturing::memory) {
            memory.follow(dt);
            self.newton.forget();
        }
    }

    /// Holds what bonds remember, and ends their turns.
    pub(super) fn hold_memory(&mut self) {
        if let Some(fracture) = &mut self.fracture {
            fracture.takes_turns = false;
        }
        self.follow_memory(None);
    }

    /// From now on bonds take turns, or they follow in no time.
    pub(super) fn take_turns(&mut self, takes_turns: bool) {
        if let Some(fracture) = &mut self.fracture {
            fracture.takes_turns = takes_turns;
        }
        self.follow_memory((!takes_turns).then_some(0.0));
    }

    fn takes_turns(&self) -> bool {
        self.fracture.as_ref().is_some_and(|fracture| fracture.takes_turns)
    }

    /// Bonds remember what they come to at an equilibrium, `dt` s after the last one. Where they held what
    /// they remembered on the way there, the energy falls once it is found, by all that is dissipated.
    pub(super) fn evolve(
        &mut self,
        from: &[f64],
        to: &[f64],
        dt: f64,
    ) -> Result<Evolved, NewtonError> {
        let takes_turns = self.takes_turns();
        let memory = self.fracture.as_ref().and_then(Fracturing::memory);
        let Some(memory) = memory else { return Ok(Evolved::default()) };
        let from = if takes_turns { to } else { from };
        let Release { dissipated, changed, .. } = memory.evolve([from, to], dt)?;
        if let Some(fracture) = &mut self.fracture {
            fracture.has_changed = changed > 0;
        }
        if takes_turns {
            return Ok(Evolved { dissipated, behind: dissipated });
        }
        // Rounds that follow are at the same time.
        memory.follow(Some(0.0));
        Ok(Evolved { dissipated, behind: 0.0 })
    }

    /// The equilibrium at `t` with what breaks there, from displacements `last` on. Bonds that remember take
    /// turns where none is found on which they follow, and where it is not stable: a body leaves such a one.
    /// It is taken where turns lead nowhere.
    pub(super) fn settled(&mut self, last: Vec<f64>, loads: &[f64], t: f64) -> Tried<Found> {
        if !self.remembers() {
            return self.found_and_settled(last, loads, t);
        }
        if !self.can_follow() {
            let settled = self.by_turns(last, loads, t)?;
            self.hold_memory();
            return Ok(settled);
        }
        self.follow_memory(Some(self.elapsed(t)));
        let found = self.search(last.clone(), loads, t);
        let is_stable = |found: &Found| found.judged.0.positive_definite != Some(false);
        let settled = match found {
            Ok(found) if is_stable(&found) => self.settle(found, loads, t)?,
            Ok(_) => {
                let by_turns = self.by_turns(last.clone(), loads, t)?;
                if by_turns.as_ref().is_err_and(|cause| smaller_may_help(&cause.failure)) {
                    self.hold_memory();
                    self.follow_memory(Some(self.elapsed(t)));
                    self.found_and_settled(last, loads, t)?
                } else {
                    by_turns
                }
            }
            Err(cause) if smaller_may_help(&cause.failure) => self.by_turns(last, loads, t)?,
            Err(cause) => Err(cause),
        };
        self.hold_memory();
        Ok(settled)
    }

    fn found_and_settled(&mut self, last: Vec<f64>, loads: &[f64], t: f64) -> Tried<Found> {
        match self.search(last, loads, t) {
            Ok(found) => self.settle(found, loads, t),
            Err(cause) => Ok(Err(cause)),
        }
    }

    /// The equilibrium at `t` by turns, from displacements `last` on.
    fn by_turns(&mut self, last: Vec<f64>, loads: &[f64], t: f64) -> Tried<Found> {
        self.take_turns(true);
        self.found_and_settled(last, loads, t)
    }

    /// The equilibrium of what is left at the same loads, where this is the round of that number: by turns
    /// where there is no other.
    pub(super) fn rest(
        &mut self,
        from: &[f64],
        release: Release,
        (loads, t): (&[f64], f64),
        round: usize,
    ) -> Tried<Rested> {
        let may_do_without = self.can_follow() && round >= FIRST_TRY && round.is_power_of_two();
        if self.takes_turns() && may_do_without {
            self.take_turns(false);
            // Where it is not stable turns lead away from it.
            if let Ok(again) = self.solve_again(from, loads, t)?
                && self.newton.judge().is_ok_and(|judged| judged.positive_definite == Some(true))
            {
                return Ok(self.book(from, again, release, loads));
            }
            self.take_turns(true);
        }
        match self.rest_again(from, release, loads, t)? {
            Err(cause)
                if self.remembers() && !self.takes_turns() && smaller_may_help(&cause.failure) =>
            {
                self.take_turns(true);
                self.rest_again(from, release, loads, t)
            }
            rested => Ok(rested),
        }
    }
}
