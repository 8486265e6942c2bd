//! Conditions of what points gather, asked of places: of bonds as each of their ends sees them, or of points, which
//! break all of their bonds.

use rayon::prelude::*;

use crate::body::Body;
use crate::energy::NonFinite;
use crate::fracture::{Asked, FamilyCriterion, Judged};
use crate::neighborhood::Neighborhood;

/// Points that are worked out by one task, or whose bonds are; fixed, so that results do not depend on threads.
const CHUNK: usize = 64;

/// Places that go through a margin at once.
const CAPACITY: usize = 128;

/// Margins at some places, and those at rest where these are asked for.
pub(super) type Margins = (Vec<f64>, Option<Vec<f64>>);

/// A condition, and what it is asked of.
pub(super) struct Question<'a, M> {
    pub(super) criterion: &'a FamilyCriterion<M>,
    /// Whether it holds what a bond has beside what a point gathers: then it is asked of bonds.
    pub(super) of_bonds: bool,
    pub(super) asked: Asked,
}

impl<M: Sync> Question<'_, M> {
    /// Judges the places that are asked for and that `takes` takes, by what their first points gather.
    ///
    /// # Errors
    /// Those of `margins`.
    pub(super) fn answer(
        &self,
        (body, neighborhood): (&Body, &Neighborhood),
        takes: impl Fn(&[usize; 2]) -> bool + Sync,
        margins: impl Fn(&[[usize; 2]]) -> Result<Margins, NonFinite> + Sync,
    ) -> Result<Vec<Judged>, NonFinite> {
        let judge = |mut places: Vec<[usize; 2]>| {
            places.retain(&takes);
            let mut found = Vec::new();
            for places in places.chunks(CAPACITY) {
                let (now, rest) = margins(places)?;
                self.criterion.judge(places, (&now, rest.as_deref()), &mut found);
            }
            Ok(found)
        };
        if let Asked::Bond([i, j]) = self.asked {
            let places = if self.of_bonds { [[i, j], [j, i]] } else { [[i; 2], [j; 2]] };
            return judge(places.to_vec());
        }
        // Of a slab whoever owns a point judges by what it gathers.
        let (n, counted) = (body.n_points(), body.counted());
        let chunk = |number: usize| {
            let points = number * CHUNK..n.min((number + 1) * CHUNK);
            let points = points.filter(|i| counted.contains(i));
            let row = |i: usize| neighborhood.row(i).iter().map(move |j| [i, j as usize]);
            judge(match self.of_bonds {
                true => points.flat_map(row).collect(),
                false => points.map(|i| [i; 2]).collect(),
            })
        };
        let parts: Result<Vec<_>, NonFinite> =
            (0..n.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
        Ok(parts?.concat())
    }
}
