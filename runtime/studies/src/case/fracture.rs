//! Cases whose bonds break, or are cut from the start.

use std::sync::Arc;

use piola_grammar::Diagnostic;
use piola_mechanics::energy::Energy;
use piola_mechanics::fracture::crack::{self, Cut};
use piola_mechanics::fracture::criteria::{self, Criteria, Criterion};
use piola_mechanics::fracture::memory::{self, Memory, NextState};
use piola_mechanics::fracture::{Breaking, Fracture as _};
use piola_mechanics::kernel::Measure;
use piola_mechanics::neighborhood::Neighborhood;

use super::{Case, CaseError, Compiled, Potential};
use crate::scene::{CrackEntry, CrackShape, selection};
use piola_solvers::motion::Method;
use piola_solvers::steps::Control;

impl Case {
    /// Whether bonds may break, or are cut from the start.
    pub fn can_break(&self) -> bool {
        let has_criteria = self.potentials.iter().any(|one| !one.model.breaks().is_empty());
        has_criteria || !self.scene.cracks.is_empty()
    }

    /// Whether triangles, and tetrahedra, may break by conditions of their own.
    pub fn can_break_cliques(&self) -> [bool; 2] {
        let is_of = |measure| {
            let mut all = self.potentials.iter().flat_map(|one| one.model.breaks());
            all.any(|one| one.measure == measure)
        };
        [Measure::Area, Measure::Volume].map(is_of)
    }

    /// How many numbers each bond remembers that change.
    pub fn n_states(&self) -> usize {
        self.potentials.iter().map(|one| one.model.updates().len()).sum()
    }

    /// The energies as one whose status changes: bonds that cracks cut are broken at once, others when a
    /// criterion says so, and what they remember changes.
    pub(super) fn breaking(
        &self,
        terms: Vec<Box<dyn Energy>>,
        names: Arc<[String]>,
        neighborhood: Arc<Neighborhood>,
        (criteria, states): (Vec<criteria::Layer>, Vec<memory::Layer>),
    ) -> Breaking {
        let around = (&*self.body, &*neighborhood);
        let is_unbreakable = selection::unbreakable(&self.scene, &self.body);
        let criteria = Criteria::new(around, criteria, is_unbreakable);
        let memory = Memory::new(around, states);
        let (mut cut, mut absent) = (Vec::new(), Vec::new());
        for crack in &self.scene.cracks {
            let bonds = self.cut(crack, &neighborhood).bonds;
            if crack.damaged { cut.extend(bonds) } else { absent.extend(bonds) }
        }
        absent.sort_unstable();
        absent.dedup();
        cut.retain(|bond| absent.binary_search(bond).is_err());
        let body = Arc::clone(&self.body);
        let breaking =
            Breaking::new((body, neighborhood), terms, names, (criteria, memory), absent);
        breaking.take_out(&cut);
        breaking
    }

    /// What a crack does to the bonds of these neighbours.
    fn cut(&self, crack: &CrackEntry, neighborhood: &Neighborhood) -> Cut {
        match &crack.shape {
            CrackShape::Across(shape) => shape.cut(&self.body, neighborhood),
            CrackShape::Between(sets) => {
                let [one, other] =
                    sets.map(|set| selection::in_sets(&self.scene, &self.body, &[set.value]));
                let bonds = crack::between(neighborhood, [&one, &other]);
                Cut { bonds, ..Cut::default() }
            }
        }
    }

    /// The points whose bonds a crack may cut: a bond is found at its lower end, so of two sets all.
    fn near_crack(&self, crack: &CrackEntry, horizon: f64) -> Vec<usize> {
        match &crack.shape {
            CrackShape::Across(shape) => shape.points_nearby(&self.body, horizon),
            CrackShape::Between(sets) => {
                let sets = sets.map(|set| set.value);
                let inside = selection::in_sets(&self.scene, &self.body, &sets);
                (0..inside.len()).filter(|point| inside[*point]).collect()
            }
        }
    }

    /// Refuses load steps of bodies that break or remember as these cannot: attempts at an equilibrium that
    /// come to nothing put back bonds alone.
    ///
    /// # Errors
    /// At the potential that says so.
    pub(super) fn check_load_steps(&self, compiled: &[Compiled]) -> Result<(), CaseError> {
        if self.scene.motion.is_some() {
            return Ok(());
        }
        let has_cliques = || {
            let mut arguments = compiled.iter().flat_map(|one| one.of_interactions());
            arguments.any(|argument| argument != "l")
        };
        for (one, material) in self.potentials.iter().zip(&self.scene.materials) {
            let (breaks, name) = (one.model.breaks(), one.model.name());
            let what = match breaks.iter().find(|one| one.measure != Measure::Length) {
                Some(other) if other.measure == Measure::Area => "triangles break",
                Some(_) => "tetrahedra break",
                None if !one.model.updates().is_empty() => "bonds remember",
                None if !breaks.is_empty() && has_cliques() => {
                    "bonds break, with triangles or tetrahedra on them,"
                }
                None => continue,
            };
            let message = format!("{what} in {name}, and the scene has load steps");
            let found = Diagnostic::error("conflicting-keys", material.potential.span, message)
                .label("in load steps bonds break alone, and remember nothing")
                .help("write [motion] with an `end` in s, in place of [steps]");
            return Err(CaseError::Scene(self.scene.report(vec![found])));
        }
        Ok(())
    }

    /// Refuses steps by events where nothing breaks.
    pub(super) fn check_events(&self) -> Result<(), CaseError> {
        let breaks = self.potentials.iter().any(|one| !one.model.breaks().is_empty());
        let by_events = self.scene.steps.control == Control::Event && self.scene.motion.is_none();
        if breaks || !by_events {
            return Ok(());
        }
        let material = self.scene.material();
        let message = "the steps go by events, and no bond breaks: no potential has a `break when`";
        let found = Diagnostic::error("conflicting-keys", material.potential.span, message);
        let help = "write control = \"load\" in [steps], or take a potential with `break when`";
        Err(CaseError::Scene(self.scene.report(vec![found.help(help)])))
    }

    /// Warnings of cracks that cut nothing, and of those that run through points.
    pub(super) fn warnings_of_cracks(&self) -> Vec<Diagnostic> {
        let mut warnings = Vec::new();
        for crack in &self.scene.cracks {
            let horizon = self.scene.horizon_radius();
            let nearby = self.near_crack(crack, horizon);
            // What is wrong with the body is said where its energy is made.
            let Ok(around) = Neighborhood::around(&self.body, horizon, &nearby, false) else {
                continue;
            };
            let found = self.cut(crack, &around);
            if found.bonds.is_empty() {
                let message = "this crack cuts no bond of the body";
                let warning = Diagnostic::warning("idle-entry", crack.span, message);
                let help = match crack.shape {
                    CrackShape::Across(_) => "it cuts the bonds whose inside crosses its inside",
                    CrackShape::Between(_) => {
                        "no point of one set is within the horizon of the other"
                    }
                };
                warnings.push(warning.help(help));
            }
            if found.touching > 0 {
                let message = format!(
                    "this crack runs through points: {} bonds only touch it, and are kept",
                    found.touching
                );
                let warning = Diagnostic::warning("boundary-on-points", crack.span, message);
                warnings.push(warning.help("put it half a spacing from the points beside it"));
            }
        }
        warnings
    }

    /// Refuses bonds that break, or are cut, beside energies of F and of gathered values, but in explicit
    /// motions.
    ///
    /// # Errors
    /// At the potential that says so, or at the crack.
    pub(super) fn check_families(&self, potential: &Potential) -> Result<(), CaseError> {
        let is_midpoint =
            self.scene.motion.as_ref().is_some_and(|motion| motion.method == Method::Midpoint);
        if !is_midpoint || !potential.has_families() {
            return Ok(());
        }
        let model = &potential.model;
        let of_interactions = |one: &&str| ["l", "a", "v"].contains(one);
        let mut others = model.arguments().into_iter().filter(|one| !of_interactions(one));
        let other = if model.has_gradient_energy() { "F" } else { others.next().unwrap_or("l") };
        let help =
            "write [motion] with an explicit `method`, or take a potential with psi(l) alone";
        let label = "families lose bonds in explicit motions and in load steps";
        self.refuse_breaking(model.name(), other, [label, help])
    }

    fn refuse_breaking(
        &self,
        name: &str,
        other: &str,
        [label, help]: [&str; 2],
    ) -> Result<(), CaseError> {
        let mut all = self.potentials.iter().zip(&self.scene.materials);
        let breaking = all.find(|(one, _)| !one.model.breaks().is_empty());
        let (what, span) = match (breaking, self.scene.cracks.first()) {
            (Some((one, material)), _) => {
                (format!("bonds of {} break", one.model.name()), material.potential.span)
            }
            (None, Some(crack)) => ("a crack cuts bonds".to_string(), crack.span),
            (None, None) => return Ok(()),
        };
        let message = format!("{what}, and {name} has a psi({other})");
        let found = Diagnostic::error("conflicting-keys", span, message).label(label).help(help);
        Err(CaseError::Scene(self.scene.report(vec![found])))
    }
}

/// What the potentials of each layer say of bonds, by law.
pub(super) fn of_layers<T, U>(
    compiled: &mut [Compiled],
    n_laws: usize,
    take: impl Fn(&mut Compiled) -> Vec<T>,
    make: impl Fn(T) -> U,
) -> Vec<Vec<Vec<U>>> {
    let n_layers = compiled.iter().map(|one| one.layer + 1).max().unwrap_or(0);
    let of_laws = || (0..n_laws).map(|_| Vec::new()).collect();
    let mut layers: Vec<Vec<Vec<U>>> = (0..n_layers).map(|_| of_laws()).collect();
    for one in compiled {
        let own = take(one).into_iter().map(&make);
        layers[one.layer][one.law].extend(own);
    }
    layers
}

/// A criterion for the mechanics.
pub(super) fn criterion(one: piola_compiler::Criterion) -> Criterion {
    let (measure, holds_at_zero) = (one.measure(), one.holds_at_zero);
    Criterion { measure, margin: Box::new(one.margin), holds_at_zero }
}

/// The same of a next state.
pub(super) fn next_state(one: piola_compiler::NextState) -> NextState {
    NextState { field: one.field, next: Box::new(one.next) }
}
