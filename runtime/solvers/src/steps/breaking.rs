//! Bonds, triangles and tetrahedra that break at equilibria, and the account of energy of a body that loses
//! them.
//!
//! At each load step an equilibrium is found at the present status; what is beyond its criteria breaks, all at
//! once or the foremost, and the equilibrium of what is left is found at the same loads, until nothing breaks.
//! Where one is not found, what was broken on the way comes back: the step never was.

use piola_mechanics::fracture::{Fracture, Interactions, Release};
use piola_mechanics::kernel::Measure;
use piola_mechanics::vector::{dot, norm};
use piola_mechanics::words::Words;

use super::memory::Evolved;
use super::{Find, Found, LoadSteps, RELAXATION_STEPS, StepError};
use crate::constraint::Constraints;
use crate::linear::Definiteness;
use crate::newton::{History, NewtonError, NewtonFailure, NewtonReport};
use crate::singular::{Singular, Watched};

/// A body carries nothing where less than this of the most energy is left in it.
pub(super) const NOTHING: f64 = 1e-12;

/// What breaks by `breaking = "largest"` goes with the foremost within this share: mirror images.
const MIRRORED: f64 = 1e-9;

/// What load steps go by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Control {
    /// By `t`, which grows: bonds break at given loads.
    #[default]
    Load,
    /// By breaking: `t` is found where the next bond breaks, and may fall.
    Event,
    /// By the length of the way that the body goes: `t` is found with the equilibrium, and may fall.
    ArcLength,
}

impl Words for Control {
    const WORDS: &'static [(&'static str, Control)] =
        &[("load", Control::Load), ("event", Control::Event), ("arc-length", Control::ArcLength)];
}

/// Which bonds break at a load step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Breaking {
    /// All that are beyond their criteria.
    #[default]
    All,
    /// The one whose margin is largest over its amount at rest, and its mirror images.
    Largest,
}

impl Words for Breaking {
    const WORDS: &'static [(&'static str, Breaking)] =
        &[("all", Breaking::All), ("largest", Breaking::Largest)];
}

/// What becomes of parts that hang on nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Loose {
    /// They are held where they are, by as few degrees of freedom as do.
    #[default]
    Freeze,
    /// The run ends.
    Stop,
}

impl Words for Loose {
    const WORDS: &'static [(&'static str, Loose)] =
        &[("freeze", Loose::Freeze), ("stop", Loose::Stop)];
}

/// What steps go by, and how bonds break.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BreakSettings {
    /// What steps go by.
    pub control: Control,
    /// Which bonds break at a load step.
    pub breaking: Breaking,
    /// By which share of the way from rest a bond may be behind the foremost and break in one event with it.
    pub tie: f64,
    /// After how many events a run ends.
    pub events: usize,
    /// After how many steps along the way a run ends.
    pub arcs: usize,
    /// What becomes of loose parts.
    pub loose: Loose,
    /// What becomes of the run where families become too small.
    pub singular: Singular,
}

impl Default for BreakSettings {
    fn default() -> Self {
        BreakSettings {
            control: Control::default(),
            breaking: Breaking::default(),
            tie: 1e-9,
            events: 10_000,
            arcs: 1000,
            loose: Loose::default(),
            singular: Singular::default(),
        }
    }
}

/// Where the energy of a body that breaks went since the start, in J:
/// `stored + released + dissipated + relaxed - external - prescribed - quadrature` stays what it was.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Account {
    /// What bonds held when they broke.
    pub released: f64,
    /// What bonds that remember lost as they came to remember something else.
    pub dissipated: f64,
    /// What the body gave away at fixed loads after bonds had broken, until it was in equilibrium again: what
    /// a motion would have carried off.
    pub relaxed: f64,
    /// The work of loads, by the trapezoidal rule between equilibria.
    pub external: f64,
    /// The work where displacements are prescribed, by the same rule.
    pub prescribed: f64,
    /// What that rule misses of the change of the stored energy between equilibria, and what energies
    /// whose parameters change with `t` gain by that.
    pub quadrature: f64,
}

/// What broke at a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Broken {
    /// How many bonds broke at this step.
    pub bonds: usize,
    /// How many triangles, and tetrahedra, broke at it by criteria of their own.
    pub cliques: [usize; 2],
    /// In how many rounds: an equilibrium follows each.
    pub rounds: usize,
    /// How many bonds are broken, those that a crack cut included.
    pub all: usize,
    /// How many triangles, and tetrahedra, broke by criteria of their own since the start; nothing where these
    /// have none.
    pub all_cliques: [Option<usize>; 2],
    /// Where the energy went.
    pub account: Account,
}

/// What is written down on the way.
#[derive(Clone, Debug, Default)]
pub(super) struct Ledger {
    account: Account,
    /// Stored at the present equilibrium, and the most so far, in J.
    pub(super) energy: f64,
    pub(super) most: f64,
    /// `dE/du` there, in N.
    pull: Vec<f64>,
    /// The largest 2-norm of reactions and loads so far, in N.
    scale: f64,
    /// Since the last record.
    bonds: usize,
    cliques: [usize; 2],
    rounds: usize,
    pub(super) notes: Vec<String>,
    /// How many events there were.
    pub(super) events: usize,
}

/// A body that breaks.
pub(super) struct Fracturing<'a> {
    pub(super) status: &'a dyn Fracture,
    families: Watched,
    pub(super) ledger: Ledger,
    /// See [`LoadSteps::take_turns`].
    pub(super) takes_turns: bool,
    /// Whether bonds came to remember something else at the last equilibrium.
    pub(super) has_changed: bool,
}

impl<'a> Fracturing<'a> {
    pub(super) fn new(
        status: &'a dyn Fracture,
        families: Watched,
        n_dofs: usize,
    ) -> Fracturing<'a> {
        let ledger = Ledger { pull: vec![0.0; n_dofs], ..Ledger::default() };
        Fracturing { status, families, ledger, takes_turns: false, has_changed: false }
    }

    /// The status, where bonds remember anything.
    pub(super) fn memory(&self) -> Option<&'a dyn Fracture> {
        Some(self.status).filter(|status| status.n_states() > 0)
    }
}

/// A status to come back to.
pub(super) struct Before {
    gone: Interactions,
    states: Vec<f64>,
    ledger: Ledger,
    constraints: Constraints,
}

/// An equilibrium that is not judged.
pub(super) type Rested = (Vec<f64>, NewtonReport);

/// What a step that may fail gives.
pub(super) type Tried<T> = Result<Result<T, NewtonError>, StepError>;

impl<'a> LoadSteps<'a> {
    /// Breaks what is beyond its criteria at an equilibrium, round by round, until nothing goes any more.
    pub(super) fn settle(&mut self, found: Found, loads: &[f64], t: f64) -> Tried<Found> {
        let Some(before) = self.before_breaking() else { return Ok(Ok(found)) };
        match self.evolve(&self.u.clone(), &found.u, self.elapsed(t)) {
            Ok(evolved) => self.follow(&found.u, &found.report, (loads, evolved)),
            Err(cause) => return self.undo(before, cause),
        }
        let mut settled = found;
        for round in 1.. {
            let Some(fracture) = &mut self.fracture else { return Ok(Ok(settled)) };
            let is_on_its_way = fracture.goes_on(&settled.report, round);
            let release = match self.settings.breaking.breaking {
                Breaking::All => fracture.status.advance_bonds(&settled.u),
                Breaking::Largest => fracture.status.advance_foremost(&settled.u, MIRRORED),
            };
            let on_threshold = fracture.status.on_threshold();
            fracture.ledger.notes.extend(on_threshold.map(|found| found.to_string()));
            let release = match release {
                Ok(release) if !release.breaks() && !is_on_its_way => break,
                Ok(release) => release,
                Err(cause) => return self.undo(before, cause.into()),
            };
            match self.rest(&settled.u, release, (loads, t), round)? {
                Ok((u, report)) => settled = Found { u, report, ..settled },
                Err(cause) => return self.undo(before, cause),
            }
        }
        self.judged(settled, before)
    }

    /// With the judgement of its tangent, where rounds led to it.
    fn judged(&mut self, mut settled: Found, before: Before) -> Tried<Found> {
        let Some(fracture) = &self.fracture else { return Ok(Ok(settled)) };
        if fracture.ledger.rounds == 0 || self.settings.find != Find::Newton {
            return Ok(Ok(settled));
        }
        let mut looked = Ok(());
        if fracture.takes_turns {
            self.take_turns(false);
            looked = self.newton.look_at(&settled.u);
        }
        match looked.and_then(|()| self.judge()) {
            Ok(judged) => settled.judged = judged,
            Err(failure) => {
                return self.undo(before, NewtonError { failure, history: History::default() });
            }
        }
        Ok(Ok(settled))
    }

    /// What there is to come back to; nothing where nothing breaks.
    pub(super) fn before_breaking(&self) -> Option<Before> {
        let Fracturing { status, ledger, .. } = self.fracture.as_ref()?;
        let (gone, states) = (status.gone(), status.states());
        let (ledger, constraints) = (ledger.clone(), self.constraints.clone());
        Some(Before { gone, states, ledger, constraints })
    }

    /// Comes back to the last state: what broke on the way did not.
    pub(super) fn undo<T>(&mut self, before: Before, cause: NewtonError) -> Tried<T> {
        let Some(fracture) = &mut self.fracture else { return Ok(Err(cause)) };
        fracture.status.restore(&before.gone);
        fracture.status.remember(&before.states);
        fracture.ledger = before.ledger;
        self.newton.forget();
        if self.constraints != before.constraints {
            self.constrain(before.constraints)?;
        }
        Ok(Err(cause))
    }

    /// The equilibrium of what is left, at the same loads.
    pub(super) fn rest_again(
        &mut self,
        from: &[f64],
        release: Release,
        loads: &[f64],
        t: f64,
    ) -> Tried<Rested> {
        match self.solve_again(from, loads, t)? {
            Ok(again) => Ok(self.book(from, again, release, loads)),
            Err(cause) => Ok(Err(cause)),
        }
    }

    /// The same before it is judged or written down, with the energy in J that was there before.
    pub(super) fn solve_again(
        &mut self,
        from: &[f64],
        loads: &[f64],
        t: f64,
    ) -> Tried<(Rested, f64)> {
        self.newton.forget_all_but_factors();
        if let Some(Fracturing { ledger, .. }) = &self.fracture {
            // What is left of a body that is cut through carries nothing to compare residuals with.
            self.newton.compare_with(ledger.scale);
        }
        if let Some(parts) = self.hold_loose(from, loads)? {
            let failure = NewtonFailure::Loose { t, parts };
            return Ok(Err(NewtonError { failure, history: History::default() }));
        }
        let families = self.fracture.as_ref().and_then(|f| f.families.failed(self.energy));
        if let Some(families) = families {
            let failure = NewtonFailure::Singular { t, families };
            return Ok(Err(NewtonError { failure, history: History::default() }));
        }
        let held = match self.energy.energy(from) {
            Ok(parts) => parts.total(),
            Err(cause) => return Ok(Err(cause.into())),
        };
        let mut u = from.to_vec();
        let report = match self.settings.find {
            Find::Newton => self.newton.solve(&mut u, loads),
            Find::Relaxation => {
                let most = RELAXATION_STEPS * self.settings.newton.max_iterations;
                self.newton.relax(&mut u, loads, most)
            }
        };
        Ok(report.map(|report| ((u, report), held)))
    }

    /// Bonds remember what they come to at an equilibrium of what is left, and the way there is written down.
    pub(super) fn book(
        &mut self,
        from: &[f64],
        ((u, report), held): (Rested, f64),
        release: Release,
        loads: &[f64],
    ) -> Result<Rested, NewtonError> {
        let evolved = self.evolve(from, &u, 0.0)?;
        if let Some(Fracturing { ledger, .. }) = &mut self.fracture {
            let way: Vec<f64> = u.iter().zip(from).map(|(new, old)| new - old).collect();
            let (work, stored) = (dot(loads, &way), report.energy.total() - evolved.behind);
            ledger.account.released += release.energy;
            ledger.account.dissipated += evolved.dissipated;
            ledger.account.external += work;
            ledger.account.relaxed += held - stored - evolved.dissipated + work;
            ledger.bonds += release.bonds;
            ledger.cliques.iter_mut().zip(release.cliques).for_each(|(all, own)| *all += own);
            ledger.rounds += 1;
            ledger.energy = stored;
            ledger.pull.copy_from_slice(self.newton.internal_forces());
        }
        Ok((u, report))
    }

    /// Writes down the way from the present state to an equilibrium of the same body, with what bonds that
    /// remember dissipated on it.
    pub(super) fn follow(
        &mut self,
        u: &[f64],
        report: &NewtonReport,
        (loads, evolved): (&[f64], Evolved),
    ) {
        let Some(Fracturing { ledger, .. }) = &mut self.fracture else { return };
        let pull = self.newton.internal_forces();
        let (mut external, mut prescribed) = (0.0, 0.0);
        for dof in 0..u.len() {
            let way = 0.5 * (u[dof] - self.u[dof]);
            external += (self.loads[dof] + loads[dof]) * way;
            if self.constraints.is_fixed(dof) {
                let reactions = ledger.pull[dof] - self.loads[dof] + (pull[dof] - loads[dof]);
                prescribed += reactions * way;
            }
        }
        let (stored, dissipated) = (report.energy.total() - evolved.behind, evolved.dissipated);
        ledger.account.external += external;
        ledger.account.prescribed += prescribed;
        ledger.account.dissipated += dissipated;
        ledger.account.quadrature += stored + dissipated - ledger.energy - external - prescribed;
        ledger.energy = stored;
        ledger.most = ledger.most.max(stored);
        ledger.pull.copy_from_slice(pull);
        let reactions = self.constraints.fixed().iter().map(|dof| pull[*dof] - loads[*dof]);
        let force = norm(reactions).max(norm(loads.iter().copied()));
        ledger.scale = ledger.scale.max(force);
    }

    /// What broke since the last record, and what is to be said of it.
    pub(super) fn take_broken(&mut self) -> (Option<Broken>, Vec<String>) {
        let Some(Fracturing { status, ledger, .. }) = &mut self.fracture else {
            return (None, Vec::new());
        };
        let (bonds, cliques, rounds) = (
            std::mem::take(&mut ledger.bonds),
            std::mem::take(&mut ledger.cliques),
            std::mem::take(&mut ledger.rounds),
        );
        let all_cliques = [Measure::Area, Measure::Volume]
            .map(|measure| status.counts_of(measure).map(|[_, broken]| broken));
        let (all, account) = (status.counts()[1], ledger.account);
        let broken = Broken { bonds, cliques, rounds, all, all_cliques, account };
        (Some(broken), std::mem::take(&mut ledger.notes))
    }
}

/// How an equilibrium was judged that was not.
pub(super) fn not_judged(why: &str) -> (Definiteness, Option<f64>) {
    let method = format!("{why}: not judged");
    (Definiteness { positive_definite: None, negative_pivots: None, method }, None)
}
