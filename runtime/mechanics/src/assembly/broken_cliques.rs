//! Triangles and tetrahedra that are gone, by their edges or by a criterion of their own.
//!
//! Owners leave out what is gone ([`Lost`]). What that releases is the energy of their cliques before less
//! that after, owner by owner: no other energy changes.

use rayon::prelude::*;

use super::product::points;
use super::slab::Room;
use super::visit::{Sink, Visit, minus, row};
use super::{DiscreteEnergy, Rooms};
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
            let mut held = Holding { direction, half: 0.5 * step, held: Held::default() };
            let visit = Visit { energy: self, slab, order: Order::Gradient, u, only: Some(owners) };
            visit.all(&mut room, &mut held, false)?;
            Ok(held.held)
        };
        let found: Result<Vec<Held>, NonFinite> = slabs.map(of_slab).collect();
        Ok(found?.iter().fold(Held::default(), Held::and))
    }
}

/// What cliques hold on a way, added up.
struct Holding<'a> {
    direction: &'a [f64],
    half: f64,
    held: Held,
}

impl<const D: usize, const K: usize> Sink<D, K> for &mut Holding<'_> {
    fn take(&mut self, cliques: &OwnerCliques<'_, D>, batch: &[Clique], out: &mut Contributions) {
        let own = row::<D>(self.direction, cliques.owner());
        for (lane, clique) in batch.iter().enumerate() {
            let mut power = 0.0;
            for (corner, point) in points::<D, K>(cliques, clique).into_iter().enumerate() {
                let pull: [f64; D] =
                    std::array::from_fn(|axis| out.gradient[corner * D + axis][lane]);
                power += dot(&pull, &minus(&row::<D>(self.direction, point), &own));
            }
            self.held.energy += out.energy[lane];
            self.held.timing += self.half * power;
        }
    }
}
