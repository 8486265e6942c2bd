//! Energies of gathered states against the interpreter, bit for bit, and against hyper-dual numbers of
//! the energy as written, at random lengths and integrals.

use super::argument;
use super::kernel::GatheredBatch;
use crate::kernel::{Level, Mode};
use crate::model::Model;
use crate::specialise::{CompileError, Form};
use crate::values::Values;
use crate::verify::sample::Random;
use crate::verify::{UNIT_ROUNDOFF, same_bits};

/// Largest error of psi, its gradient and products, in units of [`UNIT_ROUNDOFF`] of the
/// largest component.
pub const BAR: f64 = 1e4;

/// What was found for the energies of points, or of bonds.
#[derive(Clone, Debug)]
pub struct GatheredVerification {
    /// What they are functions of, as written: `theta`, `l, m`.
    pub argument: String,
    /// How many places were tried.
    pub n_points: usize,
    /// At how many of them machine code at the strict level and interpreter differ in some bit.
    pub different_bits: usize,
    /// Largest error of psi, gradient and product against hyper-dual numbers, at both levels, in units
    /// of [`UNIT_ROUNDOFF`] of their largest components.
    pub worst: [f64; 3],
}

impl GatheredVerification {
    /// Whether nothing was found.
    pub fn passed(&self) -> bool {
        self.n_points > 0 && self.different_bits == 0 && self.worst.iter().all(|w| *w <= BAR)
    }
}

/// psi, gradient and product at each place.
type Found = [Vec<f64>; 3];

/// Verifies the energies of gathered states for these values at `n` places each; nothing where there
/// are none.
///
/// # Errors
/// An energy that cannot be compiled.
pub fn verify_gathered(
    model: &Model,
    values: &Values,
    n: usize,
) -> Result<Vec<GatheredVerification>, CompileError> {
    let modes =
        [Mode::Jit(Level::Strict), Mode::Jit(Level::Fast), Mode::Interpreter, Mode::HyperDual];
    let mut found: [Vec<Found>; 2] = Default::default();
    for mode in modes {
        let Some(kernels) = model.compile(values, mode, Form::Accurate)?.gathered else {
            return Ok(Vec::new());
        };
        for (kernel, found) in [kernels.points, kernels.bonds].iter().zip(&mut found) {
            let Some(kernel) = kernel else { continue };
            let mut random = Random::new(0x7374_6174_6573);
            let n_variables = kernel.n_variables();
            let mut numbers =
                |n: usize| (0..n).map(|_| random.uniform(0.5, 2.0)).collect::<Vec<f64>>();
            let mut variables = numbers(n_variables * n);
            let direction = numbers(n_variables * n);
            let reference = numbers(if kernel.of_bonds() { n } else { 0 });
            // Lengths at rest times stretches: the energy as written subtracts one from the other.
            for (l, rest) in variables.iter_mut().zip(&reference) {
                *l = rest * if (*l - 1.0).abs() < 0.1 { *l + 0.25 } else { *l };
            }
            let change: Vec<f64> =
                variables.iter().zip(&reference).map(|(l, rest)| (l - rest) / rest).collect();
            let at =
                GatheredBatch { n, variables: &variables, change: &change, reference: &reference };
            let mut out = [vec![0.0; n], vec![0.0; variables.len()], vec![0.0; variables.len()]];
            let [psi, gradient, product] = &mut out;
            kernel.evaluate(at, psi, gradient);
            kernel.product(at, &direction, product);
            found.push(out);
        }
    }
    let each = found.iter().enumerate().filter(|(_, found)| !found.is_empty());
    let variant = model.variant(values.dimension);
    let named = |of_bonds| variant.map_or_else(String::new, |variant| argument(variant, of_bonds));
    Ok(each.map(|(of_bonds, found)| compared(named(of_bonds == 1), n, found)).collect())
}

fn compared(argument: String, n: usize, found: &[Found]) -> GatheredVerification {
    let [strict, fast, interpreted, dual] = [0, 1, 2, 3].map(|mode| &found[mode]);
    let column = |array: &[f64], p: usize| array.iter().skip(p).step_by(n).copied().collect();
    let mut result =
        GatheredVerification { argument, n_points: n, different_bits: 0, worst: [0.0; 3] };
    for p in 0..n {
        let mut differs = false;
        for part in 0..3 {
            let of = |found: &Found| -> Vec<f64> { column(&found[part], p) };
            let (expected, machine) = (of(dual), of(strict));
            differs |= !machine.iter().zip(&of(interpreted)).all(|(x, y)| same_bits(*x, *y));
            let size = expected.iter().fold(0.0, |size: f64, x| size.max(x.abs()));
            for level in [machine, of(fast)] {
                for (x, y) in level.iter().zip(&expected) {
                    let error = (x - y).abs() / (UNIT_ROUNDOFF * size + f64::MIN_POSITIVE);
                    let error = if error.is_nan() { f64::INFINITY } else { error };
                    result.worst[part] = result.worst[part].max(error);
                }
            }
        }
        result.different_bits += usize::from(differs);
    }
    result
}
