//! Numbers in 256 bits that know what they came from, so that what cancels is seen to be 0.

use crate::expression::Function;
use crate::expression::real::Real;

/// Binary digits of a number.
const BITS: usize = 256;

/// A number that every operation rounds to 256 bits.
pub(crate) type Number = Real<BITS>;

/// What is left of terms that cancel is below this power of two of the largest of them, if nothing is.
const NOTHING: i64 = -180;

/// A number, and as a power of two the size of the largest terms it came from.
#[derive(Clone, Debug)]
pub(crate) struct Exact {
    pub(crate) value: Number,
    pub(crate) size: i64,
}

impl From<f64> for Exact {
    fn from(value: f64) -> Exact {
        Exact::new(Number::from(value))
    }
}

impl Exact {
    /// A number that is known to all its digits.
    pub(crate) fn new(value: Number) -> Exact {
        Exact::with_error(value, i64::MIN)
    }

    /// A number whose error may be a rounding of `2^size`.
    pub(crate) fn with_error(value: Number, size: i64) -> Exact {
        let own = value.magnitude().unwrap_or(i64::MIN);
        Exact { value, size: own.max(size) }
    }

    /// Whether it is 0, or no more than rounding left of terms that cancelled.
    pub(crate) fn is_nothing(&self) -> bool {
        self.value.is_number()
            && self.value.magnitude().is_none_or(|own| own < self.size.saturating_add(NOTHING))
    }

    pub(crate) fn negated(&self) -> Exact {
        Exact { value: -&self.value, size: self.size }
    }

    pub(crate) fn plus(&self, other: &Exact) -> Exact {
        let (value, size) = (&self.value + &other.value, self.size.max(other.size));
        let sum = Exact { value, size };
        if sum.is_nothing() { Exact { value: Number::from(0), size } } else { sum }
    }

    pub(crate) fn times(&self, other: &Exact) -> Exact {
        let size = self.size.saturating_add(other.size);
        Exact { value: &self.value * &other.value, size }
    }

    /// No number where it is 0.
    pub(crate) fn inverse(&self) -> Exact {
        let own = self.value.magnitude().unwrap_or(0);
        let value = Number::from(1) / self.value.only_if(!self.value.is_zero());
        let size = self.size.saturating_sub(own.saturating_mul(2)).max(own.saturating_neg());
        Exact { value, size }
    }

    /// For `p` whole, or a number above 0.
    pub(crate) fn power(&self, p: &Number) -> Exact {
        let value = self.value.power(p);
        let own = value.magnitude().unwrap_or(0);
        let lost = self.size.saturating_sub(self.value.magnitude().unwrap_or(0));
        Exact { value, size: own.saturating_add(lost) }
    }

    /// A function of it; no number where it has none.
    pub(crate) fn function(&self, function: Function) -> Exact {
        let x = &self.value;
        let one = || Number::from(1);
        let value = match function {
            Function::Negate => return self.negated(),
            Function::Abs => x.size(),
            Function::Sqrt => return self.power(&Number::from(0.5)),
            Function::Exp => x.exp(),
            Function::Expm1 => x.exp_m1(),
            Function::Ln => x.ln(),
            Function::Log1p => x.ln_1p(),
            Function::Log1pmx => x.ln_1p() - x,
            Function::Sin => x.sin(),
            Function::Cos => x.cos(),
            Function::Tan => x.tan(),
            Function::Sinh => x.sinh(),
            Function::Cosh => x.cosh(),
            Function::Tanh => x.tanh(),
            Function::Erf => x.error_function(),
            Function::Atan => x.atan(),
            Function::Asin => x.asin(),
            Function::Acos => x.acos(),
            Function::Sign => {
                Number::from(i32::from(x.is_positive()) - i32::from((-x).is_positive()))
            }
        };
        // An error of the argument moves the value by the slope, which is below these.
        let slope = match function {
            Function::Exp | Function::Expm1 => x.exp(),
            Function::Sinh | Function::Cosh => x.size().exp(),
            Function::Ln => one() / x.only_if(!x.is_zero()),
            Function::Log1p | Function::Log1pmx => one() / (one() + x),
            Function::Tan => one() + &value * &value,
            Function::Asin | Function::Acos => one() / (one() - x * x).size().sqrt(),
            Function::Erf => x.error_slope(),
            _ => one(),
        };
        if x.is_zero() {
            return Exact::new(value);
        }
        let error = self.size.saturating_add(slope.magnitude().unwrap_or(0));
        Exact::with_error(value, error)
    }
}
