//! One plan for `x^c`, followed by interpreter, machine code and printed C alike.

/// How a power with a constant exponent is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PowerPlan {
    /// By multiplications; then `1/..` if `reciprocal`, and times or over `sqrt(x)` if `half`.
    Chain {
        /// Whole part of `abs(c)`, 0 to 16.
        times: u32,
        /// Whether a factor `sqrt(x)` comes with it.
        half: bool,
        /// Whether `c < 0`.
        reciprocal: bool,
    },
    /// By the function `pow`.
    General(f64),
}

/// Largest `abs(c)` that is worked out by multiplication: at most 6 multiplications, each within
/// half a unit in the last place, which stays below the error of a call and costs a fraction of it.
const LONGEST_CHAIN: f64 = 16.5;

impl PowerPlan {
    /// The plan for this exponent.
    pub fn new(exponent: f64) -> PowerPlan {
        let size = exponent.abs();
        let twice = 2.0 * size;
        if size <= LONGEST_CHAIN && twice == twice.trunc() {
            let half = size != size.trunc();
            PowerPlan::Chain { times: size.trunc() as u32, half, reciprocal: exponent < 0.0 }
        } else {
            PowerPlan::General(exponent)
        }
    }

    /// Carries the plan out on whatever `ops` computes with.
    pub fn apply<O: PowerOps>(self, ops: &mut O, x: O::Value) -> O::Value {
        match self {
            PowerPlan::General(c) => ops.pow(x, c),
            PowerPlan::Chain { times, half, reciprocal } => {
                let mut result = None;
                let mut square = x;
                let mut left = times;
                while left > 0 {
                    if left & 1 == 1 {
                        result = Some(match result {
                            None => square,
                            Some(r) => ops.multiply(r, square),
                        });
                    }
                    left >>= 1;
                    if left > 0 {
                        square = ops.multiply(square, square);
                    }
                }
                if half {
                    let root = ops.sqrt(x);
                    result = Some(match result {
                        None => root,
                        Some(r) => ops.multiply(r, root),
                    });
                }
                match result {
                    None => ops.one(),
                    Some(r) if reciprocal => ops.reciprocal(r),
                    Some(r) => r,
                }
            }
        }
    }
}

/// The operations a plan needs.
pub trait PowerOps {
    /// What it computes with: numbers, instructions or text.
    type Value: Copy;
    /// 1
    fn one(&mut self) -> Self::Value;
    /// `x * y`
    fn multiply(&mut self, x: Self::Value, y: Self::Value) -> Self::Value;
    /// `1 / x`
    fn reciprocal(&mut self, x: Self::Value) -> Self::Value;
    /// `sqrt(x)`
    fn sqrt(&mut self, x: Self::Value) -> Self::Value;
    /// `pow(x, c)`
    fn pow(&mut self, x: Self::Value, c: f64) -> Self::Value;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expression::number::Number;

    #[test]
    fn chains_agree_with_pow() {
        for twice in -33..=33 {
            let c = f64::from(twice) / 2.0;
            assert!(matches!(PowerPlan::new(c), PowerPlan::Chain { .. }), "{c}");
            for x in [0.3, 1.0, 1.7, 12.5] {
                let exact = libm::pow(x, c);
                let error = (Number::power_constant(x, c) - exact).abs() / exact;
                assert!(error <= 8.0 * f64::EPSILON, "{x}^{c}: {error:e}");
            }
        }
        assert_eq!(PowerPlan::new(17.0), PowerPlan::General(17.0));
        assert_eq!(PowerPlan::new(2.7), PowerPlan::General(2.7));
    }
}
