//! Products by differences of forces, for energies of bonds and triangles.

use std::sync::Arc;

use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::weights::Weights;

use crate::common::{cloud, displacements, laws};
use crate::shared::{bits_do_not_depend_on_threads, equilibria_are_the_same, units_do_not_matter};

/// Energy, displacements and a direction, lengths and moduli multiplied.
fn subject(length: f64, modulus: f64) -> (DiscreteEnergy, Vec<f64>, Vec<f64>) {
    let unit = cloud(&[8, 4, 4], 1.0, 3);
    let scaled = |x: &[f64], by: f64| -> Vec<f64> { x.iter().map(|x| by * x).collect() };
    let volume = length * length * length;
    let (positions, volumes) = (scaled(unit.positions(), length), scaled(unit.volumes(), volume));
    let body = Arc::new(Body::new(3, &positions, &volumes, None));
    // The densities of bonds are in J/m^7, those of triangles in J/m^11.
    let to_4 = length * length * length * length;
    let laws = laws([modulus, 0.1 * modulus / to_4, 0.0], 2);
    let energy = DiscreteEnergy::new(body, 2.1 * length, Weights::Truncated, laws).unwrap();
    let u = scaled(&displacements(&unit, 0.05, 5), length);
    (energy, u, displacements(&unit, 1.0, 17))
}

#[test]
fn units_of_length_and_of_force_do_not_matter() {
    units_do_not_matter(subject);
}

#[test]
fn differences_lead_to_the_same_equilibrium() {
    let (energy, u, _) = subject(1e-9, 1e9);
    equilibria_are_the_same(&energy, &u);
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let (energy, u, _) = subject(1.0, 1.0);
    bits_do_not_depend_on_threads(&energy, &u);
}
