//! Bonds, triangles and tetrahedra that have numbers, one after the other with their points.

use super::Breaking;
use super::walk::{Listed, OfOwners, Walk};
use crate::energy::NonFinite;
use crate::interaction::{Clique, Lost};
use crate::kernel::Measure;

impl Breaking {
    /// See [`super::Fracture::each`].
    pub(super) fn list(&self, measure: Measure, see: &mut dyn FnMut(usize, &[usize])) {
        if measure == Measure::Length {
            for owner in 0..self.body.n_points() {
                let bonds = self.neighborhood.bonds(owner).zip(self.neighborhood.upper(owner));
                bonds.for_each(|(bond, other)| see(bond, &[owner, other as usize]));
            }
            return;
        }
        let with_criteria = self.criteria.cliques.of(measure);
        let Some(all) = with_criteria.or_else(|| self.memory.cliques(measure)) else { return };
        match (self.body.dimension(), measure) {
            (2, _) => self.list_cliques::<2, 2>(all, see),
            (_, Measure::Area) => self.list_cliques::<3, 2>(all, see),
            _ => self.list_cliques::<3, 3>(all, see),
        }
    }

    fn list_cliques<const D: usize, const K: usize>(
        &self,
        all: &OfOwners,
        see: &mut dyn FnMut(usize, &[usize]),
    ) {
        let around = (&*self.body, &*self.neighborhood);
        let (u, lost) = (vec![0.0; self.body.positions().len()], Lost::nothing_of(around.1));
        let walk = Walk { around, u: &u, lost: &lost };
        for piece in all.pieces(0..self.body.n_points(), usize::MAX) {
            let take = |listed: &Listed<'_, '_, D>, lanes: &[Clique]| {
                for clique in lanes {
                    see(listed.number(clique), &listed.points::<K>(clique)[..=K]);
                }
                Ok(())
            };
            // Nothing is worked out that might not be finite.
            let _: Result<(), NonFinite> = all.show::<D, K>(walk, piece, |_| false, take);
        }
    }
}
