//! Energies as sums of products: of what depends on fields alone, and of what depends on none.
//!
//! Near rest numbers cancel, and what is not known before a run, as the value of a field, cancels with
//! nothing. `mu*(tr(C) - 3)/2 - mu*ln(J)` is `mu` times what cancels without it.

use super::{Expander, Near, Source, Varying};
use crate::expression::{
    Comparison, ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes,
};
use crate::measure::Measure;
use crate::simplify::Simplifier;
use crate::specialise::folded_into;

/// Most products that are looked at.
const MOST: usize = 16;

/// An energy near rest that may hold fields: `near` gives that of a root without any. What is a sum of
/// products of fields with terms that have none is expanded term by term.
///
/// A field is what is known in a run alone, as `is_field` says.
pub(crate) fn with_fields(
    graph: &mut Simplifier,
    (exact, written): (&Simplifier, NodeId),
    is_field: impl Fn(Input) -> bool,
    mut near: impl FnMut(&mut Simplifier, Source<'_>, NodeId) -> Result<Option<NodeId>, TooManyNodes>,
) -> Result<Option<NodeId>, TooManyNodes> {
    let mut exact = exact.clone();
    let whole = || vec![Product { factor: None, term: written }];
    let products = products(&mut exact, written, is_field)?.unwrap_or_else(whole);
    let needed =
        products.iter().flat_map(|product| product.factor.into_iter().chain([product.term]));
    let place = folded_into(graph, exact.graph(), &needed.collect::<Vec<NodeId>>())?;
    let source = Source { graph: exact.graph(), place: &place };
    let mut sum: Option<NodeId> = None;
    for Product { factor, term } in products {
        let Some(mut part) = near(graph, source, term)? else { return Ok(None) };
        if let Some(factor) = factor {
            part = graph.multiply(place[factor.0 as usize], part)?;
        }
        sum = Some(match sum {
            Some(sum) => graph.add(sum, part)?,
            None => part,
        });
    }
    Ok(sum)
}

/// An energy of gathered values near rest, as a function of integrals, some of which are 0 at rest, of bonds of the
/// stretch `Stretch(0)`, too; `None` where it is no number there.
pub(crate) fn near_of_gathered(
    graph: &mut Simplifier,
    source: Source<'_>,
    root: NodeId,
    (of_bonds, vanishing): (bool, &[Input]),
) -> Result<Option<NodeId>, TooManyNodes> {
    let mut variables = at_nothing(vanishing);
    if of_bonds {
        let change = Input::Change(Measure::Length);
        variables.insert(0, Varying { variable: Input::Stretch(0), change, at_rest: 1.0 });
    }
    Expander::new(graph, source, &variables, &[]).whole_of(root)
}

/// Inputs that are 0 at rest, as variables.
fn at_nothing(inputs: &[Input]) -> Vec<Varying> {
    let varying = |&variable: &Input| Varying { variable, change: variable, at_rest: 0.0 };
    inputs.iter().map(varying).collect()
}

/// A function with an exponential, but no sum, that has fallen below this part of its value at rest is evaluated as
/// written: value and change cancel.
const FALLEN: f64 = 0.125;

/// A function of inputs that are 0 at rest, near rest, in a graph that is given; and whether it is 0 there itself.
/// Of all other inputs nothing is known. The function as it was where it is no number at rest.
pub(crate) fn near_of_vanishing(
    graph: &mut Simplifier,
    source: &ExprGraph,
    root: NodeId,
    vanishing: &[Input],
) -> Result<(NodeId, bool), TooManyNodes> {
    let place = folded_into(graph, source, &[root])?;
    let variables = at_nothing(vanishing);
    let of = Source { graph: source, place: &place };
    let mut expander = Expander::new(graph, of, &variables, &[]);
    let Some(near) = expander.run(root)? else { return Ok((place[root.0 as usize], false)) };
    if let Some(Near::Unknown(node)) = expander.known[root.0 as usize] {
        return Ok((node, false));
    }
    let vanishes = near.value.is_nothing();
    let total = expander.total(&near)?;
    let needed = source.reachable(&[root]);
    let mut nodes = source.nodes().filter(|(id, _)| needed[id.0 as usize]);
    let is_exponential = nodes.any(|(_, node)| matches!(node, Node::Unary(Function::Exp, _)));
    let is_sum = matches!(source[root], Node::Binary(Operator::Add | Operator::Subtract, ..));
    if vanishes || near.is_constant() || is_sum || !is_exponential {
        return Ok((total, vanishes));
    }
    let (written, fallen) = (place[root.0 as usize], FALLEN * near.value.value.to_f64().abs());
    let size = graph.unary(Function::Abs, written)?;
    let bound = graph.number(fallen)?;
    let has_fallen = graph.make(Node::Compare(Comparison::Less, size, bound))?;
    Ok((graph.make(Node::Select(has_fallen, written, total))?, false))
}

/// A factor that depends on fields alone, 1 where there is none, and a term without fields.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Product {
    factor: Option<NodeId>,
    term: NodeId,
}

/// A sum of products; nothing where a node is none.
type Sum = Option<Vec<Product>>;

/// The energy as such a sum, in the same graph; nothing where it is none, or holds no field.
fn products(
    graph: &mut Simplifier,
    root: NodeId,
    is_field: impl Fn(Input) -> bool,
) -> Result<Sum, TooManyNodes> {
    let source = graph.graph().clone();
    let held = Held::new(&source, is_field);
    if !held.fields[root.0 as usize] {
        return Ok(None);
    }
    let needed = source.reachable(&[root]);
    let mut sums: Vec<Sum> = vec![None; source.len()];
    for (id, node) in source.nodes().filter(|(id, _)| needed[id.0 as usize]) {
        sums[id.0 as usize] = held.sum(graph, &sums, id, node)?.filter(|sum| sum.len() <= MOST);
    }
    Ok(sums[root.0 as usize].take())
}

/// Which nodes of a graph depend on what.
struct Held {
    fields: Vec<bool>,
    variables: Vec<bool>,
}

impl Held {
    fn new(graph: &ExprGraph, is_one: impl Fn(Input) -> bool) -> Held {
        let mut held = Held { fields: Vec::new(), variables: Vec::new() };
        for (_, node) in graph.nodes() {
            let (is_field, is_input) = match node {
                Node::Input(input) => (is_one(input), true),
                _ => (false, false),
            };
            let of = |known: &[bool]| node.operands().any(|x| known[x.0 as usize]);
            let (has_fields, has_variables) = (of(&held.fields), of(&held.variables));
            held.fields.push(is_field || has_fields);
            held.variables.push((is_input && !is_field) || has_variables);
        }
        held
    }

    fn sum(
        &self,
        graph: &mut Simplifier,
        sums: &[Sum],
        id: NodeId,
        node: Node,
    ) -> Result<Sum, TooManyNodes> {
        let i = id.0 as usize;
        if !self.fields[i] {
            return Ok(Some(vec![Product { factor: None, term: id }]));
        }
        // Also of what depends on fields alone: `mu/2` and `mu` have one factor.
        let made = self.combined(graph, sums, node)?;
        if made.is_none() && !self.variables[i] {
            let term = graph.number(1.0)?;
            return Ok(Some(vec![Product { factor: Some(id), term }]));
        }
        Ok(made)
    }

    fn combined(
        &self,
        graph: &mut Simplifier,
        sums: &[Sum],
        node: Node,
    ) -> Result<Sum, TooManyNodes> {
        let of = |x: NodeId| sums[x.0 as usize].as_ref();
        match node {
            Node::Unary(Function::Negate, x) => of(x).map(|x| negated(graph, x)).transpose(),
            Node::Binary(operator, x, y) => {
                let (Some(x), Some(y)) = (of(x), of(y)) else { return Ok(None) };
                match operator {
                    Operator::Add => joined(graph, x, y).map(Some),
                    Operator::Subtract => {
                        let y = negated(graph, y)?;
                        joined(graph, x, &y).map(Some)
                    }
                    Operator::Multiply => multiplied(graph, x, y),
                    Operator::Divide => divided(graph, x, y),
                    _ => Ok(None),
                }
            }
            _ => Ok(None),
        }
    }
}

fn negated(graph: &mut Simplifier, sum: &[Product]) -> Result<Vec<Product>, TooManyNodes> {
    let negated = |product: &Product| Ok(Product { term: graph.negate(product.term)?, ..*product });
    sum.iter().map(negated).collect()
}

/// The sum of two sums: terms with one factor add up.
fn joined(
    graph: &mut Simplifier,
    x: &[Product],
    y: &[Product],
) -> Result<Vec<Product>, TooManyNodes> {
    let mut sum = x.to_vec();
    for product in y {
        match sum.iter_mut().find(|known| known.factor == product.factor) {
            Some(known) => known.term = graph.add(known.term, product.term)?,
            None => sum.push(*product),
        }
    }
    Ok(sum)
}

fn multiplied(graph: &mut Simplifier, x: &[Product], y: &[Product]) -> Result<Sum, TooManyNodes> {
    if x.len() * y.len() > MOST {
        return Ok(None);
    }
    let mut sum = Vec::new();
    for p in x {
        for q in y {
            let factor = match (p.factor, q.factor) {
                (Some(p), Some(q)) => Some(graph.multiply(p, q)?),
                (only, None) | (None, only) => only,
            };
            let product = Product { factor, term: graph.multiply(p.term, q.term)? };
            sum = joined(graph, &sum, &[product])?;
        }
    }
    Ok(Some(sum))
}

/// A divisor is one product.
fn divided(graph: &mut Simplifier, x: &[Product], y: &[Product]) -> Result<Sum, TooManyNodes> {
    let [divisor] = y else { return Ok(None) };
    let mut sum = Vec::new();
    for p in x {
        let factor = match (p.factor, divisor.factor) {
            (factor, None) => factor,
            (factor, Some(by)) => {
                let one = graph.number(1.0)?;
                Some(graph.binary(Operator::Divide, factor.unwrap_or(one), by)?)
            }
        };
        let term = graph.binary(Operator::Divide, p.term, divisor.term)?;
        sum.push(Product { factor, term });
    }
    Ok(Some(sum))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::model;

    /// The factors and terms of an energy of one variable, here `J`, in which parameters are fields.
    fn split(psi: &str) -> Option<Vec<(String, String)>> {
        let model = model(&format!("potential p\nparameter p\nparameter q\npsi(l) = {psi}"));
        let source = &model.variant(3).unwrap().energies[0];
        let mut graph = Simplifier::exact();
        let mut place = Vec::new();
        for (_, node) in model.variant(3).unwrap().graph.nodes() {
            let made = graph.make(node.map_operands(|x: NodeId| place[x.0 as usize])).unwrap();
            place.push(made);
        }
        let is_field = |input| matches!(input, Input::Parameter(_));
        let found = products(&mut graph, place[source.root.0 as usize], is_field).unwrap()?;
        let text = |id| crate::print::expression(&model, graph.graph(), id);
        let one = |product: &Product| (product.factor.map_or("1".into(), text), text(product.term));
        Some(found.iter().map(one).collect())
    }

    #[test]
    fn sums_are_taken_apart_by_their_fields() {
        let of = |text: &str| split(text).unwrap_or_default();
        let pair = |x: &str, y: &str| (x.to_string(), y.to_string());
        assert_eq!(of("p*l^2 - 2*p*l"), [pair("p", "l^2 - 2*l")]);
        assert_eq!(of("p/q*(l - L) + l"), [pair("1", "l"), pair("p/q", "L*(l/L - 1)")]);
        assert_eq!(of("(p + l)*(q - l)/q").len(), 4);
        assert_eq!(of("l^2/(p*l)"), [pair("1/p", "l^2/l")]);
        assert_eq!(of("p/2*l^2 - (p + 3)*l"), [pair("p", "0.5*l^2 - l"), pair("1", "-(3*l)")]);
        assert_eq!(split("exp(p*l)"), None);
        assert_eq!(split("l/(p + l)"), None);
        assert_eq!(split("l^2"), None);
    }
}
