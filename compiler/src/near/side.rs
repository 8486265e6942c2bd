//! An energy on one side of rest: nodes with their Taylor coefficients.
//!
//! Before: a graph in the measure. After: linear combinations of nodes, each `|e|^q` times a power
//! series in `e` whose first coefficients are known, with every choice made as it is on this side of
//! rest and guards where that may not last.

use rustc_hash::FxHashMap;

use super::MOST_COEFFICIENTS;
use super::coefficient::{Coefficient, Symbol, Term, add, as_number, settled};
use super::exact::Number;
use crate::expression::{ExprGraph, Function, Node, NodeId, TooManyNodes};
use crate::measure::Measure;
use crate::simplify::Simplifier;

/// Why there is no form near rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stop {
    /// More coefficients may find one.
    More,
    /// None is known.
    Lost,
    /// The graph is full.
    Full,
}

impl From<TooManyNodes> for Stop {
    fn from(_: TooManyNodes) -> Stop {
        Stop::Full
    }
}

/// So many coefficients in a row that are 0 are a function that is.
const MANY_ZEROS: usize = 8;

/// Exponents that differ by less are one, rounded differently.
pub(super) const SAME: f64 = 1e-12;

pub(super) type Made<T> = Result<T, Stop>;

/// The place of a node of a side.
pub(super) type Id = usize;

/// The number 1.
pub(super) const ONE: Id = 0;
/// The relative change `e`.
pub(super) const CHANGE: Id = 1;

/// A linear combination of nodes; 0 where it is empty.
pub(super) type Sum = Vec<(Term, Id)>;

/// A weight by its digits in 64 bits, its power of the reference measure and its other factor; and what
/// it weighs.
pub(super) type Weighed = (u64, u64, Option<NodeId>, Id);

fn key(sum: &Sum) -> Vec<Weighed> {
    let weighed = |(term, id): &(Term, Id)| {
        let Symbol { power, other } = term.symbol;
        (term.exact.value.to_f64().to_bits(), power.to_bits(), other, *id)
    };
    let mut key: Vec<Weighed> = sum.iter().map(weighed).collect();
    key.sort_unstable();
    key
}

/// What is evaluated as it was written wherever all of it is wanted.
#[derive(Clone, Copy, Debug)]
pub(super) enum Plain {
    Function(Function),
    Power(f64),
    PowerOf(Id),
}

#[derive(Clone, Debug)]
pub(super) enum Kind {
    One,
    Change,
    /// `|e|^q`, `0 < q < 1`
    Fraction(f64),
    Sum(Sum),
    Product(Id, Id),
    Quotient(Id, Id),
    /// A whole power of a polynomial of first degree.
    Power(Id, u32),
    Function(Function, Id),
    /// The operation on the first node, whose value is the second.
    Plain(Plain, Id, Id),
    /// `x/|e|^n`
    Shifted(Id, usize),
}

/// A node: `|e|^fraction` times a power series.
#[derive(Clone, Debug)]
pub(super) struct Lowered {
    pub(super) kind: Kind,
    pub(super) series: Vec<Coefficient>,
    pub(super) fraction: f64,
    /// Of a polynomial its degree, or more.
    pub(super) degree: Option<usize>,
}

/// What a node of the source is on this side.
#[derive(Clone, Debug)]
pub(super) enum Near {
    Number(Sum),
    Truth(bool),
}

/// One side of rest.
pub(super) struct Side<'a> {
    pub(super) source: &'a ExprGraph,
    pub(super) target: &'a mut Simplifier,
    pub(super) measure: Measure,
    /// 1 or -1, the sign of `e`.
    pub(super) sign: i32,
    /// How many coefficients are known of each node.
    pub(super) n: usize,
    pub(super) nodes: Vec<Lowered>,
    pub(super) known: Vec<Option<Made<Near>>>,
    /// Whether a node of the source depends on the measure.
    pub(super) varies: Vec<bool>,
    /// Nodes of the source that do not, in the target.
    pub(super) copied: FxHashMap<NodeId, NodeId>,
    pub(super) rests: FxHashMap<(Id, usize), Option<NodeId>>,
    pub(super) products: FxHashMap<(Id, Id), Id>,
    /// Linear combinations by what identifies them, up to the last digits of their weights.
    pub(super) sums: FxHashMap<Vec<Weighed>, Vec<Id>>,
    pub(super) functions: FxHashMap<(Function, Id), Id>,
    /// What must hold for the choices that were made.
    pub(super) guards: Vec<NodeId>,
    /// Whether the sign has decided anything.
    pub(super) is_sided: bool,
    pub(super) depth: usize,
}

impl<'a> Side<'a> {
    /// A side on which nothing is known yet.
    pub(super) fn new(
        source: &'a ExprGraph,
        target: &'a mut Simplifier,
        (measure, sign): (Measure, i32),
        varies: &[bool],
        n: usize,
    ) -> Side<'a> {
        Side {
            source,
            target,
            measure,
            sign,
            n,
            nodes: starting_nodes(n),
            known: vec![None; source.len()],
            varies: varies.to_vec(),
            copied: FxHashMap::default(),
            rests: FxHashMap::default(),
            products: FxHashMap::default(),
            sums: FxHashMap::default(),
            functions: FxHashMap::default(),
            guards: Vec::new(),
            is_sided: false,
            depth: 0,
        }
    }
}

impl Side<'_> {
    pub(super) fn push(&mut self, node: Lowered) -> Id {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// The first coefficient from `from` on that is not 0: nothing where all of the rest is 0.
    pub(super) fn first(&self, id: Id, from: usize) -> Made<Option<usize>> {
        let node = &self.nodes[id];
        let n = node.series.len();
        if let Some(k) = (from..n).find(|k| !node.series[*k].is_empty()) {
            return Ok(Some(k));
        }
        // Nothing that is written by hand begins so late; samples would find it.
        if self.n >= MOST_COEFFICIENTS && from + MANY_ZEROS <= n {
            return Ok(None);
        }
        match node.degree {
            Some(degree) if degree < n.max(from) => Ok(None),
            _ => Err(Stop::More),
        }
    }

    /// The first coefficient that is not 0, of a node that is not 0.
    pub(super) fn order(&self, id: Id) -> Made<usize> {
        self.first(id, 0)?.ok_or(Stop::Lost)
    }

    pub(super) fn is_constant(sum: &Sum) -> bool {
        sum.iter().all(|(_, id)| *id == ONE)
    }

    pub(super) fn added(x: &Sum, y: &Sum) -> Sum {
        let mut sum = x.clone();
        for (term, id) in y {
            let same = |(known, at): &&mut (Term, Id)| at == id && known.symbol == term.symbol;
            match sum.iter_mut().find(same) {
                Some((known, _)) => {
                    known.exact = known.exact.plus(&term.exact);
                }
                None => sum.push((term.clone(), *id)),
            }
        }
        sum.retain(|(term, _)| !term.exact.is_nothing());
        sum
    }

    pub(super) fn negated(sum: &Sum) -> Sum {
        sum.iter().map(|(term, id)| (term.negated(), *id)).collect()
    }

    pub(super) fn subtracted(x: &Sum, y: &Sum) -> Sum {
        Self::added(x, &Self::negated(y))
    }

    pub(super) fn scaled(&mut self, sum: &Sum, by: &Term) -> Made<Sum> {
        sum.iter().map(|(term, id)| Ok((self.times(term, by)?, *id))).collect()
    }

    /// The node with this value.
    pub(super) fn id_of(&mut self, sum: &Sum) -> Made<Id> {
        if let [(weight, id)] = sum.as_slice()
            && weight.symbol.is_one()
            && weight.exact.value == Number::from(1)
        {
            return Ok(*id);
        }
        let key = key(sum);
        for &known in self.sums.get(&key).into_iter().flatten() {
            if matches!(&self.nodes[known].kind, Kind::Sum(other) if same(other, sum)) {
                return Ok(known);
            }
        }
        let fraction = sum.first().map_or(0.0, |(_, id)| self.nodes[*id].fraction);
        if sum.iter().any(|(_, id)| (self.nodes[*id].fraction - fraction).abs() > SAME) {
            return Err(Stop::Lost);
        }
        let n = sum.iter().map(|(_, id)| self.nodes[*id].series.len()).min().unwrap_or(self.n);
        let mut series = Self::zeros(n);
        let mut degree = Some(0);
        for (weight, id) in sum {
            let node = &self.nodes[*id];
            degree = degree.zip(node.degree).map(|(x, y): (usize, usize)| x.max(y));
            let of_node = node.series.clone();
            for (k, coefficient) in of_node.iter().take(n).enumerate() {
                for term in coefficient {
                    let term = self.times(term, weight)?;
                    add(&mut series[k], term);
                }
            }
        }
        let series = series.into_iter().map(settled).collect();
        let id = self.push(Lowered { kind: Kind::Sum(sum.clone()), series, fraction, degree });
        self.sums.entry(key).or_default().push(id);
        Ok(id)
    }

    /// A weight and the node it weighs.
    pub(super) fn weighted(&mut self, sum: &Sum) -> Made<(Term, Id)> {
        let symbol = match sum.as_slice() {
            [only] => return Ok(only.clone()),
            [(first, _), rest @ ..] if rest.iter().all(|(x, _)| x.symbol == first.symbol) => {
                first.symbol
            }
            _ => Symbol::ONE,
        };
        let mut apart = sum.clone();
        if !symbol.is_one() {
            apart.iter_mut().for_each(|(term, _)| term.symbol = Symbol::ONE);
        }
        Ok((Term::symbol(symbol), self.id_of(&apart)?))
    }

    pub(super) fn product(&mut self, x: &Sum, y: &Sum) -> Made<Sum> {
        for (constant, other) in [(x, y), (y, x)] {
            if Self::is_constant(constant) {
                let mut product = Sum::new();
                for (weight, _) in constant {
                    product = Self::added(&product, &self.scaled(other, weight)?);
                }
                return Ok(product);
            }
        }
        let ((a, x), (b, y)) = (self.weighted(x)?, self.weighted(y)?);
        Ok(vec![(self.times(&a, &b)?, self.product_of(x, y)?)])
    }

    pub(super) fn product_of(&mut self, x: Id, y: Id) -> Made<Id> {
        let (x, y) = (x.min(y), x.max(y));
        if x == ONE {
            return Ok(y);
        }
        if let Some(id) = self.products.get(&(x, y)) {
            return Ok(*id);
        }
        for (factor, quotient) in [(x, y), (y, x)] {
            if let Kind::Quotient(numerator, divisor) = self.nodes[quotient].kind
                && divisor == factor
            {
                return Ok(numerator);
            }
        }
        let [p, q] = [x, y].map(|id| self.nodes[id].clone());
        let mut series = self.product_of_series(&p.series, &q.series)?;
        let mut fraction = p.fraction + q.fraction;
        let mut degree = p.degree.zip(q.degree).map(|(x, y): (usize, usize)| x.saturating_add(y));
        if fraction >= 1.0 - SAME {
            // |e| = sign*e
            fraction -= 1.0;
            series.truncate(self.n - 1);
            series.insert(0, Coefficient::new());
            series = self.turned(&series);
            degree = degree.map(|degree| degree.saturating_add(1));
        }
        while fraction < -SAME && series.first().is_some_and(Vec::is_empty) {
            fraction += 1.0;
            series = self.turned(&series[1..]);
            degree = degree.map(|degree| degree.saturating_sub(1));
        }
        if fraction.abs() < SAME {
            fraction = 0.0;
        }
        let id = self.push(Lowered { kind: Kind::Product(x, y), series, fraction, degree });
        self.products.insert((x, y), id);
        Ok(id)
    }

    pub(super) fn quotient(&mut self, x: &Sum, y: &Sum) -> Made<Sum> {
        if x.is_empty() {
            return Ok(Sum::new());
        }
        if Self::is_constant(y) {
            let coefficient = y.iter().map(|(term, _)| term.clone()).collect();
            let divisor = self.one_term(&coefficient)?;
            let factor = self.inverse(&divisor)?;
            return self.scaled(x, &factor);
        }
        let ((a, x), (b, y)) = (self.weighted(x)?, self.weighted(y)?);
        let inverse = self.inverse(&b)?;
        let weight = self.times(&a, &inverse)?;
        if x == y {
            return Ok(vec![(weight, ONE)]);
        }
        Ok(vec![(weight, self.quotient_of(x, y)?)])
    }

    fn quotient_of(&mut self, x: Id, y: Id) -> Made<Id> {
        if let Kind::Product(a, b) = self.nodes[x].kind
            && (a == y || b == y)
        {
            return Ok(if a == y { b } else { a });
        }
        let b = self.order(y)?;
        if self.order(x)? < b {
            return Err(Stop::Lost);
        }
        let [p, q] = [x, y].map(|id| self.nodes[id].clone());
        let fraction = match (p.fraction, q.fraction) {
            (p, 0.0) => p,
            (p, q) if (p - q).abs() < SAME => 0.0,
            _ => return Err(Stop::Lost),
        };
        let series = self.quotient_of_series(&p.series, &q.series, b)?;
        Ok(self.push(Lowered { kind: Kind::Quotient(x, y), series, fraction, degree: None }))
    }

    /// `x/|e|^n`, where `n` is its order.
    pub(super) fn shifted(&mut self, x: Id, n: usize) -> Id {
        let node = self.nodes[x].clone();
        let mut series = node.series[n..].to_vec();
        if n % 2 == 1 {
            series = self.turned(&series);
        }
        let degree = node.degree.map(|degree| degree.saturating_sub(n));
        let fraction = node.fraction;
        self.push(Lowered { kind: Kind::Shifted(x, n), series, fraction, degree })
    }

    /// Its value at rest, and the node less that.
    pub(super) fn at_rest(&mut self, id: Id) -> Made<(Coefficient, Id)> {
        let value = self.nodes[id].series[0].clone();
        let mut change: Sum = vec![(Term::symbol(Symbol::ONE), id)];
        if let Kind::Sum(terms) = &self.nodes[id].kind {
            change = terms.clone();
        }
        let constant: Sum = value.iter().map(|term| (term.clone(), ONE)).collect();
        let change = Self::subtracted(&change, &constant);
        Ok((value, self.id_of(&change)?))
    }
}

/// Whether two linear combinations are the same, in whatever order.
fn same(x: &Sum, y: &Sum) -> bool {
    let has = |(term, id): &(Term, Id)| {
        y.iter().any(|(other, at)| {
            at == id && other.symbol == term.symbol && other.exact.value == term.exact.value
        })
    };
    x.len() == y.len() && x.iter().all(has)
}

/// The number that a coefficient is.
pub(super) fn plain_number(coefficient: &Coefficient) -> Option<Number> {
    as_number(coefficient).map(|term| term.exact.value)
}

/// A node without operands that matter here.
fn starting_nodes(n: usize) -> Vec<Lowered> {
    let one = || vec![Term::symbol(Symbol::ONE)];
    let at = |place: usize| {
        let mut series = vec![Coefficient::new(); n];
        series[place] = one();
        series
    };
    vec![
        Lowered { kind: Kind::One, series: at(0), fraction: 0.0, degree: Some(0) },
        Lowered { kind: Kind::Change, series: at(1), fraction: 0.0, degree: Some(1) },
    ]
}

/// Which nodes of a graph depend on the measure.
pub(super) fn varying(graph: &ExprGraph, is_varying: impl Fn(Node) -> bool) -> Vec<bool> {
    let mut varies: Vec<bool> = Vec::with_capacity(graph.len());
    for (_, node) in graph.nodes() {
        let varied = is_varying(node) || node.operands().any(|x| varies[x.0 as usize]);
        varies.push(varied);
    }
    varies
}
