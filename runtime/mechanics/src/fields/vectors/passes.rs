//! One way through the bonds and back: what points gather, energies, forces. The same way with kernels' products
//! in the place of their derivatives takes a direction instead of displacements, and gives what all of it
//! changes by.
//!
//! Bonds go through kernels in chunks of whole owners, each bond as both of its ends see it, and add to both,
//! slab by slab, so that the order of every sum is that of the body.

use std::ops::Range;

use piola_compiler::{FamilyBatch, FamilyKernel, Slot, VectorKernels};
use rayon::prelude::*;

use super::VectorEnergy;
use crate::assembly::sum::Sum;
use crate::energy::NonFinite;
use crate::interaction::schedule::{Layout, Part, Touched, visit};

/// Bonds of a chunk, but for the last owner's.
const CHUNK: usize = 64;

/// Points per task; fixed, so that results do not depend on threads.
const POINTS: usize = 64;

/// What points gather, or what that changes by.
#[derive(Default)]
pub(super) struct Gathered {
    /// Point by point, in the order in which a potential writes them.
    pub(super) values: Vec<f64>,
    /// Derivatives of the energy per volume by them: in the end by integrals all of it, by functions of them
    /// what energies hold of these.
    pub(super) adjoint: Vec<f64>,
    /// Energies per volume of points and of the bonds of points, in J/m^d.
    pub(super) points: Vec<f64>,
    pub(super) bonds: Vec<f64>,
}

/// What kernels find slots in.
#[derive(Clone, Copy)]
pub(super) struct At<'a> {
    /// Displacements, or a direction of them.
    pub(super) u: &'a [f64],
    /// What points gather; where it is empty, nothing has been gathered yet.
    pub(super) values: &'a [f64],
    /// Multipliers of that; all 0 where it is empty.
    pub(super) adjoint: &'a [f64],
}

/// What a pass works out behind energies.
pub(super) enum Sought<'a> {
    /// Nothing.
    Energy,
    /// Derivatives by what is gathered, for second derivatives.
    Adjoint,
    /// These and forces, or of a direction products, `n x d`.
    Forces(&'a mut [f64]),
}

impl Sought<'_> {
    /// What forces go to; nothing where they are not sought.
    fn forces(&mut self) -> &mut [f64] {
        if let Sought::Forces(out) = self { out } else { &mut [] }
    }

    /// The same for a pass within.
    fn again(&mut self) -> Sought<'_> {
        match self {
            Sought::Energy => Sought::Energy,
            Sought::Adjoint => Sought::Adjoint,
            Sought::Forces(out) => Sought::Forces(out),
        }
    }
}

/// Displacements with what points gather there, where a pass takes a direction.
pub(super) type Base<'a> = Option<(&'a [f64], &'a Gathered)>;

/// What goes through a kernel.
#[derive(Default)]
pub(super) struct Room {
    /// The end that sees a bond, and the other; of points twice the point.
    pub(super) ends: Vec<[usize; 2]>,
    variables: Vec<f64>,
    given: Vec<f64>,
    fields: Vec<f64>,
    /// Of bonds at rest, in m.
    lengths: Vec<f64>,
    direction: Vec<f64>,
    /// The kernel's value and its derivatives, or what these change by, variable by variable.
    pub(super) value: Vec<f64>,
    pub(super) slopes: Vec<f64>,
}

impl Room {
    /// The value of a kernel at what is prepared, without derivatives.
    pub(super) fn evaluate(&mut self, kernel: &FamilyKernel) {
        let Room { ends, variables, given, fields, value, .. } = self;
        let n = ends.len();
        clear(value, n);
        kernel.evaluate(FamilyBatch { n, variables, given, fields }, value, &mut []);
    }

    /// A direction of so many numbers that is 1 at some places of one variable and 0 elsewhere.
    pub(super) fn set_direction(&mut self, n: usize, ones: Range<usize>) {
        clear(&mut self.direction, n);
        self.direction[ones].fill(1.0);
    }
}

/// Makes an array so long, and zero.
fn clear(array: &mut Vec<f64>, n: usize) {
    array.clear();
    array.resize(n, 0.0);
}

impl VectorEnergy {
    /// Puts what slots hold at some places behind `out`.
    fn add_slots(
        &self,
        slots: &[Slot],
        (ends, lengths): (&[[usize; 2]], &[f64]),
        at: At<'_>,
        out: &mut Vec<f64>,
    ) {
        let (d, m) = (self.body.dimension(), self.n_gathered());
        let of = |array: &[f64], end: usize, k: usize, out: &mut Vec<f64>| match array {
            [] => out.resize(out.len() + ends.len(), 0.0),
            _ => out.extend(ends.iter().map(|ends| array[ends[end] * m + k])),
        };
        for slot in slots {
            match *slot {
                Slot::Length => out.extend_from_slice(lengths),
                Slot::Moved(axis) => {
                    out.extend(ends.iter().map(|[i, j]| at.u[j * d + axis] - at.u[i * d + axis]))
                }
                Slot::Own(k) => of(at.values, 0, k, out),
                Slot::Neighbour(k) => of(at.values, 1, k, out),
                Slot::Multiplier(k) => of(at.adjoint, 0, k, out),
            }
        }
    }

    /// Prepares a batch of the places in the room, which are of this law; the direction is taken where there is one.
    pub(super) fn prepare(
        &self,
        (law, kernel): (usize, &FamilyKernel),
        (at, direction): (At<'_>, Option<At<'_>>),
        room: &mut Room,
    ) {
        let Room { ends, variables, given, fields, lengths, direction: along, .. } = room;
        [&mut *variables, given, fields, lengths, along].into_iter().for_each(Vec::clear);
        if kernel.given().contains(&Slot::Length) {
            lengths.extend(ends.iter().map(|ends| self.body.distance(*ends)));
        }
        let places = (&ends[..], &lengths[..]);
        self.add_slots(kernel.variables(), places, at, variables);
        self.add_slots(kernel.given(), places, at, given);
        if let Some(direction) = direction {
            self.add_slots(kernel.variables(), places, direction, along);
        }
        if !kernel.fields().is_empty() {
            self.add_fields(law, places, fields);
        }
    }

    /// Puts the fields of a law at some places behind `out`. The direction of bonds follows from what is there.
    fn add_fields(&self, law: usize, (ends, lengths): (&[[usize; 2]], &[f64]), out: &mut Vec<f64>) {
        let Some(all) = self.fields() else { return };
        let (own, n) = (all.of_law(law), ends.len());
        let of_places = |place: usize| ends[place].into_iter();
        if lengths.is_empty() {
            all.add(own, n, of_places, out);
            return;
        }
        let directions = all.directions_in(own.clone());
        all.add(own.start..directions.start, n, of_places, out);
        let (d, positions) = (self.body.dimension(), self.body.positions());
        for axis in 0..directions.len() {
            let places = ends.iter().zip(lengths);
            out.extend(places.map(|([i, j], length)| {
                (positions[j * d + axis] - positions[i * d + axis]) / length
            }));
        }
        all.add(directions.end..own.end, n, of_places, out);
    }

    /// The value and the derivatives of a kernel at what is prepared; what derivatives change by, along a
    /// direction.
    pub(super) fn run(kernel: &FamilyKernel, is_product: bool, room: &mut Room) {
        let Room { ends, variables, given, fields, direction, value, slopes, .. } = room;
        let n = ends.len();
        clear(value, n);
        clear(slopes, variables.len());
        let at = FamilyBatch { n, variables, given, fields };
        match is_product {
            true => kernel.product(at, direction, slopes),
            false => kernel.evaluate(at, value, slopes),
        }
    }

    /// Kernels at what is asked of a pass: `now` are values, or a direction from `base`.
    fn through(
        &self,
        (law, kernel): (usize, &FamilyKernel),
        now: At<'_>,
        base: Base<'_>,
        room: &mut Room,
    ) {
        let at = base.map(|(u, base)| At { u, values: &base.values, adjoint: &base.adjoint });
        let places = match at {
            Some(at) => (at, Some(now)),
            None => (now, None),
        };
        self.prepare((law, kernel), places, room);
        VectorEnergy::run(kernel, base.is_some(), room);
    }

    /// Owners of a slab whose bonds go through kernels at once.
    fn chunks(&self, slab: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        let pieces = self.neighborhood.pieces(self.slabs.owners(slab), CHUNK);
        pieces.map(|(owners, _)| owners)
    }

    /// Whether an end gathers by this law.
    pub(super) fn gathers_by(&self, law: usize, [end, _]: &[usize; 2]) -> bool {
        self.laws.of_law.len() == 1 || self.law_of(*end) == law
    }

    /// Whether an end has an energy by this law.
    pub(super) fn is_of(&self, law: usize, ends: &[usize; 2]) -> bool {
        !self.is_released[ends[0]] && self.gathers_by(law, ends)
    }

    /// The bonds of some owners as those of their ends see them that gather by this law.
    fn bonds_of(&self, law: usize, owners: Range<usize>, ends: &mut Vec<[usize; 2]>) {
        self.both_ends(owners, ends);
        if self.laws.of_law.len() > 1 {
            ends.retain(|ends| self.gathers_by(law, ends));
        }
    }

    /// The bonds of some owners as both of their ends see them: those of the owners first.
    pub(super) fn both_ends(&self, owners: Range<usize>, ends: &mut Vec<[usize; 2]>) {
        ends.clear();
        for i in owners {
            ends.extend(self.neighborhood.upper(i).iter().map(|j| [i, j as usize]));
        }
        let n = ends.len();
        ends.extend_from_within(..n);
        ends[n..].iter_mut().for_each(|ends| ends.reverse());
    }

    /// The integrals and the functions of them.
    pub(super) fn gather<const D: usize>(&self, u: &[f64], base: Base<'_>, out: &mut Gathered) {
        self.room.provide(Room::default);
        let (m, volumes) = (self.n_gathered(), self.body.volumes());
        clear(&mut out.values, m * self.body.n_points());
        let now = At { u, values: &[], adjoint: &[] };
        let laws = self.with_numbers(|kernels| Some(&kernels.integrands), multiplied);
        let values = Part::new(Layout::Points(m), &mut out.values);
        visit(&self.slabs, values, (), |slab, [here, next], ()| {
            let (mut values, mut room) = (Touched::new(here, next), self.room.take(Room::default));
            for owners in self.chunks(slab) {
                for (law, kernel, numbers) in &laws {
                    self.bonds_of(*law, owners.clone(), &mut room.ends);
                    self.through((*law, kernel), now, base, &mut room);
                    add_rows(&mut values, m, numbers, &room, |[i, j]| (i, volumes[j]));
                }
            }
        });
        for law in self.with_numbers(|kernels| kernels.functions.as_ref(), multiplied) {
            let now = At { u, values: &out.values, adjoint: &[] };
            for of_points in self.over_points(&law, now, base) {
                of_points.each(&law.2, |i, k, value| out.values[i * m + k] = value);
            }
        }
    }

    /// Kernels of some kind by law, with those of their variables that are gathered numbers of a kind.
    fn with_numbers<'a>(
        &'a self,
        kernel: impl Fn(&'a VectorKernels) -> Option<&'a FamilyKernel>,
        number: fn(Slot) -> Option<usize>,
    ) -> Vec<OfLaw<'a>> {
        let present = self.laws.present();
        let of_law = present.filter_map(|(law, kernels)| Some((law, kernel(kernels)?)));
        of_law.map(|(law, kernel)| (law, kernel, numbers(kernel, number))).collect()
    }

    /// A kernel at all points of its law, chunk by chunk: values, and derivatives by the numbers that are named.
    fn over_points(
        &self,
        (law, kernel, numbers): &OfLaw<'_>,
        now: At<'_>,
        base: Base<'_>,
    ) -> Vec<OfPoints> {
        let n = self.body.n_points();
        let chunk = |chunk: usize| {
            let mut room = self.room.take(Room::default);
            room.ends.clear();
            let own = (chunk * POINTS..n.min((chunk + 1) * POINTS)).map(|point| [point; 2]);
            room.ends.extend(own.filter(|ends| self.is_of(*law, ends)));
            self.through((*law, kernel), now, base, &mut room);
            let n = room.ends.len();
            let slopes = numbers.iter().flat_map(|[variable, _]| &room.slopes[variable * n..][..n]);
            OfPoints {
                points: room.ends.iter().map(|ends| ends[0]).collect(),
                value: room.value.clone(),
                slopes: slopes.copied().collect(),
            }
        };
        (0..n.div_ceil(POINTS)).into_par_iter().map(chunk).collect()
    }

    /// What points gather, energies per volume, and what is sought behind them. The same of a direction: products.
    pub(super) fn pass<const D: usize>(
        &self,
        u: &[f64],
        base: Base<'_>,
        gathered: &mut Gathered,
        mut sought: Sought<'_>,
    ) {
        self.gather::<D>(u, base, gathered);
        let (m, n) = (self.n_gathered(), self.body.n_points());
        let Gathered { values, adjoint, points, bonds } = gathered;
        clear(adjoint, m * n);
        clear(points, n);
        clear(bonds, n);
        let now = At { u, values, adjoint: &[] };
        let scale = self.laws.thickness;
        for law in self.with_numbers(|kernels| kernels.points.as_ref(), own) {
            for of_points in self.over_points(&law, now, base) {
                of_points.each(&law.2, |i, k, slope| adjoint[i * m + k] = scale * slope);
                let values = of_points.points.iter().zip(&of_points.value);
                values.for_each(|(i, value)| points[*i] = scale * value);
            }
        }
        sought.forces().fill(0.0);
        if self.laws.has()[1] {
            self.through_bonds::<D>(now, base, (adjoint, bonds, sought.forces()));
        }
        if matches!(sought, Sought::Energy) {
            return;
        }
        for law in self.with_numbers(|kernels| kernels.functions.as_ref(), own) {
            for of_points in self.over_points(&law, At { u, values, adjoint }, base) {
                of_points.each(&law.2, |i, k, slope| adjoint[i * m + k] += slope);
            }
        }
        if let Sought::Forces(out) = sought {
            self.back::<D>(At { u, values: &[], adjoint }, base, out);
        }
    }

    /// Energies of bonds, their derivatives by what both ends gather, and what bonds pull with by themselves.
    fn through_bonds<const D: usize>(
        &self,
        now: At<'_>,
        base: Base<'_>,
        (adjoint, energies, forces): (&mut [f64], &mut [f64], &mut [f64]),
    ) {
        let (m, volumes) = (self.n_gathered(), self.body.volumes());
        let half = 0.5 * self.laws.thickness;
        let laws = self.with_numbers(|kernels| kernels.bonds.as_ref(), own);
        let laws: Vec<(OfLaw<'_>, Vec<[usize; 2]>)> = laws
            .into_iter()
            .map(|law| {
                let neighbours = numbers(law.1, neighbour);
                (law, neighbours)
            })
            .collect();
        let shared = (
            Part::new(Layout::Points(m), adjoint),
            Part::new(Layout::Points(1), energies),
            Part::new(Layout::Points(1), forces.as_chunks_mut::<D>().0),
        );
        visit(&self.slabs, shared, (), |slab, [here, next], ()| {
            let mut adjoint = Touched::new(&mut here.0, &mut next.0);
            let mut energies = Touched::new(&mut here.1, &mut next.1);
            let mut forces: Touched<'_, [f64; D]> = Touched::new(&mut here.2, &mut next.2);
            let mut room = self.room.take(Room::default);
            for owners in self.chunks(slab) {
                for ((law, kernel, own), neighbours) in &laws {
                    self.bonds_of(*law, owners.clone(), &mut room.ends);
                    if self.lost.is_some() {
                        room.ends.retain(|ends| !self.is_released[ends[0]]);
                    }
                    self.through((*law, kernel), now, base, &mut room);
                    for ([i, j], value) in room.ends.iter().zip(&room.value) {
                        energies[*i] += half * volumes[*j] * value;
                    }
                    add_rows(&mut adjoint, m, own, &room, |[i, j]| (i, half * volumes[j]));
                    add_rows(&mut adjoint, m, neighbours, &room, |[i, j]| (j, half * volumes[i]));
                    if !forces.is_empty() {
                        add_pulls(&mut forces, volumes, (kernel, half), &room);
                    }
                }
            }
        });
    }

    /// Adds what bonds pull with because of what their ends gather.
    fn back<const D: usize>(&self, now: At<'_>, base: Base<'_>, out: &mut [f64]) {
        let volumes = self.body.volumes();
        let forces = Part::new(Layout::Points(1), out.as_chunks_mut::<D>().0);
        visit(&self.slabs, forces, (), |slab, [here, next], ()| {
            let mut forces: Touched<'_, [f64; D]> = Touched::new(here, next);
            let mut room = self.room.take(Room::default);
            for owners in self.chunks(slab) {
                for (law, VectorKernels { integrands: kernel, .. }) in self.laws.present() {
                    self.bonds_of(law, owners.clone(), &mut room.ends);
                    self.through((law, kernel), now, base, &mut room);
                    add_pulls(&mut forces, volumes, (kernel, 1.0), &room);
                }
            }
        });
    }

    /// The energies of points and of bonds in J, and what is sought behind them.
    pub(super) fn energies<const D: usize>(
        &self,
        u: &[f64],
        gathered: &mut Gathered,
        mut sought: Sought<'_>,
    ) -> Result<[f64; 2], NonFinite> {
        self.pass::<D>(u, None, gathered, sought.again());
        let m = self.n_gathered();
        let has_adjoint = !matches!(sought, Sought::Energy);
        let forces = &*sought.forces();
        let is_bad = |i: &usize| {
            let adjoint = if has_adjoint { &gathered.adjoint[i * m..(i + 1) * m] } else { &[] };
            let forces = forces.get(i * D..(i + 1) * D).unwrap_or_default();
            let energies = [gathered.points[*i], gathered.bonds[*i]];
            !energies.iter().chain(adjoint).chain(forces).all(|x| x.is_finite())
        };
        if let Some(i) = (0..self.body.n_points()).find(is_bad) {
            return Err(self.named(i, gathered.values.get(i * m).copied(), u));
        }
        let energies = [&gathered.points, &gathered.bonds];
        Ok(energies.map(|densities| Sum::of_products(densities, self.body.volumes()).value()))
    }

    /// What the energies of points change by under uniform displacement gradients, `n x d x d`: see
    /// [`crate::energy::Energy::virials`].
    pub(super) fn changes_of_shares<const D: usize>(
        &self,
        u: &[f64],
        virials: &mut [f64],
    ) -> Result<(), NonFinite> {
        let mut base = Gathered::default();
        self.energies::<D>(u, &mut base, Sought::Energy)?;
        let n = self.body.n_points();
        let (positions, volumes) = (self.body.positions(), self.body.volumes());
        let mut change = Gathered::default();
        for component in 0..D * D {
            let (row, column) = (component / D, component % D);
            let of = |k: usize| if k % D == row { positions[k - row + column] } else { 0.0 };
            let p: Vec<f64> = (0..n * D).map(of).collect();
            self.gather::<D>(&p, Some((u, &base)), &mut change);
            let shares = self.along::<D>((u, &base.values), (&p, &change.values));
            for (i, share) in shares.into_iter().enumerate() {
                virials[i * D * D + component] = volumes[i] * share;
            }
        }
        Ok(())
    }

    /// What the energy per volume of each point changes by along a direction.
    fn along<const D: usize>(
        &self,
        (u, values): (&[f64], &[f64]),
        (p, changes): (&[f64], &[f64]),
    ) -> Vec<f64> {
        let (volumes, thickness) = (self.body.volumes(), self.laws.thickness);
        let at = At { u, values, adjoint: &[] };
        let direction = At { u: p, values: changes, adjoint: &[] };
        let of_points = |i: usize| {
            let mut room = self.room.take(Room::default);
            let mut change = 0.0;
            let (row, law) = (self.neighborhood.row(i), self.law_of(i));
            let kernels = self.laws.of_law.get(law).and_then(Option::as_ref);
            let Some(kernels) = kernels.filter(|_| !self.is_released[i]) else { return 0.0 };
            for kernel in [&kernels.points, &kernels.bonds] {
                let Some(kernel) = kernel else { continue };
                let is_of_bonds = kernel.given().contains(&Slot::Length);
                room.ends.clear();
                match is_of_bonds {
                    true => room.ends.extend(row.iter().map(|j| [i, j as usize])),
                    false => room.ends.extend((!row.is_empty()).then_some([i; 2])),
                }
                self.prepare((law, kernel), (at, Some(direction)), &mut room);
                VectorEnergy::run(kernel, false, &mut room);
                let n = room.ends.len();
                for (k, (slope, along)) in room.slopes.iter().zip(&room.direction).enumerate() {
                    let [i, j] = room.ends[k % n];
                    let weight = if i == j { 1.0 } else { 0.5 * volumes[j] };
                    change += thickness * weight * slope * along;
                }
            }
            change
        };
        (0..self.body.n_points()).into_par_iter().map(of_points).collect()
    }
}

/// A law with its kernel, and those of the kernel's variables that are gathered numbers of a kind.
type OfLaw<'a> = (usize, &'a FamilyKernel, Vec<[usize; 2]>);

/// What a kernel gives at some points.
struct OfPoints {
    points: Vec<usize>,
    value: Vec<f64>,
    /// Derivatives by the gathered numbers that were named, number by number.
    slopes: Vec<f64>,
}

impl OfPoints {
    /// Hands over the derivatives, with their points and numbers.
    fn each(&self, numbers: &[[usize; 2]], mut take: impl FnMut(usize, usize, f64)) {
        let n = self.points.len();
        for ([_, k], slopes) in numbers.iter().zip(self.slopes.chunks(n.max(1))) {
            self.points.iter().zip(slopes).for_each(|(i, slope)| take(*i, *k, *slope));
        }
    }
}

fn multiplied(slot: Slot) -> Option<usize> {
    if let Slot::Multiplier(k) = slot { Some(k) } else { None }
}

fn own(slot: Slot) -> Option<usize> {
    if let Slot::Own(k) = slot { Some(k) } else { None }
}

fn neighbour(slot: Slot) -> Option<usize> {
    if let Slot::Neighbour(k) = slot { Some(k) } else { None }
}

/// The variables of a kernel that are gathered numbers of some kind: their places among all and the numbers.
fn numbers(kernel: &FamilyKernel, number: impl Fn(Slot) -> Option<usize>) -> Vec<[usize; 2]> {
    let all = kernel.variables().iter().enumerate();
    all.filter_map(|(place, slot)| Some([place, number(*slot)?])).collect()
}

/// Adds derivatives by gathered numbers to the rows of points, place by place: `row` says of the ends of a place
/// which point, and times what.
fn add_rows(
    out: &mut Touched<'_, f64>,
    m: usize,
    numbers: &[[usize; 2]],
    room: &Room,
    row: impl Fn([usize; 2]) -> (usize, f64),
) {
    if numbers.is_empty() {
        return;
    }
    let n = room.ends.len();
    for (place, ends) in room.ends.iter().enumerate() {
        let (point, weight) = row(*ends);
        let out = out.range(point * m..(point + 1) * m);
        for [variable, k] in numbers {
            out[*k] += weight * room.slopes[variable * n + place];
        }
    }
}

/// Adds what bonds pull at both their ends with, times a factor.
fn add_pulls<const D: usize>(
    forces: &mut Touched<'_, [f64; D]>,
    volumes: &[f64],
    (kernel, factor): (&FamilyKernel, f64),
    room: &Room,
) {
    let moved = |axis: usize| kernel.variables().iter().position(|x| *x == Slot::Moved(axis));
    let n = room.ends.len();
    let Some(first) = moved(0) else { return };
    // All components of the vector are variables, one after the other.
    let slopes = &room.slopes[first * n..(first + D) * n];
    for (place, [i, j]) in room.ends.iter().enumerate() {
        let weight = factor * volumes[*i] * volumes[*j];
        let pull: [f64; D] = std::array::from_fn(|axis| weight * slopes[axis * n + place]);
        let there = &mut forces[*j];
        (0..D).for_each(|axis| there[axis] += pull[axis]);
        let here = &mut forces[*i];
        (0..D).for_each(|axis| here[axis] -= pull[axis]);
    }
}

/// The variables of a kernel with its derivatives by them at all places of the room.
pub(super) fn of_slots<'a>(
    kernel: &'a FamilyKernel,
    room: &'a Room,
) -> impl Iterator<Item = (Slot, &'a [f64])> {
    let slopes = room.slopes.chunks(room.ends.len().max(1));
    kernel.variables().iter().copied().zip(slopes)
}
