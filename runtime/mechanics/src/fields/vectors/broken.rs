//! Families that lose bonds.
//!
//! A family without a bond is a smaller family: passes go over the lists of what is left, and everything that
//! points gather is a sum over these. A point that has lost all of its bonds has no energy.

use std::sync::{Arc, OnceLock};

use super::VectorEnergy;
use crate::fields::lost::LostBonds;

/// The families before any bond was lost.
pub(super) struct Whole {
    pub(super) lost: LostBonds,
}

impl VectorEnergy {
    /// See [`crate::energy::Energy::lose`].
    pub(super) fn lose_bonds(&mut self, bonds: &[usize]) {
        let whole = self.whole.get_or_insert_with(|| {
            Box::new(Whole { lost: LostBonds::none_of(Arc::clone(&self.neighborhood)) })
        });
        let ends = whole.lost.lose(bonds);
        self.take_out(&ends);
    }

    /// See [`crate::energy::Energy::regain`]: the whole families lose what is still lost.
    pub(super) fn regain_bonds(&mut self, bonds: &[usize]) {
        let Some(whole) = &mut self.whole else { return };
        let still = whole.lost.regain(bonds);
        self.neighborhood = Arc::clone(&whole.lost.neighborhood);
        self.take_out(&still);
    }

    /// Takes out bonds that are there, by their ends.
    fn take_out(&mut self, bonds: &[[usize; 2]]) {
        Arc::make_mut(&mut self.neighborhood).take_out(bonds);
        (self.stiffness, self.bond_pattern) = (OnceLock::new(), OnceLock::new());
    }
}
