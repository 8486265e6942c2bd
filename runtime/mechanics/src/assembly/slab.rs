//! The interactions that one slab owns: gathered into batches, evaluated, added up.

use super::accumulate::{OwnerSums, TetrahedronLane, TriangleLane};
use super::bonds::{BondRoom, BondSums, Untouched};
use super::product::Batch;
use super::rows::Rows;
use super::sum::Sum;
use super::tetrahedra::{Owner, Rules, TetrahedronSums};
use super::{DiscreteEnergy, Kind};
use crate::element::{CAPACITY, Contributions, Element, InteractionBatch, NonFiniteLane, Order};
use crate::energy::{Argument, NonFinite};
use crate::interaction::schedule::{Part, Touched};
use crate::interaction::{CliqueRoom, OwnerCliques, never_fails};
use crate::matrix::BlockPattern;

/// A slab with the rows it may write to.
pub(super) struct SlabTask<'a> {
    slab: usize,
    rows: Rows<'a>,
    /// Whether no other slab has written to these rows yet.
    is_first: bool,
}

/// The energy of one slab.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SlabEnergy {
    bonds: Sum,
    triangles: Sum,
    tetrahedra: Sum,
}

/// The energies of bonds, triangles and tetrahedra: those of the slabs in their order; an error is the lowest of all: bonds before triangles before
/// tetrahedra, then by points.
pub(super) fn total(
    outcomes: impl Iterator<Item = Result<SlabEnergy, NonFinite>>,
) -> Result<[f64; 3], NonFinite> {
    let mut total = SlabEnergy::default();
    let mut lowest: Option<NonFinite> = None;
    for outcome in outcomes {
        match outcome {
            Ok(part) => {
                total.bonds.join(&part.bonds);
                total.triangles.join(&part.triangles);
                total.tetrahedra.join(&part.tetrahedra);
            }
            Err(error) => {
                let key = |error: &NonFinite| (error.argument, error.points.clone());
                if lowest.as_ref().is_none_or(|known| key(&error) < key(known)) {
                    lowest = Some(error);
                }
            }
        }
    }
    match lowest {
        Some(error) => Err(error),
        None => Ok([total.bonds.value(), total.triangles.value(), total.tetrahedra.value()]),
    }
}

/// Work arrays of a thread for the interactions of a slab.
pub(super) struct Room<const D: usize> {
    pub(super) cliques: CliqueRoom<D>,
    bonds: Option<BondRoom>,
    triangles: Option<Gathered<TriangleLane, D>>,
    triangles_of_owner: Vec<TriangleLane>,
    tetrahedra: Option<Gathered<TetrahedronLane, D>>,
    pairs: PairNumbers,
    by_pairs: TetrahedronSums,
    sums: OwnerSums<D>,
    /// For products, kind by kind.
    pub(super) products: [Option<Batch<D>>; 3],
}

impl<const D: usize> Room<D> {
    /// Large enough for all interactions, so that it does not matter which slabs a thread is given.
    pub(super) fn new(energy: &DiscreteEnergy) -> Room<D> {
        let members = energy.neighborhood.most_later();
        let kinds = [&energy.bonds, &energy.triangles, &energy.tetrahedra];
        let [bonds, triangles, tetrahedra] = kinds.map(Option::as_ref);
        let of_tetrahedra = if tetrahedra.is_some() { members } else { 0 };
        let of_triangles = if triangles.is_some() { members * members / 2 } else { 0 };
        Room {
            cliques: CliqueRoom::new(&energy.neighborhood, &energy.slabs),
            bonds: bonds.map(|kind| BondRoom::new(energy, kind)),
            triangles: triangles.map(|kind| Gathered::new(kind, members)),
            triangles_of_owner: Vec::with_capacity(of_triangles),
            tetrahedra: tetrahedra.map(|kind| Gathered::new(kind, members)),
            pairs: PairNumbers::with_capacity(of_tetrahedra),
            by_pairs: TetrahedronSums::with_capacity(of_tetrahedra),
            sums: OwnerSums::with_capacity(members),
            products: kinds.map(|kind| kind.as_ref().map(|kind| Batch::new(kind, members))),
        }
    }
}

/// Gradient and tangent of some slabs.
type Arrays<'a> = (Part<'a, f64>, Part<'a, f64>);

impl<'a> SlabTask<'a> {
    /// With the rows of a slab and of the next.
    pub(super) fn new(
        pattern: &'a BlockPattern,
        slab: usize,
        here: &'a mut Arrays<'_>,
        next: &'a mut Arrays<'_>,
    ) -> SlabTask<'a> {
        let rows = Rows {
            row_start: &pattern.row_start,
            gradient: Touched::new(&mut here.0, &mut next.0),
            tangent: Touched::new(&mut here.1, &mut next.1),
        };
        SlabTask { slab, rows, is_first: slab.is_multiple_of(2) }
    }

    /// Assembles the interactions of the slab in the plane, kind by kind.
    pub(super) fn in_plane(
        mut self,
        energy: &DiscreteEnergy,
        order: Order,
        u: &[f64],
        room: &mut Room<2>,
    ) -> Result<SlabEnergy, NonFinite> {
        let context = self.begin::<2>(energy, order, u);
        context.bonds_and_triangles(room, &mut self.rows)
    }

    /// The same in space.
    pub(super) fn in_space(
        mut self,
        energy: &DiscreteEnergy,
        order: Order,
        u: &[f64],
        room: &mut Room<3>,
    ) -> Result<SlabEnergy, NonFinite> {
        let context = self.begin::<3>(energy, order, u);
        let mut total = context.bonds_and_triangles(room, &mut self.rows)?;
        if let Some(kind) = &energy.tetrahedra {
            total.tetrahedra = context.tetrahedra(kind, room, &mut self.rows)?;
        }
        Ok(total)
    }

    fn begin<'b, const D: usize>(
        &mut self,
        energy: &'b DiscreteEnergy,
        order: Order,
        u: &'b [f64],
    ) -> Context<'b, D> {
        // Where bonds are alone each coupling is written once, and nothing need be cleared before.
        let alone = energy.triangles.is_none() && energy.tetrahedra.is_none();
        if self.is_first && !(alone && energy.bonds.is_some()) {
            self.rows.clear_tangent();
        }
        let untouched = Untouched { couplings: alone, diagonal: alone && self.is_first };
        Context { energy, slab: self.slab, order, u, untouched }
    }
}

/// What all kinds of interaction of a slab need.
pub(super) struct Context<'a, const D: usize> {
    pub(super) energy: &'a DiscreteEnergy,
    pub(super) slab: usize,
    pub(super) order: Order,
    pub(super) u: &'a [f64],
    pub(super) untouched: Untouched,
}

impl<'a, const D: usize> Context<'a, D> {
    fn bonds_and_triangles(
        &self,
        room: &mut Room<D>,
        rows: &mut Rows<'_>,
    ) -> Result<SlabEnergy, NonFinite> {
        let mut total = SlabEnergy::default();
        if let (Some(kind), Some(room)) = (&self.energy.bonds, &mut room.bonds) {
            // Numbers of a bond.
            total.bonds = match D {
                2 => BondSums::<D, 5>::new(self, kind, room).add(self.slab, rows)?,
                _ => BondSums::<D, 9>::new(self, kind, room).add(self.slab, rows)?,
            };
        }
        if let Some(kind) = &self.energy.triangles {
            total.triangles = self.triangles(kind, room, rows)?;
        }
        Ok(total)
    }

    /// Displacements of the members relative to the owner.
    fn displacements(&self, cliques: &OwnerCliques<'_, D>, out: &mut Vec<[f64; D]>) {
        let own = row::<D>(self.u, cliques.owner());
        out.clear();
        out.extend(cliques.members().iter().map(|&m| minus(&row(self.u, m as usize), &own)));
    }

    fn triangles(
        &self,
        kind: &Kind,
        room: &mut Room<D>,
        rows: &mut Rows<'_>,
    ) -> Result<Sum, NonFinite> {
        let Room { cliques, triangles: Some(batch), triangles_of_owner, sums, .. } = room else {
            return Ok(Sum::default());
        };
        batch.restart();
        self.energy.with_cliques(self.slab, cliques, |cliques| {
            for owner in self.energy.slabs.owners(self.slab) {
                cliques.set(owner);
                self.displacements(cliques, &mut batch.displacement);
                batch.set_shares(kind, cliques);
                sums.reset(self.order, cliques.members().len(), 0);
                triangles_of_owner.clear();
                never_fails(cliques.triangles(|j, k, place| {
                    let members = [j as u32, k as u32];
                    triangles_of_owner.push(TriangleLane { members, place: place as u32 });
                    Ok(())
                }));
                for lanes in triangles_of_owner.chunks(CAPACITY) {
                    batch.lanes.extend_from_slice(lanes);
                    self.add_triangles(kind, cliques, batch, sums, rows)?;
                }
                sums.write(cliques, self.order, rows);
            }
            Ok(batch.sum)
        })
    }

    fn add_triangles(
        &self,
        kind: &Kind,
        cliques: &OwnerCliques<'_, D>,
        batch: &mut Gathered<TriangleLane, D>,
        sums: &mut OwnerSums<D>,
        rows: &mut Rows<'_>,
    ) -> Result<(), NonFinite> {
        batch.gather(kind, cliques, |lane| lane.members);
        batch.evaluate(kind, self, |lane| named(cliques, &lane.members))?;
        sums.add_triangles(&batch.lanes, &batch.out, self.order, cliques, rows);
        batch.lanes.clear();
        Ok(())
    }
}

impl Context<'_, 3> {
    fn tetrahedra(
        &self,
        kind: &Kind,
        room: &mut Room<3>,
        rows: &mut Rows<'_>,
    ) -> Result<Sum, NonFinite> {
        let Room { cliques, tetrahedra: Some(batch), pairs, by_pairs, sums, .. } = room else {
            return Ok(Sum::default());
        };
        batch.restart();
        self.energy.with_cliques(self.slab, cliques, |cliques| {
            for owner in self.energy.slabs.owners(self.slab) {
                cliques.set(owner);
                self.displacements(cliques, &mut batch.displacement);
                batch.set_shares(kind, cliques);
                pairs.set(cliques);
                sums.reset(self.order, cliques.members().len(), pairs.count);
                if !self.sum_by_pairs(kind, cliques, pairs, by_pairs, batch, sums)? {
                    self.sum_one_by_one(kind, cliques, pairs, batch, sums)?;
                }
                sums.write(cliques, self.order, rows);
            }
            Ok(batch.sum)
        })
    }

    /// Sums the tetrahedra of an owner over pairs of corners; `false` where that is not possible:
    /// with elements that know no law, and where a tetrahedron is refused.
    fn sum_by_pairs(
        &self,
        kind: &Kind,
        cliques: &OwnerCliques<'_, 3>,
        pairs: &PairNumbers,
        by_pairs: &mut TetrahedronSums,
        batch: &mut Gathered<TetrahedronLane, 3>,
        sums: &mut OwnerSums<3>,
    ) -> Result<bool, NonFinite> {
        let Some((law, arch)) = kind.element.law() else { return Ok(false) };
        let (weights, order, least) = (&kind.weights, self.order, kind.element.least());
        let rules = Rules { law, arch, weights, order, least };
        let owner = Owner {
            cliques,
            displacement: &batch.displacement,
            own_share: batch.own_share,
            shares: &batch.shares,
            pairs,
        };
        if !by_pairs.fill(&rules, &owner) {
            return Ok(false);
        }
        by_pairs.derive(&owner, order, sums);
        batch.sum.join(&by_pairs.energy);
        for &lane in &by_pairs.thin {
            batch.lanes.push(lane);
            if batch.is_full() {
                self.add_tetrahedra(kind, cliques, batch, sums)?;
            }
        }
        self.add_tetrahedra(kind, cliques, batch, sums)?;
        Ok(true)
    }

    /// Sums the tetrahedra of an owner in the order of their corners, as the element gives them.
    fn sum_one_by_one(
        &self,
        kind: &Kind,
        cliques: &OwnerCliques<'_, 3>,
        pairs: &PairNumbers,
        batch: &mut Gathered<TetrahedronLane, 3>,
        sums: &mut OwnerSums<3>,
    ) -> Result<(), NonFinite> {
        cliques.tetrahedra(|j, k, l| {
            batch.lanes.push(TetrahedronLane {
                members: [j as u32, k as u32, l as u32],
                pairs: [pairs.of(j, k), pairs.of(j, l), pairs.of(k, l)],
            });
            if batch.is_full() {
                self.add_tetrahedra(kind, cliques, batch, sums)?;
            }
            Ok(())
        })?;
        self.add_tetrahedra(kind, cliques, batch, sums)
    }

    fn add_tetrahedra(
        &self,
        kind: &Kind,
        cliques: &OwnerCliques<'_, 3>,
        batch: &mut Gathered<TetrahedronLane, 3>,
        sums: &mut OwnerSums<3>,
    ) -> Result<(), NonFinite> {
        if batch.lanes.is_empty() {
            return Ok(());
        }
        batch.gather(kind, cliques, |lane| lane.members);
        batch.evaluate(kind, self, |lane| named(cliques, &lane.members))?;
        sums.add_tetrahedra(&batch.lanes, &batch.out, self.order);
        batch.lanes.clear();
        Ok(())
    }
}

/// An interaction that its element refused.
pub(super) struct Refusal<'a> {
    pub(super) element: &'a dyn Element,
    pub(super) lane: NonFiniteLane,
}

impl Refusal<'_> {
    /// What is known of it, from its points.
    pub(super) fn of<const D: usize>(&self, points: Vec<usize>, u: &[f64]) -> NonFinite {
        let (element, NonFiniteLane { value, reference, .. }) = (self.element, self.lane);
        NonFinite {
            argument: Argument::Measure(element.measure()),
            displacements: points.iter().flat_map(|&point| row::<D>(u, point)).collect(),
            points,
            value,
            reference,
            inverted: element.forbids_inversion() && value <= 0.0,
        }
    }
}

/// The points of an interaction of an owner, from its members.
pub(super) fn named<const D: usize>(cliques: &OwnerCliques<'_, D>, members: &[u32]) -> Vec<usize> {
    let point = |&member: &u32| cliques.members()[member as usize] as usize;
    std::iter::once(cliques.owner()).chain(members.iter().map(point)).collect()
}

/// Interactions on their way through an element, and the energy so far.
struct Gathered<L, const D: usize> {
    /// What is known of each interaction.
    lanes: Vec<L>,
    /// Displacements relative to owners.
    displacement: Vec<[f64; D]>,
    /// Shares of the owner and of its members in the weights.
    own_share: f64,
    shares: Vec<f64>,
    batch: InteractionBatch,
    out: Contributions,
    sum: Sum,
}

impl<L, const D: usize> Gathered<L, D> {
    fn new(kind: &Kind, members: usize) -> Gathered<L, D> {
        let measure = kind.element.measure();
        Gathered {
            lanes: Vec::with_capacity(CAPACITY),
            displacement: Vec::with_capacity(members),
            own_share: 0.0,
            shares: Vec::with_capacity(members),
            batch: InteractionBatch::new(measure, D),
            out: Contributions::new(measure, D),
            sum: Sum::default(),
        }
    }

    /// Starts a new slab.
    fn restart(&mut self) {
        self.lanes.clear();
        self.sum = Sum::default();
    }

    #[inline(always)]
    fn is_full(&self) -> bool {
        self.lanes.len() == CAPACITY
    }

    fn set_shares(&mut self, kind: &Kind, cliques: &OwnerCliques<'_, D>) {
        self.own_share = kind.weights.share(cliques.owner());
        self.shares.clear();
        let members = cliques.members().iter();
        self.shares.extend(members.map(|&member| kind.weights.share(member as usize)));
    }

    /// Fills the batch from the lanes of one owner.
    fn gather<const K: usize>(
        &mut self,
        kind: &Kind,
        cliques: &OwnerCliques<'_, D>,
        members: impl Fn(&L) -> [u32; K],
    ) {
        let lanes = &self.lanes[..self.lanes.len().min(CAPACITY)];
        let corners = |lane: usize| members(&lanes[lane]).map(|member| member as usize);
        self.batch.gather(lanes.len(), cliques.reference(), &self.displacement, corners);
        let (shares, mut known) = (&self.shares, ([usize::MAX; K], 0.0));
        for lane in 0..lanes.len() {
            let corners = corners(lane);
            // Neighbouring interactions share all corners but the last.
            if corners[..K - 1] != known.0[..K - 1] || lane == 0 {
                let begun = corners.map(|member| shares[member]);
                known = (corners, kind.weights.begin(self.own_share, &begun[..K - 1]));
            }
            self.batch.weight[lane] = kind.weights.join_last(known.1, shares[corners[K - 1]]);
        }
    }

    fn evaluate(
        &mut self,
        kind: &Kind,
        context: &Context<'_, D>,
        points: impl Fn(&L) -> Vec<usize>,
    ) -> Result<(), NonFinite> {
        if self.batch.is_empty() {
            return Ok(());
        }
        let element = &*kind.element;
        element.evaluate(&self.batch, context.order, &mut self.out).map_err(|lane| {
            let points = points(&self.lanes[lane.lane]);
            Refusal { element, lane }.of::<D>(points, context.u)
        })?;
        let (len, padded) = (self.batch.len(), self.batch.padded_len());
        self.out.energy[len..padded].fill(0.0);
        self.sum.add(&self.out.energy[..padded]);
        Ok(())
    }
}

/// Numbers of the pairs of an owner's members that are neighbours, in lexicographic order.
#[derive(Default)]
pub(super) struct PairNumbers {
    number: Vec<u32>,
    n_members: usize,
    count: usize,
}

impl PairNumbers {
    fn with_capacity(members: usize) -> PairNumbers {
        PairNumbers { number: vec![0; members * members], ..PairNumbers::default() }
    }

    fn set<const D: usize>(&mut self, cliques: &OwnerCliques<'_, D>) {
        self.n_members = cliques.members().len();
        self.count = 0;
        self.number.resize(self.number.len().max(self.n_members * self.n_members), 0);
        for j in 0..self.n_members {
            for (k, _) in cliques.later(j) {
                self.number[j * self.n_members + k] = self.count as u32;
                self.count += 1;
            }
        }
    }

    /// How many pairs there are.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Those of the pairs of `j` with each member after it that is its neighbour.
    #[inline(always)]
    pub(super) fn row(&self, j: usize) -> &[u32] {
        &self.number[j * self.n_members..(j + 1) * self.n_members]
    }

    #[inline(always)]
    pub(super) fn of(&self, j: usize, k: usize) -> u32 {
        self.number[j * self.n_members + k]
    }
}

#[inline(always)]
pub(super) fn row<const D: usize>(rows: &[f64], point: usize) -> [f64; D] {
    std::array::from_fn(|axis| rows[point * D + axis])
}

#[inline(always)]
pub(super) fn minus<const D: usize>(p: &[f64; D], q: &[f64; D]) -> [f64; D] {
    std::array::from_fn(|axis| p[axis] - q[axis])
}
