//! Which subexpression loses digits: the one whose operands are right, and whose value is not.

use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::expression::{ExprGraph, Node, NodeId, Operator};
use crate::model::Model;
use crate::print;
use crate::specialise::ScalarEnergy;

use super::UNIT_ROUNDOFF;
use super::sample::Point;

/// Binary digits of the values that others are held against: enough for `1 - tanh(x)^2` at 300.
const BITS: usize = 1408;

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
}

/// Where psi, psi' or psi'' (`order` 0, 1, 2) as evaluated loses its digits at this point: from the
/// root down as long as an operand is about as far off as what it is an operand of. `None` where
/// numbers of 1,408 bits know no better.
pub(crate) fn cause(
    model: &Model,
    energy: &ScalarEnergy,
    order: usize,
    point: Point,
) -> Option<Cause> {
    let Point { measure, reference } = point;
    let mut rounded = Interpreter::<f64>::new();
    energy.run(&mut rounded, &measure, &reference, &point.change());
    let mut exact = Interpreter::<Precise<BITS>>::new();
    let [m, rest] = [measure, reference].map(Precise::constant);
    let change = Precise::binary(Operator::Subtract, m.clone(), rest.clone());
    let change = Precise::binary(Operator::Divide, change, rest.clone());
    energy.run(&mut exact, &m, &rest, &change);
    let truth = |node: NodeId| exact.number(node).rounded()[0];
    let error = |node: NodeId| relative(rounded.number(node), truth(node));

    let mut node = energy.roots[order];
    if exact.number(node).doubtful() || !truth(node).is_finite() {
        return None;
    }
    loop {
        let passed_on = PASSED_ON * error(node).min(f64::MAX);
        let operands = numbers(&energy.graph, node, &rounded).into_iter();
        let largest = operands.max_by(|x, y| error(*x).total_cmp(&error(*y)));
        match largest.filter(|x| error(*x) > passed_on.max(1.0)) {
            Some(operand) => node = operand,
            None => break,
        }
    }
    let cancelled = match energy.graph[node] {
        Node::Binary(Operator::Add | Operator::Subtract, x, y) => {
            let largest = truth(x).abs().max(truth(y).abs());
            Some(libm::log10(largest / truth(node).abs()))
        }
        _ => None,
    };
    let expression = print::expression(model, &energy.graph, node);
    let overflows = !rounded.number(node).is_finite();
    Some(Cause { order, expression, cancelled, overflows })
}

/// The numbers that an expression takes: of a choice the one that is taken.
fn numbers(graph: &ExprGraph, node: NodeId, rounded: &Interpreter<f64>) -> Vec<NodeId> {
    match graph[node] {
        Node::Select(condition, x, y) => vec![if rounded.truth(condition) { x } else { y }],
        node => node.operands().collect(),
    }
}

/// The error of a value in `u` of the true one; 0 where that is no number.
fn relative(found: f64, truth: f64) -> f64 {
    if found == truth || !truth.is_finite() {
        return 0.0;
    }
    let error = (found - truth).abs() / truth.abs() / UNIT_ROUNDOFF;
    if error.is_nan() { f64::INFINITY } else { error }
}
