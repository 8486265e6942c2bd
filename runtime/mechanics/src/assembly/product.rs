//! The tangent without its matrix: products with a vector, and the diagonal blocks.
//!
//! Each interaction's compact Hessian is used where it is evaluated and not added up. Rows of the
//! Hessian add up to zero over the corners of an interaction, so that only displacements relative
//! to the owner enter, and the owner's part is minus the sum of the others'. Slabs and their order
//! are those of the assembly.

use super::slab::{Refusal, Room, SlabEnergy, minus, named, row};
use super::{DiscreteEnergy, Kind, Rooms};
use crate::element::{CAPACITY, Contributions, InteractionBatch, Order};
use crate::energy::{Hessian, NonFinite};
use crate::geometry::packed;
use crate::interaction::OwnerCliques;
use crate::interaction::schedule::{Layout, Part, Touched};
use crate::pool::Pool;

/// What becomes of the interactions of a slab: `take` gets the points of one, the owner first, and
/// its place in the contributions.
trait Sink<const D: usize>: Send {
    fn take(&mut self, points: &[usize], out: &Contributions, lane: usize);
}

/// Rows of `K p`.
struct Product<'a, const D: usize> {
    p: &'a [f64],
    rows: Touched<'a, [f64; D]>,
}

impl<const D: usize> Sink<D> for Product<'_, D> {
    fn take(&mut self, points: &[usize], out: &Contributions, lane: usize) {
        let n = (points.len() - 1) * D;
        let own = row::<D>(self.p, points[0]);
        let mut relative = [0.0; 9];
        for (corner, &point) in points[1..].iter().enumerate() {
            let difference = minus(&row::<D>(self.p, point), &own);
            relative[corner * D..(corner + 1) * D].copy_from_slice(&difference);
        }
        let mut force = [0.0; 9];
        for r in 0..n {
            force[r] += out.hessian[packed(n, r, r)][lane] * relative[r];
            for c in r + 1..n {
                let entry = out.hessian[packed(n, r, c)][lane];
                force[r] += entry * relative[c];
                force[c] += entry * relative[r];
            }
        }
        for (corner, &point) in points[1..].iter().enumerate() {
            let [own, other] = self.rows.pair(points[0], point);
            for axis in 0..D {
                let part = force[corner * D + axis];
                other[axis] += part;
                own[axis] -= part;
            }
        }
    }
}

/// Diagonal blocks.
struct Diagonal<'a, const D: usize> {
    blocks: Touched<'a, [[f64; D]; D]>,
}

impl<const D: usize> Sink<D> for Diagonal<'_, D> {
    fn take(&mut self, points: &[usize], out: &Contributions, lane: usize) {
        let n = (points.len() - 1) * D;
        let entry = |r: usize, c: usize| out.hessian[packed(n, r.min(c), r.max(c))][lane];
        for (corner, &point) in points[1..].iter().enumerate() {
            let [own, other] = self.blocks.pair(points[0], point);
            for a in 0..D {
                for b in 0..D {
                    let row = corner * D + a;
                    other[a][b] += entry(row, corner * D + b);
                    let all = (0..points.len() - 1).fold(0.0, |sum, k| sum + entry(row, k * D + b));
                    own[a][b] += all;
                }
            }
        }
    }
}

/// Energies of the points.
struct Shares<'a> {
    rows: Touched<'a, f64>,
}

impl<const D: usize> Sink<D> for Shares<'_> {
    fn take(&mut self, points: &[usize], out: &Contributions, lane: usize) {
        let part = out.energy[lane] / points.len() as f64;
        points.iter().for_each(|&point| self.rows.range(point..point + 1)[0] += part);
    }
}

/// The interactions of one owner on their way through an element.
pub(super) struct Batch<const D: usize> {
    lanes: Vec<[u32; 3]>,
    displacement: Vec<[f64; D]>,
    shares: Vec<f64>,
    interactions: InteractionBatch,
    out: Contributions,
}

impl<const D: usize> Batch<D> {
    /// Room for owners of so many members.
    pub(super) fn new(kind: &Kind, members: usize) -> Batch<D> {
        let measure = kind.element.measure();
        Batch {
            lanes: Vec::with_capacity(CAPACITY),
            displacement: Vec::with_capacity(members),
            shares: Vec::with_capacity(members),
            interactions: InteractionBatch::new(measure, D),
            out: Contributions::new(measure, D),
        }
    }
}

/// A slab whose interactions go to a sink.
struct Visit<'a, const D: usize, S> {
    energy: &'a DiscreteEnergy,
    slab: usize,
    u: &'a [f64],
    sink: S,
}

impl<const D: usize, S: Sink<D>> Visit<'_, D, S> {
    /// All kinds. Energies are those of the forces, and not summed once more.
    fn all(mut self, room: &mut Room<D>) -> Result<SlabEnergy, NonFinite> {
        let energy = self.energy;
        let Room { cliques, products: [bonds, triangles, tetrahedra], .. } = room;
        energy.with_cliques(self.slab, cliques, |cliques| {
            if let (Some(kind), Some(batch)) = (&energy.bonds, bonds) {
                self.kind::<1>(kind, cliques, batch)?;
            }
            if let (Some(kind), Some(batch)) = (&energy.triangles, triangles) {
                self.kind::<2>(kind, cliques, batch)?;
            }
            if let (Some(kind), Some(batch)) = (&energy.tetrahedra, tetrahedra) {
                self.kind::<3>(kind, cliques, batch)?;
            }
            Ok(SlabEnergy::default())
        })
    }

    /// One kind, of `K` corners besides the owner.
    fn kind<const K: usize>(
        &mut self,
        kind: &Kind,
        cliques: &mut OwnerCliques<'_, D>,
        batch: &mut Batch<D>,
    ) -> Result<(), NonFinite> {
        batch.lanes.clear();
        for owner in self.energy.slabs.owners(self.slab) {
            cliques.set(owner);
            let (own, members) = (row::<D>(self.u, owner), cliques.members());
            let relative = |&member: &u32| minus(&row(self.u, member as usize), &own);
            batch.displacement.clear();
            batch.displacement.extend(members.iter().map(relative));
            batch.shares.clear();
            batch.shares.extend(members.iter().map(|&m| kind.weights.share(m as usize)));
            let mut push = |lane: [u32; 3]| {
                batch.lanes.push(lane);
                if batch.lanes.len() == CAPACITY {
                    self.flush::<K>(kind, cliques, batch)?;
                }
                Ok(())
            };
            match K {
                1 => (0..members.len()).try_for_each(|j| push([j as u32, 0, 0]))?,
                2 => {
                    cliques.triangles(|j, k, _| push([j as u32, k as u32, 0]))?;
                }
                _ => {
                    cliques.tetrahedra(|j, k, l| push([j as u32, k as u32, l as u32]))?;
                }
            }
            self.flush::<K>(kind, cliques, batch)?;
        }
        Ok(())
    }

    /// Evaluates what has been gathered and hands it on.
    fn flush<const K: usize>(
        &mut self,
        kind: &Kind,
        cliques: &OwnerCliques<'_, D>,
        batch: &mut Batch<D>,
    ) -> Result<(), NonFinite> {
        let Batch { lanes, displacement, shares, interactions, out } = batch;
        if lanes.is_empty() {
            return Ok(());
        }
        let corners = |lane: usize| -> [usize; K] {
            std::array::from_fn(|corner| lanes[lane][corner] as usize)
        };
        interactions.gather(lanes.len(), cliques.reference(), displacement, corners);
        let own = kind.weights.share(cliques.owner());
        for lane in 0..lanes.len() {
            let others = corners(lane).map(|member| shares[member]);
            interactions.weight[lane] = kind.weights.join(own, others);
        }
        let element = &*kind.element;
        element.evaluate(interactions, Order::Tangent, out).map_err(|lane| {
            let points = named(cliques, &lanes[lane.lane][..K]);
            Refusal { element, lane }.of::<D>(points, self.u)
        })?;
        let mut points = [cliques.owner(); 4];
        for lane in 0..lanes.len() {
            for (point, member) in points[1..].iter_mut().zip(corners(lane)) {
                *point = cliques.members()[member] as usize;
            }
            self.sink.take(&points[..=K], out, lane);
        }
        lanes.clear();
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
            Rooms::Plane(rooms) => self.multiply_in(rooms, p, product),
            Rooms::Space(rooms) => self.multiply_in(rooms, p, product),
        };
        if done.is_err() {
            product.fill(f64::NAN);
        }
    }
}

impl InteractionHessian<'_> {
    fn multiply_in<const D: usize>(
        &self,
        rooms: &Pool<Room<D>>,
        p: &[f64],
        out: &mut [f64],
    ) -> Result<[f64; 3], NonFinite> {
        let (energy, u) = (self.energy, &self.u[..]);
        let rows = Part::new(Layout::Points(1), out.as_chunks_mut::<D>().0);
        energy.over_slabs(rooms, rows, |slab, [here, next], room| {
            let sink = Product { p, rows: Touched::new(here, next) };
            Visit { energy, slab, u, sink }.all(room)
        })
    }
}

impl DiscreteEnergy {
    /// Adds the diagonal blocks of the Hessian at `u`.
    pub(super) fn diagonal(&self, u: &[f64], blocks: &mut [f64]) -> Result<(), NonFinite> {
        match &self.rooms {
            Rooms::Plane(rooms) => self.diagonal_in(rooms, u, blocks),
            Rooms::Space(rooms) => self.diagonal_in(rooms, u, blocks),
        }
    }

    fn diagonal_in<const D: usize>(
        &self,
        rooms: &Pool<Room<D>>,
        u: &[f64],
        blocks: &mut [f64],
    ) -> Result<(), NonFinite> {
        let blocks = blocks.as_chunks_mut::<D>().0.as_chunks_mut::<D>().0;
        let blocks = Part::new(Layout::Points(1), blocks);
        let done = self.over_slabs(rooms, blocks, |slab, [here, next], room| {
            let sink = Diagonal { blocks: Touched::new(here, next) };
            Visit { energy: self, slab, u, sink }.all(room)
        });
        done.map(|_| ())
    }

    /// See [`crate::energy::Energy::shares`]; adds to what is there.
    pub(super) fn add_shares<const D: usize>(
        &self,
        rooms: &Pool<Room<D>>,
        u: &[f64],
        shares: &mut [f64],
    ) -> Result<(), NonFinite> {
        let shares = Part::new(Layout::Points(1), shares);
        let done = self.over_slabs(rooms, shares, |slab, [here, next], room| {
            let sink = Shares { rows: Touched::new(here, next) };
            Visit { energy: self, slab, u, sink }.all(room)
        });
        done.map(|_| ())
    }
}
