//! The elementary functions of `libm` as machine code knows them.

use crate::expression::function::log1pmx;
use crate::expression::power::PowerPlan;
use crate::expression::{Function, Node, Operator};

/// A function that is called, or at the fast level inlined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Called {
    /// Of one number.
    Unary(Function),
    /// `x^y`
    Pow,
    /// The angle of the point `(y, x)`.
    Atan2,
}

impl Called {
    /// What an operation calls.
    pub(super) fn of(node: Node) -> Option<Called> {
        match node {
            Node::Unary(function, _) => function.libm().map(|_| Called::Unary(function)),
            Node::Binary(Operator::Power, ..) => Some(Called::Pow),
            Node::Binary(Operator::Atan2, ..) => Some(Called::Atan2),
            Node::PowerConstant(_, bits) => match PowerPlan::new(f64::from_bits(bits)) {
                PowerPlan::General(_) => Some(Called::Pow),
                PowerPlan::Chain { .. } => None,
            },
            _ => None,
        }
    }

    /// All of them.
    pub(super) fn all() -> impl Iterator<Item = Called> {
        let unary = Function::all_named().filter(|function| function.libm().is_some());
        unary.map(Called::Unary).chain([Called::Pow, Called::Atan2])
    }

    /// Whether the fast level has code of its own for it.
    pub(super) fn is_inlined(self) -> bool {
        use Function::{Exp, Expm1, Ln, Log1p, Log1pmx};
        matches!(self, Called::Pow | Called::Unary(Exp | Expm1 | Ln | Log1p | Log1pmx))
    }

    /// How many numbers it takes.
    pub(super) fn arity(self) -> usize {
        match self {
            Called::Unary(_) => 1,
            Called::Pow | Called::Atan2 => 2,
        }
    }

    /// The symbol under which the code generator knows it; never a name of the C library.
    pub(super) fn symbol(self) -> String {
        match self {
            Called::Unary(f) => format!("piola_{}", f.name()),
            Called::Pow => "piola_pow".to_string(),
            Called::Atan2 => "piola_atan2".to_string(),
        }
    }

    /// Its body under the calling convention of machine code.
    pub(super) fn address(self) -> Option<*const u8> {
        macro_rules! address {
            ($function:path) => {{
                extern "C" fn call(x: f64) -> f64 {
                    $function(x)
                }
                Some(call as *const u8)
            }};
        }
        extern "C" fn pow(x: f64, y: f64) -> f64 {
            libm::pow(x, y)
        }
        extern "C" fn atan2(x: f64, y: f64) -> f64 {
            libm::atan2(x, y)
        }
        let function = match self {
            Called::Pow => return Some(pow as *const u8),
            Called::Atan2 => return Some(atan2 as *const u8),
            Called::Unary(function) => function,
        };
        match function {
            Function::Negate | Function::Abs | Function::Sign | Function::Sqrt => None,
            Function::Exp => address!(libm::exp),
            Function::Ln => address!(libm::log),
            Function::Log1p => address!(libm::log1p),
            Function::Expm1 => address!(libm::expm1),
            Function::Log1pmx => address!(log1pmx),
            Function::Sin => address!(libm::sin),
            Function::Cos => address!(libm::cos),
            Function::Tan => address!(libm::tan),
            Function::Asin => address!(libm::asin),
            Function::Acos => address!(libm::acos),
            Function::Atan => address!(libm::atan),
            Function::Sinh => address!(libm::sinh),
            Function::Cosh => address!(libm::cosh),
            Function::Tanh => address!(libm::tanh),
            Function::Erf => address!(libm::erf),
        }
    }
}
