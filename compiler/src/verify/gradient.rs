//! Energies of the deformation gradient, near rest and far from it: psi, P and dP against numbers of
//! any precision of the energy as written, along random directions, and far from rest against hyper-dual
//! numbers, to a stated number of `u = 2^-53` of their norm.

use super::sample::Random;
use super::stated::cause_of_gradient;
use super::{Subject, Verification, Ways, Witness};
use crate::measure::Argument;
use crate::model::Model;
use crate::point::sample::{self, Sample};
use crate::point::truth::{norm, truth};
use crate::specialise::Form;
use crate::values::Values;

/// Largest error of psi, P and dP near rest.
const BAR_NEAR: f64 = 256.0;

/// The same far from rest, where energies as written subtract what they please.
const BAR_FAR: f64 = 1e4;

/// The witnesses; hyper-dual numbers are as far off as the energy as written lets them be, and are none
/// where that is more than the bar.
const WITNESSES: [(Witness, f64); 3] = [
    (Witness::TruthNear, BAR_NEAR),
    (Witness::TruthFar, BAR_FAR),
    (Witness::HyperDual, 2.0 * BAR_FAR),
];

/// Most gradients that are tried: true values of all derivatives take milliseconds each.
const MOST: usize = 200;

/// Verifies the energy of the deformation gradient at `2 n` gradients; nothing where there is none, or
/// nothing is left of it.
pub(super) fn verify(
    model: &Model,
    values: &Values,
    ways: &Ways,
    n: usize,
) -> Option<Verification> {
    let strict = ways.strict.gradient.as_ref()?;
    let mut samples = samples(values.dimension, n);
    samples.retain(|sample| strict.admits(&sample.gradient));
    let kernels = [&ways.strict, &ways.fast, &ways.interpreted, &ways.dual];
    let found = kernels.map(|way| way.gradient.as_ref().map(|k| sample::evaluate(k, &samples)));
    let [Some(strict), Some(fast), Some(interpreted), Some(dual)] = &found else { return None };
    let written = model.written_gradient(values);
    let subject = Subject::Argument(Argument::Gradient);
    let mut verification = Verification::new(subject, &WITNESSES);
    for (p, sample) in samples.iter().enumerate() {
        let Some(truth) = truth(&written, sample) else { continue };
        verification.count(&strict[p], &interpreted[p]);
        let size = |numbers: &[f64]| norm(numbers.iter().copied());
        let place = &sample.gradient;
        let far = !sample.is_near();
        for level in [strict, fast] {
            let found = [&*level[p], &*truth, &*dual[p]];
            verification.compare(usize::from(far), place, found, size);
        }
        if far && super::is_within(BAR_FAR, place.len(), [&dual[p], &truth], size) {
            verification.compare(2, place, [&strict[p], &dual[p], &dual[p]], size);
        } else if far {
            verification.undecided += 1;
        }
    }
    find_causes(&mut verification, model, values, &samples);
    Some(verification)
}

/// Where psi, P and dP lose their digits, each at the gradient where it keeps the fewest.
fn find_causes(found: &mut Verification, model: &Model, values: &Values, samples: &[Sample]) {
    if found.misses.is_empty() {
        return;
    }
    let Ok((Some(forms), _)) = model.specialise_gradient(values, Form::Accurate) else { return };
    for order in 0..3 {
        let Some(worst) = found.worst(order) else { continue };
        let Some(sample) = samples.iter().find(|s| s.gradient == worst.place) else { continue };
        found.causes.extend(cause_of_gradient((model, values), &forms, order, sample));
    }
}

/// Gradients near rest, by decades of `|H|` from 1e-1 to 1e-12, and far from it, by stretches and
/// rotations, never turned inside out; each with a direction.
pub(super) fn samples(dimension: usize, n: usize) -> Vec<Sample> {
    let mut random = Random::new(0x67_7261_6469_656e);
    let mut samples = Vec::new();
    for k in 0..(2 * n).min(MOST) {
        samples.push(if k % 2 == 0 {
            let size = libm::pow(10.0, -1.0 - (k / 2 % 12) as f64);
            let change = sample::tensor(dimension * dimension, size, &mut random);
            Sample::of_change(change, &mut random)
        } else {
            let gradient = sample::far(dimension, 1.0, &mut random);
            Sample::of_gradient(gradient, &mut random)
        });
    }
    samples
}
