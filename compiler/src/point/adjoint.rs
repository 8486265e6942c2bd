//! Derivatives by several variables: the gradient by one sweep from the energy back to the variables,
//! its change in a direction by one sweep forward. Neither grows with the number of variables as
//! derivatives taken one by one would.

use crate::differentiate::{Derivative, binary, derivative_of, power_constant, unary};
use crate::expression::{Input, Node, NodeId, Operator, TooManyNodes};
use crate::simplify::Simplifier;

/// The derivatives of `root` by each of the variables; a variable and its change from rest are one.
pub(super) fn gradient(
    graph: &mut Simplifier,
    root: NodeId,
    variables: &[u8],
) -> Result<Vec<NodeId>, TooManyNodes> {
    let varies = varies(graph, root);
    let mut adjoint: Vec<Option<NodeId>> = vec![None; varies.len()];
    adjoint[root.0 as usize] = Some(graph.number(1.0)?);
    let mut gradient: Vec<Option<NodeId>> = vec![None; variables.len()];
    for index in (0..varies.len()).rev().filter(|index| varies[*index]) {
        let Some(outer) = adjoint[index] else { continue };
        let id = NodeId(index as u32);
        if let Node::Input(Input::Variable(k) | Input::VariableChange(k)) = graph.graph()[id] {
            let place = variables.iter().position(|known| *known == k);
            let place = place.expect("the tensors of a file have the components of its dimension");
            gradient[place] = Some(added(graph, gradient[place], outer)?);
        }
        for (operand, part) in parts(graph, id, outer)? {
            let known = adjoint[operand.0 as usize];
            if varies[operand.0 as usize] {
                adjoint[operand.0 as usize] = Some(added(graph, known, part)?);
            }
        }
    }
    gradient.into_iter().map(|part| part.map_or_else(|| graph.number(0.0), Ok)).collect()
}

/// What the roots change by when every variable changes by its direction.
pub(super) fn product(
    graph: &mut Simplifier,
    roots: &[NodeId],
) -> Result<Vec<NodeId>, TooManyNodes> {
    let n = roots.iter().map(|root| root.0 as usize + 1).max().unwrap_or(0);
    let needed = graph.graph().reachable(roots);
    let mut known: Vec<Option<NodeId>> = vec![None; n];
    for index in (0..n).filter(|index| needed[*index]) {
        known[index] = derivative_of(graph, NodeId(index as u32), &known, &direction)?;
    }
    let of = |root: &NodeId| known[root.0 as usize];
    roots.iter().map(|root| of(root).map_or_else(|| graph.number(0.0), Ok)).collect()
}

fn direction(graph: &mut Simplifier, input: Input) -> Derivative {
    match input {
        Input::Variable(k) | Input::VariableChange(k) => graph.input(Input::Direction(k)).map(Some),
        _ => Ok(None),
    }
}

/// Which of the nodes that the root needs depend on a variable.
fn varies(graph: &Simplifier, root: NodeId) -> Vec<bool> {
    let n = root.0 as usize + 1;
    let needed = graph.graph().reachable(&[root]);
    let mut varies = vec![false; n];
    for (id, node) in graph.graph().nodes().take(n) {
        varies[id.0 as usize] = needed[id.0 as usize]
            && match node {
                Node::Input(input) => {
                    matches!(input, Input::Variable(_) | Input::VariableChange(_))
                }
                _ => node.operands().any(|x| varies[x.0 as usize]),
            };
    }
    varies
}

/// The operands of a node with `outer` times the node's derivative by each: the rules for one
/// variable, because they are linear in the derivative of the operand.
fn parts(
    graph: &mut Simplifier,
    id: NodeId,
    outer: NodeId,
) -> Result<Vec<(NodeId, NodeId)>, TooManyNodes> {
    let mut parts = Vec::new();
    let mut push = |operand: NodeId, part: Option<NodeId>| {
        parts.extend(part.map(|part| (operand, part)));
    };
    match graph.graph()[id] {
        Node::Unary(function, x) => push(x, unary(graph, function, id, x, outer)?),
        Node::PowerConstant(x, bits) => {
            push(x, power_constant(graph, x, outer, f64::from_bits(bits))?);
        }
        Node::Binary(Operator::Multiply, x, y) if x == y => {
            // Twice the same operand: one product less.
            let two = graph.number(2.0)?;
            let twice = graph.multiply(two, x)?;
            push(x, Some(graph.multiply(twice, outer)?));
        }
        Node::Binary(operator, x, y) => {
            push(x, binary(graph, operator, id, (x, Some(outer)), (y, None))?);
            push(y, binary(graph, operator, id, (x, None), (y, Some(outer)))?);
        }
        Node::Select(c, x, y) => {
            let zero = graph.number(0.0)?;
            push(x, Some(graph.make(Node::Select(c, outer, zero))?));
            push(y, Some(graph.make(Node::Select(c, zero, outer))?));
        }
        _ => {}
    }
    Ok(parts)
}

fn added(
    graph: &mut Simplifier,
    sum: Option<NodeId>,
    part: NodeId,
) -> Result<NodeId, TooManyNodes> {
    match sum {
        Some(sum) => graph.add(sum, part),
        None => Ok(part),
    }
}
