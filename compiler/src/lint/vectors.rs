//! Energies of what points gather of vectors that a rotation of the whole body changes.

use piola_grammar::Span;

use super::Finding;
use super::subject::example;
use crate::kernel::Mode;
use crate::model::Model;
use crate::specialise::Form;
use crate::verify::vectors::turned;

/// By which part of itself an energy must change to be told.
const TOLD: f64 = 1e-9;

/// The first energy of points, and of bonds, that is not objective.
pub(super) fn not_objective(model: &Model) -> Vec<(Span, Finding)> {
    if !model.gathers_vectors() {
        return Vec::new();
    }
    let mut found: Vec<(Span, Finding)> = Vec::new();
    for dimension in model.dimensions() {
        let (Some(values), Some(variant)) = (example(model, dimension), model.variant(dimension))
        else {
            continue;
        };
        let values = values.with_states(model).without_parameters_that_vary(model);
        let mut kernels = None;
        let how = (Mode::Interpreter, Form::Textbook);
        let compiled = model.compile_vectors(&values, how, &mut kernels);
        let (Ok(_), Some(kernels)) = (compiled, kernels) else { continue };
        let parts = turned(&kernels, (model, &values));
        for ([at_rest, turned], of_bonds) in parts.into_iter().zip([false, true]) {
            let size = at_rest.abs().max(turned.abs());
            let is_told = (at_rest - turned).abs() > TOLD * size;
            let mut own = variant.gathered_energies.iter().filter(|one| one.of_bonds == of_bonds);
            let Some(energy) = own.next().filter(|_| is_told) else { continue };
            if found.iter().any(|(span, _)| *span == energy.span) {
                continue;
            }
            let message = format!(
                "psi({}) is not objective: a body that is turned as a whole stores energy",
                energy.head
            );
            let help = "no rotation changes what is made of products of vectors that turn with the body, `G'*G` of \
                        a gathered gradient, `xi*xi`; `Xi` and given directions stay where they are";
            found.push((energy.span, Finding { message, help: help.into() }));
        }
    }
    found
}
