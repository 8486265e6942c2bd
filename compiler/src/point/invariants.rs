//! Invariants of the deformation, however they are written, in the form that keeps their digits.
//!
//! `(tr(C)^2 - C : C)/2` subtracts fourth powers of stretches, and the sum of the squares of the cofactors
//! of `F` is the same. Before: an energy as a graph of components, with all digits of its numbers. After:
//! the same where every sum or product that is one of [`INVARIANTS`] stands as that. What it is follows from
//! its values, not from its shape: rational functions of the components that agree at a few random places
//! modulo a large prime are one. Nothing is divided by in the new form that is not in the old one, and what
//! has no value keeps none, but for cofactors that are written by the inverse: where `J` is 0 they have their
//! limit.

use crate::expression::graph::components;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::point::modular::{Modular, PLACES};
use crate::simplify::{Rule, Simplifier, rule};
use combinations::{Combinations, PROBES};

/// Every identity in use; a test of the same name shows each at work.
pub const INVARIANTS: &[Rule] = &[
    rule("second_invariant", "(tr(C)^2 - C : C)/2 = cof(F) : cof(F)", "in three dimensions"),
    rule(
        "second_invariant_of_plane_strain",
        "((tr(C) + 1)^2 - (C : C + 1))/2 = tr(C) + J^2",
        "in two dimensions",
    ),
    rule("determinant_of_cauchy_green", "det(C) = J^2", "always"),
    rule("cofactor_of_cauchy_green", "cof(C) = cof(F)'*cof(F)", "in three dimensions"),
    rule(
        "cofactor_by_inverse",
        "J*inv(F)' = cof(F), J^2*inv(C) = cof(F)'*cof(F)",
        "where J is not 0",
    ),
    rule(
        "cofactor_of_fibre",
        "I5(n) - I1*I4(n) + I2 = norm(cof(F)*n)^2, I1*I4(n) - I5(n) = norm(cof(F)*p)^2 + norm(cof(F)*q)^2, \
         in two dimensions J^2",
        "n, p and q of length 1 at right angles",
    ),
    rule("trace_of_inverse", "tr(inv(C)) = cof(F) : cof(F)/J^2", "always"),
    rule("trace_of_square", "tr(C*C) = C : C", "always"),
    rule("square_of_deviator", "C : C - tr(C)^2/d = dev(C) : dev(C)", "always"),
];

/// The rule that products obey, and no sum.
const BY_INVERSE: &str = "cofactor_by_inverse";

/// Factors that an invariant may stand with are whole multiples of this below the other number.
const SMALLEST_FACTOR: f64 = 1.0 / 1024.0;
const LARGEST_FACTOR: u64 = 1 << 20;

/// Highest power of `J` that is known as such in a denominator.
const LARGEST_POWER: usize = 8;

type Made = Result<NodeId, TooManyNodes>;

/// A function at random places, then where combinations of cofactors show their coefficients.
type Values = [Modular; PLACES + PROBES];

/// A rational function of the components of `F`, by its values.
#[derive(Clone, Copy)]
struct Rational {
    values: Values,
    /// Whether it is divided by powers of `J`, and so has no value where `J = 0`; else by nothing.
    is_over_volume: bool,
}

/// What a sum or a product may be.
struct Invariant {
    rule: &'static Rule,
    node: NodeId,
    is: Rational,
}

impl Invariant {
    /// The number that it is multiplied with to be `x`, the value of `node`.
    fn factor_of(&self, node: Node, x: &Rational) -> Option<f64> {
        let is_kind = match node {
            Node::Binary(Operator::Add | Operator::Subtract, ..) => {
                self.rule.name != BY_INVERSE && x.is_over_volume == self.is.is_over_volume
            }
            // Powers of J that are multiplied with and divided by: their derivatives cancel.
            Node::Binary(Operator::Multiply | Operator::Divide, ..) => {
                self.rule.name == BY_INVERSE && x.is_over_volume
            }
            _ => false,
        };
        if is_kind { factor(x.values, self.is.values) } else { None }
    }
}

/// The energy `root` with every invariant in its own form, and the rules that were used; without any it
/// stays as it is, to the order of its nodes.
pub(super) fn recognised(
    source: Simplifier,
    root: NodeId,
    dimension: usize,
) -> Result<(Simplifier, NodeId, Vec<&'static Rule>), TooManyNodes> {
    let mut forms = Simplifier::exact();
    let known = invariants(&mut forms, dimension)?;
    let rationals = rationals(source.graph(), dimension);
    let mut combinations = Combinations::new(&mut forms, dimension)?;
    let mut same = |id: NodeId, node: Node| {
        let Some(x) = rationals[id.0 as usize] else { return Ok(None) };
        let multiple = |invariant: &Invariant| {
            Some((invariant.rule, invariant.node, invariant.factor_of(node, &x)?))
        };
        match known.iter().find_map(multiple) {
            Some(found) => Ok(Some(found)),
            None => combinations.form(source.graph(), id, &x),
        }
    };
    let nodes: Vec<(NodeId, Node)> = source.graph().nodes().collect();
    // From the root down: what an invariant was made of is needed no more.
    let mut needed = vec![false; nodes.len()];
    let mut found = vec![None; nodes.len()];
    let mut used: Vec<&'static Rule> = Vec::new();
    needed[root.0 as usize] = true;
    for &(id, node) in nodes.iter().rev().filter(|(id, _)| id.0 <= root.0) {
        if !needed[id.0 as usize] {
            continue;
        }
        found[id.0 as usize] = same(id, node)?;
        match found[id.0 as usize] {
            Some((rule, ..)) if used.iter().all(|x| x.name != rule.name) => used.push(rule),
            Some(_) => {}
            None => node.operands().for_each(|x| needed[x.0 as usize] = true),
        }
    }
    if used.is_empty() {
        return Ok((source, root, used));
    }
    let mut graph = Simplifier::exact();
    let mut place = vec![NodeId(0); nodes.len()];
    for &(id, node) in nodes.iter().filter(|(id, _)| needed[id.0 as usize]) {
        place[id.0 as usize] = match found[id.0 as usize] {
            Some((_, form, factor)) => {
                let form = copied(&mut graph, forms.graph(), form)?;
                let factor = graph.number(factor)?;
                graph.multiply(factor, form)?
            }
            None => graph.make(node.map_operands(|x| place[x.0 as usize]))?,
        };
    }
    Ok((graph, place[root.0 as usize], used))
}

/// All that a sum or a product may be.
fn invariants(graph: &mut Simplifier, d: usize) -> Result<Vec<Invariant>, TooManyNodes> {
    let forms = forms(graph, d)?;
    let values = rationals(graph.graph(), d);
    let invariant = |(name, node): (&str, NodeId)| {
        let rule = INVARIANTS.iter().find(|rule| rule.name == name)?;
        Some(Invariant { rule, node, is: values[node.0 as usize]? })
    };
    Ok(forms.into_iter().filter_map(invariant).collect())
}

/// A node of another graph.
fn copied(graph: &mut Simplifier, from: &ExprGraph, root: NodeId) -> Made {
    let needed = from.reachable(&[root]);
    let mut place = vec![NodeId(0); from.len()];
    for (id, node) in from.nodes().filter(|(id, _)| needed[id.0 as usize]) {
        place[id.0 as usize] = graph.make(node.map_operands(|x| place[x.0 as usize]))?;
    }
    Ok(place[root.0 as usize])
}

/// The number that an invariant is multiplied with to be `x`; `None` if that is something else.
fn factor(x: Values, invariant: Values) -> Option<f64> {
    let ratio = constant(x, invariant)?;
    let scaled = ratio * Modular::of(1.0 / SMALLEST_FACTOR)?;
    let (size, sign) = match (scaled.number(), (-scaled).number()) {
        (size, _) if size <= LARGEST_FACTOR => (size, 1.0),
        (_, size) if size <= LARGEST_FACTOR => (size, -1.0),
        _ => return None,
    };
    (size > 0).then_some(sign * size as f64 * SMALLEST_FACTOR)
}

/// The quotient of two functions if it is one number.
fn constant(x: Values, y: Values) -> Option<Modular> {
    let mut quotients = x.into_iter().zip(y).take(PLACES).map(|(x, y)| Some(x * y.reciprocal()?));
    let first = quotients.next()??;
    quotients.all(|quotient| quotient == Some(first)).then_some(first)
}

/// What every node is as a function of `F`, where it is made of its components by sums, products and
/// division by powers of `J`; other constants, as `cos(0.5)`, stand for themselves.
fn rationals(graph: &ExprGraph, d: usize) -> Vec<Option<Rational>> {
    let gradient = |k: u8| variable(k, d);
    let volume = determinant(&components(d).into_iter().map(gradient).collect::<Vec<_>>());
    let mut known: Vec<Option<Rational>> = Vec::with_capacity(graph.len());
    let mut is_constant: Vec<bool> = Vec::with_capacity(graph.len());
    for (id, node) in graph.nodes() {
        let of = |x: NodeId| known[x.0 as usize];
        let plain = |values| Rational { values, is_over_volume: false };
        let constant =
            !matches!(node, Node::Input(_)) && node.operands().all(|x| is_constant[x.0 as usize]);
        let rational = match node {
            Node::Number(bits) => {
                Modular::of(f64::from_bits(bits)).map(|x| plain([x; PLACES + PROBES]))
            }
            Node::Input(Input::Variable(k)) => Some(plain(gradient(k))),
            Node::Unary(Function::Negate, x) => {
                of(x).map(|x| Rational { values: x.values.map(|x| -x), ..x })
            }
            Node::PowerConstant(x, bits) => {
                of(x).and_then(|x| power(x, f64::from_bits(bits), &volume))
            }
            Node::Binary(operator, x, y) => {
                of(x).zip(of(y)).and_then(|(x, y)| operation(operator, x, y, &volume))
            }
            _ => None,
        };
        let symbol = || {
            let is_number = matches!(node, Node::Unary(..) | Node::PowerConstant(..));
            let symbol = Modular::symbol(id.0 as usize);
            (constant && is_number).then(|| plain([symbol; PLACES + PROBES]))
        };
        known.push(rational.or_else(symbol));
        is_constant.push(constant);
    }
    known
}

/// Component `k` of `F`.
fn variable(k: u8, d: usize) -> Values {
    let random = Modular::places(usize::from(k));
    let probes = combinations::probes(d);
    std::array::from_fn(|place| match place.checked_sub(PLACES) {
        None => random[place],
        Some(probe) => Modular::whole(probes[probe][usize::from(k / 3)][usize::from(k % 3)]),
    })
}

fn operation(operator: Operator, x: Rational, y: Rational, volume: &Values) -> Option<Rational> {
    let each = |f: fn(Modular, Modular) -> Modular| Rational {
        values: std::array::from_fn(|k| f(x.values[k], y.values[k])),
        is_over_volume: x.is_over_volume || y.is_over_volume,
    };
    match operator {
        Operator::Add => Some(each(|x, y| x + y)),
        Operator::Subtract => Some(each(|x, y| x + -y)),
        Operator::Multiply => Some(each(|x, y| x * y)),
        Operator::Divide => operation(Operator::Multiply, x, power(y, -1.0, volume)?, volume),
        _ => None,
    }
}

fn power(x: Rational, exponent: f64, volume: &Values) -> Option<Rational> {
    let n = exponent.abs();
    if n.fract() != 0.0 || n > LARGEST_POWER as f64 {
        return None;
    }
    let mut power = [Modular::ONE; PLACES + PROBES];
    for _ in 0..n as usize {
        power = std::array::from_fn(|k| power[k] * x.values[k]);
    }
    if exponent >= 0.0 {
        return Some(Rational { values: power, ..x });
    }
    // By a number, or by a number times a power of J.
    let mut powers = [Modular::ONE; PLACES + PROBES];
    let mut is_volume = None;
    for n in 0..=LARGEST_POWER {
        is_volume = is_volume.or(constant(x.values, powers).map(|_| n > 0));
        powers = std::array::from_fn(|k| powers[k] * volume[k]);
    }
    let is_over_volume = is_volume.filter(|_| !x.is_over_volume)?;
    let mut values = power;
    for value in &mut values {
        *value = value.reciprocal()?;
    }
    Some(Rational { values, is_over_volume })
}

fn determinant(f: &[Values]) -> Values {
    std::array::from_fn(|k| {
        let minor =
            |a: usize, b: usize, c: usize, e: usize| f[a][k] * f[b][k] + -(f[c][k] * f[e][k]);
        match f.len() {
            4 => minor(0, 3, 1, 2),
            _ => {
                f[0][k] * minor(4, 8, 5, 7)
                    + -(f[1][k] * minor(3, 8, 5, 6))
                    + f[2][k] * minor(3, 7, 4, 6)
            }
        }
    })
}

/// The forms that keep their digits, by the names of their rules.
fn forms(graph: &mut Simplifier, d: usize) -> Result<Vec<(&'static str, NodeId)>, TooManyNodes> {
    let mut gradient = Vec::new();
    for k in components(d) {
        gradient.push(graph.input(Input::Variable(k))?);
    }
    let cofactors = cofactors(graph, &gradient)?;
    let volume = volume(graph, &gradient, &cofactors)?;
    let volume_squared = graph.multiply(volume, volume)?;
    let cauchy_green = |graph: &mut Simplifier, i, j| columns(graph, &gradient, i, j);
    let mut trace = cauchy_green(graph, 0, 0)?;
    let mut second = columns(graph, &cofactors, 0, 0)?;
    for i in 1..d {
        let (more, cofactor) = (cauchy_green(graph, i, i)?, columns(graph, &cofactors, i, i)?);
        trace = graph.add(trace, more)?;
        second = graph.add(second, cofactor)?;
    }
    let (mut squares, mut shear, mut deviator) = (None, None, None);
    for i in 0..d {
        let diagonal = cauchy_green(graph, i, i)?;
        add_square(graph, &mut squares, diagonal)?;
        for j in i + 1..d {
            let component = cauchy_green(graph, i, j)?;
            add_square(graph, &mut shear, component)?;
            let other = cauchy_green(graph, j, j)?;
            let difference = graph.subtract(diagonal, other)?;
            add_square(graph, &mut deviator, difference)?;
        }
    }
    let [squares, shear, deviator] = [squares, shear, deviator].map(|x| x.unwrap_or(trace));
    let (two, of_d) = (graph.number(2.0)?, graph.number(d as f64)?);
    let shear = graph.multiply(two, shear)?;
    let square = graph.add(squares, shear)?;
    let deviator = graph.divide(deviator, of_d)?;
    let deviator = graph.add(deviator, shear)?;
    let mut all = vec![
        ("determinant_of_cauchy_green", volume_squared),
        ("trace_of_inverse", graph.divide(second, volume_squared)?),
        ("trace_of_square", square),
        ("square_of_deviator", deviator),
    ];
    all.extend(cofactors.iter().map(|cofactor| (BY_INVERSE, *cofactor)));
    let pairs = (0..d).flat_map(|i| (i..d).map(move |j| (i, j)));
    let mut of_cauchy_green = Vec::new();
    for (i, j) in pairs {
        of_cauchy_green.push(columns(graph, &cofactors, i, j)?);
    }
    all.extend(of_cauchy_green.iter().map(|cofactor| (BY_INVERSE, *cofactor)));
    all.push((BY_INVERSE, second));
    if d == 2 {
        all.push(("second_invariant_of_plane_strain", graph.add(trace, volume_squared)?));
        return Ok(all);
    }
    all.push(("second_invariant", second));
    all.extend(of_cauchy_green.into_iter().map(|cofactor| ("cofactor_of_cauchy_green", cofactor)));
    Ok(all)
}

/// `J`, along the first row.
fn volume(graph: &mut Simplifier, gradient: &[NodeId], cofactors: &[NodeId]) -> Made {
    let mut sum = graph.number(0.0)?;
    for (component, cofactor) in
        gradient.iter().zip(cofactors).take(if gradient.len() == 4 { 2 } else { 3 })
    {
        let term = graph.multiply(*component, *cofactor)?;
        sum = graph.add(sum, term)?;
    }
    Ok(sum)
}

/// Component `ij` of `A'*A`.
fn columns(graph: &mut Simplifier, tensor: &[NodeId], i: usize, j: usize) -> Made {
    let d = if tensor.len() == 4 { 2 } else { 3 };
    let mut sum = graph.multiply(tensor[i], tensor[j])?;
    for row in 1..d {
        let term = graph.multiply(tensor[d * row + i], tensor[d * row + j])?;
        sum = graph.add(sum, term)?;
    }
    Ok(sum)
}

fn add_square(
    graph: &mut Simplifier,
    sum: &mut Option<NodeId>,
    x: NodeId,
) -> Result<(), TooManyNodes> {
    let square = graph.multiply(x, x)?;
    *sum = Some(match *sum {
        Some(sum) => graph.add(sum, square)?,
        None => square,
    });
    Ok(())
}

/// `cof(F) = J*inv(F)'`, row by row.
fn cofactors(graph: &mut Simplifier, f: &[NodeId]) -> Result<Vec<NodeId>, TooManyNodes> {
    if let [a, b, c, d] = *f {
        return Ok(vec![d, graph.negate(c)?, graph.negate(b)?, a]);
    }
    let mut all = Vec::with_capacity(9);
    for (row, column) in (0..9).map(|k| (k / 3, k % 3)) {
        // The next two rows and columns in turn: no signs.
        let at = |i: usize, j: usize| f[3 * ((row + i) % 3) + (column + j) % 3];
        let first = graph.multiply(at(1, 1), at(2, 2))?;
        let second = graph.multiply(at(1, 2), at(2, 1))?;
        all.push(graph.subtract(first, second)?);
    }
    Ok(all)
}

mod combinations;
#[cfg(test)]
mod tests;
