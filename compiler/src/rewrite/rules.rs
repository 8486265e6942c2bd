//! The rules, one function each.

use super::monomial::{Base, Monomial, Monomials, strain, stretch};
use super::{Applied, named};
use crate::expression::{Comparison, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;
use crate::simplify::Simplifier;

type Made = Result<NodeId, TooManyNodes>;
/// What a rule makes of a node: nothing where it does not apply.
type Rewritten = Result<Option<(&'static str, NodeId)>, TooManyNodes>;

/// A term of a sum: whether it is added, and what it is.
type Term = (bool, NodeId);

/// Applies the rules to nodes whose operands are rewritten.
pub(super) struct Rules {
    measure: Measure,
    monomials: Monomials,
    pub(super) applied: Vec<Applied>,
}

impl Rules {
    pub(super) fn new(measure: Measure) -> Rules {
        Rules { measure, monomials: Monomials::new(measure), applied: Vec::new() }
    }

    /// What a node becomes.
    pub(super) fn apply(&mut self, graph: &mut Simplifier, id: NodeId) -> Made {
        let mut current = id;
        // Each rule leads to fewer differences, so few follow one another.
        for _ in 0..4 {
            let Some((name, after)) = self.one(graph, current)? else { break };
            if after == current {
                break;
            }
            self.applied.push(Applied { rule: named(name), before: current, after });
            current = after;
        }
        Ok(current)
    }

    fn one(&mut self, graph: &mut Simplifier, id: NodeId) -> Rewritten {
        match graph.graph()[id] {
            Node::Binary(Operator::Add | Operator::Subtract, ..) => {
                let terms = terms(graph, id);
                match terms.as_slice() {
                    [x, y] => self.pair(graph, *x, *y),
                    [_, _, _] => self.perfect_square(graph, &terms),
                    _ => Ok(None),
                }
            }
            Node::Unary(Function::Ln, x) => self.logarithm(graph, x),
            // In strong compression the change has lost what is left of the length.
            Node::Unary(Function::Log1p, x) if self.is_change(graph, x) => {
                let strain = strain(graph, self.measure, 0.0)?;
                Ok(Some(("logarithm_of_change", strain)))
            }
            _ => Ok(None),
        }
    }

    fn is_change(&self, graph: &Simplifier, id: NodeId) -> bool {
        graph.graph()[id] == Node::Input(Input::Change(self.measure))
    }

    fn pair(&mut self, graph: &mut Simplifier, x: Term, y: Term) -> Rewritten {
        if let Some(made) = self.rebuilt_stretch(graph, x, y)? {
            return Ok(Some(("rebuild_stretch", made)));
        }
        self.difference_of_powers(graph, x, y)
    }

    /// `1 + e = l/L`
    fn rebuilt_stretch(
        &mut self,
        graph: &mut Simplifier,
        x: Term,
        y: Term,
    ) -> Result<Option<NodeId>, TooManyNodes> {
        if !(x.0 && y.0) {
            return Ok(None);
        }
        let one = |id: NodeId| graph.graph().as_number(id) == Some(1.0);
        let rebuilt =
            (one(x.1) && self.is_change(graph, y.1)) || (one(y.1) && self.is_change(graph, x.1));
        if rebuilt { stretch(graph, self.measure).map(Some) } else { Ok(None) }
    }

    fn signed(&mut self, graph: &Simplifier, (added, id): Term) -> Option<Monomial> {
        let monomial = self.monomials.of(graph.graph(), id)?;
        Some(Monomial {
            factor: if added { monomial.factor } else { -monomial.factor },
            ..monomial
        })
    }

    /// `c*x^p - c*x^q`, of the stretch or of an exponential.
    fn difference_of_powers(&mut self, graph: &mut Simplifier, x: Term, y: Term) -> Rewritten {
        let (Some(x), Some(y)) = (self.signed(graph, x), self.signed(graph, y)) else {
            return Ok(None);
        };
        if !x.comparable(&y) || x.factor != -y.factor || x.exponent == y.exponent {
            return Ok(None);
        }
        // What stands outside is the power nearer to 1.
        let (near, far) = if x.exponent.abs() <= y.exponent.abs() { (x, y) } else { (y, x) };
        let Some(base) = near.base.or(far.base) else { return Ok(None) };
        let gap = far.exponent - near.exponent;
        let outside = Monomial { factor: far.factor, ..near };
        match base {
            Base::Stretch => {
                let factor = outside.factor * gap;
                let made = Monomial { factor, strain: Some((gap, 1.0)), ..outside };
                let made = made.node(graph, self.measure)?;
                Ok(Some(("difference_of_powers", made)))
            }
            Base::Exponential(argument) => {
                let outside = outside.node(graph, self.measure)?;
                let gap = graph.number(gap)?;
                let argument = graph.multiply(gap, argument)?;
                let inside = graph.unary(Function::Expm1, argument)?;
                let made = graph.multiply(outside, inside)?;
                Ok(Some(("difference_of_exponentials", made)))
            }
        }
    }

    /// `c*t^2 - 2*c*t*u + c*u^2`
    fn perfect_square(&mut self, graph: &mut Simplifier, terms: &[Term]) -> Rewritten {
        let mut found = Vec::new();
        for &term in terms {
            let Some(monomial) = self.signed(graph, term) else { return Ok(None) };
            found.push(monomial);
        }
        found.sort_by(|x, y| x.exponent.total_cmp(&y.exponent));
        let [low, middle, high] = [found[0], found[1], found[2]];
        let comparable =
            low.comparable(&middle) && middle.comparable(&high) && low.comparable(&high);
        let step = middle.exponent - low.exponent;
        if !comparable
            || step == 0.0
            || high.exponent - middle.exponent != step
            || low.factor != high.factor
            || middle.factor != -2.0 * low.factor
        {
            return Ok(None);
        }
        let Some(base) = low.base.or(high.base) else { return Ok(None) };
        // The square of t - u, with whichever of t^2, u^2 is nearer to 1 outside.
        let (outside, gap) =
            if low.exponent.abs() <= high.exponent.abs() { (low, step) } else { (high, -step) };
        let made = match base {
            Base::Stretch => {
                let factor = outside.factor * gap * gap;
                Monomial { factor, strain: Some((gap, 2.0)), ..outside }
                    .node(graph, self.measure)?
            }
            Base::Exponential(argument) => {
                let outside = outside.node(graph, self.measure)?;
                let gap = graph.number(gap)?;
                let argument = graph.multiply(gap, argument)?;
                let inside = graph.unary(Function::Expm1, argument)?;
                let square = graph.power(inside, 2.0)?;
                graph.multiply(outside, square)?
            }
        };
        Ok(Some(("perfect_square", made)))
    }

    fn logarithm(&mut self, graph: &mut Simplifier, x: NodeId) -> Rewritten {
        if let Some(order) = self.stretch_power(graph, x) {
            let factor = graph.number(order)?;
            let strain = strain(graph, self.measure, 0.0)?;
            let made = graph.multiply(factor, strain)?;
            return Ok(Some(("logarithm_of_stretch", made)));
        }
        let Some((y, root, number)) = sum_with_root(graph, x) else { return Ok(None) };
        let zero = graph.number(0.0)?;
        let is_negative = graph.make(Node::Compare(Comparison::Less, y, zero))?;
        let other = graph.subtract(root, y)?;
        let other = graph.unary(Function::Ln, other)?;
        let number = graph.unary(Function::Ln, number)?;
        let left = graph.subtract(number, other)?;
        let right = graph.unary(Function::Ln, x)?;
        let made = graph.make(Node::Select(is_negative, left, right))?;
        Ok(Some(("inverse_hyperbolic_sine", made)))
    }

    /// The exponent of a plain power of the stretch that is defined where the logarithm of the
    /// stretch is, and only there.
    fn stretch_power(&mut self, graph: &Simplifier, x: NodeId) -> Option<f64> {
        let monomial = self.monomials.of(graph.graph(), x)?;
        let plain = monomial.base == Some(Base::Stretch)
            && monomial.factor == 1.0
            && monomial.reference == 0.0
            && monomial.strain.is_none();
        let even = monomial.exponent % 2.0 == 0.0;
        (plain && !even).then_some(monomial.exponent)
    }

    /// `ln(1 + y)` and `ln(1 - y)` of an operand that is not rewritten yet: as a sum it may become a
    /// product, which no longer shows that it is near 1.
    pub(super) fn logarithm_of_sum(
        &mut self,
        graph: &mut Simplifier,
        id: NodeId,
        place: &[NodeId],
    ) -> Result<Option<NodeId>, TooManyNodes> {
        let Node::Unary(Function::Ln, sum) = graph.graph()[id] else { return Ok(None) };
        let (one, y, negative) = match graph.graph()[sum] {
            Node::Binary(Operator::Add, one, y) => (one, place[y.0 as usize], false),
            Node::Binary(Operator::Subtract, one, y) => (one, place[y.0 as usize], true),
            _ => return Ok(None),
        };
        if graph.graph().as_number(one) != Some(1.0) {
            return Ok(None);
        }
        let y = if negative { graph.negate(y)? } else { y };
        let made = graph.unary(Function::Log1p, y)?;
        self.applied.push(Applied { rule: named("logarithm_of_sum"), before: id, after: made });
        self.apply(graph, made).map(Some)
    }
}

/// `y`, the root and the number of `y + sqrt(y^2 + c)` with `c > 0`.
fn sum_with_root(graph: &Simplifier, x: NodeId) -> Option<(NodeId, NodeId, NodeId)> {
    let graph = graph.graph();
    let Node::Binary(Operator::Add, a, b) = graph[x] else { return None };
    let is_square = |square: NodeId, y: NodeId| match graph[square] {
        Node::PowerConstant(x, bits) => x == y && f64::from_bits(bits) == 2.0,
        Node::Binary(Operator::Multiply, p, q) => p == y && q == y,
        _ => false,
    };
    let parts = |root: NodeId, y: NodeId| {
        let Node::Unary(Function::Sqrt, sum) = graph[root] else { return None };
        let Node::Binary(Operator::Add, p, q) = graph[sum] else { return None };
        let number = |c: NodeId, square| {
            let is_number = graph.as_number(c).is_some_and(|c| c > 0.0);
            (is_number && is_square(square, y)).then_some((y, root, c))
        };
        number(p, q).or_else(|| number(q, p))
    };
    parts(b, a).or_else(|| parts(a, b))
}

/// The terms of a sum; empty if there are more than three.
fn terms(graph: &Simplifier, id: NodeId) -> Vec<Term> {
    let mut terms = Vec::new();
    let mut stack = vec![(true, id)];
    while let Some((added, id)) = stack.pop() {
        match graph.graph()[id] {
            Node::Binary(Operator::Add, x, y) => stack.extend([(added, y), (added, x)]),
            Node::Binary(Operator::Subtract, x, y) => stack.extend([(!added, y), (added, x)]),
            Node::Unary(Function::Negate, x) => stack.push((!added, x)),
            _ => terms.push((added, id)),
        }
        if stack.len() + terms.len() > 3 {
            return Vec::new();
        }
    }
    terms
}
