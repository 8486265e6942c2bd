//! Exact derivatives with respect to a measure, by the rules of calculus, one node at a time.
//!
//! Before: a simplified graph with a root. After: the same graph with the derivative's nodes added.
//! A node that does not depend on the measure has no derivative at all (rather than the number 0),
//! so no product with a zero is ever written. Both branches of `if` are differentiated and stay
//! under the same condition.

use std::f64::consts::FRAC_2_SQRT_PI;

use crate::expression::{Comparison, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;
use crate::rewrite::{Base, Monomial, Monomials, strain, stretch};
use crate::simplify::Simplifier;

/// The derivative of `root` with respect to the current measure.
///
/// The relative change `e = (l - L)/L` counts as the function of `l` that it is.
pub fn differentiate(
    graph: &mut Simplifier,
    root: NodeId,
    measure: Measure,
) -> Result<NodeId, TooManyNodes> {
    let mut monomials = Monomials::new(measure);
    by_rules(graph, root, measure, |graph, id| match monomials.of(graph.graph(), id) {
        Some(monomial) if monomial.strain.is_some() && is_of_stretch(&monomial) => {
            strain_product(graph, monomial, measure).map(Some)
        }
        _ => Ok(None),
    })
}

/// The same by the rules of calculus alone, which round no number.
pub(crate) fn differentiate_exactly(
    graph: &mut Simplifier,
    root: NodeId,
    measure: Measure,
) -> Result<NodeId, TooManyNodes> {
    by_rules(graph, root, measure, |_, _| Ok(None))
}

fn by_rules(
    graph: &mut Simplifier,
    root: NodeId,
    measure: Measure,
    special: impl FnMut(&mut Simplifier, NodeId) -> Derivative,
) -> Result<NodeId, TooManyNodes> {
    let of_input = |graph: &mut Simplifier, input| match input {
        Input::Current(m) if m == measure => graph.number(1.0).map(Some),
        Input::Change(m) if m == measure => {
            let one = graph.number(1.0)?;
            let reference = graph.input(Input::Reference(m))?;
            graph.divide(one, reference).map(Some)
        }
        _ => Ok(None),
    };
    match forward(graph, root, &of_input, special)? {
        Some(id) => Ok(id),
        None => graph.number(0.0),
    }
}

/// The derivative of `root` that follows from those of the inputs.
pub(crate) fn derivative_by(
    graph: &mut Simplifier,
    root: NodeId,
    of_input: &dyn Fn(&mut Simplifier, Input) -> Derivative,
) -> Derivative {
    forward(graph, root, of_input, |_, _| Ok(None))
}

fn forward(
    graph: &mut Simplifier,
    root: NodeId,
    of_input: &dyn Fn(&mut Simplifier, Input) -> Derivative,
    mut special: impl FnMut(&mut Simplifier, NodeId) -> Derivative,
) -> Derivative {
    let n = root.0 as usize + 1;
    let needed = graph.graph().reachable(&[root]);
    let mut derivatives: Vec<Option<NodeId>> = vec![None; n];
    for index in 0..n {
        if needed[index] {
            let id = NodeId(index as u32);
            derivatives[index] = match special(graph, id)? {
                Some(derivative) => Some(derivative),
                None => derivative_of(graph, id, &derivatives, of_input)?,
            };
        }
    }
    Ok(derivatives[n - 1])
}

/// Whether its power, if it has one, is of the stretch: exponentials have other derivatives.
fn is_of_stretch(monomial: &Monomial) -> bool {
    matches!(monomial.base, None | Some(Base::Stretch))
}

/// The derivative of `f L^r x^p S_a^k` with the stretch `x = l/L` and its strain `S_a = (x^a - 1)/a`:
/// `f L^(r-1) x^(p-1) S_a^(k-1) q`, where `q = k + (p + k a) S_a = ((p + k a) x^a - p)/a`.
///
/// By the rule for products it would be a sum that cancels: for `S_(1/2)^2` at `x = 1e8` by four digits.
/// Of the two forms of `q` the second keeps its digits far from rest, the first where `a` is near 0.
fn strain_product(
    graph: &mut Simplifier,
    monomial: Monomial,
    measure: Measure,
) -> Result<NodeId, TooManyNodes> {
    let (a, k) = monomial.strain.expect("asked of products with a strain");
    let p = monomial.exponent;
    let slope = p + k * a;
    let outside = |exponent: f64, factor: f64| Monomial {
        factor: monomial.factor * factor,
        reference: monomial.reference - 1.0,
        base: (exponent != 0.0).then_some(Base::Stretch),
        exponent,
        strain: Some((a, k - 1.0)),
    };
    if p == 0.0 {
        return outside(a - 1.0, k).node(graph, measure);
    }
    if slope == 0.0 {
        return outside(p - 1.0, k).node(graph, measure);
    }
    let inside = if a.abs() < 0.25 {
        let strain = strain(graph, measure, a)?;
        let factor = graph.number(slope)?;
        let product = graph.multiply(factor, strain)?;
        let constant = graph.number(k)?;
        graph.add(constant, product)?
    } else {
        let stretch = stretch(graph, measure)?;
        let power = graph.power(stretch, a)?;
        let factor = graph.number(slope / a)?;
        let product = graph.multiply(factor, power)?;
        let constant = graph.number(-p / a)?;
        graph.add(constant, product)?
    };
    let outside = outside(p - 1.0, 1.0);
    if outside.reference >= 0.0 {
        let outside = outside.node(graph, measure)?;
        return graph.multiply(outside, inside);
    }
    let without = Monomial { reference: 0.0, ..outside }.node(graph, measure)?;
    let product = graph.multiply(without, inside)?;
    let reference = graph.input(Input::Reference(measure))?;
    let divisor = graph.power(reference, -outside.reference)?;
    graph.divide(product, divisor)
}

/// A derivative; nothing where a node does not vary.
pub(crate) type Derivative = Result<Option<NodeId>, TooManyNodes>;

/// The derivative of a node from those of its operands and of the inputs.
pub(crate) fn derivative_of(
    graph: &mut Simplifier,
    id: NodeId,
    known: &[Option<NodeId>],
    of_input: &dyn Fn(&mut Simplifier, Input) -> Derivative,
) -> Derivative {
    let of = |x: NodeId| known[x.0 as usize];
    match graph.graph()[id] {
        Node::Input(input) => of_input(graph, input),
        Node::Number(_) | Node::Truth(_) => Ok(None),
        Node::Compare(..) | Node::And(..) | Node::Or(..) | Node::Not(_) => Ok(None),
        Node::Unary(function, x) => match of(x) {
            Some(dx) => unary(graph, function, id, x, dx),
            None => Ok(None),
        },
        Node::Strain(x, bits) => match of(x) {
            // ((x^n - 1)/n)' = x^(n-1)*x', which also holds for the logarithm, n = 0.
            Some(dx) => {
                let power = graph.power(x, f64::from_bits(bits) - 1.0)?;
                graph.multiply(power, dx).map(Some)
            }
            None => Ok(None),
        },
        Node::PowerConstant(x, bits) => match of(x) {
            Some(dx) => power_constant(graph, x, dx, f64::from_bits(bits)),
            None => Ok(None),
        },
        Node::Binary(operator, x, y) => binary(graph, operator, id, (x, of(x)), (y, of(y))),
        Node::Select(c, x, y) => match (of(x), of(y)) {
            (None, None) => Ok(None),
            (dx, dy) => {
                let zero = graph.number(0.0)?;
                let node = Node::Select(c, dx.unwrap_or(zero), dy.unwrap_or(zero));
                graph.make(node).map(Some)
            }
        },
    }
}

/// Beyond, `1/cosh(x)^2` is below 1e-303, and a little further `cosh(x)^2` overflows.
const FLAT: f64 = 350.0;

/// `f(x)' = f'(x)*x'`; `id` is `f(x)` itself.
pub(crate) fn unary(
    graph: &mut Simplifier,
    function: Function,
    id: NodeId,
    x: NodeId,
    dx: NodeId,
) -> Derivative {
    let one = graph.number(1.0)?;
    let two = graph.number(2.0)?;
    let derivative = match function {
        Function::Negate => graph.negate(dx)?,
        Function::Abs => {
            let sign = graph.unary(Function::Sign, x)?;
            graph.multiply(sign, dx)?
        }
        Function::Sign => return Ok(None),
        Function::Sqrt => {
            let twice = graph.multiply(two, id)?;
            graph.divide(dx, twice)?
        }
        Function::Exp => graph.multiply(id, dx)?,
        Function::Expm1 => {
            let exp = graph.unary(Function::Exp, x)?;
            graph.multiply(exp, dx)?
        }
        Function::Ln => graph.divide(dx, x)?,
        Function::Log1p => {
            let sum = graph.add(one, x)?;
            graph.divide(dx, sum)?
        }
        // (ln(1 + x) - x)' = -x/(1 + x)
        Function::Log1pmx => {
            let sum = graph.add(one, x)?;
            let quotient = graph.divide(x, sum)?;
            let product = graph.multiply(quotient, dx)?;
            graph.negate(product)?
        }
        Function::Sin => {
            let cos = graph.unary(Function::Cos, x)?;
            graph.multiply(cos, dx)?
        }
        Function::Cos => {
            let sin = graph.unary(Function::Sin, x)?;
            let product = graph.multiply(sin, dx)?;
            graph.negate(product)?
        }
        Function::Tan => {
            let square = graph.power(id, 2.0)?;
            let sum = graph.add(one, square)?;
            graph.multiply(sum, dx)?
        }
        Function::Asin | Function::Acos => {
            let square = graph.power(x, 2.0)?;
            let difference = graph.subtract(one, square)?;
            let root = graph.unary(Function::Sqrt, difference)?;
            let quotient = graph.divide(dx, root)?;
            if function == Function::Asin { quotient } else { graph.negate(quotient)? }
        }
        Function::Atan => {
            let square = graph.power(x, 2.0)?;
            let sum = graph.add(one, square)?;
            graph.divide(dx, sum)?
        }
        Function::Sinh => {
            let cosh = graph.unary(Function::Cosh, x)?;
            graph.multiply(cosh, dx)?
        }
        Function::Cosh => {
            let sinh = graph.unary(Function::Sinh, x)?;
            graph.multiply(sinh, dx)?
        }
        Function::Tanh => {
            // 1/cosh^2 keeps its digits where 1 - tanh^2 cancels; where the square overflows it is 0.
            let cosh = graph.unary(Function::Cosh, x)?;
            let square = graph.power(cosh, 2.0)?;
            let quotient = graph.divide(dx, square)?;
            let size = graph.unary(Function::Abs, x)?;
            let limit = graph.number(FLAT)?;
            let flat = graph.make(Node::Compare(Comparison::Greater, size, limit))?;
            let zero = graph.number(0.0)?;
            graph.make(Node::Select(flat, zero, quotient))?
        }
        // erf(x)' = 2/sqrt(pi) exp(-x^2)
        Function::Erf => {
            let square = graph.power(x, 2.0)?;
            let negated = graph.negate(square)?;
            let bell = graph.unary(Function::Exp, negated)?;
            let factor = graph.number(FRAC_2_SQRT_PI)?;
            let slope = graph.multiply(factor, bell)?;
            graph.multiply(slope, dx)?
        }
    };
    Ok(Some(derivative))
}

/// `(x^c)' = c*x^(c-1)*x'`
pub(crate) fn power_constant(graph: &mut Simplifier, x: NodeId, dx: NodeId, c: f64) -> Derivative {
    if c == 0.0 {
        return Ok(None);
    }
    let lower = graph.power(x, c - 1.0)?;
    let exponent = graph.number(c)?;
    let product = graph.multiply(exponent, lower)?;
    let slope = graph.multiply(product, dx)?;
    match positive_part(graph, x).filter(|_| c > 0.0 && c.fract() != 0.0) {
        // `max(y, 0)^1.5` is 0 with all its derivatives where y is below 0, and not `0^-0.5*0`.
        Some(of) => {
            let zero = graph.number(0.0)?;
            let is_nothing = graph.make(Node::Compare(Comparison::LessEqual, of, zero))?;
            graph.make(Node::Select(is_nothing, zero, slope)).map(Some)
        }
        None => Ok(Some(slope)),
    }
}

/// The other operand of `max(y, 0)`.
fn positive_part(graph: &Simplifier, x: NodeId) -> Option<NodeId> {
    let graph = graph.graph();
    let is_zero = |x: NodeId| matches!(graph[x], Node::Number(bits) if f64::from_bits(bits) == 0.0);
    match graph[x] {
        Node::Binary(Operator::Max, y, zero) if is_zero(zero) => Some(y),
        Node::Binary(Operator::Max, zero, y) if is_zero(zero) => Some(y),
        _ => None,
    }
}

pub(crate) fn binary(
    graph: &mut Simplifier,
    operator: Operator,
    id: NodeId,
    (x, dx): (NodeId, Option<NodeId>),
    (y, dy): (NodeId, Option<NodeId>),
) -> Derivative {
    if dx.is_none() && dy.is_none() {
        return Ok(None);
    }
    match operator {
        Operator::Add => sum(graph, dx, dy),
        Operator::Subtract => {
            let negated = dy.map(|dy| graph.negate(dy)).transpose()?;
            sum(graph, dx, negated)
        }
        Operator::Multiply => {
            let left = dx.map(|dx| graph.multiply(dx, y)).transpose()?;
            let right = dy.map(|dy| graph.multiply(x, dy)).transpose()?;
            sum(graph, left, right)
        }
        // (x/y)' = (x' - (x/y)*y')/y
        Operator::Divide => {
            let right = dy.map(|dy| graph.multiply(id, dy)).transpose()?;
            let right = right.map(|right| graph.negate(right)).transpose()?;
            let numerator = sum(graph, dx, right)?.expect("one of both varies");
            graph.divide(numerator, y).map(Some)
        }
        Operator::Power => power(graph, id, (x, dx), (y, dy)),
        Operator::Min | Operator::Max => {
            let comparison = at_tie(operator, dx.is_none());
            let first = graph.make(Node::Compare(comparison, x, y))?;
            let zero = graph.number(0.0)?;
            graph.make(Node::Select(first, dx.unwrap_or(zero), dy.unwrap_or(zero))).map(Some)
        }
        // atan2(x, y)' = (y x' - x y')/(x^2 + y^2)
        Operator::Atan2 => {
            let left = dx.map(|dx| graph.multiply(y, dx)).transpose()?;
            let right = dy.map(|dy| graph.multiply(x, dy)).transpose()?;
            let right = right.map(|right| graph.negate(right)).transpose()?;
            let numerator = sum(graph, left, right)?.expect("one of both varies");
            let (p, q) = (graph.power(x, 2.0)?, graph.power(y, 2.0)?);
            let square = graph.add(p, q)?;
            graph.divide(numerator, square).map(Some)
        }
    }
}

/// When the first operand is taken for the derivative of the smaller or larger of two. Where both are equal one of them
/// has to be: the larger is the one that varies, the smaller the one that does not, so that `max(x, 0) + min(x, 0)`
/// has the derivative of `x`, and their squares the stiffness of `x^2`, at 0, too.
pub(crate) fn at_tie(operator: Operator, first_is_constant: bool) -> Comparison {
    match (operator == Operator::Min, first_is_constant) {
        (true, true) => Comparison::LessEqual,
        (true, false) => Comparison::Less,
        (false, true) => Comparison::Greater,
        (false, false) => Comparison::GreaterEqual,
    }
}

/// `(x^y)' = y*x^(y-1)*x' + x^y*ln(x)*y'`; the logarithm appears only if the exponent varies.
fn power(
    graph: &mut Simplifier,
    id: NodeId,
    (x, dx): (NodeId, Option<NodeId>),
    (y, dy): (NodeId, Option<NodeId>),
) -> Derivative {
    let base = match dx {
        None => None,
        Some(dx) => {
            let one = graph.number(1.0)?;
            let lower = graph.subtract(y, one)?;
            let power = graph.binary(Operator::Power, x, lower)?;
            let product = graph.multiply(y, power)?;
            Some(graph.multiply(product, dx)?)
        }
    };
    let exponent = match dy {
        None => None,
        Some(dy) => {
            let ln = graph.unary(Function::Ln, x)?;
            let product = graph.multiply(id, ln)?;
            Some(graph.multiply(product, dy)?)
        }
    };
    sum(graph, base, exponent)
}

fn sum(graph: &mut Simplifier, x: Option<NodeId>, y: Option<NodeId>) -> Derivative {
    match (x, y) {
        (Some(x), Some(y)) => graph.add(x, y).map(Some),
        (only, None) | (None, only) => Ok(only),
    }
}
