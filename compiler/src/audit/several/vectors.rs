//! What points gather of vectors, and energies of it.

use super::{Found, Function, Sampled, audited, power_of_ten, strains};
use crate::audit::Settings;
use crate::clique::Part;
use crate::density::DensityForm;
use crate::expression::Input;
use crate::expression::number::Number as _;
use crate::gathered::vectors::Which;
use crate::gathered::{FamilyKernel, Slot, VectorKernels, WrittenFamily};
use crate::kernel::Mode;
use crate::model::{Model, Of, OfFamily};
use crate::specialise::{CompileError, Known};
use crate::values::Values;
use crate::verify::Subject;
use crate::verify::cause::Exact;
use crate::verify::families::a_second_later;
use crate::verify::sample::Random;
use crate::verify::stated::cause_of_several;
use crate::verify::vectors::{Place, Places, Seen, bond, evaluate, of, subject};

/// Most places of a regime: true values of a gradient by dozens of numbers take tens of milliseconds.
const MOST: usize = 2;

/// What a bond moves beside the gradient of its family, in parts of that.
const BESIDE: f64 = 0.2;

/// A regime of places: its name, and near rest the decade of its strain.
type Deformed = (String, Option<f64>, Vec<Place>);

pub(super) fn audit(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Found>, CompileError> {
    let values = &values.with_directions_alone(model);
    let variant =
        model.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
    let mut kernels = None;
    model.compile_vectors(values, (Mode::Jit(settings.level), settings.form), &mut kernels)?;
    let Some(kernels) = kernels else { return Ok(Vec::new()) };
    let sampled = sampled(&kernels, (model, values), settings.points);
    let audit = |which: Which| {
        let kernel = of(&kernels, which)?;
        let written = model.written_vectors(values, which);
        let form = model.form_of_vectors((variant, which), values, settings.form);
        let of = (kernel, &written, form.as_ref());
        Some(judged(of, (model, values), (&sampled, settings, 3), subject(variant, which)))
    };
    let all = [Which::Integrands, Which::Functions, Which::Points, Which::Bonds];
    Ok(all.into_iter().filter_map(audit).collect())
}

/// Margins of conditions of what points gather of vectors, then what states of points become, with states by the
/// values.
///
/// # Errors
/// What cannot be compiled.
pub(super) fn functions(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Found>, CompileError> {
    let values = &values.with_directions_alone(model);
    let variant =
        model.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
    let mode = Mode::Jit(settings.level);
    let criteria = model.vector_criteria(values, mode, settings.form)?;
    let later = a_second_later(model, values);
    let next_states = model.vector_next_states(&later, mode, settings.form)?;
    let mut kernels = None;
    if !criteria.is_empty() || !next_states.is_empty() {
        model.compile_vectors(values, (mode, settings.form), &mut kernels)?;
    }
    let Some(kernels) = kernels else { return Ok(Vec::new()) };
    let sampled = sampled(&kernels, (model, values), settings.points);
    let see = |(kernel, written), (of_bonds, root, span), values: &Values, subject| {
        let (of, known) = ((variant, of_bonds), Known(Some(values)));
        let made = model.margin_or_next_of_vectors(of, (root, span), known, settings.form)?;
        let of = (kernel, written, Some(&made.form));
        Ok(judged(of, (model, values), (&sampled, settings, 1), subject))
    };
    let breaks = model.conditions_of_vectors(variant).zip(&criteria).map(|(condition, one)| {
        let of = (condition.of == OfFamily::Bonds, condition.root, condition.span);
        let subject = Subject::Margin(None, one.text.clone());
        see((&one.margin, &one.written), of, values, subject)
    });
    let updates = model.updates_of_vectors(variant).zip(&next_states).map(|(update, one)| {
        let text = format!("{} = {}", model.input_name(one.state), one.text);
        let subject = Subject::NextState(Of::Family(OfFamily::Points), text);
        see((&one.next, &one.written), (false, update.root, update.span), &later, subject)
    });
    breaks.chain(updates).collect()
}

/// Audits a kernel at places, with its form where that is there to say what loses digits.
fn judged(
    (kernel, written, form): (&FamilyKernel, &WrittenFamily, Option<&DensityForm>),
    of: (&Model, &Values),
    (sampled, settings, n_orders): (&[Deformed], &Settings, usize),
    subject: Subject,
) -> Found {
    let n_gathered = sampled.iter().flat_map(|regime| &regime.2).map(Place::n_gathered).max();
    let n_gathered = n_gathered.unwrap_or(0);
    let mut function = function(kernel, written, of, n_gathered);
    function.cause = Box::new(move |order, given| {
        let place = Place::of(kernel, (of.1.dimension, n_gathered), given);
        cause_of_several(of, form?, order, inputs(&place, of, kernel))
    });
    let given = |(name, strain, places): &Deformed| -> Sampled {
        (name.clone(), *strain, places.iter().map(|place| place.given(kernel)).collect())
    };
    let sampled = sampled.iter().map(given).collect();
    audited(&function, sampled, (settings, n_orders), subject)
}

fn function<'a>(
    kernel: &'a FamilyKernel,
    written: &'a WrittenFamily,
    (model, values): (&'a Model, &'a Values),
    n_gathered: usize,
) -> Function<'a> {
    let name = |slot: &Slot| match slot {
        Slot::Length => "L".to_string(),
        Slot::Moved(axis) => format!("xi({0}) - Xi({0})", axis + 1),
        Slot::Own(k) => format!("I{}", k + 1),
        Slot::Neighbour(k) => format!("neighbour(I{})", k + 1),
        Slot::Multiplier(k) => format!("A{}", k + 1),
    };
    let slots = kernel.variables().iter().chain(kernel.given()).map(name);
    let units = (1..=values.dimension).map(|axis| format!("Xi({axis})/L"));
    let place = move |given: &[f64]| {
        let place = Place::of(kernel, (values.dimension, n_gathered), given);
        Places::new(vec![place], (model, values))
    };
    Function {
        names: slots.chain(units).collect(),
        n_variables: kernel.variables().len(),
        found: Box::new(move |given| evaluate(kernel, &place(given)).swap_remove(0)),
        truth: Box::new(move |given| {
            let places = place(given);
            Seen { written, kernel, places: &places }.truth(0)
        }),
        cause: Box::new(|_, _| None),
    }
}

/// The inputs of a graph at a place, in doubles and exactly.
fn inputs<'a>(
    place: &'a Place,
    (model, values): (&'a Model, &'a Values),
    kernel: &'a FamilyKernel,
) -> (impl Fn(Input) -> f64 + 'a, impl Fn(Input) -> Exact + 'a) {
    let directions = model.directions(values.dimension);
    let double = move |input| match input {
        Input::Direction(k) => place.direction(kernel)[usize::from(k)],
        Input::Parameter(number) => {
            let axis = directions.clone().position(|own| own == number);
            axis.map_or(f64::NAN, |axis| place.unit()[axis])
        }
        Input::Current(_) => place.length(),
        Input::Change(_) => place.length() / place.slot(Slot::Length) - 1.0,
        Input::Reference(_) => place.slot(Slot::Length),
        Input::Part(Part::Moved(axis)) => place.slot(Slot::Moved(usize::from(axis))),
        Input::Integral(k) => place.slot(Slot::Own(usize::from(k))),
        Input::Neighbour(k) => place.slot(Slot::Neighbour(usize::from(k))),
        Input::Multiplier(k) => place.slot(Slot::Multiplier(usize::from(k))),
        _ => f64::NAN,
    };
    let exact = {
        let double = double.clone();
        move |input| Exact::constant(double(input))
    };
    (double, exact)
}

/// Bonds of random families, strained, stretched, and turned.
fn sampled(kernels: &VectorKernels, of: (&Model, &Values), points: usize) -> Vec<Deformed> {
    let mut random = Random::new(0x6175_6469_7476);
    let mut places = |size: f64, is_turned: bool| -> Vec<Place> {
        let sizes = [size, size * BESIDE];
        let n = points.min(MOST);
        (0..n).map(|_| bond(kernels, of, (sizes, is_turned), &mut random)).collect()
    };
    let strains = strains().step_by(2);
    let mut all: Vec<_> =
        strains.map(|(name, size)| (name, Some(size), places(size, false))).collect();
    for decade in [1, 5, 9] {
        all.push((format!("turned 1e-{decade}"), None, places(power_of_ten(-decade), true)));
    }
    for decade in [0, 1, 2] {
        all.push((format!("gradient 1e{decade}"), None, places(power_of_ten(decade), false)));
    }
    all
}
