//! What machine code is made of: arrays in, arrays out, entry by entry.

use std::ops::Range;

use crate::expression::{ExprGraph, Input, NodeId};

/// Some roots of a graph as functions of some inputs. Inputs that are not named are not numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Program<'a> {
    pub(crate) graph: &'a ExprGraph,
    /// What the arrays that come in hold.
    pub(crate) inputs: &'a [Input],
    /// What the arrays that go out hold.
    pub(crate) roots: &'a [NodeId],
}

impl<'a> Program<'a> {
    /// The same for some of the roots.
    pub(crate) fn part(self, roots: Range<usize>) -> Program<'a> {
        Program { roots: &self.roots[roots], ..self }
    }
}
