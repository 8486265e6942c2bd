//! Arithmetic of terms, coefficients and power series.

use super::coefficient::{Coefficient, Symbol, Term, add, settled};
use super::side::{Made, Side, Stop};

/// Most terms of a coefficient. Where energies hold together one or two powers of the measure at rest are in
/// each; where lengths are added to areas every product has more of them, and quotients take minutes.
const MOST_TERMS: usize = 64;

impl Side<'_> {
    pub(super) fn times(&mut self, x: &Term, y: &Term) -> Made<Term> {
        let other = match (x.symbol.other, y.symbol.other) {
            (Some(p), Some(q)) => Some(self.target.multiply(p, q)?),
            (p, q) => p.or(q),
        };
        let symbol = Symbol { power: x.symbol.power + y.symbol.power, other };
        Ok(Term { symbol, exact: x.exact.times(&y.exact) })
    }

    pub(super) fn inverse(&mut self, x: &Term) -> Made<Term> {
        let other = match x.symbol.other {
            Some(node) => {
                let one = self.target.number(1.0)?;
                Some(self.target.divide(one, node)?)
            }
            None => None,
        };
        if x.exact.value.is_zero() {
            return Err(Stop::Lost);
        }
        let symbol = Symbol { power: -x.symbol.power, other };
        Ok(Term { symbol, exact: x.exact.inverse() })
    }

    /// A coefficient as one term: where it has several, their sum becomes a symbol.
    pub(super) fn one_term(&mut self, coefficient: &Coefficient) -> Made<Term> {
        match coefficient.as_slice() {
            [] => Err(Stop::Lost),
            [only] => Ok(only.clone()),
            _ => {
                let node = self.coefficient(coefficient)?;
                Ok(Term::symbol(Symbol { power: 0.0, other: Some(node) }))
            }
        }
    }

    pub(super) fn multiplied(&mut self, x: &Coefficient, y: &Coefficient) -> Made<Coefficient> {
        let mut product = Coefficient::new();
        for a in x {
            for b in y {
                let term = self.times(a, b)?;
                add(&mut product, term);
            }
            if product.len() > MOST_TERMS {
                return Err(Stop::Lost);
            }
        }
        Ok(product)
    }

    pub(super) fn zeros(n: usize) -> Vec<Coefficient> {
        vec![Coefficient::new(); n]
    }

    pub(super) fn product_of_series(
        &mut self,
        x: &[Coefficient],
        y: &[Coefficient],
    ) -> Made<Vec<Coefficient>> {
        let n = x.len().min(y.len());
        let mut product = Self::zeros(n);
        for (i, a) in x.iter().enumerate().filter(|(_, a)| !a.is_empty()) {
            for (j, b) in y.iter().enumerate().filter(|(_, b)| !b.is_empty()) {
                if i + j >= n {
                    break;
                }
                for term in self.multiplied(a, b)? {
                    add(&mut product[i + j], term);
                }
            }
        }
        Ok(product.into_iter().map(settled).collect())
    }

    /// `sum of coefficients[k]*d^k` for a series `d` without a constant.
    pub(super) fn composed(
        &mut self,
        coefficients: &[Coefficient],
        d: &[Coefficient],
    ) -> Made<Vec<Coefficient>> {
        let mut sum = Self::zeros(d.len());
        for coefficient in coefficients.iter().take(d.len()).rev() {
            sum = self.product_of_series(&sum, d)?;
            for term in coefficient {
                add(&mut sum[0], term.clone());
            }
        }
        Ok(sum.into_iter().map(settled).collect())
    }

    /// `x/y` where `y` begins with coefficient `b`: its quotient by `e^b` is no zero.
    pub(super) fn quotient_of_series(
        &mut self,
        x: &[Coefficient],
        y: &[Coefficient],
        b: usize,
    ) -> Made<Vec<Coefficient>> {
        let pivot = self.one_term(&y[b])?;
        let pivot = vec![self.inverse(&pivot)?];
        let mut quotient: Vec<Coefficient> = Vec::new();
        for k in 0..x.len().min(y.len()) - b {
            let mut rest = x[k + b].clone();
            for i in 1..=k {
                for term in self.multiplied(&y[b + i], &quotient[k - i].clone())? {
                    add(&mut rest, term.negated());
                }
            }
            let rest = settled(rest);
            quotient.push(settled(self.multiplied(&rest, &pivot)?));
        }
        Ok(quotient)
    }

    /// The coefficients times the sign of `e`.
    pub(super) fn turned(&mut self, series: &[Coefficient]) -> Vec<Coefficient> {
        self.is_sided = true;
        let turned = |c: &Coefficient| {
            c.iter().map(|t| if self.sign < 0 { t.negated() } else { t.clone() }).collect()
        };
        series.iter().map(turned).collect()
    }
}
