//! What is still lost, and by which subexpression: an audit with causes.

use super::functions::functions_at;
use super::{Place, Settings, audit, several};
use crate::measure::Argument;
use crate::model::Model;
use crate::point::GradientEnergyForms;
use crate::point::sample::Sample;
use crate::specialise::{CompileError, ScalarEnergy};
use crate::values::Values;
use crate::verify::cause::cause;
use crate::verify::families::a_second_later;
use crate::verify::remember::histories;
use crate::verify::stated::cause_of_gradient;
use crate::verify::{Cause, Subject};

/// A subexpression that loses digits in the compiled form.
#[derive(Clone, Debug)]
pub struct Lost {
    /// The energy it belongs to; nothing of a function of several numbers.
    pub argument: Option<Argument>,
    /// What it belongs to, if that is no energy.
    pub function: Option<Subject>,
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
        let Some(argument) = audit.argument else { continue };
        let forms = match argument {
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
                let argument = Some(argument);
                note(&mut all, Lost { argument, function: None, cause, at, error });
            }
        }
    }
    all_noted(&mut all, several::lost(model, values, settings)?);
    for values in histories(model, values)? {
        lost_of_functions(model, &values, settings, &mut all)?;
    }
    Ok(all)
}

/// The same of margins and next states, with what bonds remember by the values.
fn lost_of_functions(
    model: &Model,
    values: &Values,
    settings: &Settings,
    all: &mut Vec<Lost>,
) -> Result<(), CompileError> {
    let audits = functions_at(model, values, settings)?;
    model.derive_functions(values, settings.form, |subject, derived, _| {
        let audit = audits.iter().find(|audit| audit.function.as_ref() == Some(&subject));
        let missed = audit.into_iter().flat_map(|audit| &audit.regimes);
        for regime in missed.filter(|regime| regime.worst[0] > settings.bar) {
            let Some(Place::Interaction(point)) = regime.at[0] else { continue };
            let Some(cause) = cause(model, &derived.scalar_energy(), 0, point) else { continue };
            let (argument, error) = (Some(Argument::Measure(derived.measure)), regime.worst[0]);
            let function = Some(subject.clone());
            let at = Place::Interaction(point);
            note(all, Lost { argument, function, cause, at, error });
        }
        Ok(())
    })?;
    let later = a_second_later(model, values).without_fields();
    for (subject, forms) in model.gradient_functions_held(values, settings.form)? {
        let held = if matches!(subject, Subject::NextState(..)) { &later } else { values };
        let audit = audits.iter().find(|audit| audit.function.as_ref() == Some(&subject));
        let missed = audit.into_iter().flat_map(|audit| &audit.regimes);
        for regime in missed.filter(|regime| regime.worst[0] > settings.bar) {
            let Some(at @ Place::Gradient { gradient, change, direction, .. }) = &regime.at[0]
            else {
                continue;
            };
            let (gradient, change) = (gradient.clone(), change.clone());
            let sample = Sample { gradient, change, direction: direction.clone() };
            let cause = cause_of_gradient((model, held), &forms, 0, &sample);
            let (argument, error) = (Some(Argument::Gradient), regime.worst[0]);
            let (function, at) = (Some(subject.clone()), at.clone());
            all_noted(all, cause.map(|cause| Lost { argument, function, cause, at, error }));
        }
    }
    all_noted(
        all,
        several::functions(model, values, settings)?.into_iter().flat_map(|one| one.lost),
    );
    Ok(())
}

impl Lost {
    /// What loses them: `psi'(l)`, `margin of break when l/L - 1 > s0`.
    pub fn subject(&self) -> String {
        let order = self.cause.order;
        match (&self.function, self.argument) {
            (None, Some(argument)) => {
                format!("{}({})", argument.orders()[order], argument.symbol())
            }
            (None, None) => String::new(),
            (Some(Subject::NextState(_, text)), _) => format!("update {text}"),
            (Some(function @ Subject::Margin(..)), _) => {
                format!("the margin of `{}`", function.symbol())
            }
            (Some(function @ Subject::Gathering(text)), _) => {
                format!("the {} of {text}", function.orders()[order])
            }
            (Some(function), _) => {
                let of = ["psi", "the gradient of psi", "the product of psi"][order];
                format!("{of}({})", function.symbol())
            }
        }
    }
}

fn all_noted(all: &mut Vec<Lost>, more: impl IntoIterator<Item = Lost>) {
    more.into_iter().for_each(|one| note(all, one));
}

/// Adds a loss, or keeps the larger one of two of the same subexpression.
fn note(all: &mut Vec<Lost>, lost: Lost) {
    // What the text states is known by its place there: its derivatives have components of many kinds.
    let name = |cause: &Cause| match cause.stated {
        Some(stated) => (cause.order, Some(stated), String::new()),
        None => (cause.order, None, cause.expression.clone()),
    };
    let is_same = |known: &&mut Lost| {
        let is_one = known.argument == lost.argument && known.function == lost.function;
        is_one && name(&known.cause) == name(&lost.cause)
    };
    match all.iter_mut().find(is_same) {
        Some(known) if known.error >= lost.error => {}
        Some(known) => *known = lost,
        None => all.push(lost),
    }
}
