//! Evaluation of a graph over any number type: the reading all others are compared with.

use super::number::Number;
use super::{ExprGraph, Function, Input, Node, NodeId, Operator};

/// A value during evaluation.
#[derive(Clone, Debug)]
enum Value<N> {
    Number(N),
    Truth(bool),
}

/// Working memory of an evaluation, reusable between evaluations.
#[derive(Clone, Debug)]
pub struct Interpreter<N> {
    values: Vec<Value<N>>,
}

impl<N: Number> Interpreter<N> {
    /// Room for a graph of any size.
    pub fn new() -> Self {
        Interpreter { values: Vec::new() }
    }

    /// Evaluates every node of the graph; read results with [`Self::number`] and [`Self::truth`].
    pub fn run(&mut self, graph: &ExprGraph, input: impl Fn(Input) -> N) {
        self.values.clear();
        self.values.reserve(graph.len());
        for (_, node) in graph.nodes() {
            let value = self.step(node, &input);
            self.values.push(value);
        }
    }

    /// The number at a node of the graph last run; NaN where it holds a truth value.
    pub fn number(&self, id: NodeId) -> N {
        match &self.values[id.0 as usize] {
            Value::Number(x) => x.clone(),
            Value::Truth(_) => N::constant(f64::NAN),
        }
    }

    /// The truth value at a node of the graph last run; false where it holds a number.
    pub fn truth(&self, id: NodeId) -> bool {
        matches!(self.values[id.0 as usize], Value::Truth(true))
    }

    fn step(&self, node: Node, input: &impl Fn(Input) -> N) -> Value<N> {
        let number = |id| self.number(id);
        let truth = |id| self.truth(id);
        match node {
            Node::Number(bits) => Value::Number(N::constant(f64::from_bits(bits))),
            Node::Truth(holds) => Value::Truth(holds),
            Node::Input(name) => Value::Number(input(name)),
            Node::Unary(function, x) => Value::Number(N::unary(function, number(x))),
            Node::PowerConstant(x, bits) => {
                Value::Number(N::power_constant(number(x), f64::from_bits(bits)))
            }
            Node::Binary(operator, x, y) => {
                Value::Number(N::binary(operator, number(x), number(y)))
            }
            Node::Compare(comparison, x, y) => {
                Value::Truth(comparison.holds(number(x).value(), number(y).value()))
            }
            Node::And(x, y) => Value::Truth(truth(x) && truth(y)),
            Node::Or(x, y) => Value::Truth(truth(x) || truth(y)),
            Node::Not(x) => Value::Truth(!truth(x)),
            Node::Select(c, x, y) => {
                let taken = if truth(c) { x } else { y };
                self.values[taken.0 as usize].clone()
            }
            Node::Strain(x, bits) => Value::Number(strain(number(x), f64::from_bits(bits))),
        }
    }
}

/// A strain by its definition.
fn strain<N: Number>(stretch: N, order: f64) -> N {
    if order == 0.0 {
        return N::unary(Function::Ln, stretch);
    }
    let power = N::power_constant(stretch, order);
    let difference = N::binary(Operator::Subtract, power, N::constant(1.0));
    N::binary(Operator::Divide, difference, N::constant(order))
}

impl<N: Number> Default for Interpreter<N> {
    fn default() -> Self {
        Self::new()
    }
}
