//! Tetrahedra: `v = xi1.(xi2 x xi3)`, six times their volume (javili2020, Eq. (20), third line).

use super::{Change, Geometry, Scalar, Variable, add, cross, dot, each, packed, vector};

/// Volume measure of a tetrahedron, in m^3: signed by its orientation at rest, so that it is
/// positive until the tetrahedron turns inside out (firooz2023); `s = v`.
#[derive(Debug)]
pub struct Tetrahedron;

impl Geometry<9> for Tetrahedron {
    const VARIABLE: Variable = Variable::Measure;

    #[inline(always)]
    fn largest_square<T: Scalar>(vectors: &[T; 9]) -> Option<T> {
        let x: [[T; 3]; 3] = each(|corner| vector(vectors, corner));
        Some(dot(&x[0], &x[0]) * dot(&x[1], &x[1]) * dot(&x[2], &x[2]))
    }

    /// `v - V = eta1.(xi2 x xi3) + Xi1.(Xi2 x eta3 + eta2 x xi3)`: each term holds a displacement.
    #[inline(always)]
    fn change<T: Scalar>(reference: &[T; 9], displacement: &[T; 9]) -> Change<T> {
        let current = add(reference, displacement);
        let rest: [[T; 3]; 3] = each(|corner| vector(reference, corner));
        let eta: [[T; 3]; 3] = each(|corner| vector(displacement, corner));
        let x: [[T; 3]; 3] = each(|corner| vector(&current, corner));
        let normal = cross(&x[1], &x[2]);
        let turned = add(&cross(&rest[1], &eta[2]), &cross(&eta[1], &x[2]));
        let at_rest = dot(&rest[0], &cross(&rest[1], &rest[2]));
        let orientation = at_rest.sign();
        Change {
            measure: orientation * dot(&x[0], &normal),
            reference: orientation * at_rest,
            change: (dot(&eta[0], &normal) + dot(&rest[0], &turned)) / at_rest,
            slope: orientation,
        }
    }

    /// The normals of the three faces at the owner.
    #[inline(always)]
    fn gradient<T: Scalar>(current: &[T; 9]) -> [T; 9] {
        let x: [[T; 3]; 3] = each(|corner| vector(current, corner));
        let (p, q, r) = (cross(&x[1], &x[2]), cross(&x[2], &x[0]), cross(&x[0], &x[1]));
        [p[0], p[1], p[2], q[0], q[1], q[2], r[0], r[1], r[2]]
    }

    /// `d2s` has zero blocks on the diagonal; the others are the cross product with the vector to
    /// the corner that the block does not name.
    #[inline(always)]
    fn hessian<T: Scalar>(
        current: &[T; 9],
        gradient: &[T; 9],
        first: T,
        second: T,
        mut emit: impl FnMut(usize, T),
    ) {
        let scaled: [T; 9] = each(|k| second * gradient[k]);
        let twist: [T; 9] = each(|k| first * current[k]);
        own_block(0, &scaled, gradient, &mut emit);
        own_block(1, &scaled, gradient, &mut emit);
        own_block(2, &scaled, gradient, &mut emit);
        // Blocks of corners (1,2) and (2,3) turn one way, (1,3) the other.
        let t: [[T; 3]; 3] = each(|corner| vector(&twist, corner));
        pair_block((0, 1), &t[2], &scaled, gradient, &mut emit);
        pair_block((0, 2), &[-t[1][0], -t[1][1], -t[1][2]], &scaled, gradient, &mut emit);
        pair_block((1, 2), &t[0], &scaled, gradient, &mut emit);
    }
}

/// Upper triangle of a corner's own block.
#[inline(always)]
fn own_block<T: Scalar>(
    corner: usize,
    scaled: &[T; 9],
    gradient: &[T; 9],
    emit: &mut impl FnMut(usize, T),
) {
    for row in 3 * corner..3 * corner + 3 {
        for column in row..3 * corner + 3 {
            emit(packed(9, row, column), scaled[row] * gradient[column]);
        }
    }
}

/// The block of two corners; its loops are written out because the compiler leaves them rolled.
#[inline(always)]
fn pair_block<T: Scalar>(
    (near, far): (usize, usize),
    [x, y, z]: &[T; 3],
    scaled: &[T; 9],
    gradient: &[T; 9],
    emit: &mut impl FnMut(usize, T),
) {
    let rank_one = |row: usize, column: usize| scaled[3 * near + row] * gradient[3 * far + column];
    let place = |row: usize, column: usize| packed(9, 3 * near + row, 3 * far + column);
    emit(place(0, 0), rank_one(0, 0));
    emit(place(0, 1), rank_one(0, 1) + *z);
    emit(place(0, 2), rank_one(0, 2) - *y);
    emit(place(1, 0), rank_one(1, 0) - *z);
    emit(place(1, 1), rank_one(1, 1));
    emit(place(1, 2), rank_one(1, 2) + *x);
    emit(place(2, 0), rank_one(2, 0) + *y);
    emit(place(2, 1), rank_one(2, 1) - *x);
    emit(place(2, 2), rank_one(2, 2));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::check::{check_derivatives, int_vectors};

    #[test]
    fn derivatives_agree_with_hyper_dual_numbers() {
        check_derivatives::<Tetrahedron, 9>(|x, sign| {
            let c0 = x[4] * x[8] - x[5] * x[7];
            let c1 = x[5] * x[6] - x[3] * x[8];
            let c2 = x[3] * x[7] - x[4] * x[6];
            (x[0] * c0 + x[1] * c1 + x[2] * c2) * sign
        });
    }

    #[test]
    fn changes_are_exact_to_the_bar() {
        // Integer vectors and displacements that are multiples of 2^-30: exact in 128-bit integers.
        let shift = 30;
        let unit = 1i128 << shift;
        let (references, etas) = (int_vectors::<9>(300), int_vectors::<9>(301));
        for (reference, eta) in references.iter().zip(&etas[1..]) {
            let displacement = eta.map(|x| libm::scalbn(x, -shift));
            let whole: [i128; 9] = std::array::from_fn(|k| reference[k] as i128);
            let current: [i128; 9] = std::array::from_fn(|k| whole[k] * unit + eta[k] as i128);
            let exact = (determinant(&current) - determinant(&whole) * unit * unit * unit) as f64
                / (determinant(&whole) as f64 * libm::scalbn(1.0, 3 * shift));
            let found = Tetrahedron::change(reference, &displacement);
            let length = |p: &[f64; 9], k| dot(&vector::<f64, 9, 3>(p, k), &vector(p, k)).sqrt();
            let terms = |k: usize| {
                let (p, q) = ((k + 1) % 3, (k + 2) % 3);
                length(&displacement, k) * length(reference, p) * length(reference, q)
            };
            let scale = (terms(0) + terms(1) + terms(2)) / found.reference;
            let error = (found.change - exact).abs();
            assert!(error <= 4.0 * f64::EPSILON * scale, "{found:?} {exact:e}");
        }
    }

    fn determinant(x: &[i128; 9]) -> i128 {
        x[0] * (x[4] * x[8] - x[5] * x[7])
            + x[1] * (x[5] * x[6] - x[3] * x[8])
            + x[2] * (x[3] * x[7] - x[4] * x[6])
    }

    #[test]
    fn a_tetrahedron_turned_inside_out_is_negative() {
        let reference = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let mut displacement = [0.0; 9];
        displacement[8] = -3.0;
        let turned = Tetrahedron::change(&reference, &displacement);
        assert_eq!((turned.measure, turned.reference, turned.change), (-2.0, 1.0, -3.0));
    }
}
