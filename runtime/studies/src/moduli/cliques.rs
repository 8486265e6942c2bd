//! Energies of several measures inside an endless lattice, in a homogeneous displacement: no measure alone
//! tells what a clique stores, so each clique that belongs to a point is taken. Parameters do not vary here.

use std::ops::{Add, Mul, Sub};

use piola_mechanics::element::{CAPACITY, Contributions, Element, InteractionBatch, Order};
use piola_mechanics::geometry::packed;
use piola_mechanics::kernel::Measure;
use piola_mechanics::neighborhood::HORIZON_TOLERANCE;

use super::Affine;
use crate::case::CaseError;

/// In spacings.
pub(super) type Vector = [i64; 3];

/// The energy per volume, for cliques of this weight per volume. `ratio` is the horizon in spacings.
pub(super) fn of_cliques(
    element: &dyn Element,
    ratio: f64,
    spacing: f64,
    weight: f64,
) -> Result<Affine, CaseError> {
    let (measure, d) = (element.measure(), element.dimension());
    let mut sum = Sum {
        element,
        spacing,
        batch: InteractionBatch::new(measure, d),
        out: Contributions::new(measure, d),
        listed: Vec::new(),
        affine: Affine::zero(d),
    };
    for_each_clique(measure, d, ratio, |corners| sum.take(corners.to_vec(), weight))?;
    sum.flush(weight)?;
    Ok(sum.affine)
}

/// Calls with each triangle or tetrahedron that begins at a point, one after the other: its other corners
/// from there, in spacings, without collinear and coplanar ones.
pub(super) fn for_each_clique<E>(
    measure: Measure,
    d: usize,
    ratio: f64,
    mut visit: impl FnMut(&[Vector]) -> Result<(), E>,
) -> Result<(), E> {
    let later = later_neighbors(d, ratio);
    let near = |p: &Vector, q: &Vector| square(difference(*p, *q)) <= reach(ratio);
    for (first, p) in later.iter().enumerate() {
        for (second, q) in later.iter().enumerate().skip(first + 1).filter(|(_, q)| near(p, q)) {
            if measure == Measure::Area {
                if cross(*p, *q) != [0; 3] {
                    visit(&[*p, *q])?;
                }
                continue;
            }
            for r in later[second + 1..].iter().filter(|r| near(p, r) && near(q, r)) {
                if dot(cross(*p, *q), *r) != 0 {
                    visit(&[*p, *q, *r])?;
                }
            }
        }
    }
    Ok(())
}

/// Puts cliques into a batch: the other corners of each from its first, and their displacements against
/// it, in m, corner by corner. Weights are left to the caller.
pub(super) fn gather(
    batch: &mut InteractionBatch,
    [n_corners, d]: [usize; 2],
    [reference, displacement]: [&[f64]; 2],
) {
    match (n_corners, d) {
        (2, 2) => gather_of::<2, 2>(batch, reference, displacement),
        (2, _) => gather_of::<2, 3>(batch, reference, displacement),
        _ => gather_of::<3, 3>(batch, reference, displacement),
    }
}

fn gather_of<const K: usize, const D: usize>(
    batch: &mut InteractionBatch,
    reference: &[f64],
    displacement: &[f64],
) {
    let [reference, displacement] = [reference, displacement].map(|all| {
        let rows = all.chunks_exact(D).map(|row| std::array::from_fn(|axis| row[axis]));
        rows.collect::<Vec<[f64; D]>>()
    });
    let corners = |lane: usize| std::array::from_fn(|k| lane * K + k);
    batch.gather::<K, D>(reference.len() / K, &reference, &displacement, corners);
}

/// Cliques on their way into the derivatives.
struct Sum<'a> {
    element: &'a dyn Element,
    spacing: f64,
    batch: InteractionBatch,
    out: Contributions,
    listed: Vec<Vec<Vector>>,
    affine: Affine,
}

impl Sum<'_> {
    fn take(&mut self, corners: Vec<Vector>, weight: f64) -> Result<(), CaseError> {
        self.listed.push(corners);
        if self.listed.len() == CAPACITY { self.flush(weight) } else { Ok(()) }
    }

    /// Adds what is listed.
    fn flush(&mut self, weight: f64) -> Result<(), CaseError> {
        let d = self.element.dimension();
        let Some(first) = self.listed.first() else { return Ok(()) };
        let n_corners = first.len();
        let all: Vec<Vec<f64>> = self.listed.iter().map(|corners| self.vectors(corners)).collect();
        let reference = all.concat();
        let still = vec![0.0; reference.len()];
        gather(&mut self.batch, [n_corners, d], [&reference, &still]);
        self.batch.weight[..all.len()].fill(weight);
        let found = self.element.evaluate(&self.batch, Order::Tangent, &mut self.out);
        if found.is_err() {
            let message = "at rest, inside the body: the energy or a derivative is not finite";
            return Err(CaseError::Body { message: message.to_string() });
        }
        let (n, size) = (d * d, n_corners * d);
        for (lane, x) in all.iter().enumerate() {
            let gradient = |row: usize| self.out.gradient[row][lane];
            let hessian =
                |r: usize, c: usize| self.out.hessian[packed(size, r.min(c), r.max(c))][lane];
            // du_a = G_ai X_i, so that component a of corner c changes by X_i of that corner.
            for row in 0..n {
                let (a, i) = (row / d, row % d);
                for c in 0..n_corners {
                    self.affine.stress[row] += gradient(c * d + a) * x[c * d + i];
                }
                for column in 0..n {
                    let (b, j) = (column / d, column % d);
                    let pairs = (0..n_corners * n_corners).map(|k| (k / n_corners, k % n_corners));
                    let parts = pairs
                        .map(|(c, e)| hessian(c * d + a, e * d + b) * x[c * d + i] * x[e * d + j]);
                    self.affine.rest[(row, column)] += parts.sum::<f64>();
                }
            }
        }
        self.listed.clear();
        Ok(())
    }

    /// In m, corner by corner.
    fn vectors(&self, corners: &[Vector]) -> Vec<f64> {
        let d = self.element.dimension();
        let numbers = corners.iter().flat_map(|corner| &corner[..d]);
        numbers.map(|number| *number as f64 * self.spacing).collect()
    }
}

/// Largest squared distance of neighbours, in spacings.
fn reach(ratio: f64) -> i64 {
    let radius = ratio * (1.0 + HORIZON_TOLERANCE);
    (radius * radius).floor() as i64
}

/// The neighbours that come after a point, in ascending order: a clique belongs to its first point.
fn later_neighbors(d: usize, ratio: f64) -> Vec<Vector> {
    let (reach, mut found) = (reach(ratio), Vec::new());
    let most = reach.isqrt();
    let depth = if d == 3 { most } else { 0 };
    for x in 0..=most {
        for y in -most..=most {
            for z in -depth..=depth {
                let place = [x, y, z];
                if place > [0; 3] && square(place) <= reach {
                    found.push(place);
                }
            }
        }
    }
    found
}

fn difference(p: Vector, q: Vector) -> Vector {
    std::array::from_fn(|axis| p[axis] - q[axis])
}

pub(super) fn dot<T>(p: [T; 3], q: [T; 3]) -> T
where
    T: Copy + Mul<Output = T> + Add<Output = T>,
{
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

fn square(p: Vector) -> i64 {
    dot(p, p)
}

pub(super) fn cross<T>(p: [T; 3], q: [T; 3]) -> [T; 3]
where
    T: Copy + Mul<Output = T> + Sub<Output = T>,
{
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
}
