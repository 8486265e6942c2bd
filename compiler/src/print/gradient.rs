//! Energies of the deformation gradient with their stress and its change, as text, LaTeX, listings.

use std::fmt::Write as _;

use super::latex::Latex;
use super::text::Text;
use super::{Names, component, lines};
use crate::density::DensityForm;
use crate::expression::NodeId;
use crate::expression::graph::components;
use crate::model::Model;
use crate::point::{GradientEnergyForms, GradientFunction, GradientFunctionKind};

/// The roots of a form with their names: `psi(F)`, `P11`, .., `dP11`, ..
fn roots(form: &DensityForm, dimension: usize, psi: &str) -> Vec<(String, NodeId)> {
    let components = components(dimension);
    let named = |tensor: &'static str, roots: &[NodeId]| -> Vec<(String, NodeId)> {
        let names = components.iter().map(|k| component(tensor, *k));
        names.zip(roots.iter().copied()).collect()
    };
    let mut all = vec![(psi.to_string(), form.psi)];
    all.extend(named("P", &form.gradient));
    all.extend(named("dP", &form.product));
    all
}

/// What the letters of principal stretches and axes mean, where a form has them.
fn legend(forms: &GradientEnergyForms, comment: char) -> String {
    if !forms.far.has_axes() {
        return String::new();
    }
    format!(
        "{comment} F_ab = sum_i s_i n_ia N_ib: principal stretches s, e = s - 1, principal axes n after \
         and N before deformation\n"
    )
}

/// psi, P = dpsi/dF and dP = d2psi/dF2 : dF as lines of text, named parts first: as written, and near
/// rest in `H = F - I` if there is such a form.
pub fn gradient_text(model: &Model, forms: &GradientEnergyForms) -> String {
    let mut out = legend(forms, '#');
    let notation = Text { names: Names { model } };
    let both = [("psi(F)", Some(&forms.far)), ("psi(H)", forms.near.as_ref())];
    for (psi, form) in both {
        let Some(form) = form else { continue };
        if psi == "psi(H)" {
            out.push_str("\n# near rest, with H = F - I\n");
        }
        for (name, text) in lines(&form.graph, &roots(form, forms.dimension, psi), &notation) {
            let _ = writeln!(out, "{name} = {text}");
        }
    }
    out
}

/// psi, P and dP as written, as an `align*` environment.
pub fn gradient_latex(model: &Model, forms: &GradientEnergyForms) -> String {
    let notation = Latex { names: Names { model } };
    let mut roots = roots(&forms.far, forms.dimension, r"\psi(F)");
    for (name, _) in roots.iter_mut().skip(1) {
        let (stem, digits) = name.split_at(name.len() - 2);
        let stem = if stem == "dP" { r"\mathrm{d}P" } else { stem };
        *name = format!("{stem}_{{{digits}}}");
    }
    let rows: Vec<String> = lines(&forms.far.graph, &roots, &notation)
        .into_iter()
        .map(|(name, text)| format!("  {name} &= {text}"))
        .collect();
    let legend = legend(forms, '%');
    format!("{legend}\\begin{{align*}}\n{}\n\\end{{align*}}\n", rows.join(" \\\\\n"))
}

/// Conditions of the deformation gradient under which bonds break, and what is remembered with it, in one
/// `align*` environment; nothing where there are none.
pub fn latex_of_gradient_functions(model: &Model, functions: &[GradientFunction]) -> String {
    let notation = Latex { names: Names { model } };
    let mut rows = Vec::new();
    for GradientFunction { kind, forms, .. } in functions {
        let name = match kind {
            GradientFunctionKind::Margin { number, .. } => format!("g_{{{number}}}"),
            GradientFunctionKind::Next(state) => super::latex::next(state),
        };
        let root = [(name, forms.far.psi)];
        let own = lines(&forms.far.graph, &root, &notation).into_iter();
        rows.extend(own.map(|(name, text)| format!("  {name} &= {text}")));
        if let GradientFunctionKind::Margin { number, holds_at_zero } = kind {
            let sign = if *holds_at_zero { r"\ge" } else { ">" };
            rows.push(format!(r"  &\text{{bonds break where }} g_{{{number}}} {sign} 0"));
        }
    }
    let Some(first) = functions.first() else { return String::new() };
    let legend = legend(&first.forms, '%');
    format!("{legend}\\begin{{align*}}\n{}\n\\end{{align*}}\n", rows.join(" \\\\\n"))
}

/// Every node of both forms with its number, then the roots.
pub fn gradient_listing(model: &Model, forms: &GradientEnergyForms) -> String {
    let mut out = String::new();
    let both = [("psi(F)", Some(&forms.far)), ("psi(H)", forms.near.as_ref())];
    for (psi, form) in both {
        let Some(form) = form else { continue };
        super::listing::nodes(&mut out, model, &form.graph);
        for (name, root) in roots(form, forms.dimension, psi) {
            let _ = writeln!(out, "{name} = %{}", root.0);
        }
    }
    out
}
