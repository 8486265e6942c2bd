//! Taylor coefficients of the elementary functions.

use super::coefficient::{Coefficient, Symbol, Term, as_number};
use super::exact::Number;
use super::side::{Made, Side, Stop};
use crate::expression::Function;

impl Side<'_> {
    /// The first `n` coefficients of a function about a value.
    pub(super) fn taylor(
        &mut self,
        function: Function,
        value: &Coefficient,
        n: usize,
    ) -> Made<Vec<Coefficient>> {
        let one = |term: Term| if term.exact.value.is_zero() { Vec::new() } else { vec![term] };
        Ok(match function {
            Function::Exp => {
                let at = self.value_of(Function::Exp, value)?;
                over_factorials(&[at], n)
            }
            Function::Sin | Function::Cos | Function::Sinh | Function::Cosh => {
                let (odd, even, sign) = match function {
                    Function::Sin | Function::Cos => (Function::Sin, Function::Cos, -1),
                    _ => (Function::Sinh, Function::Cosh, 1),
                };
                let (s, c) = (self.value_of(odd, value)?, self.value_of(even, value)?);
                let signed = |term: &Term| if sign < 0 { term.negated() } else { term.clone() };
                let turn = match function {
                    Function::Sin | Function::Sinh => {
                        [s.clone(), c.clone(), signed(&s), signed(&c)]
                    }
                    _ => [c.clone(), signed(&s), signed(&c), s.clone()],
                };
                // cosh' = sinh, cos' = -sin, cos''' = sin
                let turn =
                    if function == Function::Cosh { [c.clone(), s.clone(), c, s] } else { turn };
                over_factorials(&turn, n)
            }
            Function::Ln => {
                let at = self.one_term(value)?;
                let inverse = self.inverse(&at)?;
                let mut power = Term::symbol(Symbol::ONE);
                let mut coefficients = vec![one(self.value_of(Function::Ln, value)?)];
                for k in 1..n {
                    power = self.times(&power, &inverse)?;
                    let factor =
                        Number::from(if k % 2 == 1 { 1 } else { -1 }) / Number::from(k as i32);
                    coefficients.push(vec![power.scaled(&factor)]);
                }
                coefficients
            }
            Function::Sqrt => {
                let at = self.one_term(value)?;
                let inverse = self.inverse(&at)?;
                let mut term = self.power_of_term(&at, &Number::from(0.5))?;
                let mut coefficients = Vec::with_capacity(n);
                for k in 0..n {
                    coefficients.push(vec![term.clone()]);
                    // binom(1/2, k + 1) = binom(1/2, k) (1/2 - k)/(k + 1)
                    let factor = Number::from(0.5 - k as f64) / Number::from(k as i32 + 1);
                    term = self.times(&term, &inverse)?.scaled(&factor);
                }
                coefficients
            }
            Function::Erf => {
                let at = as_number(value).ok_or(Stop::Lost)?;
                let numbers = of_error_function(&at.exact.value, n);
                numbers.into_iter().map(|number| one(Term::number(number))).collect()
            }
            Function::Tanh | Function::Atan | Function::Asin => {
                if !value.is_empty() {
                    return Err(Stop::Lost);
                }
                let numbers = about_zero(function, n);
                numbers.into_iter().map(|number| one(Term::number(number))).collect()
            }
            _ => return Err(Stop::Lost),
        })
    }

    /// A function of a value at rest.
    pub(super) fn value_of(&mut self, function: Function, value: &Coefficient) -> Made<Term> {
        let Some(number) = as_number(value) else {
            let at = self.coefficient(value)?;
            let node = self.target.unary(function, at)?;
            return Ok(Term::symbol(Symbol { power: 0.0, other: Some(node) }));
        };
        let exact = number.exact.function(function);
        if exact.value.is_number() { Ok(Term { exact, ..number }) } else { Err(Stop::Lost) }
    }
}

/// `terms[k mod len]/k!`
fn over_factorials(terms: &[Term], n: usize) -> Vec<Coefficient> {
    let mut factor = Number::from(1);
    let mut coefficients = Vec::with_capacity(n);
    for k in 0..n {
        if k > 0 {
            factor = factor / Number::from(k as i32);
        }
        let term = &terms[k % terms.len()];
        let is_zero = term.exact.value.is_zero();
        coefficients.push(if is_zero { Vec::new() } else { vec![term.scaled(&factor)] });
    }
    coefficients
}

/// Of `erf` about `c`: those of `g = exp(-(c + d)^2)`, for which `g' = -2 (c + d) g`, integrated.
pub(super) fn of_error_function(c: &Number, n: usize) -> Vec<Number> {
    let (mut before, mut here) = (Number::from(0), c.error_slope());
    let mut numbers = vec![c.error_function()];
    for k in 1..n as i32 {
        numbers.push(&here / Number::from(k));
        let next = Number::from(-2) * (c * &here + &before) / Number::from(k);
        before = std::mem::replace(&mut here, next);
    }
    numbers
}

/// Of odd functions about 0.
fn about_zero(function: Function, n: usize) -> Vec<Number> {
    let mut numbers = vec![Number::from(0); n];
    let fraction = |p: i32, q: i32| Number::from(p) / Number::from(q);
    match function {
        // t' = 1 - t^2
        Function::Tanh => {
            for k in (1..n).step_by(2) {
                let mut sum = Number::from(i32::from(k == 1));
                for i in 1..k - 1 {
                    sum = sum - &numbers[i] * &numbers[k - 1 - i];
                }
                numbers[k] = sum / Number::from(k as i32);
            }
        }
        Function::Atan => {
            for k in (1..n).step_by(2) {
                numbers[k] = fraction(if k % 4 == 1 { 1 } else { -1 }, k as i32);
            }
        }
        // asin' = (1 - x^2)^(-1/2)
        _ => {
            let mut binomial = Number::from(1);
            for k in (1..n).step_by(2) {
                numbers[k] = &binomial / Number::from(k as i32);
                binomial = binomial * fraction(k as i32, k as i32 + 1);
            }
        }
    }
    numbers
}
