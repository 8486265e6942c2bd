//! Energies of several measures with their derivatives by each, as text, LaTeX, listings.

use std::fmt::Write as _;

use super::latex::Latex;
use super::text::Text;
use super::{Names, lines};
use crate::clique::Variable;
use crate::coupled::{CoupledForm, argument};
use crate::expression::NodeId;
use crate::measure::Measure;
use crate::model::Model;

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
    model.dimensions().last().and_then(|d| model.variant(d)).map_or_else(String::new, |variant| {
        format!("psi({})", argument(variant, clique).replace("), psi(", ") + psi("))
    })
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
        format!(r"\partial\psi/\partial {}", Latex::symbol(variable.symbol()))
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
