//! Sums of cofactors with any numbers, as of fibres: `I1*I4(n) - I5(n)` and `mu*J*(n*inv(F)*m)`.
//!
//! What is a sum of cofactors of `F`, or of products of two, is found from its values: where `cof(F)` is
//! the identity, or a shear of it, they are its coefficients. Modulo a prime they tell whether the function
//! is that sum everywhere; in 256 bits they are the numbers that stand in its new form, to all their digits.
//! A sum of products whose coefficients are those of squares is a sum of squares, which does not cancel.

use super::{BY_INVERSE, INVARIANTS, Rational, Rule, Values, cofactors, rationals, volume};
use crate::expression::graph::components;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, Operator, TooManyNodes};
use crate::near::{Exact, Number};
use crate::point::modular::{Modular, PLACES};
use crate::simplify::Simplifier;

/// At how many `F` coefficients are read off.
pub(super) const PROBES: usize = 10;

/// What is below this power of two of the largest coefficient is rounding.
const NOTHING: i64 = -180;

/// Squares below this power of two of the largest may have the other sign: directions that are typed in
/// have lengths that differ from 1 by roundings.
const ROUNDED: i64 = -40;

/// Doubles that a number of 256 bits is the sum of.
const PIECES: usize = 5;

type Found = Option<(&'static Rule, NodeId, f64)>;

/// `F` of volume 1 whose cofactors are, in turn: the identity; `I + e_i e_j`, for every `i` and `j` that
/// differ, row by row; `[[1, 1], [1, 2]]` in the rows and columns `i` and `i + 1`. In two dimensions there
/// are fewer, and the last stand for nothing.
pub(super) fn probes(d: usize) -> [[[i8; 3]; 3]; PROBES] {
    let identity = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    let mut all = [identity; PROBES];
    for (n, (i, j)) in pairs(d).enumerate() {
        all[1 + n][j][i] = -1;
    }
    for (n, (i, j)) in planes(d).enumerate() {
        let probe = &mut all[1 + pairs(d).count() + n];
        (probe[i][i], probe[i][j], probe[j][i]) = (2, -1, -1);
    }
    all
}

fn pairs(d: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..d).flat_map(move |i| (0..d).map(move |j| (i, j))).filter(|(i, j)| i != j)
}

fn planes(d: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..if d == 2 { 1 } else { 3 }).map(move |i| (i, (i + 1) % d))
}

/// What coefficients are made of.
trait Field: Clone {
    fn plus(&self, other: &Self) -> Self;
    /// Times a power of two, or a small whole number.
    fn times(&self, by: f64) -> Self;
}

impl Field for Modular {
    fn plus(&self, other: &Self) -> Self {
        *self + *other
    }
    fn times(&self, by: f64) -> Self {
        Modular::of(by).map_or(*self, |by| *self * by)
    }
}

impl Field for Number {
    fn plus(&self, other: &Self) -> Self {
        self + other
    }
    fn times(&self, by: f64) -> Self {
        self * &Number::from(by)
    }
}

/// A space of functions.
#[derive(Clone, Copy, PartialEq)]
enum Space {
    /// `A : cof(F)`
    Linear,
    /// `A : (cof(F)'*cof(F))` with a symmetric `A`.
    Columns,
    /// `A : (cof(F)*cof(F)')` with a symmetric `A`.
    Rows,
    /// `a*J^2`
    Volume,
}

impl Space {
    /// `A` of the member of this space that has these values at the probes.
    fn coefficients<T: Field>(self, values: &[T], d: usize) -> [[T; 3]; 3] {
        let at_rest = &values[0];
        let none = at_rest.times(0.0);
        let mut sheared = [[0; 3]; 3].map(|row| row.map(|_: i32| none.clone()));
        if self == Space::Volume {
            sheared[0][0] = at_rest.clone();
            return sheared;
        }
        let minus = |x: &T, y: &T| x.plus(&y.times(-1.0));
        for (n, (i, j)) in pairs(d).enumerate() {
            let (i, j) = if self == Space::Rows { (j, i) } else { (i, j) };
            sheared[i][j] = minus(&values[1 + n], at_rest);
        }
        let mut all = sheared.clone();
        for (n, (i, j)) in planes(d).enumerate() {
            let plane = minus(&values[1 + pairs(d).count() + n], at_rest);
            let (right, left) = (&sheared[i][j], &sheared[j][i]);
            if self == Space::Linear {
                // a_ij + a_ji + a_jj
                all[j][j] = minus(&plane, &right.plus(left));
                if d == 2 {
                    all[i][i] = minus(at_rest, &all[j][j]);
                }
            } else {
                // 2*a_ij + a_jj, 2*a_ij + a_ii, a_ii + 6*a_ij + 4*a_jj
                let both = minus(&left.plus(&right.times(4.0)), &plane).times(0.25);
                all[j][j] = minus(right, &both.times(2.0));
                all[i][i] = minus(left, &both.times(2.0));
                (all[i][j], all[j][i]) = (both.clone(), both);
            }
        }
        all
    }
}

/// Sums of the cofactors of `F`, in the graph of the forms.
pub(super) struct Combinations<'a> {
    forms: &'a mut Simplifier,
    d: usize,
    /// Row by row.
    cofactors: Vec<NodeId>,
    values: Vec<Values>,
    volume: (NodeId, Values),
}

/// Where sums of squares do not cancel.
const SQUARES: [Space; 2] = [Space::Columns, Space::Rows];

impl Combinations<'_> {
    pub(super) fn new(forms: &mut Simplifier, d: usize) -> Result<Combinations<'_>, TooManyNodes> {
        let mut gradient = Vec::new();
        for k in components(d) {
            gradient.push(forms.input(Input::Variable(k))?);
        }
        let cofactors = cofactors(forms, &gradient)?;
        let volume = volume(forms, &gradient, &cofactors)?;
        let known = rationals(forms.graph(), d);
        let values = |id: NodeId| {
            known[id.0 as usize].map_or([Modular::whole(0); PLACES + PROBES], |x| x.values)
        };
        let volume = (volume, values(volume));
        let values = cofactors.iter().map(|id| values(*id)).collect();
        Ok(Combinations { forms, d, cofactors, values, volume })
    }

    /// The form of a node of another graph, whose values these are, if it is such a sum.
    pub(super) fn form(
        &mut self,
        graph: &ExprGraph,
        id: NodeId,
        x: &Rational,
    ) -> Result<Found, TooManyNodes> {
        let (name, spaces): (_, &[Space]) = match graph[id] {
            Node::Binary(Operator::Add | Operator::Subtract, ..) if !x.is_over_volume => {
                // The cofactors of a plane gradient are its components.
                ("cofactor_of_fibre", if self.d == 2 { &[Space::Volume] } else { &SQUARES })
            }
            Node::Binary(Operator::Multiply | Operator::Divide, ..) if x.is_over_volume => {
                (BY_INVERSE, &[Space::Linear, Space::Columns, Space::Rows])
            }
            _ => return Ok(None),
        };
        let found = spaces.iter().copied().find(|space| self.holds(*space, &x.values));
        let Some(space) = found else { return Ok(None) };
        let Some(numbers) = numbers(graph, id, self.d) else { return Ok(None) };
        let coefficients = space.coefficients(&numbers, self.d);
        let squares = match space {
            Space::Columns | Space::Rows => squares(&coefficients, self.d),
            Space::Linear | Space::Volume => None,
        };
        let form = match squares {
            Some(squares) => self.sum_of_squares(space, &squares)?,
            None if spaces == SQUARES => return Ok(None),
            None => self.sum(space, &coefficients)?,
        };
        Ok(INVARIANTS.iter().find(|rule| rule.name == name).map(|rule| (rule, form, 1.0)))
    }

    /// Whether a function is in a space, and not 0: it is the member that its values at the probes ask for.
    fn holds(&self, space: Space, values: &Values) -> bool {
        let d = self.d;
        let coefficients = space.coefficients(&values[PLACES..], d);
        if values[..PLACES].iter().all(|value| *value == Modular::whole(0)) {
            return false;
        }
        let entry = |i: usize, j: usize, place: usize| self.values[d * i + j][place];
        (0..PLACES).all(|place| {
            let mut sum = -values[place];
            for (i, j) in (0..d).flat_map(|i| (0..d).map(move |j| (i, j))) {
                let product = |k| match space {
                    Space::Columns => entry(k, i, place) * entry(k, j, place),
                    _ => entry(i, k, place) * entry(j, k, place),
                };
                let member = match space {
                    Space::Volume => self.volume.1[place] * self.volume.1[place],
                    Space::Linear => entry(i, j, place),
                    Space::Columns | Space::Rows => {
                        (1..d).fold(product(0), |sum, k| sum + product(k))
                    }
                };
                sum = sum + coefficients[i][j] * member;
            }
            sum == Modular::whole(0)
        })
    }

    /// The sum of the squares of the components of `cof(F)*w`, or `cof(F)'*w`, each with its number.
    fn sum_of_squares(
        &mut self,
        space: Space,
        squares: &[(Number, [Number; 3])],
    ) -> Result<NodeId, TooManyNodes> {
        let mut sum = self.forms.number(0.0)?;
        for (number, vector) in squares {
            let mut square = self.forms.number(0.0)?;
            for i in 0..self.d {
                let mut component = self.forms.number(0.0)?;
                for (j, w) in vector.iter().enumerate().take(self.d) {
                    let at = if space == Space::Columns { self.d * i + j } else { self.d * j + i };
                    component = self.add(component, w, self.cofactors[at])?;
                }
                let product = self.forms.multiply(component, component)?;
                square = self.forms.add(square, product)?;
            }
            sum = self.add(sum, number, square)?;
        }
        Ok(sum)
    }

    /// The sum of the entries with these numbers.
    fn sum(&mut self, space: Space, numbers: &[[Number; 3]; 3]) -> Result<NodeId, TooManyNodes> {
        let d = self.d;
        let mut sum = self.forms.number(0.0)?;
        if space == Space::Volume {
            let squared = self.forms.multiply(self.volume.0, self.volume.0)?;
            return self.add(sum, &numbers[0][0], squared);
        }
        for (i, j) in (0..d).flat_map(|i| (0..d).map(move |j| (i, j))) {
            if space == Space::Linear {
                sum = self.add(sum, &numbers[i][j], self.cofactors[d * i + j])?;
                continue;
            }
            if numbers[i][j].is_zero() || j < i {
                continue;
            }
            let mut entry = self.forms.number(0.0)?;
            for k in 0..d {
                let at = |i| if space == Space::Columns { d * k + i } else { d * i + k };
                let product = self.forms.multiply(self.cofactors[at(i)], self.cofactors[at(j)])?;
                entry = self.forms.add(entry, product)?;
            }
            let twice = if i == j { 1.0 } else { 2.0 };
            sum = self.add(sum, &numbers[i][j].times(twice), entry)?;
        }
        Ok(sum)
    }

    /// `sum + number*node`
    fn add(&mut self, sum: NodeId, number: &Number, node: NodeId) -> Result<NodeId, TooManyNodes> {
        let mut rest = number.clone();
        let mut factor = self.forms.number(0.0)?;
        for _ in 0..PIECES {
            let piece = rest.to_f64();
            let node = self.forms.number(piece)?;
            factor = self.forms.add(factor, node)?;
            rest = rest.plus(&Number::from(piece).times(-1.0));
            if rest.is_zero() {
                break;
            }
        }
        let term = self.forms.multiply(factor, node)?;
        self.forms.add(sum, term)
    }
}

/// The values of a node at the probes in 256 bits; nothing where it has none.
fn numbers(graph: &ExprGraph, id: NodeId, d: usize) -> Option<Vec<Number>> {
    let needed = graph.reachable(&[id]);
    let at = |probe: &[[i8; 3]; 3]| {
        let mut known: Vec<Number> = Vec::with_capacity(needed.len());
        for (_, node) in graph.nodes().take(id.0 as usize + 1) {
            let of = |x: NodeId| &known[x.0 as usize];
            known.push(match node {
                _ if !needed[known.len()] => Number::NONE,
                Node::Number(bits) => Number::from(f64::from_bits(bits)),
                Node::Input(Input::Variable(k)) => {
                    Number::from(i32::from(probe[usize::from(k / 3)][usize::from(k % 3)]))
                }
                Node::Unary(Function::Negate, x) => -of(x),
                Node::Unary(function, x) => Exact::new(of(x).clone()).function(function).value,
                Node::PowerConstant(x, bits) => of(x).power(&Number::from(f64::from_bits(bits))),
                Node::Binary(Operator::Add, x, y) => of(x) + of(y),
                Node::Binary(Operator::Subtract, x, y) => of(x) - of(y),
                Node::Binary(Operator::Multiply, x, y) => of(x) * of(y),
                Node::Binary(Operator::Divide, x, y) => of(x) / of(y).only_if(!of(y).is_zero()),
                _ => Number::NONE,
            });
        }
        known.pop().filter(Number::is_number)
    };
    probes(d).iter().map(at).collect()
}

/// A symmetric matrix as a sum of squares, `A = sum of c*w*w'` where all `c` have one sign; nothing where
/// they have not.
fn squares(matrix: &[[Number; 3]; 3], d: usize) -> Option<Vec<(Number, [Number; 3])>> {
    let mut rest = matrix.clone();
    let size = |x: &Number| x.magnitude().unwrap_or(i64::MIN);
    let largest = rest.iter().flatten().map(size).max()?;
    let is_nothing = |x: &Number| size(x) < largest.saturating_add(NOTHING);
    let mut all: Vec<(Number, [Number; 3])> = Vec::new();
    for _ in 0..d {
        let Some(pivot) = (0..d).filter(|i| !is_nothing(&rest[*i][*i])).max_by(|i, j| {
            let order = rest[*i][*i].size().partial_cmp(&rest[*j][*j].size());
            order.unwrap_or(std::cmp::Ordering::Equal)
        }) else {
            break;
        };
        let number = rest[pivot][pivot].clone();
        let vector = rest[pivot]
            .each_ref()
            .map(|x| if is_nothing(x) { Number::from(0) } else { x / &number });
        for i in 0..d {
            for j in 0..d {
                rest[i][j] = rest[i][j].plus(&(&(&number * &vector[i]) * &vector[j]).times(-1.0));
            }
        }
        all.push((number, vector));
    }
    let is_whole = rest.iter().flatten().all(is_nothing);
    // The first is the largest.
    let (first, _) = all.first()?;
    let has_sign = |x: &Number| {
        x.is_positive() == first.is_positive() || size(x) < size(first).saturating_add(ROUNDED)
    };
    (is_whole && all.iter().all(|(number, _)| has_sign(number))).then_some(all)
}
