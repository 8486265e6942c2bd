//! What cannot be modelled is named in the user's order.

use std::sync::Arc;

use piola_runtime::assembly::AssemblyError;
use piola_runtime::body::Body;
use piola_runtime::deformation::influence::{Constant, Influence};
use piola_runtime::deformation::{
    DeformationEnergy, DeformationError, Discretisation, Formulation, OperatorOrder,
};
use piola_runtime::energy::{Argument, Energy};
use piola_runtime::kernel::{Variables, VariablesLaw};

use crate::common::{cloud, displacements, st_venant_kirchhoff};

fn make(
    body: &Arc<Body>,
    order: OperatorOrder,
    discretisation: Discretisation,
    influence: &dyn Influence,
    law: Box<dyn VariablesLaw>,
) -> Result<DeformationEnergy, DeformationError> {
    let formulation = Formulation { horizon: 1.6, order, discretisation, influence };
    DeformationEnergy::new(Arc::clone(body), formulation, law)
}

fn refused(body: &Body, order: OperatorOrder, influence: &dyn Influence) -> DeformationError {
    let law = st_venant_kirchhoff(3, 210.0, 0.3);
    make(&Arc::new(body.clone()), order, Discretisation::BondQuadrature, influence, law)
        .err()
        .unwrap()
}

/// A cube of 3^3 points and behind it a plate of 3^2, the plate listed first.
fn cube_and_plate() -> Body {
    let mut positions: Vec<f64> = Vec::new();
    for p in 0..9 {
        positions.extend([9.0, f64::from(p / 3), f64::from(p % 3)]);
    }
    for p in 0..27 {
        positions.extend([f64::from(p / 9), f64::from(p / 3 % 3), f64::from(p % 3)]);
    }
    Body::new(3, &positions, &[1.0; 36], None)
}

#[test]
fn flat_families_are_named_with_their_condition() {
    let error = refused(&cube_and_plate(), OperatorOrder::First, &Constant);
    let DeformationError::ShapeTensor { point, neighbors, condition, count, .. } = &error else {
        panic!("{error}");
    };
    assert!(*point < 9 && *count == 9 && *condition > 1e15, "{error}");
    assert!(*neighbors == 3 || *neighbors == 5 || *neighbors == 8);
    let text = error.to_string();
    assert!(text.contains(&format!("shape tensor of point {point} ")), "{text}");
    assert!(text.contains("condition number is") && text.contains("9 points have"), "{text}");
}

#[test]
fn too_few_neighbours_for_second_order_are_named() {
    let cube: Vec<f64> = cube_and_plate().positions()[..].to_vec();
    let cube: Vec<f64> = cube.chunks_exact(3).filter(|x| x[0] < 5.0).flatten().copied().collect();
    let error = refused(&Body::new(3, &cube, &[1.0; 27], None), OperatorOrder::Second, &Constant);
    let few = matches!(error, DeformationError::ShapeTensor { functions: 9, neighbors: 6, .. });
    assert!(few, "{error}");
}

#[test]
fn influence_functions_must_be_finite_and_count_something() {
    let body = cloud(&[4, 4, 4], 2);
    let infinite = |length: f64| 1.0 / (length - length);
    let error = refused(&body, OperatorOrder::First, &infinite);
    assert!(matches!(error, DeformationError::Influence { .. }), "{error}");
    // The one that is not finite is named with the length of its bond.
    let long = |length: f64| if length > 1.55 { f64::NAN } else { length };
    let error = refused(&body, OperatorOrder::First, &long);
    let DeformationError::Influence { length, value } = error else { panic!("{error}") };
    assert!(length > 1.55 && length <= 1.6 && value.is_nan(), "{length}");
    let error = refused(&body, OperatorOrder::First, &|_: f64| 0.0);
    assert!(matches!(error, DeformationError::ShapeTensor { .. }), "{error}");
    let error = refused(&body, OperatorOrder::First, &|_: f64| -1.0);
    assert!(matches!(error, DeformationError::NoInfluence { .. }), "{error}");
}

#[test]
fn bodies_and_laws_must_fit() {
    let lonely = Body::new(3, &[0.0, 0.0, 0.0, 5.0, 0.0, 0.0], &[1.0; 2], None);
    let error = refused(&lonely, OperatorOrder::First, &Constant);
    assert!(matches!(error, DeformationError::Body(AssemblyError::Isolated { .. })), "{error}");
    let plane = cloud(&[4, 4], 1);
    let error = refused(&plane, OperatorOrder::First, &Constant);
    assert!(matches!(error, DeformationError::WrongLaw { found: 9, dimension: 2 }), "{error}");
}

/// A law that ends at a stretch of 1.5.
struct Limited(Box<dyn VariablesLaw>);

impl VariablesLaw for Limited {
    fn n_variables(&self) -> usize {
        self.0.n_variables()
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        self.0.evaluate(at, psi, gradient);
        for p in 0..at.n {
            if at.change[p] > 0.5 {
                psi[p] = f64::INFINITY;
            }
        }
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        self.0.product(at, direction, product);
        for p in 0..at.n {
            if at.change[p] > 0.5 {
                product[p] = f64::NAN;
            }
        }
    }
}

#[test]
fn the_place_whose_energy_is_not_finite_is_named() {
    let body = cloud(&[6, 6], 1);
    let mut u = displacements(&body, &[0.0; 4], 0.0, 1);
    let far = body.n_points() - 1;
    u[2 * far] = 3.0;
    for (discretisation, n_points) in
        [(Discretisation::Nodal, 1), (Discretisation::BondQuadrature, 2)]
    {
        let law = Box::new(Limited(st_venant_kirchhoff(2, 210.0, 0.3)));
        let energy = make(&body, OperatorOrder::First, discretisation, &Constant, law).unwrap();
        let mut out = vec![0.0; u.len()];
        let errors = [energy.energy(&u).unwrap_err(), energy.forces(&u, &mut out).unwrap_err()];
        energy.hessian(&u).unwrap().multiply(&u, &mut out);
        assert!(out.iter().all(|x| x.is_nan()));
        for error in errors {
            assert_eq!(error.argument, Argument::DeformationGradient);
            assert_eq!((error.points.len(), error.displacements.len()), (n_points, 2 * n_points));
            assert!(error.value > 1.0 && error.reference == 1.0, "{error}");
            assert!(error.to_string().contains("determinant"), "{error}");
        }
    }
}

/// A homogeneous deformation gradient, one triangular factor times another.
#[test]
fn the_determinant_of_the_place_is_named() {
    let f = [1.6, 0.4, -0.3, 0.8, 1.7, 0.25, -0.32, 0.22, 1.11];
    // Rows of (1 0 0, 0.5 1 0, -0.2 0.2 1) times rows of (1.6 0.4 -0.3, 0 1.5 0.4, 0 0 0.97).
    let determinant = 1.6 * 1.5 * 0.97;
    let h: Vec<f64> = (0..9).map(|k| f[k] - if k % 4 == 0 { 1.0 } else { 0.0 }).collect();
    let body = cloud(&[4, 4, 4], 1);
    let u = displacements(&body, &h, 0.0, 1);
    for discretisation in [Discretisation::Nodal, Discretisation::BondQuadrature] {
        let law = Box::new(Limited(st_venant_kirchhoff(3, 210.0, 0.3)));
        let order = OperatorOrder::First;
        let formulation = Formulation { horizon: 2.8, order, discretisation, influence: &Constant };
        let energy = DeformationEnergy::new(Arc::clone(&body), formulation, law).unwrap();
        let error = energy.energy(&u).unwrap_err();
        assert!((error.value / determinant - 1.0).abs() < 1e-12, "{error}");
    }
}
