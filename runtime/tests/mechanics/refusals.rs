//! What cannot be assembled is refused by name.

use std::sync::Arc;

use num_dual::HyperDual64;
use piola_compiler::{Form, Level, Mode, Setting, check_text};
use piola_runtime::assembly::{AssemblyError, DiscreteEnergy, Elements, Laws};
use piola_runtime::body::Body;
use piola_runtime::element::{CoordinateElement, Element, MeasureElement};
use piola_runtime::energy::Energy;
use piola_runtime::kernel::{Batch, Law, Measure, Order, Outputs};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::NeighborhoodError;
use piola_runtime::weights::{Weights, WeightsError};

use crate::common::{Random, lattice, laws, seth_hill};

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

/// A law whose psi and psi' vanish at rest, where psi'' is infinite; by the square of its measure or
/// by the measure itself.
fn pointed(measure: Measure, dimension: usize, by_square: bool) -> Laws {
    let (m, big) = (measure.symbol(), measure.reference_symbol());
    let power = if by_square { "^2" } else { "" };
    let text = format!("potential p\npsi({m}) = {big}*abs(({m}/{big}){power} - 1)^1.5\n");
    let (_, model) = check_text(&text).unwrap();
    let settings: [(String, Setting); 0] = [];
    let values = model.values(dimension, &settings, Some(3.0)).unwrap();
    let kernels = model.compile(&values, Mode::Jit(Level::Fast), Form::Accurate).unwrap().kernels;
    let kernel = kernels.into_iter().next().unwrap();
    assert_eq!(kernel.squared().is_some(), by_square && !measure.is_signed(dimension));
    let law: Option<Box<dyn Law>> = Some(Box::new(kernel));
    match measure {
        Measure::Length => Laws { bond: law, ..Laws::default() },
        Measure::Area => Laws { triangle: law, ..Laws::default() },
        Measure::Volume => Laws { tetrahedron: law, ..Laws::default() },
    }
}

/// One interaction is at rest, all others are not.
#[test]
fn an_infinite_second_derivative_is_refused_where_it_is_asked_for() {
    use Measure::{Area, Length, Volume};
    for (measure, dimension) in [(Length, 2), (Length, 3), (Area, 2), (Area, 3), (Volume, 3)] {
        // The tetrahedron at rest is thin with the first seed, and with the second it is not.
        for (by_square, seed) in [(false, 5), (true, 5), (false, 3), (true, 3)] {
            let n_corners = measure.points();
            let mut random = Random(seed);
            // A cloud of seven points in a box smaller than the horizon, the corners at rest first.
            let positions = random.vector(7 * dimension);
            let mut u: Vec<f64> = random.vector(7 * dimension).iter().map(|x| 0.1 * x).collect();
            u[..n_corners * dimension].fill(0.0);
            let body = Arc::new(Body::new(dimension, &positions, &[1.0; 7], None));
            let u = body.from_user_order(&u, dimension);
            let laws = pointed(measure, dimension, by_square);
            let energy = DiscreteEnergy::new(Arc::clone(&body), 4.0, Weights::Unit, laws).unwrap();
            let mut gradient = vec![0.0; u.len()];
            assert!(energy.energy(&u).unwrap().total() > 0.0);
            energy.forces(&u, &mut gradient).unwrap();
            let mut matrix = BlockMatrix::zeros(energy.pattern());
            let mut diagonal = vec![0.0; u.len() * dimension];
            let mut product = vec![0.0; u.len()];
            energy.hessian(&u).unwrap().multiply(&u, &mut product);
            assert!(product.iter().all(|x| x.is_nan()));
            for error in [
                energy.tangent(&u, &mut gradient, &mut matrix).unwrap_err(),
                energy.tangent_diagonal(&u, &mut gradient, &mut diagonal).unwrap_err(),
            ] {
                let user = |&point: &usize| body.user_index()[point] as usize;
                let mut points: Vec<usize> = error.points.iter().map(user).collect();
                points.sort_unstable();
                let corners: Vec<usize> = (0..n_corners).collect();
                assert_eq!(points, corners, "{error}");
                assert!((error.value / error.reference - 1.0).abs() < 1e-15, "{error}");
            }
        }
    }
}

/// An energy that ends at collapse, or beyond it, keeps interactions with a sign from turning inside
/// out, in both elements; one that goes on does not.
#[test]
fn energies_that_end_forbid_inversion() {
    type Psi = fn(f64) -> f64;
    let energies: [(&str, bool, Psi); 4] = [
        ("square", false, |x| (x - 1.0) * (x - 1.0)),
        ("root", true, |x| x.sqrt() - 0.5 * x),
        ("logarithm", true, |x| libm::log(x) * libm::log(x)),
        ("inverse", true, |x| 1.0 / x + x),
    ];
    for (name, expected, psi) in energies {
        for (measure, dimension) in [(Measure::Area, 2), (Measure::Volume, 3), (Measure::Area, 3)] {
            let law = move |batch: Batch<'_>, _: Order, out: Outputs<'_>| {
                // By the change, as accurate forms are.
                for (psi_of, e) in out.psi.iter_mut().zip(batch.change) {
                    *psi_of = psi(1.0 + e);
                }
            };
            let of_measure = MeasureElement::new(measure, dimension, Box::new(law));
            let energy = move |m: HyperDual64, _: f64| HyperDual64::from_re(psi(m.re));
            let of_coordinates = CoordinateElement::new(measure, dimension, energy);
            let expected = expected && measure.is_signed(dimension);
            assert_eq!(of_measure.forbids_inversion(), expected, "{name} {measure:?}");
            assert_eq!(of_coordinates.forbids_inversion(), expected, "{name} {measure:?}");
        }
    }
}
