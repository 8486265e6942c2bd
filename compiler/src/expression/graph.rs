//! Nodes of an expression, each stored once, operands before users.
//!
//! Equal nodes get equal ids (hash-consing), so common subexpressions are found by construction and
//! a comparison of expressions is a comparison of integers. Passes are loops over the arena.

use rustc_hash::FxHashMap;

use super::power::PowerPlan;
use super::{Comparison, Function, Operator};
use crate::clique::Part;
use crate::measure::Measure;

/// Most nodes a graph may hold.
pub const MAX_NODES: usize = 20_000;

/// The graph would need more than [`MAX_NODES`] nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the expression needs more than {MAX_NODES} operations in its graph")]
pub struct TooManyNodes;

/// Index of a node in its graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub u32);

/// A value that comes from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Input {
    /// Current measure: `l`, `a`, `v`.
    Current(Measure),
    /// Reference measure: `L`, `A`, `V`; finite and > 0.
    Reference(Measure),
    /// Relative change `(l - L)/L` of the measure, as the runtime computes it from displacements.
    Change(Measure),
    /// A measure of a part of a triangle or a tetrahedron: `l1`, `a1`, `angle`.
    Part(Part),
    /// The same at rest: `L1`, `A1`, `Angle`; finite and > 0.
    PartAtRest(Part),
    /// Its relative change, `(l1 - L1)/L1`, as the runtime computes it from displacements.
    PartChange(Part),
    /// `rate(l)`: how fast the length of a bond changes, in m/s.
    Rate,
    /// The horizon `delta`, finite and > 0.
    Horizon,
    /// A parameter of the potential, or a variable of a formula, by its number.
    Parameter(u16),
    /// One of several variables of an energy: the component of `F` with this [`component`] number.
    Variable(u8),
    /// Its change from rest, a component of `F - I`, as the runtime computes it from displacements.
    VariableChange(u8),
    /// The trace of a function of the right stretch tensor `U`, by its number.
    Trace(u8),
    /// A principal stretch, an eigenvalue of `U`; in a function of `U` number 0 is the variable.
    Stretch(u8),
    /// Its change from rest, a principal stretch less 1, as it follows from `F - I`.
    StretchChange(u8),
    /// A component of a principal axis after deformation, by the [`component`] of axis and place.
    LeftAxis(u8),
    /// The same before deformation: `F = sum_i stretch_i left_i right_i`.
    RightAxis(u8),
    /// What a point gathers, by its number: an integral over its family, or a function of such integrals.
    Integral(u8),
    /// The same of the other end of a bond.
    Neighbour(u8),
    /// What a gathered value, by its number, is multiplied by where all of them are added up: derivatives by it
    /// are the values, and it stands for the derivative of an energy by them.
    Multiplier(u8),
    /// What a variable changes by in the direction of a product with second derivatives.
    Direction(u8),
}

/// The number of a component of a tensor, the same in two dimensions and in three.
pub fn component(row: usize, column: usize) -> u8 {
    (3 * row + column) as u8
}

/// The numbers of the components of a d x d tensor, row by row.
pub fn components(d: usize) -> Vec<u8> {
    (0..d * d).map(|k| component(k / d, k % d)).collect()
}

/// In how many dimensions a tensor has so many components.
pub(crate) fn dimension(n_components: usize) -> usize {
    if n_components == 4 { 2 } else { 3 }
}

/// One operation. Numbers are stored by their bits so that nodes can be hashed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Node {
    /// A number.
    Number(u64),
    /// A truth value.
    Truth(bool),
    /// A value from outside.
    Input(Input),
    /// A function of one number.
    Unary(Function, NodeId),
    /// `x^c` with a constant exponent, given by its bits.
    PowerConstant(NodeId, u64),
    /// An operator with two numbers.
    Binary(Operator, NodeId, NodeId),
    /// A comparison; a truth value.
    Compare(Comparison, NodeId, NodeId),
    /// Both hold.
    And(NodeId, NodeId),
    /// At least one holds.
    Or(NodeId, NodeId),
    /// Does not hold.
    Not(NodeId),
    /// `if condition then x else y`; both are evaluated, one is taken.
    Select(NodeId, NodeId, NodeId),
    /// `(x^n - 1)/n`, and `ln(x)` for `n = 0`, of the stretch `x`, with `n` given by its bits. It stands
    /// only between rewriting and the end of differentiation; see [`mod@crate::rewrite`].
    Strain(NodeId, u64),
}

impl Node {
    /// A number's node.
    pub fn number(value: f64) -> Node {
        Node::Number(value.to_bits())
    }

    /// The nodes it reads.
    pub fn operands(self) -> impl Iterator<Item = NodeId> {
        let (x, y, z) = match self {
            Node::Number(_) | Node::Truth(_) | Node::Input(_) => (None, None, None),
            Node::Unary(_, x) | Node::PowerConstant(x, _) | Node::Strain(x, _) | Node::Not(x) => {
                (Some(x), None, None)
            }
            Node::Binary(_, x, y) | Node::Compare(_, x, y) | Node::And(x, y) | Node::Or(x, y) => {
                (Some(x), Some(y), None)
            }
            Node::Select(c, x, y) => (Some(c), Some(x), Some(y)),
        };
        [x, y, z].into_iter().flatten()
    }

    /// The same operation on other operands.
    pub fn map_operands(self, mut map: impl FnMut(NodeId) -> NodeId) -> Node {
        match self {
            Node::Number(_) | Node::Truth(_) | Node::Input(_) => self,
            Node::Unary(f, x) => Node::Unary(f, map(x)),
            Node::PowerConstant(x, c) => Node::PowerConstant(map(x), c),
            Node::Strain(x, n) => Node::Strain(map(x), n),
            Node::Binary(o, x, y) => Node::Binary(o, map(x), map(y)),
            Node::Compare(o, x, y) => Node::Compare(o, map(x), map(y)),
            Node::And(x, y) => Node::And(map(x), map(y)),
            Node::Or(x, y) => Node::Or(map(x), map(y)),
            Node::Not(x) => Node::Not(map(x)),
            Node::Select(c, x, y) => Node::Select(map(c), map(x), map(y)),
        }
    }
}

/// A graph of operations.
#[derive(Clone, Debug, Default)]
pub struct ExprGraph {
    nodes: Vec<Node>,
    ids: FxHashMap<Node, NodeId>,
}

impl ExprGraph {
    /// An empty graph.
    pub fn new() -> ExprGraph {
        ExprGraph::default()
    }

    /// The id of this node, which is stored if it is new. Operands must be here already.
    pub fn intern(&mut self, node: Node) -> Result<NodeId, TooManyNodes> {
        if let Some(&id) = self.ids.get(&node) {
            return Ok(id);
        }
        if self.nodes.len() >= MAX_NODES {
            return Err(TooManyNodes);
        }
        let id = NodeId(self.nodes.len() as u32);
        self.nodes.push(node);
        self.ids.insert(node, id);
        Ok(id)
    }

    /// How many nodes there are.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// All nodes, operands before users.
    pub fn nodes(&self) -> impl DoubleEndedIterator<Item = (NodeId, Node)> {
        self.nodes.iter().enumerate().map(|(i, &node)| (NodeId(i as u32), node))
    }

    /// The number a node is, if it is one.
    pub fn as_number(&self, id: NodeId) -> Option<f64> {
        match self[id] {
            Node::Number(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// How many nodes are operations: neither numbers nor inputs.
    pub fn operations(&self) -> usize {
        let given = |node: &Node| matches!(node, Node::Number(_) | Node::Truth(_) | Node::Input(_));
        self.nodes.iter().filter(|node| !given(node)).count()
    }

    /// How many elementary functions it calls.
    pub fn calls(&self) -> usize {
        let called = |node: Node| match node {
            Node::Unary(function, _) => function.libm().is_some(),
            Node::Binary(Operator::Power | Operator::Atan2, ..) => true,
            Node::PowerConstant(_, bits) => {
                matches!(PowerPlan::new(f64::from_bits(bits)), PowerPlan::General(_))
            }
            _ => false,
        };
        self.nodes.iter().filter(|node| called(**node)).count()
    }

    /// Which nodes the roots need, themselves included.
    pub fn reachable(&self, roots: &[NodeId]) -> Vec<bool> {
        let mut needed = vec![false; self.nodes.len()];
        for root in roots {
            needed[root.0 as usize] = true;
        }
        for (id, node) in self.nodes().rev() {
            if needed[id.0 as usize] {
                for operand in node.operands() {
                    needed[operand.0 as usize] = true;
                }
            }
        }
        needed
    }

    /// Whether the roots need this input.
    pub fn depends_on(&self, roots: &[NodeId], input: Input) -> bool {
        let needed = self.reachable(roots);
        self.ids.get(&Node::Input(input)).is_some_and(|id| needed[id.0 as usize])
    }

    /// A graph with only what the roots need, and the roots in it; the order is kept.
    pub fn extract(&self, roots: &[NodeId]) -> (ExprGraph, Vec<NodeId>) {
        let needed = self.reachable(roots);
        let mut graph = ExprGraph::new();
        let mut place = vec![NodeId(0); self.nodes.len()];
        for (id, node) in self.nodes() {
            if needed[id.0 as usize] {
                let moved = node.map_operands(|x| place[x.0 as usize]);
                place[id.0 as usize] = graph.intern(moved).expect("no larger than its source");
            }
        }
        (graph, roots.iter().map(|r| place[r.0 as usize]).collect())
    }
}

impl std::ops::Index<NodeId> for ExprGraph {
    type Output = Node;
    fn index(&self, id: NodeId) -> &Node {
        &self.nodes[id.0 as usize]
    }
}
