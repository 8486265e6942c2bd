//! An energy of `F` near rest as a function of `H = F - I`, with its digits.
//!
//! As written, `tr(C) - 3 - 2*ln(J)` is a difference of numbers near 3 and 0 whose constant and linear
//! parts cancel: at strain 1e-8 nothing of it is left. So every node becomes `value + slope . H + rest`:
//! value and slope are numbers of 256 bits, found here, and only the rest, of second order in `H`, is a
//! graph. What cancels cancels in the numbers, once, and the rests add up to the energy
//! (`mu*(H:H/2 - I2(H) - det(H) + x - ln(1 + x))`, x = J - 1, for the neo-Hookean one).
//!
//! Before: the simplified graph in `F`, with all digits of its numbers. After: the energy as a graph in `H`, right up to
//! `max |H| = 0.25` where it is not steep ([`super::reach`]), or nothing where it has no value at rest.

mod functions;
mod terms;

use crate::differentiate::at_tie;
use crate::expression::graph::dimension;
use crate::expression::{
    Comparison, ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes,
};
use crate::near::{Exact, Number};
use crate::simplify::Simplifier;
pub(crate) use terms::{near_of_gathered, near_of_vanishing, with_fields};

/// A node near rest: `value + slope . H + rest`.
#[derive(Clone, Debug)]
struct Expansion {
    value: Exact,
    /// By the place of the variable, then of the [`Expander::kinks`]; 0 where it ends.
    slope: Vec<Exact>,
    /// Of second order in `H`; `None` where it is 0.
    rest: Option<NodeId>,
}

impl Expansion {
    fn constant(value: Exact, n: usize) -> Expansion {
        Expansion { value, slope: vec![Exact::from(0.0); n], rest: None }
    }

    /// The slopes of two nodes, place by place.
    fn slopes<'a>(&'a self, other: &'a Expansion) -> impl Iterator<Item = (Exact, Exact)> + 'a {
        let of = |slope: &[Exact], k: usize| slope.get(k).cloned().unwrap_or(Exact::from(0.0));
        let n = self.slope.len().max(other.slope.len());
        (0..n).map(move |k| (of(&self.slope, k), of(&other.slope, k)))
    }

    fn is_linear(&self) -> bool {
        self.rest.is_none()
    }

    /// Whether it is the same at every `H`.
    fn is_constant(&self) -> bool {
        self.is_linear() && self.slope.iter().all(Exact::is_nothing)
    }

    fn is_finite(&self) -> bool {
        let is_finite = |x: &Exact| x.value.to_f64().is_finite();
        is_finite(&self.value) && self.slope.iter().all(is_finite)
    }
}

/// A node near rest, or a condition and what it is there, unless that is a tie.
#[derive(Clone, Debug)]
enum Near {
    Number(Expansion),
    /// A number of which nothing is known at rest.
    Unknown(NodeId),
    Truth(NodeId, Option<bool>),
}

type Rest = Result<Option<NodeId>, TooManyNodes>;

/// A function of a principal stretch at rest: `f(1 + e) = value + slope*e + rest(e)`.
pub(super) struct FunctionAtRest {
    value: Exact,
    slope: Exact,
    /// In `StretchChange(0)`; none where it is 0.
    pub(super) rest: Option<NodeId>,
}

impl FunctionAtRest {
    /// `f'(1)`
    pub(super) fn slope(&self) -> f64 {
        self.slope.value.to_f64()
    }
}

/// The functions whose traces an energy holds, by number; `None` where one has no value at rest.
pub(super) type Traces<'a> = &'a [Option<&'a FunctionAtRest>];

/// A graph with all digits of its numbers, and where its nodes are in the graph that is evaluated.
#[derive(Clone, Copy)]
pub(crate) struct Source<'a> {
    pub(crate) graph: &'a ExprGraph,
    pub(crate) place: &'a [NodeId],
}

/// The function `root` of `Stretch(0)` at rest; `None` where it is no number there.
pub(super) fn function_at_rest(
    graph: &mut Simplifier,
    source: Source<'_>,
    root: NodeId,
) -> Result<Option<FunctionAtRest>, TooManyNodes> {
    let variables =
        [Varying { variable: Input::Stretch(0), change: Input::StretchChange(0), at_rest: 1.0 }];
    let mut expander = Expander::new(graph, source, &variables, &[]);
    let Some(Expansion { value, mut slope, rest }) = expander.run(root)? else { return Ok(None) };
    if matches!(expander.known[root.0 as usize], Some(Near::Unknown(_))) {
        return Ok(None);
    }
    Ok(Some(FunctionAtRest { value, slope: slope.remove(0), rest }))
}

/// The energy `root` near rest, where traces stand for what is beyond rest of their functions: see
/// [`Expander::trace`], and whether there are roots in it of what is 0 at rest; `None` where it is no number there.
pub(super) fn near(
    graph: &mut Simplifier,
    source: Source<'_>,
    root: NodeId,
    components: &[u8],
    traces: Traces<'_>,
) -> Result<Option<(NodeId, bool)>, TooManyNodes> {
    let variables: Vec<Varying> = components
        .iter()
        .map(|&k| Varying {
            variable: Input::Variable(k),
            change: Input::VariableChange(k),
            at_rest: f64::from(u8::from(k.is_multiple_of(4))),
        })
        .collect();
    let mut expander = Expander::new(graph, source, &variables, traces);
    let near = expander.whole_of(root)?;
    Ok(near.map(|near| (near, expander.has_roots)))
}

/// A variable of an energy.
#[derive(Clone, Copy)]
struct Varying {
    variable: Input,
    change: Input,
    at_rest: f64,
}

/// What is a variable, or something of which nothing is known before a run.
fn is_from_outside(input: Input) -> bool {
    matches!(
        input,
        Input::Variable(_)
            | Input::Stretch(_)
            | Input::Parameter(_)
            | Input::Integral(_)
            | Input::Neighbour(_)
            | Input::Current(_)
            | Input::Reference(_)
            | Input::Change(_)
            | Input::Part(_)
            | Input::PartAtRest(_)
            | Input::PartChange(_)
    )
}

struct Expander<'a> {
    graph: &'a mut Simplifier,
    source: Source<'a>,
    variables: &'a [Varying],
    traces: Traces<'a>,
    known: Vec<Option<Near>>,
    /// Which nodes depend on traces.
    has_traces: Vec<bool>,
    /// What is of first order at rest without a slope there, as the root of a square: each counts as a
    /// variable of its own, so that it may cancel.
    kinks: Vec<NodeId>,
    /// Whether there are roots, or other powers and functions, of what is 0 at rest.
    has_roots: bool,
}

impl<'a> Expander<'a> {
    fn new(
        graph: &'a mut Simplifier,
        source: Source<'a>,
        variables: &'a [Varying],
        traces: Traces<'a>,
    ) -> Expander<'a> {
        let mut has_traces = Vec::with_capacity(source.graph.len());
        for (_, node) in source.graph.nodes() {
            let is_trace = matches!(node, Node::Input(Input::Trace(_)));
            has_traces.push(is_trace || node.operands().any(|x: NodeId| has_traces[x.0 as usize]));
        }
        let known = vec![None; source.graph.len()];
        Expander {
            graph,
            source,
            variables,
            traces,
            known,
            has_traces,
            kinks: Vec::new(),
            has_roots: false,
        }
    }

    fn run(&mut self, root: NodeId) -> Result<Option<Expansion>, TooManyNodes> {
        let needed = self.source.graph.reachable(&[root]);
        for index in (0..=root.0 as usize).filter(|index| needed[*index]) {
            let near = self.node(NodeId(index as u32))?;
            if matches!(&near, Near::Number(expansion) if !expansion.is_finite()) {
                return Ok(None);
            }
            self.known[index] = Some(near);
        }
        Ok(Some(self.number(root)))
    }

    /// The root as one expression in the changes of its variables; `None` where it is no number at rest.
    fn whole_of(&mut self, root: NodeId) -> Result<Option<NodeId>, TooManyNodes> {
        let Some(energy) = self.run(root)? else { return Ok(None) };
        match self.known[root.0 as usize] {
            Some(Near::Unknown(node)) => Ok(Some(node)),
            _ => self.total(&energy).map(Some),
        }
    }

    fn number(&self, id: NodeId) -> Expansion {
        match &self.known[id.0 as usize] {
            Some(Near::Number(expansion)) => expansion.clone(),
            _ => self.nothing(),
        }
    }

    fn constant(&self, value: Exact) -> Expansion {
        Expansion::constant(value, self.variables.len())
    }

    /// No number.
    fn nothing(&self) -> Expansion {
        self.constant(Exact::new(Number::NONE))
    }

    /// A condition, and what it is at rest.
    fn truth(&self, id: NodeId) -> (NodeId, Option<bool>) {
        match self.known[id.0 as usize] {
            Some(Near::Truth(condition, at_rest)) => (condition, at_rest),
            _ => (self.source.place[id.0 as usize], None),
        }
    }

    fn node(&mut self, id: NodeId) -> Result<Near, TooManyNodes> {
        let is_unknown = |x: NodeId| matches!(self.known[x.0 as usize], Some(Near::Unknown(_)));
        if self.source.graph[id].operands().any(is_unknown) {
            return self.with_unknown(id);
        }
        Ok(Near::Number(match self.source.graph[id] {
            Node::Number(bits) => self.constant(Exact::from(f64::from_bits(bits))),
            Node::Input(input) if is_from_outside(input) => {
                let place = self.variables.iter().position(|known| known.variable == input);
                let Some(place) = place else {
                    return Ok(Near::Unknown(self.source.place[id.0 as usize]));
                };
                let mut expansion = self.constant(Exact::from(self.variables[place].at_rest));
                expansion.slope[place] = Exact::from(1.0);
                expansion
            }
            Node::Input(Input::Trace(k)) => self.trace(k)?,
            Node::Unary(function, x) => self.unary(id, function, x)?,
            Node::PowerConstant(x, bits) => {
                let x = self.number(x);
                self.power(&x, &Number::from(f64::from_bits(bits)))?
            }
            Node::Binary(operator, x, y) => self.binary(id, operator, x, y)?,
            Node::Select(c, x, y) => {
                let (condition, at_rest) = self.truth(c);
                if matches!(self.known[x.0 as usize], Some(Near::Truth(..))) {
                    let [(x, p), (y, q)] = [self.truth(x), self.truth(y)];
                    let made = self.graph.make(Node::Select(condition, x, y))?;
                    return Ok(Near::Truth(made, at_rest.and_then(|c| if c { p } else { q })));
                }
                let (x, y) = (self.number(x), self.number(y));
                self.choice((condition, at_rest), &x, &y)?
            }
            Node::Compare(comparison, x, y) => {
                let (x, y) = (self.number(x), self.number(y));
                let (condition, at_rest) = self.compare(Some(id), comparison, &x, &y)?;
                return Ok(Near::Truth(condition, at_rest));
            }
            Node::And(x, y) => {
                let [(x, p), (y, q)] = [self.truth(x), self.truth(y)];
                let made = self.graph.make(Node::And(x, y))?;
                return Ok(Near::Truth(made, p.zip(q).map(|(p, q)| p && q)));
            }
            Node::Or(x, y) => {
                let [(x, p), (y, q)] = [self.truth(x), self.truth(y)];
                let made = self.graph.make(Node::Or(x, y))?;
                return Ok(Near::Truth(made, p.zip(q).map(|(p, q)| p || q)));
            }
            Node::Not(x) => {
                let (x, p) = self.truth(x);
                return Ok(Near::Truth(self.graph.make(Node::Not(x))?, p.map(|p| !p)));
            }
            Node::Truth(holds) => {
                return Ok(Near::Truth(self.graph.make(Node::Truth(holds))?, Some(holds)));
            }
            Node::Input(_) | Node::Strain(..) => self.nothing(),
        }))
    }

    /// A node with an operand of which nothing is known: a multiple of what is 0 at rest is so, too.
    fn with_unknown(&mut self, id: NodeId) -> Result<Near, TooManyNodes> {
        let node = self.source.graph[id];
        let operands = node.operands().map(|x| self.whole(x));
        let operands: Vec<NodeId> = operands.collect::<Result<_, _>>()?;
        let mut codes = operands.into_iter();
        let made =
            self.graph.make(node.map_operands(|_| codes.next().expect("one per operand")))?;
        let vanishes = |x: NodeId| match &self.known[x.0 as usize] {
            Some(Near::Number(x)) => x.value.is_nothing(),
            _ => false,
        };
        Ok(match node {
            Node::Compare(..) | Node::And(..) | Node::Or(..) | Node::Not(_) => {
                Near::Truth(made, None)
            }
            Node::Binary(Operator::Multiply, x, y) if vanishes(x) || vanishes(y) => {
                Near::Number(self.kink(Exact::from(0.0), made))
            }
            Node::Binary(Operator::Divide, x, _) if vanishes(x) => {
                Near::Number(self.kink(Exact::from(0.0), made))
            }
            _ => Near::Unknown(made),
        })
    }

    /// `slope . H + rest`, what a node changes by.
    fn change(&mut self, x: &Expansion) -> Rest {
        let linear = self.linear(&x.slope)?;
        self.sum(linear, x.rest)
    }

    /// Components with one slope are added first: `a*(H11 + H22 + H33)`.
    fn linear(&mut self, slope: &[Exact]) -> Rest {
        let slope: Vec<f64> = slope.iter().map(|a| a.value.to_f64()).collect();
        let mut seen: Vec<f64> = Vec::new();
        let mut total = None;
        for &a in slope.iter().filter(|a| **a != 0.0) {
            if seen.contains(&a.abs()) {
                continue;
            }
            seen.push(a.abs());
            let mut sum = None;
            for (place, b) in slope.iter().enumerate().filter(|(_, b)| b.abs() == a.abs()) {
                let input = match self.variables.get(place) {
                    Some(variable) => self.graph.input(variable.change)?,
                    None => self.kinks[place - self.variables.len()],
                };
                let signed =
                    if (*b < 0.0) == (a < 0.0) { input } else { self.graph.negate(input)? };
                sum = self.sum(sum, Some(signed))?;
            }
            let term = self.multiplied(sum, a)?;
            total = self.sum(total, term)?;
        }
        Ok(total)
    }

    fn sum(&mut self, x: Option<NodeId>, y: Option<NodeId>) -> Rest {
        match (x, y) {
            (Some(x), Some(y)) => self.graph.add(x, y).map(Some),
            (only, None) | (None, only) => Ok(only),
        }
    }

    fn scaled(&mut self, x: Option<NodeId>, by: &Exact) -> Rest {
        self.multiplied(x, by.value.to_f64())
    }

    fn multiplied(&mut self, x: Option<NodeId>, by: f64) -> Rest {
        match x {
            Some(x) if by != 0.0 => {
                let by = self.graph.number(by)?;
                self.graph.multiply(by, x).map(Some)
            }
            _ => Ok(None),
        }
    }

    fn times(&mut self, x: Option<NodeId>, y: Option<NodeId>) -> Rest {
        match (x, y) {
            (Some(x), Some(y)) => self.graph.multiply(x, y).map(Some),
            _ => Ok(None),
        }
    }

    /// With `e = s - 1`, `sum e = tr(H) + (H:H - sum e^2)/2`, because `U*U = C`. So the trace of a
    /// function is `d f(1) + f'(1)*(tr(H) + H:H/2)`, and what is left are functions of second order,
    /// `f(1 + e) - f(1) - f'(1)*(e + e^2/2)`: their trace is what a trace stands for near rest.
    fn trace(&mut self, k: u8) -> Result<Expansion, TooManyNodes> {
        let Some(function) = self.traces.get(usize::from(k)).copied().flatten() else {
            return Ok(self.nothing());
        };
        let mut squares = None;
        for varying in self.variables {
            let h = self.graph.input(varying.change)?;
            let square = self.graph.multiply(h, h)?;
            squares = self.sum(squares, Some(square))?;
        }
        let squares = self.multiplied(squares, 0.5 * function.slope())?;
        let beyond = self.graph.input(Input::Trace(k))?;
        let rest = self.sum(squares, Some(beyond))?;
        let d = Exact::from(dimension(self.variables.len()) as f64);
        let slope = |v: &Varying| Exact::from(v.at_rest).times(&function.slope);
        Ok(Expansion {
            value: d.times(&function.value),
            slope: self.variables.iter().map(slope).collect(),
            rest,
        })
    }

    fn binary(
        &mut self,
        id: NodeId,
        operator: Operator,
        x: NodeId,
        y: NodeId,
    ) -> Result<Expansion, TooManyNodes> {
        let (p, q) = (self.number(x), self.number(y));
        match operator {
            Operator::Add => self.combination(&p, &q, 1.0),
            Operator::Subtract => self.combination(&p, &q, -1.0),
            Operator::Multiply => self.product(&p, &q),
            Operator::Divide => {
                let reciprocal = self.reciprocal(&q)?;
                self.product(&p, &reciprocal)
            }
            Operator::Min | Operator::Max => {
                let comparison = at_tie(operator, p.is_constant());
                let condition = self.compare(None, comparison, &p, &q)?;
                self.choice(condition, &p, &q)
            }
            Operator::Power if q.is_constant() => self.power(&p, &q.value.value),
            Operator::Power if p.value.value.is_positive() => {
                let logarithm = self.smooth(Function::Ln, &p)?;
                let exponent = self.product(&q, &logarithm)?;
                self.smooth(Function::Exp, &exponent)
            }
            Operator::Power => self.opaque(id),
            Operator::Atan2 => self.angle(id, &p, &q),
        }
    }

    /// `x + sign*y`
    fn combination(
        &mut self,
        x: &Expansion,
        y: &Expansion,
        sign: f64,
    ) -> Result<Expansion, TooManyNodes> {
        let signed = |b: &Exact| if sign < 0.0 { b.negated() } else { b.clone() };
        let value = x.value.plus(&signed(&y.value));
        let slope = x.slopes(y).map(|(a, b)| a.plus(&signed(&b))).collect();
        let rest = match (x.rest, y.rest) {
            (Some(p), Some(q)) if sign < 0.0 => Some(self.graph.subtract(p, q)?),
            (Some(p), Some(q)) => Some(self.graph.add(p, q)?),
            (None, Some(q)) if sign < 0.0 => Some(self.graph.negate(q)?),
            (only, None) | (None, only) => only,
        };
        Ok(Expansion { value, slope, rest })
    }

    /// `(a + p)*(b + q) = a*b + (a*q + b*p) + p*q` with the changes `p` and `q`.
    fn product(&mut self, x: &Expansion, y: &Expansion) -> Result<Expansion, TooManyNodes> {
        let slope = |(a, b): (Exact, Exact)| x.value.times(&b).plus(&y.value.times(&a));
        let slope = x.slopes(y).map(slope).collect();
        let (first, second) = (self.scaled(y.rest, &x.value)?, self.scaled(x.rest, &y.value)?);
        let single = self.sum(first, second)?;
        let (p, q) = (self.change(x)?, self.change(y)?);
        let both = self.times(p, q)?;
        let rest = self.sum(single, both)?;
        Ok(Expansion { value: x.value.times(&y.value), slope, rest })
    }

    /// Equal values at rest are told apart by what they change by. `as_written` is the same comparison in
    /// the source.
    fn compare(
        &mut self,
        as_written: Option<NodeId>,
        comparison: Comparison,
        x: &Expansion,
        y: &Expansion,
    ) -> Result<(NodeId, Option<bool>), TooManyNodes> {
        let difference = x.value.plus(&y.value.negated());
        if !difference.is_nothing() {
            let at_rest = Some(comparison.holds(difference.value.to_f64(), 0.0));
            if let Some(id) = as_written.filter(|id| !self.has_traces[id.0 as usize]) {
                return Ok((self.source.place[id.0 as usize], at_rest));
            }
            let same = Node::Compare(comparison, self.total(x)?, self.total(y)?);
            return Ok((self.graph.make(same)?, at_rest));
        }
        let (p, q) = (self.change(x)?, self.change(y)?);
        let zero = self.graph.number(0.0)?;
        let node = Node::Compare(comparison, p.unwrap_or(zero), q.unwrap_or(zero));
        Ok((self.graph.make(node)?, None))
    }

    /// The branch that holds at rest, with what the other one differs by where that holds. Branches that
    /// meet at rest with two slopes have none there, and their first order is left to the rest. Where an
    /// energy jumps at rest its value there says nothing of those beside it, and it has no form near rest.
    fn choice(
        &mut self,
        (condition, at_rest): (NodeId, Option<bool>),
        x: &Expansion,
        y: &Expansion,
    ) -> Result<Expansion, TooManyNodes> {
        let agree = |a: &Exact, b: &Exact| a.plus(&b.negated()).is_nothing();
        let base = match at_rest {
            Some(true) => x.clone(),
            Some(false) => y.clone(),
            None if !agree(&x.value, &y.value) => return Ok(self.nothing()),
            None if x.slopes(y).all(|(a, b)| agree(&a, &b)) => x.clone(),
            None => {
                let (p, q) = (self.change(x)?, self.change(y)?);
                let zero = self.graph.number(0.0)?;
                let node = Node::Select(condition, p.unwrap_or(zero), q.unwrap_or(zero));
                let change = self.graph.make(node)?;
                return Ok(self.kink(x.value.clone(), change));
            }
        };
        let base = Expansion { rest: None, ..base };
        let mut rests = [None, None];
        for (rest, branch) in rests.iter_mut().zip([x, y]) {
            let beyond = self.combination(branch, &base, -1.0)?;
            *rest = Some(self.total(&beyond)?);
        }
        let [Some(p), Some(q)] = rests else { return Ok(base) };
        let rest = Some(self.graph.make(Node::Select(condition, p, q))?);
        Ok(Expansion { rest, ..base })
    }

    /// A value at rest and a change of first order that has no slope there.
    fn kink(&mut self, value: Exact, change: NodeId) -> Expansion {
        let known = self.kinks.iter().position(|known| *known == change);
        let k = known.unwrap_or(self.kinks.len());
        if known.is_none() {
            self.kinks.push(change);
        }
        let mut kink = self.constant(value);
        kink.slope.resize(self.variables.len() + k + 1, Exact::from(0.0));
        kink.slope[self.variables.len() + k] = Exact::from(1.0);
        kink
    }

    /// Value and change in one.
    fn total(&mut self, x: &Expansion) -> Result<NodeId, TooManyNodes> {
        let value = self.graph.number(x.value.value.to_f64())?;
        match self.change(x)? {
            Some(change) => self.graph.add(value, change),
            None => Ok(value),
        }
    }

    /// A node as it was, with its own value. What is 0 at rest has its digits in its change, and where
    /// a node holds traces, which stand for something else near rest, it is the sum of both.
    fn whole(&mut self, id: NodeId) -> Result<NodeId, TooManyNodes> {
        match self.known[id.0 as usize].clone() {
            Some(Near::Truth(condition, _)) => Ok(condition),
            Some(Near::Unknown(node)) => Ok(node),
            Some(Near::Number(near))
                if self.has_traces[id.0 as usize] || near.value.is_nothing() =>
            {
                self.total(&near)
            }
            _ => Ok(self.source.place[id.0 as usize]),
        }
    }

    /// A node of which nothing better is known: its change is a difference, as exact as that is.
    fn opaque(&mut self, id: NodeId) -> Result<Expansion, TooManyNodes> {
        let node = self.source.graph[id];
        let value_of = |x: NodeId| self.number(x).value;
        let value = match node {
            Node::Unary(function, x) => value_of(x).function(function),
            Node::PowerConstant(x, bits) => value_of(x).power(&Number::from(f64::from_bits(bits))),
            Node::Binary(Operator::Power, x, y) => value_of(x).power(&value_of(y).value),
            Node::Binary(Operator::Atan2, x, y) => {
                Exact::new(Number::angle(&value_of(x).value, &value_of(y).value))
            }
            _ => Exact::new(Number::NONE),
        };
        let at_rest = self.graph.number(value.value.to_f64())?;
        let operands = node.operands().map(|x| self.whole(x));
        let operands: Vec<NodeId> = operands.collect::<Result<_, _>>()?;
        let mut operands = operands.into_iter();
        let node = node.map_operands(|_| operands.next().expect("one per operand"));
        let id = self.graph.make(node)?;
        let change = self.graph.subtract(id, at_rest)?;
        self.has_roots = true;
        Ok(self.kink(value, change))
    }
}
