//! LaTeX read as a reader of papers reads it has the value of what was printed.

use super::latex::Latex;
use super::{Names, lines};
use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator};
use crate::measure::Measure;
use crate::test_support::model;

/// Reads the value of a formula from left to right.
struct Reader<'a> {
    rest: &'a str,
    /// `l` and `L`.
    at: [f64; 2],
}

impl Reader<'_> {
    fn take(&mut self, start: &str) -> bool {
        self.rest = self.rest.trim_start_matches([' ', '\n']);
        let found = self.rest.strip_prefix(start);
        self.rest = found.unwrap_or(self.rest);
        found.is_some()
    }

    fn expect(&mut self, start: &str) {
        assert!(self.take(start), "`{start}` is missing before `{}`", self.rest);
    }

    /// What stands between braces or brackets.
    fn inside(&mut self, open: &str, close: &str) -> f64 {
        self.expect(open);
        let value = self.sum();
        self.expect(close);
        value
    }

    fn sum(&mut self) -> f64 {
        let mut sum = self.product();
        loop {
            let operator = match () {
                () if self.take("+") => Operator::Add,
                () if self.take("-") => Operator::Subtract,
                () => return sum,
            };
            sum = f64::binary(operator, sum, self.product());
        }
    }

    /// A minus before a product is that of its first factor.
    fn product(&mut self) -> f64 {
        let mut product = self.factor();
        while self.take(r"\cdot") || self.take(r"\,") {
            product = f64::binary(Operator::Multiply, product, self.factor());
        }
        product
    }

    /// A minus before a power is that of the power.
    fn factor(&mut self) -> f64 {
        if self.take("-") {
            return f64::unary(Function::Negate, self.factor());
        }
        let base = self.atom();
        if !self.take("^") {
            return base;
        }
        let is_constant = !self.rest.starts_with("{l") && !self.rest.starts_with("{L");
        let exponent = self.inside("{", "}");
        if is_constant {
            f64::power_constant(base, exponent)
        } else {
            f64::binary(Operator::Power, base, exponent)
        }
    }

    fn atom(&mut self) -> f64 {
        for (name, function) in [(r"\ln", Function::Ln), (r"\arctan", Function::Atan)] {
            if self.take(name) {
                return f64::unary(function, self.inside(r"\left(", r"\right)"));
            }
        }
        for (name, operator) in [(r"\min", Operator::Min), (r"\max", Operator::Max)] {
            if self.take(name) {
                self.expect(r"\left(");
                let first = self.sum();
                self.expect(",");
                let second = self.sum();
                self.expect(r"\right)");
                return f64::binary(operator, first, second);
            }
        }
        match () {
            () if self.take(r"\frac") => {
                let above = self.inside("{", "}");
                f64::binary(Operator::Divide, above, self.inside("{", "}"))
            }
            () if self.take(r"\sqrt") => f64::unary(Function::Sqrt, self.inside("{", "}")),
            () if self.take(r"\left|") => {
                let x = self.sum();
                self.expect(r"\right|");
                f64::unary(Function::Abs, x)
            }
            () if self.take(r"\left(") => {
                let x = self.sum();
                self.expect(r"\right)");
                x
            }
            () if self.take("l") => self.at[0],
            () if self.take("L") => self.at[1],
            () => {
                let is_digit = |c: char| c.is_ascii_digit() || c == '.';
                let end = self.rest.find(|c| !is_digit(c)).unwrap_or(self.rest.len());
                let (number, rest) = self.rest.split_at(end);
                self.rest = rest;
                number.parse().unwrap_or_else(|_| panic!("no number before `{rest}`"))
            }
        }
    }
}

/// A graph with all shapes of three operations, one in another, of `l`, `L` and a number.
fn shapes() -> (ExprGraph, Vec<NodeId>) {
    let mut graph = ExprGraph::new();
    let l = Input::Current(Measure::Length);
    let leaves = [Node::Input(l), Node::Input(Input::Reference(Measure::Length))];
    let leaves = [leaves[0], leaves[1], Node::number(1.5), Node::number(-2.0)];
    let leaves = leaves.map(|leaf| graph.intern(leaf).unwrap());
    let operations = |x: NodeId, y: NodeId| {
        use Operator::{Add, Divide, Max, Min, Multiply, Subtract};
        let binary = [Add, Subtract, Multiply, Divide, Min, Max].map(|o| Node::Binary(o, x, y));
        use Function::{Abs, Atan, Ln, Negate, Sqrt};
        let unary = [Negate, Abs, Ln, Sqrt, Atan].map(|f| Node::Unary(f, x));
        let powers = [2.0, -1.0, 0.5].map(|c: f64| Node::PowerConstant(x, c.to_bits()));
        [&binary[..], &unary[..], &powers[..], &[Node::Binary(Operator::Power, x, leaves[0])]]
            .concat()
    };
    let mut level = vec![leaves[0]];
    let mut all = Vec::new();
    for _ in 0..3 {
        let mut next = Vec::new();
        for &x in &level {
            for (one, other) in [(x, leaves[1]), (leaves[2], x), (x, leaves[3]), (leaves[3], x)] {
                next.extend(
                    operations(one, other).into_iter().map(|node| graph.intern(node).unwrap()),
                );
            }
        }
        next.sort_unstable();
        next.dedup();
        all.extend(&next);
        // All of the first go on, and some of the second.
        level = next.iter().copied().step_by(1 + next.len() / 100).collect();
    }
    (graph, all)
}

#[test]
fn latex_means_what_it_was_printed_from() {
    let model = model("potential p\npsi(l) = l/L - ln(l/L)\n");
    let (graph, roots) = shapes();
    let notation = Latex { names: Names { model: &model } };
    let at = [0.7, 1.3];
    let mut interpreter = Interpreter::<f64>::new();
    interpreter.run(&graph, |input| match input {
        Input::Current(_) => at[0],
        _ => at[1],
    });
    assert!(roots.len() > 1500, "{}", roots.len());
    for root in roots {
        let printed = lines(&graph, &[(String::new(), root)], &notation);
        // One formula without parts of its own.
        let [(_, text)] = &printed[..] else { continue };
        let mut reader = Reader { rest: text, at };
        let (found, expected) = (reader.sum(), interpreter.number(root));
        assert_eq!(reader.rest.trim(), "", "{text}");
        let same = found.to_bits() == expected.to_bits() || (found.is_nan() && expected.is_nan());
        assert!(same, "{text}: {found} {expected}");
    }
}

/// What messages quote is written out, and has names only for what does not fit into a line.
#[test]
fn quoted_expressions_name_nothing_that_fits_into_a_line() {
    let text = "potential p\ny = sin(l/L)*exp(l - L)\npsi(l) = y^2 + 1/(1 + y)\n";
    let short = model(text);
    let variant = short.variant(2).unwrap();
    let quoted = super::quoted(&short, &variant.graph, variant.energies[0].root);
    assert_eq!(quoted, "(sin(l/L)*exp(l - L))^2 + 1/(1 + sin(l/L)*exp(l - L))");
    let long: String = (0..12).map(|k| format!("y{} = y{k}*(y{k} + l)\n", k + 1)).collect();
    let text = format!("potential p\ny0 = sin(l/L)\n{long}psi(l) = y12\n");
    let model = model(&text);
    let variant = model.variant(2).unwrap();
    let quoted = super::quoted(&model, &variant.graph, variant.energies[0].root);
    assert!(quoted.contains(", where t1 = ") && quoted.len() < 6000, "{quoted}");
}
