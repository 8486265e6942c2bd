//! Products by differences of forces, for energies of gathered states.

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::states::StateEnergy;

use crate::common::{cloud, displacements, h_of};
use crate::shared::{bits_do_not_depend_on_threads, equilibria_are_the_same, units_do_not_matter};
use crate::{energy, solid};

/// Energy, displacements and a direction, lengths and moduli multiplied.
fn subject(length: f64, modulus: f64) -> (StateEnergy, Vec<f64>, Vec<f64>) {
    let unit = cloud(&[7, 4, 4], 3);
    let scaled = |x: &[f64], by: f64| -> Vec<f64> { x.iter().map(|x| by * x).collect() };
    let volume = length * length * length;
    let (positions, volumes) = (scaled(unit.positions(), length), scaled(unit.volumes(), volume));
    let body = Arc::new(Body::new(3, &positions, &volumes, None));
    let moduli = [("K", 2.0 * modulus), ("G", 0.7 * modulus)];
    let energy = energy(&solid("1/L"), &moduli, &body, 2.3 * length);
    let u = scaled(&displacements(&unit, &h_of(3), 0.01, 5), length);
    (energy, u, displacements(&unit, &h_of(3), 1.0, 9))
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
