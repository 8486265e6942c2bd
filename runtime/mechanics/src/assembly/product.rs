//! Products of the Hessian with a vector, without its matrix; energies of points, and their virials.
//!
//! What goes along the rows of a lattice, or in fours, has products of its own. In batches each interaction's compact
//! Hessian is used where it is evaluated and not added up. Rows of the
//! Hessian add up to zero over the corners of an interaction, so that only displacements relative
//! to the owner enter, and the owner's part is minus the sum of the others'. Slabs and their order
//! are those of the assembly.

use super::abreast::AbreastRoom;
use super::axes::{Axes, Wanted};
use super::slab::{Room, SlabEnergy};
use super::sum::Sum;
use super::visit::{Sink, Visit, minus, row};
use super::{DiscreteEnergy, Rooms};
use crate::element::{CAPACITY, Contributions, Order};
use crate::energy::{Hessian, NonFinite};
use crate::geometry::{packed, packed_len};
use crate::interaction::schedule::{Layout, Part, Touched};
use crate::interaction::{Clique, OwnerCliques};
use crate::pool::Pool;

/// Rows of `K p`.
struct Product<'a, const D: usize> {
    p: &'a [f64],
    rows: Touched<'a, [f64; D]>,
}

impl<const D: usize, const K: usize> Sink<D, K> for Product<'_, D> {
    fn take(&mut self, cliques: &OwnerCliques<'_, D>, batch: &[Clique], out: &mut Contributions) {
        let (owner, n) = (cliques.owner(), K * D);
        let own = row::<D>(self.p, owner);
        let hessian = &out.hessian[..packed_len(n)];
        for (lane, clique) in batch[..batch.len().min(CAPACITY)].iter().enumerate() {
            let points = points::<D, K>(cliques, clique);
            // Of at most three corners in three dimensions.
            let mut relative = [0.0; 9];
            for (corner, &point) in points.iter().enumerate() {
                let difference = minus(&row::<D>(self.p, point), &own);
                relative[corner * D..(corner + 1) * D].copy_from_slice(&difference);
            }
            let mut force = [0.0; 9];
            for r in 0..n {
                force[r] += hessian[packed(n, r, r)][lane] * relative[r];
                for c in r + 1..n {
                    let entry = hessian[packed(n, r, c)][lane];
                    force[r] += entry * relative[c];
                    force[c] += entry * relative[r];
                }
            }
            for (corner, &point) in points.iter().enumerate() {
                let [own, other] = self.rows.pair(owner, point);
                for axis in 0..D {
                    let part = force[corner * D + axis];
                    other[axis] += part;
                    own[axis] -= part;
                }
            }
        }
    }
}

/// Energies of the points.
struct Shares<'a> {
    rows: Touched<'a, f64>,
}

impl<const D: usize, const K: usize> Sink<D, K> for Shares<'_> {
    fn take(&mut self, cliques: &OwnerCliques<'_, D>, batch: &[Clique], out: &mut Contributions) {
        for (clique, energy) in batch.iter().zip(&out.energy) {
            let part = energy / (K + 1) as f64;
            let points = points::<D, K>(cliques, clique);
            let all = std::iter::once(cliques.owner()).chain(points);
            all.for_each(|point| self.rows[point] += part);
        }
    }
}

/// How the energies of the points change under a uniform displacement gradient.
struct Virials<'a, const D: usize> {
    /// At rest, in m.
    positions: &'a [[f64; D]],
    rows: Touched<'a, [[f64; D]; D]>,
}

impl<const D: usize, const K: usize> Sink<D, K> for Virials<'_, D> {
    fn take(&mut self, cliques: &OwnerCliques<'_, D>, batch: &[Clique], out: &mut Contributions) {
        let (owner, part) = (cliques.owner(), 1.0 / (K + 1) as f64);
        for (lane, clique) in batch.iter().enumerate() {
            let points = points::<D, K>(cliques, clique);
            let mut virial = [[0.0; D]; D];
            for (corner, &point) in points.iter().enumerate() {
                let arm = minus(&self.positions[point], &self.positions[owner]);
                for (axis, row) in virial.iter_mut().enumerate() {
                    let force = part * out.gradient[corner * D + axis][lane];
                    (0..D).for_each(|c| row[c] += force * arm[c]);
                }
            }
            for point in std::iter::once(owner).chain(points) {
                let all = self.rows[point].as_flattened_mut().iter_mut();
                all.zip(virial.as_flattened()).for_each(|(sum, x)| *sum += x);
            }
        }
    }
}

/// The points of an interaction besides the owner.
#[inline(always)]
pub(super) fn points<const D: usize, const K: usize>(
    cliques: &OwnerCliques<'_, D>,
    clique: &Clique,
) -> [usize; K] {
    clique.corners::<K>().map(|member| cliques.members()[member] as usize)
}

impl Visit<'_> {
    /// Hands the slab's interactions of some kinds to a sink, those of bonds, triangles and tetrahedra.
    pub(super) fn all<const D: usize, S>(
        self,
        room: &mut Room<D>,
        sink: &mut S,
        is_meant: [bool; 3],
    ) -> Result<(), NonFinite>
    where
        S: Sink<D, 1> + Sink<D, 2> + Sink<D, 3>,
    {
        let Room { cliques, gathered: [bonds, triangles, tetrahedra], .. } = room;
        let [of_bonds, of_triangles, of_tetrahedra] = self.energy.kinds();
        if let (Some(kind), Some(gathered)) = (of_bonds.filter(|_| is_meant[0]), bonds) {
            self.run::<D, 1>(kind, (cliques, gathered), sink)?;
        }
        if let (Some(kind), Some(gathered)) = (of_triangles.filter(|_| is_meant[1]), triangles) {
            self.run::<D, 2>(kind, (cliques, gathered), sink)?;
        }
        if let (Some(kind), Some(gathered)) = (of_tetrahedra.filter(|_| is_meant[2]), tetrahedra) {
            self.run::<D, 3>(kind, (cliques, gathered), sink)?;
        }
        Ok(())
    }
}

/// The Hessian of all interactions at `u`: each product evaluates them again.
pub(super) struct InteractionHessian<'a> {
    pub(super) energy: &'a DiscreteEnergy,
    /// Displacements, `n x d`, in m.
    pub(super) u: Vec<f64>,
}

impl Hessian for InteractionHessian<'_> {
    fn multiply(&self, p: &[f64], product: &mut [f64]) {
        assert!(p.len() == self.u.len() && product.len() == p.len(), "vectors are n x d");
        product.fill(0.0);
        let done = match &self.energy.rooms {
            Rooms::Plane(rooms) => self.multiply_in(rooms, (p, |_, _, _, _| None), product),
            Rooms::Space(rooms) => {
                let tetrahedra: TetrahedraOf<3> = |energy, slab, at, room| {
                    energy.on_lattice.add_tetrahedra(energy, slab, at, Wanted::Product, room)
                };
                self.multiply_in(rooms, (p, tetrahedra), product)
            }
        };
        if done.is_err() {
            product.fill(f64::NAN);
        }
    }
}

/// Adds what tetrahedra of a slab that go along the rows of a lattice have in a product, to its axes; nothing where
/// these do not go so.
type TetrahedraOf<const D: usize> = fn(
    &DiscreteEnergy,
    usize,
    (&[f64], Option<&[f64]>),
    (&mut Axes, &mut AbreastRoom<D>),
) -> Option<Sum>;

impl InteractionHessian<'_> {
    fn multiply_in<const D: usize>(
        &self,
        rooms: &Pool<Room<D>>,
        (p, tetrahedra): (&[f64], TetrahedraOf<D>),
        out: &mut [f64],
    ) -> Result<(), NonFinite> {
        let (energy, u, order) = (self.energy, &self.u[..], Order::Tangent);
        let rows = Part::new(Layout::Points(1), out.as_chunks_mut::<D>().0);
        let done = energy.over_slabs(rooms, rows, |slab, [here, next], room| {
            let mut sink = Product { p, rows: Touched::new(here, next) };
            let is_known = sink.add_known(energy, (slab, u), tetrahedra, room);
            let visit = Visit { energy, slab, order, u, only: None };
            visit.all(room, &mut sink, is_known.map(|is_known| !is_known))?;
            // Owners that have lost interactions do not go with the others. Broken bonds are not among those that go.
            let rest = energy.lost.as_ref().map(|lost| lost.owners());
            if let Some(rest) = rest.filter(|rest| rest.have_any(energy.slabs.owners(slab))) {
                let [_, triangles, tetrahedra] = is_known;
                let visit = Visit { only: Some(rest), ..visit };
                visit.all(room, &mut sink, [false, triangles, tetrahedra])?;
            }
            Ok(SlabEnergy::default())
        });
        done.map(|_| ())
    }
}

impl<const D: usize> Product<'_, D> {
    /// Adds what goes without neighbour lists and kernels; which of bonds, triangles and tetrahedra
    /// went so.
    fn add_known(
        &mut self,
        energy: &DiscreteEnergy,
        (slab, u): (usize, &[f64]),
        tetrahedra: TetrahedraOf<D>,
        room: &mut Room<D>,
    ) -> [bool; 3] {
        let Room { axes, abreast, fours, .. } = room;
        let at = (u, Some(self.p));
        let mut add = |point: usize, part: &[f64; D]| {
            let row = &mut self.rows[point];
            (0..D).for_each(|axis| row[axis] += part[axis]);
        };
        let lattice = &energy.on_lattice;
        let known = lattice.add::<D>(energy, slab, at, Wanted::Product, (axes, abreast));
        let (mut bonds, triangles) =
            known.map_or((false, false), |sums| (sums.bonds.is_some(), sums.triangles.is_some()));
        if known.is_some() {
            axes.each::<D>(&mut add);
        }
        if let Some(of_bonds) = energy.fours.as_ref().filter(|_| !bonds)
            && of_bonds.add::<D>(energy, slab, at, Wanted::Product, fours).is_some()
        {
            fours.each::<D>(&mut add);
            bonds = true;
        }
        let tetrahedra = tetrahedra(energy, slab, at, (axes, abreast)).is_some();
        if tetrahedra {
            axes.each::<D>(&mut add);
        }
        [bonds, triangles, tetrahedra]
    }
}

impl DiscreteEnergy {
    /// See [`crate::energy::Energy::shares`]: those of all its parts, or of one.
    pub(super) fn shares_from(
        &self,
        part: Option<usize>,
        u: &[f64],
        shares: &mut [f64],
    ) -> Result<(), NonFinite> {
        assert_eq!(shares.len(), self.body.n_points(), "one number per point");
        shares.fill(0.0);
        // Parts are those of the measures that are there, in their order.
        let mut numbers = 0..;
        let is_meant = self.kinds().map(|kind| {
            let number = kind.and_then(|_| numbers.next());
            number.is_some() && part.is_none_or(|part| number == Some(part))
        });
        match &self.rooms {
            Rooms::Plane(rooms) => self.add_shares(rooms, is_meant, u, shares),
            Rooms::Space(rooms) => self.add_shares(rooms, is_meant, u, shares),
        }
    }

    fn add_shares<const D: usize>(
        &self,
        rooms: &Pool<Room<D>>,
        is_meant: [bool; 3],
        u: &[f64],
        shares: &mut [f64],
    ) -> Result<(), NonFinite> {
        let shares = Part::new(Layout::Points(1), shares);
        let done = self.over_slabs(rooms, shares, |slab, [here, next], room| {
            let mut sink = Shares { rows: Touched::new(here, next) };
            let visit = Visit { energy: self, slab, order: Order::Energy, u, only: None };
            let done = visit.all(room, &mut sink, is_meant);
            done.map(|()| SlabEnergy::default())
        });
        done.map(|_| ())
    }

    /// See [`crate::energy::Energy::virials`]; adds to what is there.
    pub(super) fn add_virials<const D: usize>(
        &self,
        rooms: &Pool<Room<D>>,
        u: &[f64],
        virials: &mut [f64],
    ) -> Result<(), NonFinite> {
        let virials = virials.as_chunks_mut::<D>().0.as_chunks_mut::<D>().0;
        let positions = self.body.positions().as_chunks::<D>().0;
        let done = self.over_slabs(
            rooms,
            Part::new(Layout::Points(1), virials),
            |slab, [here, next], room| {
                let mut sink = Virials { positions, rows: Touched::new(here, next) };
                let visit = Visit { energy: self, slab, order: Order::Gradient, u, only: None };
                visit.all(room, &mut sink, [true; 3]).map(|()| SlabEnergy::default())
            },
        );
        done.map(|_| ())
    }
}
