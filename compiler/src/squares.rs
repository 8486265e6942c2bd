//! Energies that are functions of the squared measure.
//!
//! Lengths, and areas in space, are roots: their squares come from vectors without one. An energy in
//! which such a measure has even powers alone is a function of `q = m^2/M`, which is `M` at rest and
//! has the unit of `m`. So it is an energy like any other, one whose measure is `q`: it is rewritten,
//! differentiated and compiled by the same code, and its change is `(q - M)/M = m^2/M^2 - 1`.
//!
//! Before: a simplified energy as written. After: the same energy with `q` in the place of the input
//! `m`; nothing where an odd power of `m` is left.

use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;
use crate::model::Model;
use crate::rewrite::stretch;
use crate::simplify::Simplifier;
use crate::specialise::{Form, MAX_OPERATIONS, ScalarEnergy, SimpleEnergy, energy, known};
use crate::values::Values;

impl Model {
    /// The energy of a measure `m` as a function of `q = m^2/M`, with derivatives by `q`: the current
    /// input is `q`, the reference `M`, the change `(q - M)/M`. Nothing where the measure is signed,
    /// where it has an odd power, and where the energy would be too large.
    pub fn squared(&self, values: &Values, measure: Measure) -> Option<ScalarEnergy> {
        if measure.is_signed(values.dimension) {
            return None;
        }
        let variant = self.variant(values.dimension)?;
        let found = energy(variant, self.parameters(), measure, &known(values), &mut Vec::new());
        let derived = square_of(found.ok()??, values).ok()??;
        (derived.graph.len() <= MAX_OPERATIONS).then_some(derived)
    }
}

/// The same function of `q = m^2/M` with its derivatives by `q`; nothing where it has an odd power.
pub(crate) fn square_of(
    mut function: SimpleEnergy,
    values: &Values,
) -> Result<Option<ScalarEnergy>, TooManyNodes> {
    let (graph, measure) = (function.graph.graph(), function.measure);
    let Some(squared) = squared(graph, function.psi, measure)? else { return Ok(None) };
    (function.graph, function.psi) = squared;
    Ok(Some(function.of(values).derivatives(Form::Accurate)?.scalar_energy()))
}

/// `rest * m^current * M^reference`, where the rest is a function of `q` and `M`.
#[derive(Clone, Copy)]
struct Product {
    rest: NodeId,
    current: i32,
    reference: i32,
}

impl Product {
    fn plain(rest: NodeId) -> Product {
        Product { rest, current: 0, reference: 0 }
    }
}

/// The energy `psi` as a function of `q`, if it is one.
fn squared(
    source: &ExprGraph,
    psi: NodeId,
    measure: Measure,
) -> Result<Option<(Simplifier, NodeId)>, TooManyNodes> {
    let needed = source.reachable(&[psi]);
    let mut squares = Squares { measure, graph: Simplifier::exact(), products: Vec::new() };
    for (id, node) in source.nodes() {
        let product = if needed[id.0 as usize] {
            let Some(product) = squares.product(source, node)? else { return Ok(None) };
            product
        } else {
            Product::plain(NodeId(0))
        };
        squares.products.push(product);
    }
    let root = squares.node(squares.of(psi))?;
    Ok(root.map(|root| (squares.graph, root)))
}

struct Squares {
    measure: Measure,
    graph: Simplifier,
    /// What each node of the source has become.
    products: Vec<Product>,
}

/// Nothing where an odd power of the measure stands alone.
type Made<T> = Result<Option<T>, TooManyNodes>;

impl Squares {
    fn of(&self, id: NodeId) -> Product {
        self.products[id.0 as usize]
    }

    fn product(&mut self, source: &ExprGraph, node: Node) -> Made<Product> {
        match node {
            Node::Input(Input::Current(m)) if m == self.measure => {
                let rest = self.graph.number(1.0)?;
                Ok(Some(Product { rest, current: 1, reference: 0 }))
            }
            Node::Input(Input::Reference(m)) if m == self.measure => {
                let rest = self.graph.number(1.0)?;
                Ok(Some(Product { rest, current: 0, reference: 1 }))
            }
            // At rest `q = M` holds to rounding only, and must not decide.
            Node::Compare(_, x, y) | Node::Binary(Operator::Min | Operator::Max, x, y)
                if source.depends_on(&[x, y], Input::Current(self.measure)) =>
            {
                Ok(None)
            }
            // `(m - M)/M` is linear in `m`.
            Node::Input(Input::Change(_)) | Node::Strain(..) => Ok(None),
            Node::Unary(Function::Negate, x) => {
                let x = self.of(x);
                Ok(Some(Product { rest: self.graph.negate(x.rest)?, ..x }))
            }
            Node::PowerConstant(x, bits) => self.power(self.of(x), f64::from_bits(bits)),
            Node::Binary(operator @ (Operator::Add | Operator::Subtract), x, y) => {
                self.sum(operator, self.of(x), self.of(y))
            }
            Node::Binary(operator @ (Operator::Multiply | Operator::Divide), x, y) => {
                self.joined(operator, self.of(x), self.of(y))
            }
            _ => {
                let mut operands = Vec::new();
                for operand in node.operands() {
                    let Some(made) = self.node(self.of(operand))? else { return Ok(None) };
                    operands.push(made);
                }
                let mut operands = operands.into_iter();
                let node = node.map_operands(|_| operands.next().expect("one per operand"));
                Ok(Some(Product::plain(self.graph.make(node)?)))
            }
        }
    }

    /// `x^c`; for a whole `c` factor by factor.
    fn power(&mut self, x: Product, c: f64) -> Made<Product> {
        let whole = (c == c.trunc() && c.abs() <= f64::from(i16::MAX)).then_some(c as i32);
        let times = |exponent: i32| whole.and_then(|c| exponent.checked_mul(c));
        if let (Some(current), Some(reference)) = (times(x.current), times(x.reference)) {
            return Ok(Some(Product { rest: self.graph.power(x.rest, c)?, current, reference }));
        }
        let Some(x) = self.node(x)? else { return Ok(None) };
        Ok(Some(Product::plain(self.graph.power(x, c)?)))
    }

    /// `x + y` or `x - y`: a power of `M` that both have stays outside.
    fn sum(&mut self, operator: Operator, x: Product, y: Product) -> Made<Product> {
        let (Some(x), Some(y)) = (self.by_stretch(x)?, self.by_stretch(y)?) else {
            return Ok(None);
        };
        if x.reference == y.reference {
            let rest = self.graph.binary(operator, x.rest, y.rest)?;
            return Ok(Some(Product { rest, ..x }));
        }
        let (Some(x), Some(y)) = (self.node(x)?, self.node(y)?) else { return Ok(None) };
        Ok(Some(Product::plain(self.graph.binary(operator, x, y)?)))
    }

    /// `x*y` or `x/y`.
    fn joined(&mut self, operator: Operator, x: Product, y: Product) -> Made<Product> {
        let sign = if operator == Operator::Divide { -1 } else { 1 };
        let exponents = || {
            let of_y = (y.current.checked_mul(sign)?, y.reference.checked_mul(sign)?);
            // What cancels is 0/0 at m = 0, and would not be any more.
            let cancels = x.current.signum() * of_y.0.signum() < 0;
            let current = x.current.checked_add(of_y.0).filter(|_| !cancels)?;
            Some((current, x.reference.checked_add(of_y.1)?))
        };
        if let Some((current, reference)) = exponents() {
            let rest = self.graph.binary(operator, x.rest, y.rest)?;
            return Ok(Some(Product { rest, current, reference }));
        }
        let (Some(x), Some(y)) = (self.node(x)?, self.node(y)?) else { return Ok(None) };
        Ok(Some(Product::plain(self.graph.binary(operator, x, y)?)))
    }

    /// `m^i M^j = (q/M)^(i/2) M^(i + j)`: the same product with a power of the stretch in the rest.
    fn by_stretch(&mut self, Product { rest, current, reference }: Product) -> Made<Product> {
        if current == 0 {
            return Ok(Some(Product { rest, current, reference }));
        }
        let sum = current.checked_add(reference).filter(|_| current % 2 == 0);
        let Some(reference) = sum else { return Ok(None) };
        let stretch = stretch(&mut self.graph, self.measure)?;
        let power = self.graph.power(stretch, f64::from(current / 2))?;
        let rest = self.graph.multiply(rest, power)?;
        Ok(Some(Product { rest, current: 0, reference }))
    }

    /// The node of a product.
    fn node(&mut self, product: Product) -> Made<NodeId> {
        let Some(Product { rest, reference, .. }) = self.by_stretch(product)? else {
            return Ok(None);
        };
        if reference == 0 {
            return Ok(Some(rest));
        }
        let base = self.graph.input(Input::Reference(self.measure))?;
        let power = self.graph.power(base, f64::from(reference).abs())?;
        let operator = if reference > 0 { Operator::Multiply } else { Operator::Divide };
        self.graph.binary(operator, rest, power).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::print;
    use crate::test_support::{model, values};

    /// psi, psi', psi'' of `psi(l)` as functions of `q`, printed as `l`.
    fn squared(psi: &str) -> [String; 3] {
        let model = model(&format!("potential p\npsi(l) = {psi}"));
        let energy = model.squared(&values(&model, 3, &[]), Measure::Length).unwrap();
        energy.roots.map(|root| print::expression(&model, &energy.graph, root))
    }

    #[test]
    fn strains_of_order_two_are_the_change() {
        // The change `l/L - 1` is an input.
        let expected = ["L*(0.5*(0.5*(l/L - 1))^2)", "0.25*(l/L - 1)", "0.25/L"];
        assert_eq!(squared("1/2*L*(((l/L)^2 - 1)/2)^2"), expected);
        assert_eq!(squared("1/2*L*((l^2 - L^2)/(2*L^2))^2"), expected);
        assert_eq!(squared("1/2*L*((l*l - L*L)/(2*L*L))^2"), expected);
    }

    #[test]
    fn powers_have_half_their_exponents() {
        assert_eq!(squared("L*(l/L)^4")[0], "L*(l/L)^2");
        assert_eq!(squared("L^3/l^2")[0], "L*(l/L)^-1");
        assert_eq!(squared("(l^2)^1.3")[0], "(l/L*L^2)^1.3");
    }
}
