//! Bonds that break: what a sum over interactions loses with them.
//!
//! A broken bond keeps its place in all lists and has the factor 0. Where laws are affine that is all:
//! they are finite at any stretch. Kernels see a broken bond at rest, for its energy far from there may be
//! infinite.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use super::DiscreteEnergy;
use super::quadratic::AffineLaw;
use super::visit::{Refusal, minus};
use crate::element::{Contributions, InteractionBatch, Order};
use crate::energy::NonFinite;
use crate::fracture::Release;
use crate::geometry::dot;
use crate::kernel::{Law, Measure};

/// How much the square of a length must have grown, in m^2, until a margin is 0 that is negative at rest
/// and grows with the length; nothing of margins that are not affine in the length or in its square.
pub(crate) fn affine_threshold(margin: &dyn Law, length: f64) -> Option<f64> {
    let law = AffineLaw::of(margin).filter(|_| margin.fields().is_empty())?;
    let at_rest = law.at(length, 1.0)?;
    if at_rest.bent != 0.0 || at_rest.linear <= 0.0 {
        return None;
    }
    let grown = -at_rest.rest / at_rest.linear;
    Some(if law.by_square { grown } else { grown * (2.0 * length + grown) })
}

impl DiscreteEnergy {
    /// Bonds alone: a triangle or a tetrahedron would go with the first of its edges.
    pub(super) fn has_bonds_alone(&self) -> bool {
        self.triangles.is_none() && self.tetrahedra.is_none()
    }

    /// See [`crate::energy::Energy::lose`].
    pub(super) fn lose_bonds(&mut self, bonds: &[usize]) {
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
        exceeded.resize_with(slabs.len(), || AtomicBool::new(true));
        true
    }

    /// See [`crate::energy::Energy::exceeding`].
    pub(super) fn exceeding_owners(&self) -> Option<Vec<Range<usize>>> {
        if self.exceeded.is_empty() {
            return None;
        }
        let is_beyond = |slab: &usize| self.exceeded[*slab].load(Ordering::Relaxed);
        let found = (0..self.slabs.len()).filter(is_beyond);
        Some(found.map(|slab| self.slabs.owners(slab)).collect())
    }

    /// What bonds that are still there release, one by one: see [`crate::energy::Energy::break_bonds`].
    pub(super) fn release_bonds<const D: usize>(
        &self,
        u: &[f64],
        (step, direction): (f64, &[f64]),
        bonds: &[usize],
    ) -> Result<Release, NonFinite> {
        let mut release = Release { bonds: bonds.len(), ..Release::default() };
        let Some(kind) = &self.bonds else { return Ok(release) };
        let positions = self.body.positions().as_chunks::<D>().0;
        let (u_of, v_of) = (u.as_chunks::<D>().0, direction.as_chunks::<D>().0);
        let mut batch = InteractionBatch::new(Measure::Length, D);
        let mut out = Contributions::new(Measure::Length, D);
        for &bond in bonds {
            let [owner, other] = self.neighborhood.ends(bond);
            let xi = minus(&positions[other], &positions[owner]);
            let eta = minus(&u_of[other], &u_of[owner]);
            let weights = &kind.weights;
            let begun = weights.begin(weights.share(owner), &[]);
            let factor = kind.factors.as_ref().map_or(1.0, |factors| factors[bond]);
            let weight = factor * weights.join_last(begun, weights.share(other));
            for (law, part) in kind.parts_of(&[owner, other]).iter() {
                let Some(element) = kind.element(law) else { continue };
                batch.fill(1, |_| (xi, eta, part * weight));
                if let Some(fields) = kind.fields_of(law) {
                    batch.take_fields(fields, |_| [owner, other].into_iter());
                }
                let evaluated = element.evaluate(&batch, Order::Gradient, &mut out);
                evaluated
                    .map_err(|lane| Refusal { element, lane }.of::<D>(vec![owner, other], u))?;
                let pull: [f64; D] = std::array::from_fn(|axis| out.gradient[axis][0]);
                release.energy += out.energy[0];
                release.timing += 0.5 * step * dot(&pull, &minus(&v_of[other], &v_of[owner]));
            }
        }
        Ok(release)
    }
}
