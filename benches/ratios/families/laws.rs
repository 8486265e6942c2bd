//! Derivatives of the two materials, by hand and by dual numbers.

use num_dual::{Dual64, DualNum, HyperDual64};

use super::{BULK, LAMBDA, MU};

pub(super) type Tensor = [[f64; 3]; 3];

/// First and second derivatives of what the models store.
pub(super) trait Derivatives {
    /// `P(F)` of St Venant-Kirchhoff material.
    fn stress(f: &Tensor) -> Tensor;
    /// `dP/dF : dF`.
    fn stress_change(f: &Tensor, df: &Tensor) -> Tensor;
    /// The derivative of `(K - 5G/3)/2 theta^2`.
    fn pressure(theta: f64) -> f64;
    /// What it changes by.
    fn pressure_change(theta: f64, change: f64) -> f64;
    /// The derivative of `scale e^2/2` by `l`, `e = l - L`.
    fn tension(scale: f64, length: f64, rest: f64) -> f64;
    /// What it changes by.
    fn tension_change(scale: f64, length: f64, rest: f64, change: f64) -> f64;
}

/// As a program for these models alone would have them.
pub(super) struct ByHand;

impl ByHand {
    /// Second Piola-Kirchhoff stress of a Green-Lagrange strain.
    #[inline(always)]
    fn second(e: &Tensor) -> Tensor {
        let trace = LAMBDA * (e[0][0] + e[1][1] + e[2][2]);
        let mut s = *e;
        s.as_flattened_mut().iter_mut().for_each(|x| *x *= 2.0 * MU);
        (0..3).for_each(|k| s[k][k] += trace);
        s
    }
}

#[inline(always)]
fn multiply(a: &Tensor, b: &Tensor) -> Tensor {
    let entry = |r: usize, c: usize| a[r][0] * b[0][c] + a[r][1] * b[1][c] + a[r][2] * b[2][c];
    std::array::from_fn(|r| std::array::from_fn(|c| entry(r, c)))
}

#[inline(always)]
fn strain(f: &Tensor) -> Tensor {
    let entry = |r: usize, c: usize| {
        let one = if r == c { 1.0 } else { 0.0 };
        0.5 * (f[0][r] * f[0][c] + f[1][r] * f[1][c] + f[2][r] * f[2][c] - one)
    };
    std::array::from_fn(|r| std::array::from_fn(|c| entry(r, c)))
}

impl Derivatives for ByHand {
    #[inline(always)]
    fn stress(f: &Tensor) -> Tensor {
        multiply(f, &ByHand::second(&strain(f)))
    }

    #[inline(always)]
    fn stress_change(f: &Tensor, df: &Tensor) -> Tensor {
        let half =
            |r: usize, c: usize| f[0][r] * df[0][c] + f[1][r] * df[1][c] + f[2][r] * df[2][c];
        let de: Tensor =
            std::array::from_fn(|r| std::array::from_fn(|c| 0.5 * (half(r, c) + half(c, r))));
        let geometric = multiply(df, &ByHand::second(&strain(f)));
        let material = multiply(f, &ByHand::second(&de));
        std::array::from_fn(|r| std::array::from_fn(|c| geometric[r][c] + material[r][c]))
    }

    #[inline(always)]
    fn pressure(theta: f64) -> f64 {
        (BULK - 5.0 * MU / 3.0) * theta
    }

    #[inline(always)]
    fn pressure_change(_theta: f64, change: f64) -> f64 {
        (BULK - 5.0 * MU / 3.0) * change
    }

    #[inline(always)]
    fn tension(scale: f64, length: f64, rest: f64) -> f64 {
        scale * (length - rest)
    }

    #[inline(always)]
    fn tension_change(scale: f64, _length: f64, _rest: f64, change: f64) -> f64 {
        scale * change
    }
}

/// By dual numbers, compiled for each energy.
pub(super) struct ByNumbers;

/// `lambda/2 tr(E)^2 + mu E:E`.
#[inline(always)]
fn psi<T: DualNum<Primitive = f64> + Copy>(f: &[[T; 3]; 3]) -> T {
    let (mut trace, mut square) = (T::from(0.0), T::from(0.0));
    for r in 0..3 {
        for c in 0..3 {
            let one = if r == c { 1.0 } else { 0.0 };
            let e = (f[0][r] * f[0][c] + f[1][r] * f[1][c] + f[2][r] * f[2][c] - one) * 0.5;
            square += e * e;
            if r == c {
                trace += e;
            }
        }
    }
    trace * trace * (0.5 * LAMBDA) + square * MU
}

#[inline(always)]
fn of_dilatation<T: DualNum<Primitive = f64> + Copy>(theta: T) -> T {
    theta * theta * (0.5 * (BULK - 5.0 * MU / 3.0))
}

#[inline(always)]
fn of_length<T: DualNum<Primitive = f64> + Copy>(scale: f64, length: T, rest: f64) -> T {
    let e = length - rest;
    e * e * (0.5 * scale)
}

impl Derivatives for ByNumbers {
    #[inline(never)]
    fn stress(f: &Tensor) -> Tensor {
        let mut dual = f.map(|row| row.map(Dual64::from_re));
        let mut stress = [[0.0; 3]; 3];
        for r in 0..3 {
            for c in 0..3 {
                dual[r][c].eps = 1.0;
                stress[r][c] = psi(&dual).eps;
                dual[r][c].eps = 0.0;
            }
        }
        stress
    }

    #[inline(never)]
    fn stress_change(f: &Tensor, df: &Tensor) -> Tensor {
        let mut dual: [[HyperDual64; 3]; 3] = std::array::from_fn(|r| {
            std::array::from_fn(|c| HyperDual64::new(f[r][c], 0.0, df[r][c], 0.0))
        });
        let mut change = [[0.0; 3]; 3];
        for r in 0..3 {
            for c in 0..3 {
                dual[r][c].eps1 = 1.0;
                change[r][c] = psi(&dual).eps1eps2;
                dual[r][c].eps1 = 0.0;
            }
        }
        change
    }

    #[inline(always)]
    fn pressure(theta: f64) -> f64 {
        of_dilatation(Dual64::new(theta, 1.0)).eps
    }

    #[inline(always)]
    fn pressure_change(theta: f64, change: f64) -> f64 {
        of_dilatation(HyperDual64::new(theta, 1.0, change, 0.0)).eps1eps2
    }

    #[inline(always)]
    fn tension(scale: f64, length: f64, rest: f64) -> f64 {
        of_length(scale, Dual64::new(length, 1.0), rest).eps
    }

    #[inline(always)]
    fn tension_change(scale: f64, length: f64, rest: f64, change: f64) -> f64 {
        of_length(scale, HyperDual64::new(length, 1.0, change, 0.0), rest).eps1eps2
    }
}
