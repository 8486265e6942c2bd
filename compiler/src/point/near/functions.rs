//! Functions and powers near rest: what they have beyond their tangent, by forms that keep their
//! digits.

use super::{Expander, Expansion};
use crate::expression::{Comparison, Function, NodeId, TooManyNodes};
use crate::near::{Exact, Number, beyond};

/// Largest whole exponent that is worked out by products.
const LARGEST_EXPONENT: f64 = 16.0;

type Expanded = Result<Expansion, TooManyNodes>;

impl Expander<'_> {
    /// `f(x)` from `f` and `f'` at the value of `x`, and what `f` has beyond its tangent there.
    fn composed(
        &mut self,
        x: &Expansion,
        (value, derivative): (Exact, Exact),
        beyond: Option<NodeId>,
    ) -> Expanded {
        let slope = x.slope.iter().map(|a| derivative.times(a)).collect();
        let straight = self.scaled(x.rest, &derivative)?;
        let rest = self.sum(straight, beyond)?;
        Ok(Expansion { value, slope, rest })
    }

    pub(super) fn unary(&mut self, id: NodeId, function: Function, x: NodeId) -> Expanded {
        let p = self.number(x);
        let zero = self.constant(Exact::from(0.0));
        match function {
            Function::Negate => self.combination(&zero, &p, -1.0),
            Function::Abs => {
                let condition = self.compare(None, Comparison::GreaterEqual, &p, &zero)?;
                let negative = self.combination(&zero, &p, -1.0)?;
                self.choice(condition, &p, &negative)
            }
            _ if p.is_constant() => Ok(self.constant(p.value.function(function))),
            Function::Sign => {
                let condition = self.compare(None, Comparison::Greater, &p, &zero)?;
                let one = self.constant(Exact::from(1.0));
                let negative = self.constant(Exact::from(-1.0));
                self.choice(condition, &one, &negative)
            }
            Function::Sqrt if p.value.value.is_positive() => self.smooth(function, &p),
            Function::Sqrt | Function::Acos => self.opaque(id),
            Function::Ln if !p.value.value.is_positive() => self.opaque(id),
            _ => self.smooth(function, &p),
        }
    }

    /// A function that is smooth at the value of its argument.
    pub(super) fn smooth(&mut self, function: Function, x: &Expansion) -> Expanded {
        let one = self.constant(Exact::from(1.0));
        let c = &x.value;
        if !c.value.is_number() {
            return Ok(self.nothing());
        }
        match function {
            Function::Expm1 => {
                let exponential = self.smooth(Function::Exp, x)?;
                return self.combination(&exponential, &one, -1.0);
            }
            Function::Log1p => {
                let sum = self.combination(&one, x, 1.0)?;
                return self.smooth(Function::Ln, &sum);
            }
            Function::Log1pmx => {
                let logarithm = self.smooth(Function::Log1p, x)?;
                return self.combination(&logarithm, x, -1.0);
            }
            Function::Tan => {
                let sine = self.smooth(Function::Sin, x)?;
                let cosine = self.smooth(Function::Cos, x)?;
                let reciprocal = self.reciprocal(&cosine)?;
                return self.product(&sine, &reciprocal);
            }
            Function::Tanh | Function::Atan | Function::Asin if !c.is_nothing() => {
                return self.moved(function, x);
            }
            _ => {}
        }
        let value = c.function(function);
        let slope = slope(function, c, &value);
        let Some(change) = self.change(x)? else { return Ok(self.constant(value)) };
        let beyond = self.beyond(function, c, change)?;
        self.composed(x, (value, slope), beyond)
    }

    /// `f(c + d) - f(c) - f'(c) d`
    fn beyond(
        &mut self,
        function: Function,
        c: &Exact,
        d: NodeId,
    ) -> Result<Option<NodeId>, TooManyNodes> {
        if function == Function::Erf {
            return beyond::of_error_function(self.graph, &c.value, d, 2).map(Some);
        }
        let rest = |graph: &mut _, function, d| beyond::second_order(graph, function, d).map(Some);
        match function {
            Function::Exp => {
                let rest = rest(self.graph, function, d)?;
                self.scaled(rest, &c.function(function))
            }
            Function::Ln | Function::Sqrt => {
                let ratio = self.scaled(Some(d), &c.inverse())?.unwrap_or(d);
                let rest = rest(self.graph, function, ratio)?;
                let factor = match function {
                    Function::Ln => Exact::from(1.0),
                    _ => c.function(Function::Sqrt),
                };
                self.scaled(rest, &factor)
            }
            Function::Sin | Function::Cos | Function::Sinh | Function::Cosh => {
                let (odd, even) = match function {
                    Function::Sin | Function::Cos => (Function::Sin, Function::Cos),
                    _ => (Function::Sinh, Function::Cosh),
                };
                // sin(c + d) = sin c cos d + cos c sin d, cos(c + d) = cos c cos d - sin c sin d
                let (with_even, with_odd) = match function {
                    Function::Sin | Function::Sinh => (c.function(odd), c.function(even)),
                    Function::Cos => (c.function(even), c.function(odd).negated()),
                    _ => (c.function(even), c.function(odd)),
                };
                let mut sum = None;
                for (factor, function) in [(with_even, even), (with_odd, odd)] {
                    if !factor.is_nothing() {
                        let rest = rest(self.graph, function, d)?;
                        let term = self.scaled(rest, &factor)?;
                        sum = self.sum(sum, term)?;
                    }
                }
                Ok(sum)
            }
            _ => rest(self.graph, function, d),
        }
    }

    /// Functions whose value at rest is not that at 0, by their value there and themselves about 0.
    fn moved(&mut self, function: Function, x: &Expansion) -> Expanded {
        let one = self.constant(Exact::from(1.0));
        let c = self.constant(x.value.clone());
        let at_rest = self.constant(x.value.function(function));
        let d = self.combination(x, &c, -1.0)?;
        let (numerator, denominator) = match function {
            Function::Tanh => {
                // tanh(c + d) = t + (1 - t^2) T/(1 + t T), T = tanh(d)
                let tanh = self.smooth(Function::Tanh, &d)?;
                let square = self.product(&at_rest, &at_rest)?;
                let slope = self.combination(&one, &square, -1.0)?;
                let both = self.product(&at_rest, &tanh)?;
                (self.product(&slope, &tanh)?, self.combination(&one, &both, 1.0)?)
            }
            // atan(c + d) = atan(c) + atan(d/(1 + c x))
            Function::Atan => {
                let both = self.product(&c, x)?;
                let below = self.combination(&one, &both, 1.0)?;
                let below = self.reciprocal(&below)?;
                let inside = self.product(&d, &below)?;
                (self.smooth(Function::Atan, &inside)?, one)
            }
            // asin(c + d) = asin(c) + asin(d (x + c)/(sqrt(1 - c^2) x + c sqrt(1 - x^2)))
            _ => {
                let mut cosines = Vec::new();
                for y in [&c, x] {
                    let square = self.product(y, y)?;
                    let inside = self.combination(&one, &square, -1.0)?;
                    cosines.push(self.power(&inside, &Number::from(0.5))?);
                }
                let sum = self.combination(x, &c, 1.0)?;
                let numerator = self.product(&d, &sum)?;
                let (left, right) = (self.product(&cosines[0], x)?, self.product(&c, &cosines[1])?);
                let below = self.combination(&left, &right, 1.0)?;
                let below = self.reciprocal(&below)?;
                let inside = self.product(&numerator, &below)?;
                (self.smooth(Function::Asin, &inside)?, one)
            }
        };
        let below = self.reciprocal(&denominator)?;
        let moved = self.product(&numerator, &below)?;
        self.combination(&at_rest, &moved, 1.0)
    }

    /// The angle of the point with ordinate `y` and abscissa `x`: that at rest and what it turns by,
    /// `atan((y x_0 - x y_0)/(x x_0 + y y_0))`, up to a right angle and on this side of the cut.
    pub(super) fn angle(&mut self, id: NodeId, y: &Expansion, x: &Expansion) -> Expanded {
        let any = self.opaque(id)?;
        let (at_y, at_x) = (self.constant(y.value.clone()), self.constant(x.value.clone()));
        let (right, up) = (x.value.value.is_positive(), !y.value.is_nothing());
        if !any.value.value.is_number() || !(right || up) {
            return Ok(any);
        }
        let zero = self.constant(Exact::from(0.0));
        let (first, second) = (self.product(y, &at_x)?, self.product(x, &at_y)?);
        let turned = self.combination(&first, &second, -1.0)?;
        let (first, second) = (self.product(x, &at_x)?, self.product(y, &at_y)?);
        let along = self.combination(&first, &second, 1.0)?;
        let below = self.reciprocal(&along)?;
        let slope = self.product(&turned, &below)?;
        let turn = self.smooth(Function::Atan, &slope)?;
        let at_rest = self.constant(any.value.clone());
        let mut angle = self.combination(&at_rest, &turn, 1.0)?;
        if !right {
            let condition = self.compare(None, Comparison::Greater, &second, &zero)?;
            angle = self.choice(condition, &angle, &any)?;
        }
        let condition = self.compare(None, Comparison::Greater, &along, &zero)?;
        self.choice(condition, &angle, &any)
    }

    /// `1/(c + p) - 1/c + p/c^2 = (p/c)^2/(c + p)`
    pub(super) fn reciprocal(&mut self, x: &Expansion) -> Expanded {
        let inverse = x.value.inverse();
        let Some(change) = self.change(x)? else { return Ok(self.constant(inverse)) };
        let slope = inverse.times(&inverse).negated();
        let ratio = self.scaled(Some(change), &inverse)?.unwrap_or(change);
        let square = self.graph.multiply(ratio, ratio)?;
        let moved = self.total(x)?;
        let beyond = self.graph.divide(square, moved)?;
        self.composed(x, (inverse, slope), Some(beyond))
    }

    pub(super) fn power(&mut self, x: &Expansion, p: &Number) -> Expanded {
        let small = p.to_f64();
        let is_whole = *p == Number::from(small) && small == small.trunc();
        if is_whole && small.abs() <= LARGEST_EXPONENT {
            let power = self.whole_power(x, small.abs() as u32)?;
            return if small < 0.0 { self.reciprocal(&power) } else { Ok(power) };
        }
        if x.is_constant() {
            return Ok(self.constant(x.value.power(p)));
        }
        if x.value.value.is_positive() {
            if *p == Number::from(0.5) {
                return self.smooth(Function::Sqrt, x);
            }
            let logarithm = self.smooth(Function::Ln, x)?;
            let exponent = self.product(&self.constant(Exact::new(p.clone())), &logarithm)?;
            return self.smooth(Function::Exp, &exponent);
        }
        // A power of what is 0 at rest, and any other.
        let whole = self.total(x)?;
        let value = x.value.power(p);
        let at_rest = self.graph.number(value.value.to_f64())?;
        let power = self.graph.power(whole, small)?;
        let change = self.graph.subtract(power, at_rest)?;
        self.has_roots = true;
        Ok(self.kink(value, change))
    }

    fn whole_power(&mut self, x: &Expansion, n: u32) -> Expanded {
        let mut power = self.constant(Exact::from(1.0));
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

/// `f'(c)` from `c` and `f(c)`, of functions that are not made of others.
fn slope(function: Function, c: &Exact, value: &Exact) -> Exact {
    match function {
        Function::Exp => value.clone(),
        Function::Ln => c.inverse(),
        Function::Sqrt => value.times(&Exact::from(2.0)).inverse(),
        Function::Sin => c.function(Function::Cos),
        Function::Cos => c.function(Function::Sin).negated(),
        Function::Sinh => c.function(Function::Cosh),
        Function::Cosh => c.function(Function::Sinh),
        Function::Erf => Exact::new(c.value.error_slope()),
        // About 0.
        _ => Exact::from(1.0),
    }
}
