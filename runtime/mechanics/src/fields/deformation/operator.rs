//! The linear map from displacements to deformation gradients, and its transpose.
//!
//! `H_i = F_i - I = sum_j (u_j - u_i) x G_ij` over the family of `i`, ascending. A weight
//! `G_ij = V_j w_ij B_i q(X_j - X_i)` is a product of what the bond has, its influence, and of what the
//! point has, `d x m` coefficients of the `m` polynomials `q`: it is worked out where it is used, which
//! takes no more time than reading it, and a bond that breaks changes the coefficients of its two ends
//! alone ([`GradientOperator::lose`]). The transpose gathers, too: every point sums over its own family, so
//! that all points go at once and the order of every sum is that of the body.

use std::sync::Arc;

use pulp::Arch;
use rayon::prelude::*;

use super::error::DeformationError;
use super::moments::{self, OperatorOrder};
use super::rows::AlongRows;
use crate::body::Body;
use crate::fields::stored::Tensor;
use crate::geometry::lanes::InRegisters;
use crate::neighborhood::{Gaps, Neighborhood};

/// Points per task; fixed, so that results do not depend on threads.
const POINTS: usize = 256;

/// The gradient weights of all families.
pub(super) struct GradientOperator {
    body: Arc<Body>,
    neighborhood: Arc<Neighborhood>,
    order: OperatorOrder,
    /// `1/delta`: polynomials are of lengths in horizons.
    per_length: f64,
    /// `w_ij` over its largest value for each directed bond, in the order of the neighbours.
    influence: Vec<f64>,
    /// Volumes over the largest.
    volumes: Vec<f64>,
    /// `B_i` in 1/m, `m x d` for each point; then [`PADDING`].
    coefficients: Vec<f64>,
    /// `sum_j V_j w_ij q_ij`, `m` numbers for each point.
    moments: Vec<f64>,
    /// Positions in m, `n x d`; then [`PADDING`].
    positions: Vec<f64>,
    /// Whether the family of a point is so regular that its sum is taken before its coefficients.
    is_regular: Vec<bool>,
    /// What is known of lattices, of first order.
    pub(super) rows: Option<AlongRows>,
    /// The condition numbers of moment matrices; infinite where the neighbours of a point that are left
    /// determine no gradient.
    conditions: Vec<f64>,
}

/// What an operator of first order knows of its families: see the fields of the same names.
pub(super) struct Fitted<'a> {
    pub(super) body: &'a Body,
    pub(super) per_length: f64,
    pub(super) influence: &'a [f64],
    pub(super) volumes: &'a [f64],
    pub(super) coefficients: &'a [f64],
    pub(super) moments: &'a [f64],
}

/// Up to this condition number of a moment matrix `H = (sum_j V_j w_ij (u_j - u_i) x q) B`: rounding
/// errors grow by it, by its root where each neighbour has its weight. Inside of a lattice it is 1.
const REGULAR: f64 = 8.0;

/// Calls the function of this name for the dimension and the number of polynomials.
macro_rules! by_order {
    ($self:ident . $function:ident ($($argument:expr),*)) => {
        match (D, $self.order) {
            (2, OperatorOrder::First) => $self.$function::<D, 2, 2>($($argument),*),
            (2, OperatorOrder::FirstWithConstant) => $self.$function::<D, 2, 3>($($argument),*),
            (2, OperatorOrder::Second) => $self.$function::<D, 2, 5>($($argument),*),
            (_, OperatorOrder::First) => $self.$function::<D, 4, 3>($($argument),*),
            (_, OperatorOrder::FirstWithConstant) => $self.$function::<D, 4, 4>($($argument),*),
            (_, OperatorOrder::Second) => $self.$function::<D, 4, 9>($($argument),*),
        }
    };
}

impl GradientOperator {
    /// `influence` has a value for each directed bond.
    pub(super) fn new(
        body: &Arc<Body>,
        neighborhood: Arc<Neighborhood>,
        order: OperatorOrder,
        influence: &[f64],
    ) -> Result<GradientOperator, DeformationError> {
        let (d, n) = (body.dimension(), neighborhood.n_points());
        if u32::try_from(influence.len()).is_err() {
            return Err(DeformationError::TooManyBonds { bonds: influence.len() / 2 });
        }
        let m = order.n_functions(d);
        let mut operator = GradientOperator {
            body: Arc::clone(body),
            order,
            per_length: 1.0 / neighborhood.horizon(),
            influence: normalised(influence),
            volumes: normalised(body.volumes()),
            coefficients: vec![0.0; n * m * d + PADDING],
            moments: vec![0.0; n * m],
            positions: [body.positions(), &[0.0; PADDING]].concat(),
            is_regular: Vec::new(),
            rows: None,
            conditions: Vec::new(),
            neighborhood,
        };
        let mut coefficients = std::mem::take(&mut operator.coefficients);
        let mut moments = std::mem::take(&mut operator.moments);
        let of_family = |(point, (coefficients, moments)): (usize, (&mut [f64], &mut [f64]))| {
            operator.fit(point, coefficients, moments)
        };
        let rows = coefficients.par_chunks_exact_mut(m * d).zip(moments.par_chunks_exact_mut(m));
        let conditions: Vec<_> = rows.enumerate().with_min_len(POINTS).map(of_family).collect();
        let conditions = check(body, &operator.neighborhood, order, conditions)?;
        let is_regular = conditions.iter().map(|c| operator.is_regular_of(*c)).collect();
        let mut operator =
            GradientOperator { coefficients, moments, conditions, is_regular, ..operator };
        operator.rows = if order == OperatorOrder::First { operator.along_rows() } else { None };
        Ok(operator)
    }

    /// Takes out bonds by their ends, the lower one first: families become smaller, which is not refused. A
    /// point whose family determines no gradient any more has that of rest. `points` are all ends, each once;
    /// what belongs to others stays as it is, so that the result does not depend on what went first.
    pub(super) fn lose(&mut self, bonds: &[[usize; 2]], points: &[usize]) -> Gaps {
        let gaps = Arc::make_mut(&mut self.neighborhood).take_out(bonds);
        gaps.close_places(&mut self.influence);
        if let Some(rows) = &mut self.rows {
            rows.lose(bonds);
        }
        self.fit_again(points);
        gaps
    }

    /// Works out what some points have by their families, of which bonds have been taken out.
    pub(super) fn fit_again(&mut self, points: &[usize]) {
        let d = self.body.dimension();
        let m = self.order.n_functions(d);
        let of_point = |point: &usize| {
            // Those of points that are released are 0.
            let (mut coefficients, mut moments) = (vec![0.0; m * d], vec![0.0; m]);
            let condition = self.fit(*point, &mut coefficients, &mut moments);
            (coefficients, moments, condition.unwrap_or(f64::INFINITY))
        };
        let fitted: Vec<_> = points.par_iter().map(of_point).collect();
        for (&point, (coefficients, moments, condition)) in points.iter().zip(fitted) {
            self.coefficients[point * m * d..(point + 1) * m * d].copy_from_slice(&coefficients);
            self.moments[point * m..(point + 1) * m].copy_from_slice(&moments);
            self.conditions[point] = condition;
            self.is_regular[point] = self.is_regular_of(condition);
            if let Some(rows) = &mut self.rows {
                rows.set(point, &coefficients, &moments);
            }
        }
    }

    /// The bits of all that it knows of families.
    #[cfg(test)]
    pub(super) fn bits(&self) -> Vec<u64> {
        let all = [&self.influence, &self.coefficients, &self.moments, &self.conditions];
        let regular = self.is_regular.iter().map(|is_regular| u64::from(*is_regular));
        all.into_iter().flatten().map(|x| x.to_bits()).chain(regular).collect()
    }

    /// Whether a family of this condition is so regular that its sum is taken before its coefficients.
    fn is_regular_of(&self, condition: f64) -> bool {
        self.order == OperatorOrder::First && condition <= REGULAR
    }

    fn along_rows(&self) -> Option<AlongRows> {
        let d = self.body.dimension();
        let fitted = Fitted {
            body: &self.body,
            per_length: self.per_length,
            influence: &self.influence,
            volumes: &self.volumes,
            coefficients: &self.coefficients[..self.body.n_points() * d * d],
            moments: &self.moments,
        };
        match d {
            2 => AlongRows::new::<2>(&fitted, &self.neighborhood),
            _ => AlongRows::new::<3>(&fitted, &self.neighborhood),
        }
    }

    /// The coefficients and the moments of one family. `Ok` and `Err` hold the condition number.
    fn fit(&self, point: usize, coefficients: &mut [f64], sums: &mut [f64]) -> Result<f64, f64> {
        let (strengths, offsets) = self.family(point);
        let d = self.body.dimension();
        let fit = moments::fit(self.order, d, self.per_length, &offsets, &strengths)?;
        for (out, column) in coefficients.chunks_exact_mut(d).zip(fit.coefficients.column_iter()) {
            out.iter_mut().zip(column.iter()).for_each(|(out, x)| *out = *x);
        }
        sums.copy_from_slice(&fit.sums);
        Ok(fit.condition)
    }

    /// `V_j w_ij` and the offsets in horizons of one family.
    pub(super) fn family(&self, point: usize) -> (Vec<f64>, Vec<f64>) {
        let row = self.neighborhood.row(point);
        let influence = &self.influence[self.neighborhood.places(point)];
        let strengths = row.iter().zip(influence).map(|(j, w)| self.volumes[j as usize] * w);
        let here = self.body.position(point);
        let offset = |j: u32| {
            let there = self.body.position(j as usize);
            here.iter().zip(there).map(|(x, y)| (y - x) * self.per_length)
        };
        (strengths.collect(), row.iter().flat_map(offset).collect())
    }

    /// The body.
    pub(super) fn body(&self) -> &Body {
        &self.body
    }

    /// Which polynomials are differentiated exactly.
    pub(super) fn order(&self) -> OperatorOrder {
        self.order
    }

    /// The influence of each directed bond over its largest value.
    pub(super) fn influence(&self) -> &[f64] {
        &self.influence
    }

    /// The influence of the bonds with later points, over the same.
    pub(super) fn later_influence(&self, point: usize) -> &[f64] {
        let own = &self.influence[self.neighborhood.places(point)];
        &own[own.len() - self.neighborhood.upper(point).len()..]
    }

    /// Whether the neighbours of a point that are left determine no gradient.
    pub(super) fn is_released(&self, point: usize) -> bool {
        self.conditions[point] == f64::INFINITY
    }

    /// See [`GradientOperator::neighborhood`].
    pub(super) fn shared_neighborhood(&self) -> &Arc<Neighborhood> {
        &self.neighborhood
    }

    /// Who belongs to whose family.
    pub(super) fn neighborhood(&self) -> &Neighborhood {
        &self.neighborhood
    }

    /// Whether it goes along the rows of a lattice.
    pub(super) fn has_rows(&self) -> bool {
        self.rows.is_some()
    }

    /// The largest condition number of a moment matrix, of lengths in horizons.
    pub(super) fn condition(&self) -> f64 {
        let fitted = self.conditions.iter().filter(|condition| condition.is_finite());
        fitted.fold(0.0, |most, condition| most.max(*condition))
    }

    /// The weights `G_ij` in 1/m of all directed bonds, in the order of the neighbours.
    pub(super) fn weights<const D: usize>(&self) -> Vec<[f64; D]> {
        let of_point = |point: usize| {
            let row = self.neighborhood.row(point).iter();
            let influence = &self.influence[self.neighborhood.places(point)];
            row.zip(influence).map(move |(j, influence)| {
                by_order!(self.weight_in([point, j as usize], *influence))
            })
        };
        (0..self.neighborhood.n_points()).into_par_iter().flat_map_iter(of_point).collect()
    }

    /// The weights of the later point of a bond in its owner's family, and of the owner in the later
    /// point's.
    pub(super) fn both_ways<const D: usize>(
        &self,
        bond: usize,
        [i, j]: [usize; 2],
    ) -> [[f64; D]; 2] {
        let bonds = self.neighborhood.bonds(i);
        let place = self.neighborhood.places(i).end - (bonds.end - bond);
        let influence = self.influence[place];
        [[i, j], [j, i]].map(|bond| by_order!(self.weight_in(bond, influence)))
    }

    fn weight_in<const D: usize, const W: usize, const M: usize>(
        &self,
        [i, j]: [usize; 2],
        influence: f64,
    ) -> [f64; D] {
        let positions = self.body.positions().as_chunks::<D>().0;
        let q = self.functions::<D, M>(&positions[i], &positions[j]);
        let coefficients = self.coefficients_of::<D, W, M>(i);
        let weight: [f64; W] = weight(&coefficients, &q, self.volumes[j] * influence);
        std::array::from_fn(|axis| weight[axis])
    }

    /// The polynomials at the offset of a neighbour.
    #[inline(always)]
    fn functions<const D: usize, const M: usize>(
        &self,
        here: &[f64; D],
        there: &[f64; D],
    ) -> [f64; M] {
        let offset: [f64; D] = std::array::from_fn(|c| (there[c] - here[c]) * self.per_length);
        let mut q = [0.0; M];
        moments::functions(&offset, &mut q);
        q
    }

    /// `B_i` column by column; rows of `W >= D` numbers fill a register, those beyond `D` are of no
    /// use.
    #[inline(always)]
    fn coefficients_of<const D: usize, const W: usize, const M: usize>(
        &self,
        point: usize,
    ) -> [[f64; W]; M] {
        std::array::from_fn(|k| window::<W>(&self.coefficients, (point * M + k) * D))
    }

    /// `h` becomes the displacement gradients `H` of the displacements `u`.
    pub(super) fn gradient<const D: usize>(&self, u: &[f64], h: &mut [Tensor<D>]) {
        by_order!(self.gradients(u.as_chunks::<D>().0, h));
    }

    fn gradients<const D: usize, const W: usize, const M: usize>(
        &self,
        u: &[[f64; D]],
        h: &mut [Tensor<D>],
    ) {
        let arch = Arch::new();
        if let Some(rows) = &self.rows {
            rows.gradient(u, h);
            let others = h.par_iter_mut().zip(&self.is_regular).enumerate().with_min_len(POINTS);
            others.for_each(|(point, (h, is_regular))| {
                if !is_regular {
                    *h = self.gradient_at::<D, W, M>(u, point);
                }
            });
            return;
        }
        h.par_chunks_mut(POINTS).enumerate().for_each(|(chunk, h)| {
            arch.dispatch(InRegisters(
                #[inline(always)]
                || {
                    for (k, h) in h.iter_mut().enumerate() {
                        let point = chunk * POINTS + k;
                        *h = if M == D && self.is_regular[point] {
                            self.regular_gradient_at::<D, W, M>(u, point)
                        } else {
                            self.gradient_at::<D, W, M>(u, point)
                        };
                    }
                },
            ));
        });
    }

    #[inline(always)]
    fn gradient_at<const D: usize, const W: usize, const M: usize>(
        &self,
        u: &[[f64; D]],
        point: usize,
    ) -> Tensor<D> {
        let positions = self.body.positions().as_chunks::<D>().0;
        let row = self.neighborhood.row(point);
        let influence = &self.influence[self.neighborhood.places(point)];
        let coefficients = self.coefficients_of::<D, W, M>(point);
        let (here, place) = (u[point], positions[point]);
        let mut sum = [[0.0; W]; D];
        for (j, influence) in row.iter().zip(influence) {
            let j = j as usize;
            let q = self.functions::<D, M>(&place, &positions[j]);
            let g: [f64; W] = weight(&coefficients, &q, self.volumes[j] * influence);
            for r in 0..D {
                let change = u[j][r] - here[r];
                for c in 0..W {
                    sum[r][c] += change * g[c];
                }
            }
        }
        std::array::from_fn(|r| std::array::from_fn(|c| sum[r][c]))
    }

    /// The same of first order, with the coefficients last.
    #[inline(always)]
    fn regular_gradient_at<const D: usize, const W: usize, const M: usize>(
        &self,
        u: &[[f64; D]],
        point: usize,
    ) -> Tensor<D> {
        let row = self.neighborhood.row(point);
        let influence = &self.influence[self.neighborhood.places(point)];
        let (here, place) = (u[point], window::<W>(&self.positions, point * D));
        let mut sum = [[0.0; W]; D];
        for (j, influence) in row.iter().zip(influence) {
            let j = j as usize;
            let there = window::<W>(&self.positions, j * D);
            let mut offset = [0.0; W];
            for c in 0..W {
                offset[c] = there[c] - place[c];
            }
            let strength = self.volumes[j] * influence;
            for r in 0..D {
                let change = strength * (u[j][r] - here[r]);
                for c in 0..W {
                    sum[r][c] += change * offset[c];
                }
            }
        }
        let coefficients = self.coefficients_of::<D, W, M>(point);
        std::array::from_fn(|r| {
            std::array::from_fn(|c| {
                (0..D).fold(0.0, |h, k| h + self.per_length * sum[r][k] * coefficients[k][c])
            })
        })
    }

    /// Adds to `forces` (`n x d`) the transpose: what `sum_i stress_i : H_i` changes by with the
    /// displacements. `room` is for `stress_i B_i`.
    pub(super) fn add_transpose<const D: usize>(
        &self,
        stress: &[Tensor<D>],
        room: &mut Vec<f64>,
        forces: &mut [f64],
    ) {
        by_order!(self.transpose(stress, room, forces.as_chunks_mut::<D>().0));
    }

    fn transpose<const D: usize, const W: usize, const M: usize>(
        &self,
        stress: &[Tensor<D>],
        room: &mut Vec<f64>,
        forces: &mut [[f64; D]],
    ) {
        if let Some(rows) = &self.rows {
            let coefficients = &self.coefficients[..stress.len() * M * D];
            return rows.add_transpose(stress, coefficients, room, forces);
        }
        // `stress_i B_i`, column by column.
        room.resize(stress.len() * M * D + PADDING, 0.0);
        let turn = |(point, (out, stress)): (usize, (&mut [f64], &Tensor<D>))| {
            let coefficients = self.coefficients_of::<D, W, M>(point);
            for k in 0..M {
                for r in 0..D {
                    let row = &stress[r];
                    out[k * D + r] = (0..D).fold(0.0, |s, c| s + row[c] * coefficients[k][c]);
                }
            }
        };
        let points = room.par_chunks_exact_mut(M * D).zip(stress);
        points.enumerate().with_min_len(POINTS).for_each(turn);
        let (arch, columns) = (Arch::new(), &room[..]);
        forces.par_chunks_mut(POINTS).enumerate().for_each(|(chunk, forces)| {
            arch.dispatch(InRegisters(
                #[inline(always)]
                || {
                    for (k, force) in forces.iter_mut().enumerate() {
                        let sum: [f64; D] = self.force_at::<D, W, M>(columns, chunk * POINTS + k);
                        for r in 0..D {
                            force[r] += sum[r];
                        }
                    }
                },
            ));
        });
    }

    #[inline(always)]
    fn force_at<const D: usize, const W: usize, const M: usize>(
        &self,
        columns: &[f64],
        point: usize,
    ) -> [f64; D] {
        let positions = self.body.positions().as_chunks::<D>().0;
        let row = self.neighborhood.row(point);
        let influence = &self.influence[self.neighborhood.places(point)];
        let place = positions[point];
        let mut sum = [0.0; W];
        for (i, influence) in row.iter().zip(influence) {
            let i = i as usize;
            let q = self.functions::<D, M>(&positions[i], &place);
            for k in 0..M {
                let column = window::<W>(columns, (i * M + k) * D);
                for r in 0..W {
                    sum[r] += column[r] * (influence * q[k]);
                }
            }
        }
        let moments = &self.moments[point * M..(point + 1) * M];
        let mut own = [0.0; W];
        for (k, moment) in moments.iter().enumerate() {
            let column = window::<W>(columns, (point * M + k) * D);
            for r in 0..W {
                own[r] += column[r] * moment;
            }
        }
        std::array::from_fn(|r| self.volumes[point] * sum[r] - own[r])
    }
}

/// `G = V_j w_ij B q`.
#[inline(always)]
fn weight<const W: usize, const M: usize>(
    coefficients: &[[f64; W]; M],
    q: &[f64; M],
    strength: f64,
) -> [f64; W] {
    let mut g = [0.0; W];
    for (column, q) in coefficients.iter().zip(q) {
        for c in 0..W {
            g[c] += column[c] * q;
        }
    }
    g.map(|g| strength * g)
}

/// Numbers over a power of two near the largest: their unit cancels, and extreme ones stay away from
/// the ends of the range of numbers.
fn normalised(values: &[f64]) -> Vec<f64> {
    let largest = values.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    let (_, exponent) = libm::frexp(largest);
    values.iter().map(|x| libm::ldexp(*x, -exponent)).collect()
}

/// Numbers beyond the end of an array that is read by windows.
const PADDING: usize = 2;

/// `W` numbers from a place on.
#[inline(always)]
fn window<const W: usize>(values: &[f64], start: usize) -> [f64; W] {
    let window = &values[start..start + W];
    std::array::from_fn(|k| window[k])
}

/// The condition numbers, or the worst of those that are too large.
fn check(
    body: &Body,
    neighborhood: &Neighborhood,
    order: OperatorOrder,
    mut conditions: Vec<Result<f64, f64>>,
) -> Result<Vec<f64>, DeformationError> {
    // Points whose families a slab has cut are released where these determine nothing.
    let cut = conditions.iter_mut().enumerate().filter(|(point, _)| body.is_cut(*point));
    cut.filter(|(_, one)| one.is_err()).for_each(|(_, one)| *one = Ok(f64::INFINITY));
    let refused = conditions.iter().enumerate().filter_map(|(p, c)| c.err().map(|c| (p, c)));
    let user = |point: usize| body.user_index()[point] as usize;
    let worst = refused.clone().reduce(|worst, other| {
        let is_worse = other.1 > worst.1 || (other.1 == worst.1 && user(other.0) < user(worst.0));
        if is_worse { other } else { worst }
    });
    match worst {
        None => Ok(conditions.into_iter().flatten().collect()),
        Some((point, condition)) => Err(DeformationError::ShapeTensor {
            point: user(point),
            position: body.position(point).to_vec(),
            neighbors: neighborhood.row(point).len(),
            functions: order.n_functions(body.dimension()),
            condition,
            count: refused.count(),
        }),
    }
}
