//! The text of piola: from a string to a syntax tree and back.
//!
//! | stage | input | output |
//! |---|---|---|
//! | [`parse()`] | text of a potential file | [`Ast`], or every [`Diagnostic`] |
//! | [`parse_expression`] | an expression of a scene file | [`ExpressionAst`], or every [`Diagnostic`] |
//! | [`parse_unit`] | the unit after a number | [`ast::Unit`], or every [`Diagnostic`] |
//! | [`print()`] | [`Ast`] | canonical text, which parses to the same tree |
//! | [`format()`] | text of a potential file | the same text, its blanks in the layout of the library |
//! | [`tokens`] | any text | its words, numbers and marks with their places |
//!
//! `LANGUAGE.md` beside this crate is the reference of the language, `src/piola.pest` its grammar.
//! No text makes this crate panic, overflow the stack or run long: see [`MAX_BYTES`] and
//! [`MAX_NESTING`].
//!
//! ```
//! let text = "potential spring\nparameter C\npsi(l) = 1/2*C*((l - L)/L)^2";
//! let ast = piola_grammar::parse(text).unwrap();
//! assert_eq!(piola_grammar::print(&ast).trim_end(), text);
//!
//! let found = piola_grammar::parse("potential spring\nparamter C").unwrap_err();
//! assert_eq!(found[0].helps, ["did you mean `parameter`?"]);
//! ```

// A library prints nothing; what its program prints goes through one module.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod ast;
pub mod diagnostic;
mod format;
pub mod generate;
pub mod names;
mod operator;
mod parse;
mod print;
mod same;
mod span;
mod suggest;
mod tokens;

pub use ast::{Ast, ExpressionAst};
pub use diagnostic::{Diagnostic, Severity, shortened};
pub use format::format;
pub use names::spell_out;
pub use operator::Binding;
pub use parse::{
    CODES, MAX_BYTES, MAX_NESTING, Reading, parse, parse_expression, parse_unit, read,
};
pub use print::{print, print_expression, print_unit};
pub use same::{same_expression, same_tree};
pub use span::Span;
pub use suggest::{counted, suggest};
pub use tokens::{Token, TokenKind, statements, tokens};
