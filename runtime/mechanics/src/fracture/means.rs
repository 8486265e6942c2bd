//! What is remembered at points, and around them: means over their bonds, triangles or tetrahedra.

use std::ops::Range;

use rayon::prelude::*;

use super::Status;
use super::damage::measure;
use super::memory::Memory;
use super::walk::{OfOwners, Walk};
use crate::body::Body;
use crate::energy::NonFinite;
use crate::interaction::Lost;
use crate::kernel::Measure;
use crate::materials::StateOf;
use crate::neighborhood::Neighborhood;

/// Sums over what there is at some points, and of the weights in them.
struct Sums {
    points: Range<usize>,
    sums: Vec<f64>,
    weights: Vec<f64>,
}

impl Sums {
    fn of(points: Range<usize>) -> Sums {
        let nothing = vec![0.0; points.len()];
        Sums { points, sums: nothing.clone(), weights: nothing }
    }

    fn add(&mut self, point: usize, weight: f64, value: f64) {
        let place = point - self.points.start;
        self.sums[place] += weight * value;
        self.weights[place] += weight;
    }

    fn means(self) -> Vec<f64> {
        self.sums.iter().zip(&self.weights).map(|(sum, weight)| sum / weight).collect()
    }
}

/// States of a body, by their numbers ([`Memory::all`]).
pub(super) struct States<'a> {
    pub(super) around: (&'a Body, &'a Neighborhood),
    pub(super) memory: &'a Memory,
    pub(super) numbers: &'a [usize],
}

impl States<'_> {
    /// The mean of the states over what is unbroken at each point: a bond counts with the volume of the
    /// neighbour, a triangle or a tetrahedron with its measure at rest, each by the part that the law of the
    /// state has in it; not a number where there are none. Where the states are of several kinds it is the mean
    /// of theirs.
    pub(super) fn means(&self, status: &Status) -> Vec<f64> {
        let held = |kind: &StateOf| {
            self.numbers.iter().any(|number| self.memory.kind_of(*number) == Some(*kind))
        };
        let of_measure = |measure: Measure| match (self.memory.cliques(measure), &status.lost) {
            (Some(all), Some(lost)) => match (self.around.0.dimension(), measure) {
                (2, _) => self.of_cliques::<2, 2>(all, lost),
                (_, Measure::Area) => self.of_cliques::<3, 2>(all, lost),
                _ => self.of_cliques::<3, 3>(all, lost),
            },
            _ => self.of_bonds(&status.is_broken),
        };
        let of_kind = |kind: StateOf| match kind {
            StateOf::Interactions(measure) => of_measure(measure),
            StateOf::Points => self.of_points(),
        };
        let all = Measure::ALL.into_iter().map(StateOf::Interactions).chain([StateOf::Points]);
        let kinds: Vec<Vec<f64>> = all.filter(held).map(of_kind).collect();
        let mean = |point: usize| {
            let there = kinds.iter().map(|means| means[point]).filter(|mean| !mean.is_nan());
            let (sum, n) = there.fold((0.0, 0.0), |(sum, n), mean| (sum + mean, n + 1.0));
            sum / n
        };
        (0..self.around.0.n_points()).map(mean).collect()
    }

    /// The states of an interaction, with the parts of their laws.
    fn of(&self, kind: StateOf, (own, points): (usize, &[usize]), mut see: impl FnMut(f64, f64)) {
        for number in self.numbers {
            if let Some((part, value)) = self.memory.state_of(*number, kind, (own, points)) {
                see(part, value);
            }
        }
    }

    /// What points themselves remember.
    fn of_points(&self) -> Vec<f64> {
        let mut all = Sums::of(0..self.around.0.n_points());
        for point in all.points.clone() {
            self.of(StateOf::Points, (point, &[point]), |part, value| all.add(point, part, value));
        }
        all.means()
    }

    fn of_bonds(&self, is_broken: &[bool]) -> Vec<f64> {
        let (body, neighborhood) = self.around;
        let mut all = Sums::of(0..body.n_points());
        for owner in 0..body.n_points() {
            let bonds = neighborhood.bonds(owner).zip(neighborhood.upper(owner));
            for (bond, other) in bonds.filter(|(bond, _)| !is_broken[*bond]) {
                let ends = [owner, other as usize];
                self.of(StateOf::Interactions(Measure::Length), (bond, &ends), |part, value| {
                    for (point, neighbor) in [(ends[0], ends[1]), (ends[1], ends[0])] {
                        all.add(point, part * body.volumes()[neighbor], value);
                    }
                });
            }
        }
        all.means()
    }

    fn of_cliques<const D: usize, const K: usize>(
        &self,
        cliques: &OfOwners,
        lost: &Lost,
    ) -> Vec<f64> {
        let (body, _) = self.around;
        let nowhere = vec![0.0; body.positions().len()];
        let walk = Walk { around: self.around, u: &nowhere, lost };
        let of_piece = |piece: (usize, Range<usize>)| {
            let mut sums = Sums::of(cliques.touched(piece.0));
            // Nothing is worked out that might not be finite.
            let _: Result<(), NonFinite> = cliques.show::<D, K>(
                walk,
                piece,
                |_| false,
                |listed, lanes| {
                    for clique in lanes {
                        let points = listed.points::<K>(clique);
                        let weight = measure::<D, K>(listed.reference(), clique);
                        let own = (listed.number(clique), &points[..=K]);
                        self.of(StateOf::Interactions(cliques.measure), own, |part, value| {
                            points[..=K].iter().for_each(|p| sums.add(*p, part * weight, value));
                        });
                    }
                    Ok(())
                },
            );
            sums
        };
        let pieces = cliques.pieces(0..body.n_points(), usize::MAX).into_par_iter();
        let found: Vec<Sums> = pieces.map(of_piece).collect();
        let mut all = Sums::of(0..body.n_points());
        for Sums { points, sums, weights } in found {
            for (place, point) in points.enumerate() {
                all.sums[point] += sums[place];
                all.weights[point] += weights[place];
            }
        }
        all.means()
    }
}
