//! What is still lost, and by which subexpression: an audit of the energies of measures, with causes.

use super::{Place, Settings, audit};
use crate::measure::Argument;
use crate::model::Model;
use crate::specialise::CompileError;
use crate::values::Values;
use crate::verify::Cause;
use crate::verify::cause::cause;
use crate::verify::sample::Point;

/// A subexpression that loses digits in the compiled form.
#[derive(Clone, Debug)]
pub struct Lost {
    /// The energy it belongs to.
    pub argument: Argument,
    /// The subexpression.
    pub cause: Cause,
    /// Where the error is largest.
    pub at: Point,
    /// That error in `u = 2^-53` of the value; what rounded inputs excuse is left out.
    pub error: f64,
}

/// Every subexpression of energies of measures that an audit finds to lose digits beyond its bar, each
/// once for psi, psi' and psi'', with its largest error.
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
        let energy = match audit.argument {
            Argument::Measure(measure) => energies.iter().find(|e| e.measure == measure).cloned(),
            Argument::Square(measure) => model.squared(values, measure),
            Argument::Gradient => None,
        };
        let Some(energy) = energy else { continue };
        for regime in &audit.regimes {
            for order in (0..3).filter(|&order| regime.worst[order] > settings.bar) {
                let Some(Place::Interaction(at)) = regime.at[order] else { continue };
                let Some(cause) = cause(model, &energy, order, at) else { continue };
                let error = regime.worst[order];
                let of = Lost { argument: audit.argument, cause, at, error };
                let is_same = |known: &&mut Lost| {
                    let Lost { argument, cause, .. } = &**known;
                    *argument == of.argument
                        && (cause.order, &cause.expression)
                            == (of.cause.order, &of.cause.expression)
                };
                match all.iter_mut().find(is_same) {
                    Some(known) if known.error >= error => {}
                    Some(known) => *known = of,
                    None => all.push(of),
                }
            }
        }
    }
    Ok(all)
}
