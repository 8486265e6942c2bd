//! Measures of bonds, triangles and tetrahedra with their changes and derivatives.
//!
//! Everything is a function of vectors from one corner, the owner, to the others: reference vectors
//! `Xi` and relative displacements `eta`, with `xi = Xi + eta`. Derivatives are compact, that is
//! with respect to the other corners; the owner's follow because rigid translations change nothing
//! (its row is minus the sum of the rows of the others).
//!
//! Each measure `m` is differentiated through a polynomial `s(xi)`, its *variable*: `s = m` for the
//! signed measures, which are multilinear, and `s = m^2/2` for lengths and areas in space, which
//! are roots. Derivatives of `s` never divide and exist at `m = 0`; [`Variable::slopes`] turns
//! `psi'(m)`, `psi''(m)` into derivatives in `s`. Laws that are functions of `m^2` take it without its
//! root ([`squares`]).

pub mod bond;
pub mod double;
pub mod lanes;
pub mod squares;
pub mod tetrahedron;
pub mod triangle;

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number the geometry can be evaluated in: `f64` or several of them at once.
pub trait Scalar:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The number `x`, in every lane that this one has.
    fn alike(self, x: f64) -> Self;
    /// Correctly rounded square root.
    fn sqrt(self) -> Self;
    /// 1 with the sign of the number.
    fn sign(self) -> Self;
    /// `yes` in the lanes where `self == other`, `no` in all others.
    fn where_equal(self, other: Self, yes: Self, no: Self) -> Self;
}

impl Scalar for f64 {
    #[inline(always)]
    fn alike(self, x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn sqrt(self) -> f64 {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn sign(self) -> f64 {
        1f64.copysign(self)
    }
    #[inline(always)]
    fn where_equal(self, other: f64, yes: f64, no: f64) -> f64 {
        if self == other { yes } else { no }
    }
}

/// A measure now and at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change<T> {
    /// Now, `m`.
    pub measure: T,
    /// At rest, `M > 0`.
    pub reference: T,
    /// `(m - M)/M`, computed from the displacements: it keeps its digits however small it is.
    pub change: T,
    /// `dm/ds`, where it is the same for all `m`: 1 or -1, which makes the reference of a signed
    /// measure positive, `2/M` for `q = m^2/M`; 1 for roots, whose slope [`Variable::slopes`] knows.
    pub slope: T,
}

/// How the variable `s` of a measure follows from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variable {
    /// `s = m` or `s = -m`, for the signed measures.
    Measure,
    /// `s = m^2/2`, for the roots.
    HalfSquare,
    /// `s = M*q/2`, for the squares of roots: `q = m^2/M` has the place of the measure.
    Square,
}

impl Variable {
    /// `(dpsi/ds, d2psi/ds2)` from psi' and psi''; `slope` is that of [`Change`].
    ///
    /// For roots these are `psi'/m` and `(psi'' - psi'/m)/m^2`. At `m = 0` an energy with
    /// `psi'(0) = 0` is smooth and `psi'/m` tends to `psi''(0)`; the second slope then multiplies
    /// `ds = 0` and is left out. An energy with `psi'(0) != 0` has a kink there: the slopes are
    /// infinite, and the caller reports it.
    #[inline(always)]
    pub fn slopes<T: Scalar>(self, measure: T, slope: T, first: T, second: T) -> (T, T) {
        match self {
            Variable::Measure | Variable::Square => (first * slope, second * (slope * slope)),
            Variable::HalfSquare => {
                let (zero, one) = (measure.alike(0.0), measure.alike(1.0));
                let is_smooth = measure.where_equal(zero, first.where_equal(zero, one, zero), zero);
                let over = is_smooth.where_equal(one, second, first / measure);
                let rest = (second - over) / (measure * measure);
                (over, is_smooth.where_equal(one, zero, rest))
            }
        }
    }

    /// The square of the length, area or volume.
    #[inline(always)]
    pub fn square<T: Scalar>(self, measure: T, reference: T) -> T {
        match self {
            Variable::Measure | Variable::HalfSquare => measure * measure,
            Variable::Square => measure * reference,
        }
    }

    /// The length, area or volume.
    pub fn value(self, measure: f64, reference: f64) -> f64 {
        match self {
            Variable::Measure | Variable::HalfSquare => measure,
            Variable::Square => (measure * reference).sqrt(),
        }
    }
}

/// One kind of measure in one dimension. `C` numbers hold the vectors to the other corners, one
/// after the other.
pub trait Geometry<const C: usize> {
    /// The variable it is differentiated through.
    const VARIABLE: Variable;

    /// The square of the largest measure that vectors of these lengths can span; nothing where a
    /// measure holds no difference of products. A measure far below it has lost digits.
    fn largest_square<T: Scalar>(vectors: &[T; C]) -> Option<T>;

    /// The measure and its change, from reference vectors and relative displacements.
    fn change<T: Scalar>(reference: &[T; C], displacement: &[T; C]) -> Change<T>;

    /// `ds/dxi` for positive orientation, from the current vectors.
    fn gradient<T: Scalar>(current: &[T; C]) -> [T; C];

    /// `first*d2s/dxi2 + second*(ds/dxi)(ds/dxi)` for positive orientation: hands each entry of
    /// the upper triangle to `emit` with its [`packed`] place. `gradient` is `ds/dxi`.
    fn hessian<T: Scalar>(
        current: &[T; C],
        gradient: &[T; C],
        first: T,
        second: T,
        emit: impl FnMut(usize, T),
    );
}

/// Place of entry `(row, column)`, `row <= column`, in the upper triangle of a symmetric matrix of
/// `size` rows stored row by row.
#[inline(always)]
pub const fn packed(size: usize, row: usize, column: usize) -> usize {
    row * size - row * (row + 1) / 2 + column
}

/// How many entries the upper triangle of a symmetric matrix of `size` rows has.
pub const fn packed_len(size: usize) -> usize {
    size * (size + 1) / 2
}

/// `number(0), number(1), ..`. Unlike the standard library's functions it always becomes part of its
/// caller, and only so do the numbers of a vector register stay in registers. It calls `number` from two places:
/// what is longer than a line or two may then be a function of its own, and goes in a loop where it counts.
#[inline(always)]
pub(crate) fn each<T: Copy, const N: usize>(number: impl Fn(usize) -> T) -> [T; N] {
    let mut all = [number(0); N];
    for k in 1..N {
        all[k] = number(k);
    }
    all
}

/// The vector number `index` of `C` numbers.
#[inline(always)]
fn vector<T: Scalar, const C: usize, const D: usize>(all: &[T; C], index: usize) -> [T; D] {
    each(|axis| all[index * D + axis])
}

#[inline(always)]
fn add<T: Scalar, const D: usize>(p: &[T; D], q: &[T; D]) -> [T; D] {
    each(|axis| p[axis] + q[axis])
}

#[inline(always)]
pub(crate) fn dot<T: Scalar, const D: usize>(p: &[T; D], q: &[T; D]) -> T {
    let mut sum = p[0] * q[0];
    for axis in 1..D {
        sum = sum + p[axis] * q[axis];
    }
    sum
}

#[inline(always)]
pub(crate) fn cross<T: Scalar>(p: &[T; 3], q: &[T; 3]) -> [T; 3] {
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
}

#[inline(always)]
fn cross_2d<T: Scalar>(p: &[T; 2], q: &[T; 2]) -> T {
    p[0] * q[1] - p[1] * q[0]
}

#[cfg(test)]
pub(crate) mod check;
