//! Displacements that alternate from point to point (partmann2026 4.44): what sees them. Models of
//! bonds and of gathered states are in the tests of states.

use std::sync::Arc;

use piola_runtime::deformation::influence::Constant;
use piola_runtime::deformation::{
    DeformationEnergy, Discretisation, Formulation, OperatorOrder, Stabilisation,
};
use piola_runtime::energy::Energy as _;
use piola_runtime::kernel::Variables;

use crate::common::{Checkerboard, st_venant_kirchhoff};

/// In Pa.
const YOUNG: f64 = 210e9;
const POISSON: f64 = 0.25;

/// What the middle of the cube stores, in J/m^3: by its deformation gradient, and in all.
fn middle(at: &Checkerboard, discretisation: Discretisation) -> [f64; 2] {
    let law = || st_venant_kirchhoff(3, YOUNG, POISSON);
    let formulation = Formulation {
        horizon: at.horizon,
        order: OperatorOrder::First,
        discretisation,
        influence: &Constant,
    };
    let energy = DeformationEnergy::new(Arc::clone(&at.body), formulation, law()).unwrap();
    let h = &energy.displacement_gradients(&at.u)[9 * at.centre..9 * at.centre + 9];
    let mut f = h.to_vec();
    f.iter_mut().step_by(4).for_each(|f| *f += 1.0);
    let mut of_gradient = [0.0];
    law().evaluate(
        Variables { n: 1, current: &f, change: h, given: &[], laws: &[] },
        &mut of_gradient,
        &mut [],
    );
    [of_gradient[0], energy.densities(&at.u, energy.body().volumes()).unwrap()[at.centre]]
}

#[test]
fn deformation_gradients_of_points_do_not_see_what_alternates() {
    let at = Checkerboard::new();
    let bulk = YOUNG / (3.0 * (1.0 - 2.0 * POISSON));
    // C_s C_b of (4.11), C_s = 0.5 m^2 and C_b = 18K/(pi delta^4).
    let squared = at.horizon * at.horizon;
    let stiffness = 0.5 * 18.0 * bulk / (std::f64::consts::PI * squared * squared);
    for (name, discretisation) in [
        ("CC", Discretisation::Nodal),
        ("CS", Discretisation::Stabilised(Stabilisation::Silling { stiffness })),
        ("CW", Discretisation::Stabilised(Stabilisation::Wan)),
        ("CI", Discretisation::Stabilised(Stabilisation::Isotropic)),
    ] {
        let [of_gradient, whole] = middle(&at, discretisation);
        println!("{name} {of_gradient:e} {whole:e}");
        // Nothing but the rounding of displacements of 25e-6 m: `E (u 1e-3)^2` is 3e-27.
        assert!(of_gradient < 8e-26, "{name}: {of_gradient:e}");
        let deviations = match name {
            "CC" => 0.0,
            // Deviations are differences of displacements here: C_s C_b/2 times their mean square.
            "CS" => 0.5 * stiffness * mean_square(&at),
            // K is isotropic, (m/3) I with m the mean square of lengths times the sum of volumes, and
            // with it A: it is its own isotropic part.
            _ => 0.5 * wan(bulk, at.horizon) * mean_square(&at),
        };
        // Measured are 2.3e-15.
        let error = (whole - deviations).abs();
        assert!(error <= 1e-14 * deviations + 8e-26, "{name}: {whole}");
    }
}

#[test]
fn those_of_bonds_do() {
    let [of_gradient, whole] = middle(&Checkerboard::new(), Discretisation::BondQuadrature);
    println!("BAQP {whole:.6}");
    assert!(of_gradient < 8e-26);
    // Half a unit of its last digit.
    assert!((whole - 103766.447660).abs() < 0.5e-6, "{whole}");
}

/// Offsets of the neighbours of a point inside, in spacings.
fn offsets() -> impl Iterator<Item = [i32; 3]> {
    let all = (0..343).map(|k| [k / 49 - 3, k / 7 % 7 - 3, k % 7 - 3]);
    // 3.015^2 = 9.09.
    all.filter(|o| (1..=9).contains(&o.iter().map(|x| x * x).sum::<i32>()))
}

/// The mean square of `u_j - u_i` over a family inside.
fn mean_square(at: &Checkerboard) -> f64 {
    let flips = |o: [i32; 3]| {
        let odd = |p: usize, q: usize| f64::from((o[p] + o[q]).rem_euclid(2));
        4.0 * (odd(1, 2) + odd(0, 2) + odd(0, 1))
    };
    let sum: f64 = offsets().map(flips).sum();
    at.amplitude * at.amplitude * sum / offsets().count() as f64
}

/// `A` of (4.13) times the sum of volumes: `(3 lambda + 2 mu) sum V/(m/3)`, `m` the sum of `V L^2`.
fn wan(bulk: f64, horizon: f64) -> f64 {
    let spacing = horizon / 3.015;
    let squares: i32 = offsets().map(|o| o.iter().map(|x| x * x).sum::<i32>()).sum();
    3.0 * bulk * 3.0 * offsets().count() as f64 / (f64::from(squares) * spacing * spacing)
}
