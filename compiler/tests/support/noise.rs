//! Numbers rounded worse than they need be: as far as results scatter, their digits mean nothing.
//!
//! Every result of an operation is off by one unit in the last place, up or down at random, and so is
//! every argument of an elementary function, whose own rules round on the way (Parker 1997, Monte Carlo
//! arithmetic). Zeros get a sign at random: rules do not keep it, and it decides what 1/0 is.

use std::cell::{Cell, RefCell};

use num_dual::HyperDual64;
use piola_compiler::expression::number::Number;
use piola_compiler::expression::{Function, Operator};
use piola_compiler::verify::sample::Random;

thread_local! {
    static RANDOM: RefCell<Random> = RefCell::new(Random::new(0));
    static ROUNDS: Cell<bool> = const { Cell::new(true) };
}

/// Begins the sequence anew: what follows depends on the seed alone. Without rounding only zeros get
/// a sign at random, which decides between both infinities where something is divided by them.
pub(crate) fn begin(seed: u64, rounds: bool) {
    RANDOM.set(Random::new(seed));
    ROUNDS.set(rounds);
}

/// Numbers made of 64-bit floats.
pub(crate) trait Parts: Number {
    /// The same with every float changed.
    fn each(self, change: impl FnMut(f64) -> f64) -> Self;
}

impl Parts for f64 {
    fn each(self, mut change: impl FnMut(f64) -> f64) -> f64 {
        change(self)
    }
}

impl Parts for HyperDual64 {
    fn each(self, mut change: impl FnMut(f64) -> f64) -> Self {
        let [re, eps1, eps2, both] =
            [self.re, self.eps1, self.eps2, self.eps1eps2].map(&mut change);
        HyperDual64::new(re, eps1, eps2, both)
    }
}

/// A number off by `times` units in the last place of each of its floats, up or down.
pub(crate) fn disturbed<N: Parts>(x: N, times: f64) -> N {
    let size = if ROUNDS.get() { times * f64::EPSILON } else { 0.0 };
    RANDOM.with_borrow_mut(|random| {
        x.each(|x| {
            let side = if random.bits() & 1 == 0 { 1.0 } else { -1.0 };
            if x == 0.0 { side * x } else { x * (1.0 + side * size) }
        })
    })
}

/// A number whose operations round at random.
#[derive(Clone, Debug)]
pub(crate) struct Noisy<N>(pub(crate) N);

impl<N: Parts> Number for Noisy<N> {
    fn constant(value: f64) -> Self {
        Noisy(N::constant(value))
    }

    fn value(&self) -> f64 {
        self.0.value()
    }

    fn unary(function: Function, x: Self) -> Self {
        match function {
            Function::Negate | Function::Abs | Function::Sign => Noisy(N::unary(function, x.0)),
            _ => Noisy(disturbed(N::unary(function, disturbed(x.0, 1.0)), 1.0)),
        }
    }

    fn binary(operator: Operator, x: Self, y: Self) -> Self {
        match operator {
            // Either one: operands stand in any order, and both may touch where they are equal.
            Operator::Min | Operator::Max if x.value() == y.value() => {
                if RANDOM.with_borrow_mut(Random::bits) & 1 == 0 { x } else { y }
            }
            Operator::Min | Operator::Max => Noisy(N::binary(operator, x.0, y.0)),
            Operator::Power => {
                let power = N::binary(operator, disturbed(x.0, 1.0), disturbed(y.0, 1.0));
                Noisy(disturbed(power, 1.0))
            }
            _ => Noisy(disturbed(N::binary(operator, x.0, y.0), 1.0)),
        }
    }

    /// A power is a plan of products, one rounding each.
    fn power_constant(x: Self, exponent: f64) -> Self {
        let power = N::power_constant(disturbed(x.0, 1.0), exponent);
        Noisy(disturbed(power, 1.0 + exponent.abs().min(64.0)))
    }
}
