//! Energies of gathered values near rest: of points functions of the integrals that are 0 at rest, of bonds of the
//! stretch, too.
//!
//! What a bond was at rest is known before no run, as the other integrals are, and cancels with nothing. So the energy
//! is first written as a power of `L` times a function of `l/L`, which every energy is whose units are right and
//! that knows no other length; terms are taken apart by what is known in a run alone.

mod samples;

use std::cmp::Ordering;

use crate::expression::{
    Comparison, ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes,
};
use crate::measure::Measure;
use crate::point::adjoint::{self, Varied};
use crate::point::near::{near_of_gathered, with_fields};
use crate::simplify::Simplifier;
use crate::specialise::substituted_into;
use samples::Samples;

/// Up to this strain a form near rest serves.
const REACH: f64 = 0.25;
/// Larger graphs are left as the rules made them.
const LARGEST: usize = 600;

type Made = Result<NodeId, TooManyNodes>;

/// psi and its derivatives in the forms that keep their digits: `ruled` are those by the rules, of points as written;
/// `written` is the energy in the graph with all digits of its numbers. A form near rest serves bonds near rest, and
/// points anywhere, of which nobody knows how far from rest they are; it is taken where the other loses more.
pub(super) fn kept(
    graph: &mut Simplifier,
    (exact, written): (&Simplifier, NodeId),
    ruled: Vec<NodeId>,
    (of_bonds, n_integrals): (bool, usize),
    vanishing: &[Input],
) -> Result<Vec<NodeId>, TooManyNodes> {
    if exact.graph().len() > LARGEST {
        return Ok(ruled);
    }
    let (psi, varied) = match of_bonds {
        true => (
            of_bonds_near_rest(graph, exact, written, vanishing)?,
            Varied::LengthAndIntegrals(n_integrals),
        ),
        false => {
            (expanded(graph, (exact, written), (false, vanishing))?, Varied::Integrals(n_integrals))
        }
    };
    let Some(psi) = psi else { return Ok(ruled) };
    let mut near = vec![psi];
    near.extend(adjoint::gradient(graph, psi, varied)?);
    near.extend(adjoint::product(graph, &near[1..], varied)?);
    let samples = Samples::new((exact.graph(), written), (of_bonds, n_integrals), vanishing);
    let lost = samples.lost(graph.graph(), [&ruled, &near]);
    let of_form = |k: usize| lost.iter().map(|lost| lost[k]).sum::<usize>();
    if of_form(1) >= of_form(0) {
        return Ok(ruled);
    }
    let change = graph.input(Input::Change(Measure::Length))?;
    let size = graph.unary(Function::Abs, change)?;
    let limit = graph.number(REACH)?;
    let is_near = graph.make(Node::Compare(Comparison::Less, size, limit))?;
    let mut kept = Vec::new();
    for ((ruled, near), lost) in ruled.into_iter().zip(near).zip(lost) {
        kept.push(match (of_bonds, lost[1].cmp(&lost[0])) {
            (true, Ordering::Less | Ordering::Equal) => {
                graph.make(Node::Select(is_near, near, ruled))?
            }
            (false, Ordering::Less) => near,
            _ => ruled,
        });
    }
    Ok(kept)
}

/// An energy by remainders at rest, of what varies and is known there; nothing where it is no number there.
fn expanded(
    graph: &mut Simplifier,
    subject: (&Simplifier, NodeId),
    (of_bonds, vanishing): (bool, &[Input]),
) -> Result<Option<NodeId>, TooManyNodes> {
    // What has some value at rest that no form knows.
    let is_field = |input| match input {
        Input::Parameter(_) | Input::Reference(_) => true,
        Input::Integral(_) => !vanishing.contains(&input),
        _ => false,
    };
    with_fields(graph, subject, is_field, |graph, source, root| {
        near_of_gathered(graph, source, root, (of_bonds, vanishing))
    })
}

/// The same of an energy of bonds, with lengths for stretches.
fn of_bonds_near_rest(
    graph: &mut Simplifier,
    exact: &Simplifier,
    written: NodeId,
    vanishing: &[Input],
) -> Result<Option<NodeId>, TooManyNodes> {
    let Some((stretched, factor)) = stretched(exact.graph(), written)? else { return Ok(None) };
    let mut apart = Simplifier::new();
    let found = expanded(&mut apart, (&stretched, factor.node), (true, vanishing))?;
    let Some(found) = found else { return Ok(None) };
    let reference = graph.input(Input::Reference(Measure::Length))?;
    let length = graph.input(Input::Current(Measure::Length))?;
    let stretch = graph.divide(length, reference)?;
    let instead = |input: Input| (input == Input::Stretch(0)).then_some(stretch);
    let place = substituted_into(graph, apart.graph(), &[found], instead)?;
    scaled_by(graph, reference, factor.degree, place[found.0 as usize]).map(Some)
}

/// `L^degree` times a node.
fn scaled_by(graph: &mut Simplifier, reference: NodeId, degree: f64, node: NodeId) -> Made {
    if degree == 0.0 {
        return Ok(node);
    }
    let power = graph.power(reference, degree)?;
    graph.multiply(power, node)
}

/// A node as `L^degree` times another, in which lengths are stretches.
#[derive(Clone, Copy)]
struct Scaled {
    degree: f64,
    node: NodeId,
}

/// A function of a length as a power of that at rest times a function of the stretch, `Stretch(0)`, in a graph of its
/// own; nothing for a graph that rules have been at.
fn stretched(
    source: &ExprGraph,
    root: NodeId,
) -> Result<Option<(Simplifier, Scaled)>, TooManyNodes> {
    let needed = source.reachable(&[root]);
    let mut target = Simplifier::exact();
    let mut known: Vec<Scaled> = Vec::with_capacity(source.len());
    for (id, node) in source.nodes() {
        let scaled = match needed[id.0 as usize] {
            true => scaled(&mut target, &known, node)?,
            false => Some(Scaled { degree: 0.0, node: NodeId(0) }),
        };
        let Some(scaled) = scaled else { return Ok(None) };
        known.push(scaled);
    }
    Ok(Some((target, known[root.0 as usize])))
}

/// A node from its operands.
fn scaled(
    target: &mut Simplifier,
    known: &[Scaled],
    node: Node,
) -> Result<Option<Scaled>, TooManyNodes> {
    let of = |x: NodeId| known[x.0 as usize];
    let plain = |node: Made| node.map(|node| Some(Scaled { degree: 0.0, node }));
    let made = |degree: f64, node: Made| node.map(|node| Some(Scaled { degree, node }));
    match node {
        Node::Input(Input::Current(_)) => made(1.0, target.input(Input::Stretch(0))),
        Node::Input(Input::Reference(_)) => made(1.0, target.number(1.0)),
        Node::Input(Input::Change(_)) => {
            let (stretch, one) = (target.input(Input::Stretch(0))?, target.number(1.0)?);
            plain(target.subtract(stretch, one))
        }
        Node::Strain(..) => Ok(None),
        Node::Unary(function @ (Function::Negate | Function::Abs | Function::Sqrt), x) => {
            let by = if function == Function::Sqrt { 0.5 } else { 1.0 };
            made(by * of(x).degree, target.unary(function, of(x).node))
        }
        Node::Unary(Function::Sign, x) => plain(target.unary(Function::Sign, of(x).node)),
        Node::PowerConstant(x, bits) => {
            let exponent = f64::from_bits(bits);
            made(exponent * of(x).degree, target.power(of(x).node, exponent))
        }
        Node::Binary(Operator::Multiply, x, y) => {
            made(of(x).degree + of(y).degree, target.multiply(of(x).node, of(y).node))
        }
        Node::Binary(Operator::Divide, x, y) => {
            made(of(x).degree - of(y).degree, target.divide(of(x).node, of(y).node))
        }
        // What is of one degree keeps it, as `l - L`, or loses it, as `l < L`.
        Node::Binary(Operator::Add | Operator::Subtract | Operator::Min | Operator::Max, x, y)
        | Node::Select(_, x, y)
            if of(x).degree == of(y).degree =>
        {
            made(of(x).degree, target.make(node.map_operands(|x| of(x).node)))
        }
        Node::Compare(_, x, y) | Node::Binary(Operator::Atan2, x, y)
            if of(x).degree == of(y).degree =>
        {
            plain(target.make(node.map_operands(|x| of(x).node)))
        }
        _ => {
            let mut operands = Vec::new();
            for x in node.operands() {
                let reference = target.input(Input::Reference(Measure::Length))?;
                operands.push(scaled_by(target, reference, of(x).degree, of(x).node)?);
            }
            let mut operands = operands.into_iter();
            plain(target.make(node.map_operands(|_| operands.next().expect("one per operand"))))
        }
    }
}
