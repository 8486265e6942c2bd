//! Numbers of two `f64`: the digits of thin triangles and flat tetrahedra.
//!
//! `xi1 x xi2` of two nearly parallel vectors is a difference of nearly equal products; in twice the
//! digits nothing is lost that matters (Dekker 1971; Joldes, Muller, Popescu 2017, algorithms 6, 12
//! and 18). The fused operation is exact on every machine, in hardware or in software.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::Scalar;

/// The unevaluated sum of a number and its rounding error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Double {
    high: f64,
    low: f64,
}

impl Double {
    /// This number and nothing behind it.
    pub fn new(x: f64) -> Double {
        Double { high: x, low: 0.0 }
    }

    /// The nearest `f64`.
    pub fn rounded(self) -> f64 {
        self.high
    }

    /// `high + low` in its canonical form, for `abs(high) >= abs(low)`.
    fn canonical(high: f64, low: f64) -> Double {
        let sum = high + low;
        Double { high: sum, low: low - (sum - high) }
    }
}

/// A sum and its exact error.
fn two_sum(x: f64, y: f64) -> (f64, f64) {
    let sum = x + y;
    let rest = sum - x;
    (sum, (x - (sum - rest)) + (y - rest))
}

/// A product and its exact error.
fn two_product(x: f64, y: f64) -> (f64, f64) {
    let product = x * y;
    (product, x.mul_add(y, -product))
}

impl Add for Double {
    type Output = Double;
    fn add(self, other: Double) -> Double {
        let (high, error) = two_sum(self.high, other.high);
        let (low, lowest) = two_sum(self.low, other.low);
        let first = Double::canonical(high, error + low);
        Double::canonical(first.high, first.low + lowest)
    }
}

impl Neg for Double {
    type Output = Double;
    fn neg(self) -> Double {
        Double { high: -self.high, low: -self.low }
    }
}

impl Sub for Double {
    type Output = Double;
    fn sub(self, other: Double) -> Double {
        self + -other
    }
}

impl Mul for Double {
    type Output = Double;
    fn mul(self, other: Double) -> Double {
        let (high, error) = two_product(self.high, other.high);
        let low = self.high.mul_add(other.low, self.low * other.high);
        Double::canonical(high, error + low)
    }
}

impl Div for Double {
    type Output = Double;
    fn div(self, other: Double) -> Double {
        let first = self.high / other.high;
        let rest = self - other * Double::new(first);
        Double::canonical(first, rest.high / other.high)
    }
}

impl Scalar for Double {
    fn alike(self, x: f64) -> Double {
        Double::new(x)
    }

    fn where_equal(self, other: Double, yes: Double, no: Double) -> Double {
        if self == other { yes } else { no }
    }

    fn sqrt(self) -> Double {
        let root = self.high.sqrt();
        if root == 0.0 || !root.is_finite() {
            return Double::new(root);
        }
        let (square, error) = two_product(root, root);
        let rest = self - Double::canonical(square, error);
        Double::canonical(root, rest.high / (2.0 * root))
    }

    fn sign(self) -> Double {
        Double::new(1f64.copysign(self.high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(x: f64) -> Double {
        Double::new(x)
    }

    #[test]
    fn what_cancels_is_still_there() {
        let tiny = libm::ldexp(1.0, -80);
        assert_eq!((of(1.0) + of(tiny) - of(1.0)).rounded(), tiny);
        let x = of(1.0) + of(tiny);
        assert_eq!((x * x - of(1.0)).rounded(), 2.0 * tiny);
        let third = of(1.0) / of(3.0);
        assert!((third * of(3.0) - of(1.0)).rounded().abs() <= libm::ldexp(1.0, -104));
        let root = of(2.0).sqrt();
        assert!((root * root - of(2.0)).rounded().abs() <= libm::ldexp(1.0, -102));
    }

    #[test]
    fn what_has_no_digits_stays_what_it_is() {
        assert_eq!(of(0.0).sqrt().rounded(), 0.0);
        assert!(of(-1.0).sqrt().rounded().is_nan());
        assert_eq!((-of(0.0)).sign().rounded(), -1.0);
    }
}
