//! Families that lose bonds.
//!
//! A family without a bond is a smaller family: the integrals that do not change are gathered anew over what
//! is left, at the ends of bonds that go, and passes go over the lists of what is left. Rows of a lattice have
//! [gaps](super::gaps) then, where bonds at rest have neither force nor energy; others are no longer used. A point
//! that has lost all of its bonds keeps the integrals of its whole family, by which potentials divide; what changes
//! with displacements is a sum over nothing.

use std::sync::{Arc, OnceLock};

use super::StateEnergy;
use crate::fields::lost::{LostBonds, points_of};

/// The families before any bond was lost.
pub(super) struct Whole {
    pub(super) lost: LostBonds,
    at_rest: Vec<f64>,
    rest: Vec<f64>,
}

impl StateEnergy {
    /// See [`crate::energy::Energy::lose`].
    pub(super) fn lose_bonds(&mut self, bonds: &[usize]) {
        let whole = self.whole.get_or_insert_with(|| {
            let lost = LostBonds::none_of(Arc::clone(&self.neighborhood));
            let (at_rest, rest) = (self.at_rest.clone(), self.rest.clone());
            Box::new(Whole { lost, at_rest, rest })
        });
        let ends = whole.lost.lose(bonds);
        self.take_out(&ends);
    }

    /// See [`crate::energy::Energy::regain`]: the whole families lose what is still lost.
    pub(super) fn regain_bonds(&mut self, bonds: &[usize]) {
        let Some(whole) = &mut self.whole else { return };
        let still = whole.lost.regain(bonds);
        self.neighborhood = Arc::clone(&whole.lost.neighborhood);
        self.rest.clone_from(&whole.rest);
        self.at_rest.clone_from(&whole.at_rest);
        if let Some(rows) = &mut self.rows {
            rows.make_whole(&whole.lost.neighborhood);
        }
        self.take_out(&still);
    }

    /// Takes out bonds that are there, by their ends.
    fn take_out(&mut self, bonds: &[[usize; 2]]) {
        let gaps = Arc::make_mut(&mut self.neighborhood).take_out(bonds);
        gaps.close_bonds(&mut self.rest);
        (self.springs, self.bond_pattern) = (OnceLock::new(), OnceLock::new());
        let (left, alone): (Vec<usize>, Vec<usize>) = points_of(bonds)
            .into_iter()
            .partition(|point| !self.neighborhood.row(*point).is_empty());
        self.fix(&left);
        if let Some(whole) = &self.whole {
            let m = self.n_integrals();
            for own in alone.iter().map(|point| point * m..(point + 1) * m) {
                self.at_rest[own.clone()].copy_from_slice(&whole.at_rest[own]);
            }
            if let Some(mut rows) = self.rows.take()
                && rows.lose(self, &whole.lost.neighborhood, (bonds, &left))
            {
                self.rows = Some(rows);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{StateLaws, rest_lengths};
    use super::*;
    use crate::body::Body;
    use crate::kernel::{Batch, Law, Order, Outputs};
    use crate::testing::{goes_to_pieces, pseudo_random};

    /// `L^2`.
    struct Squared;

    impl Law for Squared {
        fn evaluate(&self, batch: Batch<'_>, _: Order, out: Outputs<'_>) {
            out.psi.iter_mut().zip(batch.reference).for_each(|(psi, rest)| *psi = rest * rest);
        }

        fn is_constant(&self) -> bool {
            true
        }
    }

    /// What the ends of bonds that went have alone is what all points have of what is left, to the bit.
    #[test]
    fn ends_have_what_all_points_have_of_what_is_left() {
        for d in [2, 3] {
            let n = 200;
            let volumes: Vec<f64> = pseudo_random(n, 5).iter().map(|x| 2.0 + x).collect();
            let body = Arc::new(Body::new(d, &pseudo_random(n * d, 3), &volumes, None));
            let laws = || StateLaws { integrals: vec![Box::new(Squared)], ..StateLaws::default() };
            let horizon = [0.0, 0.0, 0.4, 0.7][d];
            let mut energy = StateEnergy::new(Arc::clone(&body), horizon, laws()).unwrap();
            let whole = Arc::clone(&energy.neighborhood);
            for (new, is_lost) in goes_to_pieces(whole.n_bonds()) {
                energy.lose_bonds(&new);
                let mut other = StateEnergy::new(Arc::clone(&body), horizon, laws()).unwrap();
                let at_rest = other.at_rest.clone();
                other.neighborhood = Arc::new(whole.without(&is_lost));
                other.rest = rest_lengths(&body, &other.neighborhood);
                other.fix(&(0..n).collect::<Vec<usize>>());
                for point in other.neighborhood.isolated() {
                    other.at_rest[point] = at_rest[point];
                }
                assert_eq!(energy.neighborhood, other.neighborhood);
                assert_eq!((&energy.rest, &energy.at_rest), (&other.rest, &other.at_rest));
                // What comes back is what never went.
                let known = (energy.at_rest.clone(), energy.rest.clone());
                energy.regain_bonds(&new);
                energy.lose_bonds(&new);
                assert_eq!((&energy.at_rest, &energy.rest), (&known.0, &known.1));
            }
        }
    }
}
