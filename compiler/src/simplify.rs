//! Smart constructors: every node of a simplified graph is made here.
//!
//! Before: operands are simplified. After: no node is a constant that could be folded, no trivial
//! identity is left, commuting operands stand in one order.
//! Values change by rounding only, and no rule widens the domain of an energy: what is not a number
//! somewhere stays so. `x/x`, `0*x` and `x - x` therefore stay, unless `x` is proven finite (and
//! nonzero): inputs are finite, the reference measures and the horizon are also > 0.
//! [`RULES`] lists the identities; a test of the same name shows each at work.

use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;

/// An identity that the constructors apply.
#[derive(Clone, Copy, Debug)]
pub struct Rule {
    /// Its name, also that of its test.
    pub name: &'static str,
    /// What is replaced by what.
    pub identity: &'static str,
    /// Where it holds.
    pub condition: &'static str,
}

pub(crate) const fn rule(
    name: &'static str,
    identity: &'static str,
    condition: &'static str,
) -> Rule {
    Rule { name, identity, condition }
}

/// Every identity in use.
pub const RULES: &[Rule] = &[
    rule("fold_constants", "f(1, 2) = its value", "always"),
    rule("add_zero", "x + 0 = x", "always"),
    rule("subtract_zero", "x - 0 = x", "always"),
    rule("subtract_from_zero", "0 - x = -x", "always"),
    rule("add_negated", "x + (-y) = x - y", "always"),
    rule("subtract_negated", "x - (-y) = x + y", "always"),
    rule("subtract_own_term", "(c + x) - c = x", "c is a number"),
    rule("subtract_self", "x - x = 0", "x is an input"),
    rule("negate_negated", "-(-x) = x", "always"),
    rule("multiply_one", "1*x = x", "always"),
    rule("multiply_minus_one", "-1*x = -x", "always"),
    rule("multiply_zero", "0*x = 0", "x is an input"),
    rule("multiply_negated", "(-x)*y = -(x*y)", "always"),
    rule(
        "multiply_constants",
        "b*(c*x) = (b*c)*x, b*(c*x/y) = (b*c)*x/y",
        "b or c is a power of two",
    ),
    rule("multiply_reciprocal", "x*(1/y) = x/y", "always"),
    rule("divide_one", "x/1 = x", "always"),
    rule("divide_zero", "0/x = 0", "x is a reference measure or the horizon"),
    rule("divide_self", "x/x = 1", "x is a reference measure or the horizon"),
    rule("divide_negated", "(-x)/y = -(x/y)", "always"),
    rule("cancel_reference", "(x*L)*(y/L) = x*y", "L is a reference measure"),
    rule("divide_by_reference", "(x*L)/L = x", "L is a reference measure"),
    rule("divide_by_quotient", "1/(L/x) = x/L", "L is a reference measure"),
    rule("divide_power_of_two", "x/c = (1/c)*x", "c is a power of two: both are exact"),
    rule(
        "hyperbolic_quotient",
        "sinh(x)/cosh(x) = tanh(x), cosh(x)/sinh(x) = 1/tanh(x)",
        "always; both overflow before their quotient does",
    ),
    rule("divide_own_factor", "(c*x)/c = x", "c is a number, finite and not 0"),
    rule(
        "reference_last",
        "(x/L)*y = (x*y)/L, (x/L)/y = (x/y)/L",
        "L is a reference measure, x not l",
    ),
    rule("change_of_measure", "l - L = L*e, e the relative change", "always"),
    rule("change_of_stretch", "l/L - 1 = e, e the relative change", "always"),
    rule("constant_exponent", "x^y is a power with a constant exponent", "y is a number"),
    rule("power_one", "x^1 = x", "always"),
    rule("select_known", "if true then x else y = x", "always"),
    rule("select_same", "if c then x else x = x", "always"),
    rule("truth_known", "true and c = c, false or c = c, not not c = c", "always"),
];

/// A graph under construction, simplified as it grows.
#[derive(Clone, Debug, Default)]
pub struct Simplifier {
    graph: ExprGraph,
    /// Whether numbers that rounding would change stay apart.
    exact: bool,
}

type Made = Result<NodeId, TooManyNodes>;

impl Simplifier {
    /// An empty graph.
    pub fn new() -> Simplifier {
        Simplifier::default()
    }

    /// An empty graph in which `1/3` and `exp(1)` stay what they are: operations on numbers are worked
    /// out only where that is exact.
    pub(crate) fn exact() -> Simplifier {
        Simplifier { exact: true, ..Simplifier::default() }
    }

    /// The graph so far.
    pub fn graph(&self) -> &ExprGraph {
        &self.graph
    }

    /// A number.
    pub fn number(&mut self, value: f64) -> Made {
        self.graph.intern(Node::number(value))
    }

    /// An input.
    pub fn input(&mut self, input: Input) -> Made {
        self.graph.intern(Node::Input(input))
    }

    /// The simplified form of an operation on simplified operands.
    pub fn make(&mut self, node: Node) -> Made {
        match node {
            Node::Number(_) | Node::Truth(_) | Node::Input(_) => self.graph.intern(node),
            Node::Unary(Function::Negate, x) => self.negate(x),
            Node::Unary(function, x) => self.unary(function, x),
            Node::PowerConstant(x, bits) => self.power(x, f64::from_bits(bits)),
            Node::Binary(operator, x, y) => self.binary(operator, x, y),
            Node::Strain(..) => self.graph.intern(node),
            Node::Compare(_, x, y) if self.numbers(x, y).is_some() => self.fold(node),
            Node::Compare(..) => self.graph.intern(node),
            Node::And(x, y) => self.junction(node, x, y, true),
            Node::Or(x, y) => self.junction(node, x, y, false),
            Node::Not(x) => match self.graph[x] {
                Node::Truth(holds) => self.graph.intern(Node::Truth(!holds)),
                Node::Not(inner) => Ok(inner),
                _ => self.graph.intern(node),
            },
            Node::Select(c, x, y) => match self.graph[c] {
                Node::Truth(true) => Ok(x),
                Node::Truth(false) => Ok(y),
                _ if x == y => Ok(x),
                _ => self.graph.intern(node),
            },
        }
    }

    /// An operator on simplified operands.
    pub fn binary(&mut self, operator: Operator, x: NodeId, y: NodeId) -> Made {
        if let Some((a, b)) = self.numbers(x, y)
            && self.folds(operator, a, b)
        {
            return self.fold(Node::Binary(operator, x, y));
        }
        match operator {
            Operator::Add => self.add(x, y),
            Operator::Subtract => self.subtract(x, y),
            Operator::Multiply => self.multiply(x, y),
            Operator::Divide => self.divide(x, y),
            Operator::Power => match self.graph.as_number(y) {
                Some(c) => self.power(x, c),
                None => self.graph.intern(Node::Binary(operator, x, y)),
            },
            Operator::Atan2 => self.graph.intern(Node::Binary(operator, x, y)),
            Operator::Min | Operator::Max => self.ordered(operator, x, y),
        }
    }

    /// `x + y`
    pub fn add(&mut self, x: NodeId, y: NodeId) -> Made {
        if let Some((a, b)) = self.numbers(x, y)
            && self.folds(Operator::Add, a, b)
        {
            return self.number(a + b);
        }
        match (self.graph[x], self.graph[y]) {
            _ if self.is(x, 0.0) => Ok(y),
            _ if self.is(y, 0.0) => Ok(x),
            (_, Node::Unary(Function::Negate, b)) => self.subtract(x, b),
            (Node::Unary(Function::Negate, a), _) => self.subtract(y, a),
            // l/L + (-1) is how a sum may hide l/L - 1.
            _ if self.is(x, -1.0) => self.stretch_change(y).unwrap_or(self.sum(x, y)),
            _ if self.is(y, -1.0) => self.stretch_change(x).unwrap_or(self.sum(x, y)),
            _ => self.sum(x, y),
        }
    }

    /// `x - y`
    pub fn subtract(&mut self, x: NodeId, y: NodeId) -> Made {
        if let Some((a, b)) = self.numbers(x, y)
            && self.folds(Operator::Subtract, a, b)
        {
            return self.number(a - b);
        }
        match (self.graph[x], self.graph[y]) {
            _ if self.is(y, 0.0) => Ok(x),
            _ if self.is(x, 0.0) => self.negate(y),
            (Node::Input(_), _) if x == y => self.number(0.0),
            (Node::Binary(Operator::Add, c, rest), Node::Number(_)) if c == y => Ok(rest),
            (_, Node::Unary(Function::Negate, b)) => self.add(x, b),
            (Node::Input(Input::Current(m)), Node::Input(Input::Reference(n))) if m == n => {
                self.change_of_measure(m, y)
            }
            (Node::Input(Input::Reference(m)), Node::Input(Input::Current(n))) if m == n => {
                let change = self.change_of_measure(m, x)?;
                self.negate(change)
            }
            _ => {
                let change = if self.is(y, 1.0) {
                    self.stretch_change(x)
                } else if self.is(x, 1.0) {
                    match self.stretch_change(y) {
                        Some(e) => Some(self.negate(e?)),
                        None => None,
                    }
                } else {
                    None
                };
                change.unwrap_or(self.graph.intern(Node::Binary(Operator::Subtract, x, y)))
            }
        }
    }

    /// `-x`
    pub fn negate(&mut self, x: NodeId) -> Made {
        match self.graph[x] {
            Node::Number(bits) => self.number(-f64::from_bits(bits)),
            Node::Unary(Function::Negate, inner) => Ok(inner),
            _ => self.graph.intern(Node::Unary(Function::Negate, x)),
        }
    }

    /// `x * y`
    pub fn multiply(&mut self, x: NodeId, y: NodeId) -> Made {
        if let Some((a, b)) = self.numbers(x, y)
            && self.folds(Operator::Multiply, a, b)
        {
            return self.number(a * b);
        }
        // A number stands first.
        let (x, y) = if self.graph.as_number(y).is_some() { (y, x) } else { (x, y) };
        match (self.graph[x], self.graph[y]) {
            _ if self.is(x, 1.0) => return Ok(y),
            _ if self.is(x, -1.0) => return self.negate(y),
            (Node::Number(_), Node::Input(_)) if self.is(x, 0.0) => return Ok(x),
            (_, Node::Unary(Function::Negate, b)) => {
                let product = self.multiply(x, b)?;
                return self.negate(product);
            }
            (Node::Unary(Function::Negate, a), _) => {
                let product = self.multiply(a, y)?;
                return self.negate(product);
            }
            (_, Node::Binary(Operator::Divide, one, b)) if self.is(one, 1.0) => {
                return self.divide(x, b);
            }
            (Node::Binary(Operator::Divide, one, a), _) if self.is(one, 1.0) => {
                return self.divide(y, a);
            }
            _ => {}
        }
        if let Some(product) = self.gathered_constants(x, y) {
            return product;
        }
        if let Some(c) = self.graph.as_number(x)
            && let Node::Binary(Operator::Divide, numerator, denominator) = self.graph[y]
            && let Some((b, _)) = self.leading_number(numerator)
            && (is_moderate_power_of_two(b) || is_moderate_power_of_two(c))
        {
            let product = self.multiply(x, numerator)?;
            return self.divide(product, denominator);
        }
        if let Some(product) = self.cancelled_reference(x, y) {
            return product;
        }
        if let Some(product) = self.cancelled_reference(y, x) {
            return product;
        }
        for (quotient, other) in [(x, y), (y, x)] {
            if let Some((numerator, reference)) = self.over_reference(quotient) {
                let product = self.multiply(numerator, other)?;
                return self.divide(product, reference);
            }
        }
        self.ordered(Operator::Multiply, x, y)
    }

    /// `x / y`
    pub fn divide(&mut self, x: NodeId, y: NodeId) -> Made {
        if let Some((a, b)) = self.numbers(x, y)
            && self.folds(Operator::Divide, a, b)
        {
            return self.number(a / b);
        }
        if self.is(y, 1.0) {
            return Ok(x);
        }
        match (self.graph[x], self.graph[y]) {
            (Node::Unary(Function::Negate, a), _) => {
                let quotient = self.divide(a, y)?;
                self.negate(quotient)
            }
            (_, Node::Unary(Function::Negate, b)) => {
                let quotient = self.divide(x, b)?;
                self.negate(quotient)
            }
            (Node::Unary(Function::Sinh, a), Node::Unary(Function::Cosh, b)) if a == b => {
                self.unary(Function::Tanh, a)
            }
            (Node::Unary(Function::Cosh, a), Node::Unary(Function::Sinh, b)) if a == b => {
                let tangent = self.unary(Function::Tanh, a)?;
                let one = self.number(1.0)?;
                self.divide(one, tangent)
            }
            (_, Node::Binary(Operator::Divide, reference, m))
                if self.is(x, 1.0) && self.is_reference(reference) =>
            {
                self.divide(m, reference)
            }
            _ if self.is_positive(y) && self.is(x, 0.0) => Ok(x),
            _ if self.is_positive(y) && x == y => self.number(1.0),
            (_, Node::Number(bits)) if is_moderate_power_of_two(f64::from_bits(bits)) => {
                let factor = self.number(1.0 / f64::from_bits(bits))?;
                self.multiply(factor, x)
            }
            (Node::Binary(Operator::Multiply, c, rest), Node::Number(bits))
                if c == y && f64::from_bits(bits).is_normal() =>
            {
                Ok(rest)
            }
            _ => {
                if !self.is_reference(y)
                    && let Some((numerator, reference)) = self.over_reference(x)
                {
                    let quotient = self.divide(numerator, y)?;
                    return self.divide(quotient, reference);
                }
                if self.is_reference(y)
                    && let Some(rest) = self.without_factor(x, y)
                {
                    return rest;
                }
                self.graph.intern(Node::Binary(Operator::Divide, x, y))
            }
        }
    }

    /// `x^c`
    pub fn power(&mut self, x: NodeId, exponent: f64) -> Made {
        if let Some(value) = self.graph.as_number(x).filter(|_| !self.exact) {
            return self.number(f64::power_constant(value, exponent));
        }
        if exponent == 1.0 {
            return Ok(x);
        }
        self.graph.intern(Node::PowerConstant(x, exponent.to_bits()))
    }

    /// A named function.
    pub fn unary(&mut self, function: Function, x: NodeId) -> Made {
        match self.graph.as_number(x) {
            Some(value) if !self.exact => self.number(f64::unary(function, value)),
            _ => self.graph.intern(Node::Unary(function, x)),
        }
    }

    fn junction(&mut self, node: Node, x: NodeId, y: NodeId, neutral: bool) -> Made {
        match (self.graph[x], self.graph[y]) {
            (Node::Truth(t), _) => Ok(if t == neutral { y } else { x }),
            (_, Node::Truth(t)) => Ok(if t == neutral { x } else { y }),
            _ if x == y => Ok(x),
            _ => self.graph.intern(node),
        }
    }

    fn sum(&mut self, x: NodeId, y: NodeId) -> Made {
        self.ordered(Operator::Add, x, y)
    }

    /// Interns an operator that commutes with its operands in one order, numbers first.
    fn ordered(&mut self, operator: Operator, x: NodeId, y: NodeId) -> Made {
        debug_assert!(operator.commutes());
        let key = |id| (self.graph.as_number(id).is_none(), id);
        let (x, y) = if key(x) <= key(y) { (x, y) } else { (y, x) };
        self.graph.intern(Node::Binary(operator, x, y))
    }

    fn fold(&mut self, node: Node) -> Made {
        // The operands are numbers: evaluate the one operation as the interpreter does.
        let mut small = ExprGraph::new();
        let moved: Vec<NodeId> =
            node.operands().map(|x| small.intern(self.graph[x])).collect::<Result<_, _>>()?;
        let mut rest = moved.iter().copied();
        let root = small.intern(node.map_operands(|_| rest.next().expect("one per operand")))?;
        let mut interpreter = Interpreter::<f64>::new();
        interpreter.run(&small, |_| f64::NAN);
        if matches!(node, Node::Compare(..)) {
            self.graph.intern(Node::Truth(interpreter.truth(root)))
        } else {
            self.number(interpreter.number(root))
        }
    }

    fn numbers(&self, x: NodeId, y: NodeId) -> Option<(f64, f64)> {
        Some((self.graph.as_number(x)?, self.graph.as_number(y)?))
    }

    /// Whether an operation on these numbers is worked out.
    fn folds(&self, operator: Operator, a: f64, b: f64) -> bool {
        !self.exact || is_exact(operator, a, b)
    }

    fn is(&self, x: NodeId, value: f64) -> bool {
        self.graph.as_number(x) == Some(value)
    }

    fn is_reference(&self, x: NodeId) -> bool {
        matches!(self.graph[x], Node::Input(Input::Reference(_) | Input::PartAtRest(_)))
    }

    fn is_positive(&self, x: NodeId) -> bool {
        matches!(
            self.graph[x],
            Node::Input(Input::Reference(_) | Input::PartAtRest(_) | Input::Horizon)
        )
    }

    /// `l - L = L*e`
    fn change_of_measure(&mut self, measure: Measure, reference: NodeId) -> Made {
        let change = self.input(Input::Change(measure))?;
        self.multiply(reference, change)
    }

    /// `e` if this is `l/L`, from which 1 is to be subtracted.
    fn stretch_change(&mut self, stretch: NodeId) -> Option<Made> {
        let Node::Binary(Operator::Divide, x, y) = self.graph[stretch] else { return None };
        match (self.graph[x], self.graph[y]) {
            (Node::Input(Input::Current(m)), Node::Input(Input::Reference(n))) if m == n => {
                Some(self.input(Input::Change(m)))
            }
            _ => None,
        }
    }

    /// `b*(c*x)` and `(b*x)*(c*y)` where one of the numbers only moves the exponent, so that the
    /// product of the numbers is exact.
    fn gathered_constants(&mut self, x: NodeId, y: NodeId) -> Option<Made> {
        let (b, x_rest) = self.leading_number(x)?;
        let (c, y_rest) = self.leading_number(y)?;
        if !(is_moderate_power_of_two(b) || is_moderate_power_of_two(c)) {
            return None;
        }
        let product = match (x_rest, y_rest) {
            (Some(x), Some(y)) => self.multiply(x, y),
            (Some(only), None) | (None, Some(only)) => Ok(only),
            (None, None) => return None,
        };
        Some(product.and_then(|product| {
            let factor = self.number(b * c)?;
            self.multiply(factor, product)
        }))
    }

    fn leading_number(&self, x: NodeId) -> Option<(f64, Option<NodeId>)> {
        match self.graph[x] {
            Node::Number(bits) => Some((f64::from_bits(bits), None)),
            Node::Binary(Operator::Multiply, c, rest) => {
                self.graph.as_number(c).map(|c| (c, Some(rest)))
            }
            _ => None,
        }
    }

    /// `x*(y/L)` where `L` is a factor of `x`.
    fn cancelled_reference(&mut self, x: NodeId, y: NodeId) -> Option<Made> {
        let Node::Binary(Operator::Divide, numerator, reference) = self.graph[y] else {
            return None;
        };
        if !self.is_reference(reference) {
            return None;
        }
        let rest = self.without_factor(x, reference)?;
        Some(rest.and_then(|rest| self.multiply(rest, numerator)))
    }

    /// `x` and `L` of a quotient `x/L`, unless it is the stretch `l/L` itself.
    fn over_reference(&self, quotient: NodeId) -> Option<(NodeId, NodeId)> {
        let Node::Binary(Operator::Divide, numerator, reference) = self.graph[quotient] else {
            return None;
        };
        let stretch = matches!(self.graph[numerator], Node::Input(Input::Current(_)));
        (self.is_reference(reference) && !stretch).then_some((numerator, reference))
    }

    /// What remains of a product without one factor; looks two products deep.
    fn without_factor(&mut self, product: NodeId, factor: NodeId) -> Option<Made> {
        let mut path = Vec::new();
        let mut rest = product;
        for _ in 0..3 {
            if rest == factor {
                let one = self.number(1.0);
                return Some(self.rejoined(one, &path));
            }
            let Node::Binary(Operator::Multiply, x, y) = self.graph[rest] else { return None };
            if y == factor {
                return Some(self.rejoined(Ok(x), &path));
            }
            if x == factor {
                return Some(self.rejoined(Ok(y), &path));
            }
            let inner = if matches!(self.graph[x], Node::Binary(Operator::Multiply, ..)) {
                path.push(y);
                x
            } else {
                path.push(x);
                y
            };
            rest = inner;
        }
        None
    }

    fn rejoined(&mut self, rest: Made, factors: &[NodeId]) -> Made {
        factors.iter().rev().try_fold(rest?, |product, &factor| self.multiply(product, factor))
    }
}

/// Whether a product with this number is exact short of overflow and underflow.
/// Whether an operation on numbers rounds nothing.
fn is_exact(operator: Operator, a: f64, b: f64) -> bool {
    let is_plain = |x: f64| x == 0.0 || x.is_normal();
    match operator {
        Operator::Add | Operator::Subtract => {
            let b = if operator == Operator::Add { b } else { -b };
            let sum = a + b;
            let part = sum - a;
            sum.is_finite() && (a - (sum - part)) + (b - part) == 0.0
        }
        Operator::Multiply => {
            let product = a * b;
            // Far from where the error of the product underflows.
            is_plain(product) && product.abs() > 1e-250 && libm::fma(a, b, -product) == 0.0
                || (a == 0.0 || b == 0.0) && product == 0.0
        }
        Operator::Divide => {
            let quotient = a / b;
            quotient.is_normal() && a.abs() > 1e-250 && libm::fma(quotient, b, -a) == 0.0
        }
        Operator::Min | Operator::Max => true,
        Operator::Power | Operator::Atan2 => false,
    }
}

fn is_moderate_power_of_two(c: f64) -> bool {
    let mantissa = c.to_bits() & ((1 << 52) - 1);
    mantissa == 0 && (1e-30..=1e30).contains(&c.abs())
}

#[cfg(test)]
mod tests;
