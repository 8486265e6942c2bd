//! Tables of numbers that commands read.

use std::io::Read as _;

use piola_grammar::Diagnostic;
use piola_runtime::output::read::read_numbers;

use crate::potential;
use crate::render::{self, Source};

/// Largest table that is read, in bytes.
pub(crate) const MAX_TABLE: usize = 1 << 30;

/// The numbers of the named columns of a file or, of `-`, of the standard input, row by row; mistakes
/// are printed. `refusal` says what is wrong with a row, and in which of the columns.
pub(crate) fn rows(
    path: &str,
    names: &[&str],
    refusal: impl Fn(&[f64]) -> Option<(usize, String)>,
) -> Option<Vec<Vec<f64>>> {
    let text = text(path)?;
    let mistakes = match read_numbers(&text, names, refusal) {
        Ok(rows) => return Some(rows),
        Err(mistakes) => mistakes,
    };
    let mistakes: Vec<Diagnostic> = mistakes.into_iter().map(|error| error.diagnostic).collect();
    render::findings(Source { name: path, text: &text }, &mistakes);
    None
}

fn text(path: &str) -> Option<String> {
    if path != "-" {
        return potential::read_limited(std::path::Path::new(path), MAX_TABLE);
    }
    let mut text = String::new();
    match std::io::stdin().lock().take(MAX_TABLE as u64).read_to_string(&mut text) {
        Ok(_) => Some(text),
        Err(error) => {
            render::error(&format!("cannot read the standard input: {error}"), None);
            None
        }
    }
}
