//! Expressions outside potentials: plain numbers of a few named variables.

use piola_grammar::Diagnostic;

/// An expression of a scene file, e.g. `0.1*t` or `X < 0.125 and Y > 0`; no dimensions are checked.
#[derive(Clone, Debug)]
pub struct Formula {}

impl Formula {
    /// Parses an expression with a number as its value; spans count from the start of `text`.
    pub fn number(text: &str, variables: &[&str]) -> Result<Formula, Vec<Diagnostic>> {
        let _ = (text, variables);
        Ok(Formula {})
    }

    /// Parses an expression with a truth value; spans count from the start of `text`.
    pub fn condition(text: &str, variables: &[&str]) -> Result<Formula, Vec<Diagnostic>> {
        let _ = (text, variables);
        Ok(Formula {})
    }

    /// Its number for these values of the variables, in the order in which they were named.
    pub fn value(&self, values: &[f64]) -> f64 {
        let _ = values;
        0.0
    }

    /// Its truth for these values of the variables, in the order in which they were named.
    pub fn holds(&self, values: &[f64]) -> bool {
        let _ = values;
        false
    }
}
