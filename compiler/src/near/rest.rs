//! Code for what a node has beyond its first Taylor terms, made where it is demanded.

use super::beyond::{beyond, of_error_function};
use super::coefficient::{Coefficient, Symbol, Term, as_number};
use super::exact::Number;
use super::side::{CHANGE, Id, Kind, Made, ONE, Plain, SAME, Side, Stop, Sum};
use crate::expression::{Function, Input, NodeId, Operator};

/// Deepest recursion: what nests deeper keeps its form.
const DEEPEST: usize = 100;

/// Sums whose next coefficient cancels too are opened this often.
const OPENED: usize = 3;

/// A coefficient below this share of its terms is a difference: 2^-3.
const CANCELS: i64 = 3;

/// Larger powers of a stretch are exponentials of its logarithm.
const LARGE_POWER: f64 = 8.0;

impl Side<'_> {
    /// The whole of a node.
    pub(super) fn whole(&mut self, id: Id) -> Made<NodeId> {
        match self.rest(id, 0)? {
            Some(node) => Ok(node),
            None => Ok(self.target.number(0.0)?),
        }
    }

    /// `x - sum of c_k e^k, k < from`; nothing where that is 0.
    pub(super) fn rest(&mut self, id: Id, from: usize) -> Made<Option<NodeId>> {
        let Some(k) = self.first(id, from)? else { return Ok(None) };
        if let Some(known) = self.rests.get(&(id, k)) {
            return Ok(*known);
        }
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(Stop::Lost);
        }
        let made = self.made(id, k);
        self.depth -= 1;
        let made = made?;
        self.rests.insert((id, k), made);
        Ok(made)
    }

    fn made(&mut self, id: Id, k: usize) -> Made<Option<NodeId>> {
        let order = self.order(id)?;
        match self.nodes[id].kind.clone() {
            Kind::One => Ok(Some(self.target.number(1.0)?)),
            Kind::Change => Ok(Some(self.target.input(Input::Change(self.measure))?)),
            Kind::Fraction(q) => {
                let size = self.size()?;
                Ok(Some(self.target.power(size, q)?))
            }
            Kind::Sum(terms) => self.sum(id, &terms, k, OPENED),
            Kind::Product(x, y) => self.product_rest(id, (x, y), k).map(Some),
            Kind::Quotient(x, y) => self.quotient_rest(id, (x, y), k),
            Kind::Power(x, n) if k == order => {
                let x = self.whole(x)?;
                Ok(Some(self.target.power(x, f64::from(n))?))
            }
            Kind::Power(..) => self.horner(id, k).map(Some),
            Kind::Function(function, x) => self.function_rest(id, (function, x), k),
            Kind::Plain(Plain::Power(p), _, expanded) if k == 0 && p.abs() > LARGE_POWER => {
                self.rest(expanded, k)
            }
            Kind::Plain(plain, x, _) if k == order => {
                let x = self.whole(x)?;
                Ok(Some(match plain {
                    Plain::Function(function) => self.target.unary(function, x)?,
                    Plain::Power(0.5) => self.target.unary(Function::Sqrt, x)?,
                    Plain::Power(p) => self.target.power(x, p)?,
                    Plain::PowerOf(y) => {
                        let y = self.whole(y)?;
                        self.target.binary(Operator::Power, x, y)?
                    }
                }))
            }
            Kind::Plain(_, _, expanded) => self.rest(expanded, k),
            Kind::Shifted(x, n) => {
                let Some(rest) = self.rest(x, k + n)? else { return Ok(None) };
                let size = self.size()?;
                let divisor = self.target.power(size, n as f64)?;
                Ok(Some(self.target.divide(rest, divisor)?))
            }
        }
    }

    /// `|e|`
    fn size(&mut self) -> Made<NodeId> {
        self.is_sided = true;
        let change = self.target.input(Input::Change(self.measure))?;
        if self.sign > 0 { Ok(change) } else { Ok(self.target.negate(change)?) }
    }

    pub(super) fn plus(&mut self, x: Option<NodeId>, y: Option<NodeId>) -> Made<Option<NodeId>> {
        Ok(match (x, y) {
            (Some(x), Some(y)) => Some(self.target.add(x, y)?),
            (only, None) | (None, only) => only,
        })
    }

    /// `w x`, without the node where it is 1.
    fn weighed(&mut self, weight: &Term, x: Option<NodeId>) -> Made<NodeId> {
        let number = weight.exact.value.to_f64();
        if !number.is_finite() || (number == 0.0) != weight.exact.value.is_zero() {
            return Err(Stop::Lost);
        }
        let mut made = self.target.number(number)?;
        if let Some(node) = weight.symbol.other {
            made = self.target.multiply(made, node)?;
        }
        let power = weight.symbol.power;
        let reference = self.target.input(Input::Reference(self.measure))?;
        if power > 0.0 {
            let power = self.target.power(reference, power)?;
            made = self.target.multiply(made, power)?;
        }
        if let Some(x) = x {
            made = self.target.multiply(made, x)?;
        }
        if power < 0.0 {
            // Twice `/L` has a wider range than once `/L^2`.
            let is_whole = power == power.trunc() && power >= -4.0;
            let (divisor, times) = if is_whole {
                (reference, -power as usize)
            } else {
                (self.target.power(reference, -power)?, 1)
            };
            for _ in 0..times {
                made = self.target.divide(made, divisor)?;
            }
        }
        Ok(made)
    }

    /// The number, or function of the reference measure, that a coefficient is.
    pub(super) fn coefficient(&mut self, coefficient: &Coefficient) -> Made<NodeId> {
        let mut sum = None;
        for term in coefficient {
            let term = self.weighed(term, None)?;
            sum = self.plus(sum, Some(term))?;
        }
        match sum {
            Some(sum) => Ok(sum),
            None => Ok(self.target.number(0.0)?),
        }
    }

    /// `c e^k |e|^q`
    fn monomial(&mut self, coefficient: &Coefficient, k: usize, q: f64) -> Made<Option<NodeId>> {
        let mut power = None;
        if k > 0 {
            let change = self.target.input(Input::Change(self.measure))?;
            power = Some(self.target.power(change, k as f64)?);
        }
        if q != 0.0 {
            let size = self.size()?;
            let fraction = self.target.power(size, q)?;
            power = Some(match power {
                Some(power) => self.target.multiply(power, fraction)?,
                None => fraction,
            });
        }
        let mut sum = None;
        for term in coefficient {
            let term = self.weighed(term, power)?;
            sum = self.plus(sum, Some(term))?;
        }
        Ok(sum)
    }

    fn sum(&mut self, id: Id, terms: &Sum, k: usize, deep: usize) -> Made<Option<NodeId>> {
        if deep > 0 && terms.len() > 1 && self.cancels(id, terms, k) {
            let (coefficient, q) = (self.nodes[id].series[k].clone(), self.nodes[id].fraction);
            let first = self.monomial(&coefficient, k, q)?;
            let rest = match self.first(id, k + 1)? {
                Some(next) => self.sum(id, terms, next, deep - 1)?,
                None => None,
            };
            return self.plus(first, rest);
        }
        let mut sum = None;
        let mut left = terms.clone();
        if k == 0 {
            sum = self.stretch_in(&mut left)?;
        }
        for (weight, x) in &left {
            if let Some(rest) = self.rest(*x, k)? {
                let term = self.weighed(weight, Some(rest))?;
                sum = self.plus(sum, Some(term))?;
            }
        }
        Ok(sum)
    }

    /// `w + w e = w x` is taken out of a sum.
    fn stretch_in(&mut self, terms: &mut Sum) -> Made<Option<NodeId>> {
        let pair = terms.iter().enumerate().find_map(|(i, (w, x))| {
            let matches = |(v, y): &(Term, Id)| {
                *y == CHANGE && v.symbol == w.symbol && v.exact.value == w.exact.value
            };
            let j = terms.iter().position(matches)?;
            (*x == ONE).then_some((i, j))
        });
        let Some((i, j)) = pair else { return Ok(None) };
        let weight = terms[i].0.clone();
        terms.remove(i.max(j));
        terms.remove(i.min(j));
        let current = self.target.input(Input::Current(self.measure))?;
        if weight.symbol.power >= 1.0 {
            let mut lower = weight;
            lower.symbol.power -= 1.0;
            return self.weighed(&lower, Some(current)).map(Some);
        }
        let reference = self.target.input(Input::Reference(self.measure))?;
        let stretch = self.target.divide(current, reference)?;
        self.weighed(&weight, Some(stretch)).map(Some)
    }

    /// Whether a coefficient of a sum is much smaller than its terms, of products than theirs.
    fn cancels(&self, id: Id, terms: &Sum, k: usize) -> bool {
        let total = &self.nodes[id].series[k];
        let mut largest: Vec<(Symbol, i64)> = Vec::new();
        for (weight, x) in terms {
            let Some(parts) = self.parts(*x, k) else { return true };
            for (power, size) in parts {
                // Symbols of products are those of the total where they matter.
                let power = weight.symbol.power + power;
                let Some(own) = weight.exact.value.magnitude() else { continue };
                let symbol = total
                    .iter()
                    .map(|t| t.symbol)
                    .find(|symbol| symbol.power == power)
                    .unwrap_or(Symbol { power, other: None });
                match largest.iter_mut().find(|(known, _)| *known == symbol) {
                    Some((_, known)) => *known = (*known).max(own + size),
                    None => largest.push((symbol, own + size)),
                }
            }
        }
        largest.iter().any(|(symbol, size)| {
            let own = total
                .iter()
                .find(|t| t.symbol == *symbol)
                .and_then(|t| t.exact.value.magnitude())
                .unwrap_or(i64::MIN);
            own < size - CANCELS
        })
    }

    /// Powers of the reference and sizes, as powers of two, of what a coefficient is the sum of.
    fn parts(&self, x: Id, k: usize) -> Option<Vec<(f64, i64)>> {
        let sizes = |coefficient: &Coefficient| -> Vec<(f64, i64)> {
            let size = |term: &Term| Some((term.symbol.power, term.exact.value.magnitude()?));
            coefficient.iter().filter_map(size).collect()
        };
        let own = sizes(self.nodes[x].series.get(k)?);
        let Kind::Product(y, z) = self.nodes[x].kind else { return Some(own) };
        // The first coefficient of a product is one product, whose factors have their digits.
        if self.order(x).is_ok_and(|order| k <= order) {
            return Some(own);
        }
        let (y, z) = (&self.nodes[y].series, &self.nodes[z].series);
        let mut all = Vec::new();
        for (first, second) in y.iter().take(k + 1).zip(z.iter().take(k + 1).rev()) {
            for (p, a) in sizes(first) {
                all.extend(sizes(second).into_iter().map(|(q, b)| (p + q, a + b)));
            }
        }
        Some(all)
    }

    fn product_rest(&mut self, id: Id, (x, y): (Id, Id), k: usize) -> Made<NodeId> {
        let (a, b) = (self.order(x)?, self.order(y)?);
        if k <= self.order(id)? {
            let (p, q) = (self.whole(x)?, self.whole(y)?);
            return Ok(self.target.multiply(p, q)?);
        }
        let parts = self.nodes[x].fraction + self.nodes[y].fraction;
        let is_carried = (parts - self.nodes[id].fraction).abs() > SAME;
        if is_carried {
            return Err(Stop::Lost);
        }
        // The factor whose remainder is 0 goes by its coefficients.
        let gone = |side: &Self, f: Id, order: usize| side.first(f, k - order) == Ok(None);
        let ((x, a), (y, b)) =
            if gone(self, y, a) && !gone(self, x, b) { ((y, b), (x, a)) } else { ((x, a), (y, b)) };
        let mut sum = None;
        if let Some(rest) = self.rest(x, k - b)? {
            let other = self.whole(y)?;
            sum = Some(self.target.multiply(rest, other)?);
        }
        for i in a..k - b {
            let coefficient = self.nodes[x].series[i].clone();
            if coefficient.is_empty() {
                continue;
            }
            let factor = self.monomial(&coefficient, i, self.nodes[x].fraction)?;
            if let (Some(factor), Some(rest)) = (factor, self.rest(y, k - i)?) {
                let term = self.target.multiply(factor, rest)?;
                sum = self.plus(sum, Some(term))?;
            }
        }
        sum.ok_or(Stop::Lost)
    }

    /// `x/y - Q = (x - Q y)/y` with the first terms `Q`; `y` is of order `b`.
    fn quotient_rest(&mut self, id: Id, (x, y): (Id, Id), k: usize) -> Made<Option<NodeId>> {
        let b = self.order(y)?;
        let divisor = self.whole(y)?;
        if k <= self.order(id)? {
            let x = self.whole(x)?;
            return Ok(Some(self.target.divide(x, divisor)?));
        }
        let mut sum = self.rest(x, k + b)?;
        for i in 0..k {
            let coefficient: Coefficient =
                self.nodes[id].series[i].iter().map(Term::negated).collect();
            if coefficient.is_empty() {
                continue;
            }
            let factor = self.monomial(&coefficient, i, self.nodes[id].fraction)?;
            if let (Some(factor), Some(rest)) = (factor, self.rest(y, k + b - i)?) {
                let term = self.target.multiply(factor, rest)?;
                sum = self.plus(sum, Some(term))?;
            }
        }
        match sum {
            Some(sum) => Ok(Some(self.target.divide(sum, divisor)?)),
            None => Ok(None),
        }
    }

    /// A polynomial by its coefficients.
    fn horner(&mut self, id: Id, k: usize) -> Made<NodeId> {
        let change = self.target.input(Input::Change(self.measure))?;
        let series = self.nodes[id].series.clone();
        let last =
            self.nodes[id].degree.filter(|degree| *degree < series.len()).ok_or(Stop::More)?;
        let mut sum = None;
        for coefficient in series[k..=last].iter().rev() {
            if let Some(known) = sum {
                sum = Some(self.target.multiply(known, change)?);
            }
            if !coefficient.is_empty() {
                let constant = self.coefficient(coefficient)?;
                sum = self.plus(Some(constant), sum)?;
            }
        }
        let sum = sum.ok_or(Stop::Lost)?;
        let power = self.target.power(change, k as f64)?;
        Ok(self.target.multiply(power, sum)?)
    }

    fn function_rest(
        &mut self,
        id: Id,
        (function, x): (Function, Id),
        k: usize,
    ) -> Made<Option<NodeId>> {
        let (value, change) = self.at_rest(x)?;
        let a = self.order(change)?;
        if k == 0 {
            if let Some(first) = self.small_at_rest(function, &value)? {
                let constant = self.nodes[id].series[0].clone();
                let constant = self.monomial(&constant, 0, 0.0)?;
                let rest = if first { self.rest(id, 1)? } else { None };
                return self.plus(constant, rest);
            }
            let x = self.whole(x)?;
            return Ok(Some(self.target.unary(function, x)?));
        }
        let j = k.div_ceil(a);
        let d = self.whole(change)?;
        let mut sum = self.function_beyond(function, &value, d, j)?;
        if j > 1 {
            let coefficients = self.taylor(function, &value, j)?;
            let mut power = change;
            for (i, coefficient) in coefficients.iter().enumerate().skip(1) {
                if i > 1 {
                    power = self.product_of(power, change)?;
                }
                if coefficient.is_empty() {
                    continue;
                }
                if let Some(rest) = self.rest(power, k)? {
                    let factor = self.coefficient(coefficient)?;
                    let term = self.target.multiply(factor, rest)?;
                    sum = self.plus(sum, Some(term))?;
                }
            }
        }
        Ok(sum)
    }

    /// Whether `phi(c)` is so much smaller than `c phi'(c)` that it is better added up.
    fn small_at_rest(&mut self, function: Function, value: &Coefficient) -> Made<Option<bool>> {
        let Some(c) = as_number(value).filter(|c| !c.exact.value.is_zero()) else {
            return Ok(None);
        };
        let first = self.taylor(function, value, 2)?;
        let (Some(phi), Some(slope)) = (as_number(&first[0]), as_number(&first[1])) else {
            return Ok(None);
        };
        let limit = (&c.exact.value * &slope.exact.value).size() / Number::from(8);
        Ok((phi.exact.value.size() < limit).then_some(true))
    }

    /// `phi(c + d) - sum of phi_i d^i, i < j`
    fn function_beyond(
        &mut self,
        function: Function,
        value: &Coefficient,
        d: NodeId,
        j: usize,
    ) -> Made<Option<NodeId>> {
        match function {
            Function::Exp => {
                let factor = self.value_of(Function::Exp, value)?;
                let rest = beyond(self.target, Function::Exp, d, j)?;
                self.weighed(&factor, Some(rest)).map(Some)
            }
            Function::Ln | Function::Sqrt => {
                let at = self.one_term(value)?;
                let inverse = self.inverse(&at)?;
                let ratio = self.weighed(&inverse, Some(d))?;
                let rest = beyond(self.target, function, ratio, j)?;
                if function == Function::Ln {
                    return Ok(Some(rest));
                }
                let root = self.power_of_term(&at, &Number::from(0.5))?;
                self.weighed(&root, Some(rest)).map(Some)
            }
            Function::Sin | Function::Cos | Function::Sinh | Function::Cosh => {
                let (odd, even) = match function {
                    Function::Sin | Function::Cos => (Function::Sin, Function::Cos),
                    _ => (Function::Sinh, Function::Cosh),
                };
                let (of_odd, of_even) = (self.value_of(odd, value)?, self.value_of(even, value)?);
                // sin(c + d) = sin c cos d + cos c sin d, cos(c + d) = cos c cos d - sin c sin d
                let (with_even, with_odd) = match function {
                    Function::Sin | Function::Sinh => (of_odd, of_even),
                    Function::Cos => (of_even, of_odd.negated()),
                    _ => (of_even, of_odd),
                };
                let mut sum = None;
                for (weight, function) in [(with_even, even), (with_odd, odd)] {
                    if !weight.exact.value.is_zero() {
                        let rest = beyond(self.target, function, d, j)?;
                        let term = self.weighed(&weight, Some(rest))?;
                        sum = self.plus(sum, Some(term))?;
                    }
                }
                Ok(sum)
            }
            Function::Erf => {
                let at = as_number(value).ok_or(Stop::Lost)?;
                Ok(Some(of_error_function(self.target, &at.exact.value, d, j)?))
            }
            _ => beyond(self.target, function, d, j).map(Some),
        }
    }
}
