//! Energies of several measures near rest and far from it, against numbers of any precision of the energy as
//! written, to a stated number of `u = 2^-53` of the largest derivative.

use super::sample::Random;
use super::{Subject, Verification, Ways, Witness};
use crate::clique::Variable;
use crate::coupled::{CoupledBatch, CoupledKernel, WrittenCoupledEnergy, argument};
use crate::expression::Operator;
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::measure::Measure;
use crate::model::{Model, Variant};
use crate::point::truth::by_lines;
use crate::values::Values;

/// Largest error of psi, its gradient and products.
const BAR: f64 = 1e4;

/// Most places that are tried: true values of all derivatives take milliseconds each.
const MOST: usize = 200;

/// Verifies the energies of triangles, of tetrahedra and of vectors of bonds at `n` places each and at most 200.
pub(super) fn verify(
    (model, variant): (&Model, &Variant),
    values: &Values,
    ways: &Ways,
    n: usize,
) -> Vec<Verification> {
    let of = |clique: Measure| {
        let ways = [&ways.strict, &ways.fast, &ways.interpreted, &ways.dual];
        let found = ways.map(|way| {
            let kernel = way.coupled.iter().find(|kernel| kernel.clique() == clique);
            kernel.map(|kernel| (kernel, evaluate(kernel, n.min(MOST))))
        });
        let [Some((kernel, strict)), Some(fast), Some(interpreted), Some(dual)] = found else {
            return None;
        };
        let symbols = kernel.variables().iter().map(Variable::symbol).collect();
        let subject = Subject::Coupled(argument(variant, clique), symbols);
        let mut verification = Verification::new(subject, &[(Witness::HyperDual, BAR)]);
        let written = model.written_coupled(values, clique, kernel.variables());
        for (p, place) in strict.iter().enumerate() {
            let Some(truth) = place.truth(&written) else { continue };
            verification.count(&place.values, &interpreted.1[p].values);
            let dual = &*dual.1[p].values;
            let decides = !super::is_within(BAR, place.variables.len(), [dual, &truth], largest);
            verification.undecided += usize::from(decides);
            for level in [place, &fast.1[p]] {
                let found = [&*level.values, &*truth, dual];
                verification.compare(0, &place.change, found, largest);
            }
        }
        Some(verification)
    };
    model.coupled().into_iter().filter_map(of).collect()
}

/// The largest size; not a number if one of them is none.
fn largest(numbers: &[f64]) -> f64 {
    let larger = |x: f64, y: &f64| if y.abs() > x || y.is_nan() { y.abs() } else { x };
    numbers.iter().fold(0.0, larger)
}

/// Measures at a place with a direction, and psi, gradient and product there.
pub(crate) struct Place {
    pub(crate) variables: Vec<f64>,
    pub(crate) reference: Vec<f64>,
    pub(crate) change: Vec<f64>,
    pub(crate) direction: Vec<f64>,
    values: Vec<f64>,
    /// Which are no measures, but what the ends of a bond have moved by.
    is_moved: Vec<bool>,
}

impl Place {
    /// The place of these numbers: changes since rest, or what ends have moved by, then measures at rest, then the
    /// direction.
    pub(crate) fn of(variables: &[Variable], given: &[f64]) -> Place {
        let n = variables.len();
        let [change, reference, direction] = [0, 1, 2].map(|k| given[k * n..(k + 1) * n].to_vec());
        let is_moved: Vec<bool> =
            variables.iter().map(|variable| variable.component().is_some()).collect();
        let now = |k: usize| grown(is_moved[k], reference[k], change[k]);
        let variables = (0..n).map(now).collect();
        Place { variables, reference, change, direction, values: Vec::new(), is_moved }
    }

    /// What is true there, of measures that are `(1 + e) M` exactly; nothing where that is no finite
    /// number.
    pub(crate) fn truth(&self, written: &WrittenCoupledEnergy) -> Option<Vec<f64>> {
        let truth = by_lines(&self.direction, |slope| {
            let variable = |k: usize| {
                if self.is_moved[k] {
                    return Precise::line(self.variables[k], slope(k), 0.0);
                }
                let rest = self.reference[k];
                let stretch = Precise::line(self.change[k], slope(k) / rest, 1.0);
                Precise::binary(Operator::Multiply, Precise::constant(rest), stretch)
            };
            written.psi(variable, |k| Precise::constant(self.reference[k]))
        })?;
        truth.iter().all(|x| x.is_finite()).then_some(truth)
    }
}

/// A measure now; what the ends of a bond have moved by is that itself, which goes in both ways, and is as little as
/// its length changes.
fn grown(is_moved: bool, rest: f64, change: f64) -> f64 {
    if is_moved { change } else { rest * (1.0 + change) }
}

/// The same places for every kernel of one energy: changes by decades from 0.3 to 1e-12.
fn evaluate(kernel: &CoupledKernel, n: usize) -> Vec<Place> {
    let mut random = Random::new(0x636c_6971_7565);
    let n_variables = kernel.variables().len();
    let all = n_variables * n;
    let mut numbers =
        |low: f64, high: f64| -> Vec<f64> { (0..all).map(|_| random.uniform(low, high)).collect() };
    let (reference, direction) = (numbers(0.9, 1.2), numbers(0.5, 2.0));
    let mut change = numbers(-0.3, 0.3);
    for (index, change) in change.iter_mut().enumerate() {
        let place = index % n;
        let decade = if place.is_multiple_of(2) { place / 2 % 12 } else { 0 };
        *change *= libm::pow(10.0, -(decade as f64));
    }
    let is_moved: Vec<bool> =
        kernel.variables().iter().map(|variable| variable.component().is_some()).collect();
    let grown = |(k, (rest, e)): (usize, (&f64, &f64))| grown(is_moved[k / n], *rest, *e);
    let variables: Vec<f64> = reference.iter().zip(&change).enumerate().map(grown).collect();
    let at = CoupledBatch {
        n,
        variables: &variables,
        reference: &reference,
        change: &change,
        fields: &[],
    };
    let mut psi = vec![0.0; n];
    let [mut gradient, mut product] = [vec![0.0; all], vec![0.0; all]];
    kernel.evaluate(at, &mut psi, &mut gradient);
    kernel.product(at, &direction, &mut product);
    let place = |p: usize| {
        let column = |array: &[f64]| array.iter().skip(p).step_by(n).copied().collect::<Vec<f64>>();
        Place {
            variables: column(&variables),
            reference: column(&reference),
            change: column(&change),
            direction: column(&direction),
            values: [column(&psi), column(&gradient), column(&product)].concat(),
            is_moved: is_moved.clone(),
        }
    };
    (0..n).map(place).collect()
}
