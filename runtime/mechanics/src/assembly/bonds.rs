//! The bonds of one slab.
//!
//! An owner's later neighbours stand side by side in a batch, and their coupling blocks are one piece
//! of its row. Diagonal blocks of other points lie a row apart, each in a page of memory of its own:
//! what they get waits in an array of the slab's points until their row is written.

use pulp::{Arch, Simd, WithSimd};

use super::DiscreteEnergy;
use super::kind::Kind;
use super::rows::Rows;
use super::sum::Sum;
use super::visit::{Refusal, Visit, minus};
use crate::element::{CAPACITY, Channel, Contributions, Element, InteractionBatch, Order};
use crate::energy::NonFinite;
use crate::geometry::{each, packed, packed_len};
use crate::kernel::Measure;
use crate::weights::CliqueWeights;

/// What the rows hold before the bonds are added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Untouched {
    /// Nothing that counts in the blocks beside the diagonal.
    pub(super) couplings: bool,
    /// Nothing that counts in the diagonal blocks.
    pub(super) diagonal: bool,
}

/// Work arrays for the bonds of a slab.
pub(super) struct BondRoom {
    batch: InteractionBatch,
    out: Contributions,
    /// What points got from their lower neighbours, point by point.
    waiting: Vec<f64>,
    /// The others of an owner, material by material where there are several.
    others: Vec<u32>,
}

impl BondRoom {
    /// Large enough for every slab.
    pub(super) fn new(energy: &DiscreteEnergy, kind: &Kind) -> BondRoom {
        let (measure, d) = (kind.measure(), energy.body.dimension());
        let points = (0..energy.slabs.len()).map(|slab| energy.slabs.touched(slab).len()).max();
        BondRoom {
            batch: InteractionBatch::new(measure, d),
            out: Contributions::new(measure, d),
            waiting: Vec::with_capacity(points.unwrap_or(0) * (d + packed_len(d))),
            others: Vec::with_capacity(energy.neighborhood.most_later()),
        }
    }
}

/// The bonds of one slab on their way into its rows. A bond gives `N` numbers: the gradient at its
/// other point and the upper triangle of the Hessian there.
pub(super) struct BondSums<'a, const D: usize, const N: usize> {
    visit: Visit<'a>,
    kind: &'a Kind,
    untouched: Untouched,
    /// Whether energies and forces are known.
    only_blocks: bool,
    arch: Arch,
    batch: &'a mut InteractionBatch,
    out: &'a mut Contributions,
    sum: Sum,
    /// The first point that the slab touches.
    first: usize,
    /// What the points from `first` on got from their lower neighbours.
    waiting: &'a mut [[f64; N]],
    others: &'a mut Vec<u32>,
}

impl<'a, const D: usize, const N: usize> BondSums<'a, D, N> {
    /// Of one slab; of a tangent the blocks alone, where energies and forces are known.
    pub(super) fn new(
        visit: Visit<'a>,
        (untouched, only_blocks): (Untouched, bool),
        kind: &'a Kind,
        room: &'a mut BondRoom,
    ) -> BondSums<'a, D, N> {
        let touched = visit.energy.slabs.touched(visit.slab);
        let n = if visit.order >= Order::Force { N * touched.len() } else { 0 };
        room.waiting.clear();
        room.waiting.resize(n, 0.0);
        BondSums {
            visit,
            kind,
            untouched,
            only_blocks,
            arch: Arch::new(),
            batch: &mut room.batch,
            out: &mut room.out,
            sum: Sum::default(),
            first: touched.start,
            waiting: room.waiting.as_chunks_mut::<N>().0,
            others: &mut room.others,
        }
    }

    /// Adds the bonds; their energy.
    pub(super) fn add(mut self, rows: &mut Rows<'_>) -> Result<Sum, NonFinite> {
        let Visit { energy, slab, .. } = self.visit;
        let touched = energy.slabs.touched(slab);
        let owners = energy.slabs.owners(slab);
        for owner in owners.clone() {
            let mut own = [0.0; N];
            let mut others = std::mem::take(self.others);
            others.clear();
            others.extend(energy.neighborhood.upper(owner));
            self.add_of(owner, &mut others, &mut own, rows)?;
            *self.others = others;
            self.write(owner, &own, rows);
        }
        for other in owners.end..touched.end {
            self.write(other, &[0.0; N], rows);
        }
        Ok(self.sum)
    }

    /// Adds an owner's bonds to its later neighbours, law by law.
    fn add_of(
        &mut self,
        owner: usize,
        others: &mut [u32],
        own: &mut [f64; N],
        rows: &mut Rows<'_>,
    ) -> Result<(), NonFinite> {
        let Some(materials) = self.kind.materials.as_deref() else {
            return self.add_all((owner, others, 0), (0, 1.0), own, rows);
        };
        let (of, here) = (|point: &u32| materials.of(*point as usize), materials.of(owner));
        if materials.n_laws() == 1 || others.iter().all(|other| of(other) == here) {
            return self.add_all((owner, others, 0), (usize::from(here), 1.0), own, rows);
        }
        // Couplings, factors and states have places in the order of the others; sums have none.
        let has_places = self.visit.order == Order::Tangent && rows.has_couplings();
        if !has_places && self.kind.factors.is_none() && !self.kind.has_states() {
            others.sort_by_key(of);
        }
        let mut place = 0;
        for same in others.chunk_by(|i, j| of(i) == of(j)) {
            for part in materials.parts(&[here, of(&same[0])]).iter() {
                self.add_all((owner, same, place), part, own, rows)?;
            }
            place += same.len();
        }
        Ok(())
    }

    /// Adds an owner's bonds to some of its later neighbours, from a place among them on, by one law
    /// that has this part in them.
    #[inline(always)]
    fn add_all(
        &mut self,
        (owner, others, mut place): (usize, &[u32], usize),
        (law, part): (usize, f64),
        own: &mut [f64; N],
        rows: &mut Rows<'_>,
    ) -> Result<(), NonFinite> {
        let Some(element) = self.kind.element(law) else { return Ok(()) };
        for others in others.chunks(CAPACITY) {
            self.fill(owner, others, place, part);
            if let Some(fields) = self.kind.fields_of(law) {
                let first = self.visit.energy.neighborhood.bonds(owner).start + place;
                let bond = |(lane, other): (usize, &u32)| {
                    ([owner, *other as usize].into_iter(), first + lane)
                };
                let bonds = others.iter().enumerate().map(bond);
                self.batch.take_fields(fields, Measure::Length, bonds);
            }
            self.evaluate(element, owner, others)?;
            self.scatter(owner, others, place, own, rows);
            place += others.len();
        }
        Ok(())
    }

    fn fill(&mut self, owner: usize, others: &[u32], place: usize, part: f64) {
        let Visit { energy, u, .. } = self.visit;
        let weights = &self.kind.weights;
        let ends = Ends::<D> {
            positions: energy.body.positions().as_chunks().0,
            displacements: u.as_chunks().0,
            weights,
            owner,
            begun: weights.begin(weights.share(owner), &[]),
            part,
        };
        let Some(factors) = &self.kind.factors else {
            self.batch.fill(others.len(), |lane| ends.bond(others[lane]));
            return;
        };
        let first = energy.neighborhood.bonds(owner).start + place;
        let factors = &factors[first..first + others.len()];
        self.batch.fill(others.len(), |lane| match (ends.bond(others[lane]), factors[lane]) {
            ((xi, _, _), 0.0) => (xi, [0.0; D], 0.0),
            ((xi, eta, weight), factor) => (xi, eta, weight * factor),
        });
    }

    fn evaluate(
        &mut self,
        element: &dyn Element,
        owner: usize,
        others: &[u32],
    ) -> Result<(), NonFinite> {
        element.evaluate(self.batch, self.visit.order, self.out).map_err(|lane| {
            let points = vec![owner, others[lane.lane] as usize];
            Refusal { element, lane }.of::<D>(points, self.visit.u)
        })?;
        if self.visit.order.has_energy() {
            self.sum.add(self.out.energies(others.len()));
        }
        Ok(())
    }

    /// Adds a batch to the owner's sums, to what waits, and to the coupling blocks.
    fn scatter(
        &mut self,
        owner: usize,
        others: &[u32],
        place: usize,
        own: &mut [f64; N],
        rows: &mut Rows<'_>,
    ) {
        if self.visit.order == Order::Energy {
            return;
        }
        let couplings = match self.visit.order {
            Order::Tangent if rows.has_couplings() => {
                rows.blocks::<D>(owner, 1 + place, others.len())
            }
            _ => &mut [],
        };
        let scattering = Scattering::<D, N> {
            others,
            first: self.first,
            gradient: &self.out.gradient,
            hessian: &self.out.hessian,
            own,
            waiting: self.waiting,
            order: self.visit.order,
            couplings,
            untouched: self.untouched.couplings,
        };
        self.arch.dispatch(scattering);
    }

    /// Writes the gradient and the diagonal block of a point: what waits for it and its own part.
    fn write(&self, point: usize, own: &[f64; N], rows: &mut Rows<'_>) {
        if self.visit.order == Order::Energy {
            return;
        }
        let waiting = &self.waiting[point - self.first];
        if !self.only_blocks {
            rows.add_gradient::<D>(point, &each(|axis| waiting[axis] - own[axis]));
        }
        if self.visit.order < Order::Tangent {
            return;
        }
        let block = rows.blocks::<D>(point, 0, 1);
        for r in 0..D {
            for c in 0..D {
                let k = D + packed(D, r.min(c), r.max(c));
                let part = waiting[k] + own[k];
                let entry = &mut block[r * D + c];
                *entry = if self.untouched.diagonal { part } else { *entry + part };
            }
        }
    }
}

/// The ends of an owner's bonds.
struct Ends<'a, const D: usize> {
    positions: &'a [[f64; D]],
    displacements: &'a [[f64; D]],
    weights: &'a CliqueWeights,
    owner: usize,
    /// The owner's share in the weights.
    begun: f64,
    /// Of a law in these bonds.
    part: f64,
}

impl<const D: usize> Ends<'_, D> {
    /// The vector at rest and the relative displacement of the bond to another point, in m, and its weight.
    #[inline(always)]
    fn bond(&self, other: u32) -> ([f64; D], [f64; D], f64) {
        let other = other as usize;
        let weight = self.part * self.weights.join_last(self.begun, self.weights.share(other));
        let along = |of: &[[f64; D]]| minus(&of[other], &of[self.owner]);
        (along(self.positions), along(self.displacements), weight)
    }
}

/// Adds the bonds of a batch to the sums of both ends and to their couplings.
struct Scattering<'a, const D: usize, const N: usize> {
    others: &'a [u32],
    first: usize,
    gradient: &'a [Channel],
    hessian: &'a [Channel],
    own: &'a mut [f64; N],
    waiting: &'a mut [[f64; N]],
    order: Order,
    /// One block for each, or nothing where they are not wanted.
    couplings: &'a mut [f64],
    untouched: bool,
}

impl<const D: usize, const N: usize> WithSimd for Scattering<'_, D, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Scattering { others, first, waiting, couplings, untouched, order, .. } = self;
        let (gradient, hessian) = (&self.gradient[..D], &self.hessian[..N - D]);
        let others = &others[..others.len().min(CAPACITY)];
        let mut own = *self.own;
        if order < Order::Tangent {
            for (lane, &other) in others.iter().enumerate() {
                let sums = &mut waiting[other as usize - first];
                for axis in 0..D {
                    own[axis] += gradient[axis][lane];
                    sums[axis] += gradient[axis][lane];
                }
            }
            *self.own = own;
            return;
        }
        let parts = |lane: usize| -> [f64; N] {
            each(|k| if k < D { gradient[k][lane] } else { hessian[k - D][lane] })
        };
        if couplings.is_empty() {
            for (lane, &other) in others.iter().enumerate() {
                let (parts, sums) = (parts(lane), &mut waiting[other as usize - first]);
                for k in 0..N {
                    own[k] += parts[k];
                    sums[k] += parts[k];
                }
            }
            *self.own = own;
            return;
        }
        let blocks = couplings.chunks_exact_mut(D * D);
        for (lane, (&other, block)) in others.iter().zip(blocks).enumerate() {
            let parts = parts(lane);
            let sums = &mut waiting[other as usize - first];
            for k in 0..N {
                own[k] += parts[k];
                sums[k] += parts[k];
            }
            let mut coupling = [[0.0; D]; D];
            for r in 0..D {
                for c in 0..D {
                    let before = if untouched { 0.0 } else { block[r * D + c] };
                    coupling[r][c] = before - parts[D + packed(D, r.min(c), r.max(c))];
                }
            }
            block.copy_from_slice(coupling.as_flattened());
        }
        *self.own = own;
    }
}
