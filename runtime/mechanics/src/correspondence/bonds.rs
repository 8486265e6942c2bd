//! A bond-based body in place of the tangent: sparse, positive semi-definite and like it, so that
//! conjugate gradients with products converge fast.
//!
//! Every bond is a spring along its present direction. Its stiffness is that of the law at rest
//! along the bond, `n x n : C : n x n`, with the share of volume that the bond has in the families
//! of its ends; scaled such that a material with `lambda = mu` keeps its energy of uniform strains.
//! What is left, another Poisson's ratio and the deviations of single points, is off by bounded
//! factors however fine the body is.

use rayon::prelude::*;

use super::operator::GradientOperator;
use super::stabilisation::elasticity;
use crate::body::Body;
use crate::kernel::VariablesLaw;
use crate::matrix::BlockMatrix;
use crate::neighborhood::Neighborhood;

/// The least part of the stiffness along a bond that is left across: bodies without triangles hold.
const ACROSS: f64 = 1e-4;

/// The least part of the largest modulus of the axes that a bond has: laws may be soft along some
/// directions.
const SOFTEST: f64 = 1e-2;

/// Fills a matrix on [`crate::matrix::BlockPattern::of_bonds`].
pub(super) fn assemble<const D: usize>(
    body: &Body,
    operator: &GradientOperator,
    law: &dyn VariablesLaw,
    u: &[f64],
    matrix: &mut BlockMatrix,
) {
    let modulus = Modulus::<D>::new(law);
    let stiffness = |i: usize, k: usize, j: usize, dx: &[f64; D]| {
        let (g_ij, g_ji) = operator.both_ways::<D>(i, k);
        let along = |g: &[f64; D]| (0..D).fold(0.0, |sum, c| sum + g[c] * dx[c]);
        let share = (body.volumes()[i] * along(&g_ij) - body.volumes()[j] * along(&g_ji)).abs();
        let squared = dx.iter().fold(0.0, |sum, x| sum + x * x);
        share / squared * modulus.along(dx, squared)
    };
    springs(body, operator.neighborhood(), u, stiffness, matrix);
}

/// Fills a matrix on [`crate::matrix::BlockPattern::of_bonds`] with springs along the bonds as they
/// are at `u`. `stiffness` is that of the bond from `i` to its neighbour `j`, number `k` of its
/// family, of this offset at rest; in N/m and the same from both ends.
pub(crate) fn springs<const D: usize>(
    body: &Body,
    neighborhood: &Neighborhood,
    u: &[f64],
    stiffness: impl Fn(usize, usize, usize, &[f64; D]) -> f64 + Sync,
    matrix: &mut BlockMatrix,
) {
    let (positions, u) = (body.positions().as_chunks::<D>().0, u.as_chunks::<D>().0);
    let block = |i: usize, k: usize, j: usize| -> [[f64; D]; D] {
        let dx: [f64; D] = std::array::from_fn(|c| positions[j][c] - positions[i][c]);
        let squared = dx.iter().fold(0.0, |sum, x| sum + x * x);
        let stiffness = stiffness(i, k, j, &dx);
        let now: [f64; D] = std::array::from_fn(|c| dx[c] + (u[j][c] - u[i][c]));
        let length = now.iter().fold(0.0, |sum, x| sum + x * x);
        let (n, length) = if length > 0.0 { (now, length) } else { (dx, squared) };
        std::array::from_fn(|r| {
            std::array::from_fn(|c| {
                let across = if r == c { ACROSS } else { 0.0 };
                stiffness * (n[r] * n[c] / length + across)
            })
        })
    };
    let row = |(i, out): (usize, &mut [f64])| {
        let mut diagonal = [[0.0; D]; D];
        let mut later = D * D;
        for (k, &j) in neighborhood.row(i).iter().enumerate() {
            let block = block(i, k, j as usize);
            for (sum, x) in diagonal.as_flattened_mut().iter_mut().zip(block.as_flattened()) {
                *sum += x;
            }
            if j as usize > i {
                let place = &mut out[later..later + D * D];
                place.iter_mut().zip(block.as_flattened()).for_each(|(out, x)| *out = -x);
                later += D * D;
            }
        }
        out[..D * D].copy_from_slice(diagonal.as_flattened());
    };
    let BlockMatrix { pattern, values } = matrix;
    let mut rows = Vec::with_capacity(pattern.n_rows());
    let mut rest = &mut values[..];
    for i in 0..pattern.n_rows() {
        let length = (pattern.row_start[i + 1] - pattern.row_start[i]) * D * D;
        let (row, tail) = std::mem::take(&mut rest).split_at_mut(length);
        rows.push((i, row));
        rest = tail;
    }
    rows.into_par_iter().with_min_len(64).for_each(row);
}

/// The modulus of the law at rest along a direction.
struct Modulus<const D: usize> {
    elasticity: Vec<f64>,
    least: f64,
}

impl<const D: usize> Modulus<D> {
    fn new(law: &dyn VariablesLaw) -> Modulus<D> {
        let mut elasticity = elasticity(law, D);
        let axes = || (0..D).map(|r| (r * D + r) * (D * D + 1));
        let mut stiffest = axes().fold(0.0, |most: f64, k| most.max(elasticity[k]));
        // A law without stiffness at rest: only the pattern of the stiffness matters.
        if !(stiffest > 0.0 && elasticity.iter().all(|x| x.is_finite())) {
            elasticity.fill(0.0);
            stiffest = 1.0;
            for k in axes() {
                elasticity[k] = 1.0;
            }
        }
        Modulus { elasticity, least: SOFTEST * stiffest }
    }

    fn along(&self, dx: &[f64; D], squared: f64) -> f64 {
        let mut sum = 0.0;
        for rc in 0..D * D {
            let left = dx[rc / D] * dx[rc % D];
            for se in 0..D * D {
                sum += left * self.elasticity[rc * D * D + se] * dx[se / D] * dx[se % D];
            }
        }
        // `d(d + 2)/3` makes up for directions in which a bond does not pull; the shares of a family
        // sum up to `d`.
        (sum / (squared * squared)).max(self.least) * (D + 2) as f64 / 3.0
    }
}
