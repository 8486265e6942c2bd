//! Real numbers of so many binary digits, whose operations never panic: what has no value is none.

use std::cell::RefCell;
use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Neg, Sub};

use dashu_float::round::mode::HalfEven;
use dashu_float::{ConstCache, Context, FBig, FpResult, Repr};

type Float = FBig<HalfEven, 2>;

/// Numbers here are 0 or lie between 2^-LARGEST and 2^LARGEST; those of 64 bits lie between 2^-1074 and
/// 2^1024. Wider ones make sums and functions slow, and in the end an exponent overflows.
const LARGEST: isize = 1 << 20;

/// Functions with `exp` of this in them end here; at 64 bits they end at 709.
const LARGEST_ARGUMENT: f64 = 1e5;

/// Whole powers up to this are products.
const LARGEST_WHOLE: f64 = 4096.0;

thread_local! {
    /// ln(2) and pi, in as many digits as were asked for.
    static CONSTANTS: RefCell<ConstCache> = const { RefCell::new(ConstCache::new()) };
}

/// A number that every operation rounds to `BITS` binary digits, or none: not real, not finite, or
/// larger or smaller than can be held.
#[derive(Clone, Debug)]
pub struct Real<const BITS: usize>(Option<Float>);

impl<const BITS: usize> Real<BITS> {
    /// No number.
    pub(crate) const NONE: Self = Real(None);

    /// The arithmetic, which rounds to `BITS` digits whatever its operands have: exact results, such as
    /// ln(1) = 0, have no precision of their own.
    const CONTEXT: Context<HalfEven> = Context::new(BITS);

    fn of(result: FpResult<Float>) -> Self {
        Self::bounded(result.ok().map(|rounded| rounded.value()))
    }

    fn bounded(value: Option<Float>) -> Self {
        Real(value.filter(|x| {
            let repr = x.repr();
            let size = || repr.exponent().saturating_add_unsigned(repr.digits()).saturating_abs();
            repr.is_finite() && (repr.significand().is_zero() || size() <= LARGEST)
        }))
    }

    pub(crate) fn is_number(&self) -> bool {
        self.0.is_some()
    }

    pub(crate) fn is_zero(&self) -> bool {
        self.0.as_ref().is_some_and(|x| x.repr().significand().is_zero())
    }

    /// The power of two just above its size; nothing for 0 and for no number.
    pub(crate) fn magnitude(&self) -> Option<i64> {
        let repr = self.0.as_ref().filter(|_| !self.is_zero())?.repr();
        Some(repr.exponent().saturating_add_unsigned(repr.digits()) as i64)
    }

    pub(crate) fn is_positive(&self) -> bool {
        *self > Real::from(0)
    }

    /// This number where a condition holds, else none.
    pub(crate) fn only_if(&self, condition: bool) -> Self {
        if condition { self.clone() } else { Self::NONE }
    }

    /// Rounded once; not a number if it is none.
    pub(crate) fn to_f64(&self) -> f64 {
        self.0.as_ref().map_or(f64::NAN, |x| x.to_f64().value())
    }

    pub(crate) fn size(&self) -> Self {
        if *self < Real::from(0) { -self } else { self.clone() }
    }

    /// `x*2^n`
    pub(crate) fn shifted(&self, n: isize) -> Self {
        Self::bounded(self.0.as_ref().map(|x| x.clone() << n))
    }

    fn unary(&self, f: impl FnOnce(&Repr<2>, &mut ConstCache) -> FpResult<Float>) -> Self {
        let Some(x) = &self.0 else { return Self::NONE };
        CONSTANTS.with_borrow_mut(|constants| Self::of(f(x.repr(), constants)))
    }

    fn binary(&self, y: &Self, f: impl FnOnce(&Repr<2>, &Repr<2>) -> FpResult<Float>) -> Self {
        match (&self.0, &y.0) {
            (Some(x), Some(y)) => Self::of(f(x.repr(), y.repr())),
            _ => Self::NONE,
        }
    }

    /// The same where functions grow like `exp`, or are periodic.
    fn moderate(&self) -> Self {
        self.only_if(self.to_f64().abs() <= LARGEST_ARGUMENT)
    }

    /// For `x >= 0`.
    pub(crate) fn sqrt(&self) -> Self {
        self.unary(|x, _| Self::CONTEXT.sqrt(x))
    }

    pub(crate) fn exp(&self) -> Self {
        self.moderate().unary(|x, constants| Self::CONTEXT.exp(x, Some(constants)))
    }

    pub(crate) fn exp_m1(&self) -> Self {
        self.moderate().unary(|x, constants| Self::CONTEXT.exp_m1(x, Some(constants)))
    }

    /// For `x > 0`.
    pub(crate) fn ln(&self) -> Self {
        let x = self.only_if(self.is_positive());
        x.unary(|x, constants| Self::CONTEXT.ln(x, Some(constants)))
    }

    /// For `x > -1`.
    pub(crate) fn ln_1p(&self) -> Self {
        let x = self.only_if(*self > Real::from(-1));
        x.unary(|x, constants| Self::CONTEXT.ln_1p(x, Some(constants)))
    }

    pub(crate) fn sin(&self) -> Self {
        self.moderate().unary(|x, constants| Self::CONTEXT.sin(x, Some(constants)))
    }

    pub(crate) fn cos(&self) -> Self {
        self.moderate().unary(|x, constants| Self::CONTEXT.cos(x, Some(constants)))
    }

    pub(crate) fn tan(&self) -> Self {
        self.moderate().unary(|x, constants| Self::CONTEXT.tan(x, Some(constants)))
    }

    pub(crate) fn asin(&self) -> Self {
        self.unary(|x, constants| Self::CONTEXT.asin(x, Some(constants)))
    }

    pub(crate) fn acos(&self) -> Self {
        self.unary(|x, constants| Self::CONTEXT.acos(x, Some(constants)))
    }

    pub(crate) fn atan(&self) -> Self {
        self.unary(|x, constants| Self::CONTEXT.atan(x, Some(constants)))
    }

    pub(crate) fn sinh(&self) -> Self {
        self.moderate().unary(|x, constants| Self::CONTEXT.sinh(x, Some(constants)))
    }

    pub(crate) fn cosh(&self) -> Self {
        self.moderate().unary(|x, constants| Self::CONTEXT.cosh(x, Some(constants)))
    }

    pub(crate) fn tanh(&self) -> Self {
        self.moderate().unary(|x, constants| Self::CONTEXT.tanh(x, Some(constants)))
    }

    /// The angle of the point `(x, y)` between -pi and pi, 0 at the origin.
    pub(crate) fn angle(y: &Self, x: &Self) -> Self {
        let zero = Real::from(0);
        let right = Real::from(1).asin();
        if x.is_zero() && y.is_zero() {
            return zero;
        }
        // What is divided by is the larger of both: no quotient overflows.
        if x.size() > y.size() {
            let angle = (y / x).atan();
            return match (x.is_positive(), *y < zero) {
                (true, _) => angle,
                (false, false) => angle + Real::from(2) * right,
                (false, true) => angle - Real::from(2) * right,
            };
        }
        let angle = (x / y).atan();
        if y.is_positive() { right - angle } else { -right - angle }
    }

    /// `2/sqrt(pi) exp(-x^2)`, the derivative of the error function.
    pub(crate) fn error_slope(&self) -> Self {
        let pi = Real::from(2) * Self::from(1).asin();
        Real::from(2) / pi.sqrt() * (-(self * self)).exp()
    }

    /// The error function, by the series `x erf'(x) sum (2 x^2)^n/(1 3 5 .. (2 n + 1))`, of which no
    /// term cancels another.
    pub(crate) fn error_function(&self) -> Self {
        let square = self * self;
        if !square.is_number() {
            return Self::NONE;
        }
        // Beyond, it is +-1 to all digits: erfc(x) < exp(-x^2).
        if square.to_f64() > BITS as f64 {
            let one = Real::from(1);
            return if self.is_positive() { one } else { -one };
        }
        let twice = Real::from(2) * &square;
        let (mut term, mut sum) = (Real::from(1), Real::from(1));
        let mut n = 1;
        while term.magnitude() >= sum.magnitude().map(|size| size - BITS as i64 - 2) {
            term = term * &twice / Real::from(2 * n + 1);
            sum = sum + &term;
            n += 1;
        }
        self * self.error_slope() * sum
    }

    /// `x^c`, for whole `c` of any `x`, else of `x > 0`; of 0 it is 1 for `c = 0`, 0 for `c > 0`.
    pub(crate) fn power(&self, c: &Self) -> Self {
        let (Some(_), Some(exponent)) = (&self.0, &c.0) else { return Self::NONE };
        let (is_whole, small) = (exponent.repr().is_int(), c.to_f64());
        if self.is_zero() {
            return Real::from(i32::from(c.is_zero())).only_if(small >= 0.0);
        }
        if is_whole && small.abs() <= LARGEST_WHOLE {
            return self.unary(|x, _| Self::CONTEXT.powi(x, (small as i32).into()));
        }
        if self.is_positive() {
            return (c * self.ln()).exp();
        }
        let size = self.size().power(c).only_if(is_whole);
        if small % 2.0 == 0.0 { size } else { -size }
    }
}

impl<const BITS: usize> From<i32> for Real<BITS> {
    fn from(value: i32) -> Self {
        Real(Some(Float::from(value)))
    }
}

/// A 64-bit number in `BITS` digits, which hold it exactly.
impl<const BITS: usize> From<f64> for Real<BITS> {
    fn from(value: f64) -> Self {
        Self::bounded(Float::try_from(value).ok())
    }
}

/// Nothing equals what is no number, and nothing is smaller or larger.
impl<const BITS: usize> PartialOrd for Real<BITS> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.0.as_ref().zip(other.0.as_ref()).map(|(x, y)| x.cmp(y))
    }
}

impl<const BITS: usize> PartialEq for Real<BITS> {
    fn eq(&self, other: &Self) -> bool {
        self.partial_cmp(other) == Some(Ordering::Equal)
    }
}

impl<const BITS: usize> Neg for &Real<BITS> {
    type Output = Real<BITS>;

    fn neg(self) -> Real<BITS> {
        Real(self.0.as_ref().map(|x| -x))
    }
}

impl<const BITS: usize> Neg for Real<BITS> {
    type Output = Real<BITS>;

    fn neg(self) -> Real<BITS> {
        -&self
    }
}

/// An operator between numbers and references to them.
macro_rules! operator {
    ($trait:ident, $name:ident) => {
        operator!($trait, $name, &Real<BITS>, &Real<BITS>);
        operator!($trait, $name, &Real<BITS>, Real<BITS>);
        operator!($trait, $name, Real<BITS>, &Real<BITS>);
        operator!($trait, $name, Real<BITS>, Real<BITS>);
    };
    ($trait:ident, $name:ident, $left:ty, $right:ty) => {
        impl<const BITS: usize> $trait<$right> for $left {
            type Output = Real<BITS>;

            fn $name(self, other: $right) -> Real<BITS> {
                self.binary(&other, |x, y| Real::<BITS>::CONTEXT.$name(x, y))
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);
