//! All correspondence models of clouds of points, worked out by other programs with complex steps: of
//! 30 points in space, of 48 in the plane and of 64 in space.

use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::deformation::{DeformationEnergy, Discretisation, OperatorOrder, Stabilisation};
use piola_runtime::energy::{Energy, EnergyParts};
use serde_json::Value;

use crate::common::{energy, error, numbers, reference, shown};

/// A cloud of a reference file.
struct Cloud {
    data: Value,
    body: Arc<Body>,
    horizon: f64,
    /// Silling's stabilisation, `C_s = 0.5`.
    silling: Discretisation,
    /// Displacements and the direction of the product, in the body's order.
    u: Vec<f64>,
    v: Vec<f64>,
}

impl Cloud {
    fn new(data: &Value, dimension: usize) -> Cloud {
        let take = |name: &str| numbers(&data[name]);
        let body = Arc::new(Body::new(dimension, &take("X"), &take("V"), None));
        let stiffness = 0.5 * data["Cb"].as_f64().unwrap();
        Cloud {
            horizon: data["delta"].as_f64().unwrap(),
            silling: Discretisation::Stabilised(Stabilisation::Silling { stiffness }),
            u: body.from_user_order(&take("u"), dimension),
            v: body.from_user_order(&take("v"), dimension),
            data: data.clone(),
            body,
        }
    }

    fn energy(
        &self,
        order: OperatorOrder,
        kind: Discretisation,
        kernel: &str,
    ) -> DeformationEnergy {
        energy(&self.body, self.horizon, order, kind, kernel)
    }

    /// Errors of the energy relative to it, of forces and of products to their largest component.
    fn errors(&self, energy: &DeformationEnergy, model: &str) -> ([f64; 4], EnergyParts) {
        let expected = &self.data["models"][model];
        let d = self.body.dimension();
        // Force densities: minus the derivative over the volume.
        let of_points = |x: &[f64]| {
            let density = |(dof, x): (usize, &f64)| -x / self.body.volumes()[dof / d];
            self.body.to_user_order(&x.iter().enumerate().map(density).collect::<Vec<f64>>(), d)
        };
        let mut gradient = vec![0.0; self.u.len()];
        let mut product = gradient.clone();
        let parts = energy.forces(&self.u, &mut gradient).unwrap();
        energy.hessian(&self.u).unwrap().multiply(&self.v, &mut product);
        let total = expected["W"].as_f64().unwrap();
        let alone = energy.energy(&self.u).unwrap().total();
        let errors = [
            (parts.total() / total - 1.0).abs(),
            (alone / total - 1.0).abs(),
            error(&of_points(&gradient), &numbers(&expected["b"])),
            error(&of_points(&product), &numbers(&expected["Hv"])),
        ];
        (errors, parts)
    }
}

#[test]
fn energies_forces_and_products_are_those_of_the_reference() {
    let cloud = Cloud::new(&reference("correspondence_cloud_A.json")["cloud_A"], 3);
    let body = &cloud.body;
    let mut worst = [0.0_f64; 8];
    for kernel in ["one", "cubic"] {
        for (model, discretisation) in [
            (format!("CC_{kernel}"), Discretisation::Nodal),
            (format!("CS_{kernel}_Cs0.5"), cloud.silling),
            (format!("CW_{kernel}"), Discretisation::Stabilised(Stabilisation::Wan)),
            (format!("BAQP_{kernel}"), Discretisation::BondQuadrature),
        ] {
            let expected = &cloud.data["models"][&model];
            let energy = cloud.energy(OperatorOrder::First, discretisation, kernel);
            let (errors, parts) = cloud.errors(&energy, &model);
            println!("{model}: {errors:?}");
            (0..4).for_each(|k| worst[k] = worst[k].max(errors[k]));
            let densities = energy.densities(&cloud.u, body.volumes()).unwrap();
            let densities = body.to_user_order(&densities, 1);
            worst[4] = worst[4].max(error(&densities, &numbers(&expected["w"])));
            if let Some(of_gradients) = expected["W_F_only"].as_f64() {
                worst[5] = worst[5].max((parts.of("psi(F)") / of_gradients - 1.0).abs());
            }
            if let Some(condition) = expected["cond_max"].as_f64() {
                worst[6] = worst[6].max((energy.condition() / condition - 1.0).abs());
            }
            if expected["F0"].is_array() {
                let h = body.to_user_order(&energy.displacement_gradients(&cloud.u), 9);
                let one = |k: usize| if k.is_multiple_of(4) { 1.0 } else { 0.0 };
                let f: Vec<f64> = h[..9].iter().enumerate().map(|(k, h)| h + one(k)).collect();
                worst[7] = worst[7].max(error(&f, &numbers(&expected["F0"])));
            }
        }
    }
    println!(
        "energy, alone, forces, products, densities, of F alone, condition, F: {}",
        shown(&worst)
    );
    // Four times what was measured.
    const BARS: [f64; 8] = [7e-15, 7e-15, 1.2e-13, 8e-15, 6e-14, 2.8e-15, 3e-14, 5.2e-15];
    assert!(worst.iter().zip(BARS).all(|(worst, bar)| *worst <= bar), "{worst:?}");
}

/// The plane, the other orders and the other influence functions, from another program.
#[test]
fn all_orders_in_the_plane_and_in_space_are_those_of_the_reference() {
    const ORDERS: [(&str, OperatorOrder); 3] = [
        ("", OperatorOrder::First),
        ("_rk1c", OperatorOrder::FirstWithConstant),
        ("_rk2", OperatorOrder::Second),
    ];
    let file = reference("correspondence_clouds_DE.json");
    let (mut compared, mut worst) = (0, [[0.0_f64; 4]; 2]);
    for (place, name) in ["D", "E"].into_iter().enumerate() {
        let cloud = Cloud::new(&file["clouds"][name], 2 + place);
        for kernel in ["one", "inv", "cubic"] {
            for (label, order) in ORDERS {
                for (kind, discretisation) in [
                    ("CC", Discretisation::Nodal),
                    ("BAQP", Discretisation::BondQuadrature),
                    ("CW", Discretisation::Stabilised(Stabilisation::Wan)),
                    ("CS", cloud.silling),
                ] {
                    let model = format!("{kind}{label}_{kernel}");
                    if cloud.data["models"][&model].is_null() {
                        continue;
                    }
                    let energy = cloud.energy(order, discretisation, kernel);
                    let (errors, _) = cloud.errors(&energy, &model);
                    println!("{name} {model}: {}", shown(&errors));
                    (0..4).for_each(|k| worst[place][k] = worst[place][k].max(errors[k]));
                    compared += 1;
                }
            }
        }
    }
    println!("energy, alone, forces, products: {}, {}", shown(&worst[0]), shown(&worst[1]));
    // Four times what was measured, in the plane and in space.
    const BARS: [[f64; 4]; 2] =
        [[4e-14, 4e-14, 2.4e-13, 5.6e-14], [6e-14, 6e-14, 3.6e-13, 8.4e-14]];
    let mut held = worst.iter().flatten().zip(BARS.iter().flatten());
    assert!(held.all(|(worst, bar)| worst <= bar), "{worst:?}");
    assert_eq!(compared, 2 * 3 * (3 * 2 + 2), "all models but the state-based solid");
}
