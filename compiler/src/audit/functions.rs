//! Conditions under which something breaks, what bonds remember, and what they dissipate.
//!
//! A margin is 0 at its threshold, so that it has no digits there; what counts is where it changes its sign.
//! The regime `zeros of margin` lies around thresholds: an error of one unit that rounding the inputs does not
//! excuse is a threshold that is off by one unit in the last place of the measure, or of the change since
//! rest where that is smaller.

use super::several::Found;
use super::{Audit, Settings, dissipation, gradient, measure};
use crate::kernel::{Kernel, Mode};
use crate::measure::Argument;
use crate::model::{Model, Of, OfFamily};
use crate::specialise::CompileError;
use crate::values::Values;
use crate::verify::Subject;
use crate::verify::families::a_second_later;
use crate::verify::remember::histories;

/// Audits margins, then next states, then what is dissipated, for these values: with what bonds remember at the start, and after some
/// histories, all in one.
///
/// # Errors
/// What cannot be compiled.
pub fn functions(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Audit>, CompileError> {
    let mut all: Vec<Audit> = Vec::new();
    for values in histories(model, &values.without_fields())? {
        for Found { audit, .. } in functions_at(model, &values, settings)? {
            match all.iter_mut().find(|known| known.function == audit.function) {
                Some(known) => known.join(audit),
                None => all.push(audit),
            }
        }
    }
    Ok(all)
}

/// The same with what bonds remember by the values; of gathered values with what loses digits.
pub(super) fn functions_at(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Found>, CompileError> {
    let variant =
        model.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
    let mode = Mode::Jit(settings.level);
    let mut all: Vec<Audit> = Vec::new();
    model.derive_functions(values, settings.form, |subject, derived, written| {
        let energy = derived.scalar_energy();
        let kernel = Kernel::new(energy.clone(), (mode, settings.form), || written.clone())?;
        let orders: &[&str] =
            if matches!(subject, Subject::Margin(..)) { &["margin"] } else { &["next"] };
        let argument = Argument::Measure(energy.measure);
        let of = (&kernel, &energy, &written);
        let regimes = measure::regimes(variant, values, argument, of, (settings, orders));
        all.push(Audit::of(subject, Some(argument), regimes));
        Ok(())
    })?;
    let gathered = super::several::functions(model, values, settings)?;
    let criteria = model.gradient_criteria(values, mode, settings.form)?;
    for one in criteria {
        let regimes = gradient::regimes(&one.margin, &one.written, (settings, 1));
        let function = Subject::Margin(Some(Argument::Gradient), one.text);
        all.push(Audit::of(function, Some(Argument::Gradient), regimes));
    }
    let later = a_second_later(model, values);
    for one in model.gradient_next_states(&later.without_fields(), mode, settings.form)? {
        let regimes = gradient::regimes(&one.next, &one.written, (settings, 1));
        let text = format!("{} = {}", model.input_name(one.state), one.text);
        let subject = Subject::NextState(Of::Family(OfFamily::Gradient), text);
        all.push(Audit::of(subject, Some(Argument::Gradient), regimes));
    }
    all.extend(dissipation::audit(model, values, settings)?);
    let alone = all.into_iter().map(|audit| Found { audit, lost: Vec::new() });
    Ok(alone.chain(gathered).collect())
}
