//! Numbers with parts that are not real, whose parts after an evaluation are derivatives.
//!
//! They know what energies of powers, logarithms and exponentials need, for positive measures; any
//! other function of them is not a number. What is small stays in a part of its own and is never
//! subtracted from what is large: logarithms come through atan and atanh, not through the logarithms
//! of `x + h` and `x - h`.

use std::ops::{Add, Div, Mul, Sub};

use piola_compiler::expression::number::Number;
use piola_compiler::expression::{Function, Operator};

/// What a complex number can be made of.
pub(crate) trait Part:
    Number + Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The inverse tangent near 0.
    fn atan(self) -> Self;
    /// Cosine and sine.
    fn cos_sin(self) -> [Self; 2];
}

impl Part for f64 {
    fn atan(self) -> f64 {
        libm::atan(self)
    }

    fn cos_sin(self) -> [f64; 2] {
        [libm::cos(self), libm::sin(self)]
    }
}

/// `re + im*i` with `i^2 = -1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Complex<P> {
    /// The real part.
    pub(crate) re: P,
    /// What stands before the unit.
    pub(crate) im: P,
}

/// `re.re + re.im*i1 + im.re*i2 + im.im*i1*i2` with two units of square -1.
pub(crate) type HyperComplex = Complex<Complex<f64>>;

impl Part for Complex<f64> {
    fn atan(self) -> Self {
        let Complex { re, im } = self;
        let size = re * re + im * im;
        Complex {
            re: libm::atan2(2.0 * re, 1.0 - size) / 2.0,
            im: libm::atanh(2.0 * im / (1.0 + size)) / 2.0,
        }
    }

    fn cos_sin(self) -> [Self; 2] {
        let [cos, sin] = self.re.cos_sin();
        let (cosh, sinh) = (libm::cosh(self.im), libm::sinh(self.im));
        [Complex { re: cos * cosh, im: -sin * sinh }, Complex { re: sin * cosh, im: cos * sinh }]
    }
}

impl<P: Part> Add for Complex<P> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Complex { re: self.re + other.re, im: self.im + other.im }
    }
}

impl<P: Part> Sub for Complex<P> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Complex { re: self.re - other.re, im: self.im - other.im }
    }
}

impl<P: Part> Mul for Complex<P> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Complex {
            re: self.re * other.re - self.im * other.im,
            im: self.re * other.im + self.im * other.re,
        }
    }
}

impl<P: Part> Div for Complex<P> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let size = other.re * other.re + other.im * other.im;
        Complex {
            re: (self.re * other.re + self.im * other.im) / size,
            im: (self.im * other.re - self.re * other.im) / size,
        }
    }
}

impl<P: Part> Number for Complex<P> {
    fn constant(value: f64) -> Self {
        Complex { re: P::constant(value), im: P::constant(0.0) }
    }

    fn value(&self) -> f64 {
        self.re.value()
    }

    fn unary(function: Function, x: Self) -> Self {
        match function {
            Function::Negate => Self::constant(0.0) - x,
            Function::Ln if x.value() > 0.0 => Complex {
                re: P::constant(0.5) * P::unary(Function::Ln, x.re * x.re + x.im * x.im),
                im: (x.im / x.re).atan(),
            },
            Function::Exp => {
                let size = P::unary(Function::Exp, x.re);
                let [cos, sin] = x.im.cos_sin();
                Complex { re: size * cos, im: size * sin }
            }
            Function::Sqrt => Self::power_constant(x, 0.5),
            _ => Complex { re: P::constant(f64::NAN), im: P::constant(f64::NAN) },
        }
    }

    fn binary(operator: Operator, x: Self, y: Self) -> Self {
        match operator {
            Operator::Add => x + y,
            Operator::Subtract => x - y,
            Operator::Multiply => x * y,
            Operator::Divide => x / y,
            Operator::Power => Self::unary(Function::Exp, y * Self::unary(Function::Ln, x)),
            _ => Complex { re: P::constant(f64::NAN), im: P::constant(f64::NAN) },
        }
    }

    fn power_constant(x: Self, exponent: f64) -> Self {
        Self::binary(Operator::Power, x, Self::constant(exponent))
    }
}

/// `re + un*e` with `e^2 = +1`, also called split-complex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Double {
    /// The real part.
    pub(crate) re: f64,
    /// What stands before the unit.
    pub(crate) un: f64,
}

impl Number for Double {
    fn constant(value: f64) -> Self {
        Double { re: value, un: 0.0 }
    }

    fn value(&self) -> f64 {
        self.re
    }

    fn unary(function: Function, x: Self) -> Self {
        match function {
            Function::Negate => Double { re: -x.re, un: -x.un },
            Function::Ln if x.re > 0.0 => Double {
                re: libm::log(x.re * x.re - x.un * x.un) / 2.0,
                un: libm::atanh(x.un / x.re),
            },
            Function::Exp => {
                let size = libm::exp(x.re);
                Double { re: size * libm::cosh(x.un), un: size * libm::sinh(x.un) }
            }
            Function::Sqrt => Self::power_constant(x, 0.5),
            _ => Double { re: f64::NAN, un: f64::NAN },
        }
    }

    fn binary(operator: Operator, x: Self, y: Self) -> Self {
        match operator {
            Operator::Add => Double { re: x.re + y.re, un: x.un + y.un },
            Operator::Subtract => Double { re: x.re - y.re, un: x.un - y.un },
            Operator::Multiply => {
                Double { re: x.re * y.re + x.un * y.un, un: x.re * y.un + x.un * y.re }
            }
            Operator::Divide => {
                let size = y.re * y.re - y.un * y.un;
                Double {
                    re: (x.re * y.re - x.un * y.un) / size,
                    un: (x.un * y.re - x.re * y.un) / size,
                }
            }
            Operator::Power => {
                let logarithm = Self::unary(Function::Ln, x);
                Self::unary(Function::Exp, Self::binary(Operator::Multiply, y, logarithm))
            }
            _ => Double { re: f64::NAN, un: f64::NAN },
        }
    }

    fn power_constant(x: Self, exponent: f64) -> Self {
        Self::binary(Operator::Power, x, Self::constant(exponent))
    }
}
