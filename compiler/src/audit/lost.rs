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
                    (Forms::Gradient(forms), at) => sample_at(at).and_then(|sample| {
                        cause_of_gradient((model, values), forms, order, &sample)
                    }),
                    _ => None,
                };
                let Some(cause) = cause else { continue };
                let error = regime.worst[order];
                let argument = Some(argument);
                note(&mut all, Lost { argument, function: None, cause, at, error });
            }
        }
    }
    several::lost(model, values, settings)?.into_iter().for_each(|one| note(&mut all, one));
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
    let found = functions_at(model, values, settings)?;
    // Where a function loses digits, and how many.
    let missed = |subject: &Subject| {
        let own = found.iter().find(|one| one.audit.function.as_ref() == Some(subject));
        let regimes = own.into_iter().flat_map(|one| &one.audit.regimes);
        let missed = regimes.filter(|regime| regime.worst[0] > settings.bar);
        let places = missed.filter_map(|regime| Some((regime.at[0].clone()?, regime.worst[0])));
        places.collect::<Vec<(Place, f64)>>()
    };
    let mut lose = |subject: &Subject, argument, at: Place, error, cause: Option<Cause>| {
        let Some(cause) = cause else { return };
        let (argument, function) = (Some(argument), Some(subject.clone()));
        note(all, Lost { argument, function, cause, at, error });
    };
    model.derive_functions(values, settings.form, |subject, derived, _| {
        let argument = Argument::Measure(derived.measure);
        for (at, error) in missed(&subject) {
            let Place::Interaction(point) = at else { continue };
            let cause = cause(model, &derived.scalar_energy(), 0, point);
            lose(&subject, argument, at, error, cause);
        }
        Ok(())
    })?;
    let later = a_second_later(model, values).without_fields();
    for (subject, forms) in model.gradient_functions_held(values, settings.form)? {
        let held = if matches!(subject, Subject::NextState(..)) { &later } else { values };
        for (at, error) in missed(&subject) {
            let Some(sample) = sample_at(&at) else { continue };
            let cause = cause_of_gradient((model, held), &forms, 0, &sample);
            lose(&subject, Argument::Gradient, at, error, cause);
        }
    }
    found.into_iter().flat_map(|one| one.lost).for_each(|one| note(all, one));
    Ok(())
}

/// The gradient of a place, where it is one of gradients.
fn sample_at(place: &Place) -> Option<Sample> {
    let Place::Gradient { gradient, change, direction, .. } = place else { return None };
    let (gradient, change) = (gradient.clone(), change.clone());
    Some(Sample { gradient, change, direction: direction.clone() })
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
