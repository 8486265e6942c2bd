//! Energies of the deformation gradient: regimes, and what an error counts in.

use super::tensor::{error_left, tensor_in_units};
use super::{Place, Regime, Settings};
use crate::point::sample::{self, Sample};
use crate::point::truth::{norm, parts, truth};
use crate::point::{GradientKernel, NEAR, WrittenGradientEnergy};
use crate::verify::sample::Random;

/// Errors of a kernel in every regime: of so many of psi, P and dP.
pub(super) fn regimes(
    kernel: &GradientKernel,
    written: &WrittenGradientEnergy,
    (settings, n_orders): (&Settings, usize),
) -> Vec<Regime> {
    let mut regimes = Vec::new();
    for (name, strain, mut samples) in samples(kernel.dimension(), settings.points) {
        samples.retain(|sample| kernel.admits(&sample.gradient));
        let mut regime = Regime::new(name, strain);
        for (sample, found) in samples.iter().zip(sample::evaluate(kernel, &samples)) {
            measure_errors(&mut regime, written, sample, (&found, n_orders), settings.bar);
        }
        regimes.push(regime);
    }
    regimes
}

fn measure_errors(
    regime: &mut Regime,
    written: &WrittenGradientEnergy,
    sample: &Sample,
    (found, n_orders): (&[f64], usize),
    bar: f64,
) {
    let Some(expected) = truth(written, sample) else { return };
    regime.n_points += 1;
    for (order, part) in parts(sample.gradient.len()).into_iter().take(n_orders).enumerate() {
        let size = norm(expected[part.clone()].iter().copied());
        let difference = norm(part.map(|k| found[k] - expected[k]));
        let raw = tensor_in_units(difference, size, size);
        let left =
            if raw > bar { error_left(written, sample, &expected, order, difference) } else { raw };
        regime.see(order, [raw, left], || Place::Gradient {
            gradient: sample.gradient.clone(),
            change: sample.change.clone(),
            direction: sample.direction.clone(),
            is_near: sample.is_near(),
        });
    }
}

/// Regimes: name, decade of the strain near rest, gradients.
type Samples = Vec<(String, Option<f64>, Vec<Sample>)>;

/// A kind of stretches along the axes, of one size, in two and three dimensions.
type Kind = (&'static str, fn(f64, usize) -> Vec<f64>);

const KINDS: [Kind; 4] = [
    ("uniaxial", |s, d| [s, 1.0, 1.0][..d].to_vec()),
    ("equibiaxial", |s, d| [s, s, 1.0][..d].to_vec()),
    ("isochoric", |s, d| if d == 2 { vec![s, 1.0 / s] } else { vec![s, 1.0, 1.0 / s] }),
    ("volumetric", |s, d| vec![s; d]),
];

fn samples(d: usize, n: usize) -> Samples {
    let mut random = Random::new(0x6175_6469_7446);
    let random = &mut random;
    let mut all: Samples = Vec::new();
    let mut add = |name: String, strain: Option<f64>, make: &mut dyn FnMut(usize) -> Sample| {
        all.push((name, strain, (0..n).map(make).collect()));
    };
    for decade in 1..=15 {
        let strain = power_of_ten(-decade);
        add(format!("strain 1e-{decade}"), Some(strain), &mut |_| {
            let change = strained(d, strain, random);
            Sample::of_change(change, random)
        });
    }
    for decade in [2, 5, 8, 11] {
        add(format!("turned 1e-{decade}"), None, &mut |k| {
            turned(d, power_of_ten(-decade), k, random)
        });
    }
    for (name, stretches) in KINDS {
        for decade in [-6, -4, -2, -1, 1, 2, 4, 6] {
            // In the plane the two are one.
            if (name, d) == ("equibiaxial", 2) {
                continue;
            }
            add(format!("{name} 1e{decade}"), None, &mut |_| {
                let size = power_of_ten(decade) * random.uniform(0.6, 1.7);
                Sample::of_gradient(sample::diagonal(&stretches(size, d)), random)
            });
        }
    }
    for decade in [0, 2, 4, 6] {
        add(format!("shear 1e{decade}"), None, &mut |_| {
            let mut gradient = sample::diagonal(&vec![1.0; d]);
            gradient[1] = power_of_ten(decade) * random.uniform(0.6, 1.7);
            Sample::of_gradient(gradient, random)
        });
    }
    for decades in [1, 2] {
        add(format!("random 1e{decades}"), None, &mut |_| {
            Sample::of_gradient(sample::far(d, f64::from(decades), random), random)
        });
    }
    add("inverted".to_string(), None, &mut |_| {
        let mut gradient = sample::far(d, 1.0, random);
        gradient[..d].iter_mut().for_each(|x| *x = -*x);
        Sample::of_gradient(gradient, random)
    });
    add("guards".to_string(), None, &mut |k| guard(d, k, random));
    all
}

fn power_of_ten(exponent: i32) -> f64 {
    libm::pow(10.0, f64::from(exponent))
}

/// A change of about this size.
fn strained(d: usize, strain: f64, random: &mut Random) -> Vec<f64> {
    let size = strain * libm::pow(10.0, random.uniform(-0.3, 0.3));
    sample::tensor(d * d, size, random)
}

/// A small strain, then a rotation by any angle or by 1e-1 to 1e-4.
fn turned(d: usize, strain: f64, k: usize, random: &mut Random) -> Sample {
    let rotation = if k.is_multiple_of(2) {
        sample::rotation(d, random)
    } else {
        let mut small = sample::diagonal(&vec![1.0; d]);
        let angle = libm::pow(10.0, random.uniform(-4.0, -1.0));
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        (small[0], small[1], small[d], small[d + 1]) = (cos, -sin, sin, cos);
        small
    };
    let change = strained(d, strain, random);
    let gradient = sample::times(&rotation, &sample::plus_identity(&change, 1.0));
    Sample::of_gradient(gradient, random)
}

/// The largest component of `F - I` is where kernels of functions that are not steep at rest change from one form to
/// the other, or one rounding below or above it.
fn guard(d: usize, k: usize, random: &mut Random) -> Sample {
    let mut change = sample::tensor(d * d, 0.9 * NEAR, random);
    change[k % (d * d)] = [NEAR.next_down(), NEAR, NEAR.next_up()][k % 3];
    Sample::of_change(change, random)
}
