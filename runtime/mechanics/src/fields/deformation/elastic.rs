//! The law at rest: its elasticity tensor, and springs along the bonds that are like the Hessian.
//!
//! Every bond is a spring along its present direction. Its stiffness is that of the law at rest
//! along the bond, `n x n : C : n x n`, with the share of volume that the bond has in the families
//! of its ends; scaled such that a material with `lambda = mu` keeps its energy of uniform strains.
//! What is left, another Poisson's ratio and the deviations of single points, is off by bounded
//! factors however fine the body is.

use super::operator::GradientOperator;
use crate::body::Body;
use crate::fields::springs;
use crate::interaction::Slabs;
use crate::kernel::Variables;
use crate::materials::LawOfPoints;
use crate::matrix::BlockMatrix;

/// The least part of the largest modulus of the axes that a bond has: laws may be soft along some
/// directions.
const SOFTEST: f64 = 1e-2;

/// Fills a matrix on [`crate::matrix::BlockPattern::of_bonds`].
pub(super) fn springs<const D: usize>(
    (body, slabs): (&Body, &Slabs),
    operator: &GradientOperator,
    law: LawOfPoints<'_>,
    u: &[f64],
    matrix: &mut BlockMatrix,
) {
    let n_laws = law.materials.map_or(1, |materials| materials.n_laws());
    let moduli: Vec<Modulus<D>> = (0..n_laws).map(|k| Modulus::new(law, k as u8)).collect();
    let stiffness = |bond: usize, ends: [usize; 2], dx: &[f64; D]| {
        let [of_i, of_j] = operator.both_ways::<D>(bond, ends);
        let along = |g: &[f64; D]| (0..D).fold(0.0, |sum, c| sum + g[c] * dx[c]);
        let [v_i, v_j] = ends.map(|end| body.volumes()[end]);
        let share = (v_i * along(&of_i) - v_j * along(&of_j)).abs();
        let squared = dx.iter().fold(0.0, |sum, x| sum + x * x);
        let parts = law.parts(ends);
        let along = parts.iter().map(|(law, part)| part * moduli[law].along(dx, squared));
        share / squared * along.fold(0.0, |sum, modulus| sum + modulus)
    };
    springs::fill(body, (operator.neighborhood(), slabs), u, stiffness, matrix);
}

/// The modulus of the law at rest along a direction.
struct Modulus<const D: usize> {
    elasticity: Vec<f64>,
    least: f64,
}

impl<const D: usize> Modulus<D> {
    fn new(law: LawOfPoints<'_>, number: u8) -> Modulus<D> {
        let mut elasticity = elasticity(law, (number, None), D);
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

/// The elasticity tensor at rest of the law of a number, `d^2 x d^2` row by row: entry `(rc, se)` is
/// `dP_rc/dF_se`. Fields are those of a point, or typical; states are typical, for what is remembered later
/// must not decide what bonds that break then make of it.
pub(super) fn elasticity(
    law: LawOfPoints<'_>,
    (number, point): (u8, Option<usize>),
    d: usize,
) -> Vec<f64> {
    let size = d * d;
    let rest: Vec<f64> = (0..size).map(|k| if k % (d + 1) == 0 { 1.0 } else { 0.0 }).collect();
    // One place for each unit direction.
    let spread = |x: &[f64]| x.iter().flat_map(|&x| vec![x; size]).collect::<Vec<f64>>();
    let (current, change) = (spread(&rest), vec![0.0; size * size]);
    let direction: Vec<f64> =
        (0..size * size).map(|k| if k / size == k % size { 1.0 } else { 0.0 }).collect();
    let (mut product, laws, mut given) = (vec![0.0; size * size], vec![number; size], Vec::new());
    match (point, law.fields()) {
        (Some(point), Some(fields)) => fields.add_at_start(size, point, &mut given),
        (None, Some(fields)) => fields.add_typical(size, &mut given),
        (_, None) => {}
    }
    law.law.product(
        Variables { n: size, current: &current, change: &change, given: &given, laws: &laws },
        &direction,
        &mut product,
    );
    product
}
