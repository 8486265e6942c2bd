//! What is probably a mistake in an energy, though the language allows it.
//!
//! | code | an energy that |
//! |---|---|
//! | `not-stress-free` | has a force at rest |
//! | `not-stiff-at-rest` | gives a small deformation no stiffness |
//! | `singular-in-domain` | is no finite number somewhere inside its domain |
//! | `jump-in-energy`, `jump-in-force` | has branches that do not meet |
//! | `no-bond-energy` | stands without one of bonds |
//! | `breaks-at-rest`, `never-breaks`, `breaks-in-compression` | has a condition `break when` that holds there |
//! | `breaks-nothing` | has one of triangles or tetrahedra, and no energy of them |
//! | `update-creates-energy`, `update-not-settled` | grows, or changes again, when interactions remember |
//! | `state-unused` | has a state that changes nothing |
//! | `dissipation-creates-energy` | has a dissipation whose force drives what changes |
//! | `not-objective` | changes when the body is turned |
//! | `jump-in-stiffness` | has no jump of psi'' where branches meet, or at points of a table |
//! | `no-collapse-resistance`, `no-inversion-resistance` | stays finite where an interaction collapses, or is turned inside out |
//!
//! Before: a model. After: warnings. The energies are looked at for the defaults of their
//! parameters, at points of their declared domains: what is not found may still be there. The last
//! two are true of proven potentials, among them the quadratic bond, and so only told on request.

mod breaking;
mod dissipation;
mod domain;
mod jump;
mod remember;
mod rest;
mod subject;
mod vectors;

use piola_grammar::{Diagnostic, Severity, Span};

use crate::measure::Measure;
use crate::model::{CoupledEnergy, Model, Parameter, Variant};
use crate::values::Values;
use breaking::Breaking;
use dissipation::Dissipating;
use remember::Updating;
use subject::Subject;

/// One kind of thing that is probably a mistake.
#[derive(Clone, Copy, Debug)]
pub struct Lint {
    /// Stable kebab-case name.
    pub code: &'static str,
    /// Whether it is only told on request, because proven potentials have it too.
    pub pedantic: bool,
    look: Look,
}

/// What a lint looks at.
#[derive(Clone, Copy, Debug)]
enum Look {
    /// The whole potential; gives the measure whose energy is to be pointed at.
    Model(fn(&Model) -> Option<(Measure, Finding)>),
    /// One energy with values.
    Energy(fn(&Subject<'_>) -> Option<Finding>),
    /// One condition under which bonds break, with values.
    Break(fn(&Breaking) -> Option<Finding>),
    /// What is remembered, with values; gives the update that is to be pointed at.
    Update(fn(&Updating<'_>) -> Option<(usize, Finding)>),
    /// What bonds dissipate, with values.
    Dissipation(fn(&Dissipating) -> Option<Finding>),
    /// One state.
    State(fn(&Model, &Parameter) -> Option<Finding>),
    /// One energy of the vector of a bond.
    Vector(fn(&Variant, &CoupledEnergy) -> Option<Finding>),
}

/// What a lint has to say.
struct Finding {
    /// What is seen, and where.
    message: String,
    /// What to write instead.
    help: String,
}

/// All lints.
pub const LINTS: [Lint; 18] = [
    lint("not-stress-free", Look::Energy(rest::not_stress_free)),
    lint("not-stiff-at-rest", Look::Energy(rest::not_stiff)),
    lint("singular-in-domain", Look::Energy(domain::singular)),
    lint("jump-in-energy", Look::Energy(jump::in_energy)),
    lint("jump-in-force", Look::Energy(jump::in_force)),
    lint("no-bond-energy", Look::Model(no_bond_energy)),
    lint("breaks-at-rest", Look::Break(breaking::at_rest)),
    lint("never-breaks", Look::Break(breaking::never)),
    lint("breaks-in-compression", Look::Break(breaking::in_compression)),
    lint("breaks-nothing", Look::Break(breaking::nothing)),
    lint("update-creates-energy", Look::Update(remember::creates_energy)),
    lint("update-not-settled", Look::Update(remember::not_settled)),
    lint("dissipation-creates-energy", Look::Dissipation(dissipation::creates_energy)),
    lint("state-unused", Look::State(remember::unused)),
    lint("not-objective", Look::Vector(rest::not_objective)),
    pedantic("jump-in-stiffness", Look::Energy(jump::in_stiffness)),
    pedantic("no-collapse-resistance", Look::Energy(domain::no_collapse_resistance)),
    pedantic("no-inversion-resistance", Look::Energy(domain::no_inversion_resistance)),
];

const fn lint(code: &'static str, look: Look) -> Lint {
    Lint { code, pedantic: false, look }
}

const fn pedantic(code: &'static str, look: Look) -> Lint {
    Lint { code, pedantic: true, look }
}

impl Lint {
    /// What it says of a condition under which bonds break.
    fn look_at_break(&self, breaking: &Breaking) -> Option<Diagnostic> {
        let Look::Break(look) = self.look else { return None };
        Some(self.warning(breaking.span, look(breaking)?))
    }

    /// What it says of what is remembered.
    fn look_at_updates(&self, updating: &Updating<'_>) -> Option<Diagnostic> {
        let Look::Update(look) = self.look else { return None };
        let (update, finding) = look(updating)?;
        Some(self.warning(updating.updates[update].1, finding))
    }

    /// What it says of what bonds dissipate.
    fn look_at_dissipation(&self, dissipating: &Dissipating) -> Option<Diagnostic> {
        let Look::Dissipation(look) = self.look else { return None };
        Some(self.warning(dissipating.span, look(dissipating)?))
    }

    /// What it says of a state.
    fn look_at_state(&self, model: &Model, state: &Parameter) -> Option<Diagnostic> {
        let Look::State(look) = self.look else { return None };
        Some(self.warning(state.span, look(model, state)?))
    }

    /// What it says of an energy of the vector of a bond.
    fn look_at_vector(&self, variant: &Variant, energy: &CoupledEnergy) -> Option<Diagnostic> {
        let Look::Vector(look) = self.look else { return None };
        let finding = look(variant, energy).filter(|_| energy.clique == Measure::Length)?;
        Some(self.warning(energy.span, finding))
    }

    fn warning(&self, span: Span, Finding { message, help }: Finding) -> Diagnostic {
        let warning = Diagnostic::warning(self.code, span, message).help(help);
        warning.help(format!("if it is meant so: `allow \"{}\" \"why\"`", self.code))
    }
}

impl Model {
    /// What is probably a mistake, as warnings in the order of the text: each lint at most once for
    /// the energies of a measure, and not what the file allows.
    pub fn lint(&self, with_pedantic: bool) -> Vec<Diagnostic> {
        let mut wanted: Vec<Lint> = LINTS.to_vec();
        wanted.retain(|lint| with_pedantic || !lint.pedantic);
        wanted.retain(|lint| !self.allowed.iter().any(|code| code == lint.code));
        let mut found: Vec<Diagnostic> = Vec::new();
        for lint in &wanted {
            if let Look::Model(look) = lint.look {
                found.extend(look(self).map(|(measure, finding)| {
                    self.diagnostic(lint.code, measure, finding, String::new())
                }));
            }
        }
        for subjects in self.dimensions().flat_map(|dimension| Subject::examples(self, dimension)) {
            for warning in wanted.iter().filter_map(|lint| self.look(lint, &subjects)) {
                // What is found in two dimensions is mostly found in three too.
                if !found.iter().any(|f| f.code == warning.code && f.span == warning.span) {
                    found.push(warning);
                }
            }
        }
        let first = &self.variants[0];
        for energy in &first.coupled_energies {
            found.extend(wanted.iter().filter_map(|lint| lint.look_at_vector(first, energy)));
        }
        for lint in wanted.iter().filter(|lint| matches!(lint.look, Look::Vector(_))) {
            let of_families = vectors::not_objective(self).into_iter();
            found.extend(of_families.map(|(span, finding)| lint.warning(span, finding)));
        }
        let states = self.parameters.iter().filter(|parameter| parameter.is_state);
        for state in states {
            found.extend(wanted.iter().filter_map(|lint| lint.look_at_state(self, state)));
        }
        let mut of_bonds: Vec<Diagnostic> = Vec::new();
        for dimension in self.dimensions() {
            for breaking in Breaking::examples(self, dimension) {
                of_bonds.extend(wanted.iter().filter_map(|lint| lint.look_at_break(&breaking)));
            }
            let updating = |measure| Updating::examples(self, measure, dimension);
            let of_gradients = Updating::of_gradients(self, dimension);
            let of_families = of_gradients.into_iter().chain(Updating::of_points(self, dimension));
            for updating in Measure::ALL.into_iter().filter_map(updating).chain(of_families) {
                of_bonds.extend(wanted.iter().filter_map(|lint| lint.look_at_updates(&updating)));
            }
            if let Some(own) = Dissipating::examples(self, dimension) {
                of_bonds.extend(wanted.iter().filter_map(|lint| lint.look_at_dissipation(&own)));
            }
        }
        for warning in of_bonds {
            if !found.iter().any(|f| f.code == warning.code && f.span == warning.span) {
                found.push(warning);
            }
        }
        found.sort_by_key(|warning| warning.span);
        found
    }

    /// What makes a body with these values move without a load, or give way to any: energies with a
    /// force at rest, bonds without stiffness there, no bonds at all; as errors, and not what the file
    /// allows. Negative stiffness of triangles and tetrahedra is none: bonds may outweigh it. `others`
    /// says that the body has further energies that may make it stiff.
    pub fn unfit_at_rest(&self, values: &Values, others: bool) -> Vec<Diagnostic> {
        let subjects = Subject::all(self, values);
        let others = others
            || self.has_gradient_energy()
            || self.has_gathered_energy()
            || !self.coupled().is_empty();
        let is_bond = |subjects: &[Subject<'_>]| subjects[0].measure() == Measure::Length;
        let mut found = Vec::new();
        for lint in LINTS.iter().filter(|l| !self.allowed.iter().any(|code| code == l.code)) {
            let looks_at = |subjects: &[Subject<'_>]| match lint.code {
                "not-stress-free" => true,
                "not-stiff-at-rest" => is_bond(subjects) && !others,
                _ => false,
            };
            let looked_at = subjects.iter().filter(|subjects| looks_at(subjects));
            found.extend(looked_at.filter_map(|subjects| self.look(lint, subjects)));
            if lint.code == "no-bond-energy" && !others && !subjects.iter().any(|s| is_bond(s)) {
                let first = subjects.first().map(|subjects| subjects[0].measure());
                found.extend(first.and_then(only_cliques).map(|(measure, finding)| {
                    self.diagnostic(lint.code, measure, finding, String::new())
                }));
            }
        }
        found.sort_by_key(|error| error.span);
        found.into_iter().map(|error| Diagnostic { severity: Severity::Error, ..error }).collect()
    }

    /// An error about what all energies add up to, at the first of F, of gathered values or of several
    /// measures if there is one; nothing where the file allows its code.
    pub fn unfit_sum(&self, code: &'static str, message: String) -> Option<Diagnostic> {
        let variant = &self.variants[0];
        let gathered = variant.gathered_energies.iter().map(|energy| energy.span);
        let of_measures = variant.energies.iter().map(|energy| energy.span);
        let gradients = variant.gradient_energies.iter().map(|energy| energy.span);
        let coupled = variant.coupled_energies.iter().map(|energy| energy.span);
        let span = gradients.chain(gathered).chain(coupled).chain(of_measures).next();
        let allowed = self.allowed.iter().any(|allowed| allowed == code);
        let error = Diagnostic::error(code, span?, message)
            .help("look at its coefficients: `piola moduli` tells stress and stiffness at rest")
            .help(format!("if it is meant so: `allow \"{code}\" \"why\"`"));
        (!allowed).then_some(error)
    }

    /// What a lint says of the energies of one measure.
    fn look(&self, lint: &Lint, subjects: &[Subject<'_>]) -> Option<Diagnostic> {
        let Look::Energy(look) = lint.look else { return None };
        let (subject, finding) =
            subjects.iter().find_map(|subject| Some((subject, look(subject)?)))?;
        let values = subject.values_in_words();
        Some(self.diagnostic(lint.code, subject.measure(), finding, values))
    }

    /// A finding at the energies of a measure.
    fn diagnostic(
        &self,
        code: &'static str,
        measure: Measure,
        finding: Finding,
        label: String,
    ) -> Diagnostic {
        let energies = self.variants[0].energies.iter().filter(|e| e.measure == measure);
        let mut spans = energies.map(|energy| energy.span);
        let span = spans.next().unwrap_or_default();
        let mut warning = Diagnostic::warning(code, span, finding.message).label(label);
        for more in spans {
            warning = warning.note(more, "and this is added");
        }
        warning.help(finding.help).help(format!("if it is meant so: `allow \"{code}\" \"why\"`"))
    }
}

fn no_bond_energy(model: &Model) -> Option<(Measure, Finding)> {
    // What holds sides beside an area resists shear.
    if !model.coupled().is_empty() {
        return None;
    }
    only_cliques(*model.measures().first()?)
}

/// Energies that begin with those of this measure.
fn only_cliques(first: Measure) -> Option<(Measure, Finding)> {
    let what = match first {
        Measure::Length => return None,
        Measure::Area => "triangles can be sheared without changing their area",
        _ => "tetrahedra can be sheared without changing their volume",
    };
    Some((
        first,
        Finding {
            message: format!("no energy of bonds: {what}, so a body deforms freely"),
            help: "add an energy of bonds, for instance `psi(l) = 1/2*C1*L*(l/L - 1)^2`".into(),
        },
    ))
}

#[cfg(test)]
mod tests;
