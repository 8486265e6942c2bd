//! Stress and tangent of `psi(F)` against independent ones, near rest and far from it.
//!
//! Machine code at the strict level must equal the interpreter bit for bit. psi, P and dP must agree
//! with numbers of any precision of the energy as written, along random directions, and far from rest
//! with hyper-dual numbers, to a stated number of `u = 2^-53` of their norm.

use super::kernel::WrittenGradientEnergy;
use super::sample::{self, Sample};
use super::truth::{norm, parts, truth};
use crate::kernel::{Level, Mode};
use crate::model::Model;
use crate::specialise::{CompileError, Form};
use crate::values::Values;
use crate::verify::sample::Random;
use crate::verify::{UNIT_ROUNDOFF, same_bits};

/// Largest error of psi, P and dP near rest, in units of [`UNIT_ROUNDOFF`] of their norms.
pub const BAR_NEAR: f64 = 256.0;

/// The same far from rest, where energies as written subtract what they please.
pub const BAR_FAR: f64 = 1e4;

/// Most gradients that are tried: true values of all derivatives take milliseconds each.
const MOST: usize = 200;

/// What was found for the energy of the deformation gradient.
#[derive(Clone, Debug)]
pub struct GradientVerification {
    /// How many gradients were tried.
    pub n_points: usize,
    /// At how many of them machine code at the strict level and interpreter differ in some bit.
    pub different_bits: usize,
    /// Largest error of psi, P and dP against true values near rest, at both levels, in units of
    /// [`UNIT_ROUNDOFF`] of their norms.
    pub near: [f64; 3],
    /// The same far from rest.
    pub far: [f64; 3],
    /// Largest error of psi, P and dP against hyper-dual numbers far from rest, in the same units.
    pub dual: [f64; 3],
    /// The first gradients `F`, row by row, at which a tolerance is missed.
    pub misses: Vec<Vec<f64>>,
}

impl GradientVerification {
    /// Whether nothing was found.
    pub fn passed(&self) -> bool {
        self.n_points > 0 && self.different_bits == 0 && self.misses.is_empty()
    }
}

/// Verifies the energy of the deformation gradient for these values at `2 n` gradients; nothing where
/// there is none, or nothing is left of it.
///
/// # Errors
/// An energy that cannot be compiled.
pub fn verify_gradient(
    model: &Model,
    values: &Values,
    n: usize,
) -> Result<Option<GradientVerification>, CompileError> {
    let compiled = |mode| Ok(model.compile(values, mode, Form::Accurate)?.gradient);
    let modes =
        [Mode::Jit(Level::Strict), Mode::Jit(Level::Fast), Mode::Interpreter, Mode::HyperDual];
    let mut samples = samples(values.dimension, n);
    let mut found = Vec::new();
    for mode in modes {
        let Some(kernel) = compiled(mode)? else { return Ok(None) };
        samples.retain(|sample| kernel.admits(&sample.gradient));
        found.push(sample::evaluate(&kernel, &samples));
    }
    let written = model.written_gradient(values);
    let mut verification = GradientVerification {
        n_points: 0,
        different_bits: 0,
        near: [0.0; 3],
        far: [0.0; 3],
        dual: [0.0; 3],
        misses: Vec::new(),
    };
    for (p, sample) in samples.iter().enumerate() {
        verification.look_at(sample, &written, [0, 1, 2, 3].map(|mode| &found[mode][p][..]));
    }
    Ok(Some(verification))
}

impl GradientVerification {
    fn look_at(&mut self, sample: &Sample, written: &WrittenGradientEnergy, found: [&[f64]; 4]) {
        let [strict, fast, interpreted, dual] = found;
        let Some(truth) = truth(written, sample) else { return };
        self.n_points += 1;
        if !strict.iter().zip(interpreted).all(|(x, y)| same_bits(*x, *y)) {
            self.different_bits += 1;
        }
        let far = !sample.is_near();
        let mut missed = false;
        let mut compare =
            |found: &[f64], expected: &[f64], tolerance: f64, worst: &mut [f64; 3]| {
                for (order, part) in parts(sample.gradient.len()).into_iter().enumerate() {
                    let size = norm(expected[part.clone()].iter().copied());
                    let error = norm(part.map(|k| found[k] - expected[k]));
                    let error = error / (UNIT_ROUNDOFF * size + f64::MIN_POSITIVE);
                    let error = if error.is_nan() { f64::INFINITY } else { error };
                    worst[order] = worst[order].max(error);
                    missed |= error > tolerance;
                }
            };
        let (worst, bar) = if far { (&mut self.far, BAR_FAR) } else { (&mut self.near, BAR_NEAR) };
        compare(strict, &truth, bar, worst);
        compare(fast, &truth, bar, worst);
        if far {
            compare(strict, dual, 2.0 * BAR_FAR, &mut self.dual);
        }
        if missed && self.misses.len() < 5 {
            self.misses.push(sample.gradient.clone());
        }
    }
}

/// Gradients near rest, by decades of `|H|` from 1e-1 to 1e-12, and far from it, by stretches and
/// rotations, never turned inside out; each with a direction.
fn samples(dimension: usize, n: usize) -> Vec<Sample> {
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
