//! Families that lose bonds.
//!
//! A family without a bond is a smaller family: the integrals that do not change are gathered anew over what
//! is left, and passes go over the lists of what is left. Rows of a lattice have gaps then, and are no longer
//! used. A point that has lost all of its bonds keeps the integrals of its whole family, by which potentials
//! divide; what changes with displacements is a sum over nothing.

use std::sync::{Arc, OnceLock};

use super::{StateEnergy, rest_lengths};
use crate::neighborhood::Neighborhood;
use crate::pool::Pool;

/// The families before any bond was lost.
pub(super) struct Whole {
    pub(super) neighborhood: Arc<Neighborhood>,
    at_rest: Vec<f64>,
    is_lost: Vec<bool>,
}

impl StateEnergy {
    /// See [`crate::energy::Energy::lose`]; or puts bonds back.
    pub(super) fn lose_bonds(&mut self, bonds: &[usize], is_lost: bool) {
        let mut whole = self.whole.take().unwrap_or_else(|| {
            let (neighborhood, at_rest) = (Arc::clone(&self.neighborhood), self.at_rest.clone());
            let is_lost = vec![false; neighborhood.n_bonds()];
            Box::new(Whole { neighborhood, at_rest, is_lost })
        });
        bonds.iter().for_each(|bond| whole.is_lost[*bond] = is_lost);
        self.neighborhood = Arc::new(whole.neighborhood.without(&whole.is_lost));
        self.rest = rest_lengths(&self.body, &self.neighborhood);
        self.rows = None;
        (self.springs, self.bond_pattern) = (OnceLock::new(), OnceLock::new());
        (self.states, self.work) = (Pool::new(), Pool::new());
        let m = self.n_integrals();
        self.changing = (0..m).collect();
        self.at_rest.fill(0.0);
        self.fix();
        for point in self.neighborhood.isolated() {
            let own = point * m..(point + 1) * m;
            self.at_rest[own.clone()].copy_from_slice(&whole.at_rest[own]);
        }
        self.whole = Some(whole);
    }
}
