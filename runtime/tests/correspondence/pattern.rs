//! What is built for a stored Hessian, and when.

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::deformation::influence::Constant;
use piola_runtime::deformation::{DeformationEnergy, Discretisation, Formulation, OperatorOrder};
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::{LinearMethod, LinearOptions};
use piola_runtime::solve::newton::{Newton, NewtonSettings};

use crate::common::st_venant_kirchhoff;

#[test]
fn the_pattern_of_the_tangent_is_built_only_where_it_is_stored() {
    for method in [LinearMethod::Auto, LinearMethod::MatrixFree, LinearMethod::Cholesky] {
        let positions: Vec<f64> =
            (0..60).flat_map(|k| [f64::from(k / 6), f64::from(k % 6)]).collect();
        let body = Arc::new(Body::new(2, &positions, &[1.0; 60], Some(1.0)));
        let formulation = Formulation {
            horizon: 1.5,
            order: OperatorOrder::First,
            discretisation: Discretisation::BondQuadrature,
            influence: &Constant,
        };
        let law = st_venant_kirchhoff(2, 1.0, 0.0);
        let energy = DeformationEnergy::new(body, formulation, law).unwrap();
        let constraints = Constraints::new(120, &(0..24).collect::<Vec<usize>>()).unwrap();
        let options = LinearOptions { method, ..LinearOptions::default() };
        let mut newton =
            Newton::new(&energy, &constraints, NewtonSettings::default(), options).unwrap();
        let (mut u, mut loads) = (vec![0.0; 120], vec![0.0; 120]);
        loads[118] = 0.01;
        newton.solve(&mut u, &loads).unwrap();
        assert_eq!(energy.has_pattern(), method == LinearMethod::Cholesky);
    }
}
