//! Triangles and tetrahedra that are gone, by their edges or by a criterion of their own.
//!
//! Owners leave out what is gone ([`Lost`]). What that releases is the energy of their cliques before less
//! that after, owner by owner: no other energy changes.

use rayon::prelude::*;

use super::product::points;
use super::slab::Room;
use super::visit::{Gathered, Sink, Visit, minus, row};
use super::{DiscreteEnergy, Rooms};
use crate::body::Body;
use crate::element::{Contributions, Order};
use crate::energy::NonFinite;
use crate::fracture::{Held, Release};
use crate::geometry::dot;
use crate::interaction::{Bits, Clique, Lost, OwnerCliques, Ranks, n_neighbors};
use crate::kernel::Measure;
use crate::pool::Pool;

impl DiscreteEnergy {
    /// Whether there are energies of triangles or tetrahedra.
    fn has_cliques(&self) -> bool {
        self.triangles.is_some() || self.tetrahedra.is_some()
    }

    /// What is gone, from the first time on that something goes.
    fn losing(&mut self) -> &mut Lost {
        let DiscreteEnergy { lost, neighborhood, .. } = self;
        lost.get_or_insert_with(|| Box::new(Lost::nothing_of(neighborhood)))
    }

    /// Takes out all cliques with one of these edges.
    pub(super) fn lose_edges(&mut self, bonds: &[usize]) {
        if self.has_cliques() && !bonds.is_empty() {
            let owners = Lost::owners_of(&self.neighborhood, bonds);
            self.losing().lose_edges(bonds, &owners);
        }
    }

    /// See [`crate::energy::Energy::lose_cliques`].
    pub(super) fn lose_own(&mut self, measure: Measure, ranks: &Ranks, numbers: &[usize]) {
        if self.kinds()[measure as usize].is_some() {
            self.losing().lose_cliques(n_neighbors(measure), ranks, numbers);
        }
    }

    /// Puts back cliques with these edges. Where nothing is gone any more all is as it was before anything went.
    pub(super) fn regain_edges(&mut self, bonds: &[usize]) {
        let Some(lost) = &mut self.lost else { return };
        lost.regain_edges(&self.neighborhood, bonds);
        self.lost.take_if(|lost| lost.is_nothing());
    }

    /// See [`crate::energy::Energy::regain_cliques`].
    pub(super) fn regain_own(&mut self, measure: Measure, numbers: &[usize]) {
        let Some(lost) = &mut self.lost else { return };
        lost.regain_cliques(&self.neighborhood, n_neighbors(measure), numbers);
        self.lost.take_if(|lost| lost.is_nothing());
    }

    /// Breaks bonds as [`crate::energy::Energy::break_bonds`] says.
    pub(super) fn release_bonds(
        &mut self,
        u: &[f64],
        way: (f64, &[f64]),
        bonds: &[usize],
    ) -> Result<Release, NonFinite> {
        let mut held = vec![Held::default(); bonds.len()];
        self.add_held_of(u, way, bonds, &mut held)?;
        let release = held.iter().fold(Release::of(bonds.len()), Release::and_all_of);
        if !self.has_cliques() {
            self.lose_bonds(bonds);
            return Ok(release);
        }
        let owners = Lost::owners_of(&self.neighborhood, bonds);
        let before = self.held_by_owners(u, way, &owners)?;
        self.lose_bonds(bonds);
        let after = self.held_by_owners(u, way, &owners)?;
        Ok(release.and_all_of(&before.less(&after)))
    }

    /// See [`crate::energy::Energy::break_cliques`].
    pub(super) fn release_own(
        &mut self,
        u: &[f64],
        way: (f64, &[f64]),
        (measure, ranks, numbers): (Measure, &Ranks, &[usize]),
    ) -> Result<Release, NonFinite> {
        if self.kinds()[measure as usize].is_none() || numbers.is_empty() {
            return Ok(Release::default());
        }
        let mut owners = Bits::none_of(self.body.n_points());
        numbers.iter().for_each(|number| {
            owners.insert(ranks.owner(*number));
        });
        let before = self.held_by_owners(u, way, &owners)?;
        self.lose_own(measure, ranks, numbers);
        let after = self.held_by_owners(u, way, &owners)?;
        Ok(Release::default().and_all_of(&before.less(&after)))
    }

    /// What the triangles and tetrahedra of some owners hold.
    fn held_by_owners(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        owners: &Bits,
    ) -> Result<Held, NonFinite> {
        match &self.rooms {
            Rooms::Plane(rooms) => self.held_in(rooms, u, way, owners),
            Rooms::Space(rooms) => self.held_in(rooms, u, way, owners),
        }
    }

    fn held_in<const D: usize>(
        &self,
        rooms: &Pool<Room<D>>,
        u: &[f64],
        (step, direction): (f64, &[f64]),
        owners: &Bits,
    ) -> Result<Held, NonFinite> {
        let slabs = (0..self.slabs.len()).into_par_iter();
        let slabs = slabs.filter(|slab| owners.have_any(self.slabs.owners(*slab)));
        let of_slab = |slab: usize| {
            let mut room = rooms.take(|| Room::new(self));
            let (body, half) = (&*self.body, 0.5 * step);
            let mut held = Holding { body, direction, half, held: Held::default() };
            let visit = Visit { energy: self, slab, order: Order::Gradient, u, only: Some(owners) };
            visit.all(&mut room, &mut held, [false, true, true])?;
            Ok(held.held)
        };
        let found: Result<Vec<Held>, NonFinite> = slabs.map(of_slab).collect();
        Ok(found?.iter().fold(Held::default(), Held::and))
    }

    /// See [`crate::energy::Energy::add_held_by_cliques`]. What remembers nothing holds the same as before.
    pub(super) fn add_held_of_cliques(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        (measure, ranks, numbers): (Measure, &Ranks, &[usize]),
        held: &mut [Held],
    ) -> Result<(), NonFinite> {
        let kind = self.kinds()[measure as usize];
        let Some(kind) = kind.filter(|kind| kind.has_states() && !numbers.is_empty()) else {
            return Ok(());
        };
        let mut owners = Bits::none_of(self.body.n_points());
        numbers.iter().for_each(|number| {
            owners.insert(ranks.owner(*number));
        });
        let (mut numbers, mut held, mut pieces) = (numbers, held, Vec::new());
        for slab in 0..self.slabs.len() {
            let end = ranks.first(self.slabs.owners(slab).end);
            let (own, others) = numbers.split_at(numbers.partition_point(|number| *number < end));
            let (own_held, others_held) = held.split_at_mut(own.len());
            (numbers, held) = (others, others_held);
            if !own.is_empty() {
                pieces.push((slab, own, own_held));
            }
        }
        let pieces = pieces.into_par_iter();
        let found = pieces.map(|(slab, numbers, held)| {
            let (direction, half) = (way.1, 0.5 * way.0);
            let body = &*self.body;
            let mut each = HoldingEach { body, ranks, numbers, held, first: 0, direction, half };
            let only = Some(&owners);
            let visit = Visit { energy: self, slab, order: Order::Gradient, u, only };
            match &self.rooms {
                Rooms::Plane(rooms) => {
                    let mut room = rooms.take(|| Room::new(self));
                    let Room { cliques, gathered: [_, triangles, _], .. } = &mut *room;
                    let Some(gathered) = triangles else { return Ok(()) };
                    visit.run::<2, 2>(kind, (cliques, gathered), &mut each)
                }
                Rooms::Space(rooms) => {
                    let mut room = rooms.take(|| Room::new(self));
                    let Room { cliques, gathered: [_, triangles, tetrahedra], .. } = &mut *room;
                    match (measure, triangles, tetrahedra) {
                        (Measure::Area, Some(gathered), _) => {
                            visit.run::<3, 2>(kind, (cliques, gathered), &mut each)
                        }
                        (Measure::Volume, _, Some(gathered)) => {
                            visit.run::<3, 3>(kind, (cliques, gathered), &mut each)
                        }
                        _ => Ok(()),
                    }
                }
            }
        });
        found.collect()
    }
}

/// Which part of a clique counts.
fn counted<const D: usize, const K: usize>(
    body: &Body,
    cliques: &OwnerCliques<'_, D>,
    clique: &Clique,
) -> f64 {
    let others = points::<D, K>(cliques, clique).into_iter();
    body.counted_part(std::iter::once(cliques.owner()).chain(others))
}

/// The power of what a clique pulls with on a way.
fn power<const D: usize, const K: usize>(
    cliques: &OwnerCliques<'_, D>,
    (clique, lane): (&Clique, usize),
    out: &Contributions,
    direction: &[f64],
) -> f64 {
    let own = row::<D>(direction, cliques.owner());
    let mut power = 0.0;
    for (corner, point) in points::<D, K>(cliques, clique).into_iter().enumerate() {
        let pull: [f64; D] = std::array::from_fn(|axis| out.gradient[corner * D + axis][lane]);
        power += dot(&pull, &minus(&row::<D>(direction, point), &own));
    }
    power
}

/// What single cliques hold on a way.
struct HoldingEach<'a> {
    body: &'a Body,
    ranks: &'a Ranks,
    /// Ascending.
    numbers: &'a [usize],
    held: &'a mut [Held],
    /// The first number of the owner.
    first: usize,
    direction: &'a [f64],
    half: f64,
}

impl<const D: usize, const K: usize> Sink<D, K> for HoldingEach<'_> {
    fn begin(&mut self, cliques: &OwnerCliques<'_, D>, _: &mut Gathered<D>) -> bool {
        self.first = self.ranks.first(cliques.owner());
        true
    }

    fn wants(&self, clique: &Clique) -> bool {
        self.numbers.binary_search(&(self.first + clique.number as usize)).is_ok()
    }

    fn take(&mut self, cliques: &OwnerCliques<'_, D>, batch: &[Clique], out: &mut Contributions) {
        for (lane, clique) in batch.iter().enumerate() {
            let number = self.first + clique.number as usize;
            let Ok(place) = self.numbers.binary_search(&number) else { continue };
            let power = power::<D, K>(cliques, (clique, lane), out, self.direction);
            let counted = counted::<D, K>(self.body, cliques, clique);
            self.held[place].energy += counted * out.energy[lane];
            self.held[place].timing += self.half * power;
        }
    }
}

/// What cliques hold on a way, added up.
struct Holding<'a> {
    body: &'a Body,
    direction: &'a [f64],
    half: f64,
    held: Held,
}

impl<const D: usize, const K: usize> Sink<D, K> for Holding<'_> {
    fn take(&mut self, cliques: &OwnerCliques<'_, D>, batch: &[Clique], out: &mut Contributions) {
        for (lane, clique) in batch.iter().enumerate() {
            let power = power::<D, K>(cliques, (clique, lane), out, self.direction);
            let counted = counted::<D, K>(self.body, cliques, clique);
            self.held.energy += counted * out.energy[lane];
            self.held.timing += self.half * power;
        }
    }
}
