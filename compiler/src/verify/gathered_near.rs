//! Energies of gathered values near rest: bonds and families at strains from 1e-1 to 1e-12, against numbers of any
//! precision.
//!
//! Gathered values come rounded. So errors count in the size of the value, or in what a relative change of one of its
//! inputs makes of it if that is more: no form could do better.

use super::gathered::largest;
use super::sample::Random;
use super::{Miss, Verification, Ways, difference, parts};
use crate::expression::precise::Precise;
use crate::gathered::{GatheredBatch, GatheredKernel, WrittenGatheredEnergy};
use crate::kernel::{Batch, Kernel};
use crate::point::truth::by_lines;
use crate::verify::UNIT_ROUNDOFF;

/// Most places that are tried: true values take longer than all else.
const MOST: usize = 60;
/// Bonds of a family.
const BONDS: usize = 6;
/// A step of an input, as a share of it, over which a value changes little.
const STEP: f64 = 1e-3;

/// A bond, or a point, with a direction.
#[derive(Clone)]
pub(crate) struct Place {
    /// Of bonds the length, then the integrals.
    pub(super) variables: Vec<f64>,
    /// Of bonds the strain, of so few digits that its product with the length at rest is exact.
    change: Option<f64>,
    pub(super) reference: f64,
    pub(super) direction: Vec<f64>,
}

/// Holds the kernels of an energy against numbers of any precision near rest, as the witness of this number; gives
/// the places that were tried.
pub(super) fn judge(
    found: &mut Verification,
    witness: usize,
    (kernels, ways): ([&GatheredKernel; 3], &Ways),
    written: &WrittenGatheredEnergy,
    n: usize,
) -> Vec<Place> {
    let mut tried = Vec::new();
    let Some(gathered) = &ways.strict.gathered else { return tried };
    let [strict, fast, dual] = kernels;
    let mut random = Random::new(0x6e65_6172);
    for k in 0..n.min(MOST) {
        let strain = libm::pow(10.0, -1.0 - (k % 12) as f64) * random.uniform(0.4, 2.0);
        let place = Place::new(strict.of_bonds(), &gathered.integrals, (strain, 0.0), &mut random);
        let Some(truth) = place.truth(written) else { continue };
        let dual = place.values(dual);
        let sizes = place.sizes(strict, &truth);
        for kernel in [strict, fast] {
            let compiled = place.values(kernel);
            for (order, part) in parts(place.variables.len()).into_iter().enumerate() {
                let [compiled, dual, truth] =
                    [&compiled, &dual, &truth].map(|all| &all[part.clone()]);
                let unit = UNIT_ROUNDOFF * sizes[order] + f64::MIN_POSITIVE;
                let error = |values: &[f64]| largest(&difference(values, truth)) / unit;
                found.see(witness, order, error(compiled), |bar| Miss {
                    place: place.variables.clone(),
                    order,
                    compiled: compiled.to_vec(),
                    expected: truth.to_vec(),
                    tolerance: bar * unit,
                    is_wrong: Miss::is_wrong(
                        UNIT_ROUNDOFF * error(compiled),
                        UNIT_ROUNDOFF * error(dual),
                    ),
                });
            }
        }
        found.n_places += 1;
        tried.push(place);
    }
    tried
}

impl Place {
    /// The first bond of a random family, or its point, and what is gathered of it: strains of about one size
    /// beside one that all have.
    pub(crate) fn new(
        of_bonds: bool,
        integrals: &[Kernel],
        (strain, of_all): (f64, f64),
        random: &mut Random,
    ) -> Place {
        let mut numbers =
            |low, high| -> [f64; BONDS] { std::array::from_fn(|_| random.uniform(low, high)) };
        let volumes = numbers(0.5, 1.0);
        let reference = numbers(0.5, 2.0).map(|length| (length * 1024.0).round() / 1024.0);
        // More of one sign, as a dilatation has it.
        let change =
            numbers(-0.4, 1.0).map(|e| f64::from_bits((of_all + e * strain).to_bits() & !0xffff));
        let measure: [f64; BONDS] =
            std::array::from_fn(|j| reference[j] + reference[j] * change[j]);
        let batch =
            Batch { measure: &measure, reference: &reference, change: &change, fields: &[] };
        let gather = |kernel: &Kernel| -> f64 {
            kernel.derivatives(batch).psi.iter().zip(volumes).map(|(g, volume)| g * volume).sum()
        };
        let length = of_bonds.then_some(measure[0]);
        let variables: Vec<f64> = length.into_iter().chain(integrals.iter().map(gather)).collect();
        let direction = variables.iter().map(|_| random.uniform(0.5, 2.0)).collect();
        let change = of_bonds.then_some(change[0]);
        Place { variables, change, reference: reference[0], direction }
    }

    /// The place of these numbers: of bonds the strain and the length at rest, then integrals, then the direction.
    pub(crate) fn of(of_bonds: bool, given: &[f64]) -> Place {
        let (bond, rest) = given.split_at(if of_bonds { 2 } else { 0 });
        let n = (rest.len() - usize::from(of_bonds)) / 2;
        let (integrals, direction) = rest.split_at(n);
        let (change, reference) = (bond.first().copied(), bond.get(1).copied().unwrap_or(f64::NAN));
        let length = change.map(|change| reference + reference * change);
        let variables = length.into_iter().chain(integrals.iter().copied()).collect();
        Place { variables, change, reference, direction: direction.to_vec() }
    }

    /// The variables, the direction, and of bonds the length at rest.
    pub(crate) fn inputs(&self) -> (&[f64], &[f64], Option<f64>) {
        (&self.variables, &self.direction, self.change.map(|_| self.reference))
    }

    /// These numbers.
    pub(crate) fn given(&self) -> Vec<f64> {
        let bond: Vec<f64> = self.change.map_or(Vec::new(), |change| vec![change, self.reference]);
        let integrals = &self.variables[usize::from(self.change.is_some())..];
        [&bond[..], integrals, &self.direction].concat()
    }

    /// psi, gradient and product.
    pub(crate) fn values(&self, kernel: &GatheredKernel) -> Vec<f64> {
        let n = self.variables.len();
        let (mut psi, mut gradient, mut product) = ([0.0], vec![0.0; n], vec![0.0; n]);
        let (change, reference) = ([self.change.unwrap_or(0.0)], [self.reference]);
        let given = usize::from(self.change.is_some());
        let at = GatheredBatch {
            n: 1,
            variables: &self.variables,
            change: &change[..given],
            reference: &reference[..given],
            fields: &[],
        };
        kernel.evaluate(at, &mut psi, &mut gradient);
        kernel.product(at, &self.direction, &mut product);
        [&psi[..], &gradient, &product].concat()
    }

    /// What is true there; nothing where that is no finite number.
    pub(crate) fn truth(&self, written: &WrittenGatheredEnergy) -> Option<Vec<f64>> {
        let truth = by_lines(&self.direction, |slope| {
            let variable = |k: usize| match self.change {
                Some(change) if k == 0 => {
                    Precise::line(self.reference, slope(0), self.reference * change)
                }
                _ => Precise::line(self.variables[k], slope(k), 0.0),
            };
            written.psi(variable, Precise::line(self.reference, 0.0, 0.0))
        })?;
        truth.iter().all(|x| x.is_finite()).then_some(truth)
    }

    /// The sizes of psi, of its gradient and of its product, or what a relative change of an input makes of them.
    fn sizes(&self, kernel: &GatheredKernel, truth: &[f64]) -> [f64; 3] {
        let parts = parts(self.variables.len());
        let mut sizes = parts.clone().map(|part| largest(&truth[part]));
        for k in 0..self.variables.len() {
            let [less, more] = [1.0 - STEP, 1.0 + STEP].map(|by| {
                let mut moved = self.clone();
                match (&mut moved.change, k) {
                    (Some(change), 0) => {
                        *change *= by;
                        moved.variables[0] = self.reference + self.reference * *change;
                    }
                    _ => moved.variables[k] *= by,
                }
                moved.values(kernel)
            });
            for (size, part) in sizes.iter_mut().zip(parts.clone()) {
                let change = largest(&difference(&more[part.clone()], &less[part]));
                *size = size.max(change / (2.0 * STEP));
            }
        }
        sizes
    }
}
