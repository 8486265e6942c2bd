//! Families that lose bonds.
//!
//! A family without a bond is a smaller family: passes go over the lists of what is left, and everything that
//! points gather is a sum over these. A point is released that has lost all of its bonds, or whose bonds no longer
//! span space where its law has functions of integrals, among which inverses are: it has no energy, and its
//! functions are 0 for those who see it.

use std::sync::{Arc, OnceLock};

use nalgebra::DMatrix;

use super::VectorEnergy;
use crate::fields::lost::{LostBonds, points_of};

/// Least eigenvalue over largest of the directions of a family that spans space.
const FLAT: f64 = 1e-12;

impl VectorEnergy {
    /// See [`crate::energy::Energy::lose`].
    pub(super) fn lose_bonds(&mut self, bonds: &[usize]) {
        let whole = || LostBonds::none_of(Arc::clone(&self.neighborhood));
        let ends = self.lost.get_or_insert_with(whole).lose(bonds);
        self.take_out(&ends);
    }

    /// See [`crate::energy::Energy::regain`]: the whole families lose what is still lost.
    pub(super) fn regain_bonds(&mut self, bonds: &[usize]) {
        let Some(lost) = &mut self.lost else { return };
        let still = lost.regain(bonds);
        self.neighborhood = Arc::clone(&lost.neighborhood);
        self.is_released.fill(false);
        self.take_out(&still);
    }

    /// Takes out bonds that are there, by their ends.
    fn take_out(&mut self, bonds: &[[usize; 2]]) {
        Arc::make_mut(&mut self.neighborhood).take_out(bonds);
        (self.stiffness, self.bond_pattern) = (OnceLock::new(), OnceLock::new());
        for point in points_of(bonds) {
            self.is_released[point] = !self.has_family(point);
        }
    }

    /// Whether a point has something to gather from that is enough for its law.
    pub(super) fn has_family(&self, point: usize) -> bool {
        let row = self.neighborhood.row(point);
        let law = self.laws.of_law.get(self.law_of(point)).and_then(Option::as_ref);
        match law {
            _ if row.is_empty() => false,
            Some(law) if law.functions.is_some() => self.spans_space(point),
            _ => true,
        }
    }

    pub(super) fn spans_space(&self, point: usize) -> bool {
        let (d, row) = (self.body.dimension(), self.neighborhood.row(point));
        let mut directions = DMatrix::<f64>::zeros(d, d);
        for j in row {
            let (here, there) = (self.body.position(point), self.body.position(j as usize));
            let square = here.iter().zip(there).fold(0.0, |sum, (x, y)| sum + (y - x) * (y - x));
            for r in 0..d {
                for c in 0..d {
                    directions[(r, c)] += (there[r] - here[r]) * (there[c] - here[c]) / square;
                }
            }
        }
        let eigenvalues = directions.symmetric_eigenvalues();
        eigenvalues.min() > FLAT * eigenvalues.max()
    }
}
