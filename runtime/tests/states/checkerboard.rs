//! Displacements that alternate from point to point (partmann2026 4.44): bonds see them, and so does the
//! dilatation's companion, the energy of lengths.

use std::sync::Arc;

use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::energy::Energy;
use piola_runtime::weights::Weights;

use crate::common::Checkerboard;
use crate::{energy, library, of_length, solid, values};

/// In Pa: E = 210 GPa, nu = 1/4.
const BULK: f64 = 140e9;
const SHEAR: f64 = 84e9;

#[test]
fn lengths_see_what_alternates() {
    let at = Checkerboard::new();
    let (model, values) = values(&library("silling2000"), &[("K", BULK)], 3, at.horizon);
    let bond = of_length(&model, &values).map(|law| Box::new(law) as _);
    let laws = Laws { bond, ..Laws::default() };
    let body = Arc::clone(&at.body);
    let bonds = DiscreteEnergy::new(body, at.horizon, Weights::Volumes, laws).unwrap();
    let moduli = [("K", BULK), ("G", SHEAR)];
    let states = energy(&solid("1"), &moduli, &at.body, at.horizon);
    let energies: [(&str, &dyn Energy, f64); 2] =
        [("BB", &bonds, 266456.623865), ("LPS", &states, 215457.751279)];
    for (name, energy, expected) in energies {
        let found = energy.densities(&at.u, at.body.volumes()).unwrap()[at.centre];
        println!("{name} {found:.6}");
        // Half a unit of its last digit.
        assert!((found - expected).abs() < 0.5e-6, "{name}: {found}");
    }
}
