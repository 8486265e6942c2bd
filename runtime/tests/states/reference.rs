//! A cloud of 30 points, worked out by another program with complex steps: solids of
//! gathered states and of bonds alone.

use std::sync::Arc;

use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::energy::TotalEnergy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::weights::Weights;

use crate::common::{cloud, displacements, error, h_of, numbers, reference};
use crate::{energy, library, of_length, solid, values};

/// The cubic spline of (4.35) of unit integral in space.
const CUBIC: &str = "8/(pi*delta^3)*(if L/delta < 1/2 then 1 - 6*(L/delta)^2 + 6*(L/delta)^3 \
                     else 2*(1 - L/delta)^3)";

#[test]
fn the_solid_of_the_library_is_that_of_the_reference() {
    let file = reference("correspondence_cloud_A.json");
    let data = &file["cloud_A"];
    let take = |name: &str| numbers(&data[name]);
    let horizon = data["delta"].as_f64().unwrap();
    let moduli = [("K", file["K"].as_f64().unwrap()), ("G", file["G"].as_f64().unwrap())];
    let body = Arc::new(Body::new(3, &take("X"), &take("V"), None));
    let (u, v) = (body.from_user_order(&take("u"), 3), body.from_user_order(&take("v"), 3));
    for (name, influence) in [("LPS_one", "1"), ("LPS_inv", "1/L"), ("LPS_cubic", CUBIC)] {
        let expected = &data["models"][name];
        let energy = energy(&solid(influence), &moduli, &body, horizon);
        let of_points = |x: &[f64]| {
            let density = |(dof, x): (usize, &f64)| -x / body.volumes()[dof / 3];
            body.to_user_order(&x.iter().enumerate().map(density).collect::<Vec<f64>>(), 3)
        };
        let (mut gradient, mut product) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        let parts = energy.gradient(&u, &mut gradient).unwrap();
        energy.tangent_product(&u, &v, &mut product).unwrap();
        let gathered = body.to_user_order(&energy.integrals(&u), 2);
        let m: Vec<f64> = gathered.chunks(2).map(|of| of[0]).collect();
        let theta: Vec<f64> = gathered.chunks(2).map(|of| 3.0 / of[0] * of[1]).collect();
        let errors = [
            (parts.total() / expected["W"].as_f64().unwrap() - 1.0).abs(),
            (energy.energy(&u).unwrap().total() / parts.total() - 1.0).abs(),
            error(&of_points(&gradient), &numbers(&expected["b"])),
            error(&of_points(&product), &numbers(&expected["Hv"])),
            error(
                &body.to_user_order(&energy.energy_densities(&u).unwrap(), 1),
                &numbers(&expected["w"]),
            ),
            error(&m, &numbers(&expected["m"])),
            error(&theta, &numbers(&expected["theta"])),
        ];
        println!("{name}: {errors:?}");
        assert!(errors.iter().all(|&e| e < 1e-12), "{name}: {errors:?}");
    }
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
    let data = &file["cloud_A"];
    let take = |name: &str| numbers(&data[name]);
    let horizon = data["delta"].as_f64().unwrap();
    let body = Arc::new(Body::new(3, &take("X"), &take("V"), None));
    let (u, v) = (body.from_user_order(&take("u"), 3), body.from_user_order(&take("v"), 3));
    for (name, text) in [
        ("BB_s", library("silling2000")),
        ("BB_sbar_unit", UNIT.to_string()),
        ("BB_sbar_fast", library("miranda_modified_stretch")),
    ] {
        let expected = &data["models"][name];
        let (model, values) = values(&text, &[("K", file["K"].as_f64().unwrap())], 3, horizon);
        let bond = of_length(&model, &values).map(|law| Box::new(law) as _);
        let laws = Laws { bond, ..Laws::default() };
        let energy =
            DiscreteEnergy::new(Arc::clone(&body), horizon, Weights::Volumes, laws).unwrap();
        let of_points = |x: &[f64]| {
            let density = |(dof, x): (usize, &f64)| -x / body.volumes()[dof / 3];
            body.to_user_order(&x.iter().enumerate().map(density).collect::<Vec<f64>>(), 3)
        };
        let mut gradient = vec![0.0; u.len()];
        let mut tangent = BlockMatrix::zeros(energy.pattern());
        let parts = energy.tangent(&u, &mut gradient, &mut tangent).unwrap();
        let errors = [
            (parts.total() / expected["W"].as_f64().unwrap() - 1.0).abs(),
            error(&of_points(&gradient), &numbers(&expected["b"])),
            error(&of_points(&tangent.multiply(&v)), &numbers(&expected["Hv"])),
        ];
        println!("{name}: {errors:?}");
        assert!(errors.iter().all(|&e| e < 1e-12), "{name}: {errors:?}");
    }
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
        for &j in neighborhood.upper(i) {
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
    assert!((found.total() / expected - 1.0).abs() < 1e-13, "{} {expected}", found.total());
    assert!(found.deformation.abs() < 1e-15 * found.bonds);
}
