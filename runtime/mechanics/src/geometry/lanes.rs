//! Interactions side by side in one vector register, as wide as the machine has them.
//!
//! Every operation is the plain one of `f64` in each lane, and none is fused: the same bits on every
//! machine, however wide its registers are.

use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::{Simd, WithSimd};

use super::Scalar;
use crate::element::WIDEST;

/// As many ones as one likes and then zeros, from so many places before the middle on.
const ONES_AND_ZEROS: [f64; 2 * WIDEST] =
    [1., 1., 1., 1., 1., 1., 1., 1., 0., 0., 0., 0., 0., 0., 0., 0.];

/// A loop that is compiled for the registers of the machine, to be dispatched. A closure that is dispatched itself is
/// called by `FnOnce::call_once`. Where it moves nothing out of what it captures, that is a function of its own around
/// it, which knows nothing of these registers.
pub(crate) struct InRegisters<F>(pub(crate) F);

impl<R, F: FnMut() -> R> WithSimd for InRegisters<F> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) -> R {
        (self.0)()
    }
}

/// One number of each of `S::F64_LANES` interactions.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<S: Simd> {
    simd: S,
    numbers: S::f64s,
}

impl<S: Simd> Lanes<S> {
    /// How many there are.
    pub const WIDTH: usize = S::F64_LANES;

    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(simd: S, x: f64) -> Self {
        Lanes { simd, numbers: simd.splat_f64s(x) }
    }

    /// 1 in so many lanes, 0 in those after them.
    #[inline(always)]
    pub fn ones(simd: S, n: usize) -> Self {
        Lanes::load(simd, &ONES_AND_ZEROS[WIDEST - n..], 0)
    }

    /// The numbers of a register.
    #[inline(always)]
    pub fn new(simd: S, numbers: S::f64s) -> Self {
        Lanes { simd, numbers }
    }

    /// As a register.
    #[inline(always)]
    pub fn numbers(self) -> S::f64s {
        self.numbers
    }

    /// The numbers of group `group` of a channel.
    #[inline(always)]
    pub fn load(simd: S, channel: &[f64], group: usize) -> Self {
        Lanes { simd, numbers: S::as_simd_f64s(channel).0[group] }
    }

    /// Writes them to group `group` of a channel.
    #[inline(always)]
    pub fn store(self, channel: &mut [f64], group: usize) {
        S::as_mut_simd_f64s(channel).0[group] = self.numbers;
    }

    /// `yes` in the lanes where `self < other`, `no` in all others.
    #[inline(always)]
    pub fn where_less(self, other: Self, yes: Self, no: Self) -> Self {
        let mask = self.simd.less_than_f64s(self.numbers, other.numbers);
        Lanes { numbers: self.simd.select_f64s(mask, yes.numbers, no.numbers), ..self }
    }

    /// 0 in the lanes whose number is finite, not a number in all others.
    #[inline(always)]
    pub fn zero_or_nan(self) -> Self {
        self * self.alike(0.0)
    }

    /// The larger of two numbers in each lane, where both are numbers.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        Lanes { numbers: self.simd.max_f64s(self.numbers, other.numbers), ..self }
    }

    /// The largest of them, where all are numbers.
    #[inline(always)]
    pub fn largest(self) -> f64 {
        self.simd.reduce_max_f64s(self.numbers)
    }
}

macro_rules! lane_operator {
    ($trait:ident, $method:ident, $instruction:ident) => {
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Lanes { numbers: self.simd.$instruction(self.numbers, other.numbers), ..self }
            }
        }
    };
}
lane_operator!(Add, add, add_f64s);
lane_operator!(Sub, sub, sub_f64s);
lane_operator!(Mul, mul, mul_f64s);
lane_operator!(Div, div, div_f64s);

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Lanes { numbers: self.simd.neg_f64s(self.numbers), ..self }
    }
}

impl<S: Simd> Scalar for Lanes<S> {
    #[inline(always)]
    fn alike(self, x: f64) -> Self {
        Lanes::splat(self.simd, x)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Lanes { numbers: self.simd.sqrt_f64s(self.numbers), ..self }
    }
    #[inline(always)]
    fn sign(self) -> Self {
        let sign = self.simd.and_f64s(self.numbers, self.simd.splat_f64s(-0.0));
        Lanes { numbers: self.simd.or_f64s(sign, self.simd.splat_f64s(1.0)), ..self }
    }
    #[inline(always)]
    fn where_equal(self, other: Self, yes: Self, no: Self) -> Self {
        let mask = self.simd.equal_f64s(self.numbers, other.numbers);
        Lanes { numbers: self.simd.select_f64s(mask, yes.numbers, no.numbers), ..self }
    }
}
