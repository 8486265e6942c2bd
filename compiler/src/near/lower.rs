//! Nodes of the source on one side of rest: functions, powers and choices.

use std::cmp::Ordering;

use super::MOST_COEFFICIENTS;
use super::coefficient::{Coefficient, Symbol, Term};
use super::exact::Number;
use super::side::{
    CHANGE, Id, Kind, Lowered, Made, Near, ONE, Plain, SAME, Side, Stop, Sum, plain_number,
};
use crate::expression::{Comparison, Function, Input, Node, NodeId, Operator};

/// Largest whole exponent that is worked out by products.
const LARGEST_EXPONENT: f64 = 16.0;

impl Side<'_> {
    /// Lowers everything up to the last node; what has no form near rest says why.
    pub(super) fn lower(&mut self, needed: &[bool]) -> Made<()> {
        for (index, _) in needed.iter().enumerate().filter(|(_, needed)| **needed) {
            let id = NodeId(index as u32);
            let made = self.node(id);
            match made {
                Err(Stop::More) if self.n < MOST_COEFFICIENTS => return Err(Stop::More),
                Err(Stop::Full) => return Err(Stop::Full),
                _ => {}
            }
            self.known[index] = Some(made);
        }
        Ok(())
    }

    pub(super) fn sum_of(&self, id: NodeId) -> Made<Sum> {
        match &self.known[id.0 as usize] {
            Some(Ok(Near::Number(sum))) => Ok(sum.clone()),
            _ => Err(Stop::Lost),
        }
    }

    fn truth(&self, id: NodeId) -> Made<bool> {
        match &self.known[id.0 as usize] {
            Some(Ok(Near::Truth(truth))) => Ok(*truth),
            _ => Err(Stop::Lost),
        }
    }

    fn node(&mut self, id: NodeId) -> Made<Near> {
        let node = self.source[id];
        if !self.varies[id.0 as usize] && !self.is_number(id) {
            return match node {
                Node::Input(Input::Reference(m)) if m == self.measure => {
                    let symbol = Symbol { power: 1.0, other: None };
                    Ok(Near::Number(vec![(Term::symbol(symbol), ONE)]))
                }
                Node::Truth(truth) => Ok(Near::Truth(truth)),
                Node::Compare(..) | Node::And(..) | Node::Or(..) | Node::Not(_) => Err(Stop::Lost),
                // Powers of the reference measure stay apart, and equal functions of it become one node.
                Node::Unary(..) | Node::PowerConstant(..) | Node::Binary(..) => {
                    let made = match self.number(id, node) {
                        Err(Stop::Lost) => self.as_symbol(id),
                        made => made,
                    };
                    made.map(Near::Number)
                }
                _ => self.as_symbol(id).map(Near::Number),
            };
        }
        match node {
            Node::Truth(truth) => Ok(Near::Truth(truth)),
            Node::Compare(comparison, x, y) => {
                let difference = Self::subtracted(&self.sum_of(x)?, &self.sum_of(y)?);
                let sign = self.sign_of(&difference)?;
                Ok(Near::Truth(match comparison {
                    Comparison::Equal => sign == 0,
                    Comparison::NotEqual => sign != 0,
                    Comparison::Less => sign < 0,
                    Comparison::LessEqual => sign <= 0,
                    Comparison::Greater => sign > 0,
                    Comparison::GreaterEqual => sign >= 0,
                }))
            }
            Node::And(x, y) => Ok(Near::Truth(self.truth(x)? && self.truth(y)?)),
            Node::Or(x, y) => Ok(Near::Truth(self.truth(x)? || self.truth(y)?)),
            Node::Not(x) => Ok(Near::Truth(!self.truth(x)?)),
            Node::Select(c, x, y) => {
                let taken = if self.truth(c)? { x } else { y };
                self.known[taken.0 as usize].clone().unwrap_or(Err(Stop::Lost))
            }
            _ => self.number(id, node).map(Near::Number),
        }
    }

    /// A function of the reference measure of which nothing else is known.
    fn as_symbol(&mut self, id: NodeId) -> Made<Sum> {
        let symbol = Symbol { power: 0.0, other: Some(self.copied(id)?) };
        Ok(vec![(Term::symbol(symbol), ONE)])
    }

    /// Whether no input has a part in a node.
    fn is_number(&self, id: NodeId) -> bool {
        let is = |x: NodeId| match &self.known[x.0 as usize] {
            Some(Ok(Near::Number(sum))) => {
                sum.iter().all(|(term, id)| *id == ONE && term.symbol.is_one())
            }
            Some(Ok(Near::Truth(_))) => true,
            _ => false,
        };
        let node = self.source[id];
        !matches!(node, Node::Input(_)) && node.operands().all(is)
    }

    /// A node that does not depend on the measure, in the target.
    fn copied(&mut self, id: NodeId) -> Made<NodeId> {
        let needed = self.source.reachable(&[id]);
        for index in (0..=id.0).filter(|index| needed[*index as usize]) {
            let at = NodeId(index);
            if !self.copied.contains_key(&at) {
                let node = self.source[at].map_operands(|x| self.copied[&x]);
                let made = self.target.make(node)?;
                self.copied.insert(at, made);
            }
        }
        Ok(self.copied[&id])
    }

    fn number(&mut self, id: NodeId, node: Node) -> Made<Sum> {
        match node {
            Node::Number(bits) => {
                let value = f64::from_bits(bits);
                if !value.is_finite() {
                    return Err(Stop::Lost);
                }
                let number = Self::number_of(value);
                Ok(if value == 0.0 { Sum::new() } else { number })
            }
            Node::Input(Input::Current(m)) if m == self.measure => {
                let reference = Term::symbol(Symbol { power: 1.0, other: None });
                Ok(vec![(reference.clone(), ONE), (reference, CHANGE)])
            }
            Node::Input(Input::Change(m)) if m == self.measure => {
                Ok(vec![(Term::symbol(Symbol::ONE), CHANGE)])
            }
            Node::Unary(function, x) => {
                let x = self.sum_of(x)?;
                self.function(function, &x)
            }
            Node::PowerConstant(x, bits) => {
                let x = self.sum_of(x)?;
                self.power(&x, &Number::from(f64::from_bits(bits)))
            }
            Node::Binary(operator, x, y) => {
                let (x, y) = (self.sum_of(x)?, self.sum_of(y)?);
                self.binary(operator, &x, &y)
            }
            _ => {
                debug_assert!(!self.varies[id.0 as usize]);
                Err(Stop::Lost)
            }
        }
    }

    fn number_of(value: f64) -> Sum {
        Self::number_sum(Number::from(value))
    }

    fn number_sum(value: Number) -> Sum {
        vec![(Term::number(value), ONE)]
    }

    fn binary(&mut self, operator: Operator, x: &Sum, y: &Sum) -> Made<Sum> {
        match operator {
            Operator::Add => Ok(Self::added(x, y)),
            Operator::Subtract => Ok(Self::subtracted(x, y)),
            Operator::Multiply => self.product(x, y),
            Operator::Divide => self.quotient(x, y),
            Operator::Min | Operator::Max => {
                let sign = self.sign_of(&Self::subtracted(x, y))?;
                let first = (sign <= 0) == (operator == Operator::Min);
                Ok(if first { x.clone() } else { y.clone() })
            }
            Operator::Atan2 => self.angle(x, y),
            Operator::Power => match Self::number_in(y) {
                Some(exponent) => self.power(x, &exponent),
                None => {
                    let logarithm = self.function(Function::Ln, x)?;
                    let exponent = self.product(y, &logarithm)?;
                    let expanded = self.function(Function::Exp, &exponent)?;
                    let (base, exponent) = (self.id_of(x)?, self.id_of(y)?);
                    self.plain(Plain::PowerOf(exponent), base, &expanded)
                }
            },
        }
    }

    /// The angle of the point with ordinate `y` and abscissa `x`, by the quotient that is finite at rest.
    fn angle(&mut self, y: &Sum, x: &Sum) -> Made<Sum> {
        self.within_reach()?;
        let right = || Self::number_sum(Number::from(1).asin());
        let abscissa = if x.is_empty() { None } else { Some(self.id_of(x)?) };
        if let Some(id) = abscissa
            && self.order(id)? == 0
        {
            let quotient = self.quotient(y, x)?;
            let angle = self.function(Function::Atan, &quotient)?;
            if self.sign_of(x)? > 0 {
                return Ok(angle);
            }
            let half = self.scaled(&right(), &Term::number(Number::from(2)))?;
            return Ok(match self.sign_of(y)? {
                -1 => Self::subtracted(&angle, &half),
                _ => Self::added(&angle, &half),
            });
        }
        let sign = self.sign_of(y)?;
        if sign == 0 {
            return Err(Stop::Lost);
        }
        let quotient = self.quotient(x, y)?;
        let angle = self.function(Function::Atan, &quotient)?;
        let side = self.scaled(&right(), &Term::number(Number::from(sign)))?;
        Ok(Self::subtracted(&side, &angle))
    }

    /// Signs are known near rest: where a measure has turned its own, angles are others.
    fn within_reach(&mut self) -> Made<()> {
        let change = self.target.input(Input::Change(self.measure))?;
        let size = self.target.unary(Function::Abs, change)?;
        let reach = self.target.number(0.5)?;
        let holds = self.target.make(Node::Compare(Comparison::Less, size, reach))?;
        if !self.guards.contains(&holds) {
            self.guards.push(holds);
        }
        Ok(())
    }

    fn number_in(sum: &Sum) -> Option<Number> {
        match sum.as_slice() {
            [] => Some(Number::from(0)),
            [(term, ONE)] if term.symbol.is_one() => Some(term.exact.value.clone()),
            _ => None,
        }
    }

    /// `op(x)`, whose value is `expanded`.
    fn plain(&mut self, op: Plain, x: Id, expanded: &Sum) -> Made<Sum> {
        let expanded = self.id_of(expanded)?;
        let Lowered { series, fraction, degree, .. } = self.nodes[expanded].clone();
        let kind = Kind::Plain(op, x, expanded);
        let id = self.push(Lowered { kind, series, fraction, degree });
        Ok(vec![(Term::symbol(Symbol::ONE), id)])
    }

    fn one() -> Sum {
        Self::number_sum(Number::from(1))
    }

    pub(super) fn function(&mut self, function: Function, x: &Sum) -> Made<Sum> {
        let two = || Term::number(Number::from(2));
        match function {
            Function::Negate => return Ok(Self::negated(x)),
            Function::Abs | Function::Sign => {
                let sign = self.sign_of(x)?;
                return Ok(match (function, sign) {
                    (Function::Sign, 0) => Sum::new(),
                    (Function::Sign, sign) => Self::number_sum(Number::from(sign)),
                    (_, -1) => Self::negated(x),
                    _ => x.clone(),
                });
            }
            Function::Expm1 => {
                let exponential = self.function(Function::Exp, x)?;
                return Ok(Self::subtracted(&exponential, &Self::one()));
            }
            Function::Log1p => return self.function(Function::Ln, &Self::added(&Self::one(), x)),
            Function::Log1pmx => {
                let logarithm = self.function(Function::Log1p, x)?;
                return Ok(Self::subtracted(&logarithm, x));
            }
            Function::Tan => {
                let sine = self.function(Function::Sin, x)?;
                let cosine = self.function(Function::Cos, x)?;
                return self.quotient(&sine, &cosine);
            }
            Function::Sqrt => return self.power(x, &Number::from(0.5)),
            Function::Acos => {
                let at_rest = self.value_at_rest(x)?;
                if at_rest == Some(Ordering::Equal) {
                    // acos(x) = 2 asin(sqrt((1 - x)/2))
                    let less = Self::subtracted(&Self::one(), x);
                    let half = Term::number(Number::from(0.5));
                    let less = self.scaled(&less, &half)?;
                    let root = self.power(&less, &Number::from(0.5))?;
                    let angle = self.function(Function::Asin, &root)?;
                    return self.scaled(&angle, &two());
                }
                let right = Self::number_sum(Number::from(1).asin());
                let angle = self.function(Function::Asin, x)?;
                return Ok(Self::subtracted(&right, &angle));
            }
            Function::Asin => {
                for sign in [1, -1] {
                    let sign = Term::number(Number::from(sign));
                    let signed = self.scaled(x, &sign)?;
                    if self.value_at_rest(&signed)? == Some(Ordering::Equal) {
                        let right = Self::number_sum(Number::from(1).asin());
                        let rest = self.function(Function::Acos, &signed)?;
                        return self.scaled(&Self::subtracted(&right, &rest), &sign);
                    }
                }
            }
            _ => {}
        }
        if Self::is_constant(x) {
            return self.constant(function, x);
        }
        let id = self.id_of(x)?;
        if let Some(known) = self.functions.get(&(function, id)) {
            return Ok(vec![(Term::symbol(Symbol::ONE), *known)]);
        }
        if self.nodes[id].fraction != 0.0 {
            return Err(Stop::Lost);
        }
        let (value, change) = self.at_rest(id)?;
        let made = match function {
            Function::Tanh | Function::Atan | Function::Asin if !value.is_empty() => {
                return self.moved(function, id, &value, change);
            }
            _ => {
                let n = self.nodes[id].series.len();
                let coefficients = self.taylor(function, &value, n)?;
                let d = self.nodes[change].series.clone();
                let series = self.composed(&coefficients, &d)?;
                let kind = Kind::Function(function, id);
                self.push(Lowered { kind, series, fraction: 0.0, degree: None })
            }
        };
        self.functions.insert((function, id), made);
        Ok(vec![(Term::symbol(Symbol::ONE), made)])
    }

    /// How a value at rest compares with 1, where it is a number.
    fn value_at_rest(&mut self, x: &Sum) -> Made<Option<Ordering>> {
        let id = self.id_of(&Self::subtracted(x, &Self::one()))?;
        let Some(rest) = self.nodes[id].series.first() else { return Err(Stop::More) };
        Ok(plain_number(rest).and_then(|value| value.partial_cmp(&Number::from(0))))
    }

    /// A function of what does not depend on the measure.
    fn constant(&mut self, function: Function, x: &Sum) -> Made<Sum> {
        let coefficient: Coefficient = x.iter().map(|(term, _)| term.clone()).collect();
        let value = self.value_of(function, &coefficient)?;
        if !value.exact.value.is_number() {
            return Err(Stop::Lost);
        }
        Ok(if value.exact.value.is_zero() { Sum::new() } else { vec![(value, ONE)] })
    }

    /// Functions whose value at rest is not that at 0, by their value there and themselves about 0.
    fn moved(&mut self, function: Function, x: Id, value: &Coefficient, change: Id) -> Made<Sum> {
        let one = Self::one();
        let node = |id: Id| vec![(Term::symbol(Symbol::ONE), id)];
        let (f, d) = (node(x), node(change));
        let c: Sum = value.iter().map(|term| (term.clone(), ONE)).collect();
        let at_rest = self.constant(function, &c)?;
        let (numerator, denominator) = match function {
            Function::Tanh => {
                // tanh(c + d) = t + (1 - t^2) T/(1 + t T), T = tanh(d)
                let tanh = self.function(Function::Tanh, &d)?;
                let square = self.product(&at_rest, &at_rest)?;
                let slope = Self::subtracted(&one, &square);
                let both = self.product(&at_rest, &tanh)?;
                (self.product(&slope, &tanh)?, Self::added(&one, &both))
            }
            // atan(c + d) = atan(c) + atan(d/(1 + c f))
            Function::Atan => {
                let both = self.product(&c, &f)?;
                let inside = self.quotient(&d, &Self::added(&one, &both))?;
                (self.function(Function::Atan, &inside)?, one)
            }
            // asin(c + d) = asin(c) + asin(d (f + c)/(sqrt(1 - c^2) f + c sqrt(1 - f^2)))
            _ => {
                let cosine = |side: &mut Self, x: &Sum| {
                    let square = side.product(x, x)?;
                    side.power(&Self::subtracted(&Self::one(), &square), &Number::from(0.5))
                };
                let (of_c, of_f) = (cosine(self, &c)?, cosine(self, &f)?);
                let numerator = self.product(&d, &Self::added(&f, &c))?;
                let (left, right) = (self.product(&of_c, &f)?, self.product(&c, &of_f)?);
                let inside = self.quotient(&numerator, &Self::added(&left, &right))?;
                (self.function(Function::Asin, &inside)?, one)
            }
        };
        let moved = self.quotient(&numerator, &denominator)?;
        let expanded = Self::added(&at_rest, &moved);
        self.plain(Plain::Function(function), x, &expanded)
    }

    /// `x^p`
    pub(super) fn power(&mut self, x: &Sum, p: &Number) -> Made<Sum> {
        let small = p.to_f64();
        let is_whole = *p == Number::from(small) && small == small.trunc();
        if small == 0.0 {
            return Ok(Self::one());
        }
        if is_whole && small == 1.0 {
            return Ok(x.clone());
        }
        if x.is_empty() {
            return if small > 0.0 { Ok(Sum::new()) } else { Err(Stop::Lost) };
        }
        if Self::is_constant(x) && x.len() > 1 {
            let coefficient = x.iter().map(|(term, _)| term.clone()).collect();
            let value = self.one_term(&coefficient)?;
            return Ok(vec![(self.power_of_term(&value, p)?, ONE)]);
        }
        let (weight, id) = self.weighted(x)?;
        let apart = is_whole || (weight.exact.value.is_positive() && weight.symbol.other.is_none());
        if !apart && id != ONE {
            let id = self.id_of(x)?;
            return self.power_of(id, p, is_whole);
        }
        let factor = self.power_of_term(&weight, p)?;
        if id == ONE {
            return Ok(vec![(factor, ONE)]);
        }
        let power = self.power_of(id, p, is_whole)?;
        self.scaled(&power, &factor)
    }

    pub(super) fn power_of_term(&mut self, x: &Term, p: &Number) -> Made<Term> {
        let exact = x.exact.power(p);
        if !exact.value.is_number() || exact.value.is_zero() {
            return Err(Stop::Lost);
        }
        let other = match x.symbol.other {
            Some(node) => Some(self.target.power(node, p.to_f64())?),
            None => None,
        };
        Ok(Term { symbol: Symbol { power: x.symbol.power * p.to_f64(), other }, exact })
    }

    fn power_of(&mut self, x: Id, p: &Number, is_whole: bool) -> Made<Sum> {
        let small = p.to_f64();
        let node = |id: Id| vec![(Term::symbol(Symbol::ONE), id)];
        let order = self.order(x)?;
        if is_whole && small.abs() <= LARGEST_EXPONENT && (small > 0.0 || order == 0) {
            let expanded = self.whole_power(x, small.abs() as u32)?;
            if small > 0.0 {
                return match self.nodes[expanded].kind {
                    Kind::Power(..) => Ok(node(expanded)),
                    _ => self.plain(Plain::Power(small), x, &node(expanded)),
                };
            }
            let reciprocal = self.quotient(&Self::one(), &node(expanded))?;
            return self.plain(Plain::Power(small), x, &reciprocal);
        }
        if order > 0 {
            return self.power_at_zero(x, order, p, is_whole);
        }
        let value = self.nodes[x].series[0].clone();
        if let Some(number) = plain_number(&value)
            && !number.is_positive()
        {
            if !is_whole {
                return Err(Stop::Lost);
            }
            // (-y)^p for a large whole p
            let negative = self.id_of(&Self::negated(&node(x)))?;
            let turned = self.power_of(negative, p, is_whole)?;
            return Ok(if small % 2.0 == 0.0 { turned } else { Self::negated(&turned) });
        }
        let half = small.trunc();
        if *p == Number::from(small)
            && (small - half).abs() == 0.5
            && half.abs() <= LARGEST_EXPONENT
        {
            let root = self.square_root(x)?;
            if small == 0.5 {
                return Ok(node(root));
            }
            let lower = (small - 0.5).trunc();
            let whole = self.power(&node(x), &Number::from(lower))?;
            let expanded = self.product(&whole, &node(root))?;
            return self.plain(Plain::Power(small), x, &expanded);
        }
        let logarithm = self.function(Function::Ln, &node(x))?;
        let exponent = self.scaled(&logarithm, &Term::number(p.clone()))?;
        let expanded = self.function(Function::Exp, &exponent)?;
        self.plain(Plain::Power(small), x, &expanded)
    }

    fn square_root(&mut self, x: Id) -> Made<Id> {
        if let Some(known) = self.functions.get(&(Function::Sqrt, x)) {
            return Ok(*known);
        }
        let (value, change) = self.at_rest(x)?;
        let coefficients = self.taylor(Function::Sqrt, &value, self.nodes[x].series.len())?;
        let d = self.nodes[change].series.clone();
        let series = self.composed(&coefficients, &d)?;
        let kind = Kind::Function(Function::Sqrt, x);
        let made = self.push(Lowered { kind, series, fraction: 0.0, degree: None });
        self.functions.insert((Function::Sqrt, x), made);
        Ok(made)
    }

    fn whole_power(&mut self, x: Id, n: u32) -> Made<Id> {
        if n == 1 {
            return Ok(x);
        }
        let half = self.whole_power(x, n / 2)?;
        let mut power = self.product_of(half, half)?;
        if n % 2 == 1 {
            power = self.product_of(power, x)?;
        }
        if self.nodes[x].degree == Some(1) {
            let Lowered { series, fraction, degree, .. } = self.nodes[power].clone();
            let kind = Kind::Power(x, n);
            return Ok(self.push(Lowered { kind, series, fraction, degree }));
        }
        Ok(power)
    }

    /// `x^p = |e|^(a p) (x/|e|^a)^p` where `x` is of order `a` at rest.
    fn power_at_zero(&mut self, x: Id, a: usize, p: &Number, is_whole: bool) -> Made<Sum> {
        let small = p.to_f64();
        let node = |id: Id| vec![(Term::symbol(Symbol::ONE), id)];
        let exponent = a as f64 * small;
        let near_whole = exponent.round();
        let whole = match (exponent - near_whole).abs() < SAME {
            // What is infinite at rest may be a factor of what is not.
            _ if exponent < 0.0 => 0.0,
            true => near_whole,
            false => exponent.floor(),
        };
        let fraction = exponent - whole;
        if self.nodes[x].fraction != 0.0 {
            return Err(Stop::Lost);
        }
        let shifted = self.shifted(x, a);
        let regular = self.power_of(shifted, p, is_whole)?;
        let mut expanded = regular;
        if fraction.abs() >= SAME {
            let mut series = vec![Coefficient::new(); self.n];
            series[0] = vec![Term::symbol(Symbol::ONE)];
            let kind = Kind::Fraction(fraction);
            let id = self.push(Lowered { kind, series, fraction, degree: Some(0) });
            self.is_sided = true;
            expanded = self.product(&expanded, &node(id))?;
        }
        if whole > 0.0 {
            if whole > LARGEST_EXPONENT {
                return Err(Stop::Lost);
            }
            let power = self.whole_power(CHANGE, whole as u32)?;
            expanded = self.product(&expanded, &node(power))?;
            if whole % 2.0 == 1.0 {
                self.is_sided = true;
                let sign = Term::number(Number::from(self.sign));
                expanded = self.scaled(&expanded, &sign)?;
            }
        }
        self.plain(Plain::Power(small), x, &expanded)
    }
}
