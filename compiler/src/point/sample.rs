//! Deformation gradients at which an energy is tried: near rest, turned, stretched, random.

use super::kernel::{GradientBatch, GradientKernel, NEAR};
use crate::expression::graph::dimension;
use crate::verify::sample::Random;

/// One gradient and a direction.
#[derive(Clone, Debug)]
pub(crate) struct Sample {
    /// `F`, row by row.
    pub(crate) gradient: Vec<f64>,
    /// `F - I`; near rest it is exact, and `F` is rounded.
    pub(crate) change: Vec<f64>,
    /// `dF`: multiples of 2^-20, so that sums with unit directions are exact.
    pub(crate) direction: Vec<f64>,
}

impl Sample {
    /// `I + H` for an exact `H`.
    pub(crate) fn of_change(change: Vec<f64>, random: &mut Random) -> Sample {
        let gradient = plus_identity(&change, 1.0);
        Sample { gradient, direction: direction(change.len(), random), change }
    }

    /// An exact `F`.
    pub(crate) fn of_gradient(gradient: Vec<f64>, random: &mut Random) -> Sample {
        let change = plus_identity(&gradient, -1.0);
        Sample { change, direction: direction(gradient.len(), random), gradient }
    }

    /// The same with another `F - I`, which is exact where it is near rest; else `F` is.
    pub(crate) fn with_change(&self, change: Vec<f64>) -> Sample {
        let gradient = plus_identity(&change, 1.0);
        let moved = Sample { gradient, change, direction: self.direction.clone() };
        match moved.is_near() {
            true => moved,
            false => Sample { change: plus_identity(&moved.gradient, -1.0), ..moved },
        }
    }

    /// Whether `F - I` is what is given, and kernels take it here, but for functions that are steep at rest.
    pub(crate) fn is_near(&self) -> bool {
        self.change.iter().all(|h| h.abs() < NEAR)
    }

    /// What kernels take here: `F - I` or `F`.
    pub(crate) fn given(&self) -> &[f64] {
        if self.is_near() { &self.change } else { &self.gradient }
    }

    /// The same where other components are given.
    pub(crate) fn moved(&self, given: Vec<f64>) -> Sample {
        let mut moved = self.clone();
        if self.is_near() {
            moved.gradient = plus_identity(&given, 1.0);
            moved.change = given;
        } else {
            moved.change = plus_identity(&given, -1.0);
            moved.gradient = given;
        }
        moved
    }
}

/// psi, then P, then dP of a kernel at every sample.
pub(crate) fn evaluate(kernel: &GradientKernel, samples: &[Sample]) -> Vec<Vec<f64>> {
    evaluate_with(kernel, samples, &[])
}

/// The same with values of fields; see [`GradientBatch::fields`].
pub(super) fn evaluate_with(
    kernel: &GradientKernel,
    samples: &[Sample],
    fields: &[f64],
) -> Vec<Vec<f64>> {
    let n = samples.len();
    let n_components = kernel.dimension() * kernel.dimension();
    let columns = |of: fn(&Sample) -> &Vec<f64>| -> Vec<f64> {
        (0..n_components).flat_map(|k| samples.iter().map(move |s| of(s)[k])).collect()
    };
    let (gradient, change) = (columns(|s| &s.gradient), columns(|s| &s.change));
    let at = GradientBatch { n, gradient: &gradient, change: &change, fields };
    let (mut psi, mut stress) = (vec![0.0; n], vec![0.0; gradient.len()]);
    let mut product = vec![0.0; gradient.len()];
    kernel.evaluate(at, &mut psi, &mut stress);
    kernel.product(at, &columns(|s| &s.direction), &mut product);
    let row = |p: usize| {
        let column = |array: &[f64]| (0..n_components).map(|k| array[k * n + p]).collect();
        let [stress, product]: [Vec<f64>; 2] = [column(&stress), column(&product)];
        [vec![psi[p]], stress, product].concat()
    };
    (0..n).map(row).collect()
}

/// `tensor + factor*I`
pub(crate) fn plus_identity(tensor: &[f64], factor: f64) -> Vec<f64> {
    let d = dimension(tensor.len());
    let on_diagonal = |k: usize| if k / d == k % d { factor } else { 0.0 };
    tensor.iter().enumerate().map(|(k, x)| x + on_diagonal(k)).collect()
}

fn direction(n_components: usize, random: &mut Random) -> Vec<f64> {
    let direction = tensor(n_components, 1.0, random).into_iter();
    direction.map(|x| (x * 1_048_576.0).round() / 1_048_576.0).collect()
}

/// Components between `-size` and `size`.
pub(crate) fn tensor(n_components: usize, size: f64, random: &mut Random) -> Vec<f64> {
    (0..n_components).map(|_| size * random.uniform(-1.0, 1.0)).collect()
}

/// A random rotation: two reflections `I - 2 n n`.
pub(crate) fn rotation(d: usize, random: &mut Random) -> Vec<f64> {
    let mut rotation = plus_identity(&vec![0.0; d * d], 1.0);
    for _ in 0..2 {
        let normal = tensor(d, 1.0, random);
        let square: f64 = normal.iter().map(|x| x * x).sum();
        let mut reflection = plus_identity(&vec![0.0; d * d], 1.0);
        for (k, x) in reflection.iter_mut().enumerate() {
            *x -= 2.0 * normal[k / d] * normal[k % d] / square;
        }
        rotation = times(&reflection, &rotation);
    }
    rotation
}

/// `x*y`
pub(crate) fn times(x: &[f64], y: &[f64]) -> Vec<f64> {
    let d = dimension(x.len());
    let component = |k: usize| (0..d).map(|m| x[k / d * d + m] * y[m * d + k % d]).sum();
    (0..d * d).map(component).collect()
}

/// A tensor with these stretches along the axes.
pub(crate) fn diagonal(stretches: &[f64]) -> Vec<f64> {
    let d = stretches.len();
    (0..d * d).map(|k| if k / d == k % d { stretches[k / d] } else { 0.0 }).collect()
}

/// A random tensor of positive determinant whose stretches spread over so many decades up and down.
pub(crate) fn far(d: usize, decades: f64, random: &mut Random) -> Vec<f64> {
    let (left, right) = (rotation(d, random), rotation(d, random));
    let stretch = |_| libm::pow(10.0, decades * random.uniform(-1.0, 1.0));
    let stretches: Vec<f64> = (0..d).map(stretch).collect();
    times(&times(&left, &diagonal(&stretches)), &right)
}
