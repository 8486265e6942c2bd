//! Parameter values folded in: what is known becomes a number, what is zero disappears.
//!
//! Before: a model. After: one simplified energy per measure, with psi' and psi'' beside it, whose
//! only inputs are the measure, its reference and their relative change.

use piola_grammar::Span;

use crate::differentiate::differentiate;
use crate::expression::graph::MAX_NODES;
use crate::expression::interpret::Interpreter;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;
use crate::model::{Model, Variant};
use crate::simplify::Simplifier;
use crate::values::Values;

/// Most operations of a kernel: compile time grows faster than linearly beyond.
pub const MAX_OPERATIONS: usize = 4096;

/// psi, psi' and psi'' of one measure as one graph.
#[derive(Clone, Debug)]
pub struct ScalarEnergy {
    /// What it is a function of.
    pub measure: Measure,
    /// Only what the three roots need.
    pub graph: ExprGraph,
    /// psi, psi', psi''.
    pub roots: [NodeId; 3],
}

/// A term of an energy that is left out because its coefficient is exactly zero.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dropped {
    /// The measure it is a function of.
    pub measure: Measure,
    /// Why it is left out, in a sentence.
    pub reason: String,
}

/// An energy that cannot be compiled.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CompileError {
    /// The graph or the kernel would be too large.
    #[error("psi({}) needs more than {limit} operations", measure.symbol())]
    TooLarge {
        /// Which energy.
        measure: Measure,
        /// Where it stands.
        span: Span,
        /// The limit that is passed.
        limit: usize,
    },
    /// The potential is not defined in this many dimensions.
    #[error("the potential is not defined in {0} dimensions")]
    WrongDimension(usize),
    /// The energy depends on the horizon, and none is given.
    #[error("psi({}) depends on the horizon `delta`, which has no value", measure.symbol())]
    NoHorizon {
        /// Which energy.
        measure: Measure,
        /// Where it stands.
        span: Span,
    },
    /// Machine code could not be made.
    #[error("the code generator failed: {0}")]
    Backend(String),
}

/// Energies with values folded in, and what was left out.
#[derive(Clone, Debug, Default)]
pub struct Specialised {
    /// At most one per measure, ascending.
    pub energies: Vec<ScalarEnergy>,
    /// What is not modelled, and why.
    pub dropped: Vec<Dropped>,
}

impl Model {
    /// The energies for these values.
    ///
    /// # Errors
    /// An energy that needs too many operations, or the horizon where none is given.
    pub fn specialise(&self, values: &Values) -> Result<Specialised, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let fold = |input| match input {
            Input::Parameter(i) => Some(values.parameters[usize::from(i)]),
            Input::Horizon => Some(values.horizon),
            _ => None,
        };
        let mut result = Specialised::default();
        for measure in self.measures() {
            if measure == Measure::Volume && values.dimension == 2 {
                result.dropped.push(Dropped {
                    measure,
                    reason: "psi(v) is dropped: there are no tetrahedra in two dimensions".into(),
                });
                continue;
            }
            let span = span_of(variant, measure);
            if values.horizon.is_nan() && needs_horizon(variant, measure) {
                return Err(CompileError::NoHorizon { measure, span });
            }
            let too_large = |limit| CompileError::TooLarge { measure, span, limit };
            let mut dropped = Vec::new();
            let energy = scalar_energy(variant, measure, &fold, &mut dropped)
                .map_err(|TooManyNodes| too_large(MAX_NODES))?;
            if energy.as_ref().is_some_and(|e| e.graph.len() > MAX_OPERATIONS) {
                return Err(too_large(MAX_OPERATIONS));
            }
            result.dropped.extend(dropped);
            result.energies.extend(energy);
        }
        Ok(result)
    }

    /// The energies with parameters left as symbols, as `derive` prints them.
    ///
    /// # Errors
    /// An energy that needs too many operations.
    pub fn symbolic(&self, dimension: usize) -> Result<Specialised, CompileError> {
        let variant = self.variant(dimension).ok_or(CompileError::WrongDimension(dimension))?;
        let mut result = Specialised::default();
        for measure in self.measures() {
            let span = span_of(variant, measure);
            let energy = scalar_energy(variant, measure, &|_| None, &mut result.dropped).map_err(
                |TooManyNodes| CompileError::TooLarge { measure, span, limit: MAX_NODES },
            )?;
            result.energies.extend(energy);
        }
        Ok(result)
    }
}

fn span_of(variant: &Variant, measure: Measure) -> Span {
    let energy = variant.energies.iter().find(|e| e.measure == measure);
    energy.map_or(Span::default(), |e| e.span)
}

fn needs_horizon(variant: &Variant, measure: Measure) -> bool {
    let energies = variant.energies.iter().filter(|e| e.measure == measure);
    let roots: Vec<NodeId> = energies.map(|e| e.root).collect();
    let needed = variant.graph.reachable(&roots);
    let mut nodes = variant.graph.nodes();
    nodes.any(|(id, node)| needed[id.0 as usize] && node == Node::Input(Input::Horizon))
}

/// The sum of a measure's energies with psi' and psi''; `None` if nothing is left of it.
fn scalar_energy(
    variant: &Variant,
    measure: Measure,
    fold: &impl Fn(Input) -> Option<f64>,
    dropped: &mut Vec<Dropped>,
) -> Result<Option<ScalarEnergy>, TooManyNodes> {
    let known = KnownValues::new(&variant.graph, fold);
    let mut graph = Simplifier::new();
    let mut total: Option<NodeId> = None;
    for energy in variant.energies.iter().filter(|e| e.measure == measure) {
        let mut terms = terms(&variant.graph, energy.root);
        if !terms.iter().any(|(term, _)| known.has_zero_factor(&variant.graph, *term)) {
            // Nothing to drop: keep the order of summation that was written.
            terms = vec![(energy.root, false)];
        }
        for (term, negative) in terms {
            if known.has_zero_factor(&variant.graph, term) {
                dropped.push(Dropped {
                    measure,
                    reason: format!(
                        "a term of psi({}) is dropped: its coefficient is 0",
                        measure.symbol()
                    ),
                });
                continue;
            }
            let node = rebuild(&mut graph, &variant.graph, term, fold)?;
            total = Some(match (total, negative) {
                (None, false) => node,
                (None, true) => graph.negate(node)?,
                (Some(sum), false) => graph.add(sum, node)?,
                (Some(sum), true) => graph.subtract(sum, node)?,
            });
        }
    }
    let Some(psi) = total else { return Ok(None) };
    let dpsi = differentiate(&mut graph, psi, measure)?;
    let d2psi = differentiate(&mut graph, dpsi, measure)?;
    let (graph, roots) = graph.graph().extract(&[psi, dpsi, d2psi]);
    let roots = [roots[0], roots[1], roots[2]];
    Ok(Some(ScalarEnergy { measure, graph, roots }))
}

/// Top-level terms of a sum, each with whether it is subtracted.
fn terms(graph: &ExprGraph, root: NodeId) -> Vec<(NodeId, bool)> {
    let mut result = Vec::new();
    let mut stack = vec![(root, false)];
    while let Some((id, negative)) = stack.pop() {
        match graph[id] {
            // A term shared many times would be split exponentially often: stop at a sane number.
            _ if result.len() + stack.len() >= MAX_OPERATIONS => result.push((id, negative)),
            Node::Binary(Operator::Add, x, y) => stack.extend([(y, negative), (x, negative)]),
            Node::Binary(Operator::Subtract, x, y) => {
                stack.extend([(y, !negative), (x, negative)]);
            }
            Node::Unary(Function::Negate, x) => stack.push((x, !negative)),
            _ => result.push((id, negative)),
        }
    }
    result
}

/// The part of a graph, simplified, with known inputs as numbers.
fn rebuild(
    target: &mut Simplifier,
    source: &ExprGraph,
    root: NodeId,
    fold: &impl Fn(Input) -> Option<f64>,
) -> Result<NodeId, TooManyNodes> {
    let needed = source.reachable(&[root]);
    let mut place = vec![NodeId(0); source.len()];
    for (id, node) in source.nodes().take(root.0 as usize + 1) {
        if !needed[id.0 as usize] {
            continue;
        }
        place[id.0 as usize] = match node {
            Node::Input(input) => match fold(input) {
                Some(value) => target.number(value)?,
                None => target.input(input)?,
            },
            _ => target.make(node.map_operands(|x| place[x.0 as usize]))?,
        };
    }
    Ok(place[root.0 as usize])
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

    /// Whether a product or quotient has a factor that parameters make exactly zero.
    fn has_zero_factor(&self, graph: &ExprGraph, term: NodeId) -> bool {
        let mut stack = vec![term];
        let mut seen = vec![false; graph.len()];
        while let Some(id) = stack.pop() {
            if std::mem::replace(&mut seen[id.0 as usize], true) {
                continue;
            }
            if self.values[id.0 as usize] == Some(0.0) && self.chosen[id.0 as usize] {
                return true;
            }
            match graph[id] {
                Node::Binary(Operator::Multiply, x, y) => stack.extend([x, y]),
                Node::Unary(Function::Negate, x) => stack.push(x),
                // 0/0 is no zero.
                Node::Binary(Operator::Divide, x, y) => {
                    let divisor = self.values[y.0 as usize];
                    if divisor.is_none_or(|y| y != 0.0 && !y.is_nan()) {
                        stack.push(x);
                    }
                }
                _ => {}
            }
        }
        false
    }
}
