//! Loops that a machine is measured by: what memory and arithmetic give at best.

use std::hint::black_box;

use pulp::{Arch, Simd, WithSimd};

/// The arrays of a triad.
#[derive(Debug, Default)]
pub struct Triad {
    a: Vec<f64>,
    b: Vec<f64>,
    c: Vec<f64>,
}

impl Triad {
    /// `a = b + s c` over so many numbers.
    pub fn pass(&mut self, numbers: usize) {
        self.a.resize(numbers, 0.0);
        self.b.resize(numbers, 1.0);
        self.c.resize(numbers, 2.0);
        let s = black_box(3.0);
        for ((a, b), c) in self.a.iter_mut().zip(&self.b).zip(&self.c) {
            *a = b + s * c;
        }
        black_box(&self.a);
    }
}

/// Sums that go on side by side, as many as hide how long one takes.
const SUMS: usize = 12;

/// Multiply-adds of each.
const STEPS: usize = 1 << 16;

/// Makes multiply-adds in the machine's registers; how many.
pub fn multiply_adds() -> usize {
    let arch = Arch::new();
    black_box(arch.dispatch(Sums));
    SUMS * STEPS * arch.dispatch(Width)
}

/// Numbers of 64 bits in a register of the machine.
pub fn lanes() -> usize {
    Arch::new().dispatch(Width)
}

/// Multiply-adds in registers.
struct Sums;

impl WithSimd for Sums {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let (factor, term) = black_box((0.999, 0.001));
        let (factor, term) = (simd.splat_f64s(factor), simd.splat_f64s(term));
        let mut sums = [simd.splat_f64s(1.0); SUMS];
        for _ in 0..STEPS {
            for sum in &mut sums {
                *sum = simd.mul_add_e_f64s(*sum, factor, term);
            }
        }
        let mut all = 0.0;
        for sum in sums {
            all += simd.reduce_sum_f64s(sum);
        }
        all
    }
}

/// Numbers of 64 bits in a register.
struct Width;

impl WithSimd for Width {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::F64_LANES
    }
}
