//! From a syntax tree to a checked model.
//!
//! | pass | what |
//! |---|---|
//! | `imports` | what is used of other files takes the place of the lines that import them |
//! | `entries` | vectors of parameters, sums over their entries and `invariants` by name are written out |
//! | `names` | every name is known, used as what it is, and defined before its use |
//! | `elaborate` | once per dimension: `d` folds, types and dimensions are checked, the graph is built |
//! | `table` | the files of tables are read, each once |
//!
//! Before: any tree. After: a [`Model`], or every error of the file at once.

mod bond;
mod breaking;
mod call;
mod constant;
mod coupled;
pub mod dimension;
mod dissipation;
mod domain;
mod elaborate;
mod entries;
mod foreign;
mod gathered;
mod imports;
pub(crate) mod in_unit;
mod invariants;
pub(crate) mod names;
mod orders;
mod quantity;
mod statement;
mod states;
mod stretch;
mod symbols;
mod table;
mod tensor;
mod texts;
pub mod unit;
mod value;
mod vector;

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::HashMap;

use piola_grammar::{Ast, Diagnostic, Reading, Span, read, spell_out};

use crate::model::Model;
use imports::Imports;

/// The codes of all findings of this crate, those about values and sizes included.
pub const CODES: [&str; 28] = [
    "constraint-violated",
    "dimension-mismatch",
    "duplicate-name",
    "duplicate-statement",
    "empty-domain",
    "function-without-arguments",
    "missing-parameter",
    "no-energy",
    "no-horizon",
    "no-threshold",
    "not-a-constant",
    "not-a-function",
    "not-a-number",
    "not-a-state",
    "reserved-name",
    "too-large",
    "type-mismatch",
    "unknown-lint",
    "unknown-measure",
    "unknown-name",
    "unknown-parameter",
    "unknown-unit",
    "wrong-dimensions",
    "wrong-import",
    "wrong-measure",
    "wrong-number-of-arguments",
    "wrong-shape",
    "wrong-table",
];

/// After so many findings the rest of a file is not reported.
pub const MAX_FINDINGS: usize = 100;

/// Reads and checks the text of a potential. Every mistake is reported in one run: what is wrong
/// with the lines that can be read comes with what is wrong with the others.
pub fn check_text(text: &str) -> Result<(Ast, Model), Vec<Diagnostic>> {
    check_text_with(text, &no_files)
}

/// Gives the text of a file that a potential names, or says why there is none.
pub type Files<'f> = &'f dyn Fn(&str) -> Result<String, String>;

/// The files of a text that lies in no folder.
fn no_files(_: &str) -> Result<String, String> {
    Err("this text lies in no folder, and no file beside it".into())
}

/// The same for a text beside other files, from which its tables are read.
pub fn check_text_with(text: &str, files: Files<'_>) -> Result<(Ast, Model), Vec<Diagnostic>> {
    let Reading { ast, mut findings, unread } = read(text);
    if findings.is_empty() {
        return check_with(&ast, text.len(), files).map(|(ast, model)| (ast.into_owned(), model));
    }
    let lost: Vec<String> = unread.iter().map(|line| spell_out(&text[line.range()])).collect();
    // What is right in two dimensions may be wrong in three.
    let checkable = !lost.iter().any(|line| line.starts_with("dimensions"));
    if let Err(more) =
        if checkable { check_with(&ast, text.len(), files).map(drop) } else { Ok(()) }
    {
        findings.extend(more.into_iter().filter(|finding| !follows(finding, text, &lost)));
    }
    findings.sort_by_key(|finding| finding.span);
    findings.truncate(MAX_FINDINGS);
    Err(findings)
}

/// Whether a finding may only be there because lines are lost.
fn follows(finding: &Diagnostic, text: &str, lost: &[String]) -> bool {
    let Span { start, end } = finding.span;
    let name = spell_out(&text[start as usize..end as usize]);
    let word = |c: char| c.is_alphanumeric() || c == '_';
    let is_of_gradient =
        |line: &String| line.replace(' ', "").starts_with("psi(F") || line.contains("Xi");
    match finding.code {
        "no-energy" => true,
        // The line that is lost may be the one that brings tensors.
        "unknown-name" if foreign::is_of_tensors(&name) && lost.iter().any(is_of_gradient) => true,
        // So may an import.
        "unknown-name" if lost.iter().any(|line| line.starts_with("import")) => true,
        "unknown-name" => {
            lost.iter().any(|line| line.split(|c| !word(c)).any(|written| written == name))
        }
        _ => false,
    }
}

/// Checks a potential. Every error of the file is reported in one run, in the order of the text;
/// what depends on a name that is wrong is not looked at further.
pub fn check(ast: &Ast) -> Result<Model, Vec<Diagnostic>> {
    check_with(ast, 0, &no_files).map(|(_, model)| model)
}

/// The same of a text of this length with the files that it names; and the tree that was checked, in which
/// imports, vectors and sums are written out.
fn check_with<'a>(
    ast: &'a Ast,
    length: usize,
    files: Files<'_>,
) -> Result<(Cow<'a, Ast>, Model), Vec<Diagnostic>> {
    let mut errors = Vec::new();
    // What is imported is checked twice, and its tables are read once.
    let known = RefCell::new(HashMap::new());
    let files = &|name: &str| {
        let found = known.borrow().get(name).cloned();
        found.unwrap_or_else(|| {
            let read = files(name);
            known.borrow_mut().insert(name.to_string(), read.clone());
            read
        })
    };
    let imports = Imports::read(ast, length, files, &mut errors);
    let merged = match imports.merged(ast, false) {
        Cow::Borrowed(alone) => return check_whole(alone, files, errors),
        Cow::Owned(merged) => merged,
    };
    // What is wrong is told where it stands; what is right stands where it is imported.
    check_whole(&merged, files, errors).map_err(|errors| imports.at_home(errors))?;
    let merged = imports.merged(ast, true).into_owned();
    check_whole(&merged, files, Vec::new())
        .map(|(ast, model)| (Cow::Owned(ast.into_owned()), model))
}

/// Checks a tree without imports.
fn check_whole<'a>(
    ast: &'a Ast,
    files: Files<'_>,
    mut errors: Vec<Diagnostic>,
) -> Result<(Cow<'a, Ast>, Model), Vec<Diagnostic>> {
    let ast = entries::written_out(ast, &mut errors);
    let (mut symbols, wrong) = names::resolve(&ast);
    errors.extend(wrong);
    symbols.tables = table::read_all(&ast, files, &mut errors);
    let model = if errors.len() < MAX_FINDINGS {
        statement::model(&ast, &symbols, &mut errors)
    } else {
        None
    };
    if let (Some(model), true) = (model, errors.is_empty()) {
        return Ok((ast, model));
    }
    errors.sort_by_key(|error| error.span);
    // What is wrong in a sum is wrong in each of its terms.
    errors.dedup_by(|next, first| next.span == first.span && next.message == first.message);
    drop_uses_of_refused_names(&mut errors);
    errors.truncate(MAX_FINDINGS);
    Err(errors)
}

/// What a name that may not be defined stands for where it is used is not what was meant there: `A = 2` is no
/// area.
fn drop_uses_of_refused_names(errors: &mut Vec<Diagnostic>) {
    let quoted = |error: &Diagnostic| error.message.split('`').nth(1).map(str::to_string);
    let refused = errors.iter().filter(|error| error.code == "reserved-name");
    let refused: Vec<String> = refused.filter_map(quoted).collect();
    errors.retain(|error| {
        let follows = |name: String| match error.code {
            "unknown-name" => refused.contains(&name),
            // Told of the measure, whose reference may be what was defined.
            "wrong-measure" => refused.iter().any(|known| known.eq_ignore_ascii_case(&name)),
            _ => false,
        };
        !quoted(error).is_some_and(follows)
    });
}

pub(crate) use gathered::MAX_INTEGRALS;

/// Elaboration of a lone expression, for formulas outside potentials.
pub(crate) use elaborate::elaborate_formula;

/// What names stand for, for a second reading of a tree that was checked.
pub(crate) use elaborate::{Elaborator, Meaning, meaning};
pub(crate) use names::{parts, resolve};
pub(crate) use symbols::{Kinematic, Symbol, Symbols, TensorFunction};

#[cfg(test)]
mod imports_tests;
#[cfg(test)]
mod tests;
