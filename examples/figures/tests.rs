//! Numbers of the figures that independent programs found, too.

use crate::checkerboard;
use crate::traction::{MODELS, Model};

/// Checkerboards recomputed elsewhere; those of deviations by hand.
#[test]
fn energies_of_checkerboards_are_those_recomputed_from_the_paper() {
    let expected = [0.0, 683389.8305, 103766.447660, 215457.751279, 266456.623865];
    for (model, expected) in checkerboard::MODELS.iter().zip(expected) {
        let found = model.densities().unwrap().middle();
        assert!((found - expected).abs() <= 1e-9 * expected + 1e-15, "{}: {found}", model.name);
    }
}

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
