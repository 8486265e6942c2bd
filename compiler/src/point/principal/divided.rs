//! Divided differences `(f(a) - f(b))/(a - b)` of expressions, rule by rule as derivatives are taken.
//!
//! No rule subtracts values of `f`, so the digits do not depend on how near `a` and `b` are; where they
//! are equal the divided difference is the derivative.

use crate::expression::{
    Comparison, ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes,
};
use crate::simplify::Simplifier;

type Made = Result<NodeId, TooManyNodes>;

/// Largest whole exponent that is divided by products.
const LARGEST_EXPONENT: f64 = 16.0;

/// A node at both ends with its divided difference; none where both are the same whatever the ends.
#[derive(Clone, Copy)]
struct Ends {
    a: NodeId,
    b: NodeId,
    slope: Option<NodeId>,
}

/// The divided difference of the function `root` of `Stretch(0)` between two nodes of the target.
pub(super) fn divided(
    target: &mut Simplifier,
    source: &ExprGraph,
    root: NodeId,
    (a, b): (NodeId, NodeId),
) -> Made {
    let needed = source.reachable(&[root]);
    let one = target.number(1.0)?;
    let mut known: Vec<Option<Ends>> = vec![None; source.len()];
    for (id, node) in source.nodes().filter(|(id, _)| needed[id.0 as usize]) {
        let of = |x: NodeId| known[x.0 as usize].expect("operands stand before users");
        let made = match node {
            Node::Input(Input::Stretch(_)) => Ends { a, b, slope: Some(one) },
            _ => {
                let at_a = target.make(node.map_operands(|x| of(x).a))?;
                let at_b = target.make(node.map_operands(|x| of(x).b))?;
                let ends = Ends { a: at_a, b: at_b, slope: None };
                if node.operands().all(|x| of(x).slope.is_none()) {
                    ends
                } else {
                    let slope = slope(target, node, ends, (a, b), &of)?;
                    Ends { slope: Some(slope), ..ends }
                }
            }
        };
        known[id.0 as usize] = Some(made);
    }
    match known[root.0 as usize].and_then(|ends| ends.slope) {
        Some(slope) => Ok(slope),
        None => target.number(0.0),
    }
}

/// The divided difference of a node from those of its operands.
fn slope(
    graph: &mut Simplifier,
    node: Node,
    ends: Ends,
    (a, b): (NodeId, NodeId),
    of: &impl Fn(NodeId) -> Ends,
) -> Made {
    match node {
        Node::Unary(Function::Negate, x) => {
            let inner = inner(graph, of(x))?;
            graph.negate(inner)
        }
        Node::Unary(function, x) if of(x).slope.is_some() => {
            if let Some(outer) = of_function(graph, function, of(x))? {
                let inner = inner(graph, of(x))?;
                return graph.multiply(outer, inner);
            }
            quotient(graph, ends, (a, b))
        }
        Node::PowerConstant(x, bits) => {
            let exponent = f64::from_bits(bits);
            let outer = if exponent.fract() == 0.0 && exponent.abs() <= LARGEST_EXPONENT {
                of_whole_power(graph, of(x), exponent)?
            } else {
                let exponent = graph.number(exponent)?;
                of_power(graph, of(x), exponent)?
            };
            let inner = inner(graph, of(x))?;
            graph.multiply(outer, inner)
        }
        Node::Binary(operator, x, y) => match (operator, of(x), of(y)) {
            (Operator::Add, x, y) => {
                let (x, y) = (inner(graph, x)?, inner(graph, y)?);
                graph.add(x, y)
            }
            (Operator::Subtract, x, y) => {
                let (x, y) = (inner(graph, x)?, inner(graph, y)?);
                graph.subtract(x, y)
            }
            (Operator::Multiply, x, y) => of_product(graph, x, y),
            (Operator::Divide, x, y) => {
                // x_a - x_b = (q_a - q_b)*y_a + q_b*(y_a - y_b)
                let (p, q) = (inner(graph, x)?, inner(graph, y)?);
                let part = graph.multiply(ends.b, q)?;
                let difference = graph.subtract(p, part)?;
                graph.divide(difference, y.a)
            }
            (Operator::Power, x, Ends { a: exponent, slope: None, .. }) => {
                let outer = of_power(graph, x, exponent)?;
                let inner = inner(graph, x)?;
                graph.multiply(outer, inner)
            }
            _ => quotient(graph, ends, (a, b)),
        },
        // Functions of `U` hold nothing else.
        _ => quotient(graph, ends, (a, b)),
    }
}

fn inner(graph: &mut Simplifier, ends: Ends) -> Made {
    ends.slope.map_or_else(|| graph.number(0.0), Ok)
}

/// By its definition.
fn quotient(graph: &mut Simplifier, ends: Ends, (a, b): (NodeId, NodeId)) -> Made {
    let difference = graph.subtract(ends.a, ends.b)?;
    let apart = graph.subtract(a, b)?;
    graph.divide(difference, apart)
}

/// `x_a*y_a - x_b*y_b = ((x_a - x_b)*(y_a + y_b) + (x_a + x_b)*(y_a - y_b))/2`, which is the same with
/// the ends exchanged.
fn of_product(graph: &mut Simplifier, x: Ends, y: Ends) -> Made {
    let (p, q) = (inner(graph, x)?, inner(graph, y)?);
    if x.slope.is_none() {
        return graph.multiply(x.a, q);
    }
    if y.slope.is_none() {
        return graph.multiply(y.a, p);
    }
    let (sum_x, sum_y) = (graph.add(x.a, x.b)?, graph.add(y.a, y.b)?);
    let (first, second) = (graph.multiply(p, sum_y)?, graph.multiply(sum_x, q)?);
    let sum = graph.add(first, second)?;
    let two = graph.number(2.0)?;
    graph.divide(sum, two)
}

/// `(f(p) - f(q))/(p - q)`, where there is a rule for it.
fn of_function(
    graph: &mut Simplifier,
    function: Function,
    Ends { a: p, b: q, .. }: Ends,
) -> Result<Option<NodeId>, TooManyNodes> {
    let one = graph.number(1.0)?;
    Ok(Some(match function {
        Function::Sqrt => {
            let (p, q) = (graph.unary(function, p)?, graph.unary(function, q)?);
            let sum = graph.add(p, q)?;
            graph.divide(one, sum)?
        }
        Function::Ln => of_logarithm(graph, p, q)?,
        Function::Log1p => {
            let (p, q) = (graph.add(one, p)?, graph.add(one, q)?);
            of_logarithm(graph, p, q)?
        }
        // exp(q)*(exp(p - q) - 1)/(p - q)
        Function::Exp | Function::Expm1 => {
            let apart = graph.subtract(p, q)?;
            let factor = graph.unary(Function::Exp, q)?;
            let grown = graph.unary(Function::Expm1, apart)?;
            let ratio = graph.divide(grown, apart)?;
            let product = graph.multiply(factor, ratio)?;
            unless_equal(graph, (p, q), product, factor)?
        }
        _ => return Ok(None),
    }))
}

/// `if p == q then limit else value`
fn unless_equal(
    graph: &mut Simplifier,
    (p, q): (NodeId, NodeId),
    value: NodeId,
    limit: NodeId,
) -> Made {
    let equal = graph.make(Node::Compare(Comparison::Equal, p, q))?;
    graph.make(Node::Select(equal, limit, value))
}

/// `ln(p/q)/(p - q)`
fn of_logarithm(graph: &mut Simplifier, p: NodeId, q: NodeId) -> Made {
    let apart = graph.subtract(p, q)?;
    let logarithm = logarithm_of_ratio(graph, p, q)?;
    let value = graph.divide(logarithm, apart)?;
    let one = graph.number(1.0)?;
    let limit = graph.divide(one, q)?;
    unless_equal(graph, (p, q), value, limit)
}

/// `ln(p/q)` with its digits where `p` and `q` are near each other.
fn logarithm_of_ratio(graph: &mut Simplifier, p: NodeId, q: NodeId) -> Made {
    let apart = graph.subtract(p, q)?;
    let change = graph.divide(apart, q)?;
    let close = graph.unary(Function::Log1p, change)?;
    let ratio = graph.divide(p, q)?;
    let distant = graph.unary(Function::Ln, ratio)?;
    let size = graph.unary(Function::Abs, change)?;
    let half = graph.number(0.5)?;
    let is_close = graph.make(Node::Compare(Comparison::Less, size, half))?;
    graph.make(Node::Select(is_close, close, distant))
}

/// `(p^c - q^c)/(p - q) = q^c*(exp(c*ln(p/q)) - 1)/(p - q)`
fn of_power(graph: &mut Simplifier, ends: Ends, exponent: NodeId) -> Made {
    let Ends { a: p, b: q, .. } = ends;
    let logarithm = logarithm_of_ratio(graph, p, q)?;
    let product = graph.multiply(exponent, logarithm)?;
    let grown = graph.unary(Function::Expm1, product)?;
    let power = graph.binary(Operator::Power, q, exponent)?;
    let difference = graph.multiply(power, grown)?;
    let apart = graph.subtract(p, q)?;
    let value = graph.divide(difference, apart)?;
    let over = graph.divide(power, q)?;
    let limit = graph.multiply(exponent, over)?;
    unless_equal(graph, (p, q), value, limit)
}

/// `(p^n - q^n)/(p - q)` by products; `-(p^n - q^n)/(p - q)/(p*q)^n` for `-n`.
fn of_whole_power(graph: &mut Simplifier, ends: Ends, exponent: f64) -> Made {
    let n = exponent.abs() as u32;
    let positive = of_natural_power(graph, ends, n)?;
    if exponent >= 0.0 {
        return Ok(positive);
    }
    let product = graph.multiply(ends.a, ends.b)?;
    let power = graph.power(product, exponent)?;
    let value = graph.multiply(positive, power)?;
    graph.negate(value)
}

fn of_natural_power(graph: &mut Simplifier, ends: Ends, n: u32) -> Made {
    match n {
        0 => graph.number(0.0),
        1 => graph.number(1.0),
        _ if n.is_multiple_of(2) => {
            let half = of_natural_power(graph, ends, n / 2)?;
            let exponent = f64::from(n / 2);
            let (p, q) = (graph.power(ends.a, exponent)?, graph.power(ends.b, exponent)?);
            let sum = graph.add(p, q)?;
            graph.multiply(half, sum)
        }
        _ => {
            let below = of_natural_power(graph, ends, n - 1)?;
            let first = graph.multiply(ends.a, below)?;
            let second = graph.power(ends.b, f64::from(n - 1))?;
            graph.add(first, second)
        }
    }
}
