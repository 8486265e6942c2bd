//! Energies of gathered states by hand.

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::kernel::{Batch, Law, Order, Outputs, Variables, VariablesLaw};
use piola_runtime::states::{StateEnergy, StateLaws};

use crate::common::seth_hill;

/// With energies of points alone, of bonds with what is gathered, and all there is of two integrals.
pub(crate) fn energies(body: &Arc<Body>, horizon: f64) -> Vec<(&'static str, StateEnergy)> {
    let points = |n: usize| Some(Box::new(Square(n)) as Box<dyn VariablesLaw>);
    let bonds = |n: usize| Some(Box::new(Mixed(n)) as Box<dyn VariablesLaw>);
    let one = || vec![extension(0.3)];
    let two = vec![extension(0.3), seth_hill(0.5, 2)];
    let laws = [
        ("of points", one(), points(1), None),
        ("of bonds", one(), None, bonds(1)),
        ("of all", two, points(2), bonds(2)),
    ];
    let make = |(name, integrals, points, bonds)| {
        let laws =
            StateLaws { of_law: Vec::new(), integrals, points, bonds, ..StateLaws::default() };
        (name, StateEnergy::new(Arc::clone(body), horizon, laws).unwrap())
    };
    laws.into_iter().map(make).collect()
}

/// `c (l - L)`.
fn extension(c: f64) -> Box<dyn Law> {
    Box::new(move |batch: Batch<'_>, order: Order, out: Outputs<'_>| {
        for p in 0..batch.measure.len() {
            out.psi[p] = c * batch.change[p] * batch.reference[p];
            if order >= Order::Force {
                out.dpsi[p] = c;
            }
            if order == Order::Tangent {
                out.d2psi[p] = 0.0;
            }
        }
    })
}

/// `1/2 sum_k I_k^2` of so many integrals.
struct Square(usize);

impl VariablesLaw for Square {
    fn n_variables(&self) -> usize {
        self.0
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        for p in 0..at.n {
            let own = at.current.iter().skip(p).step_by(at.n);
            psi[p] = own.fold(0.0, |sum, x| sum + 0.5 * x * x);
        }
        gradient.iter_mut().zip(at.current).for_each(|(slope, x)| *slope = *x);
    }

    fn product(&self, _: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        product.copy_from_slice(direction);
    }
}

/// `s^2/2` with `s = (l - L)/L + sum_k I_k` of so many integrals.
struct Mixed(usize);

impl VariablesLaw for Mixed {
    fn n_variables(&self) -> usize {
        1 + self.0
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        for p in 0..at.n {
            let own = at.current.iter().skip(p).step_by(at.n).skip(1);
            let s = own.fold(at.change[p], |sum, x| sum + x);
            psi[p] = 0.5 * s * s;
            for (k, slope) in gradient.iter_mut().skip(p).step_by(at.n).enumerate() {
                *slope = if k == 0 { s / at.given[p] } else { s };
            }
        }
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        for p in 0..at.n {
            let own = direction.iter().skip(p).step_by(at.n).skip(1);
            let s = own.fold(direction[p] / at.given[p], |sum, x| sum + x);
            for (k, out) in product.iter_mut().skip(p).step_by(at.n).enumerate() {
                *out = if k == 0 { s / at.given[p] } else { s };
            }
        }
    }
}
