//! Table 6 of firooz2023: norm of the free residual over that of the first iteration, for the
//! extension of a cube in increments of 2 %; the first column, up to 20 %.

use crate::examples;
use crate::support::{number, numbers};

/// Iterations 2 to 4 as printed.
const PRINTED: [f64; 3] = [3.99e-2, 7.66e-5, 3.79e-10];
/// Relative.
const TOLERANCE: f64 = 5e-3;

#[test]
fn the_first_column_is_reproduced() {
    let overrides = ["steps.end=0.2", "steps.increments=10"];
    let run = examples::run("firooz2023_table6", &overrides);
    let step = run.steps().last().unwrap();
    assert_eq!(run.steps().len(), 10);
    assert!((number(&step["t"]) - 0.2).abs() < 1e-12);
    let residual = numbers(&step["residual"]);
    for (iteration, printed) in PRINTED.into_iter().enumerate() {
        let ratio = residual[iteration + 1] / residual[0];
        println!("iteration {}: {ratio:.4e}, printed {printed:.2e}", iteration + 2);
        assert!((ratio / printed - 1.0).abs() <= TOLERANCE, "{ratio:e}, printed {printed:e}");
    }
}
