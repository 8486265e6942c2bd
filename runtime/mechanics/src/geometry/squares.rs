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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::bond::Bond;
    use crate::geometry::check::{check_derivatives, int_vectors};
    use crate::geometry::triangle::SpaceTriangle;

    #[test]
    fn derivatives_agree_with_hyper_dual_numbers() {
        // m^2/M with 1/M from the slope 2/M.
        check_derivatives::<Squared<Bond>, 2>(|x, slope| {
            (x[0] * x[0] + x[1] * x[1]) * (0.5 * slope)
        });
        check_derivatives::<Squared<Bond>, 3>(|x, slope| {
            (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) * (0.5 * slope)
        });
        check_derivatives::<Squared<SpaceTriangle>, 6>(|x, slope| {
            let c0 = x[1] * x[5] - x[2] * x[4];
            let c1 = x[2] * x[3] - x[0] * x[5];
            let c2 = x[0] * x[4] - x[1] * x[3];
            (c0 * c0 + c1 * c1 + c2 * c2) * (0.5 * slope)
        });
    }

    #[test]
    fn a_uniform_stretch_is_recovered_to_the_last_digits() {
        let stretch = libm::scalbn(1.0, -47);
        // (1 + e)^2 - 1
        let exact = stretch * (2.0 + stretch);
        for reference in int_vectors::<3>(200) {
            let found = Squared::<Bond>::change(&reference, &reference.map(|x| x * stretch));
            assert!((found.change - exact).abs() <= 6.0 * f64::EPSILON * exact, "{found:?}");
        }
    }

    #[test]
    fn vectors_of_the_size_of_atoms_and_of_nothing() {
        let small = [3e-10, -4e-10, 0.0, 1e-10, 5e-10, 2e-10];
        let found = Squared::<SpaceTriangle>::change(&small, &[0.0; 6]);
        let expected = SpaceTriangle::change(&small, &[0.0; 6]);
        assert!((found.measure / expected.measure - 1.0).abs() <= 4.0 * f64::EPSILON);
        assert_eq!((found.reference, found.change), (expected.reference, 0.0));
        let collapsed = Squared::<Bond>::change(&[1.0, 2.0], &[-1.0, -2.0]);
        assert_eq!((collapsed.measure, collapsed.change), (0.0, -1.0));
    }
}
