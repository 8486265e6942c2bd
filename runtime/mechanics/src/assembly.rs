//! The discrete total energy of a body with its exact derivatives.
//!
//! `E(u) = sum over interactions of weight * psi(measure(u))`, each bond, triangle and tetrahedron
//! once. Interactions are enumerated by their owners, slab by slab (see
//! [`crate::interaction::Slabs`]): even slabs at once, odd ones after their neighbours. Every number is
//! summed in an order that the body alone decides, so results have the same bits for any number of
//! threads.

mod abreast;
mod accumulate;
mod axes;
mod bonds;
mod broken;
mod broken_cliques;
pub(crate) mod error;
mod fours;
mod inversion;
mod kind;
mod on_lattice;
mod pairs;
mod product;
pub(crate) mod quadratic;
mod registers;
mod rows;
mod runs;
mod slab;
pub(crate) mod sum;
mod tetrahedra;
mod visit;

pub(crate) use broken::{affine_limits, affine_threshold};
pub use error::AssemblyError;

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use crate::body::Body;
use crate::element::{Element, MeasureElement, Order};
use crate::energy::{Energy, Hessian, Inversion, Limits, NonFinite, Wanted, check_sizes};
use crate::fracture::{Held, Release};
use crate::interaction::schedule::{Cut, Layout, Part, visit};
use crate::interaction::{
    Bits, Census, CliqueRoom, ContributingPairs, Degeneracy, Inverted, Lost, OwnerCliques, Ranks,
    Report, Slabs,
};
use crate::kernel::{Law, Measure};
use crate::materials::Materials;
use crate::matrix::BlockPattern;
use crate::neighborhood::Neighborhood;
use crate::pool::Pool;
use crate::surface::Weighting;
use fours::BondFours;
use inversion::Motion;
use kind::Kind;
use on_lattice::OnLattice;
use product::InteractionHessian;
use slab::{Room, SlabEnergy, SlabTask};

/// An energy density for each kind of interaction that is modelled.
#[derive(Default)]
pub struct Laws {
    /// `psi(l)` in J/m^(2d).
    pub bond: Option<Box<dyn Law>>,
    /// `psi(a)` in J/m^(3d).
    pub triangle: Option<Box<dyn Law>>,
    /// `psi(v)` in J/m^(4d); in three dimensions only.
    pub tetrahedron: Option<Box<dyn Law>>,
}

impl Laws {
    /// These laws on the geometry of their measures.
    pub fn into_elements(self, dimension: usize) -> Elements {
        let element = |measure: Measure, law: Option<Box<dyn Law>>| {
            law.map(|law| {
                Box::new(MeasureElement::new(measure, dimension, law)) as Box<dyn Element>
            })
        };
        Elements {
            bond: element(Measure::Length, self.bond),
            triangle: element(Measure::Area, self.triangle),
            tetrahedron: element(Measure::Volume, self.tetrahedron),
        }
    }
}

/// An element for each kind of interaction that is modelled.
#[derive(Default)]
pub struct Elements {
    /// One-neighbour interactions.
    pub bond: Option<Box<dyn Element>>,
    /// Two-neighbour interactions.
    pub triangle: Option<Box<dyn Element>>,
    /// Three-neighbour interactions; in three dimensions only.
    pub tetrahedron: Option<Box<dyn Element>>,
}

/// The discrete total energy.
pub struct DiscreteEnergy {
    body: Arc<Body>,
    neighborhood: Arc<Neighborhood>,
    degeneracy: Degeneracy,
    slabs: Slabs,
    contributing: Option<ContributingPairs>,
    /// Made when it is first asked for: bodies without a stored tangent need none.
    pattern: OnceLock<Arc<BlockPattern>>,
    bonds: Option<Kind>,
    on_lattice: OnLattice,
    fours: Option<BondFours>,
    triangles: Option<Kind>,
    tetrahedra: Option<Kind>,
    /// `psi(l)`, `psi(a)`, `psi(v)`: those that are modelled.
    names: Arc<[String]>,
    report: Report,
    /// Room for passes: of their threads, and for what becomes of slabs.
    rooms: Rooms,
    outcomes: Pool<Vec<Result<SlabEnergy, NonFinite>>>,
    /// Whether bonds of each slab, triangles and tetrahedra had gone beyond their limits when forces were last worked
    /// out; empty where nobody watches.
    exceeded: [Vec<AtomicBool>; 3],
    /// What is gone of triangles and tetrahedra; nothing as long as none is.
    lost: Option<Box<Lost>>,
    /// The corrections of bonds that were taken out, where they are not 1.
    lost_factors: BTreeMap<usize, f64>,
}

/// Work arrays of threads by the dimension of the body.
enum Rooms {
    Plane(Pool<Room<2>>),
    Space(Pool<Room<3>>),
}

impl DiscreteEnergy {
    /// The energy of laws of the measures. The horizon is in m.
    pub fn new(
        body: Arc<Body>,
        horizon: f64,
        weighting: impl Into<Weighting>,
        laws: Laws,
    ) -> Result<DiscreteEnergy, AssemblyError> {
        let elements = laws.into_elements(body.dimension());
        DiscreteEnergy::with_elements(body, horizon, weighting, elements)
    }

    /// The energy of any elements.
    pub fn with_elements(
        body: Arc<Body>,
        horizon: f64,
        weighting: impl Into<Weighting>,
        elements: Elements,
    ) -> Result<DiscreteEnergy, AssemblyError> {
        error::check_elements(std::slice::from_ref(&elements), body.dimension())?;
        let neighborhood = Arc::new(Neighborhood::new(&body, horizon)?);
        DiscreteEnergy::among(body, neighborhood, weighting, elements)
    }

    /// The energy of any elements, of neighbours that energies of the body share.
    pub fn among(
        body: Arc<Body>,
        neighborhood: Arc<Neighborhood>,
        weighting: impl Into<Weighting>,
        elements: Elements,
    ) -> Result<DiscreteEnergy, AssemblyError> {
        DiscreteEnergy::of_materials(body, neighborhood, weighting, None, vec![elements])
    }

    /// The energy of a body of several materials, of neighbours that energies of the body share:
    /// `elements` has those of each law of `materials`, of the only one where there are none. An
    /// interaction that has no element in a law has no energy in it.
    pub fn of_materials(
        body: Arc<Body>,
        neighborhood: Arc<Neighborhood>,
        weighting: impl Into<Weighting>,
        materials: Option<Arc<Materials>>,
        elements: Vec<Elements>,
    ) -> Result<DiscreteEnergy, AssemblyError> {
        let n_laws = materials.as_ref().map_or(1, |materials| materials.n_laws());
        assert_eq!(elements.len(), n_laws, "elements for each law");
        let of_body = materials.as_ref().is_none_or(|m| m.n_points() == body.n_points());
        assert!(of_body, "a material for each point");
        error::check_elements(&elements, body.dimension())?;
        let elements = Elements::by_kind(elements);
        let horizon = neighborhood.horizon();
        error::check_neighbors(&body, &neighborhood)?;
        let slabs = Slabs::new(&neighborhood);
        let degeneracy = Degeneracy::new(&body);
        let needed = |measure: Measure| elements[measure as usize].iter().any(Option::is_some);
        let weighting: Weighting = weighting.into();
        weighting.check(&body, Measure::ALL.into_iter().filter(|measure| needed(*measure)))?;
        let census = Census::new(&body, &neighborhood, degeneracy, &slabs, needed);
        let mut kinds = [None, None, None];
        for (measure, (kind, elements)) in
            Measure::ALL.into_iter().zip(kinds.iter_mut().zip(elements))
        {
            if elements.iter().any(Option::is_some) {
                let weights = weighting.weights.of_measure(measure, &body, horizon, &census)?;
                let own = Kind::new(measure, elements, weights, materials.clone());
                *kind = Some(own.corrected(weighting, &body, &neighborhood)?);
            }
        }
        let present = kinds.iter().flatten();
        let names = present.map(|kind| format!("psi({})", kind.argument())).collect();
        let [bonds, triangles, tetrahedra] = kinds;
        let n_blocks = body.n_points() + neighborhood.n_bonds();
        let matrix_bytes = 8 * n_blocks * body.dimension() * body.dimension();
        let fits = ContributingPairs::bytes(&neighborhood) <= matrix_bytes / 2;
        let contributing = (triangles.is_some() && fits).then(|| match body.dimension() {
            2 => ContributingPairs::new::<2>(&body, &neighborhood, degeneracy, &slabs),
            _ => ContributingPairs::new::<3>(&body, &neighborhood, degeneracy, &slabs),
        });
        let report = Report {
            n_points: body.n_points(),
            bonds: if bonds.is_some() { census.bonds } else { 0 },
            triangles: census.triangles,
            tetrahedra: census.tetrahedra,
            dropped_triangles: census.dropped_triangles,
            dropped_tetrahedra: census.dropped_tetrahedra,
            shell_bonds: neighborhood.shell_bonds(),
            pattern_blocks: n_blocks,
            ways: Vec::new(),
        };
        let rooms = match body.dimension() {
            2 => Rooms::Plane(Pool::new()),
            _ => Rooms::Space(Pool::new()),
        };
        let mut energy = DiscreteEnergy {
            body,
            neighborhood,
            degeneracy,
            slabs,
            contributing,
            pattern: OnceLock::new(),
            bonds,
            on_lattice: OnLattice::default(),
            fours: None,
            triangles,
            tetrahedra,
            names,
            report,
            rooms,
            outcomes: Pool::new(),
            exceeded: Default::default(),
            lost: None,
            lost_factors: BTreeMap::new(),
        };
        energy.on_lattice = OnLattice::new(&energy);
        if energy.on_lattice.bonds.is_none() {
            energy.fours = BondFours::new(&energy);
        }
        energy.report.ways = energy.ways();
        Ok(energy)
    }

    /// The same where all interactions go in batches through kernels, along lists of neighbours, also where a
    /// lattice and an affine law allow a shorter way; to compare with. Before bonds break.
    pub fn in_batches(self) -> DiscreteEnergy {
        let mut energy = DiscreteEnergy { on_lattice: OnLattice::default(), fours: None, ..self };
        energy.report.ways = energy.ways();
        energy
    }

    /// The body.
    pub fn body(&self) -> &Arc<Body> {
        &self.body
    }

    /// Who is within the horizon of whom.
    pub fn neighborhood(&self) -> &Neighborhood {
        &self.neighborhood
    }

    /// How forces go over the body, as [`Report::ways`] says it.
    fn ways(&self) -> Vec<&'static str> {
        let kinds = self.kinds().into_iter().flatten().count();
        let [in_fours, on_rows] = [usize::from(self.fours.is_some()), self.along_rows().len()];
        let in_batches = kinds - on_rows - in_fours;
        let ways = [("batches", in_batches), ("fours", in_fours), ("rows", on_rows)];
        ways.into_iter().filter(|(_, kinds)| *kinds > 0).map(|(way, _)| way).collect()
    }

    /// The measures whose forces go along the rows of a lattice, without neighbour lists and kernels:
    /// those whose law is affine in the measure or in its square.
    pub fn along_rows(&self) -> Vec<Measure> {
        self.on_lattice.measures()
    }

    /// The kind of interaction whose measure has a sign, if it is modelled.
    fn signed(&self) -> Option<&Kind> {
        if self.body.dimension() == 2 { self.triangles.as_ref() } else { self.tetrahedra.as_ref() }
    }

    /// The kinds of interaction: bonds, triangles, tetrahedra.
    fn kinds(&self) -> [Option<&Kind>; 3] {
        [&self.bonds, &self.triangles, &self.tetrahedra].map(Option::as_ref)
    }

    /// Writes the parts of the energy; `gradient` becomes its derivative, `blocks` its second one: all
    /// blocks on the pattern, where their rows start, or the diagonal ones.
    fn assemble(
        &self,
        order: Order,
        u: &[f64],
        gradient: &mut [f64],
        (row_start, blocks): (Option<&[usize]>, &mut [f64]),
        parts: &mut [f64],
    ) -> Result<(), NonFinite> {
        let d = self.body.dimension();
        let layout = match row_start {
            Some(row_start) => Layout::Rows(row_start, d * d),
            None => Layout::Points(d * d),
        };
        let mut add_up = |fans: Option<&AtomicBool>| {
            gradient.fill(0.0);
            let arrays = (Part::new(Layout::Points(d), gradient), Part::new(layout, blocks));
            match &self.rooms {
                Rooms::Plane(rooms) => self.over_slabs(rooms, arrays, |slab, [own, next], room| {
                    SlabTask::new((row_start, fans), slab, own, next).in_plane(self, order, u, room)
                }),
                Rooms::Space(rooms) => self.over_slabs(rooms, arrays, |slab, [own, next], room| {
                    SlabTask::new((row_start, fans), slab, own, next).in_space(self, order, u, room)
                }),
            }
        };
        let are_refused = AtomicBool::new(false);
        let go_in_fans = order == Order::Tangent && self.on_lattice.has_triangle_blocks(self);
        let fans = go_in_fans.then_some(&are_refused);
        // A fan has triangles of several slabs: where those of one do not go so, those of no other do.
        let energies = add_up(fans)?.map_or_else(|| add_up(None), |known| Ok(Some(known)))?;
        let energies = self.kinds().into_iter().zip(energies.unwrap_or_default());
        let modelled = energies.filter(|(kind, _)| kind.is_some());
        parts.iter_mut().zip(modelled).for_each(|(part, (_, energy))| *part = energy);
        Ok(())
    }

    /// Visits all slabs with the arrays that they write to; the energies of bonds, triangles and
    /// tetrahedra.
    fn over_slabs<const D: usize, P: Cut>(
        &self,
        rooms: &Pool<Room<D>>,
        arrays: P,
        run: impl Fn(usize, [&mut P; 2], &mut Room<D>) -> Result<SlabEnergy, NonFinite> + Sync,
    ) -> Result<Option<[f64; 3]>, NonFinite> {
        rooms.provide(|| Room::new(self));
        self.kinds()
            .into_iter()
            .flatten()
            .flat_map(Kind::elements)
            .for_each(|element| element.provide());
        let mut outcomes = self.outcomes.take(Vec::new);
        outcomes.clear();
        outcomes.resize_with(self.slabs.len(), || Ok(SlabEnergy::default()));
        let own = Part::new(Layout::Slabs, &mut outcomes[..]);
        visit(&self.slabs, arrays, own, |slab, parts, outcome| {
            let mut room = rooms.take(|| Room::new(self));
            outcome.into_values()[0] = run(slab, parts, &mut room);
        });
        slab::total(outcomes.drain(..))
    }

    /// Works with what inversions need of a room.
    fn in_room<const D: usize, R>(
        &self,
        rooms: &Pool<Room<D>>,
        work: impl FnOnce((&mut CliqueRoom<D>, &mut Motion<D>)) -> R,
    ) -> R {
        let mut room = rooms.take(|| Room::new(self));
        let Room { cliques, motion, .. } = &mut *room;
        work((cliques, motion))
    }

    /// Shows the owners of a slab one after the other, with their cliques of `K` members.
    fn for_each_owner<const D: usize, const K: usize, E>(
        &self,
        slab: usize,
        room: &mut CliqueRoom<D>,
        see: impl FnMut(&OwnerCliques<'_, D>) -> Result<(), E>,
    ) -> Result<(), E> {
        self.for_each_owner_of::<D, K, E>((slab, None), room, see)
    }

    /// The same of `only` some owners, where these are given.
    fn for_each_owner_of<const D: usize, const K: usize, E>(
        &self,
        (slab, only): (usize, Option<&Bits>),
        room: &mut CliqueRoom<D>,
        mut see: impl FnMut(&OwnerCliques<'_, D>) -> Result<(), E>,
    ) -> Result<(), E> {
        let (touched, arrays) = (self.slabs.touched(slab), std::mem::take(room));
        let (body, neighborhood) = (&self.body, &self.neighborhood);
        let cliques = OwnerCliques::in_room(body, neighborhood, self.degeneracy, touched, arrays);
        let cliques = cliques.with_contributing(self.contributing.as_ref());
        let mut cliques = cliques.with_lost(self.lost.as_deref());
        let is_seen = |owner: &usize| only.is_none_or(|only| only.has(*owner));
        let result = self.slabs.owners(slab).filter(is_seen).try_for_each(|owner| {
            cliques.set_of::<K>(owner);
            see(&cliques)
        });
        *room = cliques.into_room();
        result
    }
}

impl Energy for DiscreteEnergy {
    fn dimension(&self) -> usize {
        self.body.dimension()
    }

    fn counted(&self) -> Range<usize> {
        self.body.counted()
    }

    fn positions(&self) -> &[f64] {
        self.body.positions()
    }

    fn parts(&self) -> &Arc<[String]> {
        &self.names
    }

    fn report(&self) -> Report {
        self.report.clone()
    }

    fn keeps_pattern(&self) -> bool {
        true
    }

    fn pattern(&self) -> &Arc<BlockPattern> {
        let make = || Arc::new(BlockPattern::of_bonds(&self.neighborhood, self.body.dimension()));
        self.pattern.get_or_init(make)
    }

    /// Products of bonds along rows, or in fours: 3 to 6 ns a bond in place of 13. Of triangles there are too
    /// many.
    fn has_quick_products(&self) -> bool {
        let are_quick = self.on_lattice.bonds.is_some() || self.fours.is_some();
        are_quick && self.triangles.is_none() && self.tetrahedra.is_none()
    }

    fn evaluate(&self, u: &[f64], wanted: Wanted<'_>, parts: &mut [f64]) -> Result<(), NonFinite> {
        check_sizes(self, u, &wanted, parts);
        let nothing = (None, &mut [][..]);
        match wanted {
            Wanted::Energy => self.assemble(Order::Energy, u, &mut [], nothing, parts),
            Wanted::Forces(forces) => {
                let order = if parts.is_empty() { Order::Force } else { Order::Gradient };
                self.assemble(order, u, forces, nothing, parts)
            }
            Wanted::Tangent(forces, tangent) => {
                let blocks = (Some(&self.pattern().row_start[..]), &mut tangent.values[..]);
                self.assemble(Order::Tangent, u, forces, blocks, parts)
            }
            Wanted::Diagonal(forces, diagonal) => {
                self.assemble(Order::Tangent, u, forces, (None, diagonal), parts)
            }
        }
    }

    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite> {
        Ok(Box::new(InteractionHessian { energy: self, u: u.to_vec() }))
    }

    fn shares(&self, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        self.shares_from(None, u, shares)
    }

    fn shares_of(&self, part: usize, u: &[f64], shares: &mut [f64]) -> Result<(), NonFinite> {
        self.shares_from(Some(part), u, shares)
    }

    fn virials(&self, u: &[f64], virials: &mut [f64]) -> Result<(), NonFinite> {
        assert_eq!(virials.len(), u.len() * self.body.dimension(), "virials are n x d x d");
        virials.fill(0.0);
        match &self.rooms {
            Rooms::Plane(rooms) => self.add_virials(rooms, u, virials),
            Rooms::Space(rooms) => self.add_virials(rooms, u, virials),
        }
    }

    fn can_lose_bonds(&self) -> bool {
        true
    }

    fn lose(&mut self, bonds: &[usize]) {
        self.lose_bonds(bonds);
    }

    fn regain(&mut self, bonds: &[usize]) {
        self.regain_bonds(bonds);
    }

    fn watch(&mut self, limits: &[f32]) -> bool {
        self.watch_bonds(limits)
    }

    fn watch_cliques(&mut self, measure: Measure, limits: &Limits<'_>) -> bool {
        self.watch_own(measure, limits)
    }

    fn exceeding(&self, measure: Measure) -> Option<Vec<Range<usize>>> {
        self.exceeding_owners(measure)
    }

    fn break_bonds(
        &mut self,
        u: &[f64],
        way: (f64, &[f64]),
        bonds: &[usize],
    ) -> Result<Release, NonFinite> {
        self.release_bonds(u, way, bonds)
    }

    fn lose_cliques(&mut self, measure: Measure, ranks: &Ranks, numbers: &[usize]) {
        self.lose_own(measure, ranks, numbers);
    }

    fn regain_cliques(&mut self, measure: Measure, numbers: &[usize]) {
        self.regain_own(measure, numbers);
    }

    fn break_cliques(
        &mut self,
        u: &[f64],
        way: (f64, &[f64]),
        cliques: (Measure, &Ranks, &[usize]),
    ) -> Result<Release, NonFinite> {
        self.release_own(u, way, cliques)
    }

    fn add_held(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        bonds: &[usize],
        held: &mut [Held],
    ) -> Result<(), NonFinite> {
        self.add_held_of(u, way, bonds, held)
    }

    fn add_held_by_cliques(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        cliques: (Measure, &Ranks, &[usize]),
        held: &mut [Held],
    ) -> Result<(), NonFinite> {
        self.add_held_of_cliques(u, way, cliques, held)
    }

    fn first_inversion(&self, u: &[f64], step: &[f64]) -> Option<Inversion> {
        let kind = self.signed().filter(|kind| kind.forbids_inversion())?;
        let end: Vec<f64> = u.iter().zip(step).map(|(u, step)| u + step).collect();
        let slabs = (0..self.slabs.len()).into_par_iter();
        let found = slabs.filter_map(|slab| match &self.rooms {
            Rooms::Plane(rooms) => {
                self.in_room(rooms, |room| inversion::first::<2>(self, kind, slab, room, (u, &end)))
            }
            Rooms::Space(rooms) => {
                self.in_room(rooms, |room| inversion::first::<3>(self, kind, slab, room, (u, &end)))
            }
        });
        // Of several at once that of the lowest points.
        found.min_by(|p, q| {
            p.part.total_cmp(&q.part).then_with(|| p.first.points.cmp(&q.first.points))
        })
    }

    fn inverted(&self, u: &[f64]) -> Inverted {
        if self.signed().is_none() {
            return Inverted::default();
        }
        let slabs = (0..self.slabs.len()).into_par_iter();
        let count = slabs.map(|slab| match &self.rooms {
            Rooms::Plane(rooms) => {
                self.in_room(rooms, |room| inversion::count::<2>(self, slab, room, u))
            }
            Rooms::Space(rooms) => {
                self.in_room(rooms, |room| inversion::count::<3>(self, slab, room, u))
            }
        });
        let count = count.sum();
        match self.body.dimension() {
            2 => Inverted { triangles: count, tetrahedra: 0 },
            _ => Inverted { triangles: 0, tetrahedra: count },
        }
    }
}
