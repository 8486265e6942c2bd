//! Forms that matter for values alone: derivatives are taken of what was written, where they are
//! simpler.

use super::monomial;
use crate::expression::{Comparison, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;
use crate::simplify::Simplifier;

/// Up to here `log1p(e)` is closer to the truth than `ln(l/L)`: beyond, `e` has lost what is left of
/// a strongly compressed bond.
const NEAR: f64 = 0.5;

type Made = Result<NodeId, TooManyNodes>;
type Named = Result<Option<(&'static str, NodeId)>, TooManyNodes>;

/// The better form of a node, made of operands that have theirs already.
pub(super) fn value(graph: &mut Simplifier, node: Node, place: &[NodeId]) -> Named {
    let at = |x: NodeId| place[x.0 as usize];
    match node {
        Node::Unary(Function::Log1p, x) => logarithm_of_square(graph, x, &at),
        Node::Unary(Function::Log1pmx, x) => match graph.graph()[x] {
            Node::Input(Input::Change(measure)) => {
                let made = logarithm_less_change(graph, measure, x)?;
                Ok(Some(("logarithm_of_change", made)))
            }
            _ => Ok(None),
        },
        Node::Binary(Operator::Subtract, x, y) => difference(graph, x, y, &at),
        _ => Ok(None),
    }
}

/// `abs(x) < limit`
pub(super) fn near(graph: &mut Simplifier, x: NodeId, limit: f64) -> Made {
    let size = graph.unary(Function::Abs, x)?;
    let limit = graph.number(limit)?;
    graph.make(Node::Compare(Comparison::Less, size, limit))
}

/// `ln(l/L)`
pub(super) fn logarithm(graph: &mut Simplifier, measure: Measure) -> Made {
    let change = graph.input(Input::Change(measure))?;
    let stretch = monomial::stretch(graph, measure)?;
    let near = near(graph, change, NEAR)?;
    let series = graph.unary(Function::Log1p, change)?;
    let plain = graph.unary(Function::Ln, stretch)?;
    graph.make(Node::Select(near, series, plain))
}

/// `ln(l/L) - e`
fn logarithm_less_change(graph: &mut Simplifier, measure: Measure, change: NodeId) -> Made {
    let stretch = monomial::stretch(graph, measure)?;
    let logarithm = graph.unary(Function::Ln, stretch)?;
    let far = graph.subtract(logarithm, change)?;
    let series = graph.unary(Function::Log1pmx, change)?;
    let near = near(graph, change, NEAR)?;
    graph.make(Node::Select(near, series, far))
}

/// `log1p(-y^2)`
fn logarithm_of_square(graph: &mut Simplifier, x: NodeId, at: &impl Fn(NodeId) -> NodeId) -> Named {
    let Node::Unary(Function::Negate, square) = graph.graph()[x] else { return Ok(None) };
    let Some(y) = root_of(graph, square)? else { return Ok(None) };
    let one = graph.number(1.0)?;
    let product = product_of_squares(graph, one, at(y))?;
    let plain = graph.unary(Function::Ln, product)?;
    let series = graph.unary(Function::Log1p, at(x))?;
    let near = near(graph, at(square), NEAR)?;
    let made = graph.make(Node::Select(near, series, plain))?;
    Ok(Some(("logarithm_of_square", made)))
}

fn difference(
    graph: &mut Simplifier,
    x: NodeId,
    y: NodeId,
    at: &impl Fn(NodeId) -> NodeId,
) -> Named {
    match (graph.graph()[x], graph.graph()[y]) {
        (Node::Unary(Function::Sqrt, a), Node::Number(_)) => {
            difference_of_roots(graph, at(x), at(a), at(y))
        }
        _ => difference_of_squares(graph, x, y, at),
    }
}

/// `sqrt(y) - c = (y - c^2)/(sqrt(y) + c)`
fn difference_of_roots(graph: &mut Simplifier, root: NodeId, inside: NodeId, c: NodeId) -> Named {
    let value = graph.graph().as_number(c).unwrap_or(f64::NAN);
    let square = value * value;
    if !(value > 0.0 && square.is_normal() && libm::fma(value, value, -square) == 0.0) {
        return Ok(None);
    }
    let square = graph.number(square)?;
    let difference = graph.subtract(inside, square)?;
    let sum = graph.add(root, c)?;
    let made = graph.divide(difference, sum)?;
    Ok(Some(("difference_of_roots", made)))
}

/// `y^2 - z^2 = (y - z)*(y + z)`; a number counts where it is an exact square.
fn difference_of_squares(
    graph: &mut Simplifier,
    x: NodeId,
    y: NodeId,
    at: &impl Fn(NodeId) -> NodeId,
) -> Named {
    let (Some(x), Some(y)) = (root_of(graph, x)?, root_of(graph, y)?) else { return Ok(None) };
    // A number that was not there before has no place to look up.
    let at = |graph: &Simplifier, id: NodeId| {
        if graph.graph().as_number(id).is_some() { id } else { at(id) }
    };
    let (x, y) = (at(graph, x), at(graph, y));
    let made = product_of_squares(graph, x, y)?;
    Ok(Some(("difference_of_squares", made)))
}

/// `(x - y)*(x + y)`, with the stretch in the place of `1 + e`.
fn product_of_squares(graph: &mut Simplifier, x: NodeId, y: NodeId) -> Made {
    let difference = graph.subtract(x, y)?;
    let sum = match graph.graph()[y] {
        Node::Input(Input::Change(m)) if graph.graph().as_number(x) == Some(1.0) => {
            monomial::stretch(graph, m)?
        }
        _ => graph.add(x, y)?,
    };
    graph.multiply(difference, sum)
}

/// `y` of `y^2`, also of a number that is an exact square.
fn root_of(graph: &mut Simplifier, id: NodeId) -> Result<Option<NodeId>, TooManyNodes> {
    match graph.graph()[id] {
        Node::PowerConstant(x, c) if f64::from_bits(c) == 2.0 => Ok(Some(x)),
        Node::Number(bits) => {
            let value = f64::from_bits(bits);
            let root = value.sqrt();
            let exact = value.is_normal() && value > 0.0 && libm::fma(root, root, -value) == 0.0;
            if exact { graph.number(root).map(Some) } else { Ok(None) }
        }
        _ => Ok(None),
    }
}
