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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expression::interpret::Interpreter;

    /// `f(y)` for every kind of node that has a rule, some with a parameter, and pairs of them, of
    /// `y = (x + x^2)/2`.
    fn functions(graph: &mut Simplifier, x: NodeId) -> Result<Vec<NodeId>, TooManyNodes> {
        let square = graph.power(x, 2.0)?;
        let (sum, half) = (graph.add(x, square)?, graph.number(0.5)?);
        let x = graph.multiply(half, sum)?;
        use Function::{Exp, Expm1, Ln, Log1p, Negate, Sqrt};
        let mut all = Vec::new();
        for function in [Sqrt, Ln, Log1p, Exp, Expm1, Negate] {
            all.push(graph.unary(function, x)?);
        }
        for exponent in [2.0, 3.0, 4.0, 5.0, 7.0, 16.0, -1.0, -2.0, -5.0, 0.5, 2.5, -1.3, 17.0] {
            all.push(graph.power(x, exponent)?);
        }
        let parameter = graph.input(Input::Parameter(0))?;
        all.push(graph.binary(Operator::Power, x, parameter)?);
        let mut products = Vec::new();
        for (&f, &g) in all.iter().zip(all.iter().skip(5)) {
            products.push(graph.multiply(f, g)?);
            products.push(graph.divide(g, f)?);
            products.push(graph.add(f, g)?);
            products.push(graph.subtract(f, g)?);
            products.push(graph.multiply(parameter, f)?);
            products.push(graph.divide(f, parameter)?);
            products.push(graph.divide(parameter, f)?);
        }
        all.extend(products);
        Ok(all)
    }

    /// The divided difference between `a` and `b`, and `f(a)` and `f(b)` themselves.
    fn at(number: usize, a: f64, b: f64) -> [f64; 3] {
        let mut source = Simplifier::new();
        let x = source.input(Input::Stretch(0)).unwrap();
        let root = functions(&mut source, x).unwrap()[number];
        let mut target = Simplifier::new();
        let ends = [1, 2].map(|k| target.input(Input::Stretch(k)).unwrap());
        let made = divided(&mut target, source.graph(), root, (ends[0], ends[1])).unwrap();
        let mut interpreter = Interpreter::<f64>::new();
        let mut run = |graph: &ExprGraph, node: NodeId, ends: [f64; 2]| {
            interpreter.run(graph, |input| match input {
                Input::Stretch(k) => ends[usize::from(k) / 2],
                _ => 1.7,
            });
            interpreter.number(node)
        };
        let value = run(target.graph(), made, [a, b]);
        [value, run(source.graph(), root, [a, a]), run(source.graph(), root, [b, b])]
    }

    #[test]
    fn divided_differences_are_what_they_are_called() {
        let mut graph = Simplifier::new();
        let x = graph.input(Input::Stretch(0)).unwrap();
        let n = functions(&mut graph, x).unwrap().len();
        assert!(n > 100, "{n}");
        for number in 0..n {
            for (a, b) in [(3.1, 0.7), (0.7, 3.1), (1.6, 1.3)] {
                let [value, f_a, f_b] = at(number, a, b);
                // What the difference of the values has lost; parts of quotients are up to 1e6 times as
                // large, and digits are for the tests of energies.
                let scale = (f_a.abs() + f_b.abs()) / (a - b).abs() + value.abs();
                let error = (value - (f_a - f_b) / (a - b)).abs();
                assert!(error <= 1e-9 * scale, "{number} {a} {b}: {value} {f_a} {f_b}");
            }
            // Between equal ends it is the derivative, and near them, too.
            let step = 1e-5;
            let [_, ahead, behind] = at(number, 1.3 + step, 1.3 - step);
            let derivative = (ahead - behind) / (2.0 * step);
            for apart in [0.0, 1e-13] {
                let [value, ..] = at(number, 1.3 * (1.0 + apart), 1.3);
                // Third derivatives are at most 16^3 times as large as the functions.
                let tolerance = 1e-6 * (derivative.abs() + ahead.abs());
                assert!((value - derivative).abs() <= tolerance, "{number}: {value} {derivative}");
            }
        }
    }
}
