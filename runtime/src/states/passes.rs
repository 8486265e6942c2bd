//! Passes over the bonds, each once: what points gather, energies with their derivatives, forces.
//!
//! Bonds are numbered owner by owner. Slabs of owners go at once where they touch no common points, so
//! that a bond adds to both its ends and the order of every sum is that of the body. Arrays of bonds are
//! laid out as laws take them, in chunks of whole owners.

use std::ops::Range;

use pulp::Arch;
use rayon::prelude::*;

use super::{StateEnergy, by_variables};
use crate::correspondence::batch::are_finite;
use crate::energy::NonFinite;
use crate::geometry::Geometry;
use crate::geometry::bond::Bond;
use crate::kernel::{Batch, Order, Outputs, Variables};

/// Bonds of a chunk, but for the last owner's.
const CHUNK: usize = 192;

/// Points per task; fixed, so that results do not depend on threads.
const POINTS: usize = 64;

/// What points and bonds know of each other at some displacements.
pub(super) struct States<const D: usize> {
    /// Integrals, and derivatives of the energy per volume by them, point by point.
    pub(super) integrals: Vec<f64>,
    pub(super) adjoint: Vec<f64>,
    /// Energies per volume of points and of the bonds of points, in J/m^d.
    pub(super) points: Vec<f64>,
    pub(super) bonds: Vec<f64>,
    pub(super) of_bonds: OfBonds<D>,
    /// The mean over both ends of the derivative of a bond's energy by its length.
    pub(super) tension: Vec<f64>,
}

/// The bonds as they are now; arrays that are not wanted are empty.
pub(super) struct OfBonds<const D: usize> {
    /// Lengths in m, and relative changes.
    pub(super) length: Vec<f64>,
    pub(super) change: Vec<f64>,
    /// Unit vectors from the owner to the other end.
    pub(super) normal: Vec<[f64; D]>,
    /// First and second derivatives of the integrands, integrand by integrand.
    pub(super) slopes: Vec<Vec<f64>>,
    pub(super) bends: Vec<Vec<f64>>,
}

/// One slab's part of arrays: of points that it touches, and of its own bonds.
pub(super) struct Piece<'a> {
    /// The first of the points.
    pub(super) first: usize,
    pub(super) owners: Range<usize>,
    pub(super) points: Vec<&'a mut [f64]>,
    pub(super) bonds: Vec<&'a mut [f64]>,
}

/// An array with its entries per point or bond.
pub(super) type Strided<'a> = (&'a mut [f64], usize);

impl StateEnergy {
    /// Visits all slabs, even ones first; results in the order of the slabs.
    pub(super) fn over_slabs<R: Send>(
        &self,
        mut points: Vec<Strided<'_>>,
        mut bonds: Vec<Strided<'_>>,
        visit: impl Fn(Piece<'_>) -> R + Sync,
    ) -> Vec<R> {
        let mut results = Vec::with_capacity(self.slabs.len());
        for color in 0..2 {
            let mut rest_of_points: Vec<Strided<'_>> =
                points.iter_mut().map(|(array, width)| (&mut **array, *width)).collect();
            let mut rest_of_bonds: Vec<Strided<'_>> =
                bonds.iter_mut().map(|(array, width)| (&mut **array, *width)).collect();
            let (mut point, mut bond) = (0, 0);
            let mut pieces = Vec::new();
            for slab in (color..self.slabs.len()).step_by(2) {
                let (touched, owners) = (self.slabs.touched(slab), self.slabs.owners(slab));
                let own = self.bond_start[owners.start]..self.bond_start[owners.end];
                let points = cut(&mut rest_of_points, touched.start - point, touched.len());
                let bonds = cut(&mut rest_of_bonds, own.start - bond, own.len());
                (point, bond) = (touched.end, own.end);
                pieces.push((slab, Piece { first: touched.start, owners, points, bonds }));
            }
            let done: Vec<(usize, R)> = pieces
                .into_par_iter()
                .with_max_len(1)
                .map(|(slab, piece)| (slab, visit(piece)))
                .collect();
            results.extend(done);
        }
        results.sort_by_key(|(slab, _)| *slab);
        results.into_iter().map(|(_, result)| result).collect()
    }

    /// Owners whose bonds go through laws at once, with these bonds.
    pub(super) fn chunks(
        &self,
        owners: Range<usize>,
    ) -> impl Iterator<Item = (Range<usize>, Range<usize>)> + '_ {
        let mut next = owners.start;
        std::iter::from_fn(move || {
            let first = next;
            while next < owners.end
                && (next == first || self.bond_start[next] - self.bond_start[first] < CHUNK)
            {
                next += 1;
            }
            let bonds = self.bond_start[first]..self.bond_start[next];
            (next > first).then_some((first..next, bonds))
        })
    }

    /// `ends` become those of the bonds of some owners: the owner, and the other one.
    pub(super) fn ends(&self, owners: Range<usize>, ends: &mut Vec<[u32; 2]>) {
        ends.clear();
        for i in owners {
            ends.extend(self.neighborhood.upper(i).iter().map(|&j| [i as u32, j]));
        }
    }

    /// The integrals, and the bonds with what the order asks for.
    pub(super) fn gather<const D: usize>(&self, u: &[f64], order: Order) -> (Vec<f64>, OfBonds<D>) {
        let (m, n) = (self.n_integrals(), self.rest.len());
        let wanted = |is_wanted: bool| vec![0.0; if is_wanted { n } else { 0 }];
        let (with_slopes, with_bends) = (order != Order::Energy, order == Order::Tangent);
        let mut integrals = vec![0.0; self.body.n_points() * m];
        let mut now = OfBonds {
            length: vec![0.0; n],
            change: vec![0.0; n],
            normal: vec![[0.0; D]; if with_slopes { n } else { 0 }],
            slopes: (0..m).map(|_| wanted(with_slopes)).collect(),
            bends: (0..m).map(|_| wanted(with_bends)).collect(),
        };
        let mut arrays: Vec<Strided<'_>> =
            vec![(&mut now.length, 1), (&mut now.change, 1), (now.normal.as_flattened_mut(), D)];
        arrays.extend(now.slopes.iter_mut().map(|array| (&mut array[..], 1)));
        arrays.extend(now.bends.iter_mut().map(|array| (&mut array[..], 1)));
        self.over_slabs(vec![(&mut integrals, m)], arrays, |piece| {
            self.gather_slab::<D>(u, order, piece);
        });
        (integrals, now)
    }

    fn gather_slab<const D: usize>(&self, u: &[f64], order: Order, piece: Piece<'_>) {
        let Piece { first, owners, mut points, mut bonds } = piece;
        let (positions, u) = (self.body.positions().as_chunks::<D>().0, u.as_chunks::<D>().0);
        let (volumes, arch, m) = (self.body.volumes(), Arch::new(), self.n_integrals());
        let [length, change, normal, derivatives @ ..] = &mut bonds[..] else { return };
        let normal = normal.as_chunks_mut::<D>().0;
        let (mut unused, mut ends) = ([Vec::new(), Vec::new(), Vec::new()], Vec::new());
        let start = self.bond_start[owners.start];
        for (owners, all) in self.chunks(owners) {
            let own = all.start - start..all.end - start;
            let rest = &self.rest[all];
            self.ends(owners, &mut ends);
            let (length, change) = (&mut length[own.clone()], &mut change[own.clone()]);
            let is_normal_wanted = !normal.is_empty();
            let normal =
                if is_normal_wanted { &mut normal[own.clone()] } else { &mut normal[0..0] };
            arch.dispatch(
                #[inline(always)]
                || {
                    for (b, &[i, j]) in ends.iter().enumerate() {
                        let (i, j) = (i as usize, j as usize);
                        let at_rest: [f64; D] =
                            std::array::from_fn(|c| positions[j][c] - positions[i][c]);
                        let moved: [f64; D] = std::array::from_fn(|c| u[j][c] - u[i][c]);
                        let now = <Bond as Geometry<D>>::change(&at_rest, &moved);
                        length[b] = now.measure;
                        change[b] = now.change;
                        if is_normal_wanted {
                            let inverse = 1.0 / now.measure;
                            normal[b] = std::array::from_fn(|c| (at_rest[c] + moved[c]) * inverse);
                        }
                    }
                },
            );
            unused.iter_mut().for_each(|array| array.resize(own.len(), 0.0));
            for (k, law) in self.laws.integrals.iter().enumerate() {
                let [psi, first_unused, second_unused] = &mut unused;
                let (slopes, bends) = derivatives.split_at_mut(m);
                let dpsi = match slopes[k].get_mut(own.clone()) {
                    Some(slopes) if order != Order::Energy => slopes,
                    _ => &mut first_unused[..],
                };
                let d2psi = match bends[k].get_mut(own.clone()) {
                    Some(bends) if order == Order::Tangent => bends,
                    _ => &mut second_unused[..],
                };
                let batch = Batch { measure: length, reference: rest, change };
                law.evaluate(batch, order, Outputs { psi: &mut psi[..], dpsi, d2psi });
                let integrals = &mut *points[0];
                for (value, &[i, j]) in psi.iter().zip(&ends) {
                    let (i, j) = (i as usize, j as usize);
                    integrals[(i - first) * m + k] += volumes[j] * value;
                    integrals[(j - first) * m + k] += volumes[i] * value;
                }
            }
        }
    }

    /// Energies and, unless the order asks for them alone, their derivatives.
    pub(super) fn states<const D: usize>(
        &self,
        u: &[f64],
        order: Order,
    ) -> Result<States<D>, NonFinite> {
        let (integrals, of_bonds) = self.gather::<D>(u, order);
        let (m, n) = (self.n_integrals(), self.body.n_points());
        let with_slopes = order != Order::Energy;
        let mut points = vec![0.0; n];
        let mut adjoint = self.of_points(&integrals, with_slopes, &mut points);
        let mut bonds = vec![0.0; n];
        let mut tension = vec![0.0; if with_slopes { self.rest.len() } else { 0 }];
        let arrays = vec![(&mut bonds[..], 1), (&mut adjoint[..], m)];
        let failed = self.over_slabs(arrays, vec![(&mut tension, 1)], |piece| {
            self.energies_of_slab(&integrals, &of_bonds, with_slopes, piece)
        });
        let failed = failed.into_iter().flatten();
        let bad = |i: &usize| {
            let own = &adjoint[i * m..(i + 1) * m];
            !(points[*i].is_finite() && own.iter().all(|x| x.is_finite()))
        };
        match failed.chain((0..n).find(bad)).min() {
            None => Ok(States { integrals, adjoint, points, bonds, of_bonds, tension }),
            Some(i) => Err(self.named(i, integrals.get(i * m).copied(), u)),
        }
    }

    /// The energies of points, and their derivatives by the integrals.
    fn of_points(&self, integrals: &[f64], with_slopes: bool, energies: &mut [f64]) -> Vec<f64> {
        let m = self.n_integrals();
        let mut adjoint = vec![0.0; integrals.len()];
        let Some(law) = self.laws.points.as_ref().filter(|_| m > 0) else { return adjoint };
        let work = |((rows, adjoint), energies): ((&[f64], &mut [f64]), &mut [f64])| {
            let n = energies.len();
            let current = by_variables(rows, m);
            let mut slopes = vec![0.0; if with_slopes { m * n } else { 0 }];
            law.evaluate(super::at_points(n, &current), energies, &mut slopes);
            for (place, x) in slopes.iter().enumerate() {
                adjoint[place % n * m + place / n] = *x;
            }
        };
        let rows = integrals.par_chunks(POINTS * m).zip(adjoint.par_chunks_mut(POINTS * m));
        rows.zip(energies.par_chunks_mut(POINTS)).for_each(work);
        adjoint
    }

    /// The energies of one slab's bonds; the lowest point where one is not finite.
    fn energies_of_slab<const D: usize>(
        &self,
        integrals: &[f64],
        of_bonds: &OfBonds<D>,
        with_slopes: bool,
        piece: Piece<'_>,
    ) -> Option<usize> {
        let Piece { first, owners, mut points, mut bonds } = piece;
        let (volumes, m) = (self.body.volumes(), self.n_integrals());
        let [energies, adjoint] = &mut points[..] else { return None };
        let tension = &mut *bonds[0];
        let start = self.bond_start[owners.start];
        let mut failed: Option<usize> = None;
        let mut fail = |point: usize| failed = Some(failed.map_or(point, |p| p.min(point)));
        let mut work = Ends::default();
        for (owners, all) in self.chunks(owners) {
            self.ends(owners, &mut work.ends);
            let (length, change) = (&of_bonds.length[all.clone()], &of_bonds.change[all.clone()]);
            let rest = &self.rest[all.clone()];
            let n = all.len();
            let own = all.start - start..all.end - start;
            let tension = if with_slopes { &mut tension[own] } else { &mut tension[0..0] };
            if let Some(law) = &self.laws.bonds {
                for end in 0..2 {
                    work.take(length, integrals, m, end);
                    work.slopes.resize(if with_slopes { (1 + m) * n } else { 0 }, 0.0);
                    work.psi.resize(n, 0.0);
                    let at = Variables { n, current: &work.variables, change, given: rest };
                    law.evaluate(at, &mut work.psi, &mut work.slopes);
                    if !(are_finite(&work.psi) && are_finite(&work.slopes)) {
                        let bad = (0..n).filter(|&b| !work.is_finite_at(b));
                        bad.for_each(|b| fail(work.ends[b][end] as usize));
                    }
                    let (psi, slopes) = (&work.psi[..n], &work.slopes[..]);
                    for (b, ends) in work.ends.iter().enumerate() {
                        let (point, other) = (ends[end] as usize, ends[1 - end] as usize);
                        let half = 0.5 * volumes[other];
                        energies[point - first] += half * psi[b];
                        if with_slopes {
                            let adjoint = &mut adjoint[(point - first) * m..][..m];
                            for k in 0..m {
                                adjoint[k] += half * slopes[(1 + k) * n + b];
                            }
                        }
                    }
                    tension.iter_mut().zip(slopes).for_each(|(t, x)| *t += 0.5 * x);
                }
            }
            if let Some(law) = &self.laws.plain {
                work.psi.resize(n, 0.0);
                work.slopes.resize(n, 0.0);
                work.variables.resize(n, 0.0);
                let order = if with_slopes { Order::Gradient } else { Order::Energy };
                work.slopes.fill(0.0);
                let (psi, dpsi) = (&mut work.psi[..], &mut work.slopes[..n]);
                let out = Outputs { psi, dpsi, d2psi: &mut work.variables[..n] };
                law.evaluate(Batch { measure: length, reference: rest, change }, order, out);
                for (b, ends) in work.ends.iter().enumerate() {
                    let [i, j] = ends.map(|end| end as usize);
                    energies[i - first] += 0.5 * volumes[j] * work.psi[b];
                    energies[j - first] += 0.5 * volumes[i] * work.psi[b];
                    if !work.is_finite_at(b) {
                        fail(i);
                    }
                }
                tension.iter_mut().zip(&work.slopes).for_each(|(t, x)| *t += x);
            }
        }
        failed
    }

    /// `force` (`n x d`) becomes the gradient.
    pub(super) fn forces<const D: usize>(&self, states: &States<D>, force: &mut [f64]) {
        force.fill(0.0);
        let arch = Arch::new();
        self.over_slabs(vec![(force, D)], Vec::new(), |mut piece| {
            let force = piece.points[0].as_chunks_mut::<D>().0;
            arch.dispatch(
                #[inline(always)]
                || match self.n_integrals() {
                    1 => self.forces_of_slab(1, states, piece.first, piece.owners.clone(), force),
                    2 => self.forces_of_slab(2, states, piece.first, piece.owners.clone(), force),
                    m => self.forces_of_slab(m, states, piece.first, piece.owners.clone(), force),
                },
            );
        });
    }

    #[inline(always)]
    fn forces_of_slab<const D: usize>(
        &self,
        m: usize,
        states: &States<D>,
        first: usize,
        owners: Range<usize>,
        force: &mut [[f64; D]],
    ) {
        let volumes = self.body.volumes();
        let (adjoint, now) = (&states.adjoint, &states.of_bonds);
        for i in owners {
            let mut sum = [0.0; D];
            let start = self.bond_start[i];
            for (k, &j) in self.neighborhood.upper(i).iter().enumerate() {
                let (b, j) = (start + k, j as usize);
                let mut tension = states.tension[b];
                for k in 0..m {
                    tension += (adjoint[i * m + k] + adjoint[j * m + k]) * now.slopes[k][b];
                }
                let pull = volumes[i] * volumes[j] * tension;
                for c in 0..D {
                    let part = pull * now.normal[b][c];
                    force[j - first][c] += part;
                    sum[c] += part;
                }
            }
            for c in 0..D {
                force[i - first][c] -= sum[c];
            }
        }
    }
}

/// Work arrays for the energies of a chunk's bonds at one of their ends.
#[derive(Default)]
pub(super) struct Ends {
    pub(super) ends: Vec<[u32; 2]>,
    pub(super) variables: Vec<f64>,
    pub(super) psi: Vec<f64>,
    /// Derivatives by the variables, variable by variable.
    pub(super) slopes: Vec<f64>,
}

impl Ends {
    /// The variables: lengths, and the integrals at one of the ends.
    pub(super) fn take(&mut self, length: &[f64], integrals: &[f64], m: usize, end: usize) {
        let n = length.len();
        self.variables.clear();
        self.variables.extend_from_slice(length);
        self.variables.resize((1 + m) * n, 0.0);
        for (b, ends) in self.ends.iter().enumerate() {
            let own = &integrals[ends[end] as usize * m..][..m];
            for k in 0..m {
                self.variables[(1 + k) * n + b] = own[k];
            }
        }
    }

    fn is_finite_at(&self, b: usize) -> bool {
        let n = self.psi.len();
        self.psi[b].is_finite() && self.slopes.iter().skip(b).step_by(n).all(|x| x.is_finite())
    }
}

/// Leaves out `skip` entries of each array and takes `length`; of an empty array nothing.
fn cut<'a>(arrays: &mut [Strided<'a>], skip: usize, length: usize) -> Vec<&'a mut [f64]> {
    let one = |(rest, width): &mut Strided<'a>| -> &'a mut [f64] {
        if rest.is_empty() {
            return &mut [];
        }
        let (_, tail) = std::mem::take(rest).split_at_mut(skip * *width);
        let (taken, tail) = tail.split_at_mut(length * *width);
        *rest = tail;
        taken
    };
    arrays.iter_mut().map(one).collect()
}
