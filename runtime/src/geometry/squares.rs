//! Squares of the measures that are roots: `l^2` and, in space, `a^2`.
//!
//! They and their change follow from vectors by sums and products. For an energy that is a function of
//! them, `q = m^2/M` has the place of the measure: it needs no root of the current one, its variable
//! `s = m^2/2` is proportional to it, so that no derivative is divided by a measure, and 0 is a number
//! like any other.

use super::{Change, Geometry, Scalar, Variable};

/// The square of a measure now and at rest.
#[derive(Clone, Copy, Debug)]
pub struct Squares<T> {
    /// Now, `m^2`.
    pub now: T,
    /// At rest, `M^2 > 0`.
    pub at_rest: T,
    /// `m^2 - M^2`, computed from the displacements: it keeps its digits however small it is.
    pub grown: T,
}

impl<T: Scalar> Squares<T> {
    /// The measure: `(m - M)/M = (m^2 - M^2)/(M*(m + M))`.
    #[inline(always)]
    pub(super) fn roots(self) -> Change<T> {
        let (now, at_rest) = (self.now.sqrt(), self.at_rest.sqrt());
        Change {
            measure: now,
            reference: at_rest,
            change: self.grown / (at_rest * (now + at_rest)),
            slope: at_rest.alike(1.0),
        }
    }
}

/// A geometry whose measure is a root.
pub trait Root<const C: usize>: Geometry<C> {
    /// The square of the measure, from reference vectors and relative displacements.
    fn squares<T: Scalar>(reference: &[T; C], displacement: &[T; C]) -> Squares<T>;
}

/// The geometry `G` for laws of the squared measure: what it calls the measure is `q = m^2/M`.
#[derive(Debug)]
pub struct Squared<G>(G);

impl<G: Root<C>, const C: usize> Geometry<C> for Squared<G> {
    const VARIABLE: Variable = Variable::Square;

    #[inline(always)]
    fn largest_square<T: Scalar>(vectors: &[T; C]) -> Option<T> {
        G::largest_square(vectors)
    }

    #[inline(always)]
    fn change<T: Scalar>(reference: &[T; C], displacement: &[T; C]) -> Change<T> {
        let Squares { now, at_rest, grown } = G::squares(reference, displacement);
        let over = at_rest.alike(1.0) / at_rest;
        let reference = at_rest.sqrt();
        let over_reference = reference * over;
        Change {
            measure: now * over_reference,
            reference,
            change: grown * over,
            slope: over_reference + over_reference,
        }
    }

    #[inline(always)]
    fn gradient<T: Scalar>(current: &[T; C]) -> [T; C] {
        G::gradient(current)
    }

    #[inline(always)]
    fn hessian<T: Scalar>(
        current: &[T; C],
        gradient: &[T; C],
        first: T,
        second: T,
        emit: impl FnMut(usize, T),
    ) {
        G::hessian(current, gradient, first, second, emit);
    }
}
