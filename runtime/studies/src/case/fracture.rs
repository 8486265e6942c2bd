//! Cases whose bonds break, or are cut from the start.

use std::sync::Arc;

use piola_grammar::Diagnostic;
use piola_mechanics::energy::Energy;
use piola_mechanics::fracture::criteria::{Criteria, Criterion, Layer};
use piola_mechanics::fracture::{Breaking, Fracture as _};
use piola_mechanics::neighborhood::Neighborhood;

use super::{Case, CaseError, Compiled, Potential};
use crate::scene::selection;
use piola_solvers::motion::Method;
use piola_solvers::steps::Control;

impl Case {
    /// Whether bonds may break, or are cut from the start.
    pub fn can_break(&self) -> bool {
        let has_criteria = self.potentials.iter().any(|one| !one.model.breaks().is_empty());
        has_criteria || !self.scene.cracks.is_empty()
    }

    /// The energies, all of bonds, as one that loses bonds: those that cracks cut at once, others when a
    /// criterion says so.
    pub(super) fn breaking(
        &self,
        terms: Vec<Box<dyn Energy>>,
        names: Arc<[String]>,
        neighborhood: Arc<Neighborhood>,
        layers: Vec<Layer>,
    ) -> Breaking {
        let around = (&*self.body, &*neighborhood);
        let is_unbreakable = selection::unbreakable(&self.scene, &self.body);
        let criteria = Criteria::new(around, layers, is_unbreakable);
        let (mut cut, mut absent) = (Vec::new(), Vec::new());
        for crack in &self.scene.cracks {
            let found = crack.shape.cut(&self.body, &neighborhood);
            if crack.damaged { cut.extend(found.bonds) } else { absent.extend(found.bonds) }
        }
        absent.sort_unstable();
        absent.dedup();
        cut.retain(|bond| absent.binary_search(bond).is_err());
        let body = Arc::clone(&self.body);
        let breaking = Breaking::new((body, neighborhood), terms, names, criteria, absent);
        breaking.take_out(&cut);
        breaking
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
            let nearby = crack.shape.points_nearby(&self.body, horizon);
            // What is wrong with the body is said where its energy is made.
            let Ok(around) = Neighborhood::around(&self.body, horizon, &nearby, false) else {
                continue;
            };
            let found = crack.shape.cut(&self.body, &around);
            if found.bonds.is_empty() {
                let message = "this crack cuts no bond of the body";
                let warning = Diagnostic::warning("idle-entry", crack.span, message);
                warnings.push(warning.help("it cuts the bonds whose inside crosses its inside"));
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

    /// Refuses bonds that break, or are cut, beside triangles and tetrahedra, which lose no edges: energies
    /// of several corners that have these `arguments`.
    ///
    /// # Errors
    /// At the potential that says so, or at the crack.
    pub(super) fn check_cliques<'a>(
        &self,
        name: &str,
        mut arguments: impl Iterator<Item = &'a str>,
    ) -> Result<(), CaseError> {
        let Some(other) = arguments.find(|argument| *argument != "l") else { return Ok(()) };
        let label = "triangles and tetrahedra lose no edges";
        self.refuse_breaking(name, other, [label, "set the coefficients of these energies to 0"])
    }

    /// The same beside energies of F and of gathered values in motions by an implicit rule.
    ///
    /// # Errors
    /// As [`Case::check_cliques`].
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

/// The criteria of each layer and of each law in it.
pub(super) fn criteria_of(compiled: &mut [Compiled], n_laws: usize) -> Vec<Vec<Vec<Criterion>>> {
    let n_layers = compiled.iter().map(|one| one.layer + 1).max().unwrap_or(0);
    let of_laws = || (0..n_laws).map(|_| Vec::new()).collect();
    let mut layers: Vec<Vec<Vec<Criterion>>> = (0..n_layers).map(|_| of_laws()).collect();
    for one in compiled {
        let own = one.criteria.drain(..).map(|criterion| Criterion {
            margin: Box::new(criterion.margin),
            holds_at_zero: criterion.holds_at_zero,
        });
        layers[one.layer][one.law].extend(own);
    }
    layers
}
