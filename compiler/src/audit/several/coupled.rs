//! Energies of several measures of triangles, tetrahedra and bonds.

use super::{CauseAt, Found, Function, Sampled, audited, power_of_ten, strains};
use crate::audit::Settings;
use crate::clique::Variable;
use crate::compile::Kind;
use crate::coupled::{CoupledBatch, CoupledKernel, WrittenCoupledEnergy, argument};
use crate::density::DensityForm;
use crate::expression::number::Number;
use crate::expression::{Input, Operator};
use crate::kernel::Mode;
use crate::model::Model;
use crate::specialise::CompileError;
use crate::values::Values;
use crate::verify::cause::Exact;
use crate::verify::coupled::Place;
use crate::verify::sample::Random;
use crate::verify::stated::cause_of_several;
use crate::verify::{Cause, Subject};

pub(super) fn audit(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Found>, CompileError> {
    let mode = Mode::Jit(settings.level);
    let compiled = model.compile_only(&[Kind::Coupled], values, mode, settings.form)?;
    let variant =
        model.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
    let audit = |kernel: &CoupledKernel| {
        let written = model.written_coupled(values, kernel.clique(), kernel.variables());
        let (form, _) = model.specialise_coupled(values, kernel.clique(), settings.form)?;
        let form = form.map(|form| form.density);
        let cause = |order: usize, given: &[f64]| {
            cause((model, values), form.as_ref()?, order, (kernel.variables(), given))
        };
        let function = function((kernel, &written), Box::new(cause));
        let sampled = sampled(kernel, settings.points.min(MOST));
        let symbols = kernel.variables().iter().map(Variable::symbol).collect();
        let subject = Subject::Coupled(argument(variant, kernel.clique()), symbols);
        Ok(audited(&function, sampled, (settings, 3), subject))
    };
    compiled.coupled.iter().map(audit).collect()
}

fn cause(
    of: (&Model, &Values),
    form: &DensityForm,
    order: usize,
    (variables, given): (&[Variable], &[f64]),
) -> Option<Cause> {
    let place = Place::of(variables, given);
    let found = |input| {
        let own = |variable: &Variable| variable.inputs.iter().position(|own| *own == input);
        variables.iter().enumerate().find_map(|(k, variable)| Some((k, own(variable)?)))
    };
    let double = |input| match (found(input), input) {
        (Some((k, which)), _) => [&place.variables, &place.reference, &place.change][which][k],
        (None, Input::Direction(k)) => place.direction[usize::from(k)],
        _ => f64::NAN,
    };
    let exact = |input| match found(input) {
        Some((k, 0)) if variables[k].component().is_none() => {
            let stretch = Exact::line(place.change[k], 0.0, 1.0);
            Exact::binary(Operator::Multiply, Exact::constant(place.reference[k]), stretch)
        }
        _ => Exact::constant(double(input)),
    };
    cause_of_several(of, form, order, (double, exact))
}

/// Most places of a regime: true values of arc tangents in 256 bits take milliseconds.
const MOST: usize = 4;

/// Changes since rest, or what ends have moved by, then measures at rest, then the direction.
fn function<'a>(
    (kernel, written): (&'a CoupledKernel, &'a WrittenCoupledEnergy),
    cause: CauseAt<'a>,
) -> Function<'a> {
    let variables = kernel.variables();
    let n = variables.len();
    let change = |variable: &Variable| match variable.component() {
        Some(_) => variable.symbol().to_string(),
        None => format!("{0} over rest, less 1", variable.symbol()),
    };
    let rest = |variable: &Variable| format!("{} at rest", variable.symbol());
    let place = move |given: &[f64]| Place::of(variables, given);
    Function {
        names: variables.iter().map(change).chain(variables.iter().map(rest)).collect(),
        n_variables: n,
        found: Box::new(move |given| {
            let Place { variables, reference, change, direction, .. } = place(given);
            let [mut psi, mut gradient, mut product] = [1, n, n].map(|n| vec![0.0; n]);
            let (variables, reference, change) = (&variables, &reference, &change);
            let at = CoupledBatch { n: 1, variables, reference, change, fields: &[] };
            kernel.evaluate(at, &mut psi, &mut gradient);
            kernel.product(at, &direction, &mut product);
            [psi, gradient, product].concat()
        }),
        truth: Box::new(move |given| place(given).truth(written)),
        cause,
    }
}

fn sampled(kernel: &CoupledKernel, points: usize) -> Vec<Sampled> {
    let mut random = Random::new(0x6175_6469_7463);
    let n = kernel.variables().len();
    let is_moved: Vec<bool> =
        kernel.variables().iter().map(|variable| variable.component().is_some()).collect();
    let mut places = |change: &dyn Fn(f64, bool) -> f64| -> Vec<Vec<f64>> {
        let mut place = |_| {
            let mut numbers = |low: f64, high: f64| -> Vec<f64> {
                (0..n).map(|_| random.uniform(low, high)).collect()
            };
            let (changes, reference) = (numbers(-1.0, 1.0), numbers(0.9, 1.2));
            let changes = changes.iter().zip(&is_moved).map(|(x, moved)| change(*x, *moved));
            [changes.collect(), reference, numbers(0.5, 2.0)].concat()
        };
        (0..points).map(&mut place).collect()
    };
    let mut all: Vec<Sampled> =
        strains().map(|(name, size)| (name, Some(size), places(&|x, _| x * size))).collect();
    all.push(("stretch 0.7 to 1.3".to_string(), None, places(&|x, _| 0.3 * x)));
    for decade in 1..=3 {
        let size = power_of_ten(decade);
        let pull = |x: f64, moved: bool| if moved { size * x } else { size * (0.5 + 0.1 * x) };
        all.push((format!("stretch 1e{decade}"), None, places(&pull)));
    }
    all
}
