//! Derivatives of the two materials, by hand and by dual numbers, for eight tensors side by side.
//!
//! Of what num-dual offers, one pass of `Dual64` or `HyperDual64` per component over eight tensors was
//! the fastest: 22 ns for a stress and 59 ns for its change. One tensor after the other takes 88 and
//! 208 ns, all components in one pass of vector duals 263 ns (`DualSVec64<9>`) and 914 ns
//! (`HyperDualSVec64<9, 1>`; `DualSVec<Dual64, 9>` 1109 ns): these ask at every operation whether they
//! carry any derivatives.

use num_dual::{Dual64, DualNum, HyperDual64};

use super::{BULK, LAMBDA, MU};

pub(super) type Tensor = [[f64; 3]; 3];

/// Tensors side by side.
pub(super) const LANES: usize = 8;

/// A tensor in every lane.
pub(super) type Tensors = [[[f64; LANES]; 3]; 3];

pub(super) const NO_TENSORS: Tensors = [[[0.0; LANES]; 3]; 3];

#[inline(always)]
pub(super) fn lane_of(tensors: &Tensors, lane: usize) -> Tensor {
    let mut tensor = [[0.0; 3]; 3];
    for r in 0..3 {
        for c in 0..3 {
            tensor[r][c] = tensors[r][c][lane];
        }
    }
    tensor
}

#[inline(always)]
pub(super) fn set_lane(tensors: &mut Tensors, lane: usize, tensor: &Tensor) {
    for r in 0..3 {
        for c in 0..3 {
            tensors[r][c][lane] = tensor[r][c];
        }
    }
}

/// First and second derivatives of what the models store.
pub(super) trait Derivatives {
    /// `P(F)` of St Venant-Kirchhoff material.
    fn stress(f: &Tensors) -> Tensors;
    /// `dP/dF : dF`.
    fn stress_change(f: &Tensors, df: &Tensors) -> Tensors;
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

    #[inline(always)]
    fn change(f: &Tensor, df: &Tensor) -> Tensor {
        let half =
            |r: usize, c: usize| f[0][r] * df[0][c] + f[1][r] * df[1][c] + f[2][r] * df[2][c];
        let de: Tensor =
            std::array::from_fn(|r| std::array::from_fn(|c| 0.5 * (half(r, c) + half(c, r))));
        let geometric = multiply(df, &ByHand::second(&strain(f)));
        let material = multiply(f, &ByHand::second(&de));
        std::array::from_fn(|r| std::array::from_fn(|c| geometric[r][c] + material[r][c]))
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
    fn stress(f: &Tensors) -> Tensors {
        let mut out = NO_TENSORS;
        for lane in 0..LANES {
            let f = lane_of(f, lane);
            set_lane(&mut out, lane, &multiply(&f, &ByHand::second(&strain(&f))));
        }
        out
    }

    #[inline(always)]
    fn stress_change(f: &Tensors, df: &Tensors) -> Tensors {
        let mut out = NO_TENSORS;
        for lane in 0..LANES {
            set_lane(&mut out, lane, &ByHand::change(&lane_of(f, lane), &lane_of(df, lane)));
        }
        out
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

/// `lambda/2 tr(E)^2 + mu E:E`. Written out for the six components: as a loop over nine no compiler
/// takes eight lanes at once.
#[inline(always)]
fn psi<T: DualNum<Primitive = f64> + Copy>([p, q, r]: &[[T; 3]; 3]) -> T {
    let xx = (p[0] * p[0] + q[0] * q[0] + r[0] * r[0] - 1.0) * 0.5;
    let yy = (p[1] * p[1] + q[1] * q[1] + r[1] * r[1] - 1.0) * 0.5;
    let zz = (p[2] * p[2] + q[2] * q[2] + r[2] * r[2] - 1.0) * 0.5;
    // Twice the strains.
    let xy = p[0] * p[1] + q[0] * q[1] + r[0] * r[1];
    let xz = p[0] * p[2] + q[0] * q[2] + r[0] * r[2];
    let yz = p[1] * p[2] + q[1] * q[2] + r[1] * r[2];
    let (trace, mixed) = (xx + yy + zz, (xy * xy + xz * xz + yz * yz) * 0.5);
    trace * trace * (0.5 * LAMBDA) + (xx * xx + yy * yy + zz * zz + mixed) * MU
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
    #[inline(always)]
    fn stress(f: &Tensors) -> Tensors {
        let mut out = NO_TENSORS;
        for place in 0..9 {
            let (mut seed, f) = ([[0.0; 3]; 3], *f);
            seed[place / 3][place % 3] = 1.0;
            let mut passed = [0.0; LANES];
            for lane in 0..LANES {
                let mut dual = [[Dual64::from_re(0.0); 3]; 3];
                for r in 0..3 {
                    for c in 0..3 {
                        dual[r][c] = Dual64::new(f[r][c][lane], seed[r][c]);
                    }
                }
                passed[lane] = psi(&dual).eps;
            }
            out[place / 3][place % 3] = passed;
        }
        out
    }

    #[inline(always)]
    fn stress_change(f: &Tensors, df: &Tensors) -> Tensors {
        let mut out = NO_TENSORS;
        for place in 0..9 {
            let (mut seed, f, df) = ([[0.0; 3]; 3], *f, *df);
            seed[place / 3][place % 3] = 1.0;
            let mut passed = [0.0; LANES];
            for lane in 0..LANES {
                let mut dual = [[HyperDual64::from_re(0.0); 3]; 3];
                for r in 0..3 {
                    for c in 0..3 {
                        let (f, df) = (f[r][c][lane], df[r][c][lane]);
                        dual[r][c] = HyperDual64::new(f, seed[r][c], df, 0.0);
                    }
                }
                passed[lane] = psi(&dual).eps1eps2;
            }
            out[place / 3][place % 3] = passed;
        }
        out
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
