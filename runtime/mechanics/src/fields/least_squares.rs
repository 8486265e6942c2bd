//! Deformation gradients of bodies whose energies know none: those that fit the families best.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use rayon::prelude::*;

use crate::body::Body;
use crate::matrix::BlockPattern;

/// Directions in which a family reaches no further than this part of how far it reaches, squared,
/// have no gradient: they are lines and planes of points.
const FLAT: f64 = 1e-10;

/// `F - I` of every point (`n x d x d` row by row) at displacements `u` (`n x d`, in m): with the least
/// `sum_j V_j |u_j - u_i - H (X_j - X_i)|^2` over the neighbours, and zero in directions in which
/// there are none. It is the gradient of the non-ordinary models with an influence of 1 (silling and others,
/// J. Elasticity 88, 2007), exact where displacements are linear.
pub fn displacement_gradients(body: &Body, bonds: &BlockPattern, u: &[f64]) -> Vec<f64> {
    assert_eq!(u.len(), body.positions().len(), "displacements are n x d");
    let d = body.dimension();
    let x = body.positions();
    let difference = |of: &[f64], i: usize, j: usize| {
        Vector3::from_fn(|c, _| if c < d { of[j * d + c] - of[i * d + c] } else { 0.0 })
    };
    // Planes are flat along the third axis.
    let mut sums = vec![[Matrix3::zeros(); 2]; body.n_points()];
    for i in 0..body.n_points() {
        for &j in &bonds.columns[bonds.row_start[i]..bonds.row_start[i + 1]] {
            let j = j as usize;
            let (dx, du) = (difference(x, i, j), difference(u, i, j));
            for (own, other) in [(i, j), (j, i)] {
                let [moved, shape] = &mut sums[own];
                *moved += body.volumes()[other] * du * dx.transpose();
                *shape += body.volumes()[other] * dx * dx.transpose();
            }
        }
    }
    let fit = |[moved, shape]: &[Matrix3<f64>; 2]| {
        let eigen = SymmetricEigen::new(*shape);
        let least = FLAT * eigen.eigenvalues.max();
        let inverse = eigen.eigenvalues.map(|x| if x > least { 1.0 / x } else { 0.0 });
        let vectors = eigen.eigenvectors;
        moved * vectors * Matrix3::from_diagonal(&inverse) * vectors.transpose()
    };
    let fitted: Vec<Matrix3<f64>> = sums.par_iter().map(fit).collect();
    let entry = |h: &Matrix3<f64>, place: usize| h[(place / d, place % d)];
    fitted.iter().flat_map(|h| (0..d * d).map(move |place| entry(h, place))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neighborhood::Neighborhood;

    #[test]
    fn linear_displacements_have_their_gradient() {
        let x = [0.0, 0.0, 0.0, 1.0, 0.1, 0.0, 0.2, 1.1, 0.0, 0.1, 0.2, 0.9, 1.0, 0.8, 0.7];
        let body = Body::new(3, &x, &[1.0, 2.0, 0.5, 1.5, 0.7], None);
        let neighborhood = Neighborhood::new(&body, 3.0).unwrap();
        let bonds = BlockPattern::of_bonds(&neighborhood, 3);
        let h = [[0.01, 0.2, -0.03], [1e-9, -0.1, 0.5], [0.3, 0.0, 0.02]];
        let u: Vec<f64> = body
            .positions()
            .chunks_exact(3)
            .flat_map(|x| h.map(|row| 0.5 + row[0] * x[0] + row[1] * x[1] + row[2] * x[2]))
            .collect();
        for found in displacement_gradients(&body, &bonds, &u).chunks_exact(9) {
            for (x, expected) in found.iter().zip(h.as_flattened()) {
                assert!((x - expected).abs() <= 1e-14, "{found:?}");
            }
        }
    }

    #[test]
    fn a_line_has_no_gradient_across() {
        let body = Body::new(2, &[0.0, 0.0, 1.0, 0.0, 2.0, 0.0], &[1.0; 3], None);
        let neighborhood = Neighborhood::new(&body, 1.5).unwrap();
        let bonds = BlockPattern::of_bonds(&neighborhood, 2);
        let found = displacement_gradients(&body, &bonds, &[0.0, 0.0, 0.1, 0.3, 0.2, 0.6]);
        for h in found.chunks_exact(4) {
            let known = [0.1, 0.0, 0.3, 0.0];
            assert!(h.iter().zip(known).all(|(x, known)| (x - known).abs() < 1e-15), "{h:?}");
        }
    }
}
