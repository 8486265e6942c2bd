//! Derivatives by several variables: the gradient by one sweep from the energy back to the variables,
//! its change in a direction by one sweep forward. Neither grows with the number of variables as
//! derivatives taken one by one would.

use crate::clique::Variable;
use crate::differentiate::{Derivative, at_tie, binary, derivative_of, power_constant, unary};
use crate::expression::{Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;
use crate::simplify::Simplifier;

/// The number of the first trace's direction; those of the components of a tensor are below.
pub(super) const TRACES: u8 = 9;

/// What an energy is differentiated by. An input and its change from rest are one variable.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Varied<'a> {
    /// The components of a tensor with these numbers, then so many traces.
    ComponentsAndTraces(&'a [u8], usize),
    /// A principal stretch, the variable of a function of `U`.
    Stretch,
    /// So many integrals over a family.
    Integrals(usize),
    /// The length of a bond, then so many integrals.
    LengthAndIntegrals(usize),
    /// Measures of a triangle or a tetrahedron and of its parts.
    Clique(&'a [Variable]),
    /// Inputs that do not depend on each other.
    Inputs(&'a [Input]),
}

impl Varied<'_> {
    pub(crate) fn len(self) -> usize {
        match self {
            Varied::ComponentsAndTraces(components, n) => components.len() + n,
            Varied::Stretch => 1,
            Varied::Integrals(n) => n,
            Varied::LengthAndIntegrals(n) => n + 1,
            Varied::Clique(variables) => variables.len(),
            Varied::Inputs(inputs) => inputs.len(),
        }
    }

    /// Which variable an input stands for.
    fn place(self, input: Input) -> Option<usize> {
        match (self, input) {
            (
                Varied::ComponentsAndTraces(known, _),
                Input::Variable(k) | Input::VariableChange(k),
            ) => known.iter().position(|known| *known == k),
            (Varied::ComponentsAndTraces(known, n), Input::Trace(k)) => {
                Some(known.len() + usize::from(k)).filter(|_| usize::from(k) < n)
            }
            (Varied::Stretch, Input::Stretch(_) | Input::StretchChange(_)) => Some(0),
            (Varied::Integrals(n), Input::Integral(k)) => Some(usize::from(k)).filter(|k| *k < n),
            (Varied::LengthAndIntegrals(n), Input::Integral(k)) => {
                Some(usize::from(k) + 1).filter(|k| *k <= n)
            }
            (
                Varied::LengthAndIntegrals(_),
                Input::Current(Measure::Length) | Input::Change(Measure::Length),
            ) => Some(0),
            (Varied::Clique(variables), input) => variables.iter().position(|variable| {
                let [now, _, change] = variable.inputs;
                input == now || input == change
            }),
            (Varied::Inputs(inputs), input) => inputs.iter().position(|own| *own == input),
            _ => None,
        }
    }

    /// The number of a variable's direction.
    fn direction(self, place: usize) -> u8 {
        match self {
            Varied::ComponentsAndTraces(components, _) => match components.get(place) {
                Some(component) => *component,
                None => TRACES + (place - components.len()) as u8,
            },
            _ => place as u8,
        }
    }
}

/// `part` times the derivative of an input by its variable: 1, or `1/L` of `(l - L)/L`.
fn slope(graph: &mut Simplifier, input: Input, part: NodeId) -> Result<NodeId, TooManyNodes> {
    match input {
        Input::Change(measure) => {
            let reference = graph.input(Input::Reference(measure))?;
            graph.divide(part, reference)
        }
        Input::PartChange(own) => {
            let reference = graph.input(Input::PartAtRest(own))?;
            graph.divide(part, reference)
        }
        _ => Ok(part),
    }
}

/// The derivatives of `root` by each of the variables.
pub(crate) fn gradient(
    graph: &mut Simplifier,
    root: NodeId,
    variables: Varied<'_>,
) -> Result<Vec<NodeId>, TooManyNodes> {
    let varies = varies(graph, root, variables);
    let finite = finite(graph, root);
    let mut adjoint: Vec<Adjoint> = vec![Adjoint::default(); varies.len()];
    let one = graph.number(1.0)?;
    adjoint[root.0 as usize].add(graph, one, true)?;
    let mut gradient: Vec<Option<NodeId>> = vec![None; variables.len()];
    for index in (0..varies.len()).rev().filter(|index| varies[*index]) {
        let id = NodeId(index as u32);
        for outer in std::mem::take(&mut adjoint[index]).terms {
            if let Node::Input(input) = graph.graph()[id]
                && let Some(place) = variables.place(input)
            {
                let part = slope(graph, input, outer)?;
                gradient[place] = Some(added(graph, gradient[place], part)?);
            }
            let parts = match finite[index] {
                true => parts(graph, id, outer, &varies)?,
                false => guarded(graph, id, outer, &varies)?,
            };
            for (operand, part) in parts {
                let operand = operand.0 as usize;
                if varies[operand] {
                    adjoint[operand].add(graph, part, finite[operand])?;
                }
            }
        }
    }
    gradient.into_iter().map(|part| part.map_or_else(|| graph.number(0.0), Ok)).collect()
}

/// What the root changes by with a node, as a sum of terms.
#[derive(Clone, Debug, Default)]
struct Adjoint {
    terms: Vec<NodeId>,
}

/// Most terms: beyond, nested choices would make more and more of them.
const MOST_TERMS: usize = 4;

impl Adjoint {
    /// Adds a term. Terms with one guard become one; a term and one with the opposite guard become a
    /// choice between both, which has none. Where everything is finite guards do not matter.
    fn add(
        &mut self,
        graph: &mut Simplifier,
        term: NodeId,
        finite: bool,
    ) -> Result<(), TooManyNodes> {
        for known in &mut self.terms {
            let joined = match (guard(graph, *known), guard(graph, term)) {
                (Some((c, side, x)), Some((other, other_side, y))) if c == other => {
                    if side == other_side {
                        let sum = graph.add(x, y)?;
                        chosen(graph, c, side, sum)?
                    } else {
                        let (x, y) = if side { (x, y) } else { (y, x) };
                        graph.make(Node::Select(c, x, y))?
                    }
                }
                (None, None) => graph.add(*known, term)?,
                _ if finite => graph.add(*known, term)?,
                _ => continue,
            };
            *known = joined;
            return Ok(());
        }
        self.terms.push(term);
        if self.terms.len() > MOST_TERMS {
            let mut sum = self.terms[0];
            for term in &self.terms[1..] {
                sum = graph.add(sum, *term)?;
            }
            self.terms = vec![sum];
        }
        Ok(())
    }
}

/// A term that counts on one side of a condition and is 0 on the other: the condition, the side, what
/// it is there.
fn guard(graph: &Simplifier, term: NodeId) -> Option<(NodeId, bool, NodeId)> {
    let Node::Select(c, x, y) = graph.graph()[term] else { return None };
    let is_zero = |id| graph.graph().as_number(id) == Some(0.0);
    match (is_zero(x), is_zero(y)) {
        (false, true) => Some((c, true, x)),
        (true, false) => Some((c, false, y)),
        _ => None,
    }
}

/// `x` on one side of a condition, 0 on the other.
fn chosen(
    graph: &mut Simplifier,
    c: NodeId,
    side: bool,
    x: NodeId,
) -> Result<NodeId, TooManyNodes> {
    let zero = graph.number(0.0)?;
    graph.make(if side { Node::Select(c, x, zero) } else { Node::Select(c, zero, x) })
}

/// Parts of a node that may be no number where its branch is not taken: guards stay outside, because 0
/// times what is no number is none.
fn guarded(
    graph: &mut Simplifier,
    id: NodeId,
    outer: NodeId,
    varies: &[bool],
) -> Result<Vec<(NodeId, NodeId)>, TooManyNodes> {
    let mut guards = Vec::new();
    let mut inner = outer;
    while let Some((c, side, x)) = guard(graph, inner) {
        guards.push((c, side));
        inner = x;
    }
    let mut parts = parts(graph, id, inner, varies)?;
    for (_, part) in &mut parts {
        for &(c, side) in guards.iter().rev() {
            *part = chosen(graph, c, side, *part)?;
        }
    }
    Ok(parts)
}

/// Which nodes that the root needs are finite wherever the inputs are, short of overflow.
fn finite(graph: &Simplifier, root: NodeId) -> Vec<bool> {
    let mut finite: Vec<bool> = Vec::with_capacity(root.0 as usize + 1);
    for (_, node) in graph.graph().nodes().take(root.0 as usize + 1) {
        let kept = match node {
            Node::Number(bits) => f64::from_bits(bits).is_finite(),
            Node::Input(_) | Node::Unary(Function::Negate, _) => true,
            Node::Binary(Operator::Add | Operator::Subtract | Operator::Multiply, ..) => true,
            Node::PowerConstant(_, bits) => {
                let exponent = f64::from_bits(bits);
                exponent >= 2.0 && exponent.fract() == 0.0
            }
            _ => false,
        };
        finite.push(kept && node.operands().all(|x| finite[x.0 as usize]));
    }
    finite
}

/// What the roots change by when every variable changes by its direction.
pub(crate) fn product(
    graph: &mut Simplifier,
    roots: &[NodeId],
    variables: Varied<'_>,
) -> Result<Vec<NodeId>, TooManyNodes> {
    let n = roots.iter().map(|root| root.0 as usize + 1).max().unwrap_or(0);
    let needed = graph.graph().reachable(roots);
    let mut known: Vec<Option<NodeId>> = vec![None; n];
    for index in (0..n).filter(|index| needed[*index]) {
        let of_input = |graph: &mut Simplifier, input| direction(graph, input, variables);
        known[index] = derivative_of(graph, NodeId(index as u32), &known, &of_input)?;
    }
    let of = |root: &NodeId| known[root.0 as usize];
    roots.iter().map(|root| of(root).map_or_else(|| graph.number(0.0), Ok)).collect()
}

fn direction(graph: &mut Simplifier, input: Input, variables: Varied<'_>) -> Derivative {
    let Some(place) = variables.place(input) else { return Ok(None) };
    let direction = graph.input(Input::Direction(variables.direction(place)))?;
    slope(graph, input, direction).map(Some)
}

/// Which of the nodes that the root needs depend on a variable.
fn varies(graph: &Simplifier, root: NodeId, variables: Varied<'_>) -> Vec<bool> {
    let n = root.0 as usize + 1;
    let needed = graph.graph().reachable(&[root]);
    let mut varies = vec![false; n];
    for (id, node) in graph.graph().nodes().take(n) {
        varies[id.0 as usize] = needed[id.0 as usize]
            && match node {
                Node::Input(input) => variables.place(input).is_some(),
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
    varies: &[bool],
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
        // ((x^n - 1)/n)' = x^(n-1)
        Node::Strain(x, bits) => {
            let power = graph.power(x, f64::from_bits(bits) - 1.0)?;
            push(x, Some(graph.multiply(power, outer)?));
        }
        Node::Binary(Operator::Multiply, x, y) if x == y => {
            // Twice the same operand: one product less.
            let two = graph.number(2.0)?;
            let twice = graph.multiply(two, x)?;
            push(x, Some(graph.multiply(twice, outer)?));
        }
        // One of both, as for one variable: which is asked once for both.
        Node::Binary(operator @ (Operator::Min | Operator::Max), x, y) => {
            let comparison = at_tie(operator, !varies[x.0 as usize]);
            let first = graph.make(Node::Compare(comparison, x, y))?;
            let zero = graph.number(0.0)?;
            push(x, Some(graph.make(Node::Select(first, outer, zero))?));
            push(y, Some(graph.make(Node::Select(first, zero, outer))?));
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
