//! Functions and powers near rest: what they have beyond their tangent, by forms that keep their
//! digits.

use super::{Expander, Expansion, U};
use crate::expression::number::Number;
use crate::expression::{Comparison, Function, Node, NodeId, TooManyNodes};

/// Largest whole exponent that is worked out by products.
const LARGEST_EXPONENT: f64 = 16.0;

impl Expander<'_> {
    /// `f(x)` from `f` and `f'` at the value of `x`, and what `f` has beyond its tangent there.
    fn composed(
        &mut self,
        x: &Expansion,
        (value, derivative): (f64, f64),
        beyond: Option<NodeId>,
    ) -> Result<Expansion, TooManyNodes> {
        let slope: Vec<f64> = x.slope.iter().map(|a| derivative * a).collect();
        let straight = self.scaled(x.rest, derivative)?;
        let rest = self.sum(straight, beyond)?;
        let noise = derivative.abs() * (x.noise + 2.0 * U * x.steepest()) + 2.0 * U * value.abs();
        Ok(Expansion { value, slope, rest, noise })
    }

    pub(super) fn unary(
        &mut self,
        id: NodeId,
        function: Function,
        x: NodeId,
    ) -> Result<Expansion, TooManyNodes> {
        let p = self.number(x);
        let c = p.value;
        let Some(change) = self.change(&p)? else {
            return Ok(self.of_constant(id, &p, |x| f64::unary(function, x)));
        };
        match function {
            Function::Negate => {
                let zero = Expansion::constant(0.0, self.variables.len());
                self.combination(&zero, &p, -1.0)
            }
            Function::Sqrt if c > 0.0 => self.root(&p, change),
            Function::Exp | Function::Expm1 => {
                let factor = libm::exp(c);
                let beyond = self.exponential_beyond(change)?;
                let beyond = self.scaled(Some(beyond), factor)?;
                let value = if function == Function::Exp { factor } else { libm::expm1(c) };
                self.composed(&p, (value, factor), beyond)
            }
            Function::Ln if c > 0.0 => {
                let ratio = self.divided(change, c)?;
                let beyond = self.graph.unary(Function::Log1pmx, ratio)?;
                self.composed(&p, (libm::log(c), 1.0 / c), Some(beyond))
            }
            Function::Log1p if c > -1.0 => {
                let ratio = self.divided(change, 1.0 + c)?;
                let beyond = self.graph.unary(Function::Log1pmx, ratio)?;
                self.composed(&p, (libm::log1p(c), 1.0 / (1.0 + c)), Some(beyond))
            }
            _ => self.opaque(id),
        }
    }

    /// `f` of what does not vary: the noise of its argument moves it as far as `f` moves between both
    /// ends of it, where it is a number there.
    fn of_constant(&self, id: NodeId, x: &Expansion, f: impl Fn(f64) -> f64) -> Expansion {
        let value = self.at_rest.number(id);
        let ends = [x.value - x.noise, x.value + x.noise].map(|x| (f(x) - value).abs());
        let moved = ends.into_iter().filter(|moved| moved.is_finite()).fold(0.0, f64::max);
        let noise = moved + U * value.abs();
        Expansion { noise, ..Expansion::constant(value, self.variables.len()) }
    }

    fn divided(&mut self, x: NodeId, by: f64) -> Result<NodeId, TooManyNodes> {
        let by = self.graph.number(by)?;
        self.graph.divide(x, by)
    }

    /// `exp(x) - 1 - x`: by its series where the difference would cancel.
    fn exponential_beyond(&mut self, x: NodeId) -> Result<NodeId, TooManyNodes> {
        let one = self.graph.number(1.0)?;
        let mut sum = one;
        // x^2/2*(1 + x/3*(1 + x/4*(..))): with |x| < 1/2 the terms left out are below u/8.
        for k in (3..=14).rev() {
            let term = self.divided(x, f64::from(k))?;
            let term = self.graph.multiply(term, sum)?;
            sum = self.graph.add(one, term)?;
        }
        let square = self.graph.multiply(x, x)?;
        let half = self.divided(square, 2.0)?;
        let series = self.graph.multiply(half, sum)?;
        let expm1 = self.graph.unary(Function::Expm1, x)?;
        let difference = self.graph.subtract(expm1, x)?;
        let size = self.graph.unary(Function::Abs, x)?;
        let limit = self.graph.number(0.5)?;
        let small = self.graph.make(Node::Compare(Comparison::Less, size, limit))?;
        self.graph.make(Node::Select(small, series, difference))
    }

    /// `sqrt(c + p) - sqrt(c) - p/(2 sqrt(c)) = -p^2/(2 sqrt(c) (sqrt(c + p) + sqrt(c))^2)`
    fn root(&mut self, x: &Expansion, change: NodeId) -> Result<Expansion, TooManyNodes> {
        let root = x.value.sqrt();
        let value = self.graph.number(x.value)?;
        let moved = self.graph.add(value, change)?;
        let moved = self.graph.unary(Function::Sqrt, moved)?;
        let at_rest = self.graph.number(root)?;
        let sum = self.graph.add(moved, at_rest)?;
        let ratio = self.graph.divide(change, sum)?;
        let square = self.graph.multiply(ratio, ratio)?;
        let beyond = self.scaled(Some(square), -0.5 / root)?;
        self.composed(x, (root, 0.5 / root), beyond)
    }

    /// `1/(c + p) - 1/c + p/c^2 = (p/c)^2/(c + p)`
    pub(super) fn reciprocal(&mut self, x: &Expansion) -> Result<Expansion, TooManyNodes> {
        let c = x.value;
        let Some(change) = self.change(x)? else {
            return self.composed(x, (1.0 / c, 0.0), None);
        };
        let ratio = self.divided(change, c)?;
        let square = self.graph.multiply(ratio, ratio)?;
        let value = self.graph.number(c)?;
        let moved = self.graph.add(value, change)?;
        let beyond = self.graph.divide(square, moved)?;
        self.composed(x, (1.0 / c, -1.0 / (c * c)), Some(beyond))
    }

    pub(super) fn power(
        &mut self,
        id: NodeId,
        x: NodeId,
        c: f64,
    ) -> Result<Expansion, TooManyNodes> {
        let p = self.number(x);
        let whole = c.fract() == 0.0 && c.abs() <= LARGEST_EXPONENT;
        if whole {
            let power = self.whole_power(&p, c.abs() as u32)?;
            return if c < 0.0 { self.reciprocal(&power) } else { Ok(power) };
        }
        let Some(change) = self.change(&p)? else {
            return Ok(self.of_constant(id, &p, |x| libm::pow(x, c)));
        };
        if c == 0.5 && p.value > 0.0 {
            return self.root(&p, change);
        }
        if p.value <= 0.0 {
            return self.opaque(id);
        }
        // (1 + r)^c - 1 - c*r = (exp(y) - 1 - y) + c*(ln(1 + r) - r) with y = c*ln(1 + r)
        let ratio = self.divided(change, p.value)?;
        let logarithm = self.graph.unary(Function::Log1p, ratio)?;
        let exponent = self.scaled(Some(logarithm), c)?.unwrap_or(logarithm);
        let first = self.exponential_beyond(exponent)?;
        let second = self.graph.unary(Function::Log1pmx, ratio)?;
        let second = self.scaled(Some(second), c)?;
        let both = self.sum(Some(first), second)?;
        let value = libm::pow(p.value, c);
        let beyond = self.scaled(both, value)?;
        self.composed(&p, (value, c * value / p.value), beyond)
    }

    fn whole_power(&mut self, x: &Expansion, n: u32) -> Result<Expansion, TooManyNodes> {
        let mut power = Expansion::constant(1.0, self.variables.len());
        let (mut square, mut left) = (x.clone(), n);
        while left > 0 {
            if left % 2 == 1 {
                power = self.product(&power, &square)?;
            }
            left /= 2;
            if left > 0 {
                square = self.product(&square.clone(), &square)?;
            }
        }
        Ok(power)
    }
}
