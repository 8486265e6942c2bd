//! Energies of the deformation gradient: near rest, turned, and moderately stretched.
//!
//! As `piola audit` does it, at fewer places, with true values that serve both levels: an error counts in u of
//! the norm. Of a turned body F knows a small strain to u/strain: there psi and P count in what rounding the
//! components of F changes them by.

use piola_compiler::expression::graph::components;
use piola_compiler::point::{NEAR, WrittenGradientEnergy};
use piola_compiler::verify::sample::Random;
use piola_compiler::{GradientBatch, GradientKernel, Mode};

use super::{Case, DECADES, FORM, Found, LEVELS, Truth, in_units, norm, truth};

/// A place: `F` and `F - I`, of which the one that kernels take there is exact.
struct Sample {
    name: String,
    gradient: Vec<f64>,
    change: Vec<f64>,
    direction: Vec<f64>,
    /// Whether the body is turned.
    is_turned: bool,
    /// Whether the change is taken.
    is_near: bool,
}

pub(super) fn look_at(case: &Case, found: &mut Found) {
    let written = case.model.written_gradient(&case.values);
    let kernels = LEVELS.map(|level| {
        let compiled = case.model.compile(&case.values, Mode::Jit(level), FORM).unwrap();
        compiled.gradient.unwrap()
    });
    for sample in samples(case.values.dimension) {
        let Some(truth) = truth_at(&written, &sample, &sample.direction) else { continue };
        found.n_places += 1;
        let parts = [vec![truth.psi], truth.gradient, truth.product];
        let mut scales = parts.each_ref().map(|part| norm(part.iter().copied()));
        if sample.is_turned {
            scales[0] += products(&sample.gradient, &parts[1]);
            scales[1] += rounding_changes_stress(&written, &sample);
        }
        for kernel in &kernels {
            for (order, (value, part)) in evaluate(kernel, &sample).iter().zip(&parts).enumerate() {
                let difference = norm(value.iter().zip(part).map(|(x, y)| x - y));
                found.see(sample.is_near, order, in_units(difference, scales[order]), || {
                    format!("{} {}", sample.name, case.with)
                });
            }
        }
    }
}

/// By how much psi changes when every component of F changes by its own size.
fn products(gradient: &[f64], stress: &[f64]) -> f64 {
    gradient.iter().zip(stress).map(|(f, p)| (f * p).abs()).sum()
}

/// By how much P changes when every component of F changes by its own size.
fn rounding_changes_stress(written: &WrittenGradientEnergy, sample: &Sample) -> f64 {
    let n = sample.gradient.len();
    let change = |k: usize| {
        let own: Vec<f64> = (0..n).map(|j| f64::from(u8::from(j == k))).collect();
        let truth = truth_at(written, sample, &own);
        sample.gradient[k].abs() * truth.map_or(0.0, |truth| norm(truth.product))
    };
    (0..n).map(change).sum()
}

fn truth_at(written: &WrittenGradientEnergy, sample: &Sample, direction: &[f64]) -> Option<Truth> {
    let d = if sample.gradient.len() == 4 { 2 } else { 3 };
    let components = components(d);
    // Where `F - I` is given, 1 is added to it exactly.
    let given = if sample.is_near { &sample.change } else { &sample.gradient };
    truth(given, direction, |variables| {
        written.psi(|c| {
            let j = components.iter().position(|known| *known == c).unwrap_or(0);
            let is_diagonal = c.is_multiple_of(4);
            let rest = if sample.is_near && is_diagonal { 1.0 } else { 0.0 };
            plus(variables[j].clone(), rest)
        })
    })
}

fn plus(x: super::Exact, y: f64) -> super::Exact {
    use piola_compiler::expression::Operator;
    use piola_compiler::expression::number::Number;
    if y == 0.0 { x } else { Number::binary(Operator::Add, x, Number::constant(y)) }
}

fn evaluate(kernel: &GradientKernel, sample: &Sample) -> [Vec<f64>; 3] {
    let at =
        GradientBatch { n: 1, gradient: &sample.gradient, change: &sample.change, fields: &[] };
    let n = sample.gradient.len();
    let [mut psi, mut stress, mut product] = [vec![0.0; 1], vec![0.0; n], vec![0.0; n]];
    kernel.evaluate(at, &mut psi, &mut stress);
    kernel.product(at, &sample.direction, &mut product);
    [psi, stress, product]
}

fn samples(d: usize) -> Vec<Sample> {
    let mut random = Random::new(0x6c61_7773);
    let random = &mut random;
    let mut all = Vec::new();
    for decade in DECADES {
        let strain = libm::pow(10.0, -f64::from(decade));
        let change = tensor(d, strain * libm::pow(10.0, random.uniform(-0.3, 0.3)), random);
        all.push(Sample::of_change(format!("strain 1e-{decade}"), change, random));
    }
    for size in [0.2, 0.999 * NEAR] {
        let change = tensor(d, size, random);
        all.push(Sample::of_change(format!("strain {size}"), change, random));
    }
    for decade in [2, 5, 8] {
        let strain = libm::pow(10.0, -f64::from(decade));
        let change = tensor(d, strain, random);
        let stretch: Vec<f64> = (0..d * d).map(|k| change[k] + identity(d, k)).collect();
        let gradient = times(&rotation(d, random), &stretch);
        let mut sample = Sample::of_gradient(format!("turned 1e-{decade}"), gradient, random);
        sample.is_turned = true;
        all.push(sample);
    }
    for k in 0..3 {
        let mut stretch = tensor(d, 0.1, random);
        for (j, x) in stretch.iter_mut().enumerate().filter(|(j, _)| identity(d, *j) == 1.0) {
            let largest = if k == 0 { -0.15 } else { 0.2 };
            *x += if j == 0 {
                1.5 - 0.1 * f64::from(k)
            } else {
                1.0 + largest * random.uniform(0.0, 1.0)
            };
        }
        let gradient = times(&rotation(d, random), &stretch);
        all.push(Sample::of_gradient(format!("stretched {k}"), gradient, random));
    }
    all
}

impl Sample {
    fn of_change(name: String, change: Vec<f64>, random: &mut Random) -> Sample {
        let d = if change.len() == 4 { 2 } else { 3 };
        let gradient = (0..change.len()).map(|k| change[k] + identity(d, k)).collect();
        let direction = direction(d, random);
        Sample { name, gradient, change, direction, is_turned: false, is_near: true }
    }

    fn of_gradient(name: String, gradient: Vec<f64>, random: &mut Random) -> Sample {
        let d = if gradient.len() == 4 { 2 } else { 3 };
        let change: Vec<f64> = (0..gradient.len()).map(|k| gradient[k] - identity(d, k)).collect();
        let is_near = change.iter().all(|h| h.abs() < NEAR);
        let direction = direction(d, random);
        Sample { name, gradient, change, direction, is_turned: false, is_near }
    }
}

fn identity(d: usize, k: usize) -> f64 {
    if k / d == k % d { 1.0 } else { 0.0 }
}

/// Multiples of 2^-20, so that sums with unit directions are exact.
fn direction(d: usize, random: &mut Random) -> Vec<f64> {
    tensor(d, 1.0, random).iter().map(|x| (x * 1_048_576.0).round() / 1_048_576.0).collect()
}

fn tensor(d: usize, size: f64, random: &mut Random) -> Vec<f64> {
    (0..d * d).map(|_| size * random.uniform(-1.0, 1.0)).collect()
}

/// Two reflections.
fn rotation(d: usize, random: &mut Random) -> Vec<f64> {
    let reflection = |random: &mut Random| -> Vec<f64> {
        let normal: Vec<f64> = (0..d).map(|_| random.uniform(-1.0, 1.0)).collect();
        let square: f64 = normal.iter().map(|x| x * x).sum();
        (0..d * d).map(|k| identity(d, k) - 2.0 * normal[k / d] * normal[k % d] / square).collect()
    };
    let first = reflection(random);
    times(&reflection(random), &first)
}

fn times(x: &[f64], y: &[f64]) -> Vec<f64> {
    let d = if x.len() == 4 { 2 } else { 3 };
    let component = |k: usize| (0..d).map(|m| x[k / d * d + m] * y[m * d + k % d]).sum();
    (0..d * d).map(component).collect()
}
