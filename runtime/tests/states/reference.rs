//! Clouds of 30 and of 64 points, worked out by other programs with complex steps: solids of gathered
//! states and of bonds alone.

use std::sync::Arc;

use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::states::StateEnergy;
use piola_runtime::weights::Weights;
use serde_json::Value;

use crate::common::{cloud, displacements, error, h_of, numbers, reference, shown};
use crate::{energy, library, of_length, solid, values};

/// The cubic spline of (4.35) of unit integral in space.
const CUBIC: &str = "8/(pi*delta^3)*(if L/delta < 1/2 then 1 - 6*(L/delta)^2 + 6*(L/delta)^3 \
                     else 2*(1 - L/delta)^3)";

/// A cloud of a reference file, in space.
struct Cloud<'a> {
    data: &'a Value,
    moduli: [(&'static str, f64); 2],
    body: Arc<Body>,
    horizon: f64,
    /// Displacements and the direction of the product, in the body's order.
    u: Vec<f64>,
    v: Vec<f64>,
}

impl<'a> Cloud<'a> {
    fn new(file: &'a Value, data: &'a Value) -> Cloud<'a> {
        let take = |name: &str| numbers(&data[name]);
        let modulus = |name: &str| file[name].as_f64().unwrap();
        let body = Arc::new(Body::new(3, &take("X"), &take("V"), None));
        Cloud {
            data,
            moduli: [("K", modulus("K")), ("G", modulus("G"))],
            horizon: data["delta"].as_f64().unwrap(),
            u: body.from_user_order(&take("u"), 3),
            v: body.from_user_order(&take("v"), 3),
            body,
        }
    }

    /// Force densities of points in the file's order: minus the derivative over the volume.
    fn densities(&self, x: &[f64]) -> Vec<f64> {
        let density = |(dof, x): (usize, &f64)| -x / self.body.volumes()[dof / 3];
        self.body.to_user_order(&x.iter().enumerate().map(density).collect::<Vec<f64>>(), 3)
    }

    /// Errors of the energy relative to it, of forces and of products to their largest component.
    fn errors(&self, model: &str, total: f64, gradient: &[f64], product: &[f64]) -> [f64; 3] {
        let expected = &self.data["models"][model];
        [
            (total / expected["W"].as_f64().unwrap() - 1.0).abs(),
            error(&self.densities(gradient), &numbers(&expected["b"])),
            error(&self.densities(product), &numbers(&expected["Hv"])),
        ]
    }
}

const INFLUENCES: [(&str, &str); 3] = [("LPS_one", "1"), ("LPS_inv", "1/L"), ("LPS_cubic", CUBIC)];

/// Errors of the solid of the library.
fn errors_of_the_solid(cloud: &Cloud<'_>, model: &str, energy: &StateEnergy) -> [f64; 3] {
    let (mut gradient, mut product) = (vec![0.0; cloud.u.len()], vec![0.0; cloud.u.len()]);
    let total = energy.forces(&cloud.u, &mut gradient).unwrap().total();
    energy.hessian(&cloud.u).unwrap().multiply(&cloud.v, &mut product);
    cloud.errors(model, total, &gradient, &product)
}

#[test]
fn the_solid_of_the_library_is_that_of_the_reference() {
    let file = reference("correspondence_cloud_A.json");
    let cloud = Cloud::new(&file, &file["cloud_A"]);
    let mut worst = [0.0_f64; 7];
    for (name, influence) in INFLUENCES {
        let expected = &cloud.data["models"][name];
        let energy = energy(&solid(influence), &cloud.moduli, &cloud.body, cloud.horizon);
        let [total, forces, products] = errors_of_the_solid(&cloud, name, &energy);
        let gathered = cloud.body.to_user_order(&energy.integrals(&cloud.u), 2);
        let m: Vec<f64> = gathered.chunks(2).map(|of| of[0]).collect();
        let theta: Vec<f64> = gathered.chunks(2).map(|of| 3.0 / of[0] * of[1]).collect();
        let alone = energy.energy(&cloud.u).unwrap().total();
        let densities = energy.densities(&cloud.u, energy.body().volumes()).unwrap();
        let errors = [
            total,
            (alone / expected["W"].as_f64().unwrap() - 1.0).abs(),
            forces,
            products,
            error(&cloud.body.to_user_order(&densities, 1), &numbers(&expected["w"])),
            error(&m, &numbers(&expected["m"])),
            error(&theta, &numbers(&expected["theta"])),
        ];
        println!("{name}: {}", shown(&errors));
        (0..7).for_each(|k| worst[k] = worst[k].max(errors[k]));
    }
    println!("energy, alone, forces, products, densities, m, theta: {}", shown(&worst));
    // Four times what was measured.
    const BARS: [f64; 7] = [9e-15, 9e-15, 4.4e-14, 4e-15, 3.4e-14, 1.2e-15, 4e-14];
    assert!(worst.iter().zip(BARS).all(|(worst, bar)| *worst <= bar), "{worst:?}");
}

/// The same solid in a larger cloud, from another program.
#[test]
fn the_solid_of_the_library_is_that_of_the_second_reference() {
    let file = reference("correspondence_clouds_DE.json");
    let cloud = Cloud::new(&file, &file["clouds"]["E"]);
    let mut worst = [0.0_f64; 3];
    for (name, influence) in INFLUENCES {
        let energy = energy(&solid(influence), &cloud.moduli, &cloud.body, cloud.horizon);
        let errors = errors_of_the_solid(&cloud, name, &energy);
        println!("{name}: {}", shown(&errors));
        (0..3).for_each(|k| worst[k] = worst[k].max(errors[k]));
    }
    println!("energy, forces, products: {}", shown(&worst));
    // Four times what was measured.
    const BARS: [f64; 3] = [9e-16, 1.8e-14, 2.8e-15];
    assert!(worst.iter().zip(BARS).all(|(worst, bar)| *worst <= bar), "{worst:?}");
}

/// The modified stretch under the root: `c (l^3/(6 L^2) - l/2 + L/3)` per bond, each once.
const UNIT: &str = "potential unit
dimensions 3
parameter K in Pa
c = 18*K/(pi*delta^4)
psi(l) = c*(l^3/(6*L^2) - l/2 + L/3)
";

#[test]
fn the_bond_based_solids_are_those_of_the_reference() {
    let file = reference("correspondence_cloud_A.json");
    let cloud = Cloud::new(&file, &file["cloud_A"]);
    let mut worst = [0.0_f64; 3];
    for (name, text) in [
        ("BB_s", library("silling2000")),
        ("BB_sbar_unit", UNIT.to_string()),
        ("BB_sbar_fast", library("miranda_modified_stretch")),
    ] {
        let (model, values) = values(&text, &cloud.moduli[..1], 3, cloud.horizon);
        let bond = of_length(&model, &values).map(|law| Box::new(law) as _);
        let laws = Laws { bond, ..Laws::default() };
        let energy =
            DiscreteEnergy::new(Arc::clone(&cloud.body), cloud.horizon, Weights::Volumes, laws)
                .unwrap();
        let mut gradient = vec![0.0; cloud.u.len()];
        let mut tangent = BlockMatrix::zeros(energy.pattern());
        let total = energy.tangent(&cloud.u, &mut gradient, &mut tangent).unwrap().total();
        let errors = cloud.errors(name, total, &gradient, &tangent.multiply(&cloud.v));
        println!("{name}: {}", shown(&errors));
        (0..3).for_each(|k| worst[k] = worst[k].max(errors[k]));
    }
    println!("energy, forces, products: {}", shown(&worst));
    // Four times what was measured.
    const BARS: [f64; 3] = [1.5e-14, 1.2e-14, 5e-15];
    assert!(worst.iter().zip(BARS).all(|(worst, bar)| *worst <= bar), "{worst:?}");
}

#[test]
fn at_a_quarter_with_inverse_lengths_only_bonds_are_left() {
    let body = cloud(&[5, 4, 4], 11);
    let u = displacements(&body, &h_of(3), 0.05, 5);
    let k = 1.7;
    let energy = energy(&solid("1/L"), &[("K", k), ("G", 0.6 * k)], &body, 2.4);
    let m: Vec<f64> = energy.integrals(&u).chunks(2).map(|of| of[0]).collect();
    let neighborhood = energy.neighborhood();
    let mut expected = 0.0;
    for i in 0..body.n_points() {
        for j in neighborhood.upper(i) {
            let j = j as usize;
            let length = |move_by: f64| {
                let place = |p: usize, c: usize| body.position(p)[c] + move_by * u[3 * p + c];
                let square = |c: usize| (place(j, c) - place(i, c)) * (place(j, c) - place(i, c));
                (0..3).map(square).sum::<f64>().sqrt()
            };
            let (rest, now) = (length(0.0), length(1.0));
            // models.md section 3: the bond constant is 9 K (1/m_i + 1/m_j).
            let constant = 9.0 * k * (1.0 / m[i] + 1.0 / m[j]);
            let weight = body.volumes()[i] * body.volumes()[j];
            expected += weight * constant * (now - rest) * (now - rest) / (2.0 * rest);
        }
    }
    let found = energy.energy(&u).unwrap();
    assert!((found.total() / expected - 1.0).abs() < 2e-15, "{} {expected}", found.total());
    assert!(found.of("psi(theta)").abs() < 1.5e-16 * found.of("psi(l, m)"));
}
