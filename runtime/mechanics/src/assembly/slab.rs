//! The interactions that one slab owns, added up in the rows of its points.

use std::sync::atomic::{AtomicBool, Ordering};

use super::DiscreteEnergy;
use super::abreast::AbreastRoom;
use super::accumulate::{Added, OwnerSums};
use super::axes::{Axes, Wanted};
use super::bonds::{BondRoom, BondSums, Untouched};
use super::fours::FoursRoom;
use super::inversion::Motion;
use super::kind::Kind;
use super::on_lattice::OnLatticeSums;
use super::pairs::PairNumbers;
use super::rows::Rows;
use super::sum::Sum;
use super::tetrahedra::{Owner, Rules, TetrahedronSums};
use super::visit::{Gathered, Sink, Visit};
use crate::element::{Contributions, Order};
use crate::energy::NonFinite;
use crate::interaction::schedule::{Part, Touched};
use crate::interaction::{Bits, Clique, CliqueRoom, OwnerCliques};
use crate::kernel::Measure;

/// A slab with the rows it may write to.
pub(super) struct SlabTask<'a> {
    slab: usize,
    rows: Rows<'a>,
    /// Whether no other slab has written to these rows yet.
    is_first: bool,
    /// Present where the tangent of triangles goes by the fans of bonds: whether some slab has found that it
    /// cannot.
    fans: Option<&'a AtomicBool>,
}

/// The energy of one slab.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SlabEnergy {
    bonds: Sum,
    triangles: Sum,
    tetrahedra: Sum,
    /// Whether its triangles need another treatment than fans, which then all slabs do.
    are_no_fans: bool,
}

/// The energies of bonds, triangles and tetrahedra: those of the slabs in their order. An error is the
/// lowest of all: bonds before triangles before tetrahedra, then by points. Nothing where the triangles of
/// a slab are no fans.
pub(super) fn total(
    outcomes: impl Iterator<Item = Result<SlabEnergy, NonFinite>>,
) -> Result<Option<[f64; 3]>, NonFinite> {
    let mut total = SlabEnergy::default();
    let mut lowest: Option<NonFinite> = None;
    for outcome in outcomes {
        match outcome {
            Ok(part) => {
                total.are_no_fans |= part.are_no_fans;
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
    if total.are_no_fans {
        return Ok(None);
    }
    match lowest {
        Some(error) => Err(error),
        None => Ok(Some([total.bonds.value(), total.triangles.value(), total.tetrahedra.value()])),
    }
}

/// Work arrays of a thread for the interactions of a slab.
pub(super) struct Room<const D: usize> {
    pub(super) cliques: CliqueRoom<D>,
    /// Interactions on their way to sinks, kind by kind.
    pub(super) gathered: [Option<Gathered<D>>; 3],
    bonds: Option<BondRoom>,
    pub(super) axes: Axes,
    pub(super) abreast: AbreastRoom<D>,
    pub(super) fours: FoursRoom,
    pairs: PairNumbers,
    by_pairs: TetrahedronSums,
    sums: OwnerSums<D>,
    /// Where members are, for what turns inside out.
    pub(super) motion: Motion<D>,
}

impl<const D: usize> Room<D> {
    /// Large enough for all interactions, so that it does not matter which slabs a thread is given.
    pub(super) fn new(energy: &DiscreteEnergy) -> Room<D> {
        let members = energy.neighborhood.most_later();
        let on_lattice = &energy.on_lattice;
        let of_tetrahedra = if energy.tetrahedra.is_some() { members } else { 0 };
        Room {
            cliques: CliqueRoom::new(&energy.neighborhood, &energy.slabs),
            gathered: energy.kinds().map(|kind| kind.map(|kind| Gathered::new(kind, members))),
            bonds: energy.bonds.as_ref().map(|kind| BondRoom::new(energy, kind)),
            axes: if on_lattice.is_empty() { Axes::default() } else { Axes::new(energy) },
            abreast: AbreastRoom::new(
                on_lattice.vectors_abreast::<D>(),
                on_lattice.tetrahedra.is_some(),
            ),
            fours: FoursRoom::default(),
            pairs: PairNumbers::with_capacity(of_tetrahedra),
            by_pairs: TetrahedronSums::with_capacity(of_tetrahedra),
            sums: OwnerSums::with_capacity(members, of_tetrahedra * of_tetrahedra / 2),
            motion: Motion::default(),
        }
    }
}

/// Gradient and blocks of some slabs.
type Arrays<'a> = (Part<'a, f64>, Part<'a, f64>);

impl<'a> SlabTask<'a> {
    /// With the rows of a slab and of the next; `row_start` says where the blocks of points start,
    /// and is absent where only diagonal blocks are wanted; where triangles go by fans, whether some slab has
    /// found that they cannot.
    pub(super) fn new(
        (row_start, fans): (Option<&'a [usize]>, Option<&'a AtomicBool>),
        slab: usize,
        here: &'a mut Arrays<'_>,
        next: &'a mut Arrays<'_>,
    ) -> SlabTask<'a> {
        let rows = Rows {
            row_start,
            gradient: Touched::new(&mut here.0, &mut next.0),
            blocks: Touched::new(&mut here.1, &mut next.1),
        };
        SlabTask { slab, rows, is_first: slab.is_multiple_of(2), fans }
    }

    /// Assembles the interactions of the slab in the plane, kind by kind.
    pub(super) fn in_plane(
        mut self,
        energy: &DiscreteEnergy,
        order: Order,
        u: &[f64],
        room: &mut Room<2>,
    ) -> Result<SlabEnergy, NonFinite> {
        let visit = Visit { energy, slab: self.slab, order, u, only: None };
        self.bonds_and_triangles(visit, room)
    }

    /// The same in space.
    pub(super) fn in_space(
        mut self,
        energy: &DiscreteEnergy,
        order: Order,
        u: &[f64],
        room: &mut Room<3>,
    ) -> Result<SlabEnergy, NonFinite> {
        let visit = Visit { energy, slab: self.slab, order, u, only: None };
        let mut total = self.bonds_and_triangles(visit, room)?;
        if let Some(kind) = energy.tetrahedra.as_ref().filter(|_| !total.are_no_fans) {
            total.tetrahedra = self.tetrahedra(visit, kind, room)?;
        }
        Ok(total)
    }

    fn tetrahedra(
        &mut self,
        visit: Visit<'_>,
        kind: &Kind,
        room: &mut Room<3>,
    ) -> Result<Sum, NonFinite> {
        let known = visit.tetrahedra_abreast(room, &mut self.rows);
        visit.note_beyond(Measure::Volume, known.is_none() || room.axes.is_clique_beyond);
        let sum = known.unwrap_or_default();
        let left = Left { with_blocks: known.is_some(), ..Left::new(visit, known.is_some()) };
        let Room { cliques, gathered: [_, _, gathered], pairs, by_pairs, sums, .. } = room;
        let Some(gathered) = gathered.as_mut().filter(|_| !left.is_nothing()) else {
            return Ok(sum);
        };
        let (rows, added, is_own) = (&mut self.rows, Added::new(visit.order), true);
        let mut sink =
            TetrahedronRows { kind, left, added, is_own, pairs, by_pairs, sums, rows, sum };
        Visit { only: left.only(), ..visit }.run(kind, (cliques, gathered), &mut sink)?;
        Ok(sink.sum)
    }

    fn bonds_and_triangles<const D: usize>(
        &mut self,
        visit: Visit<'_>,
        room: &mut Room<D>,
    ) -> Result<SlabEnergy, NonFinite> {
        // What this slab would find is not looked at.
        if self.fans.is_some_and(|are_refused| are_refused.load(Ordering::Relaxed)) {
            return Ok(SlabEnergy { are_no_fans: true, ..SlabEnergy::default() });
        }
        let untouched = self.untouched(visit.energy);
        let (energy, rows) = (visit.energy, &mut self.rows);
        let mut total = SlabEnergy::default();
        let mut known = visit.on_lattice::<D>(room, rows);
        if known.bonds.is_none() {
            known.bonds = visit.in_fours::<D>(&mut room.fours, rows);
        }
        let Room { axes, fours, .. } = &*room;
        let by_rows = energy.on_lattice.bonds.is_some();
        let is_beyond = if by_rows { axes.is_beyond } else { fours.is_beyond };
        visit.note_beyond(Measure::Length, known.bonds.is_none() || is_beyond);
        visit.note_beyond(Measure::Area, known.triangles.is_none() || axes.is_clique_beyond);
        if let (Some(kind), Some(room)) = (&energy.bonds, &mut room.bonds) {
            total.bonds = bonds::<D>(visit, untouched, (kind, known.bonds), room, rows)?;
        }
        if let Some(are_refused) = self.fans {
            if known.triangles.is_none() {
                are_refused.store(true, Ordering::Relaxed);
                return Ok(SlabEnergy { are_no_fans: true, ..total });
            }
            let (lattice, Room { axes, abreast, .. }) = (&energy.on_lattice, &mut *room);
            lattice.add_triangle_blocks::<D>(energy, visit.slab, visit.u, (axes, abreast), rows);
        }
        let Room { cliques, gathered: [_, gathered, _], sums, .. } = room;
        if let (Some(kind), Some(gathered)) = (&energy.triangles, gathered) {
            let left = Left {
                with_blocks: self.fans.is_some(),
                ..Left::new(visit, known.triangles.is_some())
            };
            total.triangles = known.triangles.unwrap_or_default();
            if !left.is_nothing() {
                let (added, is_own, sum) = (Added::new(visit.order), true, total.triangles);
                let mut sink = TriangleRows { left, added, is_own, sums, rows, sum };
                Visit { only: left.only(), ..visit }.run(kind, (cliques, gathered), &mut sink)?;
                total.triangles = sink.sum;
            }
        }
        Ok(total)
    }

    /// Clears the blocks where that is needed.
    fn untouched(&mut self, energy: &DiscreteEnergy) -> Untouched {
        // Where bonds of one material are alone each coupling is written once, and nothing need be
        // cleared before.
        let is_once = energy.bonds.as_ref().is_some_and(|bonds| bonds.materials.is_none());
        let alone = energy.triangles.is_none() && energy.tetrahedra.is_none() && is_once;
        if self.is_first && !alone {
            self.rows.blocks.fill(0.0);
        }
        Untouched { couplings: alone, diagonal: alone && self.is_first }
    }
}

impl Visit<'_> {
    /// Tells whether interactions of this slab have gone beyond their limits, where somebody watches.
    fn note_beyond(&self, measure: Measure, is_beyond: bool) {
        if let Some(exceeded) = self.energy.exceeded[measure as usize].get(self.slab) {
            exceeded.store(is_beyond, Ordering::Relaxed);
        }
    }

    /// Adds the forces of what goes along the rows of a lattice; the energies of that.
    fn on_lattice<const D: usize>(&self, room: &mut Room<D>, rows: &mut Rows<'_>) -> OnLatticeSums {
        let Room { axes, abreast, .. } = room;
        let (at, wanted) = ((self.u, None), Wanted::Order(self.order));
        let lattice = &self.energy.on_lattice;
        let known = lattice.add(self.energy, self.slab, at, wanted, (axes, abreast));
        if known.is_some() && wanted.has_forces() {
            axes.each::<D>(|point, part| rows.add_gradient(point, part));
        }
        known.unwrap_or_default()
    }

    /// The same for tetrahedra, with their blocks.
    fn tetrahedra_abreast(&self, room: &mut Room<3>, rows: &mut Rows<'_>) -> Option<Sum> {
        let Room { axes, abreast, .. } = room;
        let (energy, wanted) = (self.energy, Wanted::Order(self.order));
        let lattice = &energy.on_lattice;
        let sum =
            lattice.add_tetrahedra(energy, self.slab, (self.u, None), wanted, (axes, abreast))?;
        if wanted.has_forces() {
            axes.each::<3>(|point, part| rows.add_gradient(point, part));
        }
        if self.order == Order::Tangent {
            lattice.add_tetrahedron_blocks(energy, self.slab, (axes, abreast), rows);
        }
        Some(sum)
    }
}

impl Visit<'_> {
    /// The same for bonds that go in fours.
    fn in_fours<const D: usize>(&self, room: &mut FoursRoom, rows: &mut Rows<'_>) -> Option<Sum> {
        let fours = self.energy.fours.as_ref()?;
        let wanted = Wanted::Order(self.order);
        let sum = fours.add::<D>(self.energy, self.slab, (self.u, None), wanted, room)?;
        if wanted.has_forces() {
            room.each::<D>(|point, part| rows.add_gradient(point, part));
        }
        Some(sum)
    }
}

/// Adds the bonds of a slab, but for forces and energies that are known; their energy.
fn bonds<const D: usize>(
    visit: Visit<'_>,
    untouched: Untouched,
    (kind, known): (&Kind, Option<Sum>),
    room: &mut BondRoom,
    rows: &mut Rows<'_>,
) -> Result<Sum, NonFinite> {
    if let Some(sum) = known.filter(|_| visit.order != Order::Tangent) {
        return Ok(sum);
    }
    let rest = (untouched, known.is_some());
    let sum = match D {
        // Numbers of a bond.
        2 => BondSums::<D, 5>::new(visit, rest, kind, room).add(rows)?,
        _ => BondSums::<D, 9>::new(visit, rest, kind, room).add(rows)?,
    };
    Ok(known.unwrap_or(sum))
}

/// What is left to a visit of owners where some have gone abreast.
#[derive(Clone, Copy)]
struct Left<'a> {
    order: Order,
    /// Whether forces and energies are known of all owners but the `rest`.
    is_known: bool,
    /// Whether their blocks are added, too.
    with_blocks: bool,
    /// Owners whose interactions are no longer all there.
    rest: Option<&'a Bits>,
}

impl<'a> Left<'a> {
    fn new(visit: Visit<'a>, is_known: bool) -> Left<'a> {
        let rest = visit.energy.lost.as_ref().map(|lost| lost.owners());
        let rest = rest.filter(|rest| rest.have_any(visit.energy.slabs.owners(visit.slab)));
        Left { order: visit.order, is_known, with_blocks: false, rest }
    }

    /// Whether all is known of all owners but the `rest`.
    fn is_rest(&self) -> bool {
        self.is_known && (self.order != Order::Tangent || self.with_blocks)
    }

    /// Whether no owner need be visited.
    fn is_nothing(&self) -> bool {
        self.is_rest() && self.rest.is_none()
    }

    /// The owners to visit, where these are not all.
    fn only(&self) -> Option<&'a Bits> {
        self.rest.filter(|_| self.is_rest())
    }

    /// Whether the forces and energies of an owner are left, and what is to be added for it.
    fn of(&self, owner: usize) -> (bool, Added) {
        let is_own = !self.is_known || self.rest.is_some_and(|rest| rest.has(owner));
        let all = Added::new(self.order);
        (is_own, Added { forces: is_own && all.forces, ..all })
    }
}

/// Triangles on their way into the rows of their points.
struct TriangleRows<'a, 'r, const D: usize> {
    left: Left<'a>,
    /// Of the owner.
    added: Added,
    is_own: bool,
    sums: &'a mut OwnerSums<D>,
    rows: &'a mut Rows<'r>,
    sum: Sum,
}

impl<const D: usize> Sink<D, 2> for TriangleRows<'_, '_, D> {
    fn begin(&mut self, cliques: &OwnerCliques<'_, D>, _: &mut Gathered<D>) -> bool {
        (self.is_own, self.added) = self.left.of(cliques.owner());
        self.sums.reset(self.added, cliques.members().len(), 0);
        true
    }

    fn take(&mut self, cliques: &OwnerCliques<'_, D>, batch: &[Clique], out: &mut Contributions) {
        if self.left.order.has_energy() && self.is_own {
            self.sum.add(out.energies(batch.len()));
        }
        self.sums.add_triangles(batch, out, self.added, cliques, self.rows);
    }

    fn end(&mut self, cliques: &OwnerCliques<'_, D>) {
        self.sums.write(cliques, self.added, self.rows);
    }
}

/// Tetrahedra on their way into the rows of their points.
struct TetrahedronRows<'a, 'r> {
    kind: &'a Kind,
    left: Left<'a>,
    /// Of the owner.
    added: Added,
    is_own: bool,
    pairs: &'a mut PairNumbers,
    by_pairs: &'a mut TetrahedronSums,
    sums: &'a mut OwnerSums<3>,
    rows: &'a mut Rows<'r>,
    sum: Sum,
}

impl<'a> TetrahedronRows<'a, '_> {
    /// For sums over pairs of corners; nothing of elements that know no law, or take fields.
    fn rules(&self, law: usize) -> Option<Rules<'a>> {
        let (element, weights) = (self.kind.element(law)?, &self.kind.weights);
        if element.n_fields() > 0 {
            return None;
        }
        let (law, arch) = element.law()?;
        Some(Rules { law, arch, weights, order: self.left.order, least: element.least() })
    }
}

impl Sink<3, 3> for TetrahedronRows<'_, '_> {
    /// Sums the tetrahedra of the owner over pairs of corners, if that is possible and none is
    /// refused, and lists those that are thin.
    fn begin(&mut self, cliques: &OwnerCliques<'_, 3>, gathered: &mut Gathered<3>) -> bool {
        (self.is_own, self.added) = self.left.of(cliques.owner());
        self.pairs.set(cliques);
        self.sums.reset(self.added, cliques.members().len(), self.pairs.count());
        if cliques.have_own_losses() {
            return true;
        }
        let Some(rules) = gathered.law.and_then(|law| self.rules(law)) else { return true };
        let owner = Owner { cliques, members: &gathered.members, pairs: self.pairs };
        if !self.by_pairs.fill(&rules, &owner) {
            return true;
        }
        self.by_pairs.derive(&owner, self.added, self.sums);
        if self.is_own {
            self.sum.join(&self.by_pairs.energy);
        }
        gathered.list.extend_from_slice(&self.by_pairs.thin);
        false
    }

    fn take(&mut self, _: &OwnerCliques<'_, 3>, batch: &[Clique], out: &mut Contributions) {
        if self.left.order.has_energy() && self.is_own {
            self.sum.add(out.energies(batch.len()));
        }
        self.sums.add_tetrahedra(batch, self.pairs, out, self.added);
    }

    fn end(&mut self, cliques: &OwnerCliques<'_, 3>) {
        self.sums.write(cliques, self.added, self.rows);
    }
}
