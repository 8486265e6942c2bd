//! Where branches meet: energy and force without jumps.
//!
//! Every node that chooses (`if`, `min`, `max`, `abs`, `sign`, `atan2` where it is +-pi) is followed through the domain. Where
//! its choice changes between two points, bisection finds the place, and psi and psi' just before it
//! are compared with those just behind it.

use rustc_hash::FxHashSet;

use super::Finding;
use super::subject::{Subject, bisect, short};
use crate::expression::interpret::Interpreter;
use crate::expression::{ExprGraph, Function, Node, NodeId, Operator};

/// How many changes of choice are looked at; more make an energy of a saw.
const MAX_SWITCHES: usize = 100;

/// A jump is larger than this part of the values around it.
const SMALLEST_JUMP: f64 = 1e-6;

/// How far around a place values are looked at, relative to rest.
const AROUND: f64 = 0.01;

pub(super) fn in_energy(subject: &Subject<'_>) -> Option<Finding> {
    let (place, jump) = jumps(subject, 0).into_iter().next()?;
    Some(Finding {
        message: format!(
            "psi({}) jumps by {} at {}",
            subject.symbol(),
            short(jump),
            subject.place(place)
        ),
        help: "no force does the work of a jump: let the branches have one value where they meet"
            .into(),
    })
}

pub(super) fn in_force(subject: &Subject<'_>) -> Option<Finding> {
    let energies = jumps(subject, 0);
    // Where the energy jumps, the force is the smaller trouble.
    let only = |place: f64| !energies.iter().any(|(other, _)| (other - place).abs() < 1e-12);
    let mut forces = jumps(subject, 1).into_iter().filter(|(place, _)| only(*place));
    let (place, jump) = forces.next()?;
    let symbol = subject.symbol();
    Some(Finding {
        message: format!("psi'({symbol}) jumps by {} at {}", short(jump), subject.place(place)),
        help: "Newton's method may not pass a kink: let the branches have one slope where they \
               meet, as those of `max(0, x)^2`"
            .into(),
    })
}

pub(super) fn in_stiffness(subject: &Subject<'_>) -> Option<Finding> {
    let before = [jumps(subject, 0), jumps(subject, 1)].concat();
    let only = |place: f64| !before.iter().any(|(other, _)| (other - place).abs() < 1e-12);
    let found: Vec<_> = jumps(subject, 2).into_iter().filter(|(at, _)| only(*at)).collect();
    let (place, jump) = *found.first()?;
    let others = match found.len() - 1 {
        0 => String::new(),
        n => format!(", and at {n} more"),
    };
    let (symbol, place) = (subject.symbol(), subject.place(place));
    Some(Finding {
        message: format!("psi''({symbol}) jumps by {} at {place}{others}", short(jump)),
        help: "Newton's method converges more slowly across it; it is usual where branches meet \
               and at the points of a table"
            .into(),
    })
}

/// Stretches at which psi or psi' or psi'' jumps, the nearest to rest first, and by how much.
fn jumps(subject: &Subject<'_>, order: usize) -> Vec<(f64, f64)> {
    let mut found = Vec::new();
    for (before, behind) in switches(subject) {
        let step = 4.0 * f64::EPSILON;
        let sides = [before - step, behind + step].map(|s| subject.at_stretch(s)[order]);
        let around = [before - AROUND, behind + AROUND].map(|s| subject.at_stretch(s)[order]);
        let sizes = sides.into_iter().chain(around).map(f64::abs).filter(|x| x.is_finite());
        let jump = sides[1] - sides[0];
        if jump.is_finite() && jump.abs() > SMALLEST_JUMP * sizes.fold(0.0, f64::max) {
            found.push((behind, jump));
        }
    }
    found.sort_by(|x, y| (x.0 - 1.0).abs().total_cmp(&(y.0 - 1.0).abs()));
    found
}

/// Pairs of stretches between which some node changes its choice.
fn switches(subject: &Subject<'_>) -> Vec<(f64, f64)> {
    let graph = &subject.energy.graph;
    let needed = graph.reachable(&subject.energy.roots[..1]);
    let choosers = graph.nodes().filter(|(id, node)| needed[id.0 as usize] && chooses(*node));
    // Choices by one condition change at one place.
    let mut conditions = FxHashSet::default();
    let choosers = choosers.filter(|(_, node)| match node {
        Node::Select(condition, ..) => conditions.insert(*condition),
        _ => true,
    });
    let choosers: Vec<NodeId> = choosers.map(|(id, _)| id).collect();
    if choosers.is_empty() {
        return Vec::new();
    }
    let at = |stretch: f64| subject.evaluate(stretch * subject.reference);
    let mut found = Vec::new();
    let mut last: Option<(f64, Interpreter<f64>)> = None;
    for &stretch in &subject.stretches {
        let here = at(stretch);
        if let Some((previous, before)) = &last {
            for &id in &choosers {
                let was = choice(graph, before, id);
                if was != choice(graph, &here, id) && found.len() < MAX_SWITCHES {
                    let same = |s| choice(graph, &at(s), id) == was;
                    found.push(bisect((*previous, stretch), same));
                }
            }
        }
        last = Some((stretch, here));
    }
    found
}

fn chooses(node: Node) -> bool {
    matches!(
        node,
        Node::Select(..)
            | Node::Binary(Operator::Min | Operator::Max | Operator::Atan2, ..)
            | Node::Unary(Function::Abs | Function::Sign, _)
    )
}

/// Which way a node has chosen.
fn choice(graph: &ExprGraph, values: &Interpreter<f64>, id: NodeId) -> bool {
    match graph[id] {
        Node::Select(condition, ..) => values.truth(condition),
        // From -pi to pi behind the origin.
        Node::Binary(Operator::Atan2, x, y) => values.number(x) < 0.0 && values.number(y) < 0.0,
        Node::Binary(_, x, y) => values.number(x) < values.number(y),
        Node::Unary(_, x) => values.number(x) > 0.0,
        _ => false,
    }
}
