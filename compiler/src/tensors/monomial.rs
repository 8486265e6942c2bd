//! Numbers as sums of products of powers: how a formula is set, whatever the order of its operations.

use crate::expression::{ExprGraph, Function, Node, NodeId, Operator, TooManyNodes};
use crate::simplify::Simplifier;

/// Largest denominator of a fraction that a number is recognised as.
const LARGEST_DENOMINATOR: u32 = 12;

/// A number over another, both whole where that is so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ratio {
    pub(crate) numerator: f64,
    pub(crate) denominator: f64,
}

impl Ratio {
    pub(crate) const ONE: Ratio = Ratio { numerator: 1.0, denominator: 1.0 };

    /// `0.6666666666666666` as 2/3; a number with few decimals as it is.
    pub(crate) fn of(value: f64) -> Ratio {
        let whole = Ratio { numerator: value, denominator: 1.0 };
        if value.fract() == 0.0 || !value.is_finite() {
            return whole;
        }
        let near = |q: &f64| {
            let p = (value * q).round();
            p != 0.0 && (p / q - value).abs() <= 4.0 * f64::EPSILON * value.abs()
        };
        let tenths = |q: &f64| q % 5.0 != 0.0;
        let denominator = (2..=LARGEST_DENOMINATOR).map(f64::from).filter(tenths).find(near);
        match denominator {
            Some(q) => Ratio { numerator: (value * q).round(), denominator: q },
            None => whole,
        }
    }

    fn reduced(self) -> Ratio {
        let whole = |x: f64| x.fract() == 0.0 && x.abs() < 9e15;
        let Ratio { numerator, denominator } = self;
        if !whole(numerator) || !whole(denominator) || denominator == 0.0 {
            return self;
        }
        let (mut x, mut y) = (numerator.abs(), denominator.abs());
        while y != 0.0 {
            (x, y) = (y, x % y);
        }
        let by = x.max(1.0).copysign(denominator);
        Ratio { numerator: numerator / by, denominator: denominator / by }
    }

    fn times(self, other: Ratio) -> Ratio {
        let numerator = self.numerator * other.numerator;
        Ratio { numerator, denominator: self.denominator * other.denominator }.reduced()
    }

    fn inverse(self) -> Ratio {
        Ratio { numerator: self.denominator, denominator: self.numerator }.reduced()
    }

    fn plus(self, other: Ratio) -> Ratio {
        let numerator = self.numerator * other.denominator + other.numerator * self.denominator;
        Ratio { numerator, denominator: self.denominator * other.denominator }.reduced()
    }

    fn node(self, graph: &mut Simplifier) -> Result<NodeId, TooManyNodes> {
        graph.number(self.numerator / self.denominator)
    }

    pub(crate) fn is_zero(self) -> bool {
        self.numerator == 0.0
    }

    pub(crate) fn is_whole(self) -> bool {
        self.denominator == 1.0 && self.numerator.fract() == 0.0
    }
}

/// A number plus a multiple of something that has no value yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Exponent {
    pub(crate) number: Ratio,
    pub(crate) symbol: Option<(Ratio, NodeId)>,
}

impl Exponent {
    pub(crate) const ONE: Exponent = Exponent { number: Ratio::ONE, symbol: None };

    fn of(graph: &ExprGraph, node: NodeId) -> Exponent {
        let itself = Exponent { number: Ratio::of(0.0), symbol: Some((Ratio::ONE, node)) };
        let number = |x| graph.as_number(x).map(Ratio::of);
        match graph[node] {
            Node::Number(bits) => {
                Exponent { number: Ratio::of(f64::from_bits(bits)), symbol: None }
            }
            Node::Unary(Function::Negate, x) => Exponent::of(graph, x).times(Ratio::of(-1.0)),
            Node::Binary(Operator::Multiply, x, y) => match (number(x), number(y)) {
                (Some(c), _) => Exponent::of(graph, y).times(c),
                (_, Some(c)) => Exponent::of(graph, x).times(c),
                _ => itself,
            },
            Node::Binary(Operator::Divide, x, y) => match number(y) {
                Some(c) => Exponent::of(graph, x).times(c.inverse()),
                None => itself,
            },
            Node::Binary(operator @ (Operator::Add | Operator::Subtract), x, y) => {
                let sign = if operator == Operator::Add { 1.0 } else { -1.0 };
                let other = Exponent::of(graph, y).times(Ratio::of(sign));
                Exponent::of(graph, x).plus(other).unwrap_or(itself)
            }
            _ => itself,
        }
    }

    fn times(self, by: Ratio) -> Exponent {
        let symbol = self.symbol.map(|(factor, node)| (factor.times(by), node));
        Exponent { number: self.number.times(by), symbol }
    }

    /// Nothing where both hold a symbol of their own.
    fn plus(self, other: Exponent) -> Option<Exponent> {
        let symbol = match (self.symbol, other.symbol) {
            (Some((a, x)), Some((b, y))) if x == y => {
                Some((a.plus(b), x)).filter(|(factor, _)| !factor.is_zero())
            }
            (only, None) | (None, only) => only,
            _ => return None,
        };
        Some(Exponent { number: self.number.plus(other.number), symbol })
    }

    fn is_zero(self) -> bool {
        self.symbol.is_none() && self.number.is_zero()
    }
}

/// A number times powers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Monomial {
    pub(crate) coefficient: Ratio,
    pub(crate) factors: Vec<(NodeId, Exponent)>,
}

impl Monomial {
    fn number(coefficient: Ratio) -> Monomial {
        Monomial { coefficient, factors: Vec::new() }
    }

    fn times(mut self, other: &Monomial) -> Monomial {
        self.coefficient = self.coefficient.times(other.coefficient);
        for (base, exponent) in &other.factors {
            let known = self.factors.iter_mut().find_map(|(known, old)| {
                let sum = (known == base).then(|| old.plus(*exponent)).flatten()?;
                *old = sum;
                Some(())
            });
            if known.is_none() {
                self.factors.push((*base, *exponent));
            }
        }
        self.factors.retain(|(_, exponent)| !exponent.is_zero());
        self
    }

    fn inverse(mut self) -> Monomial {
        self.coefficient = self.coefficient.inverse();
        self.factors.iter_mut().for_each(|(_, e)| *e = e.times(Ratio::of(-1.0)));
        self
    }

    /// Makes a node of it.
    pub(crate) fn node(&self, graph: &mut Simplifier) -> Result<NodeId, TooManyNodes> {
        let mut product = self.coefficient.node(graph)?;
        for (base, Exponent { number, symbol }) in &self.factors {
            let mut exponent = number.node(graph)?;
            if let Some((factor, node)) = symbol {
                let factor = factor.node(graph)?;
                let part = graph.multiply(factor, *node)?;
                exponent = graph.add(part, exponent)?;
            }
            let power = graph.binary(Operator::Power, *base, exponent)?;
            product = graph.multiply(product, power)?;
        }
        Ok(product)
    }

    fn has_the_factors_of(&self, other: &Monomial) -> bool {
        self.factors.len() == other.factors.len()
            && self.factors.iter().all(|factor| other.factors.contains(factor))
    }
}

/// Reads a graph as sums of products.
pub(crate) struct Sums<'a> {
    pub(crate) graph: &'a ExprGraph,
    /// Whether a node has a name, and is not looked into.
    pub(crate) is_named: &'a dyn Fn(NodeId) -> bool,
    /// Whether powers of this node are multiplied into a sum: `J*(a/J + b) = a + b*J`.
    pub(crate) is_multiplied_out: &'a dyn Fn(NodeId) -> bool,
    /// Whether numbers are multiplied into a sum: `2*(a + b) = 2*a + 2*b`.
    pub(crate) are_numbers_multiplied_out: bool,
}

impl Sums<'_> {
    /// The terms of a node, even of one with a name.
    pub(crate) fn terms_of(&self, root: NodeId) -> Vec<Monomial> {
        let mut terms: Vec<Monomial> = Vec::new();
        for term in self.inside(root) {
            match terms.iter_mut().find(|known| known.has_the_factors_of(&term)) {
                Some(known) => known.coefficient = known.coefficient.plus(term.coefficient),
                None => terms.push(term),
            }
        }
        terms.retain(|term| !term.coefficient.is_zero());
        terms
    }

    fn terms(&self, node: NodeId) -> Vec<Monomial> {
        if (self.is_named)(node) {
            return vec![Monomial {
                coefficient: Ratio::ONE,
                factors: vec![(node, Exponent::ONE)],
            }];
        }
        self.inside(node)
    }

    fn inside(&self, node: NodeId) -> Vec<Monomial> {
        let negative = |terms: Vec<Monomial>| {
            let minus = Monomial::number(Ratio::of(-1.0));
            terms.into_iter().map(move |term| term.times(&minus))
        };
        match self.graph[node] {
            Node::Binary(Operator::Add, x, y) => [self.terms(x), self.terms(y)].concat(),
            Node::Binary(Operator::Subtract, x, y) => {
                self.terms(x).into_iter().chain(negative(self.terms(y))).collect()
            }
            Node::Unary(Function::Negate, x) => negative(self.terms(x)).collect(),
            _ => self.multiplied_out(self.product(node, true)),
        }
    }

    fn multiplied_out(&self, product: Monomial) -> Vec<Monomial> {
        let is_sum = |node: NodeId| {
            !(self.is_named)(node)
                && matches!(self.graph[node], Node::Binary(Operator::Add | Operator::Subtract, ..))
        };
        let sum = product.factors.iter().position(|(n, e)| is_sum(*n) && *e == Exponent::ONE);
        let Some(sum) = sum else { return vec![product] };
        let mut outer = product.clone();
        let (sum, _) = outer.factors.remove(sum);
        let multiplied = |(node, _): &(NodeId, Exponent)| (self.is_multiplied_out)(*node);
        let number = outer.factors.is_empty() && !self.are_numbers_multiplied_out;
        if number || !outer.factors.iter().all(multiplied) {
            return vec![product];
        }
        self.terms(sum).into_iter().map(|term| term.times(&outer)).collect()
    }

    fn product(&self, node: NodeId, is_root: bool) -> Monomial {
        let itself = || Monomial { coefficient: Ratio::ONE, factors: vec![(node, Exponent::ONE)] };
        if !is_root && (self.is_named)(node) {
            return itself();
        }
        match self.graph[node] {
            Node::Number(bits) => Monomial::number(Ratio::of(f64::from_bits(bits))),
            Node::Unary(Function::Negate, x) => {
                self.product(x, false).times(&Monomial::number(Ratio::of(-1.0)))
            }
            Node::Binary(Operator::Multiply, x, y) => {
                self.product(x, false).times(&self.product(y, false))
            }
            Node::Binary(Operator::Divide, x, y) => {
                self.product(x, false).times(&self.product(y, false).inverse())
            }
            Node::PowerConstant(x, bits) => {
                self.power(x, Exponent { number: Ratio::of(f64::from_bits(bits)), symbol: None })
            }
            Node::Binary(Operator::Power, x, y) => self.power(x, Exponent::of(self.graph, y)),
            _ => itself(),
        }
    }

    /// A whole power of a product is one of its factors; others are of the base as it stands.
    fn power(&self, x: NodeId, exponent: Exponent) -> Monomial {
        let base = self.product(x, false);
        let itself = Monomial { coefficient: Ratio::ONE, factors: vec![(x, exponent)] };
        let n = exponent.number.numerator;
        if exponent.symbol.is_some() || !exponent.number.is_whole() || n.abs() > 8.0 {
            return itself;
        }
        let one = Monomial::number(Ratio::ONE);
        let power = (0..n.abs() as usize).fold(one, |power, _| power.times(&base));
        if n < 0.0 { power.inverse() } else { power }
    }
}
