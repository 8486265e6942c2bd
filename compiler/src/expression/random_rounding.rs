//! Doubles whose operations round at random: what rounding makes of an expression.
//!
//! A single evaluation in doubles may be near the truth by luck. Where every result moves by units in the last place
//! at random, evaluations with several seeds scatter as far as rounding takes digits: where terms cancel by what their
//! roundings are of the difference, else by some roundings. This is discrete stochastic arithmetic (Vignes 1974,
//! CESTAC) and, with moves that are not those of one rounding mode, Monte Carlo arithmetic (Parker 1997).

use super::number::{Number, max, min};
use super::{Function, Operator};
use crate::verify::sample::Random;

/// A double that is rounded at random.
///
/// Where it moves to follows from the operation and its operands' seeds alone, so the same expression is the same
/// number wherever it stands: `x - x` is 0. Operations of nothing but constants move alike in all evaluations.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RandomlyRounded {
    value: f64,
    seed: u64,
}

impl RandomlyRounded {
    /// A number as it is given, in the evaluation with this seed.
    pub(crate) fn given(value: f64, seed: u64) -> Self {
        RandomlyRounded { value, seed: mixed(mixed(0, seed), value.to_bits()) }
    }

    /// The result of an operation, moved by one or two units in the last place; zeros and what is no finite number
    /// stay.
    fn rounded(value: f64, seed: u64) -> Self {
        let units = [-2, -1, 1, 2][(seed >> 62) as usize];
        let stays = value == 0.0 || !value.is_finite();
        RandomlyRounded { value: if stays { value } else { moved(value, units) }, seed }
    }
}

/// A number moved by so many units in the last place, away from 0 or towards it: not beyond 0 or infinity.
fn moved(x: f64, units: i64) -> f64 {
    let size = x.abs().to_bits().saturating_add_signed(units);
    f64::from_bits(size.min(f64::INFINITY.to_bits())).copysign(x)
}

/// A seed that depends on a seed and on one more number.
fn mixed(seed: u64, more: u64) -> u64 {
    Random::new(Random::new(seed).bits() ^ more).bits()
}

impl Number for RandomlyRounded {
    fn constant(value: f64) -> Self {
        RandomlyRounded { value, seed: mixed(1, value.to_bits()) }
    }

    fn value(&self) -> f64 {
        self.value
    }

    fn unary(function: Function, x: Self) -> Self {
        let value = f64::unary(function, x.value);
        match function {
            Function::Sign => Self::constant(value),
            Function::Negate | Function::Abs => RandomlyRounded { value, ..x },
            _ => Self::rounded(value, mixed(mixed(2, function as u64), x.seed)),
        }
    }

    fn binary(operator: Operator, x: Self, y: Self) -> Self {
        let is_first = |chosen: f64| chosen.to_bits() == x.value.to_bits();
        match operator {
            Operator::Min => return if is_first(min(x.value, y.value)) { x } else { y },
            Operator::Max => return if is_first(max(x.value, y.value)) { x } else { y },
            _ => {}
        }
        let seed = mixed(mixed(mixed(3, operator as u64), x.seed), y.seed);
        Self::rounded(f64::binary(operator, x.value, y.value), seed)
    }

    fn power_constant(x: Self, exponent: f64) -> Self {
        let seed = mixed(mixed(4, exponent.to_bits()), x.seed);
        Self::rounded(f64::power_constant(x.value, exponent), seed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How far 16 samples of a function scatter about the value in doubles, in parts of it.
    fn spread(f: fn(RandomlyRounded) -> RandomlyRounded, at: f64, expected: f64) -> f64 {
        let error = |seed| (f(RandomlyRounded::given(at, seed)).value / expected - 1.0).abs();
        (0..16).map(error).fold(0.0, f64::max)
    }

    fn of(function: Function, x: RandomlyRounded) -> RandomlyRounded {
        RandomlyRounded::unary(function, x)
    }

    #[test]
    fn samples_scatter_by_the_roundings_of_terms_that_cancel() {
        let difference = |x| {
            RandomlyRounded::binary(
                Operator::Subtract,
                of(Function::Cosh, x),
                of(Function::Sinh, x),
            )
        };
        for x in [5.0, 10.0, 15.0] {
            let expected = libm::exp(-x);
            let roundings = spread(difference, x, expected) * expected / libm::cosh(x);
            let roundings = roundings / f64::EPSILON;
            assert!((0.9..5.0).contains(&roundings), "{x}: {roundings}");
        }
        // One of the terms is moved as far as is left of it.
        let lost = spread(difference, 30.0, libm::exp(-30.0));
        assert!(lost > 1e4, "{lost}");
    }

    #[test]
    fn samples_of_what_keeps_its_digits_scatter_by_few_roundings() {
        let quotient = |x| {
            let sum = RandomlyRounded::binary(Operator::Add, x, RandomlyRounded::constant(1.0));
            let square = RandomlyRounded::power_constant(x, 2.0);
            RandomlyRounded::binary(Operator::Divide, of(Function::Sqrt, square), sum)
        };
        for x in [1e-150, 1e-3, 0.7, 1e10] {
            let found = spread(quotient, x, f64::sqrt(x * x) / (1.0 + x)) / f64::EPSILON;
            assert!((1.0..8.0).contains(&found), "{x}: {found}");
        }
    }

    #[test]
    fn what_is_exact_stays() {
        for seed in 0..16 {
            let [x, y] = [0.3, -0.7].map(|value| RandomlyRounded::given(value, seed));
            let binary = |operator, x, y| RandomlyRounded::binary(operator, x, y).value;
            assert_eq!(binary(Operator::Min, x, y), -0.7);
            assert_eq!(binary(Operator::Max, x, y), 0.3);
            assert!(binary(Operator::Max, x, RandomlyRounded::constant(f64::NAN)).is_nan());
            assert_eq!(of(Function::Negate, x).value, -0.3);
            assert_eq!(of(Function::Abs, y).value, 0.7);
            assert_eq!(of(Function::Sign, y).value, -1.0);
            let root = of(Function::Sqrt, x);
            assert_eq!(binary(Operator::Subtract, root, root), 0.0);
            assert_ne!(root.value, f64::sqrt(0.3));
        }
    }

    #[test]
    fn moves_end_at_zero_and_at_infinity() {
        let least = f64::from_bits(1);
        assert_eq!(moved(least, 2), f64::from_bits(3));
        assert_eq!(moved(-least, -1).to_bits(), (-0.0_f64).to_bits());
        assert_eq!(moved(least, -2).to_bits(), 0.0_f64.to_bits());
        assert_eq!(moved(f64::MIN_POSITIVE, -1), f64::from_bits((1 << 52) - 1));
        assert_eq!([1, 2].map(|units| moved(f64::MAX, units)), [f64::INFINITY; 2]);
        assert_eq!(moved(f64::MIN, 2), f64::NEG_INFINITY);
        assert_eq!(moved(1.0, 2), 1.0 + 2.0 * f64::EPSILON);
        assert_eq!(moved(-1.0, -1), f64::EPSILON / 2.0 - 1.0);
        for value in [0.0, -0.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
            for seed in 0..8_u64 {
                let rounded = RandomlyRounded::rounded(value, seed << 61).value;
                assert_eq!(rounded.to_bits(), value.to_bits());
            }
        }
    }
}
