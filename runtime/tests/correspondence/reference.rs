//! All correspondence models of a cloud of 30 points, worked out by another program with complex
//! steps.

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::correspondence::{Discretisation, OperatorOrder, Stabilisation};
use piola_runtime::energy::TotalEnergy;

use crate::common::{energy, error, numbers, reference};

#[test]
fn energies_forces_and_products_are_those_of_the_reference() {
    let data = &reference("correspondence_cloud_A.json")["cloud_A"];
    let take = |name: &str| numbers(&data[name]);
    let horizon = data["delta"].as_f64().unwrap();
    let bond_constant = data["Cb"].as_f64().unwrap();
    let body = Arc::new(Body::new(3, &take("X"), &take("V"), None));
    let (u, v) = (body.from_user_order(&take("u"), 3), body.from_user_order(&take("v"), 3));
    let n = body.n_points();
    for kernel in ["one", "cubic"] {
        let silling = Stabilisation::Silling { stiffness: 0.5 * bond_constant };
        for (model, discretisation) in [
            (format!("CC_{kernel}"), Discretisation::Nodal),
            (format!("CS_{kernel}_Cs0.5"), Discretisation::Stabilised(silling)),
            (format!("CW_{kernel}"), Discretisation::Stabilised(Stabilisation::Wan)),
            (format!("BAQP_{kernel}"), Discretisation::BondQuadrature),
        ] {
            let expected = &data["models"][&model];
            let energy = energy(&body, horizon, OperatorOrder::First, discretisation, kernel);
            let of_points = |x: &[f64]| {
                // Force densities: minus the derivative over the volume.
                let density = |(dof, x): (usize, &f64)| -x / body.volumes()[dof / 3];
                body.to_user_order(&x.iter().enumerate().map(density).collect::<Vec<f64>>(), 3)
            };
            let (mut gradient, mut product) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
            let parts = energy.gradient(&u, &mut gradient).unwrap();
            energy.tangent_product(&u, &v, &mut product).unwrap();
            let total = expected["W"].as_f64().unwrap();
            let errors = [
                (parts.total() / total - 1.0).abs(),
                (energy.energy(&u).unwrap().total() / total - 1.0).abs(),
                error(&of_points(&gradient), &numbers(&expected["b"])),
                error(&of_points(&product), &numbers(&expected["Hv"])),
            ];
            println!("{model}: {errors:?}");
            assert!(errors.iter().all(|&e| e < 1e-12), "{model}: {errors:?}");
            let densities = body.to_user_order(&energy.energy_densities(&u).unwrap(), 1);
            assert!(error(&densities, &numbers(&expected["w"])) < 1e-12, "{model}");
            if let Some(of_gradients) = expected["W_F_only"].as_f64() {
                assert!((parts.deformation / of_gradients - 1.0).abs() < 1e-12, "{model}");
            }
            if let Some(condition) = expected["cond_max"].as_f64() {
                assert!((energy.condition() / condition - 1.0).abs() < 1e-10, "{model}");
            }
            if expected["F0"].is_array() {
                let h = body.to_user_order(&energy.displacement_gradients(&u), 9);
                let one = |k: usize| if k.is_multiple_of(4) { 1.0 } else { 0.0 };
                let f: Vec<f64> = h[..9].iter().enumerate().map(|(k, h)| h + one(k)).collect();
                assert!(error(&f, &numbers(&expected["F0"])) < 1e-13, "{model}");
            }
        }
    }
}
