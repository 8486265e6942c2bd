//! What an elementary function has beyond its Taylor polynomial at 0, without cancellation.
//!
//! Up to an edge it is `d^j` times a polynomial, beyond it the function less the first terms; the
//! largest error in between is some units in the last place.

use super::exact::Number;
use super::polynomials::{POLYNOMIALS, Polynomial};
use super::side::{Made, Stop};
use crate::expression::{Comparison, Function, Node, NodeId, Operator, TooManyNodes};
use crate::simplify::Simplifier;

/// `phi(d) - sum of its terms below j`, `j >= 1`; of the logarithm and the root at `1 + d`.
pub(super) fn beyond(
    graph: &mut Simplifier,
    function: Function,
    d: NodeId,
    j: usize,
) -> Made<NodeId> {
    let odd = j.max(1) | 1;
    let even = (j + 1) & !1;
    match (function, j) {
        (Function::Erf, _) => Ok(of_error_function(graph, &Number::from(0), d, j)?),
        (Function::Exp, 1) => Ok(graph.unary(Function::Expm1, d)?),
        (Function::Ln, 1) => Ok(graph.unary(Function::Log1p, d)?),
        (Function::Ln, 2) => Ok(graph.unary(Function::Log1pmx, d)?),
        (Function::Exp | Function::Ln, _) => polynomial_or_difference(graph, function, d, j),
        (Function::Sqrt, _) => root(graph, d, j),
        (Function::Cos | Function::Cosh, 1 | 2) => less_one(graph, function, d),
        (Function::Cos | Function::Cosh, _) => polynomial_or_difference(graph, function, d, even),
        (_, 1) => Ok(graph.unary(function, d)?),
        _ => polynomial_or_difference(graph, function, d, odd),
    }
}

/// What a function has beyond its tangent at 0, of the logarithm and the root at `1 + d`.
pub(crate) fn second_order(
    graph: &mut Simplifier,
    function: Function,
    d: NodeId,
) -> Result<NodeId, TooManyNodes> {
    beyond(graph, function, d, 2).map_err(|_| TooManyNodes)
}

/// `cos(d) - 1 = -2 sin(d/2)^2`, `cosh(d) - 1 = 2 sinh(d/2)^2`
fn less_one(graph: &mut Simplifier, function: Function, d: NodeId) -> Made<NodeId> {
    let half = graph.number(0.5)?;
    let half = graph.multiply(half, d)?;
    let (odd, factor) = match function {
        Function::Cos => (Function::Sin, -2.0),
        _ => (Function::Sinh, 2.0),
    };
    let value = graph.unary(odd, half)?;
    let square = graph.power(value, 2.0)?;
    let factor = graph.number(factor)?;
    Ok(graph.multiply(factor, square)?)
}

/// Taylor terms of the error function: up to `|d| (1 + |c|) = 1` the next is below a rounding.
const ERROR_TERMS: usize = 40;

/// `erf(c + d) - sum of its terms below j`, `j >= 1`, about a number `c`.
pub(crate) fn of_error_function(
    graph: &mut Simplifier,
    c: &Number,
    d: NodeId,
    j: usize,
) -> Result<NodeId, TooManyNodes> {
    let terms = super::taylor::of_error_function(c, ERROR_TERMS);
    // About 0 it is odd.
    let (first, step) = if c.is_zero() { (j | 1, 2) } else { (j, 1) };
    let variable = graph.power(d, step as f64)?;
    let mut near = graph.number(0.0)?;
    for term in terms[first..].iter().step_by(step).rev() {
        let product = graph.multiply(variable, near)?;
        let term = graph.number(term.to_f64())?;
        near = graph.add(term, product)?;
    }
    let power = graph.power(d, first as f64)?;
    let near = graph.multiply(power, near)?;
    let at_rest = graph.number(c.to_f64())?;
    let whole = graph.add(at_rest, d)?;
    let mut far = graph.unary(Function::Erf, whole)?;
    for (k, term) in terms.iter().enumerate().take(j).filter(|(_, term)| !term.is_zero()) {
        let (power, factor) = (graph.power(d, k as f64)?, graph.number(term.to_f64())?);
        let term = if k == 0 { factor } else { graph.multiply(factor, power)? };
        far = graph.subtract(far, term)?;
    }
    let size = graph.unary(Function::Abs, d)?;
    let edge = graph.number(1.0 / (1.0 + c.to_f64().abs()))?;
    let is_near = graph.make(Node::Compare(Comparison::Less, size, edge))?;
    graph.make(Node::Select(is_near, near, far))
}

fn polynomial_or_difference(
    graph: &mut Simplifier,
    function: Function,
    d: NodeId,
    j: usize,
) -> Made<NodeId> {
    let known = POLYNOMIALS.iter().find(|known| known.function == function && known.order == j);
    let polynomial = known.ok_or(Stop::Lost)?;
    let two = graph.number(2.0)?;
    let (variable, measured) = match function {
        Function::Exp => (d, d),
        Function::Ln => {
            let sum = graph.add(two, d)?;
            let ratio = graph.divide(d, sum)?;
            (ratio, ratio)
        }
        _ => (graph.power(d, 2.0)?, d),
    };
    let near = times_power(graph, polynomial, variable, d)?;
    let far = difference(graph, function, d, j)?;
    let size = graph.unary(Function::Abs, measured)?;
    let edge = graph.number(polynomial.edge)?;
    let is_near = graph.make(Node::Compare(Comparison::Less, size, edge))?;
    Ok(graph.make(Node::Select(is_near, near, far))?)
}

fn times_power(
    graph: &mut Simplifier,
    polynomial: &Polynomial,
    variable: NodeId,
    d: NodeId,
) -> Made<NodeId> {
    let mut sum = None;
    for &coefficient in polynomial.coefficients.iter().rev() {
        let coefficient = graph.number(coefficient)?;
        sum = Some(match sum {
            None => coefficient,
            Some(sum) => {
                let product = graph.multiply(variable, sum)?;
                graph.add(coefficient, product)?
            }
        });
    }
    let sum = sum.ok_or(Stop::Lost)?;
    let power = graph.power(d, polynomial.order as f64)?;
    Ok(graph.multiply(power, sum)?)
}

/// The function less its terms below `j`, the first of which it lacks already.
fn difference(graph: &mut Simplifier, function: Function, d: NodeId, j: usize) -> Made<NodeId> {
    let (mut made, first) = match function {
        Function::Exp => (graph.unary(Function::Expm1, d)?, 1),
        Function::Ln => (graph.unary(Function::Log1p, d)?, 1),
        Function::Cos | Function::Cosh => (less_one(graph, function, d)?, 2),
        _ => (graph.unary(function, d)?, 1),
    };
    for k in first..j {
        let coefficient = coefficient(function, k);
        if coefficient != 0.0 {
            let factor = graph.number(coefficient)?;
            let power = graph.power(d, k as f64)?;
            let term = graph.multiply(factor, power)?;
            made = graph.binary(Operator::Subtract, made, term)?;
        }
    }
    Ok(made)
}

/// Of `d^k`, `1 <= k <= 4`.
fn coefficient(function: Function, k: usize) -> f64 {
    let [first, second, third, fourth] = match function {
        Function::Exp => [1.0, 0.5, 1.0 / 6.0, 1.0 / 24.0],
        Function::Ln => [1.0, -0.5, 1.0 / 3.0, -0.25],
        Function::Sin => [1.0, 0.0, -1.0 / 6.0, 0.0],
        Function::Sinh | Function::Asin => [1.0, 0.0, 1.0 / 6.0, 0.0],
        Function::Tanh | Function::Atan => [1.0, 0.0, -1.0 / 3.0, 0.0],
        Function::Cos => [0.0, -0.5, 0.0, 1.0 / 24.0],
        _ => [0.0, 0.5, 0.0, 1.0 / 24.0],
    };
    [0.0, first, second, third, fourth][k]
}

/// `d^j P_j(q)` with `q = 1/(1 + sqrt(1 + d))`: `P_1 = q`, and
/// `P_(j+1) = q^2 (P_j - binom(1/2, j))/(1 - 2 q)`, which is a polynomial.
fn root(graph: &mut Simplifier, d: NodeId, j: usize) -> Made<NodeId> {
    let (factor, coefficients): (f64, &[f64]) = match j {
        1 => (1.0, &[]),
        2 => (-0.5, &[1.0]),
        3 => (0.125, &[1.0, 2.0]),
        4 => (-0.0625, &[1.0, 2.0, 2.0]),
        5 => (0.0078125, &[5.0, 10.0, 12.0, 8.0]),
        _ => return Err(Stop::Lost),
    };
    let one = graph.number(1.0)?;
    let inside = graph.add(one, d)?;
    let root = graph.unary(Function::Sqrt, inside)?;
    let sum = graph.add(one, root)?;
    if coefficients.is_empty() {
        return Ok(graph.divide(d, sum)?);
    }
    let q = graph.divide(one, sum)?;
    let mut polynomial = None;
    for &coefficient in coefficients.iter().rev() {
        let coefficient = graph.number(coefficient)?;
        polynomial = Some(match polynomial {
            None => coefficient,
            Some(sum) => {
                let product = graph.multiply(q, sum)?;
                graph.add(coefficient, product)?
            }
        });
    }
    let polynomial = polynomial.ok_or(Stop::Lost)?;
    let square = graph.power(q, 2.0)?;
    let product = graph.multiply(square, polynomial)?;
    let power = graph.power(d, j as f64)?;
    let product = graph.multiply(power, product)?;
    let factor = graph.number(factor)?;
    Ok(graph.multiply(factor, product)?)
}
