//! Bond-associated quadrature points (partmann2026 4.21 to 4.33): the energy of deformation gradients
//! at the bonds.
//!
//! `W = sum over bonds of 2 V_i V_j wb_ij psi(F_ij)`, each bond once, with
//! `F_ij = (F_i + F_j)/2 (I - M) + (x_j - x_i) x dX/L^2`, `M = dX x dX/L^2` and
//! `wb_ij = w_ij/2 (1/w0_i + 1/w0_j)`, `w0_i = sum_j V_j w_ij`. The weights of all bonds sum up to the
//! volume of the body, so that affine displacements have the energy of the continuum.

use std::ops::Range;

use pulp::Arch;
use rayon::prelude::*;

use super::batch::{CAPACITY, LawBatch, determinant};
use super::columns::BondColumns;
use super::operator::GradientOperator;
use super::stabilisation::sum_of;
use super::sweep::{Failure, Fields, Pass, TouchedDuals, turned};
use crate::assembly::sum::Sum;
use crate::body::Body;
use crate::fields::stored::Tensor;
use crate::geometry::lanes::InRegisters;
use crate::interaction::Slabs;
use crate::materials::{LawOfPoints, Place};
use crate::neighborhood::{Gaps, Neighborhood};

/// The weights of all bonds.
pub(super) struct BondQuadrature {
    /// `2 V_i V_j wb_ij` in m^d, of each bond once.
    pub(super) weight: Vec<f64>,
    /// `w0_i`.
    sums: Vec<f64>,
    /// The numbers of the bonds among those of the whole families, where bonds remember something.
    numbers: Option<Vec<usize>>,
}

/// A bond with its deformation gradient.
#[derive(Clone, Copy)]
pub(super) struct Bond<const D: usize> {
    pub(super) points: [usize; 2],
    /// Among the bonds of the whole families, where bonds remember something.
    number: usize,
    /// `X_j - X_i`.
    pub(super) dx: [f64; D],
    /// `dX/L^2`.
    pub(super) along: [f64; D],
}

impl<const D: usize> Bond<D> {
    pub(super) fn new(positions: &[[f64; D]], [i, j]: [usize; 2], number: usize) -> Bond<D> {
        let dx: [f64; D] = std::array::from_fn(|c| positions[j][c] - positions[i][c]);
        let squared = dx.iter().fold(0.0, |sum, x| sum + x * x);
        Bond { points: [i, j], number, dx, along: dx.map(|x| x / squared) }
    }

    /// Where its law is evaluated.
    #[inline(always)]
    pub(super) fn place(&self) -> Place {
        Place { ends: self.points, bond: self.number }
    }

    /// `F_ij - I` from the fields.
    #[inline(always)]
    pub(super) fn gradient(&self, fields: Fields<'_, D>) -> Tensor<D> {
        let [i, j] = self.points;
        let mut h = fields.h[i];
        for r in 0..D {
            for c in 0..D {
                h[r][c] = 0.5 * (h[r][c] + fields.h[j][r][c]);
            }
            let change = fields.u[j][r] - fields.u[i][r];
            let missing = (0..D).fold(change, |sum, c| sum - h[r][c] * self.dx[c]);
            for c in 0..D {
                h[r][c] += missing * self.along[c];
            }
        }
        h
    }

    /// Adds half of a virial to either end.
    fn share_virial(&self, stress: &Tensor<D>, weight: f64, duals: &mut TouchedDuals<'_, D>) {
        let [i, j] = self.points;
        for end in duals.stress.pair(i, j) {
            let all = end.as_flattened_mut().iter_mut().zip(stress.as_flattened());
            all.for_each(|(sum, x)| *sum += 0.5 * weight * x);
        }
    }
}

impl<const D: usize> Bond<D> {
    /// Adds to the blocks of [`BondStiffness`] from `weight*d2psi/dF2` (`d^2 x d^2`, row by row).
    fn pull_back(&self, weight: f64, second: &[f64], out: &mut [f64]) {
        let (size, hh) = (D * D, D * D * D * D);
        // `(I - M)_ec`, by which half of the mean of `H` enters.
        let half = |e: usize, c: usize| {
            let one = if e == c { 1.0 } else { 0.0 };
            0.5 * (one - self.along[e] * self.dx[c])
        };
        // The last index contracted with `(I - M)/2` and with `dX/L^2`.
        let (mut mean, mut bond) = (vec![0.0; size * size], vec![0.0; size * D]);
        for rc in 0..size {
            for s in 0..D {
                let row = &second[rc * size + s * D..rc * size + (s + 1) * D];
                for f in 0..D {
                    let sum = (0..D).fold(0.0, |sum, e| sum + row[e] * half(f, e));
                    mean[rc * size + s * D + f] = weight * sum;
                }
                let sum = (0..D).fold(0.0, |sum, e| sum + row[e] * self.along[e]);
                bond[rc * D + s] = weight * sum;
            }
        }
        for r in 0..D {
            for f in 0..D {
                let rf = turned::<D>(r * D + f);
                for se in 0..size {
                    let term = |c: usize| mean[(r * D + c) * size + se] * half(f, c);
                    out[rf * size + turned::<D>(se)] += (0..D).fold(0.0, |sum, c| sum + term(c));
                }
                for s in 0..D {
                    let term = |c: usize| bond[(r * D + c) * D + s] * half(f, c);
                    out[hh + rf * D + s] += (0..D).fold(0.0, |sum, c| sum + term(c));
                }
            }
            for s in 0..D {
                let term = |c: usize| bond[(r * D + c) * D + s] * self.along[c];
                out[hh + size * D + r * D + s] += (0..D).fold(0.0, |sum, c| sum + term(c));
            }
        }
    }
}

/// Second derivatives of the bonds' energies by the fields: by `H_i` and `H_j`, by either and
/// `u_j - u_i`, by the latter twice.
pub(super) struct BondStiffness {
    dimension: usize,
    values: Vec<f64>,
}

impl BondStiffness {
    fn entries(d: usize) -> usize {
        d * d * (d * d + d + 1)
    }

    /// The three blocks of the bond of a number: `d^2 x d^2`, the same for each pair of ends;
    /// `d^2 x d`; `d x d`. Components of `H` stand column by column.
    pub(super) fn bond(&self, number: usize) -> [&[f64]; 3] {
        let d = self.dimension;
        let entries = BondStiffness::entries(d);
        let values = &self.values[number * entries..(number + 1) * entries];
        let (hh, rest) = values.split_at(d * d * d * d);
        let (hd, dd) = rest.split_at(d * d * d);
        [hh, hd, dd]
    }
}

impl BondQuadrature {
    /// Of the whole families of an operator, whose bonds remember something or not.
    pub(super) fn new(operator: &GradientOperator, remember: bool) -> BondQuadrature {
        let neighborhood = operator.neighborhood();
        let points = 0..neighborhood.n_points();
        let sums = points.clone().map(|point| sum_of(operator, point)).collect();
        let weight = Vec::with_capacity(neighborhood.n_bonds());
        let numbers = remember.then(|| (0..neighborhood.n_bonds()).collect());
        let mut quadrature = BondQuadrature { weight, sums, numbers };
        for i in points {
            let later = neighborhood.upper(i).iter().zip(operator.later_influence(i));
            let weights = later.map(|(j, w)| quadrature.of_bond(operator, [i, j as usize], *w));
            let weights: Vec<f64> = weights.collect();
            quadrature.weight.extend(weights);
        }
        quadrature
    }

    /// Follows an operator that has lost bonds: those of their ends have other weights. Without bonds a sum is
    /// 0, and no bond asks for it.
    pub(super) fn lose(&mut self, (operator, gaps): (&GradientOperator, &Gaps), points: &[usize]) {
        gaps.close_bonds(&mut self.weight);
        self.numbers.iter_mut().for_each(|numbers| gaps.close_bonds(numbers));
        points.iter().for_each(|point| self.sums[*point] = sum_of(operator, *point));
        let neighborhood = operator.neighborhood();
        for &point in points {
            let bonds = neighborhood.bonds(point);
            let later = neighborhood.upper(point).iter().zip(operator.later_influence(point));
            for (bond, (j, w)) in bonds.zip(later) {
                self.weight[bond] = self.of_bond(operator, [point, j as usize], *w);
            }
            let earlier = neighborhood.row(point).iter().map(|j| j as usize);
            for i in earlier.take_while(|j| *j < point) {
                if let Some(place) = neighborhood.upper(i).place(point as u32) {
                    let w = operator.later_influence(i)[place];
                    let bond = neighborhood.bonds(i).start + place;
                    self.weight[bond] = self.of_bond(operator, [i, point], w);
                }
            }
        }
    }

    /// The number among the bonds of the whole families of a bond that is left, where bonds remember something.
    #[inline(always)]
    pub(super) fn number(&self, bond: usize) -> usize {
        self.numbers.as_ref().map_or(0, |numbers| numbers[bond])
    }

    /// Whether bonds remember something.
    pub(super) fn remembers(&self) -> bool {
        self.numbers.is_some()
    }

    /// The weight of a bond of this influence.
    fn of_bond(&self, operator: &GradientOperator, [i, j]: [usize; 2], w: f64) -> f64 {
        let volumes = operator.body().volumes();
        volumes[i] * volumes[j] * (w / self.sums[i] + w / self.sums[j])
    }

    /// The second derivatives of all bonds' energies by the fields, from those by `F_ij`.
    pub(super) fn stiffness<const D: usize>(
        &self,
        law: LawOfPoints<'_>,
        (body, neighborhood): (&Body, &Neighborhood),
        fields: Fields<'_, D>,
    ) -> Result<BondStiffness, Failure> {
        let positions = body.positions().as_chunks::<D>().0;
        let bonds = |i: usize| {
            let bonds = neighborhood.bonds(i).zip(neighborhood.upper(i));
            bonds.map(move |(bond, j)| Bond::new(positions, [i, j as usize], self.number(bond)))
        };
        let entries = BondStiffness::entries(D);
        let mut values = vec![0.0; self.weight.len() * entries];
        let mut rows = Vec::with_capacity(neighborhood.n_points());
        let mut rest = &mut values[..];
        for i in 0..neighborhood.n_points() {
            let (row, tail) =
                std::mem::take(&mut rest).split_at_mut(neighborhood.upper(i).len() * entries);
            rows.push((i, row));
            rest = tail;
        }
        let fill = |batch: &mut LawBatch<D>, (i, row): (usize, &mut [f64])| {
            for ((bond, weight), out) in
                bonds(i).zip(&self.weight[neighborhood.bonds(i)]).zip(row.chunks_exact_mut(entries))
            {
                for (number, part) in law.parts(bond.points).iter() {
                    let place = (bond.place(), &bond.gradient(fields));
                    let second = batch.second((law, number as u8), place);
                    let second = second.map_err(|determinant| Failure {
                        points: bond.points.to_vec(),
                        determinant,
                    })?;
                    bond.pull_back(part * *weight, second, out);
                }
            }
            Ok(())
        };
        let done: Vec<Result<(), Failure>> =
            rows.into_par_iter().map_init(LawBatch::new, fill).collect();
        done.into_iter().collect::<Result<(), Failure>>()?;
        Ok(BondStiffness { dimension: D, values })
    }

    /// The bonds of one slab.
    pub(super) fn visit<const D: usize>(
        &self,
        law: LawOfPoints<'_>,
        (body, neighborhood, slabs): (&Body, &Neighborhood, &Slabs),
        slab: usize,
        (fields, pass): (Fields<'_, D>, Pass<'_, D>),
        duals: TouchedDuals<'_, D>,
    ) -> Result<Sum, Failure> {
        let arch = Arch::new();
        let positions = body.positions().as_chunks::<D>().0;
        let nothing = Bond { points: [0; 2], number: 0, dx: [0.0; D], along: [0.0; D] };
        let mut run = Run {
            law,
            fields,
            pass,
            duals,
            n: 0,
            bonds: [nothing; CAPACITY],
            weights: [0.0; CAPACITY],
            laws: [0; CAPACITY],
            columns: BondColumns::new(),
            batch: LawBatch::new(),
            sum: Sum::default(),
            arch,
        };
        let owners = (slabs.owners(slab), positions, neighborhood);
        let Some(materials) = law.materials else {
            self.each(&mut run, owners, 0, |_| Some(1.0))?;
            return Ok(run.sum);
        };
        // Law by law: batches of one law need not be taken apart.
        for number in materials.laws_among(slabs.touched(slab)) {
            self.each(&mut run, owners.clone(), number, |ends| law.part(ends, number))?;
        }
        Ok(run.sum)
    }

    /// Takes the bonds of some owners through one law, each with the part that it has in it.
    #[inline(always)]
    fn each<const D: usize>(
        &self,
        run: &mut Run<'_, D>,
        (owners, positions, neighborhood): (Range<usize>, &[[f64; D]], &Neighborhood),
        number: u8,
        part: impl Fn([usize; 2]) -> Option<f64>,
    ) -> Result<(), Failure> {
        for i in owners {
            let all = neighborhood.bonds(i);
            let weights = all.clone().zip(&self.weight[all]);
            for (j, (bond, &weight)) in neighborhood.upper(i).iter().zip(weights) {
                let ends = [i, j as usize];
                // Bonds as long as the horizon have no weight where the influence ends there.
                if weight != 0.0
                    && let Some(part) = part(ends)
                {
                    run.push(Bond::new(positions, ends, self.number(bond)), part * weight, number)?;
                }
            }
        }
        run.flush()
    }
}

/// Bonds on their way through the law, on a thread's stack.
struct Run<'a, const D: usize> {
    law: LawOfPoints<'a>,
    fields: Fields<'a, D>,
    pass: Pass<'a, D>,
    duals: TouchedDuals<'a, D>,
    /// How many there are.
    n: usize,
    bonds: [Bond<D>; CAPACITY],
    weights: [f64; CAPACITY],
    /// The numbers of the laws of the bonds.
    laws: [u8; CAPACITY],
    columns: BondColumns<D>,
    batch: LawBatch<D>,
    sum: Sum,
    arch: Arch,
}

impl<const D: usize> Run<'_, D> {
    #[inline(always)]
    fn push(&mut self, bond: Bond<D>, weight: f64, law: u8) -> Result<(), Failure> {
        if self.n == CAPACITY {
            self.flush()?;
        }
        (self.bonds[self.n], self.weights[self.n]) = (bond, weight);
        self.laws[self.n] = law;
        self.n += 1;
        Ok(())
    }

    fn flush(&mut self) -> Result<(), Failure> {
        let n = std::mem::take(&mut self.n);
        if n == 0 {
            return Ok(());
        }
        // Behind the last bond stand those of a batch before, or none: nobody looks at what comes of them.
        let (arch, bonds, weights) = (self.arch, &self.bonds, &self.weights);
        let (columns, batch) = (&mut self.columns, &mut self.batch);
        arch.dispatch(InRegisters(
            #[inline(always)]
            || {
                columns.set(bonds);
                let [h, directions] = batch.columns();
                columns.gradients(bonds, self.fields, h);
                if let Pass::Product(direction) = self.pass {
                    columns.gradients(bonds, direction, directions);
                }
                batch.take_columns(n);
            },
        ));
        let laws = if self.law.materials.is_some() { &self.laws[..n] } else { &[] };
        let (law, place) = ((self.law, laws), |lane: usize| bonds[lane].place());
        let done = match self.pass {
            Pass::Energy => batch.evaluate_taken(law, place, false),
            Pass::Gradient | Pass::Virial => batch.evaluate_taken(law, place, true),
            Pass::Product(_) => batch.multiply_taken(law, place),
        };
        done.map_err(|lane| Failure {
            points: bonds[lane].points.to_vec(),
            determinant: determinant(&batch.gradient(lane)),
        })?;
        if !matches!(self.pass, Pass::Product(_)) {
            self.sum.join(&Sum::of_products(batch.psi(), &weights[..n]));
        }
        let duals = &mut self.duals;
        let lanes = || bonds[..n].iter().zip(weights).enumerate();
        if matches!(self.pass, Pass::Virial) {
            lanes().for_each(|(lane, (bond, weight))| {
                bond.share_virial(&batch.tensor(lane), *weight, duals);
            });
        } else if !duals.stress.is_empty() {
            arch.dispatch(InRegisters(
                #[inline(always)]
                || {
                    let stress = batch.out_as_columns();
                    columns.pull(weights, stress);
                    columns.scatter(&bonds[..n], stress, duals);
                },
            ));
        }
        if !duals.shares.is_empty() {
            for (lane, (bond, weight)) in lanes() {
                for point in bond.points {
                    duals.shares[point] += 0.5 * weight * batch.psi()[lane];
                }
            }
        }
        Ok(())
    }
}
