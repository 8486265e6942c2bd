//! Near rest: any energy of a measure, and its derivatives, with their digits.
//!
//! Digits are lost near rest in one way: numbers that cancel are rounded before they cancel. So numbers
//! are worked out here, in 256 bits, and cancel here: every node has Taylor coefficients in the relative
//! change `e`, and code is made only for what is left of it beyond those of them that are taken off. A
//! root that begins with `c_m e^m` is its remainder of order `m`, whose parts demand remainders of their
//! own, down to those of the elementary functions, which are known without cancellation.
//!
//! Before: a simplified graph in which numbers stand as they were written. After: the same functions,
//! right near rest, with the conditions under which they are the same.

pub(crate) mod beyond;
mod choice;
mod coefficient;
mod exact;
mod lower;
mod polynomials;
mod rest;
mod series;
mod side;
mod sign;
mod taylor;

pub(crate) use choice::{Energy, kept};
pub(crate) use exact::{Exact, Number};

use crate::expression::{ExprGraph, Input, Node, NodeId, TooManyNodes};
use crate::measure::Measure;
use crate::simplify::Simplifier;
use side::{Made, Side, Stop, varying};

/// How many coefficients are tried, one after the other.
const COEFFICIENTS: [usize; 3] = [6, 14, MOST_COEFFICIENTS];
const MOST_COEFFICIENTS: usize = 28;

/// A root near rest on one side of it.
#[derive(Clone, Debug)]
pub(crate) struct OneSide {
    /// The root.
    pub(crate) root: NodeId,
    /// What must hold for it.
    pub(crate) guards: Vec<NodeId>,
}

/// A root near rest: for `e > 0` and for `e < 0`; nothing where it has no such form.
#[derive(Clone, Debug, Default)]
pub(crate) struct NearRest {
    pub(crate) sides: [Option<OneSide>; 2],
}

fn is_measure(node: Node, measure: Measure) -> bool {
    matches!(node, Node::Input(Input::Current(m) | Input::Change(m)) if m == measure)
}

/// The forms of some roots near rest, in the target.
pub(crate) fn near_rest(
    source: &ExprGraph,
    roots: &[NodeId],
    measure: Measure,
    target: &mut Simplifier,
) -> Result<Vec<NearRest>, TooManyNodes> {
    let varies = varying(source, |node| is_measure(node, measure));
    let mut forms = vec![NearRest::default(); roots.len()];
    for (i, &root) in roots.iter().enumerate() {
        let right = one_side(source, root, (measure, 1), &varies, target)?;
        let is_sided = right.as_ref().is_none_or(|(_, is_sided)| *is_sided);
        let left = if is_sided {
            one_side(source, root, (measure, -1), &varies, target)?
        } else {
            right.clone()
        };
        forms[i].sides = [right, left].map(|side| side.map(|(side, _)| side));
    }
    Ok(forms)
}

/// Whether a function of one measure is 0 at rest, whatever its reference is.
pub(crate) fn vanishes_at_rest(
    source: &ExprGraph,
    root: NodeId,
    measure: Measure,
) -> Result<bool, TooManyNodes> {
    let mut target = Simplifier::new();
    let varies = varying(source, |node| is_measure(node, measure));
    let needed = source.reachable(&[root]);
    let mut side = Side::new(source, &mut target, (measure, 1), &varies, COEFFICIENTS[0]);
    let lowered = side.lower(&needed[..=root.0 as usize]).and_then(|()| side.sum_of(root));
    let at_rest = lowered.and_then(|sum| {
        let id = side.id_of(&sum)?;
        Ok(side.nodes[id].series[0].is_empty())
    });
    match at_rest {
        Err(Stop::Full) => Err(TooManyNodes),
        known => Ok(known == Ok(true)),
    }
}

/// A root on one side, and whether the side has a part in it.
fn one_side(
    source: &ExprGraph,
    root: NodeId,
    (measure, sign): (Measure, i32),
    varies: &[bool],
    target: &mut Simplifier,
) -> Result<Option<(OneSide, bool)>, TooManyNodes> {
    let needed = source.reachable(&[root]);
    for n in COEFFICIENTS {
        let mut side = Side::new(source, target, (measure, sign), varies, n);
        match side.root(root, &needed[..=root.0 as usize]) {
            Ok(made) => {
                let made = OneSide { root: made, guards: std::mem::take(&mut side.guards) };
                return Ok(Some((made, side.is_sided)));
            }
            Err(Stop::More) => {}
            Err(Stop::Lost) => return Ok(None),
            Err(Stop::Full) => return Err(TooManyNodes),
        }
    }
    Ok(None)
}

impl Side<'_> {
    fn root(&mut self, root: NodeId, needed: &[bool]) -> Made<NodeId> {
        self.lower(needed)?;
        let sum = self.sum_of(root)?;
        if sum.is_empty() {
            return Ok(self.target.number(0.0)?);
        }
        let id = self.id_of(&sum)?;
        self.whole(id)
    }
}

#[cfg(test)]
mod tests;
