//! What the lattice hides: the same scene on another lattice, with the same horizon in m.
//!
//! With the horizon and all parameters fixed the model stays and its points change, so the ratio of
//! horizon and spacing does. A quantity that differs by `D` between spacings `h` and `h'` has at
//! `h` an error of about `D/|h'/h - 1|` if errors go with the spacing: surfaces and clamps are a
//! part of a spacing too thick or too thin, and sums over the neighbourhood are as rough. It is an
//! estimate of a size, not a bound.

use std::time::{Duration, Instant};

use piola_output::decimal;

use super::{Quantity, ReadCase};
use crate::case::Case;
use crate::scene::{LatticeShape, Points};
use crate::simulation::{Attempt, Course, solve};

/// Spacings differ by at least this factor: closer lattices often have the same neighbours.
const LEAST_FACTOR: f64 = 1.2;

/// Factors that differ by less are the same.
const ROUNDED: f64 = 1e-9;

/// How other lattices are solved: differences are of 1e-3 and more.
const QUICK: [&str; 2] = ["solver.tolerance=1e-6", "solver.start=tangent"];

/// And how they move: each with a step of its own.
const QUICK_MOTION: [&str; 1] = ["motion.step=auto"];

/// Fewer spacings than this in a horizon are no neighbourhood.
const LEAST_RATIO: f64 = 1.99;

/// The scene on another lattice.
#[derive(Clone, Debug)]
pub struct Alternate {
    /// Its spacing in m.
    pub spacing: f64,
    /// Spacings in a horizon.
    pub ratio: f64,
    /// What it took in s.
    pub seconds: f64,
    /// How far each quantity is from that of the scene, relative.
    pub differences: Vec<f64>,
    /// The errors of the scene's own lattice that follow.
    pub errors: Vec<f64>,
}

/// The discretisation error of a scene.
#[derive(Clone, Debug, Default)]
pub struct Resolution {
    /// The other lattices.
    pub alternates: Vec<Alternate>,
    /// For each quantity the least of the estimates, so that nothing is called hidden that may be
    /// seen; `None` where there is none.
    pub errors: Vec<Option<f64>>,
    /// Why a lattice was not tried, or failed.
    pub notes: Vec<String>,
}

/// Estimates the discretisation error of every quantity of a scene.
///
/// `own_seconds` is what the scene itself takes; a finer lattice is tried where the plan expects it
/// to end within `limit`.
pub fn resolution(
    read: &ReadCase<'_>,
    case: &Case,
    quantities: &[Quantity],
    own: &Course,
    own_seconds: f64,
    limit: Duration,
    progress: &mut dyn FnMut(&str),
) -> Resolution {
    let mut found = Resolution { errors: vec![None; quantities.len()], ..Resolution::default() };
    let Points::Lattice(shape) = &case.scene.body.points else {
        found.notes.push("the points of a file have no other spacing".to_string());
        return found;
    };
    let horizon = case.scene.horizon_radius();
    let start = Instant::now();
    let candidates = [coarser(shape, horizon), finer(shape)];
    for (spacing, which) in candidates.into_iter().zip(["coarser", "finer"]) {
        let Some(spacing) = spacing else {
            found.notes.push(format!(
                "no {which} lattice fits the box and holds two spacings in the horizon"
            ));
            continue;
        };
        let left = limit.saturating_sub(start.elapsed());
        let size = decimal(spacing);
        progress(&format!("the scene on a {which} lattice, spacing {size}"));
        let lattice = [format!("body.spacing={spacing:?}"), format!("horizon.radius={horizon:?}")];
        let quick: &[&str] = if case.scene.motion.is_some() { &QUICK_MOTION } else { &QUICK };
        let quick = quick.iter().map(|set| set.to_string());
        let overrides: Vec<String> = lattice.into_iter().chain(quick).collect();
        let ratio = horizon / spacing;
        match attempt(read, case, &overrides, own_seconds, left) {
            Ok((end, seconds)) => {
                let differences: Vec<f64> =
                    quantities.iter().map(|q| q.difference(&end, own)).collect();
                let change = (spacing / shape.spacing - 1.0).abs();
                let errors = differences.iter().map(|d| d / change).collect();
                found.alternates.push(Alternate { spacing, ratio, seconds, differences, errors });
            }
            Err(reason) => {
                found.notes.push(format!("the {which} lattice, spacing {size}: {reason}"));
            }
        }
    }
    for (index, error) in found.errors.iter_mut().enumerate() {
        let estimates = found.alternates.iter().map(|alternate| alternate.errors[index]);
        *error = estimates.filter(|e| e.is_finite() && *e > 0.0).reduce(f64::min);
    }
    found
}

/// The scene on the other lattice and the time it took, or why not.
fn attempt(
    read: &ReadCase<'_>,
    own: &Case,
    overrides: &[String],
    own_seconds: f64,
    limit: Duration,
) -> Result<(Course, f64), String> {
    let first_line = |text: String| text.lines().next().unwrap_or_default().to_string();
    let case = read(overrides).map_err(|error| first_line(error.to_string()))?;
    let threads = rayon::current_num_threads();
    let planned = |case: &Case| case.plan(threads).map(|plan| plan.time.total);
    if let (Ok(here), Ok(there)) = (planned(own), planned(&case)) {
        let expected = own_seconds * there / here.max(1e-9);
        if expected > limit.as_secs_f64() {
            let limit = limit.as_secs_f64();
            return Err(format!("it would take about {expected:.0} s, and {limit:.0} s are left"));
        }
    }
    let start = Instant::now();
    match solve(&case, limit).map_err(|error| first_line(error.to_string()))? {
        Attempt::Reached(end) => Ok((*end, start.elapsed().as_secs_f64())),
        Attempt::NotConverged(message) => Err(first_line(message)),
        Attempt::OutOfTime(t) => Err(format!("the time was up at t = {t}")),
    }
}

/// The box's longest length that divides all its sides, and how many cells the lattice has along
/// it.
fn unit(shape: &LatticeShape) -> (f64, usize) {
    let cells: Vec<usize> = shape.cells().map(|cells| cells as usize).collect();
    let divisor = cells.iter().copied().fold(0, gcd);
    let first = cells[0] / divisor.max(1);
    ((shape.high[0] - shape.low[0]) / first.max(1) as f64, divisor)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The next coarser spacing that fills the box.
fn coarser(shape: &LatticeShape, horizon: f64) -> Option<f64> {
    let (length, cells) = unit(shape);
    let spacings = (1..cells).rev().map(|count| length / count as f64);
    let mut fitting =
        spacings.filter(|spacing| *spacing >= LEAST_FACTOR * (1.0 - ROUNDED) * shape.spacing);
    fitting.next().filter(|spacing| horizon / spacing >= LEAST_RATIO)
}

/// The next finer spacing that fills the box.
fn finer(shape: &LatticeShape) -> Option<f64> {
    let (length, cells) = unit(shape);
    let spacings = (cells + 1..=2 * cells.max(1)).map(|count| length / count as f64);
    spacings.into_iter().find(|spacing| *spacing * LEAST_FACTOR <= (1.0 + ROUNDED) * shape.spacing)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Nodes;

    fn lattice(sides: &[f64], spacing: f64, nodes: Nodes) -> LatticeShape {
        LatticeShape { low: vec![0.0; sides.len()], high: sides.to_vec(), spacing, nodes }
    }

    #[test]
    fn other_spacings_fill_the_box() {
        let near = |found: Option<f64>, expected: f64| {
            assert!((found.unwrap() / expected - 1.0).abs() < 1e-15, "{found:?} {expected}");
        };
        let square = lattice(&[1.0, 1.0], 0.05, Nodes::Corners);
        near(coarser(&square, 0.15), 1.0 / 16.0);
        near(finer(&square), 1.0 / 24.0);
        // Two spacings in the horizon leave no coarser lattice.
        assert_eq!(coarser(&square, 0.1), None);
        // Sides of 20 and 8 cells: spacings are parts of their common quarter.
        let strip = lattice(&[1.0, 0.4], 0.05, Nodes::Cells);
        near(coarser(&strip, 0.2), 0.2 / 3.0);
        near(finer(&strip), 0.04);
        // Sides without a common part but one cell.
        let odd = lattice(&[0.7, 0.3], 0.1, Nodes::Corners);
        assert_eq!(coarser(&odd, 0.3), None);
        near(finer(&odd), 0.05);
    }
}
