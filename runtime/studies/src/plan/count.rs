//! How many interactions there will be: of small bodies counted, of larger ones estimated from some
//! of their points, of boxes that nobody should fill for a plan from the box.

use piola_mechanics::body::Body;
use piola_mechanics::interaction::{Degeneracy, OwnerCliques};
use piola_mechanics::neighborhood::{HORIZON_TOLERANCE, Neighborhood, NeighborhoodError};
use rayon::prelude::*;
use serde::Serialize;

use crate::scene::LatticeShape;

/// Triangles and tetrahedra are counted at no more points than this.
const MAX_SAMPLED_OWNERS: usize = 200;

/// Of no point more cliques of a kind are counted than this, a second's work for all: where the
/// horizon holds thousands of points there are billions. The estimate is too low then.
const MAX_COUNTED: u64 = 2_000_000;

/// How many interactions a body has, each unordered one once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct InteractionCount {
    /// One-neighbour interactions.
    pub bonds: u64,
    /// Two-neighbour interactions.
    pub triangles: u64,
    /// Three-neighbour interactions.
    pub tetrahedra: u64,
    /// Whether triangles and tetrahedra were counted at every point.
    pub exact: bool,
    /// Whether bonds were.
    pub bonds_exact: bool,
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
        let none = InteractionCount::default();
        return InteractionCount { bonds, exact: true, bonds_exact: true, ..none };
    }
    let owners = sample(body.n_points(), MAX_SAMPLED_OWNERS);
    cliques_of(body, neighborhood, needed, &owners).scaled(bonds, body.n_points(), true)
}

/// Rows of neighbours that are listed for an estimate: a fraction of a second.
const LISTED: f64 = 1e7;

/// Bonds are estimated from so many points.
const SAMPLED_ROWS: usize = 2000;

/// The same for a body of which not all neighbours shall be listed; `family` is how many neighbours a
/// point has, about.
///
/// # Errors
/// As [`Neighborhood::new`], for the points that are looked at.
pub fn estimate_interactions(
    body: &Body,
    horizon: f64,
    family: f64,
    needed: Needed,
) -> Result<InteractionCount, NeighborhoodError> {
    let n = body.n_points();
    let rows = sample(n, SAMPLED_ROWS);
    let listed = Neighborhood::around(body, horizon, &rows, false)?;
    let found: usize = rows.iter().map(|&row| listed.row(row).len()).sum();
    let bonds = (0.5 * n as f64 * found as f64 / rows.len().max(1) as f64).round() as u64;
    if !needed.triangles && !needed.tetrahedra {
        return Ok(InteractionCount { bonds, exact: true, ..InteractionCount::default() });
    }
    let affordable = (LISTED / (0.5 * family * family).max(1.0)) as usize;
    let owners = sample(n, affordable.clamp(1, MAX_SAMPLED_OWNERS));
    let neighborhood = Neighborhood::around(body, horizon, &owners, true)?;
    Ok(cliques_of(body, &neighborhood, needed, &owners).scaled(bonds, n, false))
}

/// The same for a whole box, none of whose points is made; `horizon` in m.
///
/// Bonds are counted by their differences in the lattice, cliques at a smaller box.
pub fn count_in_box(shape: &LatticeShape, horizon: f64, needed: Needed) -> InteractionCount {
    let counts: Vec<f64> = shape.counts().iter().map(|n| *n as f64).collect();
    let reach = horizon / shape.spacing * (1.0 + HORIZON_TOLERANCE);
    let bonds = bonds_in_box(&counts, reach);
    let count = InteractionCount {
        bonds: bonds as u64,
        bonds_exact: true,
        exact: true,
        ..InteractionCount::default()
    };
    if !needed.triangles && !needed.tetrahedra {
        return count;
    }
    // Every point of such a box has a whole family beside it.
    let most = (4.0 * reach).ceil() + 1.0;
    let sides: Vec<usize> = counts.iter().map(|n| n.min(most) as usize).collect();
    let small = stand_in(&sides);
    let family = 2.0 * bonds / counts.iter().product::<f64>();
    match estimate_interactions(&small, reach / (1.0 + HORIZON_TOLERANCE), family, needed) {
        Ok(found) => {
            let scale = bonds / (found.bonds.max(1) as f64);
            let scaled = |n: u64| (n as f64 * scale).round() as u64;
            let (triangles, tetrahedra) = (scaled(found.triangles), scaled(found.tetrahedra));
            InteractionCount { triangles, tetrahedra, exact: false, ..count }
        }
        // Neither the horizon nor a coordinate of a lattice is infinite.
        Err(_) => count,
    }
}

/// Differences in the lattice that are looked at one by one; beyond, a ball counts.
const DIFFERENCES: f64 = 3e7;

/// Bonds of a box with so many points along each axis, `reach` in spacings.
pub(super) fn bonds_in_box(counts: &[f64], reach: f64) -> f64 {
    let most = |axis: usize| counts.get(axis).map_or(0.0, |n| reach.floor().min(n - 1.0));
    let sides = [most(0), most(1), most(2)];
    if sides.iter().map(|side| 2.0 * side + 1.0).product::<f64>() > DIFFERENCES {
        let ball = match counts.len() {
            2 => std::f64::consts::PI * reach * reach,
            _ => 4.0 / 3.0 * std::f64::consts::PI * reach * reach * reach,
        };
        let points: f64 = counts.iter().product();
        return 0.5 * points * ball.min(points);
    }
    let along = |axis: usize| -(sides[axis] as i64)..=sides[axis] as i64;
    let left =
        |axis: usize, step: i64| counts.get(axis).map_or(1.0, |n| n - step.unsigned_abs() as f64);
    let mut directed = 0.0;
    for x in along(0) {
        for y in along(1) {
            for z in along(2) {
                let square = (x * x + y * y + z * z) as f64;
                if square > 0.0 && square <= reach * reach {
                    directed += left(0, x) * left(1, y) * left(2, z);
                }
            }
        }
    }
    0.5 * directed
}

/// A box of points 1 m apart.
fn stand_in(sides: &[usize]) -> Body {
    let mut positions = Vec::new();
    for point in 0..sides.iter().product::<usize>() {
        let mut rest = point;
        for side in sides {
            positions.push((rest % side) as f64);
            rest /= side;
        }
    }
    let n = positions.len() / sides.len();
    Body::new(sides.len(), &positions, &vec![1.0; n], Some(1.0))
}

/// What was found at some points: bonds to later points, triangles, tetrahedra.
struct Sampled {
    points: usize,
    sums: [u64; 3],
    cut_off: bool,
}

impl Sampled {
    /// Scaled up by the ratio of bonds.
    fn scaled(&self, bonds: u64, n: usize, bonds_exact: bool) -> InteractionCount {
        let [own, triangles, tetrahedra] = self.sums;
        let scale = if own == 0 { 0.0 } else { bonds as f64 / own as f64 };
        let scaled = |n: u64| (n as f64 * scale).round() as u64;
        let exact = bonds_exact && self.points == n && !self.cut_off;
        let (triangles, tetrahedra) = (scaled(triangles), scaled(tetrahedra));
        InteractionCount { bonds, triangles, tetrahedra, exact, bonds_exact }
    }
}

/// Bonds and cliques of some points.
fn cliques_of(
    body: &Body,
    neighborhood: &Neighborhood,
    needed: Needed,
    owners: &[usize],
) -> Sampled {
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
    Sampled { points: owners.len(), sums: [sum(0), sum(1), sum(2)], cut_off }
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

/// Up to `most` points: one from each of as many equal ranges of numbers, at a place
/// that jumps by the golden ratio so that no lattice plane is favoured.
fn sample(n: usize, most: usize) -> Vec<usize> {
    if n <= most {
        return (0..n).collect();
    }
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let width = n as f64 / most as f64;
    (0..most)
        .map(|k| {
            let place = k as f64 + ((k + 1) as f64 * GOLDEN).fract();
            ((place * width) as usize).min(n - 1)
        })
        .collect()
}
