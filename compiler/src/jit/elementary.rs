//! The elementary functions of the fast level, in lanes and without a call.
//!
//! One logarithm and one exponential carry all of them: the logarithm in twice the digits, so that
//! `x^y = exp(y ln(x))` keeps its own. Errors are at most 2 units in the last place; each function says
//! where it holds, and elsewhere (zeros, infinities, subnormal numbers, what is not a number, results
//! near the ends of the range) the entry is worked out by the strict level.
//!
//! Polynomials interpolate at the Chebyshev points, computed with 300 binary digits.

use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::{InstBuilder, MemFlagsData, Value, types};

use super::lanes::Lanes;
use super::log_table::{FIRST, PIECES};
use crate::expression::Function;
use crate::expression::function::LOG1PMX_SERIES;

/// The bits of 1.
const ONE: u64 = 0x3ff0_0000_0000_0000;
/// An exponent's bits taken from these are those of the reciprocal's power of two.
const TWICE_BIAS: u64 = 2046 << 52;
const SIGN: u64 = 1 << 63;
const EXPONENT: u64 = 0xfff0_0000_0000_0000;
/// The 26 leading digits of a number: products of two such numbers are exact.
const LEADING: u64 = 0xffff_ffff_f800_0000;
/// The 21 leading digits: times 8 digits of the table, and with room for a difference.
const FEW: u64 = 0xffff_ffff_0000_0000;

/// `1.5*2^52`: added to a number below `2^51` it leaves the nearest whole number in the last digits.
const ROUNDER: f64 = 6755399441055744.0;
/// The bits of `2^52`, whose last digits are whole numbers.
const WHOLE: u64 = 0x4330_0000_0000_0000;

/// `ln(2)` in 42 digits, and the rest.
const LN2: [f64; 2] = [0.6931471805598903, 5.497923018708371e-14];
/// `ln(2)` in 32 digits, and the rest.
const LN2_SHORT: [f64; 2] = [0.6931471803691238, 1.9082149292705877e-10];

/// `(ln(1 + r) - r + r^2/2)/r^3` for `abs(r) < 0.00574`: within `2^-67 r` of the logarithm.
const LOGARITHM: [f64; 6] = [
    0.3333333333333335,
    -0.2500000000000001,
    0.19999999993225884,
    -0.16666666660569956,
    0.14286262991800738,
    -0.12500493835754933,
];

/// `(exp(r) - 1 - r)/r^2` for `abs(r) < 0.3469`: within `2^-60` of `exp(r) - 1`, relative.
const EXPONENTIAL: [f64; 11] = [
    0.5,
    0.1666666666666667,
    0.04166666666666667,
    0.008333333333326084,
    0.0013888888888883711,
    0.0001984126987500228,
    2.480158732567746e-5,
    2.755725517000089e-6,
    2.755727347871858e-7,
    2.5105312729622103e-8,
    2.09147553258932e-9,
];

/// The exponential neither overflows nor becomes subnormal up to here.
const LARGEST_EXPONENT: f64 = 708.0;

/// A result, and the mask of the lanes in which it holds.
pub(super) struct Partial {
    pub(super) value: Value,
    pub(super) holds: Value,
}

/// A number as a sum of two.
#[derive(Clone, Copy)]
pub(super) struct Double {
    pub(super) high: Value,
    pub(super) low: Value,
}

/// A logarithm before it is summed: `start + rest + ln(1 + r)`, where `start` is exact.
struct Reduction {
    start: Value,
    rest: Value,
    r: Value,
}

/// `exp(r) - 1` and the power of two that goes with it.
struct Exponential {
    /// Its last digits are the exponent of the power.
    shifted: Value,
    minus_one: Value,
}

impl Lanes<'_, '_> {
    /// A function that is inlined, with the table of logarithms at `table`; `None` for all others.
    pub(super) fn elementary(
        &mut self,
        function: Function,
        table: Value,
        x: Value,
    ) -> Option<Partial> {
        Some(match function {
            Function::Exp => {
                let exponential = self.exponential(x, None);
                let value = self.scaled(&exponential);
                Partial { value, holds: self.is_at_most(x, LARGEST_EXPONENT) }
            }
            Function::Expm1 => self.expm1(x),
            Function::Ln => {
                let reduction = self.reduction(table, x, None);
                let value = self.rounded(&reduction);
                Partial { value, holds: self.is_normal_and_positive(x) }
            }
            Function::Log1p => {
                let (reduction, holds) = self.log1p(table, x);
                let value = self.rounded(&reduction);
                // Only the zeros have another sign by now.
                Partial { value: self.with_sign_of(value, x), holds }
            }
            Function::Log1pmx => self.log1pmx(table, x),
            _ => return None,
        })
    }

    /// `x^y` from the logarithm of `x`.
    pub(super) fn power(&mut self, logarithm: Double, y: Value) -> Partial {
        let exponent = self.times(y, &logarithm);
        let exponential = self.exponential(exponent.high, Some(exponent.low));
        let value = self.scaled(&exponential);
        Partial { value, holds: self.is_at_most(exponent.high, LARGEST_EXPONENT) }
    }

    /// `ln(x)` with a relative error of some `2^-65`, and where it holds.
    pub(super) fn logarithm(&mut self, table: Value, x: Value) -> (Double, Value) {
        let reduction = self.reduction(table, x, None);
        (self.double(&reduction), self.is_normal_and_positive(x))
    }

    fn expm1(&mut self, x: Value) -> Partial {
        let Exponential { shifted, minus_one } = self.exponential(x, None);
        let power = self.power_of_two(shifted);
        let one = self.constant(1.0);
        let rest = self.builder.ins().fsub(power, one);
        let value = self.multiply_add(power, minus_one, rest);
        let value = self.with_sign_of(value, x);
        Partial { value, holds: self.is_at_most(x, LARGEST_EXPONENT) }
    }

    /// `ln(1 + x)`, and where it holds.
    fn log1p(&mut self, table: Value, x: Value) -> (Reduction, Value) {
        let one = self.constant(1.0);
        let sum = self.builder.ins().fadd(one, x);
        let one = self.constant(1.0);
        let back = self.builder.ins().fsub(sum, one);
        let lost = self.builder.ins().fsub(x, back);
        // 1 + x is at least 2^-53 for all x > -1.
        let (least, most) = (self.constant(1e-17), self.constant(1e300));
        let above = self.compare(FloatCC::GreaterThan, sum, least);
        let below = self.compare(FloatCC::LessThan, sum, most);
        let holds = self.builder.ins().band(above, below);
        (self.reduction(table, sum, Some(lost)), holds)
    }

    /// `ln(1 + x) - x`: see [`crate::expression::function::log1pmx`].
    fn log1pmx(&mut self, table: Value, x: Value) -> Partial {
        let two = self.constant(2.0);
        let sum = self.builder.ins().fadd(two, x);
        let r = self.builder.ins().fdiv(x, sum);
        let square = self.builder.ins().fmul(r, r);
        let fourth = self.builder.ins().fmul(square, square);
        let coefficients: [f64; 11] = std::array::from_fn(|k| 2.0 / (2 * k + 3) as f64);
        let series = self.polynomial(&coefficients, square, fourth);
        let series = self.builder.ins().fmul(series, square);
        let series = self.builder.ins().fsub(series, x);
        let near = self.builder.ins().fmul(r, series);
        let (reduction, holds) = self.log1p(table, x);
        let logarithm = self.double(&reduction);
        let far = self.builder.ins().fsub(logarithm.high, x);
        let far = self.builder.ins().fadd(far, logarithm.low);
        let is_near = self.is_at_most(x, LOG1PMX_SERIES);
        let holds = self.builder.ins().bor(is_near, holds);
        Partial { value: self.choose(is_near, near, far), holds }
    }

    /// `ln(x + tail)` for a normal `x > 0`; `tail` is at most a rounding error of `x`, or `x` is 1.
    ///
    /// With `x = 2^k z` and a number `c` of the table near `z`: `k ln(2) + ln(c) + ln(1 + r)` where
    /// `r = z/c - 1`. Near 1, `c` is 1 and `r` is all there is.
    fn reduction(&mut self, table: Value, x: Value, tail: Option<Value>) -> Reduction {
        let bits = self.as_bits(x);
        // The exponent of `shifted` is that of 2^k, its leading digits are the number of the piece.
        let offset = self.mask(ONE - FIRST);
        let shifted = self.builder.ins().iadd(bits, offset);
        let exponent = self.mask(EXPONENT);
        let exponent = self.builder.ins().band(shifted, exponent);
        let [inverse, high, low] = self.row(table, shifted);
        let k = self.exponent_of(shifted);

        let one = self.mask(ONE);
        let z = self.builder.ins().iadd(bits, one);
        let z = self.builder.ins().isub(z, exponent);
        let mut r = self.ratio_minus_one(z, inverse);
        if let Some(tail) = tail {
            let twice = self.mask(TWICE_BIAS);
            let reciprocal = self.builder.ins().isub(twice, exponent);
            let reciprocal = self.as_numbers(reciprocal);
            let tail = self.builder.ins().fmul(tail, reciprocal);
            r = self.multiply_add(tail, inverse, r);
        }

        let [ln2, ln2_rest] = LN2.map(|x| self.constant(x));
        let start = self.multiply_add(k, ln2, high);
        let rest = self.multiply_add(k, ln2_rest, low);
        Reduction { start, rest, r }
    }

    /// The logarithm with a relative error of some `2^-65`.
    fn double(&mut self, &Reduction { start, rest, r }: &Reduction) -> Double {
        let first = self.sum(start, r);
        let (half_square, square_rest, square) = self.half_square(r);
        let second = self.sum(first.high, half_square);
        let cube = self.builder.ins().fmul(r, square);
        let series = self.polynomial(&LOGARITHM, r, square);
        let small = self.builder.ins().fadd(rest, first.low);
        let smaller = self.builder.ins().fadd(second.low, square_rest);
        let small = self.builder.ins().fadd(small, smaller);
        let low = self.multiply_add(cube, series, small);
        self.sum(second.high, low)
    }

    /// The logarithm as one number.
    fn rounded(&mut self, &Reduction { start, rest, r }: &Reduction) -> Value {
        let square = self.builder.ins().fmul(r, r);
        let series = self.polynomial(&LOGARITHM, r, square);
        let half = self.constant(-0.5);
        let series = self.multiply_add(r, series, half);
        let small = self.multiply_add(square, series, rest);
        let small = self.builder.ins().fadd(small, r);
        self.builder.ins().fadd(start, small)
    }

    /// `x + y` and its rounding error, for `abs(x) > abs(y)` or `x = 0`.
    fn sum(&mut self, x: Value, y: Value) -> Double {
        let high = self.builder.ins().fadd(x, y);
        let lost = self.builder.ins().fsub(x, high);
        Double { high, low: self.builder.ins().fadd(lost, y) }
    }

    /// Inverse and logarithm of the piece in which each lane lies.
    fn row(&mut self, table: Value, shifted: Value) -> [Value; 3] {
        const SIZE: u64 = size_of::<[f64; 4]>() as u64;
        // A row has 2^5 bytes, and the number of the piece begins at digit 45.
        let places = self.shifted_down(shifted, 45 - i64::from(SIZE.trailing_zeros()));
        let within = self.mask((PIECES as u64 - 1) * SIZE);
        let places = self.builder.ins().band(places, within);
        let flags = MemFlagsData::trusted().with_readonly().with_can_move();
        let rows = [0, 1].map(|lane| {
            let place = self.lane(places, lane);
            let row = self.builder.ins().iadd(table, place);
            [0, 16].map(|half| self.builder.ins().load(types::F64X2, flags, row, half))
        });
        let inverse = self.unzip(rows.map(|row| row[0]), false);
        let logarithms = rows.map(|row| row[1]);
        [inverse, self.unzip(logarithms, false), self.unzip(logarithms, true)]
    }

    /// The exponent of 2 in the leading digits, as a number.
    fn exponent_of(&mut self, bits: Value) -> Value {
        let biased = self.shifted_down(bits, 52);
        let whole = self.mask(WHOLE);
        let sum = self.builder.ins().bor(biased, whole);
        let sum = self.as_numbers(sum);
        let bias = self.constant(f64::from_bits(WHOLE) + 1023.0);
        self.builder.ins().fsub(sum, bias)
    }

    /// `z*inverse - 1`, exactly, from the bits of `z`.
    fn ratio_minus_one(&mut self, z: Value, inverse: Value) -> Value {
        let minus_one = self.constant(-1.0);
        let number = self.as_numbers(z);
        if self.fma {
            return self.builder.ins().fma(number, inverse, minus_one);
        }
        let (high, low) = self.split(number, FEW);
        let high = self.multiply_add(high, inverse, minus_one);
        let low = self.builder.ins().fmul(low, inverse);
        self.builder.ins().fadd(high, low)
    }

    /// `-r^2/2` as a sum of two, and `r^2`.
    fn half_square(&mut self, r: Value) -> (Value, Value, Value) {
        let square = self.builder.ins().fmul(r, r);
        let half = self.constant(-0.5);
        if self.fma {
            let negative = self.builder.ins().fneg(square);
            let lost = self.builder.ins().fma(r, r, negative);
            let high = self.builder.ins().fmul(square, half);
            let low = self.builder.ins().fmul(lost, half);
            return (high, low, square);
        }
        let (leading, rest) = self.split(r, LEADING);
        let high = self.builder.ins().fmul(leading, leading);
        let high = self.builder.ins().fmul(high, half);
        let sum = self.builder.ins().fadd(r, leading);
        let low = self.builder.ins().fmul(rest, sum);
        (high, self.builder.ins().fmul(low, half), square)
    }

    /// The leading digits, and the rest.
    fn split(&mut self, x: Value, digits: u64) -> (Value, Value) {
        let bits = self.as_bits(x);
        let mask = self.mask(digits);
        let leading = self.builder.ins().band(bits, mask);
        let leading = self.as_numbers(leading);
        (leading, self.builder.ins().fsub(x, leading))
    }

    /// `y*x` as a sum of two.
    fn times(&mut self, y: Value, x: &Double) -> Double {
        if self.fma {
            let high = self.builder.ins().fmul(y, x.high);
            let negative = self.builder.ins().fneg(high);
            let lost = self.builder.ins().fma(y, x.high, negative);
            return Double { high, low: self.builder.ins().fma(y, x.low, lost) };
        }
        let (x_leading, x_rest) = self.split(x.high, LEADING);
        let (y_leading, y_rest) = self.split(y, LEADING);
        let high = self.builder.ins().fmul(y_leading, x_leading);
        let crossed = self.builder.ins().fmul(y_rest, x_leading);
        let x_low = self.builder.ins().fadd(x.low, x_rest);
        let low = self.builder.ins().fmul(y, x_low);
        Double { high, low: self.builder.ins().fadd(crossed, low) }
    }

    /// `exp(x + low)` in two factors: `x = k ln(2) + r`.
    fn exponential(&mut self, x: Value, low: Option<Value>) -> Exponential {
        let per_ln2 = self.constant(std::f64::consts::LOG2_E);
        let rounder = self.constant(ROUNDER);
        let shifted = self.multiply_add(x, per_ln2, rounder);
        let k = self.builder.ins().fsub(shifted, rounder);
        let [ln2, ln2_rest] = LN2_SHORT.map(|x| self.constant(-x));
        let high = self.multiply_add(k, ln2, x);
        let low = match low {
            Some(low) => self.multiply_add(k, ln2_rest, low),
            None => self.builder.ins().fmul(k, ln2_rest),
        };
        let r = self.sum(high, low);
        let square = self.builder.ins().fmul(r.high, r.high);
        let series = self.polynomial(&EXPONENTIAL, r.high, square);
        let series = self.multiply_add(square, series, r.low);
        Exponential { shifted, minus_one: self.builder.ins().fadd(r.high, series) }
    }

    fn scaled(&mut self, exponential: &Exponential) -> Value {
        let one = self.constant(1.0);
        let value = self.builder.ins().fadd(one, exponential.minus_one);
        let value = self.as_bits(value);
        let exponent = self.exponent_bits(exponential.shifted);
        let scaled = self.builder.ins().iadd(value, exponent);
        self.as_numbers(scaled)
    }

    /// `2^k`
    fn power_of_two(&mut self, shifted: Value) -> Value {
        let one = self.mask(ONE);
        let exponent = self.exponent_bits(shifted);
        let bits = self.builder.ins().iadd(one, exponent);
        self.as_numbers(bits)
    }

    fn exponent_bits(&mut self, shifted: Value) -> Value {
        let bits = self.as_bits(shifted);
        let digits = self.builder.ins().iconst(types::I64, 52);
        self.builder.ins().ishl(bits, digits)
    }

    fn shifted_down(&mut self, bits: Value, digits: i64) -> Value {
        let digits = self.builder.ins().iconst(types::I64, digits);
        self.builder.ins().ushr(bits, digits)
    }

    fn with_sign_of(&mut self, value: Value, x: Value) -> Value {
        let (value, x) = (self.as_bits(value), self.as_bits(x));
        let sign = self.mask(SIGN);
        let sign = self.builder.ins().band(x, sign);
        let signed = self.builder.ins().bor(value, sign);
        self.as_numbers(signed)
    }

    fn is_normal_and_positive(&mut self, x: Value) -> Value {
        let (least, most) = (self.constant(f64::MIN_POSITIVE), self.constant(f64::MAX));
        let above = self.compare(FloatCC::GreaterThanOrEqual, x, least);
        let below = self.compare(FloatCC::LessThanOrEqual, x, most);
        self.builder.ins().band(above, below)
    }

    /// `abs(x) <= bound`, false if `x` is not a number.
    fn is_at_most(&mut self, x: Value, bound: f64) -> Value {
        let size = self.builder.ins().fabs(x);
        let bound = self.constant(bound);
        self.compare(FloatCC::LessThanOrEqual, size, bound)
    }
}
