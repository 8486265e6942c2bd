//! Energies of gathered values against hyper-dual numbers of the energy as written, at random lengths
//! and integrals, to a stated number of `u = 2^-53` of the largest derivative, where that is missed against numbers
//! of any precision, as near rest.

use super::sample::Random;
use super::stated::cause_of_gathered;
use super::{Subject, Verification, Ways, Witness, gathered_near, parts};
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::gathered::{
    GatheredBatch, GatheredKernel, GatheredKernels, WrittenGatheredEnergy, argument,
};
use crate::model::{Model, Variant};
use crate::point::truth::by_lines;
use crate::specialise::Form;
use crate::values::Values;

/// Largest error of psi, its gradient and products.
const BAR: f64 = 1e4;

/// The same near rest.
const BAR_NEAR: f64 = 256.0;

/// Verifies the energies of points and of bonds at `n` places each; nothing where there are none.
pub(super) fn verify(
    (model, variant): (&Model, &Variant),
    values: &Values,
    all: &Ways,
    n: usize,
) -> Vec<Verification> {
    let ways = [&all.strict, &all.fast, &all.interpreted, &all.dual];
    let of = |kernels: fn(&GatheredKernels) -> &Option<GatheredKernel>, of_bonds: bool| {
        let compiled = ways
            .each_ref()
            .map(|way| way.gathered.as_ref().and_then(|gathered| kernels(gathered).as_ref()));
        let [Some(strict), Some(fast), Some(interpreted), Some(dual)] = compiled else {
            return None;
        };
        let near = [strict, fast, dual];
        let [strict, fast, interpreted, dual] =
            [strict, fast, interpreted, dual].map(|kernel| evaluate(kernel, n));
        let subject = Subject::Gathered(argument(variant, of_bonds));
        let witnesses = [(Witness::HyperDual, BAR), (Witness::TruthNear, BAR_NEAR)];
        let mut verification = Verification::new(subject, &witnesses);
        let written = model.written_gathered(values, of_bonds);
        let found = [strict, fast, interpreted, dual.clone()]
            .map(|places| places.into_iter().map(|place| place.values).collect::<Vec<_>>());
        let places = (|p: usize| dual[p].variables.clone(), |p: usize| dual[p].truth(&written));
        verification.judge(found.each_ref().map(Vec::as_slice), BAR, largest, places);
        let near = gathered_near::judge(&mut verification, 1, (near, all), &written, n);
        let far = dual.iter().map(|place| (&place.variables, &place.direction, place.reference));
        let near = near.iter().map(|place| (&place.variables, &place.direction, place.reference));
        let sizes = |order: usize| {
            let of =
                |place: &Place| largest(&place.values[parts(place.variables.len())[order].clone()]);
            dual.iter().map(of).filter(|size| size.is_finite()).fold(0.0, f64::max)
        };
        verification.forgive([0, 1, 2].map(sizes));
        find_causes(
            &mut verification,
            (model, values),
            of_bonds,
            &far.chain(near).collect::<Vec<_>>(),
        );
        Some(verification)
    };
    let found = [of(|kernels| &kernels.points, false), of(|kernels| &kernels.bonds, true)];
    found.into_iter().flatten().collect()
}

/// Where psi, gradient and product lose their digits, each at the place where it keeps the fewest.
fn find_causes(
    found: &mut Verification,
    (model, values): (&Model, &Values),
    of_bonds: bool,
    places: &[(&Vec<f64>, &Vec<f64>, f64)],
) {
    if found.misses.is_empty() {
        return;
    }
    let forms = model.specialise_gathered(values, of_bonds, Form::Accurate);
    let Ok((Some(form), _)) = forms else { return };
    for order in 0..3 {
        let Some(worst) = found.worst(order) else { continue };
        let Some(place) = places.iter().find(|place| *place.0 == worst.place) else { continue };
        let (variables, direction, reference) = *place;
        let at = (&**variables, &**direction, of_bonds.then_some(reference));
        found.causes.extend(cause_of_gathered((model, values), &form, order, at));
    }
}

/// The largest size; not a number if one of them is none.
pub(super) fn largest(numbers: &[f64]) -> f64 {
    let larger = |x: f64, y: &f64| if y.abs() > x || y.is_nan() { y.abs() } else { x };
    numbers.iter().fold(0.0, larger)
}

/// The variables of a place with a direction, and psi, gradient and product there.
#[derive(Clone)]
pub(super) struct Place {
    pub(super) variables: Vec<f64>,
    direction: Vec<f64>,
    /// Of bonds the length at rest.
    pub(super) reference: f64,
    values: Vec<f64>,
}

impl Place {
    /// The same bond, or point, a part `t` of the way to another: lengths go by stretches.
    pub(super) fn with(&self, other: &Place, t: f64) -> Place {
        let is_bond = !self.reference.is_nan();
        let variable = |(k, (x, y)): (usize, (&f64, &f64))| match k == 0 && is_bond {
            true => x + t * (y / other.reference * self.reference - x),
            false => x + t * (y - x),
        };
        let variables = self.variables.iter().zip(&other.variables).enumerate().map(variable);
        Place { variables: variables.collect(), ..self.clone() }
    }

    /// The same with other variables.
    pub(super) fn moved(&self, variables: Vec<f64>) -> Place {
        Place { variables, ..self.clone() }
    }

    /// What is true there; nothing where that is no finite number.
    fn truth(&self, written: &WrittenGatheredEnergy) -> Option<Vec<f64>> {
        let truth = by_lines(&self.direction, |slope| {
            let variable = |k: usize| Precise::line(self.variables[k], slope(k), 0.0);
            written.psi(variable, Precise::constant(self.reference))
        })?;
        truth.iter().all(|x| x.is_finite()).then_some(truth)
    }
}

/// The same places for every kernel of one energy.
fn evaluate(kernel: &GatheredKernel, n: usize) -> Vec<Place> {
    let mut all = places(kernel, n);
    let mut psi = vec![0.0; n];
    let size = kernel.n_variables() * n;
    let [mut gradient, mut product] = [vec![0.0; size], vec![0.0; size]];
    let direction = columns(&all, |place| &place.direction);
    batch(kernel, &all, |at| {
        kernel.evaluate(at, &mut psi, &mut gradient);
        kernel.product(at, &direction, &mut product);
    });
    for (p, place) in all.iter_mut().enumerate() {
        let column = |array: &[f64]| array.iter().skip(p).step_by(n).copied().collect::<Vec<f64>>();
        place.values = [column(&psi), column(&gradient), column(&product)].concat();
    }
    all
}

/// Random lengths and integrals, with directions, and no values yet.
pub(super) fn places(kernel: &GatheredKernel, n: usize) -> Vec<Place> {
    let mut random = Random::new(0x7374_6174_6573);
    let n_variables = kernel.n_variables();
    let mut numbers = |n: usize| (0..n).map(|_| random.uniform(0.5, 2.0)).collect::<Vec<f64>>();
    let mut variables = numbers(n_variables * n);
    let direction = numbers(n_variables * n);
    let reference = numbers(if kernel.of_bonds() { n } else { 0 });
    // Lengths at rest times stretches: the energy as written subtracts one from the other.
    for (l, rest) in variables.iter_mut().zip(&reference) {
        *l = rest * if (*l - 1.0).abs() < 0.1 { *l + 0.25 } else { *l };
    }
    let place = |p: usize| {
        let column = |array: &[f64]| array.iter().skip(p).step_by(n).copied().collect::<Vec<f64>>();
        let reference = reference.get(p).copied().unwrap_or(f64::NAN);
        let (variables, direction) = (column(&variables), column(&direction));
        Place { variables, direction, reference, values: Vec::new() }
    };
    (0..n).map(place).collect()
}

/// Hands places over as a kernel takes them.
pub(super) fn batch(
    kernel: &GatheredKernel,
    places: &[Place],
    take: impl FnOnce(GatheredBatch<'_>),
) {
    let variables = columns(places, |place| &place.variables);
    let of_bonds = places.iter().filter(|_| kernel.of_bonds());
    let reference: Vec<f64> = of_bonds.map(|place| place.reference).collect();
    let lengths = variables.iter().zip(&reference);
    let change: Vec<f64> = lengths.map(|(l, rest)| (l - rest) / rest).collect();
    take(GatheredBatch {
        n: places.len(),
        variables: &variables,
        change: &change,
        reference: &reference,
        fields: &[],
    });
}

/// Variable by variable, of all places.
fn columns(places: &[Place], of: impl Fn(&Place) -> &Vec<f64>) -> Vec<f64> {
    let n = places.first().map_or(0, |place| of(place).len());
    (0..n).flat_map(|k| places.iter().map(|place| of(place)[k]).collect::<Vec<f64>>()).collect()
}
