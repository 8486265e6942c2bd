//! Bonds: `l = |xi|`, the measure of one-neighbour interactions (javili2020, Eq. (20), first line).

use super::squares::{Root, Squares};
use super::{Change, Geometry, Scalar, Variable, add, dot, packed};

/// Length of a bond in `D` dimensions, in m; `s = l^2/2`.
#[derive(Debug)]
pub struct Bond;

impl<const D: usize> Geometry<D> for Bond {
    const VARIABLE: Variable = Variable::HalfSquare;

    fn largest_square<T: Scalar>(_vectors: &[T; D]) -> Option<T> {
        None
    }

    #[inline(always)]
    fn change<T: Scalar>(reference: &[T; D], displacement: &[T; D]) -> Change<T> {
        Self::squares(reference, displacement).roots()
    }

    #[inline(always)]
    fn gradient<T: Scalar>(current: &[T; D]) -> [T; D] {
        *current
    }

    #[inline(always)]
    fn hessian<T: Scalar>(
        _current: &[T; D],
        gradient: &[T; D],
        first: T,
        second: T,
        mut emit: impl FnMut(usize, T),
    ) {
        for row in 0..D {
            let scaled = second * gradient[row];
            emit(packed(D, row, row), scaled * gradient[row] + first);
            for column in row + 1..D {
                emit(packed(D, row, column), scaled * gradient[column]);
            }
        }
    }
}

impl<const D: usize> Root<D> for Bond {
    /// `l^2 - L^2 = eta.(2*Xi + eta)`: no difference of nearly equal numbers.
    #[inline(always)]
    fn squares<T: Scalar>(reference: &[T; D], displacement: &[T; D]) -> Squares<T> {
        let current = add(reference, displacement);
        Squares {
            now: dot(&current, &current),
            at_rest: dot(reference, reference),
            grown: dot(displacement, &add(reference, &current)),
        }
    }
}

#[cfg(test)]
mod tests {
    use num_dual::DualNum;

    use super::*;
    use crate::geometry::check::{check_derivatives, int_vectors};

    #[test]
    fn derivatives_agree_with_hyper_dual_numbers() {
        check_derivatives::<Bond, 2>(|x, _| (x[0] * x[0] + x[1] * x[1]).sqrt());
        check_derivatives::<Bond, 3>(|x, _| (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt());
    }

    #[test]
    fn a_uniform_stretch_is_recovered_to_the_last_digits() {
        let stretch = libm::scalbn(1.0, -47);
        for reference in int_vectors::<3>(200) {
            let displacement = reference.map(|x| x * stretch);
            let change = Bond::change(&reference, &displacement).change;
            assert!((change - stretch).abs() <= 6.0 * f64::EPSILON * stretch, "{change:e}");
        }
    }

    #[test]
    fn a_transversal_displacement_stretches_quadratically() {
        // l/L - 1 = sqrt(1 + t^2) - 1 = t^2/2 - t^4/8 + ..; the next term is below rounding.
        for t in [1e-3, 1e-7, 1e-14, 1e-100] {
            let change = Bond::change(&[2.0, 0.0], &[0.0, 2.0 * t]).change;
            let exact = t * t / 2.0 - t * t * t * t / 8.0 + t * t * t * t * t * t / 16.0;
            assert!((change - exact).abs() <= 4.0 * f64::EPSILON * exact, "{t:e}: {change:e}");
        }
    }
}
