//! Table 6 of firooz2023: norm of the free residual over that of the first iteration, for the
//! extension of a cube in increments of 2 %, at the increments that end at 20, 40, .. 100 %.

use crate::examples;
use crate::support::{number, numbers};

/// A half of the table: derivatives by hyper-dual numbers, or by hand.
struct Printed {
    /// Iterations 2 to 4, column by column.
    columns: [[f64; 3]; 5],
    /// Iteration 6, which is rounding.
    floors: [f64; 5],
}

const HALVES: [Printed; 2] = [
    Printed {
        columns: [
            [3.99e-2, 7.66e-5, 3.79e-10],
            [2.87e-2, 2.90e-5, 4.56e-11],
            [2.08e-2, 1.16e-5, 6.64e-12],
            [1.54e-2, 5.08e-6, 1.18e-12],
            [1.15e-2, 2.41e-6, 2.51e-13],
        ],
        floors: [2.52e-14, 3.60e-14, 4.32e-14, 4.85e-14, 5.26e-14],
    },
    Printed {
        columns: [
            [3.99e-2, 7.66e-5, 3.79e-10],
            [2.87e-2, 2.90e-5, 4.56e-11],
            [2.08e-2, 1.16e-5, 6.64e-12],
            [1.54e-2, 5.08e-6, 1.18e-12],
            [1.15e-2, 2.41e-6, 2.47e-13],
        ],
        floors: [1.26e-14, 1.38e-14, 1.45e-14, 1.61e-14, 1.68e-14],
    },
];

/// One unit in the last of the three digits that are printed: the paper rounds some numbers and cuts
/// others.
fn last_digit(printed: f64) -> f64 {
    libm::pow(10.0, libm::floor(libm::log10(printed)) - 2.0)
}

#[test]
fn all_five_columns_are_reproduced() {
    let run = examples::run("firooz2023_table6", &["solver.start=last"]);
    assert_eq!(run.steps().len(), 50);
    for column in 0..5 {
        let t = 0.2 * (column + 1) as f64;
        let step = &run.steps()[10 * column + 9];
        assert!((number(&step["t"]) - t).abs() < 1e-12, "{step}");
        let residual = numbers(&step["residual"]);
        let ratio = |iteration: usize| residual[iteration - 1] / residual[0];
        for half in &HALVES {
            let floor = half.floors[column];
            for (iteration, printed) in (2..).zip(half.columns[column]) {
                // What is printed contains the rounding of that program: its part of the norm, at a
                // right angle to a residual that knows nothing of it.
                let found = libm::hypot(ratio(iteration), floor);
                let units = (found - printed) / last_digit(printed);
                println!(
                    "t = {t:.1}, iteration {iteration}: {:.4e}, printed {printed:.2e}, with its rounding {units:+.2} units",
                    ratio(iteration)
                );
                // What conjugate gradients leave here, 1.5e-14, is another unit of the smallest entry.
                let bar = if printed < 1e-12 { 2.0 } else { 1.0 };
                assert!(units.abs() <= bar, "{found:e}, printed {printed:e}");
            }
        }
        // Iteration 5 is rounding; at 80 and 100 % the tolerance is met before it.
        assert_eq!(residual.len(), if column < 3 { 5 } else { 4 }, "{residual:?}");
        if residual.len() == 5 {
            println!("t = {t:.1}, iteration 5: {:.1e}", ratio(5));
            assert!(ratio(5) < HALVES[0].floors[column], "t = {t}: {:e}", ratio(5));
        }
    }
}
