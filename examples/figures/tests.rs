//! Numbers of the figures that independent programs found, too.

use crate::traction::{MODELS, Model};

/// The traction bar recomputed elsewhere: five points over the width.
#[test]
fn elongations_are_those_recomputed_from_the_paper() {
    let expected: [&[(usize, f64)]; 3] = [
        &[(2, 0.0220), (3, 0.37743), (4, 0.718)],
        &[(2, -0.328), (3, -0.14024)],
        &[(2, -0.00469), (3, -0.001839)],
    ];
    for (model, expected) in MODELS.iter().zip(expected) {
        let Model { name, .. } = model;
        for &(horizon, error) in expected {
            let found = model.error(5, horizon).unwrap();
            // To the digits that are known.
            let digits = if horizon == 3 { 1e-5 } else { 6e-4 };
            assert!((found - error).abs() < digits, "{name}, {horizon}: {found} not {error}");
        }
    }
}
