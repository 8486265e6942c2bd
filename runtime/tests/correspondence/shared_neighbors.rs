//! Energies of one body that share what neighbours it has.

use std::sync::Arc;

use piola_runtime::assembly::{DiscreteEnergy, Elements, Laws};
use piola_runtime::deformation::influence::Constant;
use piola_runtime::deformation::{DeformationEnergy, Discretisation, Formulation, OperatorOrder};
use piola_runtime::energy::Energy;
use piola_runtime::kernel::{Batch, Law, Order, Outputs};
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::states::{StateEnergy, StateLaws};
use piola_runtime::weights::Weights;

use crate::common::{cloud, displacements, h_of, st_venant_kirchhoff};

const HORIZON: f64 = 2.3;

/// `psi = 1/2 L e^2`.
fn spring() -> Box<dyn Law> {
    Box::new(|bonds: Batch<'_>, order: Order, out: Outputs<'_>| {
        for (k, (rest, e)) in bonds.reference.iter().zip(bonds.change).enumerate() {
            out.psi[k] = 0.5 * rest * e * e;
            if order >= Order::Force {
                out.dpsi[k] = *e;
            }
            if order == Order::Tangent {
                out.d2psi[k] = 1.0 / rest;
            }
        }
    })
}

fn elements() -> Elements {
    Laws { bond: Some(spring()), ..Laws::default() }.into_elements(2)
}

/// Gathers the energies of its bonds and has none itself.
fn gathering() -> StateLaws {
    let arguments = ["theta", "l"].map(String::from);
    StateLaws {
        of_law: Vec::new(),
        integrals: vec![spring()],
        points: None,
        bonds: None,
        arguments,
    }
}

#[test]
fn shared_neighbours_are_those_that_each_energy_finds() {
    let body = cloud(&[9, 6], 7);
    let u = displacements(&body, &h_of(2), 0.01, 9);
    let shared = Arc::new(Neighborhood::new(&body, HORIZON).unwrap());
    let formulation = || Formulation {
        horizon: HORIZON,
        order: OperatorOrder::First,
        discretisation: Discretisation::Nodal,
        influence: &Constant,
    };
    let law = || st_venant_kirchhoff(2, 210.0, 0.3);
    let (known, weights) = (|| (Arc::clone(&body), Arc::clone(&shared)), Weights::Volumes);
    let bonds = DiscreteEnergy::among(known().0, known().1, weights, elements()).unwrap();
    let states = StateEnergy::among(known().0, known().1, gathering()).unwrap();
    let gradients = DeformationEnergy::among(known().0, known().1, formulation(), law()).unwrap();
    assert_eq!(Arc::strong_count(&shared), 4, "each energy keeps the list, and none a copy");
    for neighborhood in [bonds.neighborhood(), states.neighborhood(), gradients.neighborhood()] {
        assert!(std::ptr::eq(neighborhood, &*shared));
    }
    let alone = [
        DiscreteEnergy::with_elements(known().0, HORIZON, weights, elements())
            .unwrap()
            .energy(&u)
            .unwrap(),
        DeformationEnergy::new(known().0, formulation(), law()).unwrap().energy(&u).unwrap(),
    ];
    assert!(alone.iter().all(|parts| parts.total() > 0.0));
    assert_eq!([bonds.energy(&u).unwrap(), gradients.energy(&u).unwrap()], alone);
    let found = StateEnergy::new(known().0, HORIZON, gathering()).unwrap().integrals(&u);
    assert_eq!(states.integrals(&u), found);
}
