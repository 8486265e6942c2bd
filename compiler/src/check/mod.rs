//! From a syntax tree to a checked model.
//!
//! | pass | what |
//! |---|---|
//! | `names` | every name is known, used as what it is, and defined before its use |
//! | `elaborate` | once per dimension: `d` folds, types and dimensions are checked, the graph is built |
//!
//! Before: any tree. After: a [`Model`], or every error of the file at once.

mod call;
mod constant;
pub mod dimension;
mod elaborate;
mod names;
mod quantity;
mod statement;
pub mod unit;
mod value;

use piola_grammar::{Ast, Diagnostic};

use crate::model::Model;

/// After so many findings the rest of a file is not reported.
pub const MAX_FINDINGS: usize = 100;

/// Checks a potential. Every error of the file is reported in one run, in the order of the text;
/// what depends on a name that is wrong is not looked at further.
pub fn check(ast: &Ast) -> Result<Model, Vec<Diagnostic>> {
    let (symbols, mut errors) = names::resolve(ast);
    let model = if errors.len() < MAX_FINDINGS {
        statement::model(ast, &symbols, &mut errors)
    } else {
        None
    };
    match model {
        Some(model) if errors.is_empty() => Ok(model),
        _ => {
            errors.sort_by_key(|error| error.span);
            errors.truncate(MAX_FINDINGS);
            Err(errors)
        }
    }
}

/// Elaboration of a lone expression, for formulas outside potentials.
pub(crate) use elaborate::elaborate_formula;

#[cfg(test)]
mod tests;
