//! The energies over dual numbers, compiled for each: one pass per component of P or dP.
//!
//! Dual numbers with nine derivatives need one pass for all components and take 1.7 (P) and 2.9 times (dP) as
//! long: their derivatives are optional, which every operation asks for.

use num_dual::{Dual64, DualNum, HyperDual64};

use super::{LAMBDA, Law, MU, Tensor};

/// An energy of `F` over any numbers.
pub(super) trait Energy {
    fn psi<T: DualNum<Primitive = f64> + Copy>(f: &[[T; 3]; 3]) -> T;
}

pub(super) struct StVenantKirchhoff;

impl Energy for StVenantKirchhoff {
    #[inline(always)]
    fn psi<T: DualNum<Primitive = f64> + Copy>(f: &[[T; 3]; 3]) -> T {
        let strain = |r: usize, c: usize| {
            let one = if r == c { 1.0 } else { 0.0 };
            (f[0][r] * f[0][c] + f[1][r] * f[1][c] + f[2][r] * f[2][c] - one) * 0.5
        };
        let [xx, yy, zz] = [strain(0, 0), strain(1, 1), strain(2, 2)];
        let [xy, yz, zx] = [strain(0, 1), strain(1, 2), strain(2, 0)];
        let trace = xx + yy + zz;
        let square = xx * xx + yy * yy + zz * zz + (xy * xy + yz * yz + zx * zx) * 2.0;
        trace * trace * (0.5 * LAMBDA) + square * MU
    }
}

pub(super) struct NeoHooke;

impl Energy for NeoHooke {
    #[inline(always)]
    fn psi<T: DualNum<Primitive = f64> + Copy>(f: &[[T; 3]; 3]) -> T {
        let minor = |r: usize, s: usize| f[1][r] * f[2][s] - f[1][s] * f[2][r];
        let j = f[0][0] * minor(1, 2) + f[0][1] * minor(2, 0) + f[0][2] * minor(0, 1);
        let row = |r: usize| f[r][0] * f[r][0] + f[r][1] * f[r][1] + f[r][2] * f[r][2];
        let ln = j.ln();
        (row(0) + row(1) + row(2) - 3.0 - ln * 2.0) * (0.5 * MU) + ln * ln * (0.5 * LAMBDA)
    }
}

/// An energy as a law.
pub(super) struct Compiled<E>(std::marker::PhantomData<E>);

impl<E: Energy> Law for Compiled<E> {
    #[inline(never)]
    fn stress(f: &Tensor) -> (f64, Tensor) {
        let mut dual = f.map(|row| row.map(Dual64::from_re));
        let mut psi = 0.0;
        let stress = components(|r, c| {
            dual[r][c].eps = 1.0;
            let value = E::psi(&dual);
            dual[r][c].eps = 0.0;
            psi = value.re;
            value.eps
        });
        (psi, stress)
    }

    #[inline(never)]
    fn product(f: &Tensor, df: &Tensor) -> Tensor {
        let mut dual = components(|r, c| HyperDual64::new(f[r][c], 0.0, df[r][c], 0.0));
        components(|r, c| {
            dual[r][c].eps1 = 1.0;
            let value = E::psi(&dual);
            dual[r][c].eps1 = 0.0;
            value.eps1eps2
        })
    }
}

fn components<T: Copy>(mut component: impl FnMut(usize, usize) -> T) -> [[T; 3]; 3] {
    std::array::from_fn(|r| std::array::from_fn(|c| component(r, c)))
}
