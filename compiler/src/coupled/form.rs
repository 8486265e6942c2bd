//! The form in which an energy of several measures is evaluated.
//!
//! Rules that keep digits know one measure at a time, lengths of bonds for instance: each measure takes
//! that place in turn, after sums of several. What an angle changes by follows from what sides and area change by, so that it
//! keeps the digits of these.

use super::{CoupledForm, sums, variables};
use crate::clique::{Part, Variable};
use crate::density::DensityForm;
use crate::expression::{Input, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;
use crate::point::adjoint::{self, Varied};
use crate::rewrite::{expand, rewrite};
use crate::simplify::Simplifier;
use crate::specialise::Form;

type Made = Result<NodeId, TooManyNodes>;

/// psi, its gradient by all that it depends on and its product in one graph.
pub(super) fn make(
    graph: Simplifier,
    psi: NodeId,
    clique: Measure,
    which: Form,
    fields: &[u16],
) -> Result<CoupledForm, TooManyNodes> {
    let variables = variables(graph.graph(), &[psi], clique);
    let whole = Variable::whole(clique);
    let angles = (0..3).map(Part::Angle);
    let parts = variables.iter().map(|v| v.inputs[0]).filter(|input| *input != whole.inputs[0]);
    let parts: Vec<Input> = parts.chain(angles.map(Input::Part)).collect();
    let is_accurate = which == Form::Accurate;
    let keep_digits = |graph: Simplifier, roots: Vec<NodeId>| match is_accurate {
        true => accurate(graph, roots, clique, &parts),
        false => Ok((graph, roots)),
    };
    let (graph, roots) = keep_digits(graph, vec![psi])?;
    let (mut graph, roots) = substituted(&graph, &roots, |target, input| match input {
        Input::Part(Part::Angle(k)) => angle(target, k, Time::Now),
        Input::PartAtRest(Part::Angle(k)) => angle(target, k, Time::Rest),
        Input::PartChange(Part::Angle(k)) => change_of_angle(target, k),
        other => target.input(other),
    })?;
    let gradient = adjoint::gradient(&mut graph, roots[0], Varied::Clique(&variables))?;
    let (mut graph, roots) = keep_digits(graph, [&roots[..], &gradient].concat())?;
    let product = adjoint::product(&mut graph, &roots[1..], Varied::Clique(&variables))?;
    let (graph, roots) = graph.graph().extract(&[roots, product].concat());
    let density = DensityForm::new(graph, &roots, inputs(&variables), fields);
    Ok(CoupledForm { density, variables })
}

/// What the arrays of programs hold, in their order.
fn inputs(variables: &[Variable]) -> Vec<Input> {
    let of = |k: usize| variables.iter().map(move |variable| variable.inputs[k]);
    let directions = (0..variables.len() as u8).map(Input::Direction);
    of(0).chain(of(1)).chain(of(2)).chain(directions).collect()
}

/// The roots in the form that keeps the digits of every measure.
pub(crate) fn accurate(
    graph: Simplifier,
    roots: Vec<NodeId>,
    clique: Measure,
    parts: &[Input],
) -> Result<(Simplifier, Vec<NodeId>), TooManyNodes> {
    let (mut graph, roots) = sums::by_changes(&graph, &roots)?;
    let mut roots = rewritten(&mut graph, &roots, clique)?;
    for part in parts {
        // What the ends have moved by is no measure, and nothing of it cancels with a value at rest.
        let Input::Part(part) = *part else { continue };
        if matches!(part, Part::Moved(_)) {
            continue;
        }
        if !graph.graph().depends_on(&roots, Input::Part(part)) {
            continue;
        }
        let length = Measure::Length;
        let pairs = [
            (Input::Part(part), Input::Current(length)),
            (Input::PartAtRest(part), Input::Reference(length)),
            (Input::PartChange(part), Input::Change(length)),
        ];
        let there = |input: Input| pairs.iter().find(|(own, _)| *own == input).map(|pair| pair.1);
        let back = |input: Input| pairs.iter().find(|(_, of)| *of == input).map(|pair| pair.0);
        let (mut lent, own) = substituted(&graph, &roots, |target, input| {
            target.input(there(input).unwrap_or(input))
        })?;
        let own = rewritten(&mut lent, &own, length)?;
        (graph, roots) =
            substituted(&lent, &own, |target, input| target.input(back(input).unwrap_or(input)))?;
    }
    Ok((graph, roots))
}

/// Each of the roots by the rules for one measure, strains worked out.
fn rewritten(
    graph: &mut Simplifier,
    roots: &[NodeId],
    measure: Measure,
) -> Result<Vec<NodeId>, TooManyNodes> {
    let mut applied = Vec::new();
    let made: Result<Vec<NodeId>, TooManyNodes> =
        roots.iter().map(|root| rewrite(graph, *root, measure, &mut applied)).collect();
    expand(graph, &made?, measure, &mut applied)
}

/// The same roots in a graph of their own, with something in the place of inputs.
pub(crate) fn substituted(
    graph: &Simplifier,
    roots: &[NodeId],
    mut input: impl FnMut(&mut Simplifier, Input) -> Made,
) -> Result<(Simplifier, Vec<NodeId>), TooManyNodes> {
    let (needed, mut target) = (graph.graph().reachable(roots), Simplifier::new());
    let mut place = vec![NodeId(0); needed.len()];
    for (id, node) in graph.graph().nodes().filter(|(id, _)| needed[id.0 as usize]) {
        place[id.0 as usize] = match node {
            Node::Input(own) => input(&mut target, own)?,
            _ => target.make(node.map_operands(|x| place[x.0 as usize]))?,
        };
    }
    let roots = roots.iter().map(|root| place[root.0 as usize]).collect();
    Ok((target, roots))
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Time {
    Now,
    Rest,
}

/// The area measure of the triangle.
fn area(graph: &mut Simplifier, time: Time) -> Made {
    graph.input(match time {
        Time::Now => Input::Current(Measure::Area),
        Time::Rest => Input::Reference(Measure::Area),
    })
}

/// The scalar product of the sides that meet at a corner, `(l1^2 + l2^2 - l3^2)/2`.
fn product_of_sides(graph: &mut Simplifier, corner: u8, time: Time) -> Made {
    let squares = Part::sides(corner).map(|side| {
        let side = graph.input(match time {
            Time::Now => Input::Part(side),
            Time::Rest => Input::PartAtRest(side),
        })?;
        graph.power(side, 2.0)
    });
    let [first, second, across] = squares;
    half_of_sum(graph, first?, second?, across?)
}

/// `(x + y - z)/2`
fn half_of_sum(graph: &mut Simplifier, x: NodeId, y: NodeId, z: NodeId) -> Made {
    let sum = graph.add(x, y)?;
    let sum = graph.subtract(sum, z)?;
    let half = graph.number(0.5)?;
    graph.multiply(half, sum)
}

/// The angle at a corner: its tangent is the area measure over the product of the sides.
fn angle(graph: &mut Simplifier, corner: u8, time: Time) -> Made {
    let (sine, cosine) = (area(graph, time)?, product_of_sides(graph, corner, time)?);
    graph.binary(Operator::Atan2, sine, cosine)
}

/// What an angle changes by, in parts of itself at rest. Of the area `a = A (1 + e)` and the product of the
/// sides `c = C + k`, its tangent is `(a C - A c)/(a A + c C)`, with `a C - A c = A (e C - k)`.
fn change_of_angle(graph: &mut Simplifier, corner: u8) -> Made {
    let grown = Part::sides(corner).map(|side| {
        let rest = graph.input(Input::PartAtRest(side))?;
        let change = graph.input(Input::PartChange(side))?;
        let two = graph.number(2.0)?;
        let sum = graph.add(two, change)?;
        let square = graph.power(rest, 2.0)?;
        let grown = graph.multiply(change, sum)?;
        graph.multiply(square, grown)
    });
    let [first, second, across] = grown;
    let k = half_of_sum(graph, first?, second?, across?)?;
    let (a, rest) = (area(graph, Time::Now)?, area(graph, Time::Rest)?);
    let c = product_of_sides(graph, corner, Time::Now)?;
    let c_at_rest = product_of_sides(graph, corner, Time::Rest)?;
    let e = graph.input(Input::Change(Measure::Area))?;
    let turned = graph.multiply(e, c_at_rest)?;
    let turned = graph.subtract(turned, k)?;
    let sine = graph.multiply(rest, turned)?;
    let (along, across) = (graph.multiply(a, rest)?, graph.multiply(c, c_at_rest)?);
    let cosine = graph.add(along, across)?;
    let change = graph.binary(Operator::Atan2, sine, cosine)?;
    let at_rest = angle(graph, corner, Time::Rest)?;
    graph.divide(change, at_rest)
}
