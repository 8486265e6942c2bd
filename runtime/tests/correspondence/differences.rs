//! Products by differences of forces, for energies of deformation gradients.

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::deformation::influence::CubicSpline;
use piola_runtime::deformation::{
    DeformationEnergy, Discretisation, Formulation, OperatorOrder, Stabilisation,
};

use crate::common::{cloud, displacements, h_of, st_venant_kirchhoff};
use crate::shared::{bits_do_not_depend_on_threads, equilibria_are_the_same, units_do_not_matter};

const MODELS: [Discretisation; 2] =
    [Discretisation::BondQuadrature, Discretisation::Stabilised(Stabilisation::Wan)];

/// Energy, displacements and a direction, lengths and moduli multiplied.
fn subject(
    discretisation: Discretisation,
    length: f64,
    modulus: f64,
) -> (DeformationEnergy, Vec<f64>, Vec<f64>) {
    let unit = cloud(&[7, 4, 4], 3);
    let scaled = |x: &[f64], by: f64| -> Vec<f64> { x.iter().map(|x| by * x).collect() };
    let volume = length * length * length;
    let (positions, volumes) = (scaled(unit.positions(), length), scaled(unit.volumes(), volume));
    let body = Arc::new(Body::new(3, &positions, &volumes, None));
    let horizon = 2.3 * length;
    let formulation = Formulation {
        horizon,
        order: OperatorOrder::First,
        discretisation,
        influence: &CubicSpline { dimension: 3, horizon },
    };
    let law = st_venant_kirchhoff(3, 210.0 * modulus, 0.3);
    let energy = DeformationEnergy::new(body, formulation, law).unwrap();
    let u = scaled(&displacements(&unit, &h_of(3), 0.01, 5), length);
    (energy, u, displacements(&unit, &h_of(3), 1.0, 9))
}

#[test]
fn units_of_length_and_of_force_do_not_matter() {
    for discretisation in MODELS {
        units_do_not_matter(|length, modulus| subject(discretisation, length, modulus));
    }
}

#[test]
fn differences_lead_to_the_same_equilibrium() {
    for discretisation in MODELS {
        let (energy, u, _) = subject(discretisation, 1e-9, 1e9);
        equilibria_are_the_same(&energy, &u);
    }
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let (energy, u, _) = subject(Discretisation::BondQuadrature, 1.0, 1.0);
    bits_do_not_depend_on_threads(&energy, &u);
}
