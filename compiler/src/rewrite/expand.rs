//! The accurate form of every strain, and the forms that matter only for values.
//!
//! Before: psi and its derivatives with strains as nodes. After: none is left; every form is guarded where
//! it holds only in part: near rest `e` keeps the digits, far from it the stretch does.

use super::{Applied, monomial, named, values};
use crate::expression::{Function, Input, Node, NodeId, TooManyNodes};
use crate::measure::Measure;
use crate::simplify::Simplifier;

/// Up to here `expm1(z)` is closer to the truth than a power minus 1.
const SERIES: f64 = 0.5;
/// Below, `(exp(z) - 1)/z` rounds to 1, and `z` itself may lose digits to underflow.
const LOGARITHMIC: f64 = 1e-16;
/// Largest whole number `2*abs(n)` for which the strain is worked out by multiplication.
const LONGEST: f64 = 32.0;

type Made = Result<NodeId, TooManyNodes>;

/// The same roots without strains; what was done is added to `applied`.
pub fn expand(
    graph: &mut Simplifier,
    roots: &[NodeId],
    measure: Measure,
    applied: &mut Vec<Applied>,
) -> Result<Vec<NodeId>, TooManyNodes> {
    let needed = graph.graph().reachable(roots);
    let mut expansion = Expansion { measure, applied };
    let mut place: Vec<NodeId> = Vec::with_capacity(needed.len());
    for index in 0..needed.len() {
        let id = NodeId(index as u32);
        let made = if needed[index] { expansion.node(graph, id, &place)? } else { id };
        place.push(made);
    }
    Ok(roots.iter().map(|root| place[root.0 as usize]).collect())
}

struct Expansion<'a> {
    measure: Measure,
    applied: &'a mut Vec<Applied>,
}

impl Expansion<'_> {
    fn node(&mut self, graph: &mut Simplifier, id: NodeId, place: &[NodeId]) -> Made {
        let at = |x: NodeId| place[x.0 as usize];
        let node = graph.graph()[id];
        let (rule, made) = match node {
            Node::Strain(_, order) => self.strain(graph, f64::from_bits(order))?,
            _ => match values::value(graph, node, place)? {
                Some(made) => made,
                None => return graph.make(node.map_operands(at)),
            },
        };
        self.applied.push(Applied { rule: named(rule), before: id, after: made });
        Ok(made)
    }

    /// `S_n`
    fn strain(
        &self,
        graph: &mut Simplifier,
        order: f64,
    ) -> Result<(&'static str, NodeId), TooManyNodes> {
        let change = graph.input(Input::Change(self.measure))?;
        let stretch = monomial::stretch(graph, self.measure)?;
        let twice = 2.0 * order;
        if order != 0.0 && twice == twice.trunc() && twice.abs() <= LONGEST {
            let made = if order == order.trunc() {
                whole(graph, stretch, change, order as i32)?
            } else {
                // With s = sqrt(x): S_(m/2)(x) = 2*S_m(s), and s - 1 = e/(s + 1).
                let root = graph.unary(Function::Sqrt, stretch)?;
                let sum = add_one(graph, root)?;
                let root_change = graph.divide(change, sum)?;
                let made = whole(graph, root, root_change, twice as i32)?;
                let two = graph.number(2.0)?;
                graph.multiply(two, made)?
            };
            return Ok(("strain_of_whole_order", made));
        }
        let logarithm = values::logarithm(graph, self.measure)?;
        if order == 0.0 {
            return Ok(("strain_of_any_order", logarithm));
        }
        let n = graph.number(order)?;
        let z = graph.multiply(n, logarithm)?;
        let one = graph.number(1.0)?;
        let power = graph.power(stretch, order)?;
        let difference = graph.subtract(power, one)?;
        let far = graph.divide(difference, n)?;
        let exponential = graph.unary(Function::Expm1, z)?;
        let middle = graph.divide(exponential, n)?;
        let near = values::near(graph, z, SERIES)?;
        let outer = graph.make(Node::Select(near, middle, far))?;
        let tiny = values::near(graph, z, LOGARITHMIC)?;
        Ok(("strain_of_any_order", graph.make(Node::Select(tiny, logarithm, outer))?))
    }
}

fn add_one(graph: &mut Simplifier, x: NodeId) -> Made {
    let one = graph.number(1.0)?;
    graph.add(one, x)
}

/// `(x^n - 1)/n` with `e = x - 1` given; positive terms only for `x > 0`.
fn whole(graph: &mut Simplifier, x: NodeId, e: NodeId, n: i32) -> Made {
    if n % 2 == 0 {
        let half = whole(graph, x, e, n / 2)?;
        let power = graph.power(x, f64::from(n / 2))?;
        let sum = add_one(graph, power)?;
        let product = graph.multiply(half, sum)?;
        let factor = graph.number(0.5)?;
        return graph.multiply(factor, product);
    }
    // For n < 0 in powers of 1/x: nothing overflows that is not infinite itself.
    let (first, x) = if n > 0 {
        (e, x)
    } else {
        let one = graph.number(1.0)?;
        (graph.divide(e, x)?, graph.divide(one, x)?)
    };
    let mut sum = graph.number(1.0)?;
    for _ in 1..n.abs() {
        let product = graph.multiply(x, sum)?;
        sum = add_one(graph, product)?;
    }
    let product = graph.multiply(first, sum)?;
    let divisor = graph.number(f64::from(n.abs()))?;
    graph.divide(product, divisor)
}
