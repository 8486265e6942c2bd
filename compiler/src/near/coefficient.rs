//! Taylor coefficients in 256 bits: sums of numbers times functions of the reference measure.
//!
//! What cancels, cancels here: a number counts as 0 when it is nothing beside the terms it came from.

use super::exact::{Exact, Number};
use crate::expression::NodeId;

/// A function of the reference measure `M` alone: a power of it, times a node of the graph if it has
/// other factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Symbol {
    pub(super) power: f64,
    pub(super) other: Option<NodeId>,
}

impl Symbol {
    pub(super) const ONE: Symbol = Symbol { power: 0.0, other: None };

    pub(super) fn is_one(self) -> bool {
        self == Symbol::ONE
    }
}

/// A number with a symbol.
#[derive(Clone, Debug)]
pub(super) struct Term {
    pub(super) symbol: Symbol,
    pub(super) exact: Exact,
}

impl Term {
    /// A number.
    pub(super) fn number(value: Number) -> Term {
        Term { symbol: Symbol::ONE, exact: Exact::new(value) }
    }

    /// The symbol itself.
    pub(super) fn symbol(symbol: Symbol) -> Term {
        Term { symbol, exact: Exact::from(1.0) }
    }

    pub(super) fn negated(&self) -> Term {
        Term { exact: self.exact.negated(), ..*self }
    }

    pub(super) fn scaled(&self, by: &Number) -> Term {
        Term { exact: self.exact.times(&Exact::new(by.clone())), ..*self }
    }
}

/// A sum of terms with different symbols; empty where it is 0.
pub(super) type Coefficient = Vec<Term>;

/// Adds a term.
pub(super) fn add(sum: &mut Coefficient, term: Term) {
    match sum.iter_mut().find(|known| known.symbol == term.symbol) {
        Some(known) => {
            known.exact = known.exact.plus(&term.exact);
        }
        None => sum.push(term),
    }
}

/// Without the terms that cancelled.
pub(super) fn settled(mut sum: Coefficient) -> Coefficient {
    sum.retain(|term| !term.exact.is_nothing());
    sum
}

/// The one number that it is, without a symbol; nothing where it depends on the reference measure.
pub(super) fn as_number(coefficient: &Coefficient) -> Option<Term> {
    match coefficient.as_slice() {
        [] => Some(Term::number(Number::from(0))),
        [only] if only.symbol.is_one() => Some(only.clone()),
        _ => None,
    }
}
