//! Energies with functions of the right stretch tensor `U`.
//!
//! With `F = sum_i s_i n_i N_i` (principal stretches, principal axes after and before deformation),
//! the trace of a function is `sum_i f(s_i)` and its derivative by `F` is `sum_i f'(s_i) n_i N_i`. What
//! that changes by follows from the change `D = n dF N` of the gradient seen in the principal axes:
//! `f''(s_i) D_ii` along them, and across them the symmetric part of `D` times the divided difference
//! `f'[s_i, s_j]`, the skew one times `(f'(s_i) + f'(s_j))/(s_i + s_j)` (Ogden 1984, Non-linear Elastic
//! Deformations, sec. 6.1). Divided differences are derived like derivatives, rule by rule, so equal
//! stretches are no special case.
//!
//! | module | what |
//! |---|---|
//! | `divided` | divided differences of expressions |
//! | `axes` | principal stretches and axes of a deformation gradient |
//! | `witness` | the trace over other number types, as independent of this as can be |

pub(crate) mod axes;
mod divided;
pub(super) mod witness;

use super::adjoint::{self, TRACES, Varied};
use super::near::{FunctionAtRest, Source, function_at_rest};
use crate::expression::graph;
use crate::expression::{ExprGraph, Input, Node, NodeId, TooManyNodes};
use crate::simplify::Simplifier;
use crate::specialise::folded;

/// A function of a principal stretch, `Stretch(0)`, with what its trace needs.
pub(super) struct StretchFunction {
    graph: Simplifier,
    /// The function and its first two derivatives.
    derivatives: [NodeId; 3],
    /// What it is at rest; none where it has no value there.
    pub(super) at_rest: Option<FunctionAtRest>,
    /// `f(1 + e) - f(1) - f'(1)*(e + e^2/2)` in `StretchChange(0)`, and its derivative.
    beyond: [NodeId; 2],
}

impl StretchFunction {
    /// The function `written` of `Stretch(0)`, in a graph with all digits of its numbers.
    pub(super) fn new(exact: &Simplifier, written: NodeId) -> Result<Self, TooManyNodes> {
        let (mut graph, place) = folded(exact.graph(), &[written])?;
        let root = place[written.0 as usize];
        let source = Source { graph: exact.graph(), place: &place };
        let by_stretch = |graph: &mut Simplifier, root: NodeId| {
            Ok(adjoint::gradient(graph, root, Varied::Stretch)?[0])
        };
        let first = by_stretch(&mut graph, root)?;
        let second = by_stretch(&mut graph, first)?;
        let at_rest = function_at_rest(&mut graph, source, written)?;
        let beyond = match &at_rest {
            Some(known) => {
                let rest = match known.rest {
                    Some(rest) => rest,
                    None => graph.number(0.0)?,
                };
                let change = graph.input(Input::StretchChange(0))?;
                let square = graph.multiply(change, change)?;
                let half = graph.number(0.5 * known.slope())?;
                let quadratic = graph.multiply(half, square)?;
                let beyond = graph.subtract(rest, quadratic)?;
                [beyond, by_stretch(&mut graph, beyond)?]
            }
            None => [root; 2],
        };
        Ok(StretchFunction { graph, derivatives: [root, first, second], at_rest, beyond })
    }
}

/// What an energy with open traces comes to, and its derivatives by components and traces.
pub(super) struct Open {
    pub(super) psi: NodeId,
    pub(super) first: Vec<NodeId>,
    pub(super) second: Vec<NodeId>,
}

/// An energy and its derivatives by components alone: traces as sums over principal stretches, in
/// `StretchChange` where it is the form near rest. Roots are psi, P and dP.
pub(super) fn closed(
    source: &ExprGraph,
    open: &Open,
    functions: &[StretchFunction],
    (dimension, near): (usize, bool),
) -> Result<(Simplifier, Vec<NodeId>), TooManyNodes> {
    let mut builder = Builder { graph: Simplifier::new(), functions, dimension, near };
    let slopes = builder.slopes()?;
    let seen = builder.seen_in_axes()?;
    let (sums, changes) = builder.traces(&slopes, &seen)?;
    let replaced = |_: &mut Simplifier, input| {
        Ok(match input {
            Input::Trace(k) => sums.get(usize::from(k)).copied(),
            Input::Direction(k) if k >= TRACES => changes.get(usize::from(k - TRACES)).copied(),
            _ => None,
        })
    };
    let mut roots = vec![open.psi];
    roots.extend(open.first.iter().chain(&open.second));
    let roots = copied(&mut builder.graph, source, &roots, &replaced)?;
    let n = dimension * dimension;
    let (first, second) = roots[1..].split_at(open.first.len());
    let weights = Weights { by_trace: &first[n..], change: &second[n..] };
    let stress = builder.stress(&first[..n], &weights, &slopes)?;
    let product = builder.product(&second[..n], &weights, &slopes, &seen)?;
    let roots = roots[..1].iter().copied().chain(stress).chain(product).collect();
    Ok((builder.graph, roots))
}

/// Copies what some roots need into another graph, with other nodes in the place of inputs.
pub(super) fn copied(
    target: &mut Simplifier,
    source: &ExprGraph,
    roots: &[NodeId],
    replaced: &impl Fn(&mut Simplifier, Input) -> Result<Option<NodeId>, TooManyNodes>,
) -> Result<Vec<NodeId>, TooManyNodes> {
    let needed = source.reachable(roots);
    let mut place = vec![NodeId(0); source.len()];
    for (id, node) in source.nodes().filter(|(id, _)| needed[id.0 as usize]) {
        place[id.0 as usize] = match node {
            Node::Input(input) => match replaced(target, input)? {
                Some(node) => node,
                None => target.input(input)?,
            },
            _ => target.make(node.map_operands(|x| place[x.0 as usize]))?,
        };
    }
    Ok(roots.iter().map(|root| place[root.0 as usize]).collect())
}

/// What an energy changes by with each of its traces, and what that changes by.
struct Weights<'a> {
    by_trace: &'a [NodeId],
    change: &'a [NodeId],
}

struct Builder<'a> {
    graph: Simplifier,
    functions: &'a [StretchFunction],
    dimension: usize,
    near: bool,
}

type Sum = Option<NodeId>;

impl Builder<'_> {
    /// A root of a function at a principal stretch.
    fn at(&mut self, k: usize, root: NodeId, i: usize) -> Result<NodeId, TooManyNodes> {
        let functions = self.functions;
        let source = functions[k].graph.graph();
        let stretch = self.stretch(i)?;
        let replaced = |graph: &mut Simplifier, input| match input {
            Input::Stretch(_) => Ok(Some(stretch)),
            Input::StretchChange(_) => graph.input(Input::StretchChange(i as u8)).map(Some),
            _ => Ok(None),
        };
        Ok(copied(&mut self.graph, source, &[root], &replaced)?[0])
    }

    fn stretch(&mut self, i: usize) -> Result<NodeId, TooManyNodes> {
        if !self.near {
            return self.graph.input(Input::Stretch(i as u8));
        }
        let one = self.graph.number(1.0)?;
        let change = self.graph.input(Input::StretchChange(i as u8))?;
        self.graph.add(one, change)
    }

    /// `f_k` and `f_k'`, or what of them is beyond rest.
    fn value_and_slope(&self, k: usize) -> [NodeId; 2] {
        let function = &self.functions[k];
        let [value, slope, _] = function.derivatives;
        if self.near { function.beyond } else { [value, slope] }
    }

    /// What the second derivatives near rest are counted from.
    fn slope_at_rest(&self, k: usize) -> f64 {
        let known = self.functions[k].at_rest.as_ref().filter(|_| self.near);
        known.map_or(0.0, |known| known.slope())
    }

    /// `f_k'(s_i)`, function by function.
    fn slopes(&mut self) -> Result<Vec<Vec<NodeId>>, TooManyNodes> {
        (0..self.functions.len())
            .map(|k| {
                let root = self.value_and_slope(k)[1];
                (0..self.dimension).map(|i| self.at(k, root, i)).collect()
            })
            .collect()
    }

    /// The traces, and what they change by.
    fn traces(
        &mut self,
        slopes: &[Vec<NodeId>],
        seen: &[NodeId],
    ) -> Result<(Vec<NodeId>, Vec<NodeId>), TooManyNodes> {
        let d = self.dimension;
        let (mut sums, mut changes) = (Vec::new(), Vec::new());
        for (k, slopes) in slopes.iter().enumerate() {
            let root = self.value_and_slope(k)[0];
            let (mut sum, mut change) = (None, None);
            for i in 0..d {
                let value = self.at(k, root, i)?;
                sum = self.added(sum, value)?;
                let part = self.graph.multiply(slopes[i], seen[i * d + i])?;
                change = self.added(change, part)?;
            }
            sums.push(self.finished(sum)?);
            changes.push(self.finished(change)?);
        }
        Ok((sums, changes))
    }

    /// `D_ij = n_i dF N_j`
    fn seen_in_axes(&mut self) -> Result<Vec<NodeId>, TooManyNodes> {
        let d = self.dimension;
        let right: Vec<NodeId> = self.inputs(Input::RightAxis)?;
        let left: Vec<NodeId> = self.inputs(Input::LeftAxis)?;
        let direction: Vec<NodeId> = self.inputs(Input::Direction)?;
        // dF N_j, then n_i of it.
        let mut half = Vec::with_capacity(d * d);
        for (a, j) in pairs(d) {
            half.push(self.dot((0..d).map(|b| (direction[a * d + b], right[j * d + b])))?);
        }
        let mut seen = Vec::with_capacity(d * d);
        for (i, j) in pairs(d) {
            seen.push(self.dot((0..d).map(|a| (left[i * d + a], half[a * d + j])))?);
        }
        Ok(seen)
    }

    fn inputs(&mut self, of: fn(u8) -> Input) -> Result<Vec<NodeId>, TooManyNodes> {
        let components = graph::components(self.dimension);
        components.into_iter().map(|k| self.graph.input(of(k))).collect()
    }

    /// `P = dpsi/dF + sum_i p_i n_i N_i`
    fn stress(
        &mut self,
        explicit: &[NodeId],
        weights: &Weights<'_>,
        slopes: &[Vec<NodeId>],
    ) -> Result<Vec<NodeId>, TooManyNodes> {
        let d = self.dimension;
        let zero = self.graph.number(0.0)?;
        let mut along = vec![zero; d * d];
        for i in 0..d {
            along[i * d + i] = self.weighted(weights.by_trace, |k| slopes[k][i])?;
        }
        self.in_space(explicit, &along)
    }

    /// The change of the stress.
    fn product(
        &mut self,
        explicit: &[NodeId],
        weights: &Weights<'_>,
        slopes: &[Vec<NodeId>],
        seen: &[NodeId],
    ) -> Result<Vec<NodeId>, TooManyNodes> {
        let d = self.dimension;
        let zero = self.graph.number(0.0)?;
        let mut change = vec![zero; d * d];
        for i in 0..d {
            let of_weights = self.weighted(weights.change, |k| slopes[k][i])?;
            let stiffness = self.along(weights.by_trace, i)?;
            let of_stretch = self.graph.multiply(stiffness, seen[i * d + i])?;
            change[i * d + i] = self.graph.add(of_weights, of_stretch)?;
        }
        for (i, j) in pairs(d).filter(|(i, j)| i < j) {
            let two = self.graph.number(2.0)?;
            let (first, second) = (seen[i * d + j], seen[j * d + i]);
            let sum = self.graph.add(first, second)?;
            let mean = self.graph.divide(sum, two)?;
            let difference = self.graph.subtract(first, second)?;
            let turn = self.graph.divide(difference, two)?;
            let stiffness = self.across(weights.by_trace, (i, j))?;
            let symmetric = self.graph.multiply(stiffness, mean)?;
            let stiffness = self.turning(weights.by_trace, slopes, (i, j))?;
            let skew = self.graph.multiply(stiffness, turn)?;
            change[i * d + j] = self.graph.add(symmetric, skew)?;
            change[j * d + i] = self.graph.subtract(symmetric, skew)?;
        }
        self.in_space(explicit, &change)
    }

    /// `sum_k A_k f_k''(s_i)`
    fn along(&mut self, weights: &[NodeId], i: usize) -> Result<NodeId, TooManyNodes> {
        let mut parts = Vec::new();
        for k in 0..self.functions.len() {
            let root = self.functions[k].derivatives[2];
            let second = self.at(k, root, i)?;
            parts.push(self.beyond_rest(k, second)?);
        }
        self.weighted(weights, |k| parts[k])
    }

    /// `sum_k A_k f_k'[s_i, s_j]`
    fn across(
        &mut self,
        weights: &[NodeId],
        (i, j): (usize, usize),
    ) -> Result<NodeId, TooManyNodes> {
        let (a, b) = (self.stretch(i)?, self.stretch(j)?);
        let mut parts = Vec::new();
        for (k, function) in self.functions.iter().enumerate() {
            let source = function.graph.graph();
            let slope = function.derivatives[1];
            let divided = divided::divided(&mut self.graph, source, slope, (a, b))?;
            parts.push(self.beyond_rest(k, divided)?);
        }
        self.weighted(weights, |k| parts[k])
    }

    /// `sum_k A_k (f_k'(s_i) + f_k'(s_j))/(s_i + s_j)`
    fn turning(
        &mut self,
        weights: &[NodeId],
        slopes: &[Vec<NodeId>],
        (i, j): (usize, usize),
    ) -> Result<NodeId, TooManyNodes> {
        let first = self.weighted(weights, |k| slopes[k][i])?;
        let second = self.weighted(weights, |k| slopes[k][j])?;
        let sum = self.graph.add(first, second)?;
        let (a, b) = (self.stretch(i)?, self.stretch(j)?);
        let both = self.graph.add(a, b)?;
        self.graph.divide(sum, both)
    }

    /// A second derivative less what the form near rest counts elsewhere.
    fn beyond_rest(&mut self, k: usize, second: NodeId) -> Result<NodeId, TooManyNodes> {
        let slope = self.slope_at_rest(k);
        let slope = self.graph.number(slope)?;
        self.graph.subtract(second, slope)
    }

    /// `explicit_ab + sum_ij n_i[a] t_ij N_j[b]`
    fn in_space(
        &mut self,
        explicit: &[NodeId],
        tensor: &[NodeId],
    ) -> Result<Vec<NodeId>, TooManyNodes> {
        let d = self.dimension;
        let left = self.inputs(Input::LeftAxis)?;
        let right = self.inputs(Input::RightAxis)?;
        let mut half = Vec::with_capacity(d * d);
        for (a, j) in pairs(d) {
            half.push(self.dot((0..d).map(|i| (left[i * d + a], tensor[i * d + j])))?);
        }
        let mut sums = Vec::with_capacity(d * d);
        for (a, b) in pairs(d) {
            let sum = self.dot((0..d).map(|j| (half[a * d + j], right[j * d + b])))?;
            sums.push(self.graph.add(explicit[a * d + b], sum)?);
        }
        Ok(sums)
    }

    fn weighted(
        &mut self,
        weights: &[NodeId],
        of: impl Fn(usize) -> NodeId,
    ) -> Result<NodeId, TooManyNodes> {
        self.dot(weights.iter().enumerate().map(|(k, weight)| (*weight, of(k))))
    }

    fn dot(
        &mut self,
        terms: impl Iterator<Item = (NodeId, NodeId)>,
    ) -> Result<NodeId, TooManyNodes> {
        let mut sum = None;
        for (x, y) in terms {
            let term = self.graph.multiply(x, y)?;
            sum = self.added(sum, term)?;
        }
        self.finished(sum)
    }

    fn added(&mut self, sum: Sum, term: NodeId) -> Result<Sum, TooManyNodes> {
        Ok(Some(match sum {
            Some(sum) => self.graph.add(sum, term)?,
            None => term,
        }))
    }

    fn finished(&mut self, sum: Sum) -> Result<NodeId, TooManyNodes> {
        sum.map_or_else(|| self.graph.number(0.0), Ok)
    }
}

fn pairs(d: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..d * d).map(move |k| (k / d, k % d))
}
