//! Which subexpression loses digits: the one whose operands are right, and whose value is not.

use piola_grammar::Span;

use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::expression::{ExprGraph, Input, Node, NodeId, Operator};
use crate::model::Model;
use crate::print;
use crate::specialise::ScalarEnergy;

use super::UNIT_ROUNDOFF;
use super::sample::Point;

/// Binary digits of the values that others are held against: enough for `1 - tanh(x)^2` at 300.
const BITS: usize = 1408;

/// What is right beyond any doubt.
pub(crate) type Exact = Precise<BITS>;

/// An operand with so much of the error of an expression is where the error comes from.
const PASSED_ON: f64 = 1.0 / 16.0;

/// A subexpression that loses digits.
#[derive(Clone, Debug, PartialEq)]
pub struct Cause {
    /// Of psi, psi' or psi'': 0, 1, 2.
    pub order: usize,
    /// As it is evaluated, in the piola language.
    pub expression: String,
    /// Where it is a sum or a difference: how many decimal digits of its terms cancel.
    pub cancelled: Option<f64>,
    /// Whether it overflows, or is made of what does: its true value is a number, and what is found is none.
    pub overflows: bool,
    /// What it is in the text, where that is known.
    pub stated: Option<Stated>,
}

/// What a subexpression is in the text of a potential.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stated {
    /// Where it stands.
    pub span: Span,
    /// What of it.
    pub part: Part,
}

/// What a subexpression is of something in a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// All of it, but for a power of two.
    Whole,
    /// A component of a tensor.
    Component,
    /// Made of it by differentiation.
    Derivative,
}

/// The nodes of a graph in doubles and in numbers of 1,408 bits, from the same inputs.
pub(super) struct Compared<'a> {
    graph: &'a ExprGraph,
    rounded: Interpreter<f64>,
    exact: Interpreter<Exact>,
}

impl<'a> Compared<'a> {
    pub(super) fn new(
        graph: &'a ExprGraph,
        rounded: impl Fn(Input) -> f64,
        exact: impl Fn(Input) -> Exact,
    ) -> Compared<'a> {
        let mut compared =
            Compared { graph, rounded: Interpreter::new(), exact: Interpreter::new() };
        compared.rounded.run(graph, rounded);
        compared.exact.run(graph, exact);
        compared
    }

    pub(super) fn truth(&self, node: NodeId) -> f64 {
        self.exact.number(node).rounded()[0]
    }

    /// How far off a value is; infinite where it is no number.
    pub(super) fn difference(&self, node: NodeId) -> f64 {
        let (found, truth) = (self.rounded.number(node), self.truth(node));
        let difference = (found - truth).abs();
        if found == truth || !truth.is_finite() {
            0.0
        } else if difference.is_nan() {
            f64::INFINITY
        } else {
            difference
        }
    }

    /// The error in `u` of the true value; 0 where that is no number.
    pub(super) fn error(&self, node: NodeId) -> f64 {
        match self.difference(node) {
            0.0 => 0.0,
            difference => difference / self.truth(node).abs() / UNIT_ROUNDOFF,
        }
    }

    /// The operand that hands down the error of a node; `None` where that arises. Of the terms of a sum
    /// it is the one that is farthest off: one that is nearly zero has few digits, and takes none.
    fn passing_on(&self, node: NodeId) -> Option<NodeId> {
        let is_sum = is_sum(self.graph, node);
        let size = |x: NodeId| if is_sum { self.difference(x) } else { self.error(x) };
        let passed_on = PASSED_ON * self.error(node).min(f64::MAX);
        let operands = self.operands(node).into_iter();
        let largest = operands.max_by(|x, y| size(*x).total_cmp(&size(*y)));
        largest.filter(|x| self.error(*x) > passed_on.max(1.0))
    }

    /// The numbers that an expression takes: of a choice the one that is taken.
    fn operands(&self, node: NodeId) -> Vec<NodeId> {
        match self.graph[node] {
            Node::Select(condition, x, y) => {
                vec![if self.rounded.truth(condition) { x } else { y }]
            }
            node => node.operands().collect(),
        }
    }

    /// How many decimal digits of the terms of a sum or a difference cancel.
    fn cancelled(&self, node: NodeId) -> Option<f64> {
        let size = |x: NodeId| self.truth(x).abs();
        let largest = self.graph[node].operands().map(size).fold(0.0, f64::max);
        is_sum(self.graph, node).then(|| libm::log10(largest / size(node)))
    }

    /// How far off a sum or difference is whose terms are right and cancel; 0 for any other node.
    pub(super) fn error_made(&self, node: NodeId) -> f64 {
        let cancels = self.cancelled(node).is_some_and(|digits| digits >= 1.0);
        if cancels && self.passing_on(node).is_none() { self.error(node) } else { 0.0 }
    }

    /// Where a root loses its digits: down as long as an operand is about as far off as what it is an
    /// operand of. `None` where numbers of 1,408 bits know no better.
    pub(super) fn cause(
        &self,
        model: &Model,
        order: usize,
        root: NodeId,
    ) -> Option<(NodeId, Cause)> {
        if self.exact.number(root).doubtful() || !self.truth(root).is_finite() {
            return None;
        }
        let mut node = root;
        while let Some(operand) = self.passing_on(node) {
            node = operand;
        }
        let cause = Cause {
            order,
            expression: print::quoted(model, self.graph, node),
            cancelled: self.cancelled(node),
            overflows: !self.rounded.number(node).is_finite(),
            stated: None,
        };
        Some((node, cause))
    }
}

fn is_sum(graph: &ExprGraph, node: NodeId) -> bool {
    matches!(graph[node], Node::Binary(Operator::Add | Operator::Subtract, ..))
}

/// Where psi, psi' or psi'' (`order` 0, 1, 2) as evaluated loses its digits at this point.
pub(crate) fn cause(
    model: &Model,
    energy: &ScalarEnergy,
    order: usize,
    point: Point,
) -> Option<Cause> {
    let Point { measure, reference } = point;
    let [m, rest] = [measure, reference].map(Precise::constant);
    let change = Precise::binary(Operator::Subtract, m.clone(), rest.clone());
    let change = Precise::binary(Operator::Divide, change, rest.clone());
    let (mut rounded, mut exact) = (Interpreter::<f64>::new(), Interpreter::<Exact>::new());
    energy.run(&mut rounded, &measure, &reference, &point.change());
    energy.run(&mut exact, &m, &rest, &change);
    let compared = Compared { graph: &energy.graph, rounded, exact };
    compared.cause(model, order, energy.roots[order]).map(|(_, cause)| cause)
}
