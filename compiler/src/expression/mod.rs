//! The form piola computes on: a hash-consed graph of operations in an arena.
//!
//! | module | what |
//! |---|---|
//! | [`graph`] | nodes, stored once each, operands before users |
//! | [`function`] | the elementary functions, one list for all readings |
//! | [`number`] | what a number type must offer so that a graph can be evaluated over it |
//! | [`interpret`] | evaluation over any such type |
//! | [`precise`] | numbers of any precision with two derivatives |
//! | `random_rounding` | doubles whose operations round at random |
//! | [`power`] | one plan for `x^c`, followed by interpreter and machine code alike |

pub mod function;
pub mod graph;
pub mod interpret;
pub mod number;
pub mod power;
pub mod precise;
pub(crate) mod random_rounding;
pub(crate) mod real;

pub use function::{Comparison, Function, Operator};
pub use graph::{ExprGraph, Input, Node, NodeId, TooManyNodes};
