//! Models and graphs as plain listings, for reading and for golden files.

use std::fmt::Write as _;

use super::Names;
use crate::expression::{ExprGraph, Node, NodeId};
use crate::measure::Measure;
use crate::model::Model;

/// What the checker made of a file: parameters with their SI units, energies with theirs.
pub fn model_listing(model: &Model) -> String {
    let mut out = format!("potential {}\n", model.name());
    for variant in [2, 3].into_iter().filter_map(|d| model.variant(d)) {
        let d = variant.dimension;
        let _ = writeln!(out, "in {d} dimensions");
        let parameters = model.parameters().iter().zip(&variant.units).zip(&variant.defaults);
        for ((parameter, unit), default) in parameters {
            let _ = write!(out, "  parameter {}", parameter.name);
            if let Some(default) = default {
                let _ = write!(out, " = {default}");
            }
            let _ = write!(out, ": {}", unit.dimension.describe());
            if unit.scale != 1.0 {
                let _ = write!(out, ", 1 is {:e} in SI units", unit.scale);
            }
            out.push('\n');
        }
        for energy in &variant.energies {
            let unit = Model::energy_unit(energy.measure, d);
            let _ = writeln!(out, "  psi({}) in {unit} = {}", energy.measure.symbol(), energy.text);
        }
        for energy in &variant.gradient_energies {
            let _ = writeln!(out, "  psi(F) in J/m^3 = {}", energy.text);
        }
        for (number, integral) in variant.integrals.iter().enumerate() {
            let (number, text) = (number + 1, &integral.text);
            let _ = match integral.is_function {
                true => writeln!(out, "  I{number} = {text}"),
                false => writeln!(out, "  I{number} = integral({text})"),
            };
        }
        for energy in &variant.gathered_energies {
            let unit = match energy.of_bonds {
                true => Model::energy_unit(Measure::Length, d),
                false => "J/m^3".to_string(),
            };
            let _ = writeln!(out, "  psi({}) in {unit} = {}", energy.head, energy.text);
        }
        for energy in &variant.coupled_energies {
            let unit = Model::energy_unit(energy.clique, d);
            let _ = write!(out, "  psi({}) in {unit} = {}", energy.head, energy.text);
            let _ = match energy.orders.len() {
                1 => writeln!(out),
                n => writeln!(out, ", the mean over {n} orders of the points"),
            };
        }
        for domain in &variant.domains {
            let _ = writeln!(out, "  domain {domain}");
        }
        for one in &variant.dissipations {
            let _ = writeln!(out, "  dissipation(l) in W/m^{} = {}", 2 * d, one.text);
        }
        let families = variant.family_breaks.iter().map(|breaking| &breaking.text);
        for text in variant.breaks.iter().map(|breaking| &breaking.text).chain(families) {
            let _ = writeln!(out, "  break when {text}");
        }
    }
    for constraint in model.constraints() {
        let _ = writeln!(out, "constraint {}", constraint.text);
    }
    out
}

/// Every node of a graph with its number, then the roots.
pub fn graph_listing(
    model: &Model,
    measure: Measure,
    graph: &ExprGraph,
    roots: &[NodeId],
) -> String {
    let mut out = String::new();
    nodes(&mut out, model, graph);
    for (name, root) in super::root_names(measure).iter().zip(roots) {
        let _ = writeln!(out, "{name} = %{}", root.0);
    }
    out
}

/// A line for every node.
pub(super) fn nodes(out: &mut String, model: &Model, graph: &ExprGraph) {
    let names = Names { model };
    for (id, node) in graph.nodes() {
        let text = match node {
            Node::Number(bits) => format!("{:?}", f64::from_bits(bits)),
            Node::Truth(holds) => holds.to_string(),
            Node::Input(input) => names.input(input),
            Node::Unary(f, x) => format!("{} %{}", f.name(), x.0),
            Node::PowerConstant(x, bits) => format!("%{} ^ {:?}", x.0, f64::from_bits(bits)),
            Node::Strain(x, bits) => format!("strain %{} {:?}", x.0, f64::from_bits(bits)),
            Node::Binary(o, x, y) => format!("%{} {} %{}", x.0, o.name(), y.0),
            Node::Compare(o, x, y) => format!("%{} {} %{}", x.0, o.name(), y.0),
            Node::And(x, y) => format!("%{} and %{}", x.0, y.0),
            Node::Or(x, y) => format!("%{} or %{}", x.0, y.0),
            Node::Not(x) => format!("not %{}", x.0),
            Node::Select(c, x, y) => format!("if %{} then %{} else %{}", c.0, x.0, y.0),
        };
        let _ = writeln!(out, "%{} = {text}", id.0);
    }
}
