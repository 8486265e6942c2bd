//! The tangent without its matrix: products with a vector, and the diagonal blocks.
//!
//! Each interaction's compact Hessian is used where it is evaluated and not added up. Rows of the
//! Hessian add up to zero over the corners of an interaction, so that only displacements relative
//! to the owner enter, and the owner's part is minus the sum of the others'. Slabs and their order
//! are those of the assembly.

use rayon::prelude::*;

use super::slab::{Refusal, minus, named, row};
use super::{DiscreteEnergy, Kind};
use crate::element::{CAPACITY, Contributions, InteractionBatch, Order};
use crate::energy::{Hessian, NonFinite};
use crate::geometry::packed;
use crate::interaction::OwnerCliques;

/// What becomes of the interactions of a slab: `take` gets the points of one, the owner first, and
/// its place in the contributions.
trait Sink<const D: usize>: Send {
    fn take(&mut self, points: &[usize], out: &Contributions, lane: usize);
}

/// Rows of `K p` from `first` on.
struct Product<'a, const D: usize> {
    p: &'a [f64],
    first: usize,
    rows: &'a mut [f64],
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
        let owner = (points[0] - self.first) * D;
        for (corner, &point) in points[1..].iter().enumerate() {
            for axis in 0..D {
                let part = force[corner * D + axis];
                self.rows[(point - self.first) * D + axis] += part;
                self.rows[owner + axis] -= part;
            }
        }
    }
}

/// Rows of the gradient and diagonal blocks from `first` on.
struct Diagonal<'a, const D: usize> {
    first: usize,
    gradient: &'a mut [f64],
    blocks: &'a mut [f64],
}

impl<const D: usize> Sink<D> for Diagonal<'_, D> {
    fn take(&mut self, points: &[usize], out: &Contributions, lane: usize) {
        let n = (points.len() - 1) * D;
        let entry = |r: usize, c: usize| out.hessian[packed(n, r.min(c), r.max(c))][lane];
        let owner = points[0] - self.first;
        for (corner, &point) in points[1..].iter().enumerate() {
            let place = point - self.first;
            for a in 0..D {
                let part = out.gradient[corner * D + a][lane];
                self.gradient[place * D + a] += part;
                self.gradient[owner * D + a] -= part;
                for b in 0..D {
                    let row = corner * D + a;
                    self.blocks[(place * D + a) * D + b] += entry(row, corner * D + b);
                    let all = (0..points.len() - 1).fold(0.0, |sum, k| sum + entry(row, k * D + b));
                    self.blocks[(owner * D + a) * D + b] += all;
                }
            }
        }
    }
}

/// Energies of the points from `first` on.
struct Shares<'a> {
    first: usize,
    shares: &'a mut [f64],
}

impl<const D: usize> Sink<D> for Shares<'_> {
    fn take(&mut self, points: &[usize], out: &Contributions, lane: usize) {
        let part = out.energy[lane] / points.len() as f64;
        points.iter().for_each(|point| self.shares[point - self.first] += part);
    }
}

/// The interactions of one owner on their way through an element.
struct Batch<const D: usize> {
    lanes: Vec<[u32; 3]>,
    displacement: Vec<[f64; D]>,
    shares: Vec<f64>,
    interactions: InteractionBatch,
    out: Contributions,
}

/// A slab whose interactions go to a sink.
struct Visit<'a, const D: usize, S> {
    energy: &'a DiscreteEnergy,
    slab: usize,
    u: &'a [f64],
    sink: S,
}

impl<const D: usize, S: Sink<D>> Visit<'_, D, S> {
    /// All kinds; the energies of each.
    fn all(mut self) -> Result<[f64; 3], NonFinite> {
        let energy = self.energy;
        let mut parts = [0.0; 3];
        if let Some(kind) = &energy.bonds {
            parts[0] = self.kind::<1>(kind)?;
        }
        if let Some(kind) = &energy.triangles {
            parts[1] = self.kind::<2>(kind)?;
        }
        if let Some(kind) = &energy.tetrahedra {
            parts[2] = self.kind::<3>(kind)?;
        }
        Ok(parts)
    }

    /// One kind, of `K` corners besides the owner; its energy.
    fn kind<const K: usize>(&mut self, kind: &Kind) -> Result<f64, NonFinite> {
        let (energy, measure) = (self.energy, kind.element.measure());
        let touched = energy.slabs.touched(self.slab);
        let mut cliques =
            OwnerCliques::<D>::new(&energy.body, &energy.neighborhood, energy.degeneracy, touched)
                .with_contributing(energy.contributing.as_ref());
        let mut batch = Batch {
            lanes: Vec::with_capacity(CAPACITY),
            displacement: Vec::new(),
            shares: Vec::new(),
            interactions: InteractionBatch::new(measure, D),
            out: Contributions::new(measure, D),
        };
        let mut total = 0.0;
        for owner in energy.slabs.owners(self.slab) {
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
                    total += self.flush::<K>(kind, &cliques, &mut batch)?;
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
            total += self.flush::<K>(kind, &cliques, &mut batch)?;
        }
        Ok(total)
    }

    /// Evaluates what has been gathered and hands it on; its energy.
    fn flush<const K: usize>(
        &mut self,
        kind: &Kind,
        cliques: &OwnerCliques<'_, D>,
        batch: &mut Batch<D>,
    ) -> Result<f64, NonFinite> {
        let Batch { lanes, displacement, shares, interactions, out } = batch;
        if lanes.is_empty() {
            return Ok(0.0);
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
        let energy = out.energy[..lanes.len()].iter().fold(0.0, |sum, x| sum + x);
        lanes.clear();
        Ok(energy)
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
        let done = match self.energy.body.dimension() {
            2 => self.multiply_in::<2>(p, product),
            _ => self.multiply_in::<3>(p, product),
        };
        if done.is_err() {
            product.fill(f64::NAN);
        }
    }
}

impl InteractionHessian<'_> {
    fn multiply_in<const D: usize>(&self, p: &[f64], out: &mut [f64]) -> Result<(), NonFinite> {
        let energy = self.energy;
        out.fill(0.0);
        let mut energies = vec![[0.0; 3]; energy.slabs.len()];
        for color in 0..2 {
            let rows = energy.cut(color, D, out).into_iter();
            let sinks = rows.map(|(slab, first, rows)| (slab, Product::<D> { p, first, rows }));
            energy.visit(&self.u, sinks.collect(), &mut energies)?;
        }
        Ok(())
    }
}

impl DiscreteEnergy {
    /// See [`crate::energy::Wanted::Diagonal`].
    pub(super) fn diagonal(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        blocks: &mut [f64],
    ) -> Result<[f64; 3], NonFinite> {
        match self.body.dimension() {
            2 => self.diagonal_in::<2>(u, gradient, blocks),
            _ => self.diagonal_in::<3>(u, gradient, blocks),
        }
    }

    fn diagonal_in<const D: usize>(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        blocks: &mut [f64],
    ) -> Result<[f64; 3], NonFinite> {
        gradient.fill(0.0);
        blocks.fill(0.0);
        let mut energies = vec![[0.0; 3]; self.slabs.len()];
        for color in 0..2 {
            let rows = self.cut(color, D, gradient).into_iter();
            let blocks = self.cut(color, D * D, blocks).into_iter();
            let sinks = rows.zip(blocks).map(|((slab, first, gradient), (_, _, blocks))| {
                (slab, Diagonal::<D> { first, gradient, blocks })
            });
            self.visit(u, sinks.collect(), &mut energies)?;
        }
        let sum = |sum: [f64; 3], part: &[f64; 3]| std::array::from_fn(|k| sum[k] + part[k]);
        Ok(energies.iter().fold([0.0; 3], sum))
    }

    /// See [`crate::energy::Energy::shares`].
    pub(super) fn shares_in<const D: usize>(
        &self,
        u: &[f64],
        shares: &mut [f64],
    ) -> Result<(), NonFinite> {
        shares.fill(0.0);
        let mut energies = vec![[0.0; 3]; self.slabs.len()];
        for color in 0..2 {
            let rows = self.cut(color, 1, shares).into_iter();
            let sinks = rows.map(|(slab, first, shares)| (slab, Shares { first, shares }));
            self.visit::<D, _>(u, sinks.collect(), &mut energies)?;
        }
        Ok(())
    }

    /// Sends the interactions of some slabs to their sinks and keeps the energies by slab; the
    /// error of the lowest slab counts.
    fn visit<const D: usize, S: Sink<D>>(
        &self,
        u: &[f64],
        sinks: Vec<(usize, S)>,
        energies: &mut [[f64; 3]],
    ) -> Result<(), NonFinite> {
        let run = |(slab, sink)| (slab, Visit { energy: self, slab, u, sink }.all());
        let done: Vec<_> = sinks.into_par_iter().with_max_len(1).map(run).collect();
        for (slab, part) in done {
            energies[slab] = part?;
        }
        Ok(())
    }

    /// The slabs of a colour, each with the first point that it touches and the rows of all these,
    /// `width` numbers a point.
    fn cut<'a>(
        &self,
        color: usize,
        width: usize,
        rows: &'a mut [f64],
    ) -> Vec<(usize, usize, &'a mut [f64])> {
        let (mut rest, mut at) = (rows, 0);
        let slabs = (color..self.slabs.len()).step_by(2);
        slabs
            .map(|slab| {
                let touched = self.slabs.touched(slab);
                let (_, tail) =
                    std::mem::take(&mut rest).split_at_mut((touched.start - at) * width);
                let (mine, tail) = tail.split_at_mut(touched.len() * width);
                (rest, at) = (tail, touched.end);
                (slab, touched.start, mine)
            })
            .collect()
    }
}
