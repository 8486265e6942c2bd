//! Sums in which measures cancel each other: every rule that keeps digits knows one measure, and here are
//! several.
//!
//! `l1/L1 - l2/L2` is 0 at rest and loses there what it is; what both change by has all digits. So a sum
//! whose measures over their values at rest and whose numbers add up to 0 becomes one of changes. The
//! cosine of an angle less that at rest is `-2 sin((angle + Angle)/2) sin((angle - Angle)/2)`.

use crate::clique::Part;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::simplify::Simplifier;

/// Most terms of a sum that is looked at.
const MOST: usize = 64;

/// What a term of a sum is, times a number.
#[derive(Clone, Copy, PartialEq)]
enum Term {
    One,
    /// A measure over its value at rest, by what it changes by.
    Grown(Input),
    /// The cosine of an angle.
    Cosine(u8),
    /// The same at rest.
    CosineAtRest(u8),
    Other(NodeId),
}

/// The roots with such sums written by changes.
pub(super) fn by_changes(
    graph: &Simplifier,
    roots: &[NodeId],
) -> Result<(Simplifier, Vec<NodeId>), TooManyNodes> {
    let (source, mut target) = (graph.graph(), Simplifier::new());
    let needed = source.reachable(roots);
    let mut place = vec![NodeId(0); needed.len()];
    for (id, node) in source.nodes().filter(|(id, _)| needed[id.0 as usize]) {
        let sum = match node {
            Node::Binary(Operator::Add | Operator::Subtract, ..) => terms(source, id),
            _ => Vec::new(),
        };
        place[id.0 as usize] = match of_changes(&mut target, sum, &place)? {
            Some(written) => written,
            None => target.make(node.map_operands(|x| place[x.0 as usize]))?,
        };
    }
    let roots = roots.iter().map(|root| place[root.0 as usize]).collect();
    Ok((target, roots))
}

/// The terms of a sum with their coefficients, alike ones as one; none where there are too many.
fn terms(graph: &ExprGraph, sum: NodeId) -> Vec<(f64, Term)> {
    let (mut found, mut open): (Vec<(f64, Term)>, _) = (Vec::new(), vec![(1.0, sum)]);
    while let Some((factor, id)) = open.pop() {
        let term = match graph[id] {
            Node::Binary(Operator::Add, x, y) => {
                open.extend([(factor, x), (factor, y)]);
                continue;
            }
            Node::Binary(Operator::Subtract, x, y) => {
                open.extend([(factor, x), (-factor, y)]);
                continue;
            }
            Node::Unary(Function::Negate, x) => {
                open.push((-factor, x));
                continue;
            }
            Node::Number(bits) => (factor * f64::from_bits(bits), Term::One),
            node => match scaled(graph, node) {
                Some((number, x)) => {
                    open.push((factor * number, x));
                    continue;
                }
                None => term(graph, id, node, factor),
            },
        };
        match found.iter_mut().find(|(_, known)| *known == term.1) {
            Some((coefficient, _)) => *coefficient += term.0,
            None => found.push(term),
        }
        if found.len() + open.len() > MOST {
            return Vec::new();
        }
    }
    found
}

fn number(graph: &ExprGraph, id: NodeId) -> Option<f64> {
    match graph[id] {
        Node::Number(bits) => Some(f64::from_bits(bits)),
        _ => None,
    }
}

/// A number times something, or something over a number.
fn scaled(graph: &ExprGraph, node: Node) -> Option<(f64, NodeId)> {
    match node {
        Node::Binary(Operator::Multiply, x, y) => {
            number(graph, x).map(|x| (x, y)).or_else(|| Some((number(graph, y)?, x)))
        }
        Node::Binary(Operator::Divide, x, y) => Some((1.0 / number(graph, y)?, x)),
        _ => None,
    }
}

/// A term that is no sum and no multiple, but for `2*l1/L1`, times a factor.
fn term(graph: &ExprGraph, id: NodeId, node: Node, factor: f64) -> (f64, Term) {
    let input = |id: NodeId| match graph[id] {
        Node::Input(input) => Some(input),
        _ => None,
    };
    let term = match node {
        Node::Binary(Operator::Divide, x, y) => {
            let (number, x) = scaled(graph, graph[x]).unwrap_or((1.0, x));
            let change = match (input(x), input(y)) {
                (Some(Input::Part(now)), Some(Input::PartAtRest(rest))) if now == rest => {
                    Input::PartChange(now)
                }
                (Some(Input::Current(now)), Some(Input::Reference(rest))) if now == rest => {
                    Input::Change(now)
                }
                _ => return (factor, Term::Other(id)),
            };
            return (factor * number, Term::Grown(change));
        }
        Node::Unary(Function::Cos, x) => match input(x) {
            Some(Input::Part(Part::Angle(k))) => Term::Cosine(k),
            Some(Input::PartAtRest(Part::Angle(k))) => Term::CosineAtRest(k),
            _ => Term::Other(id),
        },
        _ => Term::Other(id),
    };
    (factor, term)
}

/// The sum by changes, if what does not change in it cancels.
fn of_changes(
    target: &mut Simplifier,
    mut sum: Vec<(f64, Term)>,
    place: &[NodeId],
) -> Result<Option<NodeId>, TooManyNodes> {
    let is_level = |(_, term): &&(f64, Term)| matches!(term, Term::One | Term::Grown(_));
    let level: f64 = sum.iter().filter(is_level).map(|(coefficient, _)| coefficient).sum();
    let grows = sum.iter().any(|(_, term)| matches!(term, Term::Grown(_))) && level == 0.0;
    let opposite = |(coefficient, term): &(f64, Term)| match term {
        Term::Cosine(k) => sum.contains(&(-coefficient, Term::CosineAtRest(*k))),
        _ => false,
    };
    let turned: Vec<(f64, Term)> = sum.iter().copied().filter(opposite).collect();
    if !grows && turned.is_empty() {
        return Ok(None);
    }
    let mut total = target.number(0.0)?;
    for (coefficient, term) in &turned {
        let Term::Cosine(k) = *term else { continue };
        sum.retain(|(_, term)| *term != Term::Cosine(k) && *term != Term::CosineAtRest(k));
        let own = turn(target, k)?;
        let factor = target.number(-2.0 * coefficient)?;
        let own = target.multiply(factor, own)?;
        total = target.add(total, own)?;
    }
    for (coefficient, term) in sum {
        let own = match term {
            Term::One if grows => continue,
            Term::One => target.number(1.0)?,
            Term::Grown(change) if grows => target.input(change)?,
            Term::Grown(change) => grown(target, change)?,
            Term::Cosine(k) => cosine(target, Input::Part(Part::Angle(k)))?,
            Term::CosineAtRest(k) => cosine(target, Input::PartAtRest(Part::Angle(k)))?,
            Term::Other(id) => place[id.0 as usize],
        };
        let factor = target.number(coefficient)?;
        let own = target.multiply(factor, own)?;
        total = target.add(total, own)?;
    }
    Ok(Some(total))
}

/// A measure over its value at rest.
fn grown(target: &mut Simplifier, change: Input) -> Result<NodeId, TooManyNodes> {
    let [now, rest] = match change {
        Input::PartChange(part) => [Input::Part(part), Input::PartAtRest(part)],
        Input::Change(measure) => [Input::Current(measure), Input::Reference(measure)],
        other => [other, other],
    };
    let (now, rest) = (target.input(now)?, target.input(rest)?);
    target.divide(now, rest)
}

fn cosine(target: &mut Simplifier, angle: Input) -> Result<NodeId, TooManyNodes> {
    let angle = target.input(angle)?;
    target.unary(Function::Cos, angle)
}

/// `sin((angle + Angle)/2) sin((angle - Angle)/2)`
fn turn(target: &mut Simplifier, k: u8) -> Result<NodeId, TooManyNodes> {
    let part = Part::Angle(k);
    let (now, rest) = (target.input(Input::Part(part))?, target.input(Input::PartAtRest(part))?);
    let change = target.input(Input::PartChange(part))?;
    let half = target.number(0.5)?;
    let (sum, difference) = (target.add(now, rest)?, target.multiply(rest, change)?);
    let sines = [sum, difference].map(|angle| {
        let angle = target.multiply(half, angle)?;
        target.unary(Function::Sin, angle)
    });
    let [sum, difference] = sines;
    target.multiply(sum?, difference?)
}
