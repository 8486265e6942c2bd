//! Elementary functions and operators: one list, which every reading of a graph goes through.

use piola_grammar::names::UNARY_FUNCTIONS;

/// Functions of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Function {
    /// `-x`
    Negate,
    /// Absolute value.
    Abs,
    /// -1, 0 or 1; not a number where `x` is none.
    Sign,
    /// Square root.
    Sqrt,
    /// Exponential.
    Exp,
    /// Natural logarithm.
    Ln,
    /// `ln(1 + x)`, accurate near 0.
    Log1p,
    /// `exp(x) - 1`, accurate near 0.
    Expm1,
    /// `ln(1 + x) - x`, accurate near 0.
    Log1pmx,
    /// Sine of an angle in rad.
    Sin,
    /// Cosine of an angle in rad.
    Cos,
    /// Tangent of an angle in rad.
    Tan,
    /// Inverse sine.
    Asin,
    /// Inverse cosine.
    Acos,
    /// Inverse tangent.
    Atan,
    /// Hyperbolic sine.
    Sinh,
    /// Hyperbolic cosine.
    Cosh,
    /// Hyperbolic tangent.
    Tanh,
    /// The error function, `2/sqrt(pi)` times the integral of `exp(-t^2)` from 0 to `x`.
    Erf,
}

impl Function {
    /// All functions that have a name in the language (negation is an operator there).
    pub fn all_named() -> impl Iterator<Item = Function> {
        UNARY_FUNCTIONS.into_iter().filter_map(Function::named)
    }

    /// The function with this name.
    pub fn named(name: &str) -> Option<Function> {
        Some(match name {
            "abs" => Function::Abs,
            "sign" => Function::Sign,
            "sqrt" => Function::Sqrt,
            "exp" => Function::Exp,
            "ln" => Function::Ln,
            "log1p" => Function::Log1p,
            "expm1" => Function::Expm1,
            "log1pmx" => Function::Log1pmx,
            "sin" => Function::Sin,
            "cos" => Function::Cos,
            "tan" => Function::Tan,
            "asin" => Function::Asin,
            "acos" => Function::Acos,
            "atan" => Function::Atan,
            "sinh" => Function::Sinh,
            "cosh" => Function::Cosh,
            "tanh" => Function::Tanh,
            "erf" => Function::Erf,
            _ => return None,
        })
    }

    /// As written in a potential file.
    pub fn name(self) -> &'static str {
        UNARY_FUNCTIONS.into_iter().find(|name| Function::named(name) == Some(self)).unwrap_or("-")
    }

    /// The body at the strict level for the functions that are not single machine instructions:
    /// interpreter and machine code both call it, so they agree to the last bit.
    pub fn libm(self) -> Option<fn(f64) -> f64> {
        Some(match self {
            Function::Negate | Function::Abs | Function::Sign | Function::Sqrt => return None,
            Function::Exp => libm::exp,
            Function::Ln => libm::log,
            Function::Log1p => libm::log1p,
            Function::Expm1 => libm::expm1,
            Function::Log1pmx => log1pmx,
            Function::Sin => libm::sin,
            Function::Cos => libm::cos,
            Function::Tan => libm::tan,
            Function::Asin => libm::asin,
            Function::Acos => libm::acos,
            Function::Atan => libm::atan,
            Function::Sinh => libm::sinh,
            Function::Cosh => libm::cosh,
            Function::Tanh => libm::tanh,
            Function::Erf => libm::erf,
        })
    }
}

/// Up to here, in size, [`log1pmx`] is a series.
pub(crate) const LOG1PMX_SERIES: f64 = 0.3;

/// `ln(1 + x) - x` without the cancellation of its leading terms.
///
/// With `r = x/(2 + x)`, `ln(1 + x) = 2 atanh(r)` and `2r - x = -r*x`, so near 0 only the small terms
/// of the series of atanh are added to `-r*x`.
pub fn log1pmx(x: f64) -> f64 {
    if x.abs() >= LOG1PMX_SERIES || x.is_nan() {
        return libm::log1p(x) - x;
    }
    let r = x / (2.0 + x);
    let square = r * r;
    // r^2 <= 0.032: eleven terms leave less than 1e-18 of the first.
    let mut sum = 0.0;
    for k in (1..=11).rev() {
        sum = square * (sum + 1.0 / f64::from(2 * k + 1));
    }
    r * (2.0 * sum - x)
}

/// Operators with two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Operator {
    /// `x + y`
    Add,
    /// `x - y`
    Subtract,
    /// `x * y`
    Multiply,
    /// `x / y`
    Divide,
    /// `x^y` with an exponent that is not a known number.
    Power,
    /// The smaller; not a number if either is none, `-0 < +0`.
    Min,
    /// The larger; not a number if either is none, `-0 < +0`.
    Max,
    /// The angle of the point with ordinate `x` and abscissa `y`, the first and the second operand, in
    /// rad between -pi and pi; 0 at the origin.
    Atan2,
}

impl Operator {
    /// The operator that is a function with this name in the language.
    pub fn named(name: &str) -> Option<Operator> {
        Some(match name {
            "min" => Operator::Min,
            "max" => Operator::Max,
            "atan2" => Operator::Atan2,
            _ => return None,
        })
    }

    /// Whether the operands may be exchanged without changing a bit.
    pub fn commutes(self) -> bool {
        matches!(self, Operator::Add | Operator::Multiply | Operator::Min | Operator::Max)
    }

    /// As written.
    pub fn name(self) -> &'static str {
        match self {
            Operator::Add => "+",
            Operator::Subtract => "-",
            Operator::Multiply => "*",
            Operator::Divide => "/",
            Operator::Power => "^",
            Operator::Min => "min",
            Operator::Max => "max",
            Operator::Atan2 => "atan2",
        }
    }
}

/// Comparisons of two numbers; every one but `!=` is false if either is not a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Comparison {
    /// `==`
    Equal,
    /// `!=`
    NotEqual,
    /// `<`
    Less,
    /// `<=`
    LessEqual,
    /// `>`
    Greater,
    /// `>=`
    GreaterEqual,
}

impl Comparison {
    /// Whether it holds.
    pub fn holds(self, x: f64, y: f64) -> bool {
        match self {
            Comparison::Equal => x == y,
            Comparison::NotEqual => x != y,
            Comparison::Less => x < y,
            Comparison::LessEqual => x <= y,
            Comparison::Greater => x > y,
            Comparison::GreaterEqual => x >= y,
        }
    }

    /// As written.
    pub fn name(self) -> &'static str {
        match self {
            Comparison::Equal => "==",
            Comparison::NotEqual => "!=",
            Comparison::Less => "<",
            Comparison::LessEqual => "<=",
            Comparison::Greater => ">",
            Comparison::GreaterEqual => ">=",
        }
    }
}

#[cfg(test)]
mod tests {
    use piola_grammar::names::BINARY_FUNCTIONS;

    use super::*;

    #[test]
    fn every_name_of_the_grammar_is_that_of_a_function() {
        let names: Vec<&str> = Function::all_named().map(Function::name).collect();
        assert_eq!(names, UNARY_FUNCTIONS);
        assert_eq!(Function::Negate.name(), "-");
        for name in BINARY_FUNCTIONS {
            assert_eq!(Operator::named(name).map(Operator::name), Some(name));
        }
    }
}
