//! The gradient and its transpose along the rows of a lattice, eight points abreast.
//!
//! Every point sums over its own family. Consecutive points have the same bonds but for those that end at
//! the surface: of a bond of eight points the vector is known, and the other ends are eight consecutive
//! points, whose numbers are read as they lie. Sums stay in registers until all bonds are through.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::operator::Fitted;
use crate::element::WIDEST;
use crate::fields::stored::Tensor;
use crate::geometry::each;
use crate::geometry::lanes::Lanes;
use crate::interaction::Slabs;
use crate::interaction::runs::{Bundle, Directed, Runs};
use crate::neighborhood::Neighborhood;
use crate::pool::Pool;

/// Groups of points per task; fixed, so that results do not depend on threads.
const GROUPS: usize = 32;

/// How far the influence of a bond may be from that of others of its vector, relative: they are of lengths
/// between rounded positions.
const ALIKE: f64 = 1e-12;

/// What is known of the families of a lattice.
pub(super) struct AlongRows {
    directed: Directed,
    /// `w_ij (X_j - X_i)` in m of each vector, then of each turned around; times the volume of a point
    /// where all have the same.
    weights: Vec<f64>,
    /// Volumes with room before and behind, where they are not all the same.
    volumes: Option<Vec<f64>>,
    /// `B_i/delta` of groups of points, number by number.
    coefficients: Vec<f64>,
    /// `sum_j V_j w_ij q_ij` of groups of points, number by number.
    moments: Vec<f64>,
    per_length: f64,
    n_points: usize,
    arch: Arch,
    room: Pool<Vec<f64>>,
}

impl AlongRows {
    /// Of an operator of first order; nothing where bonds do not repeat, or bonds of one vector have
    /// several influences.
    pub(super) fn new<const D: usize>(
        fitted: &Fitted<'_>,
        neighborhood: &Neighborhood,
    ) -> Option<AlongRows> {
        let body = fitted.body;
        let runs = Runs::new(body, neighborhood, &Slabs::new(neighborhood))?;
        let influence = influence_of_vectors(&runs, runs.n_vectors::<D>(), fitted, neighborhood)?;
        let first = *fitted.volumes.first()?;
        let all_same = fitted.volumes.iter().all(|volume| *volume == first);
        let volume = if all_same { first } else { 1.0 };
        let vectors = runs.vectors::<D>();
        let weight = |way: f64| {
            let weights = vectors.iter().zip(&influence);
            weights.flat_map(move |(x, w)| x.map(|x| way * x * w * volume))
        };
        let n = body.n_points();
        let by_groups = |values: &[f64], width: usize, factor: f64| -> Vec<f64> {
            let groups = 0..n.div_ceil(WIDEST);
            let number = |group: usize, k: usize, lane: usize| {
                let point = group * WIDEST + lane;
                if point < n { factor * values[point * width + k] } else { 0.0 }
            };
            let numbers =
                |group| (0..width).flat_map(move |k| (0..WIDEST).map(move |l| (group, k, l)));
            groups.flat_map(numbers).map(|(group, k, lane)| number(group, k, lane)).collect()
        };
        let room = [0.0; WIDEST];
        Some(AlongRows {
            directed: runs.directed::<D>(std::iter::once(0..n)),
            weights: weight(1.0).chain(weight(-1.0)).collect(),
            volumes: (!all_same).then(|| [&room, fitted.volumes, &room].concat()),
            coefficients: by_groups(fitted.coefficients, D * D, fitted.per_length),
            moments: by_groups(fitted.moments, D, 1.0),
            per_length: fitted.per_length,
            n_points: n,
            arch: Arch::new(),
            room: Pool::new(),
        })
    }

    /// Takes out bonds by their ends.
    pub(super) fn lose(&mut self, bonds: &[[usize; 2]]) {
        for &[i, j] in bonds {
            self.directed.lose(i, j);
            self.directed.lose(j, i);
        }
    }

    /// Other coefficients `B_i` in 1/m and moments of a point.
    pub(super) fn set(&mut self, point: usize, coefficients: &[f64], moments: &[f64]) {
        let (group, lane) = (point / WIDEST, point % WIDEST);
        for (all, own, factor) in [
            (&mut self.coefficients, coefficients, self.per_length),
            (&mut self.moments, moments, 1.0),
        ] {
            let all = &mut all[group * own.len() * WIDEST..];
            own.iter().enumerate().for_each(|(k, x)| all[k * WIDEST + lane] = factor * x);
        }
    }

    /// From one axis to the next of arrays that are read by groups.
    fn stride(&self) -> usize {
        self.n_points.next_multiple_of(WIDEST) + 2 * WIDEST
    }

    /// `h` becomes the gradients of the displacements `u`.
    pub(super) fn gradient<const D: usize>(&self, u: &[[f64; D]], h: &mut [Tensor<D>]) {
        let mut room = self.room.take(Vec::new);
        let stride = self.stride();
        room.resize(D * stride, 0.0);
        room.par_chunks_mut(stride).enumerate().for_each(|(axis, out)| {
            out[WIDEST..].iter_mut().zip(u).for_each(|(out, u)| *out = u[axis]);
        });
        let u = &room[..];
        h.par_chunks_mut(GROUPS * WIDEST).enumerate().for_each(|(chunk, h)| {
            let groups = chunk * GROUPS..chunk * GROUPS + h.len().div_ceil(WIDEST);
            self.arch.dispatch(Gradients::<D> { rows: self, groups, stride, u, h });
        });
    }

    /// Adds to `forces` the transpose of the gradient: of `stress`, with the coefficients `B_i` in 1/m.
    pub(super) fn add_transpose<const D: usize>(
        &self,
        stress: &[Tensor<D>],
        coefficients: &[f64],
        room: &mut Vec<f64>,
        forces: &mut [[f64; D]],
    ) {
        let stride = self.stride();
        room.clear();
        room.resize(D * D * stride, 0.0);
        room.par_chunks_mut(stride).enumerate().for_each(|(number, out)| {
            let (k, r) = (number / D, number % D);
            let points = stress.iter().zip(coefficients.chunks_exact(D * D));
            for (out, (stress, coefficients)) in out[WIDEST..].iter_mut().zip(points) {
                let column = &coefficients[k * D..(k + 1) * D];
                *out = (0..D).fold(0.0, |sum, c| sum + stress[r][c] * column[c]);
            }
        });
        let columns = &room[..];
        forces.par_chunks_mut(GROUPS * WIDEST).enumerate().for_each(|(chunk, forces)| {
            let groups = chunk * GROUPS..chunk * GROUPS + forces.len().div_ceil(WIDEST);
            self.arch.dispatch(Forces::<D> { rows: self, groups, stride, columns, forces });
        });
    }

    /// 1 for points of a group that have a bond, 0 for others; nothing where all have it. Times the volumes
    /// of the other ends, if these are wanted and not all the same.
    #[inline(always)]
    fn scale<S: Simd>(
        &self,
        simd: S,
        bundle: &Bundle,
        register: usize,
        with_volumes: bool,
    ) -> Option<Lanes<S>> {
        let mut scale = None;
        if bundle.owners != u8::MAX {
            let inside: [f64; WIDEST] = each(|lane| f64::from(bundle.owners >> lane & 1));
            scale = Some(Lanes::load(simd, &inside, register));
        }
        if with_volumes && let Some(volumes) = &self.volumes {
            let volume = Lanes::load(simd, &volumes[place(bundle.other as isize)..], register);
            scale = Some(match scale {
                Some(inside) => inside * volume,
                None => volume,
            });
        }
        scale
    }
}

/// The influence of the bonds of each vector.
fn influence_of_vectors(
    runs: &Runs,
    n_vectors: usize,
    fitted: &Fitted<'_>,
    neighborhood: &Neighborhood,
) -> Option<Vec<f64>> {
    let mut found: Vec<Option<f64>> = vec![None; n_vectors];
    for ([i, j], vector) in runs.bonds() {
        let place = neighborhood.row(i).place(j as u32)?;
        let influence = fitted.influence[neighborhood.places(i).start + place];
        let known = *found[vector].get_or_insert(influence);
        if (influence - known).abs() > ALIKE * known.abs() {
            return None;
        }
    }
    found.into_iter().collect()
}

/// Where the numbers of a point stand.
#[inline(always)]
fn place(point: isize) -> usize {
    point.wrapping_add(WIDEST as isize) as usize
}

/// Gradients of some groups on their way.
struct Gradients<'a, const D: usize> {
    rows: &'a AlongRows,
    groups: Range<usize>,
    stride: usize,
    u: &'a [f64],
    h: &'a mut [Tensor<D>],
}

impl<const D: usize> WithSimd for Gradients<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Gradients { rows, groups, stride, u, h } = self;
        let zero = Lanes::splat(simd, 0.0);
        let weights = rows.weights.as_chunks::<D>().0;
        let u: [&[f64]; D] = each(|axis| &u[axis * stride..][..stride]);
        for (group, h) in groups.zip(h.chunks_mut(WIDEST)) {
            let mut found = [[[0.0; WIDEST]; D]; D];
            for register in 0..WIDEST / Lanes::<S>::WIDTH {
                let at = |axis: usize, place: usize| Lanes::load(simd, &u[axis][place..], register);
                let here: [Lanes<S>; D] = each(|axis| at(axis, (group + 1) * WIDEST));
                let mut sums = [[zero; D]; D];
                for bundle in rows.directed.of_group(group) {
                    let weight = &weights[bundle.vector as usize];
                    let there = place(bundle.other as isize);
                    let mut eta: [Lanes<S>; D] = each(|axis| at(axis, there) - here[axis]);
                    if let Some(scale) = rows.scale(simd, bundle, register, true) {
                        eta = each(|axis| eta[axis] * scale);
                    }
                    for c in 0..D {
                        let weight = Lanes::splat(simd, weight[c]);
                        for r in 0..D {
                            sums[r][c] = sums[r][c] + eta[r] * weight;
                        }
                    }
                }
                let numbers = &rows.coefficients[group * D * D * WIDEST..][..D * D * WIDEST];
                let b = |k: usize, c: usize| {
                    Lanes::load(simd, &numbers[(k * D + c) * WIDEST..][..WIDEST], register)
                };
                for c in 0..D {
                    let column: [Lanes<S>; D] = each(|k| b(k, c));
                    for r in 0..D {
                        let mut sum = sums[r][0] * column[0];
                        for k in 1..D {
                            sum = sum + sums[r][k] * column[k];
                        }
                        sum.store(&mut found[r][c], register);
                    }
                }
            }
            for (lane, h) in h.iter_mut().enumerate() {
                for r in 0..D {
                    for c in 0..D {
                        h[r][c] = found[r][c][lane];
                    }
                }
            }
        }
    }
}

/// Forces of some groups on their way.
struct Forces<'a, const D: usize> {
    rows: &'a AlongRows,
    groups: Range<usize>,
    stride: usize,
    /// `stress_i B_i`, column by column, number by number.
    columns: &'a [f64],
    forces: &'a mut [[f64; D]],
}

impl<const D: usize> WithSimd for Forces<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Forces { rows, groups, stride, columns, forces } = self;
        let zero = Lanes::splat(simd, 0.0);
        let weights = rows.weights.as_chunks::<D>().0;
        let per_length = Lanes::splat(simd, rows.per_length);
        for (group, forces) in groups.zip(forces.chunks_mut(WIDEST)) {
            let mut found = [[0.0; WIDEST]; D];
            for register in 0..WIDEST / Lanes::<S>::WIDTH {
                let at = |number: usize, place: usize| {
                    let axis = &columns[number * stride..][..stride];
                    Lanes::load(simd, &axis[place..], register)
                };
                let mut sums = [zero; D];
                for bundle in rows.directed.of_group(group) {
                    let there = place(bundle.other as isize);
                    let inside = rows.scale(simd, bundle, register, false);
                    // Seen from the other end the vector points here.
                    for k in 0..D {
                        let mut weight = Lanes::splat(simd, -weights[bundle.vector as usize][k]);
                        if let Some(inside) = inside {
                            weight = weight * inside;
                        }
                        for r in 0..D {
                            sums[r] = sums[r] + at(k * D + r, there) * weight;
                        }
                    }
                }
                let own = (group + 1) * WIDEST;
                let volume = match &rows.volumes {
                    Some(volumes) => Lanes::load(simd, &volumes[own..], register),
                    // It is in the weights.
                    None => Lanes::splat(simd, 1.0),
                };
                let moments = &rows.moments[group * D * WIDEST..][..D * WIDEST];
                for r in 0..D {
                    let mut force = sums[r] * (volume * per_length);
                    for k in 0..D {
                        let moment = Lanes::load(simd, &moments[k * WIDEST..][..WIDEST], register);
                        force = force - at(k * D + r, own) * moment;
                    }
                    force.store(&mut found[r], register);
                }
            }
            for (lane, force) in forces.iter_mut().enumerate() {
                for r in 0..D {
                    force[r] += found[r][lane];
                }
            }
        }
    }
}
