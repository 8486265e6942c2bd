//! What a number type must offer so that a graph can be evaluated over it.

use std::f64::consts::FRAC_2_SQRT_PI;

use num_dual::{Dual2_64, DualNum, HyperDual64};

use super::function::log1pmx;
use super::power::{PowerOps, PowerPlan};
use super::{Function, Operator};

/// A number over which a graph can be evaluated.
///
/// `f64` is the strict level, bit for bit what the machine code computes; the dual numbers carry
/// first and second derivatives and are independent of the symbolic ones.
pub trait Number: Clone {
    /// A constant.
    fn constant(value: f64) -> Self;
    /// Its value, on which comparisons decide.
    fn value(&self) -> f64;
    /// A function of it.
    fn unary(function: Function, x: Self) -> Self;
    /// An operator with two of them.
    fn binary(operator: Operator, x: Self, y: Self) -> Self;
    /// `x^c`
    fn power_constant(x: Self, exponent: f64) -> Self;
}

/// The smaller of two numbers; not a number if either is none, `-0 < +0`.
pub fn min(x: f64, y: f64) -> f64 {
    if x.is_nan() || y.is_nan() {
        f64::NAN
    } else if x < y || (x == y && x.is_sign_negative()) {
        x
    } else {
        y
    }
}

/// The larger of two numbers; not a number if either is none, `-0 < +0`.
pub fn max(x: f64, y: f64) -> f64 {
    if x.is_nan() || y.is_nan() {
        f64::NAN
    } else if x > y || (x == y && y.is_sign_negative()) {
        x
    } else {
        y
    }
}

/// -1, 0 or 1; zeros and non-numbers stay what they are.
pub fn sign(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        x
    }
}

impl Number for f64 {
    fn constant(value: f64) -> f64 {
        value
    }

    fn value(&self) -> f64 {
        *self
    }

    fn unary(function: Function, x: f64) -> f64 {
        match function {
            Function::Negate => -x,
            Function::Abs => x.abs(),
            Function::Sign => sign(x),
            Function::Sqrt => x.sqrt(),
            other => (other.libm().expect("every other function has a body"))(x),
        }
    }

    fn binary(operator: Operator, x: f64, y: f64) -> f64 {
        match operator {
            Operator::Add => x + y,
            Operator::Subtract => x - y,
            Operator::Multiply => x * y,
            Operator::Divide => x / y,
            Operator::Power => libm::pow(x, y),
            Operator::Min => min(x, y),
            Operator::Max => max(x, y),
            Operator::Atan2 => libm::atan2(x, y),
        }
    }

    fn power_constant(x: f64, exponent: f64) -> f64 {
        PowerPlan::new(exponent).apply(&mut Strict, x)
    }
}

/// The strict level's arithmetic for power plans.
struct Strict;

impl PowerOps for Strict {
    type Value = f64;
    fn one(&mut self) -> f64 {
        1.0
    }
    fn multiply(&mut self, x: f64, y: f64) -> f64 {
        x * y
    }
    fn reciprocal(&mut self, x: f64) -> f64 {
        1.0 / x
    }
    fn sqrt(&mut self, x: f64) -> f64 {
        x.sqrt()
    }
    fn pow(&mut self, x: f64, c: f64) -> f64 {
        libm::pow(x, c)
    }
}

/// Derivative parts of a dual number.
pub trait DualParts {
    /// Whether all derivative parts are zero.
    fn is_constant(&self) -> bool;
}

impl DualParts for HyperDual64 {
    fn is_constant(&self) -> bool {
        self.eps1 == 0.0 && self.eps2 == 0.0 && self.eps1eps2 == 0.0
    }
}

impl DualParts for Dual2_64 {
    fn is_constant(&self) -> bool {
        self.v1 == 0.0 && self.v2 == 0.0
    }
}

macro_rules! dual_number {
    ($type:ty) => {
        impl Number for $type {
            fn constant(value: f64) -> Self {
                <$type>::from_re(value)
            }

            fn value(&self) -> f64 {
                self.re
            }

            fn unary(function: Function, x: Self) -> Self {
                match function {
                    Function::Negate => -x,
                    Function::Abs => x * sign(x.re),
                    Function::Sign => Self::from_re(sign(x.re)),
                    Function::Sqrt => x.sqrt(),
                    Function::Exp => x.exp(),
                    Function::Ln => x.ln(),
                    Function::Log1p => x.ln_1p(),
                    Function::Expm1 => x.exp_m1(),
                    Function::Log1pmx => {
                        let mut difference = x.ln_1p() - x;
                        difference.re = log1pmx(x.re);
                        difference
                    }
                    Function::Sin => x.sin(),
                    Function::Cos => x.cos(),
                    Function::Tan => x.tan(),
                    Function::Asin => x.asin(),
                    Function::Acos => x.acos(),
                    Function::Atan => x.atan(),
                    Function::Sinh => x.sinh(),
                    Function::Cosh => x.cosh(),
                    // As sinh/cosh both overflow.
                    Function::Tanh if x.re.abs() > 20.0 => {
                        let side = sign(x.re);
                        let small = (x * (-2.0 * side)).exp();
                        (small * -2.0 / (small + 1.0) + 1.0) * side
                    }
                    Function::Tanh => x.tanh(),
                    Function::Erf => {
                        let (at, change) = (x.re, x - x.re);
                        let slope = FRAC_2_SQRT_PI * libm::exp(-at * at);
                        let mut value = change * (change * (-at) + 1.0) * slope;
                        value.re = libm::erf(at);
                        value
                    }
                }
            }

            fn binary(operator: Operator, x: Self, y: Self) -> Self {
                match operator {
                    Operator::Add => x + y,
                    Operator::Subtract => x - y,
                    Operator::Multiply => x * y,
                    Operator::Divide => {
                        // x*(1/y) would round the value twice.
                        let mut quotient = x / y;
                        quotient.re = x.re / y.re;
                        quotient
                    }
                    // exp(y ln x) would fail for x <= 0 although the exponent does not vary.
                    Operator::Power if y.is_constant() => Self::power_constant(x, y.re),
                    Operator::Power => {
                        let mut power = x.powd(y);
                        power.re = libm::pow(x.re, y.re);
                        power
                    }
                    // Of equal ones the larger is the one that varies.
                    Operator::Min | Operator::Max if x.re.to_bits() == y.re.to_bits() => {
                        if x.is_constant() == (operator == Operator::Min) { x } else { y }
                    }
                    Operator::Min if min(x.re, y.re).to_bits() == x.re.to_bits() => x,
                    Operator::Max if max(x.re, y.re).to_bits() == x.re.to_bits() => x,
                    Operator::Min | Operator::Max if x.re.is_nan() => x,
                    Operator::Min | Operator::Max => y,
                    Operator::Atan2 => {
                        let (p, q) = (x - x.re, y - y.re);
                        let size = libm::hypot(x.re, y.re);
                        let (sine, cosine) = (x.re / size, y.re / size);
                        // About the point, along the circle and along the radius.
                        let along = (p * cosine - q * sine) / size;
                        let out = (q * cosine + p * sine) / size;
                        let mut angle = along - along * out;
                        angle.re = libm::atan2(x.re, y.re);
                        angle
                    }
                }
            }

            fn power_constant(x: Self, exponent: f64) -> Self {
                let mut power = if exponent == exponent.trunc() && exponent.abs() <= 1024.0 {
                    x.powi(exponent as i32)
                } else {
                    x.powf(exponent)
                };
                // As x^(n-3)*x*x*x it is rounded four times, and `x^n - 1` magnifies that.
                power.re = libm::pow(x.re, exponent);
                power
            }
        }
    };
}

dual_number!(HyperDual64);
dual_number!(Dual2_64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hyperbolic_tangent_of_a_dual_number_does_not_overflow() {
        for (x, slope) in [(25.0, 4.0 * libm::exp(-50.0)), (800.0, 0.0), (-1e9, 0.0)] {
            let tanh = HyperDual64::unary(Function::Tanh, HyperDual64::new(x, 1.0, 1.0, 0.0));
            assert_eq!(tanh.re, libm::tanh(x));
            assert!((tanh.eps1 - slope).abs() <= 1e-14 * slope, "{x}: {tanh}");
            let second = -2.0 * tanh.re * slope;
            assert!((tanh.eps1eps2 - second).abs() <= 1e-14 * slope, "{x}: {tanh}");
        }
    }

    #[test]
    fn dual_numbers_know_the_derivatives_of_two_variables() {
        // d/dt and d/ds of erf(x) and of atan2(y, x), with x = t and y = s.
        let (x, y) = (0.7, -1.3);
        let erf = HyperDual64::unary(Function::Erf, HyperDual64::new(x, 1.0, 1.0, 0.0));
        let slope = FRAC_2_SQRT_PI * libm::exp(-x * x);
        let near = |found: f64, expected: f64| (found - expected).abs() <= 1e-15 * expected.abs();
        assert_eq!(erf.re, libm::erf(x));
        assert!(near(erf.eps1, slope) && near(erf.eps1eps2, -2.0 * x * slope), "{erf}");
        let [t, s] = [HyperDual64::new(x, 1.0, 0.0, 0.0), HyperDual64::new(y, 0.0, 1.0, 0.0)];
        let angle = HyperDual64::binary(Operator::Atan2, s, t);
        let square = x * x + y * y;
        assert_eq!(angle.re, libm::atan2(y, x));
        assert!(near(angle.eps1, -y / square) && near(angle.eps2, x / square), "{angle}");
        let mixed = (y * y - x * x) / (square * square);
        assert!((angle.eps1eps2 - mixed).abs() <= 1e-15, "{angle}");
    }

    /// The witness must not be less accurate than what it is a witness for.
    #[test]
    fn values_of_dual_powers_are_rounded_once() {
        for x in [0.9, 1.0 - 1e-9, 1.0 + 3e-7, 2.7, -1.001] {
            for n in [-2.0, -1.0, 3.0, 4.0, 30.0] {
                let value = libm::pow(x, n);
                let hyper = HyperDual64::power_constant(HyperDual64::new(x, 1.0, 1.0, 0.0), n);
                let second = Dual2_64::power_constant(Dual2_64::new(x, 1.0, 0.0), n);
                assert_eq!((hyper.re, second.re), (value, value), "{x}^{n}");
                let varied = HyperDual64::new(x.abs(), 1.0, 1.0, 0.0);
                let exponent = HyperDual64::new(n, 1.0, 1.0, 0.0);
                let power = HyperDual64::binary(Operator::Power, varied, exponent);
                assert_eq!(power.re, libm::pow(x.abs(), n), "{x}^{n}");
            }
        }
    }
}
