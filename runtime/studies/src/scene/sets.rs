//! `[sets]`: named points, by a condition or as a file lists them.

use std::sync::Arc;

use piola_grammar::Span;
use piola_mechanics::body::Body;
use rayon::prelude::*;

use super::{Expression, Located};

/// One entry of `[sets]`: a named set of points.
#[derive(Clone, Debug, PartialEq)]
pub struct SetDefinition {
    /// Its name.
    pub name: Located<String>,
    /// Which points are in it.
    pub members: Members,
}

/// Which points are in a set.
#[derive(Clone, Debug, PartialEq)]
pub enum Members {
    /// Those where it holds.
    Where(Expression),
    /// Those that a file lists.
    Listed {
        /// How.
        by: Listing,
        /// One entry per point in the user's order; none before the points are there.
        inside: Arc<Vec<bool>>,
    },
}

/// How a file lists points.
#[derive(Clone, Debug, PartialEq)]
pub enum Listing {
    /// As a group of the mesh, by its name.
    Group(Located<String>),
    /// As numbers from 1 in a file of their own, by its path relative to the scene's folder.
    Numbers(Located<String>),
}

impl Members {
    pub(crate) fn listed(by: Listing) -> Members {
        Members::Listed { by, inside: Arc::default() }
    }

    /// Where the scene says which points they are.
    pub fn span(&self) -> Span {
        match self {
            Members::Where(condition) => condition.span,
            Members::Listed { by: Listing::Group(name) | Listing::Numbers(name), .. } => name.span,
        }
    }

    /// Which points of a body are in the set, in the body's order.
    pub fn of(&self, body: &Body) -> Vec<bool> {
        match self {
            Members::Where(condition) => holds(condition, body.positions(), body.dimension()),
            Members::Listed { inside, .. } => {
                let is_inside = |user: &u32| inside.get(*user as usize).copied().unwrap_or(false);
                body.places().iter().map(is_inside).collect()
            }
        }
    }

    /// Whether a point is.
    pub fn has(&self, body: &Body, point: usize) -> bool {
        match self {
            Members::Where(condition) => condition.holds(body.position(point)),
            Members::Listed { inside, .. } => {
                inside.get(body.places()[point] as usize).copied().unwrap_or(false)
            }
        }
    }
}

/// Where a condition holds, one entry per point of `positions`, `n x d`.
pub(super) fn holds(condition: &Expression, positions: &[f64], dimension: usize) -> Vec<bool> {
    // Collecting keeps the order, so the result does not depend on the threads.
    positions.par_chunks_exact(dimension).map(|position| condition.holds(position)).collect()
}
