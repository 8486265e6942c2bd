//! Newton's method converges quadratically on every example, down to the rounding floor, which is that
//! of the module `floor`.

use serde_json::Value;

use crate::examples;
use crate::support::numbers;

/// Entries below this are rounding: the sum of some 100 forces per point, each rounded.
const FLOOR: f64 = 1e-13;
/// The same for triangles that are 1e6 times as stiff as the bonds between points 0.01 apart, whose
/// forces at a point cancel.
const FLOOR_OF_FINE_SQUARE: f64 = 1e-12;

/// Steps start on the line through the last two equilibria.
const LINE: &str = "solver.start=extrapolate";
/// They start at the last: far enough off that quadratic convergence is seen.
const LAST: &str = "solver.start=last";

/// The same where particles a hundred times as stiff as the body move with it: their forces are rounded
/// as their own stiffness is large.
const FLOOR_OF_PARTICLES: f64 = 1e-11;

/// What is asserted of one example: `R_{k+1} <= c R_k^2` for residuals over the reaction.
///
/// The residual that a Newton step leaves is quadratic in the step, `K |du|^2/h`: the energy changes
/// its curvature when points move by a length `h` against each other, a part of the horizon. With
/// the reaction `K U`, `U` the end displacement, and `R K U` the residual that the step removes, the
/// step is `|du| ~ R U` and `c ~ U/h`: of the order of 1, and larger where the energy is stiffer in
/// some deformations (areas, volumes) than against the end displacement. A logarithm changes its
/// curvature over the fraction `a/A` of `h` where a triangle is pressed flat, as in `first` at 60 %.
/// Those below are two to five times what was measured.
struct Expected {
    example: &'static str,
    overrides: &'static [&'static str],
    c: f64,
    floor: f64,
}

const EXPECTED: [Expected; 21] = [
    Expected { example: "bimetal", overrides: &[], c: 15.0, floor: FLOOR },
    Expected { example: "bonds_beside_F", overrides: &[], c: 6.0, floor: FLOOR },
    Expected { example: "cantilever", overrides: &[], c: 0.2, floor: FLOOR },
    Expected {
        example: "clamped_beam",
        overrides: &["material.parameters.K=5e7"],
        c: 0.6,
        floor: FLOOR,
    },
    Expected { example: "cork", overrides: &[], c: 0.7, floor: FLOOR },
    Expected { example: "correspondence_as_text", overrides: &[], c: 3.0, floor: FLOOR },
    Expected { example: "cube_C1", overrides: &[], c: 0.7, floor: FLOOR },
    Expected { example: "cube_C1_C2", overrides: &[], c: 1.1, floor: FLOOR },
    Expected { example: "cube_C1_C3", overrides: &[], c: 2.5, floor: FLOOR },
    Expected {
        example: "cube_incompressible",
        overrides: &["steps.end=0.1", "steps.increments=5"],
        c: 2.5,
        floor: FLOOR,
    },
    Expected { example: "firooz2023_table6", overrides: &[], c: 0.7, floor: FLOOR },
    Expected { example: "first", overrides: &[], c: 36.0, floor: FLOOR },
    Expected { example: "inclusions", overrides: &[], c: 40.0, floor: FLOOR_OF_PARTICLES },
    // One percent of strain.
    Expected { example: "lamina", overrides: &[], c: 1.0, floor: FLOOR },
    Expected { example: "nanostrip", overrides: &[], c: 2.5, floor: FLOOR },
    Expected { example: "ring", overrides: &[], c: 0.2, floor: FLOOR },
    Expected { example: "square", overrides: &[], c: 1.5, floor: FLOOR },
    // From the last equilibrium its triangles are too far off.
    Expected {
        example: "square_incompressible",
        overrides: &["steps.end=0.03", "steps.increments=3", LINE],
        c: 11.0,
        floor: FLOOR_OF_FINE_SQUARE,
    },
    Expected { example: "square_with_hole", overrides: &[], c: 1.8, floor: FLOOR },
    Expected {
        example: "torsion",
        overrides: &["steps.end=0.1", "steps.increments=6"],
        c: 3.0,
        floor: FLOOR,
    },
    // One percent of strain: far from where curvature changes.
    Expected { example: "traction_bar", overrides: &["steps.increments=1"], c: 0.1, floor: FLOOR },
];

/// The largest `R_{k+1}/R_k^2` of the steps, entries at the floor left out, and how many there are.
fn largest_ratio(steps: &[Value], floor: f64) -> (f64, usize) {
    let (mut largest, mut pairs) = (0.0_f64, 0);
    for step in steps {
        let residual = numbers(&step["residual_over_reaction"]);
        for pair in residual.windows(2).filter(|pair| pair[1] > floor) {
            largest = largest.max(pair[1] / (pair[0] * pair[0]));
            pairs += 1;
        }
    }
    (largest, pairs)
}

#[test]
fn all_examples_converge_quadratically_down_to_rounding() {
    let names: Vec<&str> = EXPECTED.iter().map(|expected| expected.example).collect();
    assert_eq!(names, examples::all(), "every example is listed");
    for Expected { example, overrides, c, floor } in EXPECTED {
        let start: &[&str] = if overrides.contains(&LINE) { &[] } else { &[LAST] };
        let run = examples::run(example, &[overrides, start].concat());
        let (ratio, pairs) = largest_ratio(run.steps(), floor);
        println!("{example}: largest R_(k+1)/R_k^2 {ratio:.2} of {pairs}");
        assert!(pairs >= 2 * run.steps().len(), "{example}: {pairs} pairs show nothing");
        assert!(ratio <= c, "{example}: {ratio}");
    }
}
