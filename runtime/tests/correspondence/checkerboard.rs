//! Displacements that alternate from point to point (partmann2026 4.44): what sees them.

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::correspondence::influence::Constant;
use piola_runtime::correspondence::{
    Correspondence, Discretisation, Formulation, OperatorOrder, Stabilisation,
};
use piola_runtime::energy::{EnergyParts, TotalEnergy};

use crate::common::st_venant_kirchhoff;

/// Points per side: the middle is out of reach of the surface, 6 spacings deep.
const SIDE: usize = 15;
const SPACING: f64 = 0.025;

/// Energy density in the middle of the cube, and the energy of the whole.
fn middle(discretisation: Discretisation) -> (f64, EnergyParts) {
    let n = SIDE;
    let cell = |p: usize| [p / (n * n), p / n % n, p % n];
    let positions: Vec<f64> = (0..n * n * n).flat_map(cell).map(|k| k as f64 * SPACING).collect();
    let volume = SPACING * SPACING * SPACING;
    let body = Arc::new(Body::new(3, &positions, &vec![volume; n * n * n], Some(SPACING)));
    let law = st_venant_kirchhoff(3, 210e9, 0.25);
    let formulation = Formulation {
        horizon: 3.015 * SPACING,
        order: OperatorOrder::First,
        discretisation,
        influence: &Constant,
    };
    let energy = Correspondence::new(Arc::clone(&body), formulation, law).unwrap();
    let mut u = Vec::new();
    for x in body.positions().chunks_exact(3) {
        // cos(pi k) of the number of the layer.
        let sign = |a: usize| if libm::round(x[a] / SPACING) % 2.0 == 0.0 { 1.0 } else { -1.0 };
        for (p, q) in [(1, 2), (0, 2), (0, 1)] {
            u.push(1e-3 * SPACING * sign(p) * sign(q));
        }
    }
    let densities = body.to_user_order(&energy.energy_densities(&u).unwrap(), 1);
    let centre = (n / 2 * n + n / 2) * n + n / 2;
    (densities[centre], energy.energy(&u).unwrap())
}

#[test]
fn only_bonds_see_what_alternates() {
    let (density, _) = middle(Discretisation::Nodal);
    println!("CC {density:e}");
    assert!(density < 1e-15);
    // The energy of the deformation gradients is the same with stabilisation; that of the deviations
    // is not zero.
    let (density, parts) = middle(Discretisation::Stabilised(Stabilisation::Wan));
    println!("CW {density:e}");
    assert!(density > 1e5 && parts.stabilisation > parts.deformation);
    let (density, _) = middle(Discretisation::BondQuadrature);
    println!("BAQP {density:.6}");
    assert!((density / 103766.447660 - 1.0).abs() < 1e-11, "{density}");
}
