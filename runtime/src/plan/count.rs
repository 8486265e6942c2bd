//! How many interactions there will be.

use std::collections::HashMap;
use std::ops::Range;

use rayon::prelude::*;
use serde::Serialize;

use crate::body::Body;

/// Neighbours are within `horizon * (1 + HORIZON_TOLERANCE)`: rounding must not decide on a lattice.
const HORIZON_TOLERANCE: f64 = 1e-6;

/// Triangles and tetrahedra are counted at no more points than this.
const MAX_SAMPLED_OWNERS: usize = 200;

/// Points per task when bonds are counted.
const CHUNK: usize = 1024;

/// How many interactions a body has, each unordered one once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct InteractionCount {
    /// One-neighbour interactions; exact.
    pub bonds: u64,
    /// Two-neighbour interactions.
    pub triangles: u64,
    /// Three-neighbour interactions.
    pub tetrahedra: u64,
    /// Whether triangles and tetrahedra were counted at every point.
    pub exact: bool,
}

/// How many interactions a point owns: those of which it is the corner that comes first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cliques {
    /// Triangles that are not degenerate.
    pub triangles: u64,
    /// Tetrahedra that are not degenerate.
    pub tetrahedra: u64,
}

/// Counts what a point owns among its neighbours with greater numbers, which are in ascending order.
pub type CountCliques<'a> = dyn Fn(usize, &[u32]) -> Cliques + Sync + 'a;

/// Counts bonds, and with `cliques` estimates triangles and tetrahedra.
///
/// `cliques` is asked at up to 200 points spread evenly over the body, the same ones every time; the sums are scaled by the ratio of all bonds to those of the sample,
/// since the surface costs all kinds of interaction alike.
pub fn count_interactions(
    body: &Body,
    horizon: f64,
    cliques: Option<&CountCliques<'_>>,
) -> InteractionCount {
    let cells = Cells::new(body, horizon * (1.0 + HORIZON_TOLERANCE));
    let n = body.n_points();
    let chunks = (0..n).step_by(CHUNK).collect::<Vec<usize>>();
    let in_chunk = |start: &usize| -> u64 {
        let mut neighbours = Vec::new();
        let mut bonds = 0;
        for point in *start..(start + CHUNK).min(n) {
            cells.upper_neighbours(point, &mut neighbours);
            bonds += neighbours.len() as u64;
        }
        bonds
    };
    // Whole numbers: their sum does not depend on the order.
    let bonds = chunks.par_iter().map(in_chunk).collect::<Vec<u64>>().iter().sum();
    let Some(cliques) = cliques else {
        return InteractionCount { bonds, exact: true, ..InteractionCount::default() };
    };
    let owners = sample(n);
    let counted: Vec<(u64, Cliques)> = owners
        .par_iter()
        .map(|&owner| {
            let mut neighbours = Vec::new();
            cells.upper_neighbours(owner, &mut neighbours);
            (neighbours.len() as u64, cliques(owner, &neighbours))
        })
        .collect();
    let sampled_bonds: u64 = counted.iter().map(|(bonds, _)| bonds).sum();
    let scale = if sampled_bonds == 0 { 0.0 } else { bonds as f64 / sampled_bonds as f64 };
    let scaled = |count: fn(&Cliques) -> u64| {
        let sum: u64 = counted.iter().map(|(_, cliques)| count(cliques)).sum();
        (sum as f64 * scale).round() as u64
    };
    InteractionCount {
        bonds,
        triangles: scaled(|cliques| cliques.triangles),
        tetrahedra: scaled(|cliques| cliques.tetrahedra),
        exact: owners.len() == n,
    }
}

/// Up to [`MAX_SAMPLED_OWNERS`] points: one from each of as many equal ranges of numbers, at a place
/// that jumps by the golden ratio so that no lattice plane is favoured.
fn sample(n: usize) -> Vec<usize> {
    if n <= MAX_SAMPLED_OWNERS {
        return (0..n).collect();
    }
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let width = n as f64 / MAX_SAMPLED_OWNERS as f64;
    (0..MAX_SAMPLED_OWNERS)
        .map(|k| {
            let place = k as f64 + ((k + 1) as f64 * GOLDEN).fract();
            ((place * width) as usize).min(n - 1)
        })
        .collect()
}

/// Points by the cell of a grid whose cells are as wide as the reach of an interaction.
struct Cells<'a> {
    body: &'a Body,
    reach: f64,
    /// Points cell by cell, ascending within a cell.
    points: Vec<u32>,
    ranges: HashMap<[i64; 3], Range<usize>>,
}

impl<'a> Cells<'a> {
    fn new(body: &'a Body, reach: f64) -> Cells<'a> {
        let mut keyed: Vec<([i64; 3], u32)> =
            (0..body.n_points()).map(|p| (cell(body.position(p), reach), p as u32)).collect();
        keyed.par_sort_unstable();
        let mut ranges: HashMap<[i64; 3], Range<usize>> = HashMap::new();
        for (i, (key, _)) in keyed.iter().enumerate() {
            ranges.entry(*key).or_insert(i..i).end = i + 1;
        }
        let points = keyed.into_iter().map(|(_, point)| point).collect();
        Cells { body, reach, points, ranges }
    }

    /// The neighbours of a point with greater numbers, ascending.
    fn upper_neighbours(&self, point: usize, found: &mut Vec<u32>) {
        found.clear();
        let position = self.body.position(point);
        let here = cell(position, self.reach);
        let depth = if self.body.dimension() == 3 { -1..=1 } else { 0..=0 };
        for (i, j) in (-1..=1).flat_map(|i| (-1..=1).map(move |j| (i, j))) {
            for k in depth.clone() {
                let key = [here[0] + i, here[1] + j, here[2] + k];
                let Some(range) = self.ranges.get(&key) else { continue };
                let near = |other: &&u32| {
                    **other as usize > point && self.is_near(position, **other as usize)
                };
                found.extend(self.points[range.clone()].iter().filter(near));
            }
        }
        found.sort_unstable();
    }

    fn is_near(&self, position: &[f64], other: usize) -> bool {
        let other = self.body.position(other);
        let squared: f64 = position.iter().zip(other).map(|(x, y)| (x - y) * (x - y)).sum();
        squared <= self.reach * self.reach
    }
}

fn cell(position: &[f64], reach: f64) -> [i64; 3] {
    let mut cell = [0; 3];
    for (index, x) in cell.iter_mut().zip(position) {
        *index = (x / reach).floor() as i64;
    }
    cell
}
