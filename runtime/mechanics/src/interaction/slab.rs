//! Slabs: contiguous ranges of points whose cliques reach no further than the next slab.
//!
//! The points of a body are sorted along an axis and a clique belongs to its lowest point, so the
//! cliques of slab `s` touch only rows of slabs `s` and `s + 1`. Even slabs can be assembled at
//! once, odd ones after them, without two tasks writing to one row; the slabs follow from the body
//! alone, so every sum has one order for any number of threads.

use std::ops::Range;

use crate::neighborhood::Neighborhood;

/// The slabs of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Slabs {
    /// Slab `s` holds the points `bounds[s]..bounds[s + 1]`.
    bounds: Vec<usize>,
}

impl Slabs {
    /// The thinnest slabs: each ends where the one before it cannot reach, that is about one
    /// horizon further.
    pub fn new(neighborhood: &Neighborhood) -> Slabs {
        Slabs::reaching(neighborhood.n_points(), |point| {
            neighborhood.upper(point).last().map_or(point, |last| last as usize)
        })
    }

    /// The thinnest slabs of `n` points of which each reaches no further than to `last(point)`.
    pub fn reaching(n: usize, last: impl Fn(usize) -> usize) -> Slabs {
        let mut bounds = vec![0];
        let mut reach = 0;
        let mut point = 0;
        while bounds[bounds.len() - 1] < n {
            let end = bounds[bounds.len() - 1];
            let seen = if bounds.len() == 1 { 1 } else { end };
            while point < seen {
                reach = reach.max(last(point) + 1);
                point += 1;
            }
            bounds.push(reach.max(end + 1));
        }
        Slabs { bounds }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.bounds.len() - 1
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The first point of a slab; of the one after the last, how many points there are.
    pub fn start(&self, slab: usize) -> usize {
        self.bounds[slab]
    }

    /// The points of a slab.
    pub fn owners(&self, slab: usize) -> Range<usize> {
        self.bounds[slab]..self.bounds[slab + 1]
    }

    /// The points that the cliques of a slab's owners touch: its own and those of the next slab.
    pub fn touched(&self, slab: usize) -> Range<usize> {
        self.bounds[slab]..self.bounds[(slab + 2).min(self.len())]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Body;
    use crate::lattice::{Lattice, Nodes};

    fn check(body: &Body, horizon: f64) -> Slabs {
        let neighborhood = Neighborhood::new(body, horizon).unwrap();
        let slabs = Slabs::new(&neighborhood);
        let mut next = 0;
        for slab in 0..slabs.len() {
            assert_eq!(slabs.owners(slab).start, next);
            assert!(!slabs.owners(slab).is_empty());
            next = slabs.owners(slab).end;
            for owner in slabs.owners(slab) {
                let touched = slabs.touched(slab);
                assert!(neighborhood.upper(owner).iter().all(|j| touched.contains(&(j as usize))));
            }
        }
        assert_eq!(next, body.n_points());
        slabs
    }

    #[test]
    fn slabs_reach_no_further_than_the_next() {
        let lattice = Lattice {
            lower: vec![0.0, 0.0],
            upper: vec![20.0, 9.0],
            spacing: 1.0,
            nodes: Nodes::Corners,
        };
        let points = lattice.points().unwrap();
        let body = Body::new(2, &points.positions, &points.volumes, Some(1.0));
        let slabs = check(&body, 3.0);
        assert_eq!(slabs.len(), 7, "three layers each: {slabs:?}");
        check(&body, 1.0);
        check(&body, 100.0);
        let scattered: Vec<f64> =
            (0..400).map(|k| (k as f64 * 0.754877666246693 * (1.0 + k as f64)).fract()).collect();
        check(&Body::new(2, &scattered, &[1.0; 200], None), 0.12);
        check(&Body::new(2, &[0.0, 0.0, 1.0, 0.0, 9.0, 0.0], &[1.0; 3], None), 1.5);
    }
}
