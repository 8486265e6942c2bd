//! What holds the points of a broken body together where bonds have no energy of their own.

use super::damage::lost_of;
use super::{Breaking, CLIQUES, left_of};
use crate::energy::Energy as _;
use crate::interaction::{Degeneracy, Lost, OwnerCliques, Slabs, n_neighbors};
use crate::kernel::Measure;
use crate::matrix::BlockPattern;

impl Breaking {
    /// See [`super::Fracture::joined`].
    pub(super) fn joined_by_cliques(&self) -> Option<BlockPattern> {
        let status = self.now();
        let report = status.energy.report();
        if report.bonds > 0 {
            return None;
        }
        let mut is_joined = vec![false; self.neighborhood.n_bonds()];
        for (measure, count) in CLIQUES.into_iter().zip([report.triangles, report.tetrahedra]) {
            if count > 0 {
                let ranks = self.ranks(measure);
                let lost = lost_of(&status, &self.neighborhood, (n_neighbors(measure), ranks));
                match (self.body.dimension(), measure) {
                    (2, _) => self.join::<2, 2>(&lost, &mut is_joined),
                    (_, Measure::Area) => self.join::<3, 2>(&lost, &mut is_joined),
                    _ => self.join::<3, 3>(&lost, &mut is_joined),
                }
            }
        }
        let apart: Vec<usize> = (0..is_joined.len()).filter(|bond| !is_joined[*bond]).collect();
        Some(left_of(&BlockPattern::of_bonds(&self.neighborhood, self.body.dimension()), &apart))
    }

    /// Notes the bonds from owners to others of a clique that is left.
    fn join<const D: usize, const K: usize>(&self, lost: &Lost, is_joined: &mut [bool]) {
        let slabs = Slabs::new(&self.neighborhood);
        for slab in 0..slabs.len() {
            let mut cliques = OwnerCliques::<D>::new(
                &self.body,
                &self.neighborhood,
                Degeneracy::new(&self.body),
                slabs.touched(slab),
            )
            .with_lost(Some(lost));
            for owner in slabs.owners(slab) {
                let own = &mut is_joined[self.neighborhood.bonds(owner)];
                let mut missing = own.iter().filter(|joined| !**joined).count();
                cliques.set_of::<K>(owner);
                // All that is asked is known long before the last clique.
                let _: Result<(), Done> = cliques.each_numbered::<K, Done>(|clique| {
                    for member in clique.corners::<K>() {
                        missing -= usize::from(!std::mem::replace(&mut own[member], true));
                    }
                    if missing == 0 { Err(Done) } else { Ok(()) }
                });
            }
        }
    }
}

/// Every member of an owner is joined to it.
struct Done;
