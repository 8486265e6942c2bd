//! Second derivatives of energies of deformation gradients by the fields `H` and `u`, for stored
//! tangents. Products evaluate the law again instead, and keep no 81 numbers for each point in space or
//! 117 for each bond.

use rayon::prelude::*;

use super::batch::{LawBatch, determinant};
use super::operator::GradientOperator;
use super::quadrature::BondStiffness;
use super::stabilisation::Deviations;
use super::sweep::{Failure, Fields, turned};
use crate::body::Body;
use crate::fields::stored::{Linearised, Seen, Tensor};
use crate::interaction::Slabs;
use crate::interaction::schedule::{Layout, Part, Touched, visit};
use crate::materials::{LawOfPoints, Place};
use crate::neighborhood::Neighborhood;

/// Second derivatives of the energy by the fields.
pub(super) struct FieldStiffness<'a, const D: usize> {
    body: &'a Body,
    neighborhood: &'a Neighborhood,
    /// `G_ij` of all directed bonds.
    weights: Vec<[f64; D]>,
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

impl<'a, const D: usize> FieldStiffness<'a, D> {
    /// `law` is that of the points, if it is evaluated there.
    pub(super) fn new(
        (body, slabs): (&'a Body, &Slabs),
        operator: &'a GradientOperator,
        law: Option<LawOfPoints<'_>>,
        fields: Fields<'_, D>,
        bonds: Bonds<'a>,
    ) -> Result<FieldStiffness<'a, D>, Failure> {
        let size = D * D * D * D;
        let mut points = vec![0.0; body.n_points() * size];
        let fill = |batch: &mut LawBatch<D>, (point, out): (usize, &mut [f64])| {
            let Some(law) = law else { return Ok(()) };
            let h = &fields.h[point];
            let second = batch
                .second((law, law.number(point)), (Place::at(point), h))
                .map_err(|_| Failure { points: vec![point], determinant: determinant(h) })?;
            let (volume, n) = (body.volumes()[point], D * D);
            for (place, second) in second.iter().enumerate() {
                out[turned::<D>(place / n) * n + turned::<D>(place % n)] = volume * second;
            }
            Ok(())
        };
        let chunks = points.par_chunks_exact_mut(size).with_min_len(64).enumerate();
        let done: Vec<Result<(), Failure>> = chunks.map_init(LawBatch::new, fill).collect();
        done.into_iter().collect::<Result<(), Failure>>()?;
        let (neighborhood, weights) = (operator.neighborhood(), operator.weights());
        let all = FieldStiffness { body, neighborhood, weights, points: Vec::new(), bonds };
        all.add_bonds(slabs, &mut points);
        Ok(FieldStiffness { points, ..all })
    }

    /// What the energies of bonds are by the `H` of either end twice.
    fn add_bonds(&self, slabs: &Slabs, points: &mut [f64]) {
        if matches!(self.bonds, Bonds::None) {
            return;
        }
        let size = D * D * D * D;
        visit(slabs, Part::new(Layout::Points(size), points), (), |slab, [here, next], ()| {
            let mut points = Touched::new(here, next);
            for i in slabs.owners(slab) {
                for (bond, j) in self.neighborhood.bonds(i).zip(self.neighborhood.upper(i)) {
                    let ends = [i, j as usize];
                    for end in ends {
                        let out = points.range(end * size..(end + 1) * size);
                        self.add_bond(end, Seen { ends, bond, sign: 1.0 }, out);
                    }
                }
            }
        });
    }

    fn add_bond(&self, end: usize, seen: Seen, out: &mut [f64]) {
        match &self.bonds {
            Bonds::None => {}
            Bonds::Quadrature(bonds) => {
                let [hh, ..] = bonds.bond(seen.bond);
                out.iter_mut().zip(hh).for_each(|(out, hh)| *out += hh);
            }
            Bonds::Deviations(deviations) => {
                let strength = deviations.strength[seen.bond];
                let (a, dx) = (deviations.stiffness::<D>(end), self.offset(seen.ends));
                for r in 0..D {
                    for c in 0..D {
                        for s in 0..D {
                            for e in 0..D {
                                out[(c * D + r) * D * D + e * D + s] +=
                                    strength * a[r][s] * dx[c] * dx[e];
                            }
                        }
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn offset(&self, [i, j]: [usize; 2]) -> [f64; D] {
        let positions = self.body.positions().as_chunks::<D>().0;
        std::array::from_fn(|c| positions[j][c] - positions[i][c])
    }
}

impl<const D: usize> Linearised<D> for FieldStiffness<'_, D> {
    #[inline(always)]
    fn neighborhood(&self) -> &Neighborhood {
        self.neighborhood
    }

    #[inline(always)]
    fn n_fields(&self) -> usize {
        D * D
    }

    #[inline(always)]
    fn weights(&self) -> &[[f64; D]] {
        &self.weights
    }

    /// `dH_rc = sum_j (du_j - du_i)_r G_c`.
    #[inline(always)]
    fn add_transposed(&self, weight: &[[f64; D]], x: &[f64], columns: usize, out: &mut [f64]) {
        for r in 0..D {
            let out = &mut out[r * columns..(r + 1) * columns];
            for c in 0..D {
                let row = &x[(c * D + r) * columns..(c * D + r + 1) * columns];
                for (out, x) in out.iter_mut().zip(row) {
                    *out += weight[0][c] * x;
                }
            }
        }
    }

    #[inline(always)]
    fn times(&self, x: &[f64], weight: &[[f64; D]]) -> Tensor<D> {
        let mut block = [[0.0; D]; D];
        for (block, row) in block.iter_mut().zip(x.chunks_exact(D * D)) {
            for (column, weight) in row.as_chunks::<D>().0.iter().zip(&weight[0]) {
                for s in 0..D {
                    block[s] += column[s] * weight;
                }
            }
        }
        block
    }

    #[inline(always)]
    fn at_point(&self, point: usize) -> &[f64] {
        let size = D * D * D * D;
        &self.points[point * size..(point + 1) * size]
    }

    #[inline(always)]
    fn across(&self, seen: Seen) -> Option<&[f64]> {
        match &self.bonds {
            // The same both ways: of the mean of both ends.
            Bonds::Quadrature(bonds) => Some(bonds.bond(seen.bond)[0]),
            _ => None,
        }
    }

    #[inline(always)]
    fn is_across(&self) -> bool {
        matches!(self.bonds, Bonds::Quadrature(_))
    }

    #[inline(always)]
    fn is_direct(&self) -> bool {
        !matches!(self.bonds, Bonds::None)
    }

    #[inline(always)]
    fn is_mixed(&self) -> bool {
        self.is_direct()
    }

    #[inline(always)]
    fn mixed(&self, end: usize, seen: Seen, out: &mut [f64]) {
        match &self.bonds {
            Bonds::None => out.fill(0.0),
            Bonds::Quadrature(bonds) => {
                let [_, of_end, _] = bonds.bond(seen.bond);
                out.iter_mut().zip(of_end).for_each(|(out, x)| *out = seen.sign * x);
            }
            Bonds::Deviations(deviations) => {
                let strength = deviations.strength[seen.bond];
                let (a, dx) = (deviations.stiffness::<D>(end), self.offset(seen.ends));
                for r in 0..D {
                    for c in 0..D {
                        for s in 0..D {
                            out[(c * D + r) * D + s] = -strength * a[r][s] * dx[c];
                        }
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn direct(&self, seen: Seen) -> Tensor<D> {
        match &self.bonds {
            Bonds::None => [[0.0; D]; D],
            Bonds::Quadrature(bonds) => {
                let [.., of_bond] = bonds.bond(seen.bond);
                std::array::from_fn(|r| std::array::from_fn(|s| of_bond[r * D + s]))
            }
            Bonds::Deviations(deviations) => {
                let strength = deviations.strength[seen.bond];
                let [here, there] = seen.ends.map(|end| deviations.stiffness::<D>(end));
                std::array::from_fn(|r| {
                    std::array::from_fn(|s| strength * (here[r][s] + there[r][s]))
                })
            }
        }
    }
}
