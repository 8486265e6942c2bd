//! Energies of several measures with their derivatives by each, as text, LaTeX, listings, C.

use std::fmt::Write as _;

use super::c::statements;
use super::latex::Latex;
use super::text::Text;
use super::{Names, lines};
use crate::clique::Variable;
use crate::coupled::{CoupledForm, argument};
use crate::expression::{Input, Node, NodeId};
use crate::measure::Measure;
use crate::model::{DIRECTIONS, Model};

/// psi and its derivatives by each measure, with their names.
fn roots(
    form: &CoupledForm,
    psi: String,
    name: impl Fn(&Variable) -> String,
) -> Vec<(String, NodeId)> {
    let derivatives = form.variables.iter().map(name).zip(form.density.gradient.iter().copied());
    std::iter::once((psi, form.density.psi)).chain(derivatives).collect()
}

fn head(model: &Model, clique: Measure) -> String {
    model
        .dimensions()
        .last()
        .and_then(|d| model.variant(d))
        .map_or_else(String::new, |variant| format!("psi({})", argument(variant, clique)))
}

/// What the letters mean, where there is an angle.
fn legend(form: &CoupledForm, head: &str, comment: char) -> String {
    match head.contains("angle") && form.variables.len() > 1 {
        true => {
            format!("{comment} tan(angle) = 2*a/(l1^2 + l2^2 - l3^2), and so on for all corners\n")
        }
        false => String::new(),
    }
}

/// psi and `dpsi/dl1`, .. as lines of text, named parts first.
pub fn coupled_text(model: &Model, clique: Measure, form: &CoupledForm) -> String {
    let (head, notation) = (head(model, clique), Text { names: Names { model } });
    let mut out = legend(form, &head, '#');
    let roots = roots(form, head, |variable| format!("dpsi/d{}", variable.symbol()));
    for (name, text) in lines(&form.density.graph, &roots, &notation) {
        let _ = writeln!(out, "{name} = {text}");
    }
    out
}

/// The same as an `align*` environment.
pub fn coupled_latex(model: &Model, clique: Measure, form: &CoupledForm) -> String {
    let notation = Latex { names: Names { model } };
    let by = |variable: &Variable| {
        let symbol = match variable.inputs[0] {
            Input::Part(part) => Latex::part(part),
            _ => Latex::symbol(variable.symbol()),
        };
        format!(r"\partial\psi/\partial {symbol}")
    };
    let head = head(model, clique);
    let roots = roots(form, r"\psi".to_string(), by);
    let rows: Vec<String> = lines(&form.density.graph, &roots, &notation)
        .into_iter()
        .map(|(name, text)| format!("  {name} &= {text}"))
        .collect();
    let legend = legend(form, &head, '%');
    format!("{legend}\\begin{{align*}}\n{}\n\\end{{align*}}\n", rows.join(" \\\\\n"))
}

/// Every node with its number, then the roots.
pub fn coupled_listing(model: &Model, clique: Measure, form: &CoupledForm) -> String {
    let mut out = String::new();
    super::listing::nodes(&mut out, model, &form.density.graph);
    let by = |variable: &Variable| format!("dpsi/d{}", variable.symbol());
    for (name, root) in roots(form, head(model, clique), by) {
        let _ = writeln!(out, "{name} = %{}", root.0);
    }
    out
}

/// Two C functions, to follow those of [`super::c_source`]:
/// `void NAME_triangle(size_t n, const double *measures, const double *reference, const double *change,
/// double *psi, double *gradient)` and
/// `void NAME_triangle_product(size_t n, .., const double *direction, double *product)`, or `tetrahedron`.
/// Arrays hold measure after measure of `n` interactions, in the order that a comment gives; `change` is
/// the measure over that at rest, less 1. Bonds, `NAME_bond`, have their length and what their ends have moved by,
/// and the components of the unit vector between these at rest as arrays of their own.
pub fn coupled_c(model: &Model, clique: Measure, form: &CoupledForm) -> String {
    let entry = |array: &str, k: usize| format!("{array}[{k} * n + i]");
    let holds = |number: &u16| {
        let input = Node::Input(Input::Parameter(*number));
        form.density.graph.nodes().any(|(_, node)| node == input)
    };
    let all = model.directions(DIRECTIONS);
    let directions = all.start..all.clone().rev().find(holds).map_or(all.start, |last| last + 1);
    let input = |input| {
        let of = |variable: &Variable| variable.inputs.iter().position(|own| *own == input);
        let found = form.variables.iter().map(of).enumerate();
        match (input, found.filter_map(|(k, place)| Some((k, place?))).next()) {
            (Input::Direction(k), _) => entry("direction", usize::from(k)),
            (_, Some((k, place))) => entry(["measures", "reference", "change"][place], k),
            (Input::Parameter(number), _) => match directions.clone().position(|own| own == number)
            {
                Some(axis) => format!("direction_{}[i]", axis + 1),
                None => "NAN".into(),
            },
            // Specialisation has put numbers in the place of all others.
            _ => "NAN".into(),
        }
    };
    let given: String =
        (1..=directions.len()).map(|k| format!("const double *direction_{k}, ")).collect();
    let name = format!("{}_{}", model.name(), clique.interaction());
    let symbols: Vec<&str> = form.variables.iter().map(Variable::symbol).collect();
    let mut out = format!("/* measures of a {}: {} */\n", clique.interaction(), symbols.join(", "));
    let density = &form.density;
    for (name, arrays, with_direction) in [
        (name.clone(), "double *psi, double *gradient", false),
        (format!("{name}_product"), "const double *direction, double *product", true),
    ] {
        let (array, roots) = match with_direction {
            true => ("product", &density.product),
            false => ("gradient", &density.gradient),
        };
        let psi = Some(("psi[i]".to_string(), density.psi)).filter(|_| !with_direction);
        let all = roots.iter().enumerate().map(|(k, root)| (entry(array, k), *root));
        let (targets, roots): (Vec<String>, Vec<NodeId>) = psi.into_iter().chain(all).unzip();
        let (graph, roots) = density.graph.extract(&roots);
        let _ = write!(
            out,
            "\nvoid {name}(size_t n, const double *measures, const double *reference,\n\
             \x20   const double *change, {given}{arrays}) {{\n\
             \x20 for (size_t i = 0; i < n; i++) {{\n"
        );
        statements(&mut out, &graph, &input, targets.into_iter().zip(roots));
        out.push_str("  }\n}\n");
    }
    out
}
