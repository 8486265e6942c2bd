//! What is left of a sum once parameters are numbers: its terms but those whose factor is exactly zero.

use crate::expression::interpret::Interpreter;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::model::Parameter;
use crate::simplify::Simplifier;

/// Which zeros dropped something, in words: `C2 = 0`.
pub(super) fn reasons(graph: &ExprGraph, parameters: &[Parameter], factors: &[NodeId]) -> String {
    let mut found: Vec<String> = Vec::new();
    for &factor in factors {
        let reason = match graph[factor] {
            Node::Input(Input::Parameter(i)) if let Some(own) = parameters.get(usize::from(i)) => {
                format!("{} = 0", own.name)
            }
            _ => "its coefficient is 0".to_string(),
        };
        if !found.contains(&reason) {
            found.push(reason);
        }
    }
    found.join(", ")
}

/// A graph on its way to a simplified one, with known inputs as numbers.
pub(super) struct Rebuild<'a, F> {
    source: &'a ExprGraph,
    fold: &'a F,
    pub(super) target: Simplifier,
    /// For each product the factor that parameters make exactly zero.
    zero: Vec<Option<NodeId>>,
    /// The simplified form of each node that is needed.
    place: Vec<Option<NodeId>>,
    /// The same for sums, without their zero terms; the inner `None` where nothing is left.
    modelled: Vec<Option<Option<NodeId>>>,
    /// The factors that dropped a term.
    pub(super) dropped: Vec<NodeId>,
}

impl<'a, F: Fn(Input) -> Option<f64>> Rebuild<'a, F> {
    pub(super) fn new(source: &'a ExprGraph, fold: &'a F, target: Simplifier) -> Self {
        Rebuild {
            source,
            fold,
            target,
            zero: KnownValues::new(source, fold).zero_factors(source),
            place: vec![None; source.len()],
            modelled: vec![None; source.len()],
            dropped: Vec::new(),
        }
    }

    /// Makes the simplified form of everything the roots need.
    pub(super) fn nodes(&mut self, roots: &[NodeId]) -> Result<(), TooManyNodes> {
        let needed = self.source.reachable(roots);
        for (id, node) in self.source.nodes() {
            if !needed[id.0 as usize] {
                continue;
            }
            let made = match node {
                Node::Input(input) => match (self.fold)(input) {
                    Some(value) => self.target.number(value)?,
                    None => self.target.input(input)?,
                },
                _ => self.target.make(node.map_operands(|x| self.at(x)))?,
            };
            self.place[id.0 as usize] = Some(made);
        }
        Ok(())
    }

    fn at(&self, id: NodeId) -> NodeId {
        self.place[id.0 as usize].expect("operands are made before their users")
    }

    /// What is modelled of a sum: its terms but those with a zero factor, in the order written.
    pub(super) fn modelled(&mut self, root: NodeId) -> Result<Option<NodeId>, TooManyNodes> {
        let mut stack = vec![root];
        while let Some(&id) = stack.last() {
            if self.modelled[id.0 as usize].is_some() {
                stack.pop();
                continue;
            }
            let parts: Vec<NodeId> = match self.source[id] {
                _ if self.zero[id.0 as usize].is_some() => Vec::new(),
                node if is_sum(node) => node.operands().collect(),
                _ => Vec::new(),
            };
            let missing = parts.iter().filter(|part| self.modelled[part.0 as usize].is_none());
            let missing: Vec<NodeId> = missing.copied().collect();
            if missing.is_empty() {
                self.modelled[id.0 as usize] = Some(self.sum_of_modelled(id)?);
                stack.pop();
            } else {
                stack.extend(missing);
            }
        }
        Ok(self.modelled[root.0 as usize].flatten())
    }

    /// A sum whose terms are known.
    fn sum_of_modelled(&mut self, id: NodeId) -> Result<Option<NodeId>, TooManyNodes> {
        if let Some(factor) = self.zero[id.0 as usize] {
            self.dropped.push(factor);
            return Ok(None);
        }
        let of = |x: NodeId| self.modelled[x.0 as usize].flatten();
        match self.source[id] {
            Node::Binary(Operator::Add, x, y) => match (of(x), of(y)) {
                (Some(x), Some(y)) => self.target.add(x, y).map(Some),
                (only, None) | (None, only) => Ok(only),
            },
            Node::Binary(Operator::Subtract, x, y) => match (of(x), of(y)) {
                (Some(x), Some(y)) => self.target.subtract(x, y).map(Some),
                (x, None) => Ok(x),
                (None, Some(y)) => self.target.negate(y).map(Some),
            },
            Node::Unary(Function::Negate, x) => match of(x) {
                Some(x) => self.target.negate(x).map(Some),
                None => Ok(None),
            },
            _ => Ok(Some(self.at(id))),
        }
    }
}

/// Whether a node adds up terms.
fn is_sum(node: Node) -> bool {
    matches!(
        node,
        Node::Binary(Operator::Add | Operator::Subtract, ..) | Node::Unary(Function::Negate, _)
    )
}

/// Values of the nodes that are known once the parameters are.
struct KnownValues {
    values: Vec<Option<f64>>,
    /// Whether a parameter has a part in the value: a zero that was written as such is no choice of
    /// what to model.
    chosen: Vec<bool>,
}

impl KnownValues {
    fn new(graph: &ExprGraph, fold: &impl Fn(Input) -> Option<f64>) -> KnownValues {
        let mut known = vec![false; graph.len()];
        let mut chosen = vec![false; graph.len()];
        for (id, node) in graph.nodes() {
            let i = id.0 as usize;
            (known[i], chosen[i]) = match node {
                Node::Input(input) => (fold(input).is_some(), fold(input).is_some()),
                _ => (
                    node.operands().all(|x| known[x.0 as usize]),
                    node.operands().any(|x| chosen[x.0 as usize]),
                ),
            };
        }
        let mut interpreter = Interpreter::<f64>::new();
        interpreter.run(graph, |input| fold(input).unwrap_or(f64::NAN));
        let value = |(id, _): (NodeId, Node)| known[id.0 as usize].then(|| interpreter.number(id));
        KnownValues { values: graph.nodes().map(value).collect(), chosen }
    }

    /// For products and quotients the innermost factor that parameters make exactly zero.
    fn zero_factors(&self, graph: &ExprGraph) -> Vec<Option<NodeId>> {
        let mut zero: Vec<Option<NodeId>> = Vec::with_capacity(graph.len());
        for (id, node) in graph.nodes() {
            let i = id.0 as usize;
            let of = |x: NodeId| zero[x.0 as usize];
            let factor = match node {
                Node::Binary(Operator::Multiply, x, y) => of(x).or(of(y)),
                Node::Unary(Function::Negate, x) => of(x),
                // 0/0 is no zero.
                Node::Binary(Operator::Divide, x, y) => {
                    let divisor = self.values[y.0 as usize];
                    of(x).filter(|_| divisor.is_none_or(|y| y != 0.0 && !y.is_nan()))
                }
                _ => None,
            };
            let itself = self.chosen[i] && self.values[i] == Some(0.0);
            zero.push(factor.or(itself.then_some(id)));
        }
        zero
    }
}
