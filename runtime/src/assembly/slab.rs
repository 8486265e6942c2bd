//! The interactions that one slab owns: gathered into batches, evaluated, added up.

use super::accumulate::{OwnerSums, TetrahedronLane, TriangleLane, add_bonds};
use super::rows::Rows;
use super::{DiscreteEnergy, Kind};
use crate::element::{Contributions, InteractionBatch, Order};
use crate::energy::{EnergyParts, NonFinite};
use crate::geometry::Geometry;
use crate::geometry::tetrahedron::Tetrahedron;
use crate::geometry::triangle::PlaneTriangle;
use crate::interaction::{OwnerCliques, never_fails};

/// A slab with the rows it may write to.
pub(super) struct SlabTask<'a> {
    pub(super) slab: usize,
    pub(super) rows: Rows<'a>,
}

/// The energy of one slab.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SlabEnergy {
    bonds: Sum,
    triangles: Sum,
    tetrahedra: Sum,
}

/// A sum that carries its rounding error along (Neumaier): as good as one with twice the digits.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    sum: f64,
    error: f64,
}

impl Sum {
    #[inline(always)]
    fn add(&mut self, x: f64) {
        let sum = self.sum + x;
        let lost =
            if self.sum.abs() >= x.abs() { (self.sum - sum) + x } else { (x - sum) + self.sum };
        self.sum = sum;
        self.error += lost;
    }

    fn join(&mut self, other: Sum) {
        self.add(other.sum);
        self.add(other.error);
    }

    fn value(self) -> f64 {
        self.sum + self.error
    }
}

/// Adds the slabs in their order; an error is the lowest of all: bonds before triangles before
/// tetrahedra, then by points.
pub(super) fn total(
    outcomes: impl Iterator<Item = Result<SlabEnergy, NonFinite>>,
) -> Result<EnergyParts, NonFinite> {
    let mut total = SlabEnergy::default();
    let mut lowest: Option<NonFinite> = None;
    for outcome in outcomes {
        match outcome {
            Ok(part) => {
                total.bonds.join(part.bonds);
                total.triangles.join(part.triangles);
                total.tetrahedra.join(part.tetrahedra);
            }
            Err(error) => {
                let key = |error: &NonFinite| (error.measure, error.points.clone());
                if lowest.as_ref().is_none_or(|known| key(&error) < key(known)) {
                    lowest = Some(error);
                }
            }
        }
    }
    match lowest {
        Some(error) => Err(error),
        None => Ok(EnergyParts {
            bonds: total.bonds.value(),
            triangles: total.triangles.value(),
            tetrahedra: total.tetrahedra.value(),
        }),
    }
}

impl SlabTask<'_> {
    /// Assembles the interactions of the slab, kind by kind.
    pub(super) fn assemble(
        self,
        energy: &DiscreteEnergy,
        order: Order,
        u: &[f64],
    ) -> Result<SlabEnergy, NonFinite> {
        match energy.body.dimension() {
            2 => self.assemble_in::<2>(energy, order, u),
            _ => self.assemble_in::<3>(energy, order, u),
        }
    }

    fn assemble_in<const D: usize>(
        self,
        energy: &DiscreteEnergy,
        order: Order,
        u: &[f64],
    ) -> Result<SlabEnergy, NonFinite> {
        let SlabTask { slab, mut rows } = self;
        let mut total = SlabEnergy::default();
        let context = Context::<D> { energy, slab, order, u };
        if let Some(kind) = &energy.bonds {
            total.bonds = context.bonds(kind, &mut rows)?;
        }
        if let Some(kind) = &energy.triangles {
            total.triangles = context.triangles(kind, &mut rows)?;
        }
        if let Some(kind) = &energy.tetrahedra {
            total.tetrahedra = context.tetrahedra(kind, &mut rows)?;
        }
        Ok(total)
    }
}

/// What all kinds of interaction of a slab need.
struct Context<'a, const D: usize> {
    energy: &'a DiscreteEnergy,
    slab: usize,
    order: Order,
    u: &'a [f64],
}

impl<'a, const D: usize> Context<'a, D> {
    fn bonds(&self, kind: &Kind, rows: &mut Rows<'_>) -> Result<Sum, NonFinite> {
        let (body, neighborhood) = (&self.energy.body, &self.energy.neighborhood);
        let mut batch = Gathered::new(kind, D);
        for owner in self.energy.slabs.owners(self.slab) {
            let (rest, now) = (row::<D>(body.positions(), owner), row::<D>(self.u, owner));
            for (place, &other) in neighborhood.upper(owner).iter().enumerate() {
                let other = other as usize;
                let reference = minus(&row(body.positions(), other), &rest);
                let displacement = minus(&row(self.u, other), &now);
                let weight = kind.weights.of([owner, other]);
                batch.batch.push([&reference], [&displacement], weight);
                batch.lanes.push((owner, other, place));
                if batch.batch.is_full() {
                    batch.evaluate(kind, self.order, |&(owner, other, _)| vec![owner, other])?;
                    add_bonds::<D>(&batch.lanes, &batch.out, self.order, rows);
                    batch.clear();
                }
            }
        }
        batch.evaluate(kind, self.order, |&(owner, other, _)| vec![owner, other])?;
        add_bonds::<D>(&batch.lanes, &batch.out, self.order, rows);
        Ok(batch.sum)
    }

    fn cliques(&self) -> OwnerCliques<'a, D> {
        let energy = self.energy;
        let touched = energy.slabs.touched(self.slab);
        OwnerCliques::new(&energy.body, &energy.neighborhood, energy.degeneracy, touched)
    }

    /// Displacements of the members relative to the owner.
    fn displacements(&self, cliques: &OwnerCliques<'_, D>, out: &mut Vec<[f64; D]>) {
        let own = row::<D>(self.u, cliques.owner());
        out.clear();
        out.extend(cliques.members().iter().map(|&m| minus(&row(self.u, m as usize), &own)));
    }

    fn triangles(&self, kind: &Kind, rows: &mut Rows<'_>) -> Result<Sum, NonFinite> {
        let mut cliques = self.cliques();
        let mut batch = Gathered::<TriangleLane>::new(kind, D);
        let (mut sums, mut eta) = (OwnerSums::<D>::default(), Vec::new());
        for owner in self.energy.slabs.owners(self.slab) {
            cliques.set(owner);
            self.displacements(&cliques, &mut eta);
            sums.reset(self.order, cliques.members().len(), 0);
            let (members, reference) = (cliques.members(), cliques.reference());
            let point = |member: u32| members[member as usize] as usize;
            let points = |lane: &TriangleLane| vec![owner, point(lane.j), point(lane.k)];
            let mut flush = |batch: &mut Gathered<TriangleLane>, rows: &mut Rows<'_>| {
                batch.evaluate(kind, self.order, points)?;
                sums.add_triangles(&batch.lanes, &batch.out, self.order, rows);
                batch.clear();
                Ok(())
            };
            cliques.triangles(|j, k| {
                let corners = [owner, members[j] as usize, members[k] as usize];
                let weight = kind.weights.of(corners);
                batch.batch.push([&reference[j], &reference[k]], [&eta[j], &eta[k]], weight);
                let block = rows.coupling::<D>(corners[1], cliques.place(j, k));
                batch.lanes.push(TriangleLane { j: j as u32, k: k as u32, block });
                if batch.batch.is_full() { flush(&mut batch, rows) } else { Ok(()) }
            })?;
            flush(&mut batch, rows)?;
            sums.write(&cliques, self.order, rows);
        }
        Ok(batch.sum)
    }

    fn tetrahedra(&self, kind: &Kind, rows: &mut Rows<'_>) -> Result<Sum, NonFinite> {
        let mut cliques = self.cliques();
        let mut batch = Gathered::<TetrahedronLane>::new(kind, D);
        let (mut sums, mut eta) = (OwnerSums::<D>::default(), Vec::new());
        let mut pairs = PairNumbers::default();
        for owner in self.energy.slabs.owners(self.slab) {
            cliques.set(owner);
            self.displacements(&cliques, &mut eta);
            pairs.set(&cliques);
            sums.reset(self.order, cliques.members().len(), pairs.count);
            let (members, reference) = (cliques.members(), cliques.reference());
            let points = |lane: &TetrahedronLane| {
                let point = |member: u32| members[member as usize] as usize;
                [&[owner], &lane.members.map(point)[..]].concat()
            };
            let mut flush = |batch: &mut Gathered<TetrahedronLane>| {
                batch.evaluate(kind, self.order, points)?;
                sums.add_tetrahedra(&batch.lanes, &batch.out, self.order);
                batch.clear();
                Ok(())
            };
            cliques.tetrahedra(|j, k, l| {
                let point = |member: usize| members[member] as usize;
                let weight = kind.weights.of([owner, point(j), point(k), point(l)]);
                let rest = [&reference[j], &reference[k], &reference[l]];
                batch.batch.push(rest, [&eta[j], &eta[k], &eta[l]], weight);
                batch.lanes.push(TetrahedronLane {
                    members: [j as u32, k as u32, l as u32],
                    pairs: [pairs.of(j, k), pairs.of(j, l), pairs.of(k, l)],
                });
                if batch.batch.is_full() { flush(&mut batch) } else { Ok(()) }
            })?;
            flush(&mut batch)?;
            sums.write(&cliques, self.order, rows);
        }
        Ok(batch.sum)
    }
}

/// A batch with what is known of each of its interactions, and the energy so far.
struct Gathered<L> {
    batch: InteractionBatch,
    lanes: Vec<L>,
    out: Contributions,
    sum: Sum,
}

impl<L> Gathered<L> {
    fn new(kind: &Kind, dimension: usize) -> Gathered<L> {
        let measure = kind.element.measure();
        Gathered {
            batch: InteractionBatch::new(measure, dimension),
            lanes: Vec::with_capacity(crate::element::CAPACITY),
            out: Contributions::new(measure, dimension),
            sum: Sum::default(),
        }
    }

    fn evaluate(
        &mut self,
        kind: &Kind,
        order: Order,
        points: impl Fn(&L) -> Vec<usize>,
    ) -> Result<(), NonFinite> {
        if self.batch.is_empty() {
            return Ok(());
        }
        let result = kind.element.evaluate(&self.batch, order, &mut self.out);
        result.map_err(|refused| NonFinite {
            measure: kind.element.measure(),
            points: points(&self.lanes[refused.lane]),
            value: refused.value,
            reference: refused.reference,
        })?;
        for &energy in &self.out.energy[..self.batch.len()] {
            self.sum.add(energy);
        }
        Ok(())
    }

    fn clear(&mut self) {
        self.batch.clear();
        self.lanes.clear();
    }
}

/// Numbers of the pairs of an owner's members that are neighbours, in lexicographic order.
#[derive(Default)]
struct PairNumbers {
    number: Vec<u32>,
    n_members: usize,
    count: usize,
}

impl PairNumbers {
    fn set<const D: usize>(&mut self, cliques: &OwnerCliques<'_, D>) {
        self.n_members = cliques.members().len();
        self.count = 0;
        self.number.resize(self.number.len().max(self.n_members * self.n_members), 0);
        cliques.for_each_pair(|j, k| {
            self.number[j * self.n_members + k] = self.count as u32;
            self.count += 1;
        });
    }

    #[inline(always)]
    fn of(&self, j: usize, k: usize) -> u32 {
        self.number[j * self.n_members + k]
    }
}

#[inline(always)]
fn row<const D: usize>(rows: &[f64], point: usize) -> [f64; D] {
    std::array::from_fn(|axis| rows[point * D + axis])
}

#[inline(always)]
fn minus<const D: usize>(p: &[f64; D], q: &[f64; D]) -> [f64; D] {
    std::array::from_fn(|axis| p[axis] - q[axis])
}

/// Triangles of a slab with `a < 0`, in the plane.
pub(super) fn inverted_triangles(energy: &DiscreteEnergy, slab: usize, u: &[f64]) -> u64 {
    if energy.triangles.is_none() {
        return 0;
    }
    let context = Context::<2> { energy, slab, order: Order::Energy, u };
    let (mut cliques, mut eta, mut inverted) = (context.cliques(), Vec::new(), 0);
    for owner in energy.slabs.owners(slab) {
        cliques.set(owner);
        context.displacements(&cliques, &mut eta);
        let rest = cliques.reference();
        never_fails(cliques.triangles(|j, k| {
            let change = PlaneTriangle::change(&join([rest[j], rest[k]]), &join([eta[j], eta[k]]));
            inverted += u64::from(change.measure < 0.0);
            Ok(())
        }));
    }
    inverted
}

/// Tetrahedra of a slab with `v < 0`.
pub(super) fn inverted_tetrahedra(energy: &DiscreteEnergy, slab: usize, u: &[f64]) -> u64 {
    if energy.tetrahedra.is_none() {
        return 0;
    }
    let context = Context::<3> { energy, slab, order: Order::Energy, u };
    let (mut cliques, mut eta, mut inverted) = (context.cliques(), Vec::new(), 0);
    for owner in energy.slabs.owners(slab) {
        cliques.set(owner);
        context.displacements(&cliques, &mut eta);
        let rest = cliques.reference();
        never_fails(cliques.tetrahedra(|j, k, l| {
            let reference = join([rest[j], rest[k], rest[l]]);
            let change = Tetrahedron::change(&reference, &join([eta[j], eta[k], eta[l]]));
            inverted += u64::from(change.measure < 0.0);
            Ok(())
        }));
    }
    inverted
}

/// Vectors one after the other.
fn join<const K: usize, const D: usize, const C: usize>(vectors: [[f64; D]; K]) -> [f64; C] {
    std::array::from_fn(|index| vectors[index / D][index % D])
}
