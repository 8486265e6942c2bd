//! Numbers of any precision with two derivatives: the truth that rounding errors are measured against.
//!
//! The derivatives follow the chain rule number by number, independent of the symbolic ones.

use dashu_float::FBig;
use dashu_float::round::mode::HalfEven;

use super::number::Number;
use super::{Function, Operator};

pub(crate) type Float = FBig<HalfEven, 2>;

/// Beyond `exp` of this the numbers here end; those of 64 bits end at 709.
const LARGEST_EXPONENT: f64 = 1e5;

/// A value with its first and second derivative with respect to the measure, in `BITS` binary digits;
/// nothing where one of them is not a finite number.
#[derive(Clone, Debug)]
pub struct Precise<const BITS: usize> {
    parts: Option<[Float; 3]>,
    doubtful: bool,
}

impl<const BITS: usize> Precise<BITS> {
    /// The measure itself: its derivative is 1.
    pub fn variable(value: f64) -> Self {
        Self::new(float::<BITS>(value).map(|x| [x, exact::<BITS>(1), exact::<BITS>(0)]), false)
    }

    /// `value + more`, added exactly, on a line with this slope.
    pub fn line(value: f64, slope: f64, more: f64) -> Self {
        let parts = [float::<BITS>(value), float::<BITS>(slope), float::<BITS>(more)];
        let [Some(value), Some(slope), Some(more)] = parts else { return Self::new(None, false) };
        Self::new(Some([value + more, slope, exact::<BITS>(0)]), false)
    }

    /// A constant of all digits.
    pub(crate) fn exactly(value: Float) -> Self {
        Self::at(value, 0)
    }

    /// A value with this whole number as its first derivative.
    pub(crate) fn at(value: Float, slope: i32) -> Self {
        Self::new(Some([value, exact::<BITS>(slope), exact::<BITS>(0)]), false)
    }

    /// No number.
    pub(crate) fn nothing() -> Self {
        Self::new(None, false)
    }

    fn new(parts: Option<[Float; 3]>, doubtful: bool) -> Self {
        // An exact result, as ln(1) = 0, has no precision of its own, and functions of it would have none.
        let limited =
            |x: Float| if x.precision() == 0 { x.with_precision(BITS).value() } else { x };
        Precise { parts: parts.map(|parts| parts.map(limited)), doubtful }
    }

    /// Whether a difference on the way had fewer than 128 digits left: it may be none.
    pub fn doubtful(&self) -> bool {
        self.doubtful
    }

    /// Value, first and second derivative, rounded once.
    pub fn rounded(&self) -> [f64; 3] {
        match &self.parts {
            Some(parts) => parts.each_ref().map(|x| x.to_f64().value()),
            None => [f64::NAN; 3],
        }
    }

    /// Value, first and second derivative.
    pub fn parts(&self) -> Option<&[Float; 3]> {
        self.parts.as_ref()
    }

    /// `f(x)` from `f`, `f'` and `f''` at the value.
    fn chain(&self, f: impl FnOnce(&Float) -> Option<[Float; 3]>) -> Self {
        let parts = self.parts.as_ref().and_then(|[x, dx, ddx]| {
            let [f, df, ddf] = f(x)?;
            Some([f, &df * dx, &ddf * &(dx * dx) + &df * ddx])
        });
        Self::new(parts, self.doubtful)
    }

    /// `x + y`
    fn sum(x: Self, y: Self) -> Self {
        let mut doubtful = x.doubtful || y.doubtful;
        let parts = x.parts.zip(y.parts).map(|([x, dx, ddx], [y, dy, ddy])| {
            let sum = &x + y;
            doubtful |= lost::<BITS>(&sum, &x);
            [sum, dx + dy, ddx + ddy]
        });
        Self::new(parts, doubtful)
    }

    fn reciprocal(&self) -> Self {
        self.chain(|x| {
            let r = nonzero(x).map(|x| exact::<BITS>(1) / x)?;
            let square = &r * &r;
            Some([r.clone(), -square.clone(), exact::<BITS>(2) * square * r])
        })
    }

    fn times(x: &Self, y: &Self) -> Self {
        let parts = x.parts.as_ref().zip(y.parts.as_ref()).map(|([x, dx, ddx], [y, dy, ddy])| {
            [x * y, dx * y + x * dy, ddx * y + exact::<BITS>(2) * dx * dy + x * ddy]
        });
        Self::new(parts, x.doubtful || y.doubtful)
    }

    /// `x^c` for a known number `c`.
    fn raised(&self, c: &Float) -> Self {
        let one = exact::<BITS>(1);
        self.chain(|x| {
            let power = |c: &Float| power::<BITS>(x, c);
            let lower = c - &one;
            let value = power(c)?;
            if !is_zero(x) {
                let first = c * &value / x;
                let second = &lower * &first / x;
                return Some([value, first, second]);
            }
            // Where a factor is 0 its power is not asked for: 0^-1 has no value.
            let first = if is_zero(c) { exact::<BITS>(0) } else { c * power(&lower)? };
            let second = if is_zero(c) || is_zero(&lower) {
                exact::<BITS>(0)
            } else {
                c * &lower * power(&(&lower - &one))?
            };
            Some([value, first, second])
        })
    }
}

/// A 64-bit number in `BITS` digits; they hold it exactly.
fn float<const BITS: usize>(value: f64) -> Option<Float> {
    let exact = FBig::<HalfEven, 2>::try_from(value).ok().filter(|_| value.is_finite())?;
    Some(exact.with_precision(BITS).value())
}

pub(crate) fn exact<const BITS: usize>(value: i32) -> Float {
    Float::from(value).with_precision(BITS).value()
}

fn is_zero(x: &Float) -> bool {
    x.repr().significand().is_zero()
}

fn is_positive(x: &Float) -> bool {
    *x > Float::ZERO
}

fn nonzero(x: &Float) -> Option<&Float> {
    (!is_zero(x)).then_some(x)
}

/// Whether a sum is so much smaller than a term that few digits are left of it.
fn lost<const BITS: usize>(sum: &Float, term: &Float) -> bool {
    let size = |x: &Float| if *x < Float::ZERO { -x.clone() } else { x.clone() };
    !is_zero(term) && (size(sum) << (BITS as isize - 128)) < size(term)
}

fn moderate(x: &Float) -> Option<&Float> {
    (x.to_f64().value().abs() <= LARGEST_EXPONENT).then_some(x)
}

/// `x^c`, for whole `c` of any `x`, else of `x > 0`, and `0` for `x = 0`.
fn power<const BITS: usize>(x: &Float, c: &Float) -> Option<Float> {
    let whole = c.fract();
    let small = c.to_f64().value();
    if is_zero(x) {
        let zero = if is_zero(c) { 1 } else { 0 };
        return (small >= 0.0).then(|| exact::<BITS>(zero));
    }
    if is_zero(&whole) && small.abs() <= 4096.0 {
        return Some(x.powi((small as i32).into()));
    }
    if !is_positive(x) {
        if !is_zero(&whole) {
            return None;
        }
        let size = power::<BITS>(&-x.clone(), c)?;
        return Some(if small % 2.0 == 0.0 { size } else { -size });
    }
    let exponent = c * x.ln();
    moderate(&exponent).map(Float::exp)
}

impl<const BITS: usize> Number for Precise<BITS> {
    fn constant(value: f64) -> Self {
        Self::new(float::<BITS>(value).map(|x| [x, exact::<BITS>(0), exact::<BITS>(0)]), false)
    }

    fn value(&self) -> f64 {
        self.rounded()[0]
    }

    fn unary(function: Function, x: Self) -> Self {
        let one = || exact::<BITS>(1);
        let two = || exact::<BITS>(2);
        let in_unit = |x: &Float| *x > -one() && *x < one();
        match function {
            Function::Negate => Self::new(x.parts.map(|parts| parts.map(|part| -part)), x.doubtful),
            Function::Abs if x.value() < 0.0 => Self::unary(Function::Negate, x),
            Function::Abs => x,
            Function::Sign => Self::constant(super::number::sign(x.value())),
            Function::Sqrt => x.chain(|x| {
                if is_zero(x) {
                    return None;
                }
                let root = is_positive(x).then(|| x.sqrt())?;
                let first = one() / (two() * &root);
                let second = -(&first / (two() * x));
                Some([root, first, second])
            }),
            Function::Exp => x.chain(|x| {
                let value = moderate(x)?.exp();
                Some([value.clone(), value.clone(), value])
            }),
            Function::Expm1 => x.chain(|x| {
                let slope = moderate(x)?.exp();
                Some([x.exp_m1(), slope.clone(), slope])
            }),
            Function::Ln => x.chain(|x| {
                let value = is_positive(x).then(|| x.ln())?;
                let first = one() / x;
                Some([value, first.clone(), -(&first * &first)])
            }),
            Function::Log1p | Function::Log1pmx => {
                let value = x.chain(|x| {
                    let sum = one() + x;
                    is_positive(&sum).then_some(())?;
                    let first = one() / &sum;
                    Some([x.ln_1p(), first.clone(), -(&first * &first)])
                });
                match function {
                    Function::Log1p => value,
                    _ => Self::binary(Operator::Subtract, value, x),
                }
            }
            Function::Sin => x.chain(|x| {
                let (sin, cos) = (moderate(x)?.sin(), x.cos());
                Some([sin.clone(), cos, -sin])
            }),
            Function::Cos => x.chain(|x| {
                let (sin, cos) = (moderate(x)?.sin(), x.cos());
                Some([cos.clone(), -sin, -cos])
            }),
            Function::Tan => x.chain(|x| {
                let tan = moderate(x)?.tan();
                let first = one() + &tan * &tan;
                Some([tan.clone(), first.clone(), two() * tan * first])
            }),
            Function::Asin | Function::Acos => x.chain(|x| {
                let inside = in_unit(x).then(|| one() - x * x)?;
                let first = one() / inside.sqrt();
                let second = x * &first / inside;
                Some(match function {
                    Function::Asin => [x.asin(), first, second],
                    _ => [x.acos(), -first, -second],
                })
            }),
            Function::Atan => x.chain(|x| {
                let first = one() / (one() + x * x);
                let second = -(two() * x * &first * &first);
                Some([x.atan(), first, second])
            }),
            Function::Sinh => x.chain(|x| {
                let (sinh, cosh) = (moderate(x)?.sinh(), x.cosh());
                Some([sinh.clone(), cosh, sinh])
            }),
            Function::Cosh => x.chain(|x| {
                let (sinh, cosh) = (moderate(x)?.sinh(), x.cosh());
                Some([cosh.clone(), sinh, cosh])
            }),
            Function::Tanh => x.chain(|x| {
                let tanh = moderate(x)?.tanh();
                let first = one() - &tanh * &tanh;
                let second = -(two() * &tanh * &first);
                Some([tanh, first, second])
            }),
        }
    }

    fn binary(operator: Operator, x: Self, y: Self) -> Self {
        match operator {
            Operator::Add => Self::sum(x, y),
            Operator::Subtract => Self::sum(x, Self::unary(Function::Negate, y)),
            Operator::Multiply => Self::times(&x, &y),
            Operator::Divide => Self::times(&x, &y.reciprocal()),
            Operator::Power => match &y.parts {
                Some([c, dc, ddc]) if is_zero(dc) && is_zero(ddc) => x.raised(c),
                _ => {
                    let exponent = Self::times(&Self::unary(Function::Ln, x), &y);
                    Self::unary(Function::Exp, exponent)
                }
            },
            Operator::Min | Operator::Max => {
                let first = match (&x.parts, &y.parts) {
                    (Some([x, ..]), Some([y, ..])) => (x <= y) == (operator == Operator::Min),
                    _ => return Self::new(None, false),
                };
                if first { x } else { y }
            }
        }
    }

    fn power_constant(x: Self, exponent: f64) -> Self {
        match float::<BITS>(exponent) {
            Some(c) => x.raised(&c),
            None => Self::new(None, false),
        }
    }
}
