//! The same of triangles and tetrahedra: what is left of them, owner by owner.

use std::ops::Range;

use rayon::prelude::*;

use super::super::walk::{Listed, Of, OfOwners, Room, Walk};
use super::{Change, Changes, Memory};
use crate::body::Body;
use crate::energy::NonFinite;
use crate::interaction::{Clique, Lost};
use crate::kernel::Measure;
use crate::materials::Fields;
use crate::neighborhood::Neighborhood;

/// Owners that one task looks at: they have hundreds of triangles each, and thousands of tetrahedra.
const CHUNK: usize = 32;

/// Gives all cliques of a size the states that they begin with: the mean of what their points have.
pub(super) fn begin(all: &OfOwners, around: (&Body, &Neighborhood), fields: &Fields) {
    fields.begin_states(all.measure, Some(&all.ranks), |field| {
        match (around.0.dimension(), all.measure) {
            (2, _) => means::<2, 2>(all, around, |points| fields.mean(field, points)),
            (_, Measure::Area) => means::<3, 2>(all, around, |points| fields.mean(field, points)),
            _ => means::<3, 3>(all, around, |points| fields.mean(field, points)),
        }
    });
}

/// A mean over the points of each clique.
fn means<const D: usize, const K: usize>(
    all: &OfOwners,
    around: (&Body, &Neighborhood),
    mean: impl Fn(std::iter::Take<std::array::IntoIter<usize, 4>>) -> f64 + Sync,
) -> Vec<f64> {
    let (u, lost) = (vec![0.0; around.0.positions().len()], Lost::nothing_of(around.1));
    let walk = Walk { around, u: &u, lost: &lost };
    let pieces = all.pieces(0..around.0.n_points(), CHUNK).into_par_iter();
    let found = pieces.map(|piece| {
        let mut own = Vec::new();
        let take = |listed: &Listed<'_, '_, D>, lanes: &[Clique]| {
            let points = |clique| listed.points::<K>(clique).into_iter().take(K + 1);
            own.extend(lanes.iter().map(|clique| mean(points(clique))));
            Ok(())
        };
        // Nothing is worked out that might not be finite.
        let _: Result<(), NonFinite> = all.show::<D, K>(walk, piece, |_| false, take);
        own
    });
    found.collect::<Vec<_>>().concat()
}

impl Memory {
    /// What the states of some owners' cliques of one size become that are not lost; see [`Memory::changes`].
    pub(super) fn changes_of_cliques(
        &self,
        all: &OfOwners,
        (around, lost): ((&Body, &Neighborhood), &Lost),
        (u, dt): (&[f64], f64),
        owners: Range<usize>,
    ) -> Result<Changes, NonFinite> {
        let walk = Walk { around, u, lost };
        let pieces = all.pieces(owners, CHUNK).into_par_iter();
        let found = pieces.map(|piece| match (around.0.dimension(), all.measure) {
            (2, _) => self.changes_in::<2, 2>(all, (walk, dt), piece),
            (_, Measure::Area) => self.changes_in::<3, 2>(all, (walk, dt), piece),
            _ => self.changes_in::<3, 3>(all, (walk, dt), piece),
        });
        let found: Result<Vec<Vec<Change>>, NonFinite> = found.collect();
        Ok(Changes::new(found?))
    }

    fn changes_in<const D: usize, const K: usize>(
        &self,
        all: &OfOwners,
        (walk, dt): (Walk<'_>, f64),
        piece: (usize, Range<usize>),
    ) -> Result<Vec<Change>, NonFinite> {
        let (mut room, mut changes) = (Room::new(all.measure, D), Vec::new());
        all.show::<D, K>(
            walk,
            piece,
            |_| false,
            |listed, lanes| {
                self.add_changes_of::<D, K>(
                    (all.measure, dt),
                    (listed, lanes),
                    &mut room,
                    &mut changes,
                )
            },
        )?;
        Ok(changes)
    }

    fn add_changes_of<const D: usize, const K: usize>(
        &self,
        (measure, dt): (Measure, f64),
        (listed, lanes): (&Listed<'_, '_, D>, &[Clique]),
        room: &mut Room,
        changes: &mut Vec<Change>,
    ) -> Result<(), NonFinite> {
        for (layer, rules) in self.layers.iter().enumerate() {
            let of_laws = &rules.of_kinds[measure as usize];
            for (law, states) in of_laws.iter().enumerate().filter(|(_, own)| !own.is_empty()) {
                let is_alone = of_laws.len() == 1;
                let takes = |clique: &&Clique| {
                    let points = listed.points::<K>(clique);
                    is_alone || rules.parts(&points[..=K]).iter().any(|part| part.0 == law)
                };
                let own: Vec<Clique> = lanes.iter().filter(takes).copied().collect();
                if own.is_empty() {
                    continue;
                }
                let fields = (&*rules.fields, rules.fields.of_law(law));
                for (field, element) in states {
                    let fields = Some(fields.clone());
                    let of = Of { element, fields, dt: Some(dt), at_rest: false };
                    listed.evaluate::<K>(&own, of, room)?;
                    let next = own.iter().zip(&room.out.energy);
                    changes.extend(next.filter_map(|(clique, &value)| {
                        rules.change(layer, *field, listed.number(clique), value)
                    }));
                }
            }
        }
        Ok(())
    }
}
