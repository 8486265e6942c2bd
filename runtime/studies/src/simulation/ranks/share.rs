//! Which points are whose: a body is cut across its longest axis, along which its points are sorted.

use std::ops::Range;

use piola_mechanics::body::Body;

/// Distances are compared with this part of themselves to spare: a point more in a halo does no harm.
pub(super) const MARGIN: f64 = 1e-6;

/// What a rank owns and holds, as ranges of points in the body's order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Share {
    /// Rank `r` owns the points `ranges[r]..ranges[r + 1]`.
    pub(super) ranges: Vec<u64>,
    /// The points that this rank owns.
    pub(super) own: Range<usize>,
    /// These and the halo before and behind them: all points on which forces on its own depend.
    pub(super) held: Range<usize>,
}

impl Share {
    /// That of one of `ranks` ranks, where forces depend on points as far away as `reach`, in m. Ranks own equally many
    /// points, up to one.
    pub(super) fn of(body: &Body, reach: f64, (rank, ranks): (usize, usize)) -> Share {
        let n = body.n_points();
        let ranges = Share::ranges(n, ranks);
        let own = ranges[rank] as usize..ranges[rank + 1] as usize;
        let along = |point: usize| body.position(point)[body.sorted_axis()];
        let reach = reach * (1.0 + MARGIN);
        let first =
            (0..own.start).rev().take_while(|point| along(own.start) - along(*point) <= reach);
        let last = (own.end..n).take_while(|point| along(*point) - along(own.end - 1) <= reach);
        let held = own.start - first.count()..own.end + last.count();
        Share { ranges, own, held }
    }

    /// Where the points of each of so many ranks begin, and where the last ones end.
    pub(super) fn ranges(n_points: usize, ranks: usize) -> Vec<u64> {
        (0..=ranks).map(|rank| (n_points * rank / ranks) as u64).collect()
    }

    /// The places of its own points among those that it holds.
    pub(super) fn own_of_held(&self) -> Range<usize> {
        self.own.start - self.held.start..self.own.end - self.held.start
    }

    /// The halo's points by their numbers in the body.
    pub(super) fn ghosts(&self) -> Vec<u64> {
        let numbers = (self.held.start..self.own.start).chain(self.own.end..self.held.end);
        numbers.map(|point| point as u64).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_own_all_points_once_and_hold_what_is_near() {
        let positions: Vec<f64> =
            (0..50).flat_map(|k| [f64::from(k / 2), f64::from(k % 2)]).collect();
        let body = Body::new(2, &positions, &[1.0; 50], Some(1.0));
        for ranks in 1..8 {
            let shares: Vec<Share> =
                (0..ranks).map(|rank| Share::of(&body, 3.0, (rank, ranks))).collect();
            let mut next = 0;
            for share in &shares {
                assert_eq!(share.own.start, next);
                next = share.own.end;
                for point in 0..50 {
                    let near = share
                        .own
                        .clone()
                        .any(|own| (body.position(own)[0] - body.position(point)[0]).abs() <= 3.0);
                    assert_eq!(share.held.contains(&point), near);
                }
                assert_eq!(share.ghosts().len() + share.own.len(), share.held.len());
            }
            assert_eq!(next, 50);
        }
    }
}
