//! Stress and tangent of `psi(F)` against independent ones, near rest and far from it.
//!
//! Machine code at the strict level must equal the interpreter bit for bit. psi, P and dP must agree
//! with numbers of any precision of the energy as written, along random directions, and far from rest
//! with hyper-dual numbers, to a stated number of `u = 2^-53` of their norm.

use super::kernel::{GradientBatch, WrittenGradientEnergy};
use crate::expression::graph;
use crate::expression::precise::Precise;
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

/// Binary digits of true values.
const BITS: usize = 384;

/// Values beyond this are left out: the squares of their norms pass the largest number, and products
/// on the way to them may.
const LARGEST: f64 = 1e150;

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

/// One gradient, a direction, and what a kernel says there.
pub(super) struct Sample {
    pub(super) gradient: Vec<f64>,
    pub(super) change: Vec<f64>,
    pub(super) direction: Vec<f64>,
}

#[derive(Clone, Debug, Default)]
struct Found {
    psi: Vec<f64>,
    stress: Vec<f64>,
    product: Vec<f64>,
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
    let compiled = |mode| Ok(model.compile_gradient(values, mode, Form::Accurate)?.0);
    let modes =
        [Mode::Jit(Level::Strict), Mode::Jit(Level::Fast), Mode::Interpreter, Mode::HyperDual];
    let samples = samples(values.dimension, n);
    let mut found = Vec::new();
    for mode in modes {
        let Some(kernel) = compiled(mode)? else { return Ok(None) };
        let n_components = values.dimension * values.dimension;
        let gather = |of: fn(&Sample) -> &Vec<f64>| -> Vec<f64> {
            (0..n_components).flat_map(|k| samples.iter().map(move |s| of(s)[k])).collect()
        };
        let (gradient, change) = (gather(|s| &s.gradient), gather(|s| &s.change));
        let direction = gather(|s| &s.direction);
        let at = GradientBatch { n: samples.len(), gradient: &gradient, change: &change };
        let mut out = Found {
            psi: vec![0.0; samples.len()],
            stress: vec![0.0; gradient.len()],
            product: vec![0.0; gradient.len()],
        };
        kernel.evaluate(at, &mut out.psi, &mut out.stress);
        kernel.product(at, &direction, &mut out.product);
        found.push(out);
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
        verification.look_at(sample, &written, p, samples.len(), &found);
    }
    Ok(Some(verification))
}

impl GradientVerification {
    fn look_at(
        &mut self,
        sample: &Sample,
        written: &WrittenGradientEnergy,
        p: usize,
        n: usize,
        found: &[Found],
    ) {
        let n_components = sample.gradient.len();
        let column =
            |array: &[f64]| (0..n_components).map(|k| array[k * n + p]).collect::<Vec<_>>();
        let all = |found: &Found| {
            let mut all = vec![found.psi[p]];
            all.extend(column(&found.stress));
            all.extend(column(&found.product));
            all
        };
        let [strict, fast, interpreted, dual] = [0, 1, 2, 3].map(|mode| all(&found[mode]));
        let Some(truth) = truth(written, sample) else { return };
        self.n_points += 1;
        if !strict.iter().zip(&interpreted).all(|(x, y)| same_bits(*x, *y)) {
            self.different_bits += 1;
        }
        let far = sample.change.iter().any(|h| h.abs() >= super::kernel::NEAR);
        let mut missed = false;
        let mut compare =
            |found: &[f64], expected: &[f64], tolerance: f64, worst: &mut [f64; 3]| {
                let parts = [0..1, 1..n_components + 1, n_components + 1..2 * n_components + 1];
                for (order, part) in parts.into_iter().enumerate() {
                    let norm =
                        |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
                    let size = norm(&mut expected[part.clone()].iter().copied());
                    let differences = part.clone().map(|k| found[k] - expected[k]);
                    let error = norm(&mut differences.into_iter());
                    let error = error / (UNIT_ROUNDOFF * size + f64::MIN_POSITIVE);
                    let error = if error.is_nan() { f64::INFINITY } else { error };
                    worst[order] = worst[order].max(error);
                    missed |= error > tolerance;
                }
            };
        let (worst, bar) = if far { (&mut self.far, BAR_FAR) } else { (&mut self.near, BAR_NEAR) };
        compare(&strict, &truth, bar, worst);
        compare(&fast, &truth, bar, worst);
        if far {
            compare(&strict, &dual, 2.0 * BAR_FAR, &mut self.dual);
        }
        if missed && self.misses.len() < 5 {
            self.misses.push(sample.gradient.clone());
        }
    }
}

/// psi, P and dP of the energy as written for exactly these numbers; nothing where one of them is no
/// finite number. P along each unit direction, dP by polarisation of second derivatives.
pub(super) fn truth(written: &WrittenGradientEnergy, sample: &Sample) -> Option<Vec<f64>> {
    let n = sample.gradient.len();
    let components = graph::components(if n == 4 { 2 } else { 3 });
    let along = |direction: &dyn Fn(usize) -> f64| -> Option<[f64; 3]> {
        let psi = written.psi(|c| {
            let k = components.iter().position(|known| *known == c).unwrap_or(0);
            if sample.change.iter().all(|h| h.abs() < super::kernel::NEAR) {
                let rest = f64::from(u8::from(c % 4 == 0));
                Precise::<BITS>::line(sample.change[k], direction(k), rest)
            } else {
                Precise::<BITS>::line(sample.gradient[k], direction(k), 0.0)
            }
        });
        psi.parts().map(|_| psi.rounded())
    };
    let mut truth = vec![along(&|k| sample.direction[k])?[0]];
    let mut products = Vec::new();
    for k in 0..n {
        let unit = |j: usize| f64::from(u8::from(j == k));
        // With D = dF: e:A:D = ((e + D):A:(e + D) - (e - D):A:(e - D))/4, all to `BITS` digits but
        // rounded: directions of one size keep the difference exact enough.
        let plus = along(&|j| sample.direction[j] + unit(j))?[2];
        let minus = along(&|j| sample.direction[j] - unit(j))?[2];
        truth.push(along(&unit)?[1]);
        products.push((plus - minus) / 4.0);
    }
    truth.extend(products);
    truth.iter().all(|x| x.abs() < LARGEST).then_some(truth)
}

/// Gradients near rest, by decades of `|H|` from 1e-1 to 1e-12, and far from it, by stretches and
/// rotations, never turned inside out; each with a direction.
fn samples(dimension: usize, n: usize) -> Vec<Sample> {
    let mut random = Random::new(0x67_7261_6469_656e);
    let n_components = dimension * dimension;
    let mut samples = Vec::new();
    for k in 0..(2 * n).min(MOST) {
        let mut numbers =
            |size: f64| (0..n_components).map(|_| size * random.uniform(-1.0, 1.0)).collect();
        // Multiples of 2^-20: sums with unit directions are exact.
        let direction: Vec<f64> = numbers(1.0);
        let direction: Vec<f64> =
            direction.iter().map(|x| (x * 1_048_576.0).round() / 1_048_576.0).collect();
        if k % 2 == 0 {
            let size = libm::pow(10.0, -1.0 - (k / 2 % 12) as f64);
            let change: Vec<f64> = numbers(size);
            let gradient = plus_identity(&change, dimension, 1.0);
            samples.push(Sample { gradient, change, direction });
        } else {
            let gradient = far(dimension, &mut random);
            let change = plus_identity(&gradient, dimension, -1.0);
            samples.push(Sample { gradient, change, direction });
        }
    }
    samples
}

pub(super) fn plus_identity(tensor: &[f64], d: usize, factor: f64) -> Vec<f64> {
    let on_diagonal = |k: usize| if k / d == k % d { factor } else { 0.0 };
    tensor.iter().enumerate().map(|(k, x)| x + on_diagonal(k)).collect()
}

/// A random tensor of positive determinant whose stretches spread over two decades.
fn far(d: usize, random: &mut Random) -> Vec<f64> {
    let rotation = |random: &mut Random| {
        // Two reflections I - 2 n n.
        let mut rotation: Vec<f64> = plus_identity(&vec![0.0; d * d], d, 1.0);
        for _ in 0..2 {
            let normal: Vec<f64> = (0..d).map(|_| random.uniform(-1.0, 1.0)).collect();
            let square: f64 = normal.iter().map(|x| x * x).sum();
            let reflect = |column: usize, from: &[f64]| -> Vec<f64> {
                let dot: f64 = (0..d).map(|r| normal[r] * from[r * d + column]).sum();
                (0..d).map(|r| from[r * d + column] - 2.0 * dot * normal[r] / square).collect()
            };
            let columns: Vec<Vec<f64>> = (0..d).map(|c| reflect(c, &rotation)).collect();
            for (k, x) in rotation.iter_mut().enumerate() {
                *x = columns[k % d][k / d];
            }
        }
        rotation
    };
    let (left, right) = (rotation(random), rotation(random));
    let stretches: Vec<f64> = (0..d).map(|_| libm::pow(10.0, random.uniform(-1.0, 1.0))).collect();
    (0..d * d)
        .map(|k| (0..d).map(|m| left[k / d * d + m] * stretches[m] * right[k % d * d + m]).sum())
        .collect()
}
