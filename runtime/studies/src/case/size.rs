//! Bodies that no plan can be made for: their points, or the list of their neighbours, are larger
//! than the memory of the machine. They are refused before memory is taken for them.
//!
//! [`crate::plan`] estimates everything that comes later and can be overruled; without points and
//! neighbours there is nothing to estimate from.

use piola_mechanics::body::Body;
use piola_mechanics::neighborhood::HORIZON_TOLERANCE;

use super::CaseError;
use crate::plan::{available_memory, in_bytes};
use crate::scene::LatticeShape;

/// Copies of positions and volumes that exist while a body is made: of the lattice, of the points
/// that stay, in the body's order.
const COPIES: f64 = 3.0;

/// Bytes per bond while neighbours are listed: two ends, in chunks and together.
const BOND_BYTES: f64 = 16.0;

/// Neighbours are counted at so many points.
const SAMPLED: usize = 64;

/// Refuses a lattice whose points alone exceed the memory.
pub(crate) fn check_lattice(shape: &LatticeShape) -> Result<(), CaseError> {
    let points = shape.counts().iter().map(|n| *n as f64).product::<f64>();
    check_points(points, shape.low.len(), "of the box")
}

/// Refuses so many points, `whose`, if they alone exceed the memory.
pub(crate) fn check_points(points: f64, d: usize, whose: &str) -> Result<(), CaseError> {
    let bytes = points * COPIES * 8.0 * (d + 1) as f64;
    check(bytes, &format!("the {points:.1e} points {whose}"), "take a larger spacing")
}

/// How many neighbours a point has, from some of the points.
pub(crate) fn family(body: &Body, horizon: f64) -> f64 {
    let n = body.n_points();
    let sampled = n.min(SAMPLED);
    let points = (0..sampled).map(|k| (2 * k + 1) * n / (2 * sampled));
    let found: usize = points.map(|point| count_neighbors(body, horizon, point)).sum();
    found as f64 / sampled.max(1) as f64
}

/// Refuses a body whose neighbours exceed the memory; `family` is how many a point has.
pub(crate) fn check_neighbors(body: &Body, horizon: f64, family: f64) -> Result<(), CaseError> {
    let n = body.n_points();
    let bonds = 0.5 * n as f64 * family;
    let what = format!("the {bonds:.1e} bonds of {n} points within the horizon {horizon} m");
    check(BOND_BYTES * bonds, &what, "take a larger spacing or a smaller horizon")
}

/// Neighbours of a point, among the points near it along the axis by which the body is sorted.
fn count_neighbors(body: &Body, horizon: f64, point: usize) -> usize {
    let (d, axis) = (body.dimension(), body.sorted_axis());
    let reach = horizon * (1.0 + HORIZON_TOLERANCE);
    let here = body.position(point);
    let near = |other: &&[f64]| {
        let square: f64 = other.iter().zip(here).map(|(x, y)| (x - y) * (x - y)).sum();
        square <= reach * reach
    };
    let rows = body.positions().chunks_exact(d);
    let (before, after) = (rows.clone().take(point).rev(), rows.skip(point + 1));
    let inside = |other: &&[f64]| (other[axis] - here[axis]).abs() <= reach;
    before.take_while(inside).filter(near).count() + after.take_while(inside).filter(near).count()
}

fn check(bytes: f64, what: &str, help: &str) -> Result<(), CaseError> {
    let Some(available) = available_memory().filter(|available| bytes > *available as f64) else {
        return Ok(());
    };
    let (needed, available) = (in_bytes(bytes as u64), in_bytes(available));
    let message = format!(
        "{what} alone need about {needed} of memory, and {available} are available: {help}"
    );
    Err(CaseError::Body { message })
}
