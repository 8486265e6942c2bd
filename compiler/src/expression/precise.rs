//! Numbers of any precision with two derivatives: the truth that rounding errors are measured against.
//!
//! The derivatives follow the chain rule number by number, independent of the symbolic ones.

use super::number::Number;
use super::real::Real;
use super::{Function, Operator};

/// A value with its first and second derivative with respect to the measure, in `BITS` binary digits;
/// nothing where one of them is not a finite number, or lies beyond 2^(2^20) or below its reciprocal.
#[derive(Clone, Debug)]
pub struct Precise<const BITS: usize> {
    parts: Option<[Real<BITS>; 3]>,
    doubtful: bool,
}

impl<const BITS: usize> Precise<BITS> {
    /// The measure itself: its derivative is 1.
    pub fn variable(value: f64) -> Self {
        Self::at(Real::from(value), 1)
    }

    /// `value + more`, added exactly, on a line with this slope.
    pub fn line(value: f64, slope: f64, more: f64) -> Self {
        let [value, slope, more] = [value, slope, more].map(Real::from);
        Self::new([value + more, slope, Real::from(0)], false)
    }

    /// A constant of all digits.
    pub(crate) fn exactly(value: Real<BITS>) -> Self {
        Self::at(value, 0)
    }

    /// A value with this whole number as its first derivative.
    pub(crate) fn at(value: Real<BITS>, slope: i32) -> Self {
        Self::new([value, Real::from(slope), Real::from(0)], false)
    }

    /// No number.
    pub(crate) fn nothing() -> Self {
        Precise { parts: None, doubtful: false }
    }

    fn new(parts: [Real<BITS>; 3], doubtful: bool) -> Self {
        Self::if_any(Some(parts), doubtful)
    }

    fn if_any(parts: Option<[Real<BITS>; 3]>, doubtful: bool) -> Self {
        Precise { parts: parts.filter(|parts| parts.iter().all(Real::is_number)), doubtful }
    }

    /// Whether a difference on the way had fewer than 128 digits left: it may be none.
    pub fn doubtful(&self) -> bool {
        self.doubtful
    }

    /// Value, first and second derivative, rounded once.
    pub fn rounded(&self) -> [f64; 3] {
        match &self.parts {
            Some(parts) => parts.each_ref().map(Real::to_f64),
            None => [f64::NAN; 3],
        }
    }

    /// Value, first and second derivative.
    pub fn parts(&self) -> Option<&[Real<BITS>; 3]> {
        self.parts.as_ref()
    }

    /// `f(x)` from `f`, `f'` and `f''` at the value.
    fn chain(&self, f: impl FnOnce(&Real<BITS>) -> [Real<BITS>; 3]) -> Self {
        let parts = self.parts.as_ref().map(|[x, dx, ddx]| {
            let [f, df, ddf] = f(x);
            [f, &df * dx, ddf * (dx * dx) + df * ddx]
        });
        Self::if_any(parts, self.doubtful)
    }

    /// `x + y`
    fn sum(x: Self, y: Self) -> Self {
        let mut doubtful = x.doubtful || y.doubtful;
        let parts = x.parts.zip(y.parts).map(|([x, dx, ddx], [y, dy, ddy])| {
            let sum = &x + y;
            doubtful |= Self::lost(&sum, &x);
            [sum, dx + dy, ddx + ddy]
        });
        Self::if_any(parts, doubtful)
    }

    /// Whether a sum is so much smaller than a term that few digits are left of it.
    fn lost(sum: &Real<BITS>, term: &Real<BITS>) -> bool {
        !term.is_zero() && sum.size().shifted(BITS as isize - 128) < term.size()
    }

    fn reciprocal(&self) -> Self {
        self.chain(|x| {
            let r = Real::from(1) / x.only_if(!x.is_zero());
            let square = &r * &r;
            let second = Real::from(2) * &square * &r;
            [r, -square, second]
        })
    }

    fn times(x: &Self, y: &Self) -> Self {
        let parts = x.parts.as_ref().zip(y.parts.as_ref()).map(|([x, dx, ddx], [y, dy, ddy])| {
            [x * y, dx * y + x * dy, ddx * y + Real::from(2) * dx * dy + x * ddy]
        });
        Self::if_any(parts, x.doubtful || y.doubtful)
    }

    /// The angle of the point `(x, y)`.
    fn angle(y: &Self, x: &Self) -> Self {
        let parts = y.parts.as_ref().zip(x.parts.as_ref()).map(|([y, dy, ddy], [x, dx, ddx])| {
            let square = x * x + y * y;
            let square = square.only_if(!square.is_zero());
            // angle' = (x y' - y x')/(x^2 + y^2), and the derivative of that quotient.
            let first = (x * dy - y * dx) / &square;
            let change = Real::from(2) * (x * dx + y * dy);
            let second = (x * ddy - y * ddx - &first * change) / &square;
            [Real::angle(y, x), first, second]
        });
        Self::if_any(parts, y.doubtful || x.doubtful)
    }

    /// `x^c` for a known number `c`.
    fn raised(&self, c: &Real<BITS>) -> Self {
        let one = Real::from(1);
        self.chain(|x| {
            let (value, lower) = (x.power(c), c - &one);
            if !x.is_zero() {
                let first = c * &value / x;
                let second = &lower * &first / x;
                return [value, first, second];
            }
            // Where a factor is 0 its power is not asked for: 0^-1 has no value.
            let times = |factor: Real<BITS>, exponent: &Real<BITS>| {
                if factor.is_zero() { factor } else { factor * x.power(exponent) }
            };
            let first = times(c.clone(), &lower);
            let second = times(c * &lower, &(&lower - &one));
            [value, first, second]
        })
    }
}

impl<const BITS: usize> Number for Precise<BITS> {
    fn constant(value: f64) -> Self {
        Self::at(Real::from(value), 0)
    }

    fn value(&self) -> f64 {
        self.rounded()[0]
    }

    fn unary(function: Function, x: Self) -> Self {
        let one = || Real::from(1);
        let two = || Real::from(2);
        match function {
            Function::Negate => {
                let parts = x.parts.as_ref().map(|parts| parts.each_ref().map(|part| -part));
                Self::if_any(parts, x.doubtful)
            }
            Function::Abs if x.value() < 0.0 => Self::unary(Function::Negate, x),
            Function::Abs => x,
            Function::Sign => Self::constant(super::number::sign(x.value())),
            Function::Sqrt => x.chain(|x| {
                let root = x.only_if(x.is_positive()).sqrt();
                let first = one() / (two() * &root);
                let second = -(&first / (two() * x));
                [root, first, second]
            }),
            Function::Exp => x.chain(|x| {
                let value = x.exp();
                [value.clone(), value.clone(), value]
            }),
            Function::Expm1 => x.chain(|x| {
                let slope = x.exp();
                [x.exp_m1(), slope.clone(), slope]
            }),
            Function::Ln => x.chain(|x| {
                let value = x.ln();
                let first = one() / x;
                let second = -(&first * &first);
                [value, first, second]
            }),
            Function::Log1p => x.chain(|x| {
                let first = one() / (one() + x);
                let second = -(&first * &first);
                [x.ln_1p(), first, second]
            }),
            Function::Log1pmx => {
                Self::binary(Operator::Subtract, Self::unary(Function::Log1p, x.clone()), x)
            }
            Function::Sin => x.chain(|x| {
                let (sin, cos) = (x.sin(), x.cos());
                [sin.clone(), cos, -sin]
            }),
            Function::Cos => x.chain(|x| {
                let (sin, cos) = (x.sin(), x.cos());
                [cos.clone(), -sin, -cos]
            }),
            Function::Tan => x.chain(|x| {
                let tan = x.tan();
                let first = one() + &tan * &tan;
                let second = two() * &tan * &first;
                [tan, first, second]
            }),
            Function::Asin | Function::Acos => x.chain(|x| {
                let inside = one() - x * x;
                let inside = inside.only_if(inside.is_positive());
                let first = one() / inside.sqrt();
                let second = x * &first / inside;
                match function {
                    Function::Asin => [x.asin(), first, second],
                    _ => [x.acos(), -first, -second],
                }
            }),
            Function::Atan => x.chain(|x| {
                let first = one() / (one() + x * x);
                let second = -(two() * x * &first * &first);
                [x.atan(), first, second]
            }),
            Function::Sinh => x.chain(|x| {
                let (sinh, cosh) = (x.sinh(), x.cosh());
                [sinh.clone(), cosh, sinh]
            }),
            Function::Cosh => x.chain(|x| {
                let (sinh, cosh) = (x.sinh(), x.cosh());
                [cosh.clone(), sinh, cosh]
            }),
            Function::Tanh => x.chain(|x| {
                let tanh = x.tanh();
                let first = one() - &tanh * &tanh;
                let second = -(two() * &tanh * &first);
                [tanh, first, second]
            }),
            Function::Erf => x.chain(|x| {
                let first = x.error_slope();
                let second = -(two() * x * &first);
                [x.error_function(), first, second]
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
                Some([c, dc, ddc]) if dc.is_zero() && ddc.is_zero() => x.raised(c),
                _ => {
                    let exponent = Self::times(&Self::unary(Function::Ln, x), &y);
                    Self::unary(Function::Exp, exponent)
                }
            },
            Operator::Min | Operator::Max => {
                let first = match (&x.parts, &y.parts) {
                    // Of equal ones the larger is the one that varies.
                    (Some([x, dx, ddx]), Some([y, ..])) if x == y => {
                        let nothing = Real::from(0);
                        (*dx == nothing && *ddx == nothing) == (operator == Operator::Min)
                    }
                    (Some([x, ..]), Some([y, ..])) => (x < y) == (operator == Operator::Min),
                    _ => return Self::nothing(),
                };
                if first { x } else { y }
            }
            Operator::Atan2 => Self::angle(&x, &y),
        }
    }

    fn power_constant(x: Self, exponent: f64) -> Self {
        x.raised(&Real::from(exponent))
    }
}
