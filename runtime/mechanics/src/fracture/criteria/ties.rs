//! Bonds that rounding keeps from their threshold, or puts beyond it: which of them break depends on the last
//! bits of displacements.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use super::margin::at_rest;
use super::{Candidate, Criteria, Margin, Margins, Room, room_for};
use crate::body::Body;
use crate::element::CAPACITY;
use crate::energy::NonFinite;
use crate::geometry::each;
use crate::neighborhood::Neighborhood;

/// How much the length of a bond is changed, relative to it: what margins are exact to.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Only margins below this part of what they amount to at rest are looked at.
const NEARLY_ZERO: f64 = 1e-6;

/// Bonds at their threshold, until they have been told.
#[derive(Default)]
pub(super) struct Ties {
    are_told: AtomicBool,
    bonds: Mutex<Vec<usize>>,
}

impl Ties {
    /// Whether nobody asks any more.
    pub(super) fn are_told(&self) -> bool {
        self.are_told.load(Ordering::Relaxed)
    }

    pub(super) fn add(&self, bonds: Vec<usize>) {
        self.bonds.lock().unwrap_or_else(PoisonError::into_inner).extend(bonds);
    }
}

impl Criteria {
    /// Bonds that were at their threshold but for rounding when bonds were judged, ascending. Once there have
    /// been some, nobody looks any more.
    pub(in crate::fracture) fn take_ties(&self) -> Vec<usize> {
        let mut found = self.ties.bonds.lock().unwrap_or_else(PoisonError::into_inner);
        if !found.is_empty() {
            self.ties.are_told.store(true, Ordering::Relaxed);
        }
        let mut bonds = std::mem::take(&mut *found);
        bonds.sort_unstable();
        bonds.dedup();
        bonds
    }

    /// Finds out what margins amount to at rest.
    pub(super) fn weigh(&mut self, around: (&Body, &Neighborhood)) {
        let n_laws = self.layers.iter().map(|layer| layer.of_law.len()).max().unwrap_or(0);
        for law in 0..n_laws {
            match around.0.dimension() {
                2 => self.weigh_law::<2>(around, law),
                _ => self.weigh_law::<3>(around, law),
            }
        }
    }

    fn weigh_law<const D: usize>(
        &mut self,
        (body, neighborhood): (&Body, &Neighborhood),
        law: usize,
    ) {
        let positions = body.positions().as_chunks::<D>().0;
        let nowhere = vec![[0.0; D]; positions.len()];
        for layer in self.layers.iter_mut().filter(|layer| layer.of_law.len() > law) {
            let takes = |ends: &[usize; 2]| layer.parts(ends).iter().any(|part| part.0 == law);
            let bonds = (0..neighborhood.n_points()).flat_map(|owner| {
                let ends =
                    neighborhood.upper(owner).iter().map(move |other| [owner, other as usize]);
                neighborhood.bonds(owner).zip(ends)
            });
            let bonds = bonds.filter(|(_, ends)| takes(ends)).take(CAPACITY);
            let bonds: Vec<Candidate<D>> =
                bonds.map(|(bond, ends)| Candidate::new(bond, ends, positions, &nowhere)).collect();
            let bonds: Vec<&Candidate<D>> = bonds.iter().collect();
            let mut room = room_for(D);
            let of_margin = |margin: &Margin| {
                let values =
                    layer.values((margin, law), &bonds, at_rest, &mut room, nowhere.as_flattened());
                // What has no value at rest is said where bonds are judged.
                values.map_or(0.0, |all| all.iter().fold(0.0, |most: f64, m| most.max(m.abs())))
            };
            let found: Vec<f64> = layer.of_law[law].iter().map(of_margin).collect();
            layer.of_law[law]
                .iter_mut()
                .zip(found)
                .for_each(|(margin, size)| margin.at_rest = size);
        }
    }
}

impl Margin {
    /// Whether a margin is so small that rounding may decide.
    pub(super) fn is_nearly_zero(&self, margin: f64) -> bool {
        margin.abs() <= NEARLY_ZERO * self.at_rest
    }
}

impl Margins {
    /// Those of some bonds that break or not by a change of their length by rounding.
    pub(super) fn decided_by_rounding<const D: usize>(
        &self,
        margin: (&Margin, usize),
        bonds: &[&Candidate<D>],
        room: &mut Room,
        u: &[f64],
    ) -> Result<Vec<usize>, NonFinite> {
        let mut verdicts = |part: f64| -> Result<Vec<bool>, NonFinite> {
            let eta = |bond: &Candidate<D>| {
                each(|axis| bond.eta[axis] + part * (bond.xi[axis] + bond.eta[axis]))
            };
            let values = self.values(margin, bonds, eta, room, u)?;
            Ok(values.iter().map(|value| margin.0.breaks(*value)).collect())
        };
        let (shorter, longer) = (verdicts(-ROUNDING)?, verdicts(ROUNDING)?);
        let verdicts = shorter.into_iter().zip(longer);
        let ties = bonds.iter().zip(verdicts).filter(|(_, (shorter, longer))| shorter != longer);
        Ok(ties.map(|(bond, _)| bond.bond).collect())
    }
}
