//! An energy of `F` near rest as a function of `H = F - I`, with its digits.
//!
//! As written, `tr(C) - 3 - 2*ln(J)` is a difference of numbers near 3 and 0 whose constant and linear
//! parts cancel: at strain 1e-8 nothing of it is left. So every node becomes `value + slope . H + rest`:
//! value and slope are numbers, found here, and only the rest, of second order in `H`, is a graph. What
//! cancels cancels in the numbers, once, and the rests add up to the energy
//! (`mu*(H:H/2 - I2(H) - det(H) + x - ln(1 + x))`, x = J - 1, for the neo-Hookean one).
//!
//! Before: the simplified graph in `F`. After: the energy as a graph in `H`, right up to
//! `max |H| = 0.25`, or nothing where it has no value at rest.

mod functions;

use crate::expression::graph::dimension;
use crate::expression::interpret::Interpreter;
use crate::expression::{Comparison, Input, Node, NodeId, Operator, TooManyNodes};
use crate::simplify::Simplifier;

/// A node near rest: `value + slope . H + rest`.
#[derive(Clone, Debug)]
struct Expansion {
    value: f64,
    /// By the place of the variable.
    slope: Vec<f64>,
    /// Of second order in `H`; `None` where it is 0.
    rest: Option<NodeId>,
    /// How far rounding may have moved value and slope.
    noise: f64,
}

impl Expansion {
    fn constant(value: f64, n: usize) -> Expansion {
        Expansion { value, slope: vec![0.0; n], rest: None, noise: 0.0 }
    }

    fn steepest(&self) -> f64 {
        self.slope.iter().fold(0.0, |most, x| x.abs().max(most))
    }

    /// Whether it is the same at every `H`.
    fn is_constant(&self) -> bool {
        self.rest.is_none() && self.slope.iter().all(|x| *x == 0.0)
    }

    fn size(&self) -> f64 {
        self.value.abs() + self.steepest()
    }
}

fn value_at_rest(traces: Traces<'_>, k: u8, n_components: usize) -> f64 {
    let function = traces.get(usize::from(k)).copied().flatten();
    function.map_or(f64::NAN, |function| dimension(n_components) as f64 * function.value)
}

/// A node near rest, or a condition.
#[derive(Clone, Debug)]
enum Near {
    Number(Expansion),
    Truth(NodeId),
}

type Rest = Result<Option<NodeId>, TooManyNodes>;

/// Half a unit in the last place of 1.
const U: f64 = f64::EPSILON / 2.0;

/// A value or a slope at rest counts as 0 within this many times its possible rounding.
const NOTHING: f64 = 4.0;

/// A function of a principal stretch at rest: `f(1 + e) = value + slope*e + rest(e)`.
pub(super) struct FunctionAtRest {
    value: f64,
    pub(super) slope: f64,
    /// How far rounding may have moved both.
    noise: f64,
    /// In `StretchChange(0)`; none where it is 0.
    pub(super) rest: Option<NodeId>,
}

/// The functions whose traces an energy holds, by number; `None` where one has no value at rest.
pub(super) type Traces<'a> = &'a [Option<&'a FunctionAtRest>];

/// The function `root` of `Stretch(0)` at rest; `None` where it is no number there.
pub(super) fn function_at_rest(
    graph: &mut Simplifier,
    root: NodeId,
) -> Result<Option<FunctionAtRest>, TooManyNodes> {
    let variables =
        [Varying { variable: Input::Stretch(0), change: Input::StretchChange(0), at_rest: 1.0 }];
    let mut expander = Expander::new(graph, root, &variables, &[]);
    let Some(Expansion { value, slope, rest, noise }) = expander.run(root)? else {
        return Ok(None);
    };
    Ok(Some(FunctionAtRest { value, slope: slope[0], noise, rest }))
}

/// The energy `root` near rest, where traces stand for what is beyond rest of their functions: see
/// [`Expander::trace`]; `None` where it is no number there.
pub(super) fn near(
    graph: &mut Simplifier,
    root: NodeId,
    components: &[u8],
    traces: Traces<'_>,
) -> Result<Option<NodeId>, TooManyNodes> {
    let variables: Vec<Varying> = components
        .iter()
        .map(|&k| Varying {
            variable: Input::Variable(k),
            change: Input::VariableChange(k),
            at_rest: rest_of_component(k),
        })
        .collect();
    let mut expander = Expander::new(graph, root, &variables, traces);
    let Some(energy) = expander.run(root)? else { return Ok(None) };
    let zeroed = |x: f64| if x.abs() <= NOTHING * energy.noise { 0.0 } else { x };
    let energy = Expansion {
        value: zeroed(energy.value),
        slope: energy.slope.iter().map(|x| zeroed(*x)).collect(),
        ..energy
    };
    let change = expander.change(&energy)?;
    let value = expander.graph.number(energy.value)?;
    Ok(Some(match change {
        None => value,
        Some(change) => expander.graph.add(value, change)?,
    }))
}

/// A variable of an energy.
#[derive(Clone, Copy)]
struct Varying {
    variable: Input,
    change: Input,
    at_rest: f64,
}

/// Components on the diagonal: 0, 4, 8.
fn rest_of_component(k: u8) -> f64 {
    f64::from(u8::from(k.is_multiple_of(4)))
}

struct Expander<'a> {
    graph: &'a mut Simplifier,
    variables: &'a [Varying],
    traces: Traces<'a>,
    /// Values of the nodes at rest.
    at_rest: Interpreter<f64>,
    known: Vec<Option<Near>>,
    /// Which nodes depend on traces.
    has_traces: Vec<bool>,
    /// Conditions that compare what is equal at rest, so that another branch may hold beside it.
    tied: Vec<bool>,
}

impl<'a> Expander<'a> {
    fn new(
        graph: &'a mut Simplifier,
        root: NodeId,
        variables: &'a [Varying],
        traces: Traces<'a>,
    ) -> Expander<'a> {
        let mut at_rest = Interpreter::new();
        at_rest.run(graph.graph(), |input| match input {
            Input::Variable(k) => rest_of_component(k),
            Input::Stretch(_) => 1.0,
            Input::Trace(k) => value_at_rest(traces, k, variables.len()),
            _ => 0.0,
        });
        let mut has_traces = Vec::with_capacity(graph.graph().len());
        for (_, node) in graph.graph().nodes() {
            let is_trace = matches!(node, Node::Input(Input::Trace(_)));
            has_traces.push(is_trace || node.operands().any(|x: NodeId| has_traces[x.0 as usize]));
        }
        let n = root.0 as usize + 1;
        let (known, tied) = (vec![None; n], vec![false; n]);
        Expander { graph, variables, traces, at_rest, known, has_traces, tied }
    }

    fn run(&mut self, root: NodeId) -> Result<Option<Expansion>, TooManyNodes> {
        let needed = self.graph.graph().reachable(&[root]);
        for index in (0..self.known.len()).filter(|index| needed[*index]) {
            let id = NodeId(index as u32);
            let near = self.node(id)?;
            if let Near::Number(expansion) = &near
                && !(expansion.value.is_finite() && expansion.steepest().is_finite())
            {
                return Ok(None);
            }
            self.known[index] = Some(near);
        }
        Ok(Some(self.number(root)))
    }

    fn number(&self, id: NodeId) -> Expansion {
        match &self.known[id.0 as usize] {
            Some(Near::Number(expansion)) => expansion.clone(),
            _ => Expansion::constant(f64::NAN, self.variables.len()),
        }
    }

    fn is_tied(&self, id: NodeId) -> bool {
        self.tied[id.0 as usize]
    }

    fn truth(&self, id: NodeId) -> NodeId {
        match self.known[id.0 as usize] {
            Some(Near::Truth(condition)) => condition,
            _ => id,
        }
    }

    fn node(&mut self, id: NodeId) -> Result<Near, TooManyNodes> {
        let n = self.variables.len();
        Ok(Near::Number(match self.graph.graph()[id] {
            Node::Number(bits) => Expansion::constant(f64::from_bits(bits), n),
            Node::Input(input @ (Input::Variable(_) | Input::Stretch(_))) => {
                let place = self.variables.iter().position(|known| known.variable == input);
                let place = place.expect("one of the variables");
                let mut slope = vec![0.0; n];
                slope[place] = 1.0;
                Expansion { value: self.variables[place].at_rest, slope, rest: None, noise: 0.0 }
            }
            Node::Input(Input::Trace(k)) => self.trace(k)?,
            Node::Unary(function, x) => self.unary(id, function, x)?,
            Node::PowerConstant(x, bits) => self.power(id, x, f64::from_bits(bits))?,
            Node::Binary(operator, x, y) => self.binary(id, operator, x, y)?,
            Node::Select(c, x, y) => {
                let condition = self.truth(c);
                if matches!(self.known[x.0 as usize], Some(Near::Truth(_))) {
                    self.tied[id.0 as usize] = [c, x, y].into_iter().any(|x| self.is_tied(x));
                    let node = Node::Select(condition, self.truth(x), self.truth(y));
                    return self.graph.make(node).map(Near::Truth);
                }
                self.choice(id, condition, x, y, self.is_tied(c))?
            }
            Node::Compare(comparison, x, y) => {
                return self.compare(id, comparison, x, y).map(Near::Truth);
            }
            node @ (Node::And(..) | Node::Or(..) | Node::Not(_)) => {
                self.tied[id.0 as usize] = node.operands().any(|x| self.is_tied(x));
                let node = node.map_operands(|x| self.truth(x));
                return self.graph.make(node).map(Near::Truth);
            }
            Node::Truth(_) => return Ok(Near::Truth(id)),
            Node::Input(_) | Node::Strain(..) => self.opaque(id)?,
        }))
    }

    /// `slope . H + rest`, what a node changes by.
    fn change(&mut self, x: &Expansion) -> Rest {
        let linear = self.linear(&x.slope)?;
        self.sum(linear, x.rest)
    }

    /// Components with one slope are added first: `a*(H11 + H22 + H33)`.
    fn linear(&mut self, slope: &[f64]) -> Rest {
        let mut seen: Vec<f64> = Vec::new();
        let mut total = None;
        for &a in slope.iter().filter(|a| **a != 0.0) {
            if seen.contains(&a.abs()) {
                continue;
            }
            seen.push(a.abs());
            let mut sum = None;
            for (place, b) in slope.iter().enumerate().filter(|(_, b)| b.abs() == a.abs()) {
                let input = self.graph.input(self.variables[place].change)?;
                let signed =
                    if (*b < 0.0) == (a < 0.0) { input } else { self.graph.negate(input)? };
                sum = self.sum(sum, Some(signed))?;
            }
            let term = self.scaled(sum, a)?;
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

    fn scaled(&mut self, x: Option<NodeId>, by: f64) -> Rest {
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
        let n = self.variables.len();
        let Some(function) = self.traces.get(usize::from(k)).copied().flatten() else {
            return Ok(Expansion::constant(f64::NAN, n));
        };
        let mut squares = None;
        for varying in self.variables {
            let h = self.graph.input(varying.change)?;
            let square = self.graph.multiply(h, h)?;
            squares = self.sum(squares, Some(square))?;
        }
        let squares = self.scaled(squares, 0.5 * function.slope)?;
        let beyond = self.graph.input(Input::Trace(k))?;
        let rest = self.sum(squares, Some(beyond))?;
        Ok(Expansion {
            value: value_at_rest(self.traces, k, n),
            slope: self.variables.iter().map(|v| v.at_rest * function.slope).collect(),
            rest,
            noise: dimension(n) as f64 * function.noise,
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
            Operator::Divide if q.is_constant() => {
                let divisor = self.graph.number(q.value)?;
                let rest = p.rest.map(|rest| self.graph.divide(rest, divisor)).transpose()?;
                let slope: Vec<f64> = p.slope.iter().map(|a| a / q.value).collect();
                let noise = (p.noise + U * p.size()) / q.value.abs();
                Ok(Expansion { value: p.value / q.value, slope, rest, noise })
            }
            Operator::Divide => {
                let reciprocal = self.reciprocal(&q)?;
                self.product(&p, &reciprocal)
            }
            Operator::Min | Operator::Max => {
                let comparison = match operator {
                    Operator::Min => Comparison::LessEqual,
                    _ => Comparison::GreaterEqual,
                };
                let condition = self.compare(id, comparison, x, y)?;
                self.choice(id, condition, x, y, self.is_tied(id))
            }
            Operator::Power => self.opaque(id),
        }
    }

    /// `x + sign*y`
    fn combination(
        &mut self,
        x: &Expansion,
        y: &Expansion,
        sign: f64,
    ) -> Result<Expansion, TooManyNodes> {
        let value = x.value + sign * y.value;
        let slope: Vec<f64> = x.slope.iter().zip(&y.slope).map(|(a, b)| a + sign * b).collect();
        let rest = match (x.rest, y.rest) {
            (Some(p), Some(q)) if sign < 0.0 => Some(self.graph.subtract(p, q)?),
            (Some(p), Some(q)) => Some(self.graph.add(p, q)?),
            (None, Some(q)) if sign < 0.0 => Some(self.graph.negate(q)?),
            (only, None) | (None, only) => only,
        };
        let noise = x.noise + y.noise + U * x.size().max(y.size());
        Ok(Expansion { value, slope, rest, noise })
    }

    /// `(a + p)*(b + q) = a*b + (a*q + b*p) + p*q` with the changes `p` and `q`.
    fn product(&mut self, x: &Expansion, y: &Expansion) -> Result<Expansion, TooManyNodes> {
        let slopes = x.slope.iter().zip(&y.slope);
        let slope: Vec<f64> = slopes.map(|(a, b)| x.value * b + y.value * a).collect();
        let (first, second) = (self.scaled(y.rest, x.value)?, self.scaled(x.rest, y.value)?);
        let single = self.sum(first, second)?;
        let (p, q) = (self.change(x)?, self.change(y)?);
        let both = self.times(p, q)?;
        let rest = self.sum(single, both)?;
        let noise = x.size() * y.noise + y.size() * x.noise + 2.0 * U * x.size() * y.size();
        let noise = if x.is_constant() || y.is_constant() { noise / 2.0 } else { noise };
        Ok(Expansion { value: x.value * y.value, slope, rest, noise })
    }

    /// Equal values at rest are told apart by what they change by.
    fn compare(
        &mut self,
        id: NodeId,
        comparison: Comparison,
        x: NodeId,
        y: NodeId,
    ) -> Result<NodeId, TooManyNodes> {
        let (p, q) = (self.number(x), self.number(y));
        if (p.value - q.value).abs() > NOTHING * (p.noise + q.noise) {
            let same = Node::Compare(comparison, self.whole(x)?, self.whole(y)?);
            return if self.graph.graph()[id] == same { Ok(id) } else { self.graph.make(same) };
        }
        self.tied[id.0 as usize] = true;
        let (p, q) = (self.change(&p)?, self.change(&q)?);
        let zero = self.graph.number(0.0)?;
        let node = Node::Compare(comparison, p.unwrap_or(zero), q.unwrap_or(zero));
        self.graph.make(node)
    }

    /// Branches that agree to first order at rest differ by their rests. Where an energy jumps at rest its
    /// value there says nothing of those beside it, and it has no form near rest.
    fn choice(
        &mut self,
        id: NodeId,
        condition: NodeId,
        x: NodeId,
        y: NodeId,
        is_tied: bool,
    ) -> Result<Expansion, TooManyNodes> {
        let (p, q) = (self.number(x), self.number(y));
        let noise = p.noise + q.noise;
        let agree = |a: f64, b: f64| (a - b).abs() <= NOTHING * noise;
        let slopes = p.slope.iter().zip(&q.slope).all(|(a, b)| agree(*a, *b));
        if is_tied && !agree(p.value, q.value) {
            return Ok(Expansion::constant(f64::NAN, self.variables.len()));
        }
        if !(agree(p.value, q.value) && slopes) {
            return self.opaque(id);
        }
        let zero = self.graph.number(0.0)?;
        let node = Node::Select(condition, p.rest.unwrap_or(zero), q.rest.unwrap_or(zero));
        let rest = if p.rest == q.rest { p.rest } else { Some(self.graph.make(node)?) };
        Ok(Expansion { rest, noise, ..p })
    }

    /// A node as it was, with its own value. Where it holds traces, which stand for something else
    /// near rest, that is its value at rest and its change.
    fn whole(&mut self, id: NodeId) -> Result<NodeId, TooManyNodes> {
        match self.known[id.0 as usize].clone() {
            _ if !self.has_traces[id.0 as usize] => Ok(id),
            Some(Near::Truth(condition)) => Ok(condition),
            Some(Near::Number(near)) => {
                let value = self.graph.number(near.value)?;
                match self.change(&near)? {
                    Some(change) => self.graph.add(value, change),
                    None => Ok(value),
                }
            }
            None => Ok(id),
        }
    }

    /// A node of which nothing better is known: its change is a difference, as exact as that is.
    fn opaque(&mut self, id: NodeId) -> Result<Expansion, TooManyNodes> {
        let value = self.at_rest.number(id);
        let at_rest = self.graph.number(value)?;
        let node = self.graph.graph()[id];
        let operands = node.operands().map(|x| self.whole(x));
        let operands: Vec<NodeId> = operands.collect::<Result<_, _>>()?;
        let same = node.operands().eq(operands.iter().copied());
        let mut operands = operands.into_iter();
        let node = node.map_operands(|_| operands.next().expect("one per operand"));
        let id = if same { id } else { self.graph.make(node)? };
        let rest = Some(self.graph.subtract(id, at_rest)?);
        let n = self.variables.len();
        Ok(Expansion { rest, noise: U * value.abs(), ..Expansion::constant(value, n) })
    }
}
