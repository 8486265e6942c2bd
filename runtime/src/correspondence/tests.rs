//! What is built, and when.

use super::influence::Constant;
use super::*;
use crate::kernel::Variables;
use crate::solve::constraint::Constraints;
use crate::solve::linear::{LinearMethod, LinearOptions};
use crate::solve::newton::{Newton, NewtonSettings};

/// `psi = 1/2 H:H`.
struct Linear;

impl VariablesLaw for Linear {
    fn n_variables(&self) -> usize {
        4
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        for p in 0..at.n {
            psi[p] = (0..4)
                .fold(0.0, |sum, k| sum + 0.5 * at.change[k * at.n + p] * at.change[k * at.n + p]);
        }
        if !gradient.is_empty() {
            gradient.copy_from_slice(at.change);
        }
    }

    fn product(&self, _at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        product.copy_from_slice(direction);
    }
}

fn energy(discretisation: Discretisation) -> Correspondence {
    let positions: Vec<f64> = (0..60).flat_map(|k| [f64::from(k / 6), f64::from(k % 6)]).collect();
    let body = Arc::new(Body::new(2, &positions, &[1.0; 60], Some(1.0)));
    let formulation = Formulation {
        horizon: 1.5,
        order: OperatorOrder::First,
        discretisation,
        influence: &Constant,
    };
    Correspondence::new(body, formulation, Box::new(Linear)).unwrap()
}

#[test]
fn the_pattern_of_the_tangent_is_built_only_where_it_is_stored() {
    for method in [LinearMethod::Auto, LinearMethod::MatrixFree, LinearMethod::Cholesky] {
        let energy = energy(Discretisation::BondQuadrature);
        let constraints = Constraints::new(120, &(0..24).collect::<Vec<usize>>()).unwrap();
        let options = LinearOptions { method, ..LinearOptions::default() };
        let mut newton =
            Newton::new(&energy, &constraints, NewtonSettings::default(), options).unwrap();
        let (mut u, mut loads) = (vec![0.0; 120], vec![0.0; 120]);
        loads[118] = 0.01;
        newton.solve(&mut u, &loads).unwrap();
        assert_eq!(energy.pattern.get().is_some(), method == LinearMethod::Cholesky);
    }
}

#[test]
fn patterns_are_the_reach_of_the_energy() {
    // In a lattice with horizon 1.5 neighbours are those of a king's move.
    for (discretisation, reach) in [(Discretisation::Nodal, 2), (Discretisation::BondQuadrature, 3)]
    {
        let energy = energy(discretisation);
        let pattern = energy.pattern();
        for i in 0..60 {
            let columns = &pattern.columns[pattern.row_start[i]..pattern.row_start[i + 1]];
            let near = |j: &u32| {
                let offset = |a: usize| {
                    let (x, y) = (energy.body.position(i)[a], energy.body.position(*j as usize)[a]);
                    (x - y).abs() <= f64::from(reach)
                };
                offset(0) && offset(1)
            };
            let expected: Vec<u32> = (i as u32..60).filter(near).collect();
            assert_eq!(columns, expected);
        }
    }
}
