//! Cases whose bonds break, or are cut from the start.

use std::sync::Arc;

use piola_compiler::{Model, OfFamily};
use piola_grammar::Diagnostic;
use piola_mechanics::energy::Energy;
use piola_mechanics::fracture::crack::{self, Cut};
use piola_mechanics::fracture::criteria::{self, Criteria, Criterion};
use piola_mechanics::fracture::memory::{self, Memory, NextState};
use piola_mechanics::fracture::{Breaking, Fracture as _};
use piola_mechanics::kernel::Measure;
use piola_mechanics::materials::StateOf;
use piola_mechanics::neighborhood::Neighborhood;

use super::potential::is_sheet;
use super::{Case, CaseError, Compiled, Potential};
use crate::scene::{ColourBy, CrackEntry, CrackShape, selection};
use piola_solvers::motion::Method;
use piola_solvers::singular::{Singular, SmallFamilies};
use piola_solvers::steps::Control;

impl Case {
    /// Whether bonds may break, or are cut from the start.
    pub fn can_break(&self) -> bool {
        let has_criteria = self.potentials.iter().any(|one| one.model.can_break());
        has_criteria || !self.scene.cracks.is_empty()
    }

    /// Whether triangles, and tetrahedra, may break by conditions of their own.
    pub fn can_break_cliques(&self) -> [bool; 2] {
        let is_of = |measure| {
            let mut all = self.potentials.iter().flat_map(|one| one.model.breaks());
            all.any(|one| one.of == measure)
        };
        [Measure::Area, Measure::Volume].map(is_of)
    }

    /// How many states there are that change.
    pub fn n_states(&self) -> usize {
        self.n_states_of().iter().sum()
    }

    /// The same of each bond, of each triangle, of each tetrahedron and of each point.
    pub(crate) fn n_states_of(&self) -> [usize; 4] {
        let all: Vec<StateOf> = self
            .potentials
            .iter()
            .flat_map(|one| one.which_are_states(&self.scene).into_iter().flatten())
            .collect();
        let own = |kind| all.iter().filter(|one| **one == kind).count();
        let [bonds, triangles, tetrahedra] =
            Measure::ALL.map(|measure| own(StateOf::Interactions(measure)));
        [bonds, triangles, tetrahedra, own(StateOf::Points)]
    }

    /// The names of what is remembered, as [`Fracture::states`](piola_mechanics::fracture::Fracture::states)
    /// has its numbers: layer by layer, law by law, in the order of the potential.
    pub(crate) fn all_states(&self) -> Vec<&str> {
        let mut all: Vec<(usize, usize, &str)> = Vec::new();
        for (potential, (law, layer)) in self.potentials.iter().zip(self.places()) {
            let fields =
                potential.values.fields.iter().zip(potential.which_are_states(&self.scene));
            let names = fields.filter(|(_, state)| state.is_some()).map(|(number, _)| {
                potential.model.parameters()[usize::from(*number)].name.as_str()
            });
            all.extend(names.map(|name| (layer, law, name)));
        }
        all.sort_by_key(|(layer, law, _)| (*layer, *law));
        all.into_iter().map(|(_, _, name)| name).collect()
    }

    /// The names of what is remembered, each once.
    pub(crate) fn names_of_states(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for name in self.all_states() {
            if !names.iter().any(|known| known == name) {
                names.push(name.to_owned());
            }
        }
        names
    }

    /// The numbers of the states of this name: of several materials there may be several.
    pub(crate) fn states_called(&self, name: &str) -> Vec<usize> {
        let all = self.all_states();
        (0..all.len()).filter(|number| all[*number] == name).collect()
    }

    /// Refuses pictures of states that no potential has.
    ///
    /// # Errors
    /// At the material.
    pub(super) fn check_colour(&self) -> Result<(), CaseError> {
        let ColourBy::State(wanted) = &self.scene.output.colour else { return Ok(()) };
        let names = self.names_of_states();
        if names.contains(wanted) {
            return Ok(());
        }
        let message =
            format!("the colours of the picture show the state `{wanted}`, and there is none");
        let span = self.scene.material().potential.span;
        let found = Diagnostic::error("conflicting-keys", span, message)
            .label("states are those of the potentials that an `update` changes");
        let help = match names.is_empty() {
            true => "write colour = \"damage\" in [output], or take a potential with `update`"
                .to_owned(),
            false => {
                format!("write colour = \"state {}\" in [output]", names.join("\" or \"state "))
            }
        };
        Err(CaseError::Scene(self.scene.report(vec![found.help(help)])))
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

    /// Refuses steps by what this case cannot go by.
    pub(super) fn check_control(&self) -> Result<(), CaseError> {
        match self.scene.steps.control {
            _ if self.scene.motion.is_some() => Ok(()),
            Control::Load => Ok(()),
            Control::Event => self.check_events(),
            Control::ArcLength => self.check_way(),
        }
    }

    /// Refuses steps along the way where what the body is made of goes with `t`: that may fall, and is what
    /// drives the body alone.
    fn check_way(&self) -> Result<(), CaseError> {
        let mut all = self.potentials.iter().zip(&self.scene.materials);
        let of = |potential: &Potential| {
            if potential.model.remembers_time() {
                return Some("remembers the time that passes");
            }
            if !potential.model.family_updates().is_empty() {
                return Some(
                    "remembers by what families give, which is not followed along the way",
                );
            }
            potential.changes_in_time().then_some("has parameters that vary with t")
        };
        let found = all.find_map(|(one, material)| Some((of(one)?, one, material)));
        let Some((why, one, material)) = found else { return Ok(()) };
        let message =
            format!("the steps go by the length of the way, and {} {why}", one.model.name());
        let found = Diagnostic::error("conflicting-keys", material.potential.span, message)
            .help("write control = \"load\" in [steps]: t grows there");
        Err(CaseError::Scene(self.scene.report(vec![found])))
    }

    /// Refuses steps by events where nothing breaks, or something is remembered: where a margin is 0 is not asked
    /// along the way on which these change.
    fn check_events(&self) -> Result<(), CaseError> {
        let mut all = self.potentials.iter().zip(&self.scene.materials);
        let breaks = self.potentials.iter().any(|one| one.model.can_break());
        let (span, message, help) = match all.find(|(one, _)| one.model.has_memory()) {
            Some((one, material)) => (
                material.potential.span,
                format!("the steps go by events, and {} remembers", one.model.name()),
                "write control = \"load\" in [steps], or [motion] in its place",
            ),
            None if !breaks => (
                self.scene.material().potential.span,
                "the steps go by events, and nothing breaks: no potential has a `break when`"
                    .into(),
                "write control = \"load\" in [steps], or take a potential with `break when`",
            ),
            None => return Ok(()),
        };
        let found = Diagnostic::error("conflicting-keys", span, message).help(help);
        Err(CaseError::Scene(self.scene.report(vec![found])))
    }

    /// Refuses conditions and states of deformation gradients of sheets, whose gradients have no component across.
    ///
    /// # Errors
    /// At the material.
    pub(super) fn check_gradient_functions(&self) -> Result<(), CaseError> {
        let mut all = self.potentials.iter().zip(&self.scene.materials);
        let breaks =
            |model: &Model| model.family_breaks().iter().any(|one| one.of == OfFamily::Gradient);
        let remembers =
            |model: &Model| model.family_updates().iter().any(|one| one.of == OfFamily::Gradient);
        let found = all.find(|(one, _)| breaks(&one.model) || remembers(&one.model));
        let Some((one, material)) = found.filter(|_| is_sheet(&self.scene)) else { return Ok(()) };
        let (what, follow, instead) = match breaks(&one.model) {
            true => ("bonds of", "break by", "a condition of bonds: `break when l/L - 1 > s0`"),
            false => ("states of", "follow", "a state of bonds: `update k = max(k, l/L - 1)`"),
        };
        let message = format!(
            "{what} {} {follow} a deformation gradient, and in plane stress what lies across the sheet is \
             not there",
            one.model.name()
        );
        let found = Diagnostic::error("conflicting-keys", material.potential.span, message)
            .help(format!("write plane = \"strain\" in [correspondence], or {instead}"));
        Err(CaseError::Scene(self.scene.report(vec![found])))
    }

    /// Refuses cracks that leave families too small, where the scene says so.
    ///
    /// # Errors
    /// At the first crack.
    pub(super) fn check_singular(&self, energy: &dyn Energy) -> Result<(), CaseError> {
        let [crack, ..] = &self.scene.cracks[..] else { return Ok(()) };
        if self.scene.fracture.singular != Singular::Refuse {
            return Ok(());
        }
        let Some(families) = SmallFamilies::of(energy, &[]) else { return Ok(()) };
        let message = format!("cut by cracks, {}", self.numbered(&families));
        let label = "[fracture] says singular = \"refuse\"";
        let help = "write singular = \"release\" to go on without the energy that such points have by \
                    their families, or leave them more neighbours: a crack elsewhere, a longer horizon";
        let found = Diagnostic::error("conflicting-keys", crack.span, message);
        Err(CaseError::Scene(self.scene.report(vec![found.label(label).help(help)])))
    }

    /// The same of a case whose energy is not there yet; of more points than a plan looks at it is not said.
    pub(crate) fn check_cut_families(&self) -> Result<(), CaseError> {
        let is_asked = self.scene.fracture.singular == Singular::Refuse
            && !self.scene.cracks.is_empty()
            && self.potentials.iter().any(Potential::has_families);
        if !is_asked || self.large_box().is_some() {
            return Ok(());
        }
        self.check_singular(&self.energy(self.compile()?)?)
    }

    /// Families with the numbers that the user knows their points by.
    pub(crate) fn numbered(&self, families: &SmallFamilies) -> SmallFamilies {
        families.clone().numbered(|point| self.body.user_index()[point] as usize)
    }

    /// Warnings of cracks that cut nothing, of those that run through points, and of tracks without a crack.
    pub(crate) fn warnings_of_cracks(&self) -> Vec<Diagnostic> {
        let mut warnings = Vec::new();
        for track in self.scene.tracks.iter().filter(|_| !self.can_break()) {
            let message = "no bond of this scene can break: there is nothing to follow";
            let warning = Diagnostic::warning("idle-entry", track.name.span, message);
            warnings
                .push(warning.help("take a potential with `break when`, or leave [[track]] out"));
        }
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
        let breaking = all.find(|(one, _)| one.model.can_break());
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
    NextState { measure: one.measure(), field: one.field, next: Box::new(one.next) }
}
