//! The linear map from displacements to deformation gradients, and its transpose.
//!
//! `H_i = F_i - I = sum_j (u_j - u_i) x G_ij` with `G_ij = V_j Psi_ij`, over the family of `i` in
//! ascending order. The transpose gathers, too: every point sums over its own family, so that all
//! points go at once and the order of every sum is that of the body.

use std::sync::Arc;

use pulp::Arch;
use rayon::prelude::*;

use super::error::CorrespondenceError;
use super::moments::{self, OperatorOrder};
use crate::body::Body;
use crate::neighborhood::Neighborhood;

/// A `d x d` tensor, row by row.
pub(super) type Tensor<const D: usize> = [[f64; D]; D];

/// Points per task; fixed, so that results do not depend on threads.
const POINTS: usize = 256;

/// The gradient weights of all families.
pub(super) struct GradientOperator {
    neighborhood: Arc<Neighborhood>,
    /// `G_ij` in 1/m, `d` numbers for each directed bond, in the order of the neighbours; then
    /// [`PADDING`].
    weights: Vec<f64>,
    /// `-sum_j G_ij`, `d` numbers for each point: its weight in its own family.
    own: Vec<f64>,
    /// For each directed bond `(i, j)` the place of `(j, i)`.
    reverse: Vec<u32>,
    /// The largest condition number of a moment matrix.
    condition: f64,
}

impl GradientOperator {
    /// `influence` has a value for each directed bond.
    pub(super) fn new(
        body: &Body,
        neighborhood: Arc<Neighborhood>,
        order: OperatorOrder,
        influence: &[f64],
    ) -> Result<GradientOperator, CorrespondenceError> {
        let d = body.dimension();
        let n = neighborhood.n_points();
        if u32::try_from(influence.len()).is_err() {
            return Err(CorrespondenceError::TooManyBonds { bonds: influence.len() / 2 });
        }
        let mut weights = vec![0.0; influence.len() * d + PADDING];
        let mut rows = Vec::with_capacity(n);
        let mut rest = &mut weights[..];
        for point in 0..n {
            let (row, tail) =
                std::mem::take(&mut rest).split_at_mut(neighborhood.row(point).len() * d);
            rows.push((point, row));
            rest = tail;
        }
        let family = |(point, weights): (usize, &mut [f64])| {
            let (strengths, offsets) = family(body, &neighborhood, influence, point);
            let condition = moments::weights(order, d, &offsets, &strengths, weights);
            weights.iter_mut().for_each(|g| *g /= neighborhood.horizon());
            condition
        };
        let conditions: Vec<_> = rows.into_par_iter().with_min_len(POINTS).map(family).collect();
        let condition = check(body, &neighborhood, order, &conditions)?;
        let sum = |point: usize, axis: usize| {
            let row = &weights[neighborhood.places(point).start * d..];
            let row = row[..neighborhood.row(point).len() * d].chunks_exact(d);
            row.fold(0.0, |sum, g| sum - g[axis])
        };
        let own = (0..n * d).into_par_iter().map(|k| sum(k / d, k % d)).collect();
        let reverse = reverse(&neighborhood);
        Ok(GradientOperator { neighborhood, weights, own, reverse, condition })
    }

    /// Who belongs to whose family.
    pub(super) fn neighborhood(&self) -> &Neighborhood {
        &self.neighborhood
    }

    /// The largest condition number of a moment matrix, of lengths in horizons.
    pub(super) fn condition(&self) -> f64 {
        self.condition
    }

    /// The members of a family with their weights.
    pub(super) fn family<const D: usize>(&self, point: usize) -> (&[u32], &[[f64; D]]) {
        let weights = &self.weights.as_chunks::<D>().0[self.neighborhood.places(point)];
        (self.neighborhood.row(point), weights)
    }

    /// The weights that a point has in the families of its neighbours.
    pub(super) fn in_families<const D: usize>(
        &self,
        point: usize,
    ) -> impl Iterator<Item = (usize, [f64; D])> + '_ {
        let all = self.weights.as_chunks::<D>().0;
        let places = &self.reverse[self.neighborhood.places(point)];
        let row = self.neighborhood.row(point);
        row.iter().zip(places).map(|(&i, &place)| (i as usize, all[place as usize]))
    }

    /// The weights of neighbour `k` in a point's family, and of the point in the neighbour's.
    pub(super) fn both_ways<const D: usize>(&self, point: usize, k: usize) -> ([f64; D], [f64; D]) {
        let all = self.weights.as_chunks::<D>().0;
        let place = self.neighborhood.places(point).start + k;
        (all[place], all[self.reverse[place] as usize])
    }

    /// `-sum_j G_ij`: the weight of a point in its own family.
    pub(super) fn own<const D: usize>(&self, point: usize) -> [f64; D] {
        self.own.as_chunks::<D>().0[point]
    }

    /// `h` becomes the displacement gradients `H` of the displacements `u`.
    pub(super) fn gradient<const D: usize>(&self, u: &[f64], h: &mut [Tensor<D>]) {
        let u = u.as_chunks::<D>().0;
        let arch = Arch::new();
        h.par_chunks_mut(POINTS).enumerate().for_each(|(chunk, h)| {
            arch.dispatch(
                #[inline(always)]
                || {
                    for (k, h) in h.iter_mut().enumerate() {
                        *h = match D {
                            2 => self.gradient_at::<D, 2>(u, chunk * POINTS + k),
                            _ => self.gradient_at::<D, 4>(u, chunk * POINTS + k),
                        };
                    }
                },
            );
        });
    }

    /// One point's; rows of `W >= D` numbers fill a register, those beyond `D` are of no use.
    #[inline(always)]
    fn gradient_at<const D: usize, const W: usize>(
        &self,
        u: &[[f64; D]],
        point: usize,
    ) -> Tensor<D> {
        let row = self.neighborhood.row(point);
        let weights = &self.weights[self.neighborhood.places(point).start * D..];
        let here = u[point];
        let mut sum = [[0.0; W]; D];
        for (k, &j) in row.iter().enumerate() {
            let there = u[j as usize];
            let g = window::<W>(weights, k * D);
            for r in 0..D {
                let change = there[r] - here[r];
                for c in 0..W {
                    sum[r][c] += change * g[c];
                }
            }
        }
        std::array::from_fn(|r| std::array::from_fn(|c| sum[r][c]))
    }

    /// Adds to `forces` (`n x d`) the transpose: what `sum_i stress_i : H_i` changes by with the
    /// displacements. `columns` is room.
    pub(super) fn add_transpose<const D: usize>(
        &self,
        stress: &[Tensor<D>],
        columns: &mut Vec<f64>,
        forces: &mut [f64],
    ) {
        // Column by column.
        columns.resize(stress.len() * D * D + PADDING, 0.0);
        let turn = |(columns, stress): (&mut [f64], &Tensor<D>)| {
            for c in 0..D {
                for r in 0..D {
                    columns[c * D + r] = stress[r][c];
                }
            }
        };
        let points = columns.par_chunks_exact_mut(D * D).with_min_len(POINTS);
        points.zip(stress.par_iter().with_min_len(POINTS)).for_each(turn);
        let (arch, columns) = (Arch::new(), &columns[..]);
        let forces = forces.as_chunks_mut::<D>().0;
        forces.par_chunks_mut(POINTS).enumerate().for_each(|(chunk, forces)| {
            arch.dispatch(
                #[inline(always)]
                || {
                    for (k, force) in forces.iter_mut().enumerate() {
                        let sum: [f64; D] = match D {
                            2 => self.force_at::<D, 2>(columns, chunk * POINTS + k),
                            _ => self.force_at::<D, 4>(columns, chunk * POINTS + k),
                        };
                        for r in 0..D {
                            force[r] += sum[r];
                        }
                    }
                },
            );
        });
    }

    #[inline(always)]
    fn force_at<const D: usize, const W: usize>(&self, columns: &[f64], point: usize) -> [f64; D] {
        let mut sum = [0.0; W];
        for (i, g) in self.in_families::<D>(point) {
            for c in 0..D {
                let column = window::<W>(columns, i * D * D + c * D);
                for r in 0..W {
                    sum[r] += column[r] * g[c];
                }
            }
        }
        let own = self.own::<D>(point);
        for c in 0..D {
            let column = window::<W>(columns, point * D * D + c * D);
            for r in 0..W {
                sum[r] += column[r] * own[c];
            }
        }
        std::array::from_fn(|r| sum[r])
    }
}

/// Numbers beyond the end of an array that is read by windows.
const PADDING: usize = 2;

/// `W` numbers from a place on.
#[inline(always)]
fn window<const W: usize>(values: &[f64], start: usize) -> [f64; W] {
    let window = &values[start..start + W];
    std::array::from_fn(|k| window[k])
}

/// `V_j w_ij` and the offsets in horizons of one family.
pub(super) fn family(
    body: &Body,
    neighborhood: &Neighborhood,
    influence: &[f64],
    point: usize,
) -> (Vec<f64>, Vec<f64>) {
    let row = neighborhood.row(point);
    let influence = &influence[neighborhood.places(point)];
    let strengths =
        row.iter().zip(influence).map(|(&j, w)| body.volumes()[j as usize] * w).collect();
    let here = body.position(point);
    let offset = |&j: &u32| {
        let there = body.position(j as usize);
        here.iter().zip(there).map(|(x, y)| (y - x) / neighborhood.horizon())
    };
    (strengths, row.iter().flat_map(offset).collect())
}

/// The largest condition number, or the worst of those that are too large.
fn check(
    body: &Body,
    neighborhood: &Neighborhood,
    order: OperatorOrder,
    conditions: &[Result<f64, f64>],
) -> Result<f64, CorrespondenceError> {
    let refused = conditions.iter().enumerate().filter_map(|(p, c)| c.err().map(|c| (p, c)));
    let user = |point: usize| body.user_index()[point] as usize;
    let worst = refused.clone().reduce(|worst, other| {
        let is_worse = other.1 > worst.1 || (other.1 == worst.1 && user(other.0) < user(worst.0));
        if is_worse { other } else { worst }
    });
    match worst {
        None => Ok(conditions.iter().flatten().fold(0.0, |most: f64, c| most.max(*c))),
        Some((point, condition)) => Err(CorrespondenceError::ShapeTensor {
            point: user(point),
            position: body.position(point).to_vec(),
            neighbors: neighborhood.row(point).len(),
            functions: order.n_functions(body.dimension()),
            condition,
            count: refused.count(),
        }),
    }
}

/// Rows are symmetric and ascending: going through the points in order, each finds its place in a
/// neighbour's row right after the point before.
pub(crate) fn reverse(neighborhood: &Neighborhood) -> Vec<u32> {
    let n = neighborhood.n_points();
    let mut next: Vec<usize> = (0..n).map(|point| neighborhood.places(point).start).collect();
    let mut reverse = Vec::with_capacity(2 * neighborhood.n_bonds());
    for point in 0..n {
        for &j in neighborhood.row(point) {
            reverse.push(next[j as usize] as u32);
            next[j as usize] += 1;
        }
    }
    reverse
}
