//! Passes over the bonds, each once: what points gather, energies with their derivatives, forces.
//!
//! Bonds are numbered owner by owner. A bond adds to both its ends, slab by slab, so that the order of
//! every sum is that of the body. Laws take bonds in chunks of whole owners. Arrays are kept for the next
//! pass: they are larger than caches, and fresh memory costs more than what is written to it.

use std::ops::Range;

use pulp::Arch;
use rayon::prelude::*;

use super::StateEnergy;
use crate::energy::NonFinite;
use crate::geometry::Geometry;
use crate::geometry::bond::Bond;
use crate::geometry::lanes::InRegisters;
use crate::interaction::schedule::{Layout, Part, Touched, visit};
use crate::kernel::{Batch, Order, Outputs, Variables};
use crate::materials::Materials;
use crate::pool::Taken;
use crate::vector::are_finite;

/// Bonds of a chunk, but for the last owner's.
const CHUNK: usize = 192;

/// Points per task; fixed, so that results do not depend on threads.
const POINTS: usize = 64;

/// What points and bonds know of each other at some displacements, as far as it was asked for.
#[derive(Default)]
pub(super) struct States {
    /// Integrals, and derivatives of the energy per volume by them, point by point.
    pub(super) integrals: Vec<f64>,
    pub(super) adjoint: Vec<f64>,
    /// Energies per volume of points and of the bonds of points, in J/m^d.
    pub(super) points: Vec<f64>,
    pub(super) bonds: Vec<f64>,
    /// The bonds as they are now: lengths in m, and relative changes.
    pub(super) length: Vec<f64>,
    pub(super) change: Vec<f64>,
    /// Unit vectors from the owner to the other end.
    normal: Vec<f64>,
    /// First and second derivatives of the integrands that change, slab by slab and there integrand by
    /// integrand.
    slopes: Vec<f64>,
    bends: Vec<f64>,
    /// The mean over both ends of the derivative of a bond's energy by its length.
    pub(super) tension: Vec<f64>,
    /// Half of what it is more at the owner than at the other end, where virials are wanted.
    uneven: Vec<f64>,
    /// The lowest point of each slab whose bonds have an energy that is not finite.
    failed: Vec<Option<usize>>,
}

impl States {
    /// Unit vectors from the owner to the other end.
    pub(super) fn normals<const D: usize>(&self) -> &[[f64; D]] {
        self.normal.as_chunks::<D>().0
    }
}

/// Room for so many numbers, which hold anything.
pub(super) fn room(array: &mut Vec<f64>, n: usize) -> &mut [f64] {
    if array.len() < n {
        array.resize(n, 0.0);
    }
    &mut array[..n]
}

/// Makes an array so long, and zero.
pub(super) fn clear(array: &mut Vec<f64>, n: usize) {
    array.clear();
    array.resize(n, 0.0);
}

impl StateEnergy {
    /// What a bond has of an array, or some entries of each.
    pub(super) fn per_bond(&self, entries: usize) -> Layout<'_> {
        Layout::Rows(self.neighborhood.bond_starts(), entries)
    }

    /// The bonds of a slab's owners.
    pub(super) fn bonds_of(&self, slab: usize) -> Range<usize> {
        let owners = self.slabs.owners(slab);
        let start = self.neighborhood.bond_starts();
        start[owners.start]..start[owners.end]
    }

    /// First derivatives of the integrands that change at the bonds of a slab: of the one at place `k`
    /// among them at bond `b`.
    #[inline(always)]
    pub(super) fn slopes<'a>(
        &self,
        slab: usize,
        states: &'a States,
    ) -> impl Fn(usize, usize) -> f64 + use<'a> {
        self.by_integrand(slab, &states.slopes)
    }

    /// Second derivatives of the same.
    #[inline(always)]
    pub(super) fn bends<'a>(
        &self,
        slab: usize,
        states: &'a States,
    ) -> impl Fn(usize, usize) -> f64 + use<'a> {
        self.by_integrand(slab, &states.bends)
    }

    #[inline(always)]
    fn by_integrand<'a>(
        &self,
        slab: usize,
        array: &'a [f64],
    ) -> impl Fn(usize, usize) -> f64 + use<'a> {
        let (bonds, m) = (self.bonds_of(slab), self.changing.len());
        let own = &array[m * bonds.start..m * bonds.end];
        let (start, n) = (bonds.start, bonds.len());
        move |k, b| own[k * n + (b - start)]
    }

    /// Owners whose bonds go through laws at once, with these bonds.
    pub(super) fn chunks(
        &self,
        owners: Range<usize>,
    ) -> impl Iterator<Item = (Range<usize>, Range<usize>)> + '_ {
        self.neighborhood.pieces(owners, CHUNK)
    }

    /// `ends` become those of the bonds of some owners: the owner, and the other one.
    pub(super) fn ends(&self, owners: Range<usize>, ends: &mut Vec<[u32; 2]>) {
        ends.clear();
        for i in owners {
            ends.extend(self.neighborhood.upper(i).iter().map(|j| [i as u32, j]));
        }
    }

    /// The integrals, and the bonds with what the order asks for.
    pub(super) fn gather<const D: usize>(&self, u: &[f64], order: Order, states: &mut States) {
        let (m, n) = (self.changing.len(), self.rest.len());
        let with_slopes = if order == Order::Energy { 0 } else { n };
        let with_bends = if order == Order::Tangent { n } else { 0 };
        states.integrals.clear();
        states.integrals.extend_from_slice(&self.at_rest);
        let integrals = Part::new(Layout::Points(self.n_integrals()), &mut states.integrals);
        let bonds = (
            Part::new(self.per_bond(1), room(&mut states.length, n)),
            Part::new(self.per_bond(1), room(&mut states.change, n)),
            Part::new(self.per_bond(D), room(&mut states.normal, D * with_slopes)),
            Part::new(self.per_bond(m), room(&mut states.slopes, m * with_slopes)),
            Part::new(self.per_bond(m), room(&mut states.bends, m * with_bends)),
        );
        visit(&self.slabs, integrals, bonds, |slab, [here, next], bonds| {
            let bonds = OfBonds {
                length: bonds.0.into_values(),
                change: bonds.1.into_values(),
                normal: bonds.2.into_values(),
                slopes: bonds.3.into_values(),
                bends: bonds.4.into_values(),
            };
            self.gather_slab::<D>(u, order, slab, Touched::new(here, next), bonds);
        });
    }

    fn gather_slab<const D: usize>(
        &self,
        u: &[f64],
        order: Order,
        slab: usize,
        mut integrals: Touched<'_, f64>,
        bonds: OfBonds<'_>,
    ) {
        let OfBonds { length, change, normal, slopes, bends } = bonds;
        let (positions, u) = (self.body.positions().as_chunks::<D>().0, u.as_chunks::<D>().0);
        let (volumes, arch, m) = (self.body.volumes(), Arch::new(), self.n_integrals());
        let normal = normal.as_chunks_mut::<D>().0;
        let mut work = self.work();
        let Work { ends, unused, given, .. } = &mut *work;
        let (start, all_of_slab) = (self.bonds_of(slab).start, length.len());
        for (owners, all) in self.chunks(self.slabs.owners(slab)) {
            let own = all.start - start..all.end - start;
            let rest = &self.rest[all];
            self.ends(owners, ends);
            let (length, change) = (&mut length[own.clone()], &mut change[own.clone()]);
            let is_normal_wanted = !normal.is_empty();
            let normal =
                if is_normal_wanted { &mut normal[own.clone()] } else { &mut normal[0..0] };
            arch.dispatch(InRegisters(
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
            ));
            unused.iter_mut().for_each(|array| array.resize(own.len(), 0.0));
            for (place, &k) in self.changing.iter().enumerate() {
                let law = &self.laws.integrals[k];
                let [psi, first_unused, second_unused] = &mut *unused;
                let place = place * all_of_slab + own.start..place * all_of_slab + own.end;
                let dpsi = slopes.get_mut(place.clone()).unwrap_or(first_unused);
                let d2psi = bends.get_mut(place).unwrap_or(second_unused);
                given.clear();
                if let Some((fields, own)) = self.fields_of(k) {
                    let points = |b: usize| ends[b].into_iter().map(|end| end as usize);
                    fields.add(own, rest.len(), points, given);
                }
                let batch = Batch { measure: length, reference: rest, change, fields: given };
                law.evaluate(batch, order, Outputs { psi: &mut psi[..], dpsi, d2psi });
                for (value, &[i, j]) in psi.iter().zip(&*ends) {
                    let (i, j) = (i as usize, j as usize);
                    integrals[i * m + k] += volumes[j] * value;
                    integrals[j * m + k] += volumes[i] * value;
                }
            }
        }
    }

    /// Energies and, unless the order asks for them alone, their derivatives.
    pub(super) fn states<const D: usize>(
        &self,
        u: &[f64],
        order: Order,
    ) -> Result<Taken<'_, States>, NonFinite> {
        self.states_with::<D>(u, order, false)
    }

    /// The same; with the tensions of both ends apart, or not.
    fn states_with<const D: usize>(
        &self,
        u: &[f64],
        order: Order,
        apart: bool,
    ) -> Result<Taken<'_, States>, NonFinite> {
        self.work.provide(|| Work::new(self));
        let mut taken = self.states.take(States::default);
        let states = &mut *taken;
        self.gather::<D>(u, order, states);
        let (m, n) = (self.n_integrals(), self.body.n_points());
        let with_slopes = order != Order::Energy;
        clear(&mut states.points, n);
        clear(&mut states.adjoint, n * m);
        clear(&mut states.bonds, n);
        self.of_points(with_slopes, states);
        states.failed.clear();
        states.failed.resize(self.slabs.len(), None);
        let n_tensions = if with_slopes { self.rest.len() } else { 0 };
        let shared = (
            Part::new(Layout::Points(1), &mut states.bonds),
            Part::new(Layout::Points(m), &mut states.adjoint),
        );
        let n_uneven = if apart { n_tensions } else { 0 };
        let own = (
            Part::new(self.per_bond(1), room(&mut states.tension, n_tensions)),
            Part::new(self.per_bond(1), room(&mut states.uneven, n_uneven)),
            Part::new(Layout::Slabs, &mut states.failed),
        );
        let known = (&states.integrals[..], &states.length[..], &states.change[..]);
        visit(&self.slabs, shared, own, |slab, [here, next], (tension, uneven, failed)| {
            let energies = Touched::new(&mut here.0, &mut next.0);
            let adjoint = Touched::new(&mut here.1, &mut next.1);
            let tensions = (tension.into_values(), uneven.into_values());
            let bad = self.energies_of_slab(slab, known, (energies, adjoint), tensions);
            failed.into_values()[0] = bad;
        });
        let failed = states.failed.iter().copied().flatten();
        let bad = |i: &usize| {
            let own = &states.adjoint[i * m..(i + 1) * m];
            !(states.points[*i].is_finite() && own.iter().all(|x| x.is_finite()))
        };
        match failed.chain((0..n).find(bad)).min() {
            None => Ok(taken),
            Some(i) => Err(self.named(i, states.integrals.get(i * m).copied(), u)),
        }
    }

    /// The energies of points, and their derivatives by the integrals.
    pub(super) fn of_points(&self, with_slopes: bool, states: &mut States) {
        let m = self.n_integrals();
        let Some(law) = self.laws.points.as_ref().filter(|_| m > 0) else { return };
        let work = |(chunk, ((rows, adjoint), energies)): Chunk<'_>| {
            let n = energies.len();
            let laws = self.laws_of(chunk * POINTS..chunk * POINTS + n);
            let mut work = self.work();
            let Work { variables, slopes, given, .. } = &mut *work;
            super::by_variables(rows, m, variables);
            slopes.resize(if with_slopes { m * n } else { 0 }, 0.0);
            given.clear();
            self.give(n, |p| [chunk * POINTS + p; 2], given);
            law.evaluate(super::at_points(variables, (laws, given), n), energies, slopes);
            for (place, x) in slopes.iter().enumerate() {
                adjoint[place % n * m + place / n] = *x;
            }
        };
        let rows = states.integrals.par_chunks(POINTS * m);
        let rows = rows.zip(states.adjoint.par_chunks_mut(POINTS * m));
        rows.zip(states.points.par_chunks_mut(POINTS)).enumerate().for_each(work);
    }

    /// The energies of one slab's bonds; the lowest point where one is not finite.
    fn energies_of_slab(
        &self,
        slab: usize,
        (integrals, length, change): (&[f64], &[f64], &[f64]),
        (mut energies, mut adjoint): (Touched<'_, f64>, Touched<'_, f64>),
        (tension, uneven): (&mut [f64], &mut [f64]),
    ) -> Option<usize> {
        let (volumes, m) = (self.body.volumes(), self.n_integrals());
        let (start, with_slopes) = (self.bonds_of(slab).start, !tension.is_empty());
        let mut failed: Option<usize> = None;
        let mut fail = |point: usize| failed = Some(failed.map_or(point, |p| p.min(point)));
        let mut work = self.work();
        for (owners, all) in self.chunks(self.slabs.owners(slab)) {
            self.ends(owners, &mut work.ends);
            let (length, change) = (&length[all.clone()], &change[all.clone()]);
            let rest = &self.rest[all.clone()];
            let n = all.len();
            let own = all.start - start..all.end - start;
            let [tension, uneven] = [&mut *tension, &mut *uneven]
                .map(|all| all.get_mut(own.clone()).unwrap_or_default());
            tension.fill(0.0);
            uneven.fill(0.0);
            let work = &mut *work;
            if let Some(law) = &self.laws.bonds {
                for end in 0..2 {
                    work.take(length, integrals, m, end);
                    work.set_laws(self.materials.as_deref(), end);
                    work.slopes.resize(if with_slopes { (1 + m) * n } else { 0 }, 0.0);
                    work.psi.resize(n, 0.0);
                    work.give(self, rest, end);
                    let (current, laws) = (&work.variables[..], &work.laws[..]);
                    let at = Variables { n, current, change, given: &work.given, laws };
                    law.evaluate(at, &mut work.psi, &mut work.slopes);
                    if !(are_finite(&work.psi) && are_finite(&work.slopes)) {
                        let bad = (0..n).filter(|&b| !work.is_finite_at(b));
                        bad.for_each(|b| fail(work.ends[b][end] as usize));
                    }
                    let (psi, slopes) = (&work.psi[..n], &work.slopes[..]);
                    for (b, ends) in work.ends.iter().enumerate() {
                        let (point, other) = (ends[end] as usize, ends[1 - end] as usize);
                        let half = 0.5 * volumes[other];
                        energies[point] += half * psi[b];
                        if with_slopes {
                            let adjoint = adjoint.range(point * m..(point + 1) * m);
                            for &k in &self.changing {
                                adjoint[k] += half * slopes[(1 + k) * n + b];
                            }
                        }
                    }
                    tension.iter_mut().zip(slopes).for_each(|(t, x)| *t += 0.5 * x);
                    let half = if end == 0 { 0.5 } else { -0.5 };
                    uneven.iter_mut().zip(slopes).for_each(|(t, x)| *t += half * x);
                }
            }
        }
        failed
    }

    /// Adds the gradient to `force` (`n x d`).
    pub(super) fn forces<const D: usize>(&self, states: &States, force: &mut [f64]) {
        let arch = Arch::new();
        let force = Part::new(Layout::Points(1), force.as_chunks_mut::<D>().0);
        visit(&self.slabs, force, (), |slab, [here, next], ()| {
            let force = Touched::new(here, next);
            arch.dispatch(
                #[inline(always)]
                || match &self.changing[..] {
                    &[k] => self.forces_of_slab(&[k], states, slab, force),
                    &[k, l] => self.forces_of_slab(&[k, l], states, slab, force),
                    changing => self.forces_of_slab(changing, states, slab, force),
                },
            );
        });
    }

    /// Adds the virials of points to `virials` (`n x d x d`).
    pub(super) fn add_virials<const D: usize>(
        &self,
        u: &[f64],
        virials: &mut [f64],
    ) -> Result<(), NonFinite> {
        let states = self.states_with::<D>(u, Order::Gradient, true)?;
        let positions = self.body.positions().as_chunks::<D>().0;
        let (volumes, m) = (self.body.volumes(), self.n_integrals());
        let (normals, adjoint) = (states.normals::<D>(), &states.adjoint);
        let virials = virials.as_chunks_mut::<D>().0.as_chunks_mut::<D>().0;
        let virials = Part::new(Layout::Points(1), virials);
        visit(&self.slabs, virials, (), |slab, [here, next], ()| {
            let mut virials: Touched<'_, [[f64; D]; D]> = Touched::new(here, next);
            let slopes = self.slopes(slab, &states);
            for i in self.slabs.owners(slab) {
                let bonds = self.neighborhood.bonds(i);
                for (b, j) in bonds.zip(self.neighborhood.upper(i)) {
                    let j = j as usize;
                    let (tension, uneven) = (states.tension[b], states.uneven[b]);
                    for (point, direct) in [(i, tension + uneven), (j, tension - uneven)] {
                        let mut pull = 0.5 * direct;
                        for (place, k) in self.changing.iter().enumerate() {
                            pull += adjoint[point * m + k] * slopes(place, b);
                        }
                        pull *= volumes[i] * volumes[j];
                        for (row, normal) in virials[point].iter_mut().zip(&normals[b]) {
                            for c in 0..D {
                                row[c] += pull * normal * (positions[j][c] - positions[i][c]);
                            }
                        }
                    }
                }
            }
        });
        Ok(())
    }

    #[inline(always)]
    fn forces_of_slab<const D: usize>(
        &self,
        changing: &[usize],
        states: &States,
        slab: usize,
        mut force: Touched<'_, [f64; D]>,
    ) {
        let (volumes, m) = (self.body.volumes(), self.n_integrals());
        let (adjoint, normals) = (&states.adjoint, states.normals::<D>());
        let slopes = self.slopes(slab, states);
        for i in self.slabs.owners(slab) {
            let mut sum = [0.0; D];
            let start = self.neighborhood.bonds(i).start;
            for (k, j) in self.neighborhood.upper(i).iter().enumerate() {
                let (b, j) = (start + k, j as usize);
                let mut tension = states.tension[b];
                for (place, k) in changing.iter().enumerate() {
                    tension += (adjoint[i * m + k] + adjoint[j * m + k]) * slopes(place, b);
                }
                let pull = volumes[i] * volumes[j] * tension;
                let force = &mut force[j];
                for c in 0..D {
                    let part = pull * normals[b][c];
                    force[c] += part;
                    sum[c] += part;
                }
            }
            let force = &mut force[i];
            for c in 0..D {
                force[c] -= sum[c];
            }
        }
    }

    /// Work arrays for a thread.
    pub(super) fn work(&self) -> Taken<'_, Work> {
        self.work.take(|| Work::new(self))
    }
}

/// A number, with the integrals of some points, the derivatives by them and the energies.
type Chunk<'a> = (usize, ((&'a [f64], &'a mut [f64]), &'a mut [f64]));

/// One slab's bonds as they are now; arrays that are not wanted are empty.
struct OfBonds<'a> {
    length: &'a mut [f64],
    change: &'a mut [f64],
    normal: &'a mut [f64],
    slopes: &'a mut [f64],
    bends: &'a mut [f64],
}

/// Work arrays for the bonds of a chunk, at one of their ends, or for some points.
pub(super) struct Work {
    pub(super) ends: Vec<[u32; 2]>,
    pub(super) variables: Vec<f64>,
    /// The numbers of the laws of bonds at one of their ends; none where one law holds everywhere.
    pub(super) laws: Vec<u8>,
    /// What is given beside variables.
    pub(super) given: Vec<f64>,
    pub(super) psi: Vec<f64>,
    /// Derivatives by the variables, variable by variable.
    pub(super) slopes: Vec<f64>,
    /// What a law gives that is not wanted.
    unused: [Vec<f64>; 3],
}

impl Work {
    /// Large enough for every chunk.
    pub(super) fn new(energy: &StateEnergy) -> Work {
        let bonds = CHUNK + energy.neighborhood.most_later();
        let variables = (1 + energy.n_integrals()) * bonds.max(POINTS);
        let numbers = |n: usize| -> Vec<f64> { Vec::with_capacity(n) };
        Work {
            ends: Vec::with_capacity(bonds),
            variables: numbers(variables),
            laws: Vec::with_capacity(bonds),
            given: numbers(bonds * (1 + energy.fields().map_or(0, |fields| fields.len()))),
            psi: numbers(bonds),
            slopes: numbers(variables),
            unused: [numbers(bonds), numbers(bonds), numbers(bonds)],
        }
    }

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

    /// What is given of bonds: their lengths at rest, and fields, with the states of one of their ends.
    pub(super) fn give(&mut self, energy: &StateEnergy, rest: &[f64], end: usize) {
        let Work { given, ends, .. } = self;
        given.clear();
        given.extend_from_slice(rest);
        let ends = |b: usize| [ends[b][end] as usize, ends[b][1 - end] as usize];
        energy.give(rest.len(), ends, given);
    }

    /// The laws are those of one of the ends.
    pub(super) fn set_laws(&mut self, materials: Option<&Materials>, end: usize) {
        self.laws.clear();
        if let Some(materials) = materials {
            self.laws.extend(self.ends.iter().map(|ends| materials.of(ends[end] as usize)));
        }
    }

    fn is_finite_at(&self, b: usize) -> bool {
        let n = self.psi.len();
        self.psi[b].is_finite() && self.slopes.iter().skip(b).step_by(n).all(|x| x.is_finite())
    }
}
