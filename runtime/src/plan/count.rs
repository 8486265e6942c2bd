//! How many interactions there will be.

use rayon::prelude::*;
use serde::Serialize;

use crate::body::Body;
use crate::interaction::{Degeneracy, OwnerCliques};
use crate::neighborhood::Neighborhood;

/// Triangles and tetrahedra are counted at no more points than this.
const MAX_SAMPLED_OWNERS: usize = 200;

/// Of no point more cliques of a kind are counted than this, a second's work for all: where the
/// horizon holds thousands of points there are billions. The estimate is too low then.
const MAX_COUNTED: u64 = 2_000_000;

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

/// Which cliques a potential needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needed {
    /// psi(a) is modelled.
    pub triangles: bool,
    /// psi(v) is modelled.
    pub tetrahedra: bool,
}

/// Counts bonds, and estimates the cliques that are needed.
///
/// Cliques are counted at up to 200 points spread evenly over the body, the same ones every time;
/// the sums are scaled by the ratio of all bonds to those of the sample, since the surface costs
/// all kinds of interaction alike.
pub fn count_interactions(
    body: &Body,
    neighborhood: &Neighborhood,
    needed: Needed,
) -> InteractionCount {
    let bonds = neighborhood.n_bonds() as u64;
    if !needed.triangles && !needed.tetrahedra {
        return InteractionCount { bonds, exact: true, ..InteractionCount::default() };
    }
    let owners = sample(body.n_points());
    let degeneracy = Degeneracy::new(body);
    let counted: Vec<[u64; 3]> = owners
        .par_iter()
        .map(|&owner| {
            let found = if body.dimension() == 2 {
                owned::<2>(body, neighborhood, degeneracy, owner, needed)
            } else {
                owned::<3>(body, neighborhood, degeneracy, owner, needed)
            };
            [neighborhood.upper(owner).len() as u64, found[0], found[1]]
        })
        .collect();
    let cut_off = counted.iter().any(|c| c[1].max(c[2]) >= MAX_COUNTED);
    let sum = |k: usize| counted.iter().map(|c| c[k]).sum::<u64>();
    let scale = if sum(0) == 0 { 0.0 } else { bonds as f64 / sum(0) as f64 };
    let scaled = |k: usize| (sum(k) as f64 * scale).round() as u64;
    let exact = owners.len() == body.n_points() && !cut_off;
    InteractionCount { bonds, triangles: scaled(1), tetrahedra: scaled(2), exact }
}

/// Stops the count at [`MAX_COUNTED`].
struct Enough;

/// Triangles and tetrahedra of which a point is the corner that comes first.
fn owned<const D: usize>(
    body: &Body,
    neighborhood: &Neighborhood,
    degeneracy: Degeneracy,
    owner: usize,
    needed: Needed,
) -> [u64; 2] {
    let points = owner..body.n_points();
    let mut cliques = OwnerCliques::<D>::new(body, neighborhood, degeneracy, points);
    cliques.set(owner);
    let mut found = [0, 0];
    let count = |number: &mut u64| {
        *number += 1;
        if *number < MAX_COUNTED { Ok(()) } else { Err(Enough) }
    };
    // Being stopped early is no error here.
    if needed.triangles {
        let _ = cliques.triangles(|_, _, _| count(&mut found[0]));
    }
    if needed.tetrahedra && D == 3 {
        let _ = cliques.tetrahedra(|_, _, _| count(&mut found[1]));
    }
    found
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
