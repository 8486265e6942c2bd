//! What is still lost, and by which subexpression: an audit with causes.

use super::{Place, Settings, audit};
use crate::measure::Argument;
use crate::model::Model;
use crate::point::GradientEnergyForms;
use crate::point::sample::Sample;
use crate::specialise::{CompileError, ScalarEnergy};
use crate::values::Values;
use crate::verify::Cause;
use crate::verify::cause::cause;
use crate::verify::stated::cause_of_gradient;

/// A subexpression that loses digits in the compiled form.
#[derive(Clone, Debug)]
pub struct Lost {
    /// The energy it belongs to.
    pub argument: Argument,
    /// The subexpression.
    pub cause: Cause,
    /// Where the error is largest.
    pub at: Place,
    /// That error in `u = 2^-53` of the value; what rounded inputs excuse is left out.
    pub error: f64,
}

/// An energy as compiled.
enum Forms {
    Measure(ScalarEnergy),
    Gradient(Box<GradientEnergyForms>),
}

/// Every subexpression that an audit finds to lose digits beyond its bar, each once for psi, psi' and
/// psi'' (of F psi, P and dP), with its largest error.
///
/// # Errors
/// Energies that cannot be compiled.
pub fn lost(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Lost>, CompileError> {
    let energies = model.specialise_as(values, settings.form)?.energies;
    let mut all: Vec<Lost> = Vec::new();
    for audit in audit(model, values, settings)?.0 {
        let forms = match audit.argument {
            Argument::Measure(measure) => {
                energies.iter().find(|e| e.measure == measure).cloned().map(Forms::Measure)
            }
            Argument::Square(measure) => model.squared(values, measure).map(Forms::Measure),
            Argument::Gradient => model
                .specialise_gradient(values, settings.form)?
                .0
                .map(|forms| Forms::Gradient(Box::new(forms))),
        };
        let Some(forms) = forms else { continue };
        for regime in &audit.regimes {
            for order in (0..3).filter(|&order| regime.worst[order] > settings.bar) {
                let Some(at) = regime.at[order].clone() else { continue };
                let cause = match (&forms, &at) {
                    (Forms::Measure(energy), Place::Interaction(at)) => {
                        cause(model, energy, order, *at)
                    }
                    (
                        Forms::Gradient(forms),
                        Place::Gradient { gradient, change, direction, .. },
                    ) => {
                        let (gradient, change) = (gradient.clone(), change.clone());
                        let sample = Sample { gradient, change, direction: direction.clone() };
                        cause_of_gradient((model, values), forms, order, &sample)
                    }
                    _ => None,
                };
                let Some(cause) = cause else { continue };
                let error = regime.worst[order];
                note(&mut all, Lost { argument: audit.argument, cause, at, error });
            }
        }
    }
    Ok(all)
}

/// Adds a loss, or keeps the larger one of two of the same subexpression.
fn note(all: &mut Vec<Lost>, lost: Lost) {
    // What the text states is known by its place there: its derivatives have components of many kinds.
    let name = |cause: &Cause| match cause.stated {
        Some(stated) => (cause.order, Some(stated), String::new()),
        None => (cause.order, None, cause.expression.clone()),
    };
    let is_same = |known: &&mut Lost| {
        known.argument == lost.argument && name(&known.cause) == name(&lost.cause)
    };
    match all.iter_mut().find(is_same) {
        Some(known) if known.error >= lost.error => {}
        Some(known) => *known = lost,
        None => all.push(lost),
    }
}
