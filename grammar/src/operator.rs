//! How operators are written and how tightly they bind: the one table of both.

use crate::ast::{BinaryOperator, UnaryOperator};

/// How tightly an operator binds; of two neighbours the greater takes the operand between them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Binding {
    /// `or`
    Or,
    /// `and`
    And,
    /// `not`
    Not,
    /// `== != < <= > >=`, which do not chain
    Comparison,
    /// `+ -`
    Sum,
    /// `* / :`
    Product,
    /// `-x`
    Sign,
    /// `^`, from right to left
    Power,
    /// `x'`
    Transpose,
}

impl UnaryOperator {
    /// How tightly it binds its operand.
    pub fn binding(self) -> Binding {
        match self {
            UnaryOperator::Negate => Binding::Sign,
            UnaryOperator::Not => Binding::Not,
            UnaryOperator::Transpose => Binding::Transpose,
        }
    }

    /// As written in a piola file.
    pub fn symbol(self) -> &'static str {
        match self {
            UnaryOperator::Negate => "-",
            UnaryOperator::Not => "not",
            UnaryOperator::Transpose => "'",
        }
    }
}

impl BinaryOperator {
    /// All of them, loosest first.
    pub const ALL: [BinaryOperator; 14] = [
        BinaryOperator::Or,
        BinaryOperator::And,
        BinaryOperator::Equal,
        BinaryOperator::NotEqual,
        BinaryOperator::Less,
        BinaryOperator::LessEqual,
        BinaryOperator::Greater,
        BinaryOperator::GreaterEqual,
        BinaryOperator::Add,
        BinaryOperator::Subtract,
        BinaryOperator::Multiply,
        BinaryOperator::Divide,
        BinaryOperator::Contract,
        BinaryOperator::Power,
    ];

    /// The operator written so.
    pub fn from_symbol(symbol: &str) -> Option<BinaryOperator> {
        BinaryOperator::ALL.into_iter().find(|operator| operator.symbol() == symbol)
    }

    /// As written in a piola file.
    pub fn symbol(self) -> &'static str {
        match self {
            BinaryOperator::Or => "or",
            BinaryOperator::And => "and",
            BinaryOperator::Equal => "==",
            BinaryOperator::NotEqual => "!=",
            BinaryOperator::Less => "<",
            BinaryOperator::LessEqual => "<=",
            BinaryOperator::Greater => ">",
            BinaryOperator::GreaterEqual => ">=",
            BinaryOperator::Add => "+",
            BinaryOperator::Subtract => "-",
            BinaryOperator::Multiply => "*",
            BinaryOperator::Divide => "/",
            BinaryOperator::Contract => ":",
            BinaryOperator::Power => "^",
        }
    }

    /// How tightly it binds its operands.
    pub fn binding(self) -> Binding {
        match self {
            BinaryOperator::Or => Binding::Or,
            BinaryOperator::And => Binding::And,
            BinaryOperator::Equal
            | BinaryOperator::NotEqual
            | BinaryOperator::Less
            | BinaryOperator::LessEqual
            | BinaryOperator::Greater
            | BinaryOperator::GreaterEqual => Binding::Comparison,
            BinaryOperator::Add | BinaryOperator::Subtract => Binding::Sum,
            BinaryOperator::Multiply | BinaryOperator::Divide | BinaryOperator::Contract => {
                Binding::Product
            }
            BinaryOperator::Power => Binding::Power,
        }
    }

    /// Whether it is `==`, `!=`, `<`, `<=`, `>` or `>=`.
    pub fn is_comparison(self) -> bool {
        self.binding() == Binding::Comparison
    }
}
