//! The exact Hessian row by row, and its diagonal: for small bodies, and as the witness of the
//! products.
//!
//! With `H = B u` it is `B^T S_HH B + B^T S_Hu + S_uH B + S_uu`, the second derivatives `S` by the
//! fields `H` and `u` being blocks of points and bonds. A row takes from its point's family what a
//! displacement of the point does to the duals of all fields there, and spreads these over the
//! families of the points that they belong to.

use std::sync::Arc;

use rayon::prelude::*;

use super::batch::{LawBatch, determinant};
use super::operator::{GradientOperator, Tensor};
use super::quadrature::BondStiffness;
use super::stabilisation::Deviations;
use super::sweep::{Failure, Fields};
use crate::body::Body;
use crate::kernel::VariablesLaw;
use crate::matrix::{BlockMatrix, BlockPattern};
use crate::neighborhood::Neighborhood;

/// Points that are reached over so many bonds, as a pattern.
pub(crate) fn pattern(neighborhood: &Neighborhood, dimension: usize, reach: usize) -> BlockPattern {
    let n = neighborhood.n_points();
    let row = |seen: &mut Vec<u32>, point: usize| {
        let mut found = vec![point as u32];
        seen[point] = point as u32;
        let mut ring = 0..1;
        for _ in 0..reach {
            for k in ring.clone() {
                for &j in neighborhood.row(found[k] as usize) {
                    if seen[j as usize] != point as u32 {
                        seen[j as usize] = point as u32;
                        found.push(j);
                    }
                }
            }
            ring = ring.end..found.len();
        }
        found.retain(|&j| j as usize >= point);
        found.sort_unstable();
        found
    };
    let rows: Vec<Vec<u32>> = (0..n).into_par_iter().map_init(|| vec![u32::MAX; n], row).collect();
    let mut row_start = vec![0];
    row_start.extend(rows.iter().scan(0, |end, row| {
        *end += row.len();
        Some(*end)
    }));
    BlockPattern { dimension, row_start, columns: rows.concat() }
}

/// Second derivatives of the energy by the fields.
pub(super) struct FieldStiffness<'a, const D: usize> {
    body: &'a Body,
    operator: &'a GradientOperator,
    /// By `H_i` twice, `d^2 x d^2` for each point.
    points: Vec<f64>,
    bonds: Bonds<'a>,
}

/// Those that couple the two ends of a bond.
pub(super) enum Bonds<'a> {
    None,
    Deviations(&'a Deviations),
    Quadrature(BondStiffness),
}

/// Derivatives by one end's `H` and `u_j - u_i`, entry `[r][c][s]` by `H_rc` and component `s`.
type Mixed<const D: usize> = [Tensor<D>; D];

impl<'a, const D: usize> FieldStiffness<'a, D> {
    /// `law` is that of the points, if it is evaluated there.
    pub(super) fn new(
        body: &'a Body,
        operator: &'a GradientOperator,
        law: Option<&dyn VariablesLaw>,
        fields: Fields<'_, D>,
        bonds: Bonds<'a>,
    ) -> Result<FieldStiffness<'a, D>, Failure> {
        let size = D * D * D * D;
        let mut points = vec![0.0; body.n_points() * size];
        let all = FieldStiffness { body, operator, points: Vec::new(), bonds };
        let fill = |batch: &mut LawBatch<D>, (point, out): (usize, &mut [f64])| {
            if let Some(law) = law {
                let h = &fields.h[point];
                let second = batch
                    .second(law, h)
                    .map_err(|_| Failure { points: vec![point], determinant: determinant(h) })?;
                let volume = body.volumes()[point];
                out.iter_mut().zip(second).for_each(|(out, second)| *out = volume * second);
            }
            all.add_bonds_of(point, out);
            Ok(())
        };
        let chunks = points.par_chunks_exact_mut(size).with_min_len(64).enumerate();
        let done: Vec<Result<(), Failure>> = chunks.map_init(LawBatch::new, fill).collect();
        done.into_iter().collect::<Result<(), Failure>>()?;
        Ok(FieldStiffness { points, ..all })
    }

    /// What the energies of a point's bonds are by its `H` twice.
    fn add_bonds_of(&self, point: usize, out: &mut [f64]) {
        for (k, &j) in self.operator.neighborhood().row(point).iter().enumerate() {
            match &self.bonds {
                Bonds::None => return,
                Bonds::Quadrature(bonds) => {
                    let (owner, k) = self.bond(point, k, j as usize);
                    let [hh, ..] = bonds.bond(owner, k);
                    out.iter_mut().zip(hh).for_each(|(out, hh)| *out += hh);
                }
                Bonds::Deviations(deviations) => {
                    let (owner, k) = self.bond(point, k, j as usize);
                    let strength = deviations.strengths(owner)[k];
                    let (a, dx) =
                        (deviations.stiffness::<D>(point), self.offset(point, j as usize));
                    for r in 0..D {
                        for c in 0..D {
                            for s in 0..D {
                                for e in 0..D {
                                    out[(r * D + c) * D * D + s * D + e] +=
                                        strength * a[r][s] * dx[c] * dx[e];
                                }
                            }
                        }
                    }
                }
            }
        }
    }

    fn offset(&self, i: usize, j: usize) -> [f64; D] {
        let positions = self.body.positions().as_chunks::<D>().0;
        std::array::from_fn(|c| positions[j][c] - positions[i][c])
    }

    /// The owner of a point's `k`-th bond and its number there.
    fn bond(&self, point: usize, k: usize, other: usize) -> (usize, usize) {
        let neighborhood = self.operator.neighborhood();
        if point < other {
            (point, k - (neighborhood.row(point).len() - neighborhood.upper(point).len()))
        } else {
            let found = neighborhood.upper(other).binary_search(&(point as u32));
            (other, found.unwrap_or_default())
        }
    }

    /// Derivatives by the `H` of one end of the bond from `i` to `j` and by `u_j - u_i`.
    fn mixed(&self, end: usize, (i, j): (usize, usize), (owner, k): (usize, usize)) -> Mixed<D> {
        let mut mixed = [[[0.0; D]; D]; D];
        match &self.bonds {
            Bonds::None => {}
            Bonds::Quadrature(bonds) => {
                let sign = if owner == i { 1.0 } else { -1.0 };
                let [_, of_end, _] = bonds.bond(owner, k);
                for (place, x) in of_end.iter().enumerate() {
                    mixed[place / (D * D)][place / D % D][place % D] = sign * x;
                }
            }
            Bonds::Deviations(deviations) => {
                let strength = deviations.strengths(owner)[k];
                let (a, dx) = (deviations.stiffness::<D>(end), self.offset(i, j));
                for r in 0..D {
                    for c in 0..D {
                        for s in 0..D {
                            mixed[r][c][s] = -strength * a[r][s] * dx[c];
                        }
                    }
                }
            }
        }
        mixed
    }

    /// Derivatives by the difference of displacements of a bond's ends twice.
    fn direct(&self, (i, j): (usize, usize), (owner, k): (usize, usize)) -> Tensor<D> {
        match &self.bonds {
            Bonds::None => [[0.0; D]; D],
            Bonds::Quadrature(bonds) => {
                let [.., of_bond] = bonds.bond(owner, k);
                std::array::from_fn(|r| std::array::from_fn(|s| of_bond[r * D + s]))
            }
            Bonds::Deviations(deviations) => {
                let strength = deviations.strengths(owner)[k];
                let (here, there) = (deviations.stiffness::<D>(i), deviations.stiffness::<D>(j));
                std::array::from_fn(|r| {
                    std::array::from_fn(|s| strength * (here[r][s] + there[r][s]))
                })
            }
        }
    }

    /// The whole tangent on its pattern.
    pub(super) fn tangent(&self, tangent: &mut BlockMatrix) {
        let pattern = Arc::clone(&tangent.pattern);
        let n = pattern.n_rows();
        let mut rows = Vec::with_capacity(n);
        let mut rest = &mut tangent.values[..];
        for point in 0..n {
            let blocks = pattern.row_start[point + 1] - pattern.row_start[point];
            let (row, tail) = std::mem::take(&mut rest).split_at_mut(blocks * D * D);
            rows.push((point, row));
            rest = tail;
        }
        let fill = |scratch: &mut Scratch<D>, (point, out): (usize, &mut [f64])| {
            let columns = &pattern.columns[pattern.row_start[point]..pattern.row_start[point + 1]];
            let all = matches!(self.bonds, Bonds::Quadrature(_));
            self.row(scratch, point, columns, all, out);
        };
        rows.into_par_iter().map_init(|| Scratch::new(n), fill).collect::<()>();
    }

    /// Its diagonal blocks.
    pub(super) fn diagonal(&self, blocks: &mut [f64]) {
        let n = self.body.n_points();
        let fill = |scratch: &mut Scratch<D>, (point, out): (usize, &mut [f64])| {
            self.row(scratch, point, &[point as u32], false, out);
        };
        let blocks = blocks.par_chunks_exact_mut(D * D).enumerate();
        blocks.map_init(|| Scratch::new(n), fill).collect::<()>();
    }

    /// The blocks of a row at some columns, ascending. `beyond` tells whether displacements of the
    /// point change fields outside its family.
    fn row(
        &self,
        scratch: &mut Scratch<D>,
        point: usize,
        columns: &[u32],
        beyond: bool,
        out: &mut [f64],
    ) {
        out.fill(0.0);
        scratch.start(point, columns);
        let neighborhood = self.operator.neighborhood();
        scratch.see(point);
        neighborhood.row(point).iter().for_each(|&j| scratch.see(j as usize));
        if beyond {
            for &i in neighborhood.row(point) {
                neighborhood.row(i as usize).iter().for_each(|&j| scratch.see(j as usize));
            }
        }
        self.through_gradients(scratch, point, self.operator.own::<D>(point), out);
        for (i, weight) in self.operator.in_families::<D>(point) {
            self.through_gradients(scratch, i, weight, out);
        }
        self.through_bonds(scratch, point, out);
        self.spread(scratch, columns, out);
    }

    /// The force at the point by way of `H_i`, in which it has this weight.
    fn through_gradients(
        &self,
        scratch: &mut Scratch<D>,
        i: usize,
        weight: [f64; D],
        out: &mut [f64],
    ) {
        let size = D * D * D * D;
        scratch.add_contracted(i, weight, &self.points[i * size..(i + 1) * size]);
        if matches!(self.bonds, Bonds::None) {
            return;
        }
        let mut at_i = [[0.0; D]; D];
        for (k, &j) in self.operator.neighborhood().row(i).iter().enumerate() {
            let j = j as usize;
            let (owner, k) = self.bond(i, k, j);
            if let Bonds::Quadrature(bonds) = &self.bonds {
                scratch.add_contracted(j, weight, bonds.bond(owner, k)[0]);
            }
            let place = scratch.place(j);
            if place.is_none() && scratch.place(i).is_none() {
                continue;
            }
            let mixed = self.mixed(i, (i, j), (owner, k));
            let block: Tensor<D> = std::array::from_fn(|r| {
                std::array::from_fn(|s| (0..D).fold(0.0, |sum, c| sum + weight[c] * mixed[r][c][s]))
            });
            add(out, place, &block, 1.0);
            for r in 0..D {
                for s in 0..D {
                    at_i[r][s] += block[r][s];
                }
            }
        }
        add(out, scratch.place(i), &at_i, -1.0);
    }

    /// The force at the point by the differences of displacements of its own bonds.
    fn through_bonds(&self, scratch: &mut Scratch<D>, point: usize, out: &mut [f64]) {
        if matches!(self.bonds, Bonds::None) {
            return;
        }
        for (k, &j) in self.operator.neighborhood().row(point).iter().enumerate() {
            let j = j as usize;
            let (owner, k) = self.bond(point, k, j);
            for end in [point, j] {
                let mixed = self.mixed(end, (point, j), (owner, k));
                scratch.subtract_transposed(end, &mixed);
            }
            let direct = self.direct((point, j), (owner, k));
            add(out, scratch.place(j), &direct, -1.0);
            add(out, scratch.place(point), &direct, 1.0);
        }
    }

    /// From derivatives of the force by `H_j` to those by displacements.
    fn spread(&self, scratch: &Scratch<D>, columns: &[u32], out: &mut [f64]) {
        let block = |duals: &[f64], g: &[f64; D]| -> Tensor<D> {
            std::array::from_fn(|r| {
                std::array::from_fn(|s| {
                    let row = &duals[(r * D + s) * D..(r * D + s + 1) * D];
                    (0..D).fold(0.0, |sum, e| sum + row[e] * g[e])
                })
            })
        };
        let duals = |slot: usize| &scratch.duals[slot * D * D * D..(slot + 1) * D * D * D];
        if let [only] = columns {
            let only = *only as usize;
            if let Some(slot) = scratch.slot(only) {
                add(out, Some(0), &block(duals(slot), &self.operator.own::<D>(only)), 1.0);
            }
            for (j, g) in self.operator.in_families::<D>(only) {
                if let Some(slot) = scratch.slot(j) {
                    add(out, Some(0), &block(duals(slot), &g), 1.0);
                }
            }
            return;
        }
        let Some(&lowest) = columns.first() else { return };
        for (slot, &j) in scratch.seen.iter().enumerate() {
            let j = j as usize;
            let (row, weights) = self.operator.family::<D>(j);
            let later = row.partition_point(|&b| b < lowest);
            for (&b, g) in row[later..].iter().zip(&weights[later..]) {
                add(out, scratch.place(b as usize), &block(duals(slot), g), 1.0);
            }
            if scratch.place(j).is_some() {
                let own = self.operator.own::<D>(j);
                add(out, scratch.place(j), &block(duals(slot), &own), 1.0);
            }
        }
    }
}

/// Adds a block at a place, if there is one.
fn add<const D: usize>(out: &mut [f64], place: Option<usize>, block: &Tensor<D>, factor: f64) {
    let Some(place) = place else { return };
    let out = &mut out[place * D * D..(place + 1) * D * D];
    for (out, x) in out.iter_mut().zip(block.as_flattened()) {
        *out += factor * x;
    }
}

const NOWHERE: u32 = u32::MAX;

/// Work arrays of one thread.
struct Scratch<const D: usize> {
    /// Which block of the row a point has.
    places: Vec<u32>,
    columns: Vec<u32>,
    /// Which slot of `duals` a point has.
    slots: Vec<u32>,
    seen: Vec<u32>,
    /// Derivatives of the force at the row's point by `H_j`: entry `[r][s][e]` of component `r` by
    /// `H_se`.
    duals: Vec<f64>,
}

impl<const D: usize> Scratch<D> {
    fn new(n: usize) -> Scratch<D> {
        Scratch {
            places: vec![NOWHERE; n],
            columns: Vec::new(),
            slots: vec![NOWHERE; n],
            seen: Vec::new(),
            duals: Vec::new(),
        }
    }

    fn start(&mut self, point: usize, columns: &[u32]) {
        debug_assert!(columns.first() == Some(&(point as u32)));
        self.columns.iter().for_each(|&b| self.places[b as usize] = NOWHERE);
        self.seen.iter().for_each(|&j| self.slots[j as usize] = NOWHERE);
        self.columns.clear();
        self.columns.extend_from_slice(columns);
        for (place, &b) in columns.iter().enumerate() {
            self.places[b as usize] = place as u32;
        }
        self.seen.clear();
        self.duals.clear();
    }

    fn see(&mut self, point: usize) {
        if self.slots[point] == NOWHERE {
            self.slots[point] = self.seen.len() as u32;
            self.seen.push(point as u32);
            self.duals.resize(self.seen.len() * D * D * D, 0.0);
        }
    }

    fn place(&self, point: usize) -> Option<usize> {
        (self.places[point] != NOWHERE).then_some(self.places[point] as usize)
    }

    fn slot(&self, point: usize) -> Option<usize> {
        (self.slots[point] != NOWHERE).then_some(self.slots[point] as usize)
    }

    /// Adds `sum_c weight_c second_(rc)(se)` to the derivatives by `H_j`.
    fn add_contracted(&mut self, j: usize, weight: [f64; D], second: &[f64]) {
        let Some(slot) = self.slot(j) else { return };
        let (size, start) = (D * D, slot * D * D * D);
        for r in 0..D {
            let out = &mut self.duals[start + r * size..start + (r + 1) * size];
            for c in 0..D {
                let row = &second[(r * D + c) * size..(r * D + c + 1) * size];
                for (out, x) in out.iter_mut().zip(row) {
                    *out += weight[c] * x;
                }
            }
        }
    }

    fn subtract_transposed(&mut self, end: usize, mixed: &Mixed<D>) {
        let Some(slot) = self.slot(end) else { return };
        let start = slot * D * D * D;
        for r in 0..D {
            for s in 0..D {
                for e in 0..D {
                    self.duals[start + (r * D + s) * D + e] -= mixed[s][e][r];
                }
            }
        }
    }
}
