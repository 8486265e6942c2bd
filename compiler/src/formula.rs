//! Expressions outside potentials: plain numbers of a few named variables.

use std::ops::Range;

use piola_grammar::{Diagnostic, Span, parse_expression};

use crate::check::elaborate_formula;
use crate::expression::interpret::Interpreter;
use crate::expression::{ExprGraph, Input, NodeId};
use crate::jit::{Code, isa};
use crate::kernel::Level;
use crate::program::Program;
use crate::specialise::CompileError;

/// An expression of a scene file, e.g. `0.1*t` or `X < 0.125 and Y > 0`; no dimensions are checked.
#[derive(Clone, Debug)]
pub struct Formula {
    graph: ExprGraph,
    root: NodeId,
}

impl Formula {
    /// Parses an expression with a number as its value; spans count from the start of `text`.
    ///
    /// # Errors
    /// Every mistake in the text, and a condition where a number is expected.
    pub fn number(text: &str, variables: &[&str]) -> Result<Formula, Vec<Diagnostic>> {
        let help = "choose between numbers with `if .. then .. else ..`";
        Formula::parse(text, variables, false, "a number is expected, this is a condition", help)
    }

    /// Parses an expression with a truth value; spans count from the start of `text`.
    ///
    /// # Errors
    /// Every mistake in the text, and a number where a condition is expected.
    pub fn condition(text: &str, variables: &[&str]) -> Result<Formula, Vec<Diagnostic>> {
        let help = "compare it with something, for instance `X < 0.5`";
        Formula::parse(text, variables, true, "a condition is expected, this is a number", help)
    }

    fn parse(
        text: &str,
        variables: &[&str],
        wanted_truth: bool,
        message: &str,
        help: &str,
    ) -> Result<Formula, Vec<Diagnostic>> {
        let ast = parse_expression(text)?;
        let (graph, root, truth) = elaborate_formula(&ast, variables)?;
        if truth != wanted_truth {
            let span = Span::new(0, text.len());
            return Err(vec![Diagnostic::error("type-mismatch", span, message).help(help)]);
        }
        Ok(Formula { graph, root })
    }

    /// Its number for these values of the variables, in the order in which they were named.
    pub fn value(&self, values: &[f64]) -> f64 {
        self.run(values).number(self.root)
    }

    /// Its truth for these values of the variables, in the order in which they were named.
    pub fn holds(&self, values: &[f64]) -> bool {
        self.run(values).truth(self.root)
    }

    /// A number as machine code, for very many values of the variables, of which there are `n`; the bits are
    /// those of [`Formula::value`].
    ///
    /// # Errors
    /// What the code generator reports; the message is Cranelift's.
    pub fn compiled(&self, n: u8) -> Result<CompiledFormula, CompileError> {
        let inputs: Vec<Input> = (0..n).map(|i| Input::Parameter(i.into())).collect();
        let program = Program { graph: &self.graph, inputs: &inputs, roots: &[self.root] };
        Ok(CompiledFormula(Code::new(
            program,
            &[Range { start: 0, end: 1 }],
            Level::Strict,
            isa(true)?,
        )?))
    }

    fn run(&self, values: &[f64]) -> Interpreter<f64> {
        let mut interpreter = Interpreter::new();
        interpreter.run(&self.graph, |input| match input {
            Input::Parameter(i) => values[usize::from(i)],
            _ => f64::NAN,
        });
        interpreter
    }
}

/// A formula with a number as its value, as machine code.
#[derive(Debug)]
pub struct CompiledFormula(Code);

impl CompiledFormula {
    /// Its numbers; `variables` has an array for each, in the order in which they were named.
    ///
    /// # Panics
    /// If an array is missing or they differ in length: a mistake of the caller, not of a user.
    pub fn values(&self, variables: &[&[f64]], values: &mut [f64]) {
        self.0.run(0, variables, &mut [values]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const XYZT: &[&str] = &["X", "Y", "Z", "t"];

    #[test]
    fn formulas_evaluate() {
        let f = Formula::number("0.1*t + X^2", XYZT).unwrap();
        assert_eq!(f.value(&[2.0, 0.0, 0.0, 1.0]), 0.1 + 4.0);
        let c = Formula::condition("max(abs(X-0.5), abs(Y-0.5)) < 0.2 - 1e-9", XYZT).unwrap();
        assert!(c.holds(&[0.6, 0.4, 0.0, 0.0]));
        assert!(!c.holds(&[0.8, 0.4, 0.0, 0.0]));
    }

    #[test]
    fn machine_code_has_the_same_bits() {
        let texts = [
            "0.1*t + X^2",
            "if X < 0.5 and t > 0.2 then sin(3*X)*exp(-t) else max(Y, Z)^0.3 - t",
            "erf(X - t) + atan2(Y, X)*ln(2 + Z)",
            "3",
        ];
        let array = |seed: usize| (0..257).map(|k| ((k * seed) % 101) as f64 / 100.0).collect();
        let arrays: [Vec<f64>; 4] = [7, 13, 29, 31].map(array);
        for text in texts {
            let formula = Formula::number(text, XYZT).unwrap();
            let mut found = vec![0.0; 257];
            let variables = arrays.each_ref().map(|array| &array[..]);
            formula.compiled(4).unwrap().values(&variables, &mut found);
            for (k, found) in found.into_iter().enumerate() {
                let own = formula.value(&arrays.each_ref().map(|array| array[k]));
                assert_eq!(own.to_bits(), found.to_bits(), "{text} at {k}: {own:e} {found:e}");
            }
        }
    }

    #[test]
    fn wrong_formulas_say_why() {
        let code = |r: Result<Formula, Vec<Diagnostic>>| r.unwrap_err()[0].code;
        assert_eq!(code(Formula::number("X < 1", XYZT)), "type-mismatch");
        assert_eq!(code(Formula::condition("X", XYZT)), "type-mismatch");
        assert_eq!(code(Formula::number("0.1*T", XYZT)), "unknown-name");
        assert_eq!(code(Formula::number("0.1*", XYZT)), "syntax");
    }
}
