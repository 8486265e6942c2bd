//! Triangles: `a = |xi1 x xi2|`, twice their area (javili2020, Eq. (20), second line).

use super::squares::{Root, Squares};
use super::{Change, Geometry, Scalar, Variable, add, cross, cross_2d, dot, each, packed, vector};

/// Area measure of a triangle in the plane, in m^2: signed by its orientation at rest, so that it
/// is positive until the triangle turns inside out; `s = a`.
#[derive(Debug)]
pub struct PlaneTriangle;

impl Geometry<4> for PlaneTriangle {
    const VARIABLE: Variable = Variable::Measure;

    #[inline(always)]
    fn largest_square<T: Scalar>(vectors: &[T; 4]) -> Option<T> {
        let x: [[T; 2]; 2] = each(|corner| vector(vectors, corner));
        Some(dot(&x[0], &x[0]) * dot(&x[1], &x[1]))
    }

    /// `a - A = Xi1 x eta2 + eta1 x xi2`.
    #[inline(always)]
    fn change<T: Scalar>(reference: &[T; 4], displacement: &[T; 4]) -> Change<T> {
        let current = add(reference, displacement);
        let (x1, x2) = (vector::<T, 4, 2>(&current, 0), vector::<T, 4, 2>(&current, 1));
        let (rest1, rest2) = (vector::<T, 4, 2>(reference, 0), vector::<T, 4, 2>(reference, 1));
        let (eta1, eta2) = (vector::<T, 4, 2>(displacement, 0), vector::<T, 4, 2>(displacement, 1));
        let at_rest = cross_2d(&rest1, &rest2);
        let grown = cross_2d(&rest1, &eta2) + cross_2d(&eta1, &x2);
        let orientation = at_rest.sign();
        Change {
            measure: orientation * cross_2d(&x1, &x2),
            reference: orientation * at_rest,
            change: grown / at_rest,
            slope: orientation,
        }
    }

    #[inline(always)]
    fn gradient<T: Scalar>(x: &[T; 4]) -> [T; 4] {
        [x[3], -x[2], -x[1], x[0]]
    }

    #[inline(always)]
    fn hessian<T: Scalar>(
        _current: &[T; 4],
        gradient: &[T; 4],
        first: T,
        second: T,
        mut emit: impl FnMut(usize, T),
    ) {
        for row in 0..4 {
            let scaled = second * gradient[row];
            for column in row..4 {
                let rank_one = scaled * gradient[column];
                let entry = match (row, column) {
                    (0, 3) => rank_one + first,
                    (1, 2) => rank_one - first,
                    _ => rank_one,
                };
                emit(packed(4, row, column), entry);
            }
        }
    }
}

/// Area measure of a triangle in space, in m^2, never negative; `s = a^2/2`.
///
/// Areas are plain differences of products: their error is below `8u |xi1||xi2|`. Thin triangles are
/// worked out in twice the digits ([`super::double`]).
#[derive(Debug)]
pub struct SpaceTriangle;

impl Geometry<6> for SpaceTriangle {
    const VARIABLE: Variable = Variable::HalfSquare;

    #[inline(always)]
    fn largest_square<T: Scalar>(vectors: &[T; 6]) -> Option<T> {
        let x: [[T; 3]; 2] = each(|corner| vector(vectors, corner));
        Some(dot(&x[0], &x[0]) * dot(&x[1], &x[1]))
    }

    #[inline(always)]
    fn change<T: Scalar>(reference: &[T; 6], displacement: &[T; 6]) -> Change<T> {
        Self::squares(reference, displacement).roots()
    }

    /// `ds/dxi1 = xi2 x c`, `ds/dxi2 = c x xi1`.
    #[inline(always)]
    fn gradient<T: Scalar>(current: &[T; 6]) -> [T; 6] {
        let (x1, x2) = (vector::<T, 6, 3>(current, 0), vector::<T, 6, 3>(current, 1));
        let normal = cross(&x1, &x2);
        let (p, q) = (cross(&x2, &normal), cross(&normal, &x1));
        [p[0], p[1], p[2], q[0], q[1], q[2]]
    }

    /// `d2s/dxi1dxi1 = |xi2|^2 I - xi2 xi2`, `d2s/dxi2dxi2 = |xi1|^2 I - xi1 xi1` and
    /// `d2s/dxi1dxi2 = 2 xi1 xi2 - xi2 xi1 - (xi1.xi2) I`.
    #[inline(always)]
    fn hessian<T: Scalar>(
        current: &[T; 6],
        gradient: &[T; 6],
        first: T,
        second: T,
        mut emit: impl FnMut(usize, T),
    ) {
        let (x1, x2) = (vector::<T, 6, 3>(current, 0), vector::<T, 6, 3>(current, 1));
        let (f1, f2): ([T; 3], [T; 3]) = (each(|k| first * x1[k]), each(|k| first * x2[k]));
        let (square1, square2, product) = (dot(&f1, &x1), dot(&f2, &x2), dot(&f1, &x2));
        let scaled: [T; 6] = each(|k| second * gradient[k]);
        for row in 0..3 {
            for column in row..3 {
                let near = scaled[row] * gradient[column] - f2[row] * x2[column];
                let far = scaled[row + 3] * gradient[column + 3] - f1[row] * x1[column];
                let diagonal = row == column;
                emit(packed(6, row, column), if diagonal { near + square2 } else { near });
                let far = if diagonal { far + square1 } else { far };
                emit(packed(6, row + 3, column + 3), far);
            }
            for column in 0..3 {
                let twice = f1[row] * x2[column];
                let mixed =
                    scaled[row] * gradient[column + 3] + (twice + twice) - f2[row] * x1[column];
                emit(
                    packed(6, row, column + 3),
                    if row == column { mixed - product } else { mixed },
                );
            }
        }
    }
}

impl Root<6> for SpaceTriangle {
    /// `a^2 - A^2 = (c - C).(c + C)` with the normals `C = Xi1 x Xi2`, `c = xi1 x xi2` and
    /// `c - C = Xi1 x eta2 + eta1 x xi2`.
    #[inline(always)]
    fn squares<T: Scalar>(reference: &[T; 6], displacement: &[T; 6]) -> Squares<T> {
        let current = add(reference, displacement);
        let (x1, x2) = (vector::<T, 6, 3>(&current, 0), vector::<T, 6, 3>(&current, 1));
        let (rest1, rest2) = (vector::<T, 6, 3>(reference, 0), vector::<T, 6, 3>(reference, 1));
        let (eta1, eta2) = (vector::<T, 6, 3>(displacement, 0), vector::<T, 6, 3>(displacement, 1));
        let normal_at_rest = cross(&rest1, &rest2);
        let normal = cross(&x1, &x2);
        let grown = add(&cross(&rest1, &eta2), &cross(&eta1, &x2));
        Squares {
            now: dot(&normal, &normal),
            at_rest: dot(&normal_at_rest, &normal_at_rest),
            grown: dot(&grown, &add(&normal, &normal_at_rest)),
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
        check_derivatives::<PlaneTriangle, 4>(|x, sign| (x[0] * x[3] - x[1] * x[2]) * sign);
        check_derivatives::<SpaceTriangle, 6>(|x, _| {
            let c0 = x[1] * x[5] - x[2] * x[4];
            let c1 = x[2] * x[3] - x[0] * x[5];
            let c2 = x[0] * x[4] - x[1] * x[3];
            (c0 * c0 + c1 * c1 + c2 * c2).sqrt()
        });
    }

    #[test]
    fn changes_in_the_plane_are_exact_to_the_bar() {
        // Integer vectors and displacements that are multiples of 2^-47: exact in 128-bit integers.
        let unit = 1i128 << 47;
        let (references, etas) = (int_vectors::<4>(300), int_vectors::<4>(301));
        for (reference, eta) in references.iter().zip(&etas[1..]) {
            let whole: [i128; 4] = std::array::from_fn(|k| reference[k] as i128);
            let small: [i128; 4] = std::array::from_fn(|k| eta[k] as i128);
            let displacement = eta.map(|x| x / unit as f64);
            let current: [i128; 4] = std::array::from_fn(|k| whole[k] * unit + small[k]);
            let area = |p: &[i128; 4]| p[0] * p[3] - p[1] * p[2];
            let at_rest = area(&whole);
            let exact = (area(&current) - at_rest * unit * unit) as f64
                / (at_rest as f64 * unit as f64 * unit as f64);
            let found = PlaneTriangle::change(reference, &displacement);
            let size = |p: &[f64]| (p[0] * p[0] + p[1] * p[1]).sqrt();
            let scale = (size(&reference[..2]) * size(&displacement[2..])
                + size(&displacement[..2]) * size(&reference[2..]))
                / found.reference;
            assert!(
                (found.change - exact).abs() <= 4.0 * f64::EPSILON * scale,
                "{found:?} {exact:e}"
            );
        }
    }

    #[test]
    fn a_uniform_stretch_in_space_is_recovered_to_the_last_digits() {
        let stretch = libm::scalbn(1.0, -47);
        let exact = stretch * (2.0 + stretch);
        for reference in int_vectors::<6>(300) {
            let found = SpaceTriangle::change(&reference, &reference.map(|x| x * stretch));
            let lengths = (dot(&vector::<f64, 6, 3>(&reference, 0), &vector(&reference, 0))
                * dot(&vector::<f64, 6, 3>(&reference, 1), &vector(&reference, 1)))
            .sqrt();
            let bar = 8.0 * f64::EPSILON * exact * lengths / found.reference;
            assert!((found.change - exact).abs() <= bar, "{:e} {exact:e}", found.change);
        }
    }

    #[test]
    fn thin_triangles_keep_the_base_bar() {
        // |xi1 x xi2| of nearly parallel integer vectors, exact in 128-bit integers.
        for k in [0, 10, 20, 26] {
            let base = [(1i64 << 26) + 5, (1 << 25) + 3, (1 << 24) + 1];
            let other = [base[0] + (1 << (26 - k)), base[1] - 1, base[2] + 1];
            let vectors: [i64; 6] = [base[0], base[1], base[2], other[0], other[1], other[2]];
            let wide = vectors.map(i128::from);
            let minor = |p: usize, q: usize| wide[p] * wide[q + 3] - wide[q] * wide[p + 3];
            let exact = [minor(1, 2), minor(2, 0), minor(0, 1)].map(|c| c as f64);
            let reference = vectors.map(|x| x as f64);
            let found = SpaceTriangle::change(&reference, &[0.0; 6]).reference;
            let length = |p: &[f64]| dot(&[p[0], p[1], p[2]], &[p[0], p[1], p[2]]).sqrt();
            let bar = 4.0 * f64::EPSILON * length(&reference[..3]) * length(&reference[3..]);
            assert!((found - dot(&exact, &exact).sqrt()).abs() <= bar, "angle 2^-{k}");
        }
    }

    #[test]
    fn a_triangle_turned_inside_out_is_negative() {
        let turned = PlaneTriangle::change(&[1.0, 0.0, 0.0, 1.0], &[0.0, 0.0, 0.0, -3.0]);
        assert_eq!((turned.measure, turned.reference, turned.change), (-2.0, 1.0, -3.0));
        let mirrored = PlaneTriangle::change(&[0.0, 1.0, 1.0, 0.0], &[0.0; 4]);
        assert_eq!((mirrored.measure, mirrored.slope), (1.0, -1.0));
    }
}
