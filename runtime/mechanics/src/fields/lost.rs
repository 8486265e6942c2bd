//! Which bonds families have lost.

use std::sync::Arc;

use crate::neighborhood::Neighborhood;

/// The families before any bond was lost, and which bonds of theirs are.
pub(crate) struct LostBonds {
    /// The whole families.
    pub(crate) neighborhood: Arc<Neighborhood>,
    is_lost: Vec<bool>,
}

impl LostBonds {
    /// None of these families.
    pub(crate) fn none_of(neighborhood: Arc<Neighborhood>) -> LostBonds {
        let is_lost = vec![false; neighborhood.n_bonds()];
        LostBonds { neighborhood, is_lost }
    }

    /// Takes in bonds by their numbers; the ends of those that were there, the lower one first.
    pub(crate) fn lose(&mut self, bonds: &[usize]) -> Vec<[usize; 2]> {
        let mut ends = Vec::with_capacity(bonds.len());
        for &bond in bonds {
            if !std::mem::replace(&mut self.is_lost[bond], true) {
                ends.push(self.neighborhood.ends(bond));
            }
        }
        ends
    }

    /// Puts bonds back by their numbers; the ends of those that are lost still.
    pub(crate) fn regain(&mut self, bonds: &[usize]) -> Vec<[usize; 2]> {
        bonds.iter().for_each(|bond| self.is_lost[*bond] = false);
        let lost = (0..self.is_lost.len()).filter(|bond| self.is_lost[*bond]);
        lost.map(|bond| self.neighborhood.ends(bond)).collect()
    }
}

/// The points at the ends of bonds, ascending, each once.
pub(crate) fn points_of(ends: &[[usize; 2]]) -> Vec<usize> {
    let mut points = ends.as_flattened().to_vec();
    points.sort_unstable();
    points.dedup();
    points
}
