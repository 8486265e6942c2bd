//! Where the numbers of a graph stand in the text, so that what is wrong with one of them can be said
//! in the user's words.

use rustc_hash::FxHashSet;

use piola_grammar::Span;

use super::elaborate::Elaborator;
use super::value::{GRADIENT, INTEGRAL, Kind, Value};
use crate::expression::{Node, NodeId};
use crate::verify::{Part, Stated};

/// Numbers that depend on the deformation, each with the first expression that is it.
#[derive(Default)]
pub(super) struct Texts {
    pub(super) all: Vec<(NodeId, Stated)>,
    known: FxHashSet<NodeId>,
}

impl Elaborator<'_> {
    /// Takes note of what an expression became.
    pub(super) fn state(&mut self, value: Value, span: Span) {
        if value.uses & (GRADIENT | INTEGRAL) == 0 {
            return;
        }
        match value.kind {
            Kind::Number(_) => self.state_node(value.node, Stated { span, part: Part::Whole }),
            Kind::Tensor(id, _) => {
                for k in 0..self.tensors[id.0 as usize].len() {
                    if let Some(node) = self.tensors[id.0 as usize][k] {
                        self.state_node(node, Stated { span, part: Part::Component });
                    }
                }
            }
            Kind::Truth | Kind::OfStretch(_) => {}
        }
    }

    fn state_node(&mut self, node: NodeId, stated: Stated) {
        let has_text = !matches!(self.graph[node], Node::Input(_) | Node::Number(_));
        if has_text && self.stated.known.insert(node) {
            self.stated.all.push((node, stated));
        }
    }
}
