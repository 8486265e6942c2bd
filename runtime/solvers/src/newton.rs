//! Newton's method: a stationary point of the potential `Pi(u) = E(u) - f.u` over the free degrees
//! of freedom, the fixed ones having their prescribed values already.
//!
//! The residual is `dE/du - f`: on free degrees of freedom it must vanish, on fixed ones it is the
//! reaction. The state is converged when the 2-norm of the free residual is at most `tolerance`
//! times the larger of the 2-norms of the reactions and of the loads.
//!
//! A full step is tried first, and its tangent assembled at once: in benign cases it is the next
//! iteration's, and at convergence it is the one that is judged. The module `line_search` says what
//! happens otherwise. Modified Newton assembles forces alone and goes on with the tangent it has,
//! as long as that serves.

mod along;
mod constrain;
mod judge;
mod relaxation;

use std::cell::Cell;

use super::clock::{Counters, PhaseTimes, timed};
use super::constraint::Constraints;
use super::forcing::Forcing;
use super::held::HeldTangent;
use super::line_search::{LineSearch, Trial};
use super::linear::{LinearError, LinearOptions, LinearReport, LinearSolver, Tangent};
pub use super::newton_outcome::{History, NewtonError, NewtonFailure, NewtonReport};
use super::watch::{Event, Watch};
pub(crate) use along::Distance;
use piola_mechanics::energy::{Energy, EnergyParts, NonFinite, Wanted, magnitude, total};
use piola_mechanics::vector::{dot, norm, norm_of};
use piola_mechanics::words::Words;

/// Unit roundoff of f64.
const ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// A residual is taken as rounding below this multiple of `u |K| |u|`: rounding the displacements
/// alone changes the forces by that much, and sums of some 100 terms by a few times more.
const ROUNDING_MULTIPLE: f64 = 8.0;

/// Modified Newton takes a new tangent where a step left more than this of the residual: three such
/// steps cost about what a tangent costs, and then it gains more.
const SERVES: f64 = 0.2;

/// How much of each Newton step is new.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NewtonVariant {
    /// A tangent and an exact solution for every step: converges quadratically.
    #[default]
    Full,
    /// Linear systems are solved only as exactly as pays (conjugate gradients only).
    Inexact,
    /// The tangent and its factors are kept as long as the residual falls by a factor of 5 a step.
    Modified,
}

impl Words for NewtonVariant {
    const WORDS: &'static [(&'static str, NewtonVariant)] = &[
        ("full", NewtonVariant::Full),
        ("inexact", NewtonVariant::Inexact),
        ("modified", NewtonVariant::Modified),
    ];
}

/// Choices for Newton's method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewtonSettings {
    /// Free residual over the larger of reactions and loads (2-norms) at convergence.
    pub tolerance: f64,
    /// More iterations than this are a failure.
    pub max_iterations: usize,
    /// What a step takes.
    pub variant: NewtonVariant,
}

impl Default for NewtonSettings {
    fn default() -> Self {
        NewtonSettings { tolerance: 1e-10, max_iterations: 25, variant: NewtonVariant::Full }
    }
}

/// A step made longer, so that no interaction turns inside out on more than 0.9 of the way to the
/// turn: the part of the longer step to the turn is the part of the step that may be gone.
fn beyond(step: &[f64]) -> Vec<f64> {
    step.iter().map(|x| x / 0.9).collect()
}

/// Newton's method for one energy and one set of fixed degrees of freedom.
///
/// Keeps the tangent, its factors and the state they belong to from one solve to the next.
pub struct Newton<'a> {
    energy: &'a dyn Energy,
    constraints: Constraints,
    settings: NewtonSettings,
    linear: LinearSolver,
    tangent: HeldTangent<'a>,
    gradient: Vec<f64>,
    /// The parts of the energy there, in J.
    parts: Vec<f64>,
    /// The displacements of `gradient`.
    evaluated_at: Option<Vec<f64>>,
    /// The rounding error of the forces there, once it is asked for.
    rounding: Cell<Option<f64>>,
    forcing: Forcing,
    /// 2-norm of the right-hand side of the linear system that led to the start in N, where one did.
    started_from: Option<f64>,
    /// How exactly the next one is solved: its residual over its right-hand side.
    start_term: f64,
    /// What residuals are compared with beside reactions and loads, in N.
    scale: f64,
    /// Whether the energy is a potential of the forces.
    has_potential: bool,
    /// Whether a shorter step ends a solve.
    full_steps_only: bool,
    /// Whether the linear solver holds the factors of `tangent`.
    factorized: bool,
    counters: Counters,
    times: PhaseTimes,
    watch: Watch,
}

impl<'a> Newton<'a> {
    /// Does the symbolic part of the linear solver's work.
    pub fn new(
        energy: &'a dyn Energy,
        constraints: &Constraints,
        settings: NewtonSettings,
        linear: LinearOptions,
    ) -> Result<Newton<'a>, LinearError> {
        let mut linear = LinearSolver::of_energy(energy, constraints, linear)?;
        if energy.bond_pattern().is_some() {
            linear.may_store();
        }
        Ok(Newton {
            energy,
            constraints: constraints.clone(),
            settings,
            tangent: HeldTangent::new(energy, linear.stores_matrix()),
            linear,
            rounding: Cell::new(None),
            forcing: Forcing::new(settings.variant, settings.tolerance),
            started_from: None,
            start_term: Forcing::start(settings.variant),
            scale: 0.0,
            has_potential: true,
            full_steps_only: false,
            gradient: vec![0.0; constraints.n_dofs()],
            parts: vec![0.0; energy.parts().len()],
            evaluated_at: None,
            factorized: false,
            counters: Counters::default(),
            times: PhaseTimes::default(),
            watch: Watch::default(),
        })
    }

    /// From now on someone looks on: sees residuals and products, and may end a solve.
    pub fn watched(&mut self, watch: &Watch) {
        self.watch = watch.clone();
        self.linear.watched(watch.clone());
    }

    /// From now on residuals are compared with this, too, in N: where neither reactions nor loads tell how
    /// large forces are.
    pub fn compare_with(&mut self, scale: f64) {
        self.scale = scale;
    }

    /// From now on residuals alone say how far a step goes: forces may not be derivatives of the energy, as
    /// where bonds come to remember something else on the way.
    pub fn without_potential(&mut self) {
        self.has_potential = false;
    }

    /// The linear solver: its method and its estimate.
    pub fn linear(&self) -> &LinearSolver {
        &self.linear
    }

    /// `dE/du` in N at the displacements of the last solve, if that converged.
    pub fn internal_forces(&self) -> &[f64] {
        &self.gradient
    }

    /// What was evaluated and solved so far.
    pub fn counters(&self) -> Counters {
        let before = self.counters.factorizations;
        Counters { factorizations: before + self.linear.n_factorizations(), ..self.counters }
    }

    /// Forgets what was worked out of the energy: it is another one from now on.
    pub fn forget(&mut self) {
        self.evaluated_at = None;
        self.rounding.set(None);
        self.tangent.forget();
        self.factorized = false;
    }

    /// The same where little has gone from the body: factors of modified Newton that are dear serve on as long as the
    /// residual falls with them. What breaks at an event is a change of low rank; behind a round in which much breaks
    /// they soon do not serve, and are made anew.
    pub fn forget_all_but_factors(&mut self) {
        let serve = self.factorized && self.is_modified() && self.linear.has_dear_factors();
        self.forget();
        self.factorized = serve;
    }

    /// Time by phase since the last call.
    pub fn take_times(&mut self) -> PhaseTimes {
        std::mem::take(&mut self.times)
    }

    /// Refuses a jump from `from` to `to` that goes more than 0.9 of the way to where an interaction
    /// is turned inside out that may not be.
    pub fn check_jump(&self, from: &[f64], to: &[f64]) -> Result<(), NewtonError> {
        let jump: Vec<f64> = to.iter().zip(from).map(|(to, from)| to - from).collect();
        match self.energy.first_inversion(from, &beyond(&jump)) {
            None => Ok(()),
            Some(inversion) => {
                Err(NewtonError { failure: inversion.first.into(), history: History::default() })
            }
        }
    }

    /// Moves the free entries of `u` to equilibrium with `loads` (both `n x d`).
    ///
    /// After a failure `u` is undefined.
    pub fn solve(&mut self, u: &mut [f64], loads: &[f64]) -> Result<NewtonReport, NewtonError> {
        self.full_steps_only = false;
        self.solve_with_history(u, loads)
    }

    /// The same, but gives up where a full step does not serve: the start is then not close, and
    /// shorter steps may lead to an equilibrium of another branch.
    pub fn solve_by_full_steps(
        &mut self,
        u: &mut [f64],
        loads: &[f64],
    ) -> Result<NewtonReport, NewtonError> {
        self.full_steps_only = true;
        self.solve_with_history(u, loads)
    }

    fn solve_with_history(
        &mut self,
        u: &mut [f64],
        loads: &[f64],
    ) -> Result<NewtonReport, NewtonError> {
        let mut history = History::default();
        match self.iterate(u, loads, &mut history) {
            Ok(mut report) => {
                report.history = history;
                Ok(report)
            }
            Err(failure) => Err(NewtonError { failure, history }),
        }
    }

    fn iterate(
        &mut self,
        u: &mut [f64],
        loads: &[f64],
        history: &mut History,
    ) -> Result<NewtonReport, NewtonFailure> {
        let mut report = NewtonReport {
            iterations: 0,
            history: History::default(),
            energy: EnergyParts::default(),
            linear: Vec::new(),
            step_lengths: Vec::new(),
            rounding_floor: 0.0,
            notes: Vec::new(),
        };
        self.forcing = Forcing::new(self.settings.variant, self.settings.tolerance);
        let started_from = self.started_from.take();
        // Modified Newton begins with the factors that it has.
        self.evaluate(u, !(self.is_modified() && self.factorized))?;
        if let Some(before) = started_from {
            self.forcing.started_from(before);
            let missed = self.residual_norm(loads) / before;
            self.start_term = Forcing::next_start(self.settings.variant, self.start_term, missed);
        }
        loop {
            let converged = self.is_converged(loads, history, &mut report.notes)?;
            self.tell(report.iterations, history);
            if converged {
                report.energy = EnergyParts::new(self.energy.parts(), self.parts.clone());
                report.rounding_floor = self.rounding_floor(loads);
                return Ok(report);
            }
            if report.iterations == self.settings.max_iterations {
                return Err(NewtonFailure::Iterations { limit: self.settings.max_iterations });
            }
            if self.watch.wants_end() {
                return Err(NewtonFailure::Interrupted);
            }
            let (direction, linear) = self.direction(loads)?;
            let negative_pivots = linear.negative_pivots;
            report.linear.push(linear);
            report.iterations += 1;
            let length = if self.is_modified() {
                self.modified_step(u, &direction, loads, negative_pivots)?
            } else {
                self.step(u, &direction, loads, negative_pivots)?
            };
            report.step_lengths.push(length);
            if self.full_steps_only && 0.0 < length && length < 1.0 {
                return Err(NewtonFailure::LineSearch { negative_pivots });
            }
        }
    }

    fn tell(&self, iterations: usize, history: &History) {
        if let Some(&over_reaction) = history.residual_over_reaction.last() {
            self.watch.notice(Event::Residual { iterations, over_reaction });
        }
    }

    fn is_modified(&self) -> bool {
        self.settings.variant == NewtonVariant::Modified
    }

    /// A step with a tangent that may be of another state; a new one where it does not serve. 0 if
    /// the step led nowhere.
    fn modified_step(
        &mut self,
        u: &mut [f64],
        direction: &[f64],
        loads: &[f64],
        negative_pivots: Option<usize>,
    ) -> Result<f64, NewtonFailure> {
        let is_own = self.tangent.is_at(u);
        let (start, before) = (u.to_vec(), self.residual_norm(loads));
        let length = match self.step(u, direction, loads, negative_pivots) {
            Err(_) if !is_own => {
                u.copy_from_slice(&start);
                0.0
            }
            stepped => stepped?,
        };
        let serves = length > 0.0 && self.residual_norm(loads) <= SERVES * before;
        self.evaluate(u, !serves)?;
        Ok(length)
    }

    /// Records the residual of the present state and compares it with the tolerance.
    fn is_converged(
        &self,
        loads: &[f64],
        history: &mut History,
        notes: &mut Vec<String>,
    ) -> Result<bool, NewtonFailure> {
        let residual = self.residual_norm(loads);
        let force = self.force(loads);
        let previous = history.residual.last().copied();
        history.residual.push(residual);
        history.residual_over_reaction.push(if residual == 0.0 { 0.0 } else { residual / force });
        if residual <= self.settings.tolerance * force {
            return Ok(true);
        }
        let floor = ROUNDING_MULTIPLE * self.rounding();
        if residual > floor {
            return Ok(false);
        }
        if force <= floor {
            notes.push("no forces: residual and reactions are rounding".to_string());
            return Ok(true);
        }
        // Within rounding, but it may fall further.
        match previous {
            Some(previous) if residual >= 0.5 * previous => {
                let tolerance = self.settings.tolerance;
                Err(NewtonFailure::RoundingFloor {
                    residual,
                    floor,
                    tolerance,
                    within: floor / force,
                })
            }
            _ => Ok(false),
        }
    }

    /// The change of the forces when the displacements are rounded, as a 2-norm over the free ones.
    fn rounding(&self) -> f64 {
        if let Some(rounding) = self.rounding.get() {
            return rounding;
        }
        let Some(u) = self.evaluated_at.as_deref() else { return 0.0 };
        let forces = self.tangent.multiply_absolute(u);
        let rounding = ROUNDOFF * norm(self.constraints.free().iter().map(|&dof| forces[dof]));
        self.rounding.set(Some(rounding));
        rounding
    }

    /// How the free points answer, to first order, when the fixed ones leave the equilibrium `u` by
    /// `jump` (0 elsewhere) and the loads become `loads`: the solution of
    /// `K du = loads - dE/du - K jump` with the tangent at `u`, 0 on the fixed degrees of freedom,
    /// and how it was found. The tangent that was judged at `u` serves with its factors.
    ///
    /// # Errors
    /// A tangent that is not finite or cannot be solved with.
    pub fn response(
        &mut self,
        u: &[f64],
        jump: &[f64],
        loads: &[f64],
    ) -> Result<(Vec<f64>, LinearReport), NewtonFailure> {
        self.evaluate(u, true)?;
        let mut forced = vec![0.0; u.len()];
        self.tangent.multiply(jump, &mut forced)?;
        let terms = loads.iter().zip(&self.gradient).zip(&forced);
        let rhs: Vec<f64> = terms.map(|((load, force), forced)| load - force - forced).collect();
        self.started_from = Some(norm(self.constraints.free().iter().map(|&dof| rhs[dof])));
        self.solve_linear(&rhs, self.start_term)
    }

    /// The Newton step `-K_ff^-1 R_f`, 0 on the fixed degrees of freedom.
    fn direction(&mut self, loads: &[f64]) -> Result<(Vec<f64>, LinearReport), NewtonFailure> {
        let minus_residual: Vec<f64> =
            loads.iter().zip(&self.gradient).map(|(f, g)| f - g).collect();
        let (residual, force) = (self.residual_norm(loads), self.force(loads));
        let tolerance = self.forcing.next(residual, force, self.rounding());
        self.solve_linear(&minus_residual, tolerance)
    }

    /// `K_ff^-1 b_f` with the tangent at hand, to a relative residual where the solver iterates.
    fn solve_linear(
        &mut self,
        rhs: &[f64],
        tolerance: f64,
    ) -> Result<(Vec<f64>, LinearReport), NewtonFailure> {
        let mut solution = vec![0.0; rhs.len()];
        // No more exactly than products are.
        self.linear.set_tolerance(tolerance.max(self.energy.products().error()));
        self.counters.linear_solves += 1;
        let report = self.with_tangent(|linear, tangent, factorized| {
            if !factorized {
                linear.factorize(tangent)?;
            }
            linear.solve_factorized(tangent, rhs, &mut solution)
        })?;
        Ok((solution, report))
    }

    /// Works with the linear solver on the tangent at hand, which it has prepared already or not. Where
    /// products with it turn out to be dearer than storing it, it is stored from then on.
    fn with_tangent<T>(
        &mut self,
        mut work: impl FnMut(&mut LinearSolver, Tangent<'_>, bool) -> Result<T, LinearError>,
    ) -> Result<T, NewtonFailure> {
        loop {
            let (linear, held) = (&mut self.linear, &self.tangent);
            let factorized = std::mem::replace(&mut self.factorized, true);
            let done = timed(&mut self.times.linear, || {
                Ok::<_, NewtonFailure>(work(linear, held.tangent()?, factorized))
            })?;
            match done {
                Err(LinearError::GivenUp { because, iterations }) => {
                    self.factorized = false;
                    let (linear, energy) = (&mut self.linear, self.energy);
                    let stores = timed(&mut self.times.linear, || {
                        linear.reconsider(energy, &because, iterations)
                    })?;
                    if stores {
                        self.counters.tangents += 1;
                        let tangent = &mut self.tangent;
                        timed(&mut self.times.assembly, || tangent.store())?;
                    }
                }
                done => return Ok(done?),
            }
        }
    }

    /// Goes along `direction` as far as the line search allows; the part of the full step taken.
    fn step(
        &mut self,
        u: &mut [f64],
        direction: &[f64],
        loads: &[f64],
        negative_pivots: Option<usize>,
    ) -> Result<f64, NewtonFailure> {
        let start = self.trial(u, direction, loads, &self.gradient, &self.parts);
        let noise = 100.0 * ROUNDOFF * self.energy_scale(u, loads);
        let floor = ROUNDING_MULTIPLE * self.rounding();
        let inversion = self.energy.first_inversion(u, &beyond(direction));
        let mut search = LineSearch::new(start, noise, floor);
        if let Some(inversion) = &inversion {
            search.no_further_than(inversion.part);
        }
        let mut not_finite = inversion.map(|inversion| inversion.first);
        let origin = u.to_vec();
        let (mut gradient, mut parts) = (vec![0.0; u.len()], vec![0.0; self.parts.len()]);
        while let Some(length) = search.next_length() {
            for (u, (origin, d)) in u.iter_mut().zip(origin.iter().zip(direction)) {
                *u = origin + length * d;
            }
            let is_full = length == 1.0;
            let evaluated = if is_full {
                self.evaluate(u, !self.is_modified())
            } else {
                self.counters.gradients += 1;
                let (energy, wanted) = (self.energy, Wanted::Forces(&mut gradient));
                timed(&mut self.times.line_search, || energy.evaluate(u, wanted, &mut parts))
            };
            let trial = match evaluated {
                Ok(()) => {
                    let own = (&self.gradient, &self.parts);
                    let (gradient, parts) = if is_full { own } else { (&gradient, &parts) };
                    Some(self.trial(u, direction, loads, gradient, parts))
                }
                Err(error) => {
                    not_finite = Some(error);
                    None
                }
            };
            if search.accepts(trial) {
                self.evaluate(u, !self.is_modified())?;
                return Ok(length);
            }
        }
        Err(match not_finite.filter(|_| search.all_not_finite()) {
            Some(error) => error.into(),
            None => NewtonFailure::LineSearch { negative_pivots },
        })
    }

    /// What the line search needs to know of a state.
    fn trial(
        &self,
        u: &[f64],
        direction: &[f64],
        loads: &[f64],
        gradient: &[f64],
        parts: &[f64],
    ) -> Trial {
        let residual = |&dof: &usize| gradient[dof] - loads[dof];
        let free = self.constraints.free();
        Trial {
            potential: if self.has_potential { total(parts) - dot(loads, u) } else { f64::NAN },
            slope: free.iter().fold(0.0, |sum, dof| sum + residual(dof) * direction[*dof]),
            residual: norm(free.iter().map(residual)),
        }
    }

    /// The size of the terms whose difference is the potential.
    fn energy_scale(&self, u: &[f64], loads: &[f64]) -> f64 {
        let work = loads.iter().zip(u).fold(0.0, |sum, (f, u)| sum + (f * u).abs());
        magnitude(&self.parts) + work
    }

    /// Energy and gradient at `u`, and the tangent if asked for, unless they are at hand.
    fn evaluate(&mut self, u: &[f64], with_tangent: bool) -> Result<(), NonFinite> {
        let at_hand = self.evaluated_at.as_deref() == Some(u);
        if at_hand && (!with_tangent || self.tangent.is_at(u)) {
            return Ok(());
        }
        self.evaluated_at = None;
        self.rounding.set(None);
        let (energy, gradient, parts) = (self.energy, &mut self.gradient, &mut self.parts);
        if with_tangent {
            self.factorized = false;
            self.counters.tangents += 1;
            let tangent = &mut self.tangent;
            timed(&mut self.times.assembly, || tangent.evaluate(u, gradient, parts))?;
        } else {
            self.counters.gradients += 1;
            let wanted = Wanted::Forces(gradient);
            timed(&mut self.times.assembly, || energy.evaluate(u, wanted, parts))?;
        }
        self.evaluated_at = Some(u.to_vec());
        Ok(())
    }

    /// What the residual is compared with: the larger of the 2-norms of reactions and loads.
    fn force(&self, loads: &[f64]) -> f64 {
        self.reaction_norm(loads).max(norm_of(loads)).max(self.scale)
    }

    /// How far rounding the displacements changes the forces, relative to these; 0 where there are
    /// none. Residuals come to rest a little below.
    fn rounding_floor(&self, loads: &[f64]) -> f64 {
        let (floor, force) = (self.rounding(), self.force(loads));
        if force <= floor { 0.0 } else { floor / force }
    }

    fn residual_norm(&self, loads: &[f64]) -> f64 {
        norm(self.constraints.free().iter().map(|&dof| self.gradient[dof] - loads[dof]))
    }

    fn reaction_norm(&self, loads: &[f64]) -> f64 {
        norm(self.constraints.fixed().iter().map(|&dof| self.gradient[dof] - loads[dof]))
    }
}

#[cfg(test)]
#[path = "newton_tests.rs"]
mod tests;
