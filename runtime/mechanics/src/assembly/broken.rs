//! Bonds that break: what a sum over interactions loses with them.
//!
//! A broken bond keeps its place in all lists and has the factor 0. Where laws are affine that is all:
//! they are finite at any stretch. Kernels see a broken bond at rest, for its energy far from there may be
//! infinite.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use super::DiscreteEnergy;
use super::kind::Kind;
use super::on_lattice::OnLattice;
use super::quadratic::AffineLaw;
use super::visit::{Refusal, minus};
use crate::element::{CAPACITY, Contributions, InteractionBatch, Order};
use crate::energy::{Limits, NonFinite};
use crate::fracture::Held;
use crate::geometry::dot;
use crate::kernel::{Law, Measure};

/// Bonds that one task looks at.
const CHUNK: usize = 1024;

/// How much the square of a length must have grown, in m^2, until a margin is 0 that is negative at rest
/// and grows with the length; nothing of margins that are not affine in the length or in its square.
/// `direction` is that of the bond at rest where these are the fields of the margin; nothing of others.
pub(crate) fn affine_threshold(
    margin: &dyn Law,
    length: f64,
    direction: Option<&[f64]>,
) -> Option<f64> {
    let is_known = margin.fields().is_empty() || direction.is_some();
    let law = AffineLaw::of(margin, direction.is_some()).filter(|_| is_known)?;
    let at_rest = law.at(length, direction.unwrap_or_default(), 1.0)?;
    if at_rest.bent != 0.0 || at_rest.linear <= 0.0 {
        return None;
    }
    let grown = -at_rest.rest / at_rest.linear;
    Some(if law.by_square { grown } else { grown * (2.0 * length + grown) })
}

/// How much areas or volumes of one size at rest may shrink (a number below 0) and grow until a margin is 0 that is
/// negative at rest; nothing of margins that are not affine in the measure or in its square.
pub(crate) fn affine_limits(margin: &dyn Law, size: f64) -> Option<[f64; 2]> {
    let law = AffineLaw::of(margin, false).filter(|_| margin.fields().is_empty())?;
    let at_rest = law.at(size, &[], 1.0)?;
    if at_rest.bent != 0.0 || at_rest.rest >= 0.0 {
        return None;
    }
    let (low, high) = (f64::NEG_INFINITY, f64::INFINITY);
    if at_rest.linear == 0.0 {
        return Some([low, high]);
    }
    let zero = -at_rest.rest / at_rest.linear;
    let square = size * size + zero;
    let by_root = zero / (square.sqrt() + size);
    Some(match (law.by_square, at_rest.linear > 0.0) {
        (false, true) => [low, zero],
        (false, false) => [zero, high],
        // Measures have a sign: those turned inside out have squares, too.
        (true, true) => [-(2.0 * size + by_root), by_root],
        (true, false) if square > 0.0 => [by_root, high],
        (true, false) => [low, high],
    })
}

impl DiscreteEnergy {
    /// See [`crate::energy::Energy::lose`].
    pub(super) fn lose_bonds(&mut self, bonds: &[usize]) {
        self.lose_edges(bonds);
        let DiscreteEnergy { neighborhood, bonds: kind, on_lattice, fours, lost_factors, .. } =
            self;
        let Some(kind) = kind else { return };
        let n_bonds = neighborhood.n_bonds();
        let factors = kind.factors.get_or_insert_with(|| vec![1.0; n_bonds]);
        for &bond in bonds {
            if factors[bond] != 1.0 {
                lost_factors.entry(bond).or_insert(factors[bond]);
            }
            factors[bond] = 0.0;
        }
        if let Some(runs) = &mut on_lattice.bonds {
            runs.lose(neighborhood, bonds);
        }
        if let Some(fours) = fours {
            fours.lose(neighborhood, bonds);
        }
    }

    /// See [`crate::energy::Energy::regain`].
    pub(super) fn regain_bonds(&mut self, bonds: &[usize]) {
        self.regain_edges(bonds);
        let DiscreteEnergy { neighborhood, bonds: kind, on_lattice, fours, lost_factors, .. } =
            self;
        let Some(factors) = kind.as_mut().and_then(|kind| kind.factors.as_mut()) else { return };
        for &bond in bonds {
            let factor = lost_factors.remove(&bond).unwrap_or(1.0);
            factors[bond] = factor;
            if let Some(runs) = &mut on_lattice.bonds {
                runs.regain(bond, factor);
            }
        }
        if let Some(fours) = fours {
            fours.regain(neighborhood, bonds);
        }
    }

    /// See [`crate::energy::Energy::watch`].
    pub(super) fn watch_bonds(&mut self, limits: &[f32]) -> bool {
        let DiscreteEnergy { neighborhood, on_lattice, fours, body, slabs, exceeded, .. } = self;
        match (&mut on_lattice.bonds, fours) {
            (Some(runs), _) if body.dimension() == 2 => runs.watch::<2>(neighborhood, limits),
            (Some(runs), _) => runs.watch::<3>(neighborhood, limits),
            (None, Some(fours)) => fours.watch(neighborhood, limits),
            (None, None) => return false,
        }
        exceeded[Measure::Length as usize].resize_with(slabs.len(), || AtomicBool::new(true));
        true
    }

    /// See [`crate::energy::Energy::exceeding`].
    pub(super) fn exceeding_owners(&self, measure: Measure) -> Option<Vec<Range<usize>>> {
        let exceeded = &self.exceeded[measure as usize];
        if exceeded.is_empty() {
            return None;
        }
        // Triangles and tetrahedra of owners that have lost some go one by one: nobody watches these.
        let lost = self.lost.as_ref().filter(|_| measure != Measure::Length);
        let of_slab = |slab: usize| {
            let owners = self.slabs.owners(slab);
            if exceeded[slab].load(Ordering::Relaxed) {
                return vec![owners];
            }
            let has_lost = |owner: &usize| lost.is_some_and(|lost| lost.owners().has(*owner));
            let mut found: Vec<Range<usize>> = Vec::new();
            for owner in owners.filter(has_lost) {
                match found.last_mut().filter(|last| last.end == owner) {
                    Some(last) => last.end += 1,
                    None => found.push(owner..owner + 1),
                }
            }
            found
        };
        Some((0..self.slabs.len()).flat_map(of_slab).collect())
    }

    /// See [`crate::energy::Energy::watch_cliques`].
    pub(super) fn watch_own(&mut self, measure: Measure, limits: &Limits<'_>) -> bool {
        let OnLattice { triangles, tetrahedra, .. } = &mut self.on_lattice;
        let is_watched = match (measure, triangles, tetrahedra) {
            (Measure::Area, Some(all), _) => all.watch(self.body.dimension(), limits),
            (Measure::Volume, _, Some(all)) => all.watch(limits),
            _ => false,
        };
        let n_slabs = if is_watched { self.slabs.len() } else { 0 };
        self.exceeded[measure as usize].resize_with(n_slabs, || AtomicBool::new(true));
        is_watched
    }

    /// See [`crate::energy::Energy::add_held`].
    pub(super) fn add_held_of(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        bonds: &[usize],
        held: &mut [Held],
    ) -> Result<(), NonFinite> {
        match self.body.dimension() {
            2 => self.add_held_by::<2>(u, way, bonds, held),
            _ => self.add_held_by::<3>(u, way, bonds, held),
        }
    }

    fn add_held_by<const D: usize>(
        &self,
        u: &[f64],
        way: (f64, &[f64]),
        bonds: &[usize],
        held: &mut [Held],
    ) -> Result<(), NonFinite> {
        let Some(kind) = &self.bonds else { return Ok(()) };
        let chunks = bonds.par_chunks(CHUNK).zip(held.par_chunks_mut(CHUNK));
        let add = |(bonds, held): (&[usize], &mut [Held])| {
            let ends: Vec<[usize; 2]> = bonds.iter().map(|b| self.neighborhood.ends(*b)).collect();
            let mut room =
                (InteractionBatch::new(Measure::Length, D), Contributions::new(Measure::Length, D));
            (0..kind.n_laws()).try_for_each(|law| {
                let part_of = |lane: usize| {
                    let own = kind.parts_of(&ends[lane]).iter().find(|part| part.0 == law);
                    own.map(|(_, part)| (lane, part))
                };
                let lanes: Vec<(usize, f64)> = (0..bonds.len()).filter_map(part_of).collect();
                let law = OfLaw { kind, law, bonds, ends: &ends };
                let mut batches = lanes.chunks(CAPACITY);
                batches.try_for_each(|lanes| {
                    self.add_held::<D>(&law, lanes, (u, way), &mut room, held)
                })
            })
        };
        chunks.map(add).collect()
    }

    /// The same of some bonds that take one law, with the part that it has in each.
    fn add_held<const D: usize>(
        &self,
        &OfLaw { kind, law, bonds, ends }: &OfLaw<'_>,
        lanes: &[(usize, f64)],
        (u, (step, direction)): (&[f64], (f64, &[f64])),
        (batch, out): &mut (InteractionBatch, Contributions),
        held: &mut [Held],
    ) -> Result<(), NonFinite> {
        let Some(element) = kind.element(law) else { return Ok(()) };
        let positions = self.body.positions().as_chunks::<D>().0;
        let (u_of, v_of) = (u.as_chunks::<D>().0, direction.as_chunks::<D>().0);
        batch.fill(lanes.len(), |k| {
            let (lane, part) = lanes[k];
            let ([owner, other], weights) = (ends[lane], &kind.weights);
            let begun = weights.begin(weights.share(owner), &[]);
            let factor = kind.factors.as_ref().map_or(1.0, |factors| factors[bonds[lane]]);
            let weight = factor * weights.join_last(begun, weights.share(other));
            let eta = minus(&u_of[other], &u_of[owner]);
            (minus(&positions[other], &positions[owner]), eta, part * weight)
        });
        if let Some(fields) = kind.fields_of(law) {
            let bond = |(lane, _): &(usize, f64)| (ends[*lane].into_iter(), bonds[*lane]);
            batch.take_fields(fields, Measure::Length, lanes.iter().map(bond));
        }
        element.evaluate(batch, Order::Gradient, out).map_err(|lane| {
            let points = ends[lanes[lane.lane].0].to_vec();
            Refusal { element, lane }.of::<D>(points, u)
        })?;
        for (k, (lane, _)) in lanes.iter().enumerate() {
            let [owner, other] = ends[*lane];
            let pull: [f64; D] = std::array::from_fn(|axis| out.gradient[axis][k]);
            let counted = self.body.counted_part([owner, other].into_iter());
            held[*lane].energy += counted * out.energy[k];
            held[*lane].timing += 0.5 * step * dot(&pull, &minus(&v_of[other], &v_of[owner]));
        }
        Ok(())
    }
}

/// Bonds on their way through the element of a law.
struct OfLaw<'a> {
    kind: &'a Kind,
    law: usize,
    bonds: &'a [usize],
    ends: &'a [[usize; 2]],
}
