//! What cannot be assembled is refused by name.

use std::sync::Arc;

use piola_runtime::assembly::{AssemblyError, DiscreteEnergy, Elements, Laws};
use piola_runtime::body::Body;
use piola_runtime::element::MeasureElement;
use piola_runtime::kernel::Measure;
use piola_runtime::neighborhood::NeighborhoodError;
use piola_runtime::weights::{Weights, WeightsError};

use crate::common::{lattice, laws, seth_hill};

fn refuse(body: Arc<Body>, horizon: f64, weights: Weights, laws: Laws) -> AssemblyError {
    match DiscreteEnergy::new(body, horizon, weights, laws) {
        Err(error) => error,
        Ok(_) => panic!("accepted"),
    }
}

fn bonds() -> Laws {
    laws([1.0, 0.0, 0.0], 1)
}

fn points(positions: &[f64], volumes: &[f64]) -> Arc<Body> {
    Arc::new(Body::new(2, positions, volumes, None))
}

#[test]
fn points_without_neighbors_are_listed_in_the_users_order() {
    let body = points(&[9.0, 0.0, 0.0, 0.0, 0.5, 0.0, -7.0, 1.0], &[1.0; 4]);
    let error = refuse(body, 1.0, Weights::Volumes, bonds());
    let AssemblyError::Isolated { count: 2, first, .. } = &error else { panic!("{error}") };
    assert_eq!(first, &[(0, vec![9.0, 0.0]), (3, vec![-7.0, 1.0])]);
    assert!(error.to_string().contains("point 0 at [9.0, 0.0] m, point 3"), "{error}");
    let scattered: Vec<f64> = (0..20).map(f64::from).collect();
    let error = refuse(points(&scattered, &[1.0; 10]), 1.0, Weights::Volumes, bonds());
    assert!(error.to_string().starts_with("10 points") && error.to_string().contains(", .."));
}

#[test]
fn bad_input_is_named() {
    let pair = [0.0, 0.0, 0.5, 0.0];
    let error = refuse(points(&pair, &[1.0, -2.0]), 1.0, Weights::Unit, bonds());
    assert!(matches!(&error, AssemblyError::Weights(WeightsError::Volume { point: 1, .. })));
    assert!(error.to_string().contains("-2 m^2"), "{error}");
    let error = refuse(points(&pair, &[1.0; 2]), -1.0, Weights::Unit, bonds());
    let horizon = NeighborhoodError::Horizon { horizon: -1.0 };
    assert_eq!(error, AssemblyError::Neighborhood(horizon));
    let error = refuse(points(&pair, &[1.0; 2]), 1.0, Weights::Uniform, bonds());
    assert_eq!(error, AssemblyError::Weights(WeightsError::UniformCloud));
    let error =
        refuse(points(&[0.0, f64::INFINITY, 0.5, 0.0], &[1.0; 2]), 1.0, Weights::Unit, bonds());
    assert!(matches!(error, AssemblyError::Neighborhood(NeighborhoodError::NonFinite { .. })));
    assert_eq!(refuse(points(&[], &[]), 1.0, Weights::Unit, bonds()), AssemblyError::Empty);
}

#[test]
fn energies_must_fit_the_body() {
    let plane = lattice(&[0.0, 0.0], &[2, 2], 1.0);
    let error = refuse(Arc::clone(&plane), 1.0, Weights::Uniform, Laws::default());
    assert_eq!(error, AssemblyError::NoEnergy);
    let error = refuse(Arc::clone(&plane), 1.0, Weights::Uniform, laws([1.0, 1.0, 1.0], 1));
    assert_eq!(error, AssemblyError::VolumeInPlane { dimension: 2 });
    let element = MeasureElement::new(Measure::Area, 2, seth_hill(1.0, 1));
    let elements = Elements { bond: Some(Box::new(element)), ..Elements::default() };
    let result = DiscreteEnergy::with_elements(plane, 1.0, Weights::Uniform, elements);
    let error = result.err().unwrap();
    assert!(error.to_string().starts_with("an element for psi(a) in 2 dimensions"), "{error}");
}
