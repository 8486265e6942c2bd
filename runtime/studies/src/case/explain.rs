//! Why the energy of an interaction is not a finite number: the interaction is evaluated once more,
//! in the open, down to the operation that failed. And which entry of a scene leaves a body free.

use std::fmt::Write as _;

use piola_compiler::expression::interpret::Interpreter;
use piola_compiler::expression::{ExprGraph, Input, Node, NodeId};
use piola_compiler::print::quoted;
use piola_compiler::{Interval, Measure, Model, Values, Variant};
use piola_grammar::Diagnostic;
use piola_mechanics::energy::{Argument, NonFinite};
use piola_solvers::rigid_modes::UnderConstrained;

use super::potential::is_sheet;
use super::{Case, CaseError, Potential};
use crate::scene::Scene;

/// A message of several lines: what, the points, the energy as written with its parameters, the
/// operation that failed.
pub(crate) fn explain(case: &Case, found: &NonFinite) -> String {
    let points: Vec<String> =
        found.points.iter().map(|&p| case.body.user_index()[p].to_string()).collect();
    if found.argument == Argument::Gathered {
        return format!(
            "an energy of gathered values or a derivative is not finite for the point {}: its first \
             integral is {:e}",
            points.join(", "),
            found.value
        ) + &displaced(case, found);
    }
    if found.argument == Argument::Rate {
        let mut text = format!(
            "what is dissipated or a derivative is not finite for the bond of the points {}: rate(l) = \
             {:e}, L = {:e}",
            points.join(", "),
            found.value,
            found.reference
        ) + &displaced(case, found);
        let all = case.potentials.iter().flat_map(|potential| potential.model.dissipations());
        all.for_each(|one| text += &format!("\n  dissipation(l) = {}", one.text));
        return text;
    }
    let Argument::Measure(measure) = found.argument else {
        let place = if points.len() == 1 { "the point" } else { "the bond of the points" };
        if let Some(bound) = left_domain(case, found.value) {
            return format!(
                "psi(F) is declared for {bound} alone, and J = {:e} for {place} {}",
                found.value,
                points.join(", ")
            ) + &displaced(case, found);
        }
        return format!(
            "psi(F) or a derivative is not finite for {place} {}: det F = {:e}{}{}",
            points.join(", "),
            found.value,
            if is_sheet(&case.scene) {
                " in the plane (plane stress: or no thickness leaves the faces free)"
            } else {
                ""
            },
            other_domains(case)
        ) + &displaced(case, found);
    };
    let (symbol, twin) = (measure.symbol(), measure.reference_symbol());
    let arguments: Vec<&str> =
        case.potentials.iter().flat_map(|p| p.model.of_clique(measure)).collect();
    let argument =
        if arguments.is_empty() { symbol.to_string() } else { arguments.join(") + psi(") };
    let kind = measure.interaction();
    let named = format!("{kind} of the points {}", points.join(", "));
    let mut text = if found.inverted {
        format!("psi({argument}) forbids that the {named} turns inside out")
    } else {
        format!("psi({argument}) or a derivative is not finite for the {named}")
    };
    let _ = write!(text, ": {symbol} = {:e}, {twin} = {:e}", found.value, found.reference);
    text += &displaced(case, found);
    let laws = case.materials.as_ref().map(|materials| materials.laws_of(&found.points));
    let of_points = case
        .potentials
        .iter()
        .zip(&case.scene.materials)
        .filter(|(_, material)| laws.as_ref().is_none_or(|laws| laws.contains(&material.law)));
    let readings = of_points.filter_map(|(potential, material)| {
        let Potential { model, .. } = potential;
        let variant = model.variant(case.body.dimension())?;
        let has = variant.energies.iter().any(|energy| energy.measure == measure);
        let values = case.values_between((potential, material.law), &found.points);
        let varies = !potential.values.fields.is_empty();
        has.then_some(Reading { model, values, varies, variant, measure, found })
    });
    let readings: Vec<Reading<'_>> = readings.collect();
    // Of several potentials the one that fails, where that shows in what is written.
    let failed = |energy: &&Reading<'_>| energy.failed_as_written(found.value).is_some();
    let failing = readings.iter().find(failed);
    for energy in failing.map_or(&readings[..], std::slice::from_ref) {
        energy.write_statements(&mut text);
        let _ = write!(text, "\n  {}", energy.reason());
    }
    let variants = case.potentials.iter().filter_map(|p| p.model.variant(case.body.dimension()));
    let of_several = variants.flat_map(|variant| &variant.coupled_energies);
    for energy in of_several.filter(|energy| energy.clique == measure) {
        let _ = write!(text, "\n  psi({}) = {}", energy.head, energy.text);
    }
    text
}

/// The declared domain of psi(F) that does not hold this volume ratio.
fn left_domain(case: &Case, j: f64) -> Option<&Interval> {
    domains_of_gradients(case).find(|domain| domain.of_volume_ratio && !domain.contains(j))
}

/// The declared domains of psi(F).
fn domains_of_gradients(case: &Case) -> impl Iterator<Item = &Interval> {
    let variants = case.potentials.iter().filter_map(|p| p.model.variant(case.body.dimension()));
    let domains = variants.flat_map(|variant| &variant.domains);
    domains.filter(|domain| domain.argument == piola_compiler::Argument::Gradient)
}

/// What else psi(F) is declared for, where it may have been left.
fn other_domains(case: &Case) -> String {
    let others = domains_of_gradients(case).filter(|domain| !domain.of_volume_ratio);
    others.map(|domain| format!("; psi(F) is declared for {domain} alone")).collect()
}

/// A line for each point: where it was and how far it moved.
fn displaced(case: &Case, found: &NonFinite) -> String {
    let mut text = String::new();
    let d = case.body.dimension();
    for (number, displacement) in found.points.iter().zip(found.displacements.chunks_exact(d)) {
        let place = case.body.user_index()[*number];
        let position = tuple(&case.body.position(*number)[..d]);
        let _ = write!(
            text,
            "\n  point {place} at {position} m, displaced by {} m",
            tuple(displacement)
        );
    }
    text
}

fn tuple(numbers: &[f64]) -> String {
    let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
    format!("({})", numbers.join(", "))
}

/// The energy of one interaction, read again.
struct Reading<'a> {
    model: &'a Model,
    /// Of fields those at `t = 0`.
    values: Values,
    /// Whether there are some.
    varies: bool,
    variant: &'a Variant,
    measure: Measure,
    found: &'a NonFinite,
}

impl Reading<'_> {
    /// The roots of the energy as written.
    fn roots(&self) -> Vec<NodeId> {
        let energies = self.variant.energies.iter().filter(|e| e.measure == self.measure);
        energies.map(|energy| energy.root).collect()
    }

    /// The energy as written, and the parameters it depends on in SI units.
    fn write_statements(&self, text: &mut String) {
        for energy in self.variant.energies.iter().filter(|e| e.measure == self.measure) {
            let _ = write!(text, "\n  psi({}) = {}", self.measure.symbol(), energy.text);
        }
        let roots = self.roots();
        let names = self.model.parameters().iter().zip(&self.values.parameters).enumerate();
        let used = names
            .filter(|(i, _)| self.variant.graph.depends_on(&roots, Input::Parameter(*i as u16)))
            .map(|(_, (parameter, value))| format!("{} = {value:e}", parameter.name));
        let used: Vec<String> = used.collect();
        if !used.is_empty() {
            let when = if self.varies { ", at t = 0 where they vary" } else { "" };
            let _ = write!(text, "\n  with {} in SI units{when}", used.join(", "));
        }
    }

    /// What failed: in the energy as written, else in its derivatives, else beyond them.
    fn reason(&self) -> String {
        let (value, reference) = (self.found.value, self.found.reference);
        let mut places = vec![value];
        if self.found.inverted {
            places.extend([0.0, -reference]);
        }
        let failed = places.iter().find_map(|&place| self.failed_as_written(place));
        failed.unwrap_or_else(|| {
            if self.found.inverted { self.declared_domain() } else { self.failed_derivative() }
        })
    }

    fn failed_as_written(&self, value: f64) -> Option<String> {
        let read = self.read(&self.variant.graph, value);
        self.roots().iter().find_map(|&root| self.failed(&self.variant.graph, root, &read))
    }

    fn declared_domain(&self) -> String {
        let own = piola_compiler::Argument::Measure(self.measure);
        let domain = self.variant.domains.iter().find(|d| d.argument == own);
        match domain {
            Some(domain) => format!("the declared domain of {} ends before", domain.text),
            None => "its energy is not finite beyond".to_string(),
        }
    }

    /// The energy is finite, so a derivative is not, or what is made of them.
    fn failed_derivative(&self) -> String {
        let symbol = self.measure.symbol();
        let specialised = self.model.specialise(&self.values).ok();
        let energy = specialised
            .and_then(|all| all.energies.into_iter().find(|e| e.measure == self.measure));
        let Some(energy) = energy else { return format!("psi({symbol}) itself is finite") };
        let read = self.read(&energy.graph, self.found.value);
        for (name, root) in ["psi", "psi'", "psi''"].iter().zip(energy.roots) {
            if let Some(failed) = self.failed(&energy.graph, root, &read) {
                return format!("in {name}({symbol}), {failed}");
            }
        }
        let [psi, first, second] = energy.roots.map(|root| read.number(root));
        if self.found.value == 0.0 && first != 0.0 {
            return format!(
                "psi'({symbol}) = {first:e} at {symbol} = 0, where a force has no direction"
            );
        }
        format!(
            "psi = {psi:e}, psi' = {first:e}, psi'' = {second:e}: their products with the weight of \
             the interaction and with its shape are not finite"
        )
    }

    fn read(&self, graph: &ExprGraph, value: f64) -> Interpreter<f64> {
        read(graph, &self.values, value, self.found.reference)
    }

    /// The operation that made a root a number that is not finite: from the root to an operand that
    /// is not finite, as long as there is one. Of a choice only the branch taken counts.
    fn failed(&self, graph: &ExprGraph, root: NodeId, read: &Interpreter<f64>) -> Option<String> {
        let is_number = |id: NodeId| {
            !matches!(
                graph[id],
                Node::Truth(_) | Node::Compare(..) | Node::And(..) | Node::Or(..) | Node::Not(_)
            )
        };
        let operands = |id: NodeId| -> Vec<NodeId> {
            match graph[id] {
                Node::Select(condition, x, y) => vec![if read.truth(condition) { x } else { y }],
                node => node.operands().filter(|&x| is_number(x)).collect(),
            }
        };
        let mut node = root;
        if read.number(node).is_finite() {
            return None;
        }
        while let Some(&cause) = operands(node).iter().find(|&&x| !read.number(x).is_finite()) {
            node = cause;
        }
        let print = |id: NodeId| quoted(self.model, graph, id);
        let given: Vec<String> = operands(node)
            .iter()
            .filter(|&&x| graph.as_number(x).is_none())
            .map(|&x| format!("{} = {:e}", print(x), read.number(x)))
            .collect();
        let with =
            if given.is_empty() { String::new() } else { format!(" with {}", given.join(", ")) };
        Some(format!("{} is {:e}{with}", print(node), read.number(node)))
    }
}

/// A graph evaluated at a measure and its value at rest.
pub(crate) fn read(
    graph: &ExprGraph,
    values: &Values,
    measure: f64,
    reference: f64,
) -> Interpreter<f64> {
    let mut interpreter = Interpreter::new();
    interpreter.run(graph, |input| match input {
        Input::Current(_) => measure,
        Input::Reference(_) => reference,
        Input::Change(_) => (measure - reference) / reference,
        Input::Horizon => values.horizon,
        Input::Parameter(i) => values.parameter(i).unwrap_or(f64::NAN),
        // A measure knows nothing of the deformation gradient, nor of families.
        _ => f64::NAN,
    });
    interpreter
}

/// A motion that nothing holds, at the first entry that holds or pulls something.
pub(crate) fn free_motion(scene: &Scene, error: &UnderConstrained) -> CaseError {
    let held = scene.prescriptions.first().map(|entry| entry.set.span);
    let pulled = scene.loads.first().map(|entry| entry.set.span);
    let (span, label) = match (held, pulled) {
        (Some(span), _) => (span, "what is prescribed, here and below, does not hold it"),
        (None, Some(span)) => (span, "nothing holds what this pulls"),
        (None, None) => (scene.material().potential.span, "no displacement is prescribed"),
    };
    let found = Diagnostic::error("free-motion", span, error.to_string()).label(label).help(
        "write a [[prescribe]] with a set of that part, and 0 where the component of u is \"free\": \
         without it the forces do not say where the part is",
    );
    CaseError::Scene(scene.report(vec![found]))
}
