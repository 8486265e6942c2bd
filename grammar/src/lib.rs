//! The text of piola: from a string to a syntax tree and back.
//!
//! | stage | input | output |
//! |---|---|---|
//! | [`parse`] | text of a potential file | [`Ast`], or every [`Diagnostic`] |
//! | [`parse_expression`] | an expression of a scene file | [`ExpressionAst`], or every [`Diagnostic`] |
//! | [`print`] | [`Ast`] | canonical text, which parses to the same tree |
//!
//! `LANGUAGE.md` beside this crate is the reference of the language.

pub mod ast;
pub mod diagnostic;
mod span;

pub use ast::{Ast, ExpressionAst};
pub use diagnostic::{Diagnostic, Severity};
pub use span::Span;
