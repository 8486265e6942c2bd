//! Energies of points and of bonds of numbers that points gather, with conditions and next states of these.

use super::{CauseAt, Found, Function, Sampled, audited, power_of_ten, strains};
use crate::audit::Settings;
use crate::compile::Kind;
use crate::gathered::{GatheredKernel, GatheredKernels, WrittenGatheredEnergy, argument};
use crate::kernel::{Kernel, Mode};
use crate::model::{Break, Model, Of, OfFamily, Update};
use crate::specialise::{CompileError, Known};
use crate::values::Values;
use crate::verify::Subject;
use crate::verify::families::a_second_later;
use crate::verify::gathered_near::Place;
use crate::verify::sample::Random;
use crate::verify::stated::cause_of_gathered;

pub(super) fn audit(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Found>, CompileError> {
    let Some(gathered) = compiled(model, values, settings)? else { return Ok(Vec::new()) };
    let variant =
        model.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
    let audit = |kernel: &GatheredKernel| {
        let written = model.written_gathered(values, kernel.of_bonds());
        let subject = Subject::Gathered(argument(variant, kernel.of_bonds()));
        let (form, _) = model.specialise_gathered(values, kernel.of_bonds(), settings.form)?;
        let cause = |order: usize, given: &[f64]| {
            let place = Place::of(kernel.of_bonds(), given);
            cause_of_gathered((model, values), form.as_ref()?, order, place.inputs())
        };
        let of = (kernel, &written, &gathered.integrals[..]);
        Ok(judged(of, (settings, 3), subject, Box::new(cause)))
    };
    [&gathered.points, &gathered.bonds].into_iter().flatten().map(audit).collect()
}

/// Margins of conditions of gathered numbers, then what states of points become, with states by the values.
///
/// # Errors
/// What cannot be compiled.
pub(super) fn functions(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Found>, CompileError> {
    let mut all = Vec::new();
    let variant =
        model.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
    let mode = Mode::Jit(settings.level);
    let criteria = model.gathered_criteria(values, mode, settings.form)?;
    let later = a_second_later(model, values).without_fields();
    let next_states = model.gathered_next_states(&later, mode, settings.form)?;
    if criteria.is_empty() && next_states.is_empty() {
        return Ok(all);
    }
    let Some(gathered) = compiled(model, values, settings)? else { return Ok(all) };
    let integrals = &gathered.integrals[..];
    let mut see = |(kernel, written), (of_bonds, root, span), values: &Values, subject| {
        let (of, known) = ((variant, of_bonds), Known(Some(values)));
        let form = model.margin_or_next(of, (root, span), known, settings.form)?;
        let cause = |order: usize, given: &[f64]| {
            let place = Place::of(of_bonds, given);
            cause_of_gathered((model, values), &form, order, place.inputs())
        };
        let of = (kernel, written, integrals);
        all.push(judged(of, (settings, 1), subject, Box::new(cause)));
        Ok::<(), CompileError>(())
    };
    let breaks = variant.family_breaks.iter().filter(|one| one.of != OfFamily::Gradient);
    for (Break { of, root, span, .. }, one) in breaks.zip(&criteria) {
        let of = (*of == OfFamily::Bonds, *root, *span);
        let subject = Subject::Margin(None, one.text.clone());
        see((&one.margin, &one.written), of, values, subject)?;
    }
    let updates = variant.family_updates.iter().filter(|one| one.of != OfFamily::Gradient);
    for (Update { root, span, .. }, one) in updates.zip(&next_states) {
        let text = format!("{} = {}", model.input_name(one.state), one.text);
        let subject = Subject::NextState(Of::Family(OfFamily::Points), text);
        see((&one.next, &one.written), (false, *root, *span), &later, subject)?;
    }
    Ok(all)
}

fn compiled(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Option<GatheredKernels>, CompileError> {
    let mode = Mode::Jit(settings.level);
    Ok(model.compile_only(&[Kind::Gathered], values, mode, settings.form)?.gathered)
}

fn judged(
    (kernel, written, integrals): (&GatheredKernel, &WrittenGatheredEnergy, &[Kernel]),
    settings: (&Settings, usize),
    subject: Subject,
    cause: CauseAt<'_>,
) -> Found {
    let of_bonds = kernel.of_bonds();
    let bond = ["(l - L)/L", "L"].into_iter().filter(|_| of_bonds).map(str::to_string);
    let gathered = (1..=integrals.len()).map(|k| format!("I{k}"));
    let function = Function {
        names: bond.chain(gathered).collect(),
        n_variables: kernel.n_variables(),
        found: Box::new(move |given| Place::of(of_bonds, given).values(kernel)),
        truth: Box::new(move |given| Place::of(of_bonds, given).truth(written)),
        cause,
    };
    let sampled = sampled(of_bonds, integrals, settings.0.points);
    audited(&function, sampled, settings, subject)
}

/// Bonds of random families, and their points.
fn sampled(of_bonds: bool, integrals: &[Kernel], points: usize) -> Vec<Sampled> {
    let mut random = Random::new(0x6175_6469_7467);
    let mut places = |strain: f64, shift: f64| -> Vec<Vec<f64>> {
        let mut place = |_| Place::new(of_bonds, integrals, (strain, shift), &mut random).given();
        (0..points).map(&mut place).collect()
    };
    let mut all: Vec<Sampled> =
        strains().map(|(name, size)| (name, Some(size), places(size, 0.0))).collect();
    for decade in [-3, -2, -1, 1, 2, 3] {
        let stretch = power_of_ten(decade);
        all.push((format!("stretch 1e{decade}"), None, places(0.3 * stretch, stretch - 1.0)));
    }
    all
}
