//! Which parts of an energy are `f * L^r * x^p * S^k`: numbers, powers of the stretch and of a strain.
//!
//! The rules on differences and the derivative of a strain need only these exponents.

use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;
use crate::simplify::Simplifier;

/// What a power is a power of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Base {
    /// The stretch `l/L`.
    Stretch,
    /// `exp` of this node.
    Exponential(NodeId),
}

/// `factor * L^reference * base^exponent * S_order^times`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Monomial {
    /// A number, finite and not 0.
    pub(crate) factor: f64,
    /// Exponent of the reference measure.
    pub(crate) reference: f64,
    /// Nothing where the exponent is 0.
    pub(crate) base: Option<Base>,
    /// Exponent of the base.
    pub(crate) exponent: f64,
    /// Order and exponent of a strain `S_n = ((l/L)^n - 1)/n`.
    pub(crate) strain: Option<(f64, f64)>,
}

impl Monomial {
    /// A number.
    pub(crate) fn number(factor: f64) -> Option<Monomial> {
        let usable = factor.is_finite() && factor != 0.0;
        usable.then_some(Monomial {
            factor,
            reference: 0.0,
            base: None,
            exponent: 0.0,
            strain: None,
        })
    }

    fn times(self, other: Monomial) -> Option<Monomial> {
        let base = match (self.base, other.base) {
            (Some(x), Some(y)) if x != y => return None,
            (x, y) => x.or(y),
        };
        let strain = match (self.strain, other.strain) {
            (Some((a, k)), Some((b, m))) if a == b => Some((a, k + m)),
            (Some(_), Some(_)) => return None,
            (x, y) => x.or(y),
        };
        let exponent = self.exponent + other.exponent;
        let product = Monomial {
            reference: self.reference + other.reference,
            base: base.filter(|_| exponent != 0.0),
            exponent,
            strain,
            ..Monomial::number(self.factor * other.factor)?
        };
        Some(product)
    }

    /// `x^c` where it has the domain of the factors' powers.
    fn power(self, c: f64) -> Option<Monomial> {
        let whole = c == c.trunc() && c.abs() <= 64.0;
        let plain = self.exponent == 0.0 || self.exponent == 1.0;
        let exponential = matches!(self.base, Some(Base::Exponential(_)));
        if !whole && !((plain || exponential) && self.factor > 0.0 && self.strain.is_none()) {
            return None;
        }
        if self.strain.is_some() && c < 1.0 {
            return None;
        }
        let exponent = self.exponent * c;
        let power = Monomial {
            reference: self.reference * c,
            base: self.base.filter(|_| exponent != 0.0),
            exponent,
            strain: self.strain.map(|(order, times)| (order, times * c)),
            ..Monomial::number(libm::pow(self.factor, c))?
        };
        Some(power)
    }

    /// Whether another one has the same powers of `L` and no other base, so that their difference
    /// is a difference of powers; neither may hold a strain.
    pub(crate) fn comparable(&self, other: &Monomial) -> bool {
        let bases = match (self.base, other.base) {
            (Some(x), Some(y)) => x == y,
            _ => true,
        };
        bases
            && self.reference == other.reference
            && self.strain.is_none()
            && other.strain.is_none()
    }

    /// Its node.
    pub(crate) fn node(
        &self,
        graph: &mut Simplifier,
        measure: Measure,
    ) -> Result<NodeId, TooManyNodes> {
        let reference = graph.input(Input::Reference(measure))?;
        let mut product = graph.number(self.factor)?;
        if self.reference > 0.0 {
            let power = graph.power(reference, self.reference)?;
            product = graph.multiply(product, power)?;
        }
        if let Some(base) = self.base {
            let power = match base {
                Base::Stretch => {
                    let stretch = stretch(graph, measure)?;
                    graph.power(stretch, self.exponent)?
                }
                Base::Exponential(x) => {
                    let exponent = graph.number(self.exponent)?;
                    let argument = graph.multiply(exponent, x)?;
                    graph.unary(Function::Exp, argument)?
                }
            };
            product = graph.multiply(product, power)?;
        }
        if let Some((order, times)) = self.strain.filter(|(_, times)| *times != 0.0) {
            let strain = strain(graph, measure, order)?;
            let power = graph.power(strain, times)?;
            product = graph.multiply(product, power)?;
        }
        if self.reference < 0.0 {
            // Twice `/L` has a wider range than once `/L^2`.
            let whole = self.reference == self.reference.trunc() && self.reference >= -4.0;
            let (divisor, times) = if whole {
                (reference, -self.reference as usize)
            } else {
                (graph.power(reference, -self.reference)?, 1)
            };
            for _ in 0..times {
                product = graph.divide(product, divisor)?;
            }
        }
        Ok(product)
    }
}

/// `l/L`
pub(crate) fn stretch(graph: &mut Simplifier, measure: Measure) -> Result<NodeId, TooManyNodes> {
    let current = graph.input(Input::Current(measure))?;
    let reference = graph.input(Input::Reference(measure))?;
    graph.divide(current, reference)
}

/// The strain `S_n` of the stretch; for `n = 1` it is the relative change itself.
pub(crate) fn strain(
    graph: &mut Simplifier,
    measure: Measure,
    order: f64,
) -> Result<NodeId, TooManyNodes> {
    if order == 1.0 {
        return graph.input(Input::Change(measure));
    }
    let stretch = stretch(graph, measure)?;
    graph.make(Node::Strain(stretch, order.to_bits()))
}

/// The monomials of a graph that grows.
#[derive(Debug)]
pub(crate) struct Monomials {
    measure: Measure,
    known: Vec<Option<Monomial>>,
}

impl Monomials {
    /// Nothing is known yet.
    pub(crate) fn new(measure: Measure) -> Monomials {
        Monomials { measure, known: Vec::new() }
    }

    /// The monomial a node is, if it is one.
    pub(crate) fn of(&mut self, graph: &ExprGraph, id: NodeId) -> Option<Monomial> {
        while self.known.len() <= id.0 as usize {
            let next = NodeId(self.known.len() as u32);
            let monomial = self.read(graph, graph[next]);
            self.known.push(monomial);
        }
        self.known[id.0 as usize]
    }

    fn read(&self, graph: &ExprGraph, node: Node) -> Option<Monomial> {
        let of = |x: NodeId| self.known[x.0 as usize];
        let one = Monomial::number(1.0)?;
        match node {
            Node::Number(bits) => Monomial::number(f64::from_bits(bits)),
            Node::Input(Input::Current(m)) if m == self.measure => {
                let base = Some(Base::Stretch);
                Some(Monomial { reference: 1.0, base, exponent: 1.0, ..one })
            }
            Node::Input(Input::Reference(m)) if m == self.measure => {
                Some(Monomial { reference: 1.0, ..one })
            }
            Node::Input(Input::Change(m)) if m == self.measure => {
                Some(Monomial { strain: Some((1.0, 1.0)), ..one })
            }
            Node::Strain(_, order) => {
                Some(Monomial { strain: Some((f64::from_bits(order), 1.0)), ..one })
            }
            Node::Unary(Function::Negate, x) => of(x).map(|x| Monomial { factor: -x.factor, ..x }),
            Node::Unary(Function::Exp, x) => {
                let (factor, rest) = split(graph, x);
                let base = Some(Base::Exponential(rest));
                Some(Monomial { base, exponent: factor, ..one })
            }
            Node::Unary(Function::Sqrt, x) => of(x)?.power(0.5),
            Node::PowerConstant(x, c) => of(x)?.power(f64::from_bits(c)),
            Node::Binary(Operator::Multiply, x, y) => of(x)?.times(of(y)?),
            Node::Binary(Operator::Divide, x, y) => of(x)?.times(of(y)?.power(-1.0)?),
            _ => None,
        }
    }
}

/// `c*x` as `c` and `x`.
fn split(graph: &ExprGraph, id: NodeId) -> (f64, NodeId) {
    match graph[id] {
        Node::Unary(Function::Negate, x) => {
            let (factor, rest) = split_product(graph, x);
            (-factor, rest)
        }
        _ => split_product(graph, id),
    }
}

fn split_product(graph: &ExprGraph, id: NodeId) -> (f64, NodeId) {
    match graph[id] {
        Node::Binary(Operator::Multiply, c, x) => match graph.as_number(c) {
            Some(factor) if factor.is_finite() && factor != 0.0 => (factor, x),
            _ => (1.0, id),
        },
        _ => (1.0, id),
    }
}
