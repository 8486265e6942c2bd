//! Energy, gradient and Hessian of small random clouds against 100-digit arithmetic
//! (cpd_small_clouds.json). The reference differentiates in all coordinates of all points.

use std::sync::Arc;

use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::weights::Weights;

use crate::common::{dense, distance, laws, numbers, reference};

struct Case {
    name: String,
    n: i32,
    horizon: f64,
    coefficients: [f64; 3],
    body: Arc<Body>,
    u: Vec<f64>,
    json: serde_json::Value,
}

fn cases() -> Vec<Case> {
    let clouds = reference("cpd_small_clouds.json");
    let read = |json: &serde_json::Value| {
        let flat = |key: &str| -> Vec<f64> {
            json[key].as_array().unwrap().iter().flat_map(numbers).collect()
        };
        let number = |key: &str| json[key].as_f64().unwrap();
        let dimension = json["D"].as_u64().unwrap() as usize;
        let (reference, current) = (flat("X"), flat("x"));
        let body = Body::new(dimension, &reference, &numbers(&json["V"]), None);
        let u: Vec<f64> = current.iter().zip(&reference).map(|(x, rest)| x - rest).collect();
        Case {
            name: json["name"].as_str().unwrap().to_string(),
            n: json["n"].as_i64().unwrap() as i32,
            horizon: number("delta"),
            coefficients: [number("C1"), number("C2"), number("C3")],
            u: body.from_user_order(&u, dimension),
            body: Arc::new(body),
            json: json.clone(),
        }
    };
    clouds["cases"].as_array().unwrap().iter().map(read).collect()
}

/// Rows and columns of a dense matrix in the user's order.
fn matrix_in_user_order(body: &Body, whole: &[f64]) -> Vec<f64> {
    let (d, n) = (body.dimension(), body.positions().len());
    let place = |index: usize| body.user_index()[index / d] as usize * d + index % d;
    let mut out = vec![0.0; n * n];
    for row in 0..n {
        for column in 0..n {
            out[place(row) * n + place(column)] = whole[row * n + column];
        }
    }
    out
}

#[test]
fn energy_gradient_and_hessian_agree() {
    let cases = cases();
    assert_eq!(cases.len(), 7);
    for case in cases {
        let laws = laws(case.coefficients, case.n);
        let energy =
            DiscreteEnergy::new(Arc::clone(&case.body), case.horizon, Weights::Truncated, laws)
                .unwrap();
        let mut gradient = vec![0.0; case.u.len()];
        let mut tangent = BlockMatrix::zeros(energy.pattern());
        let parts = energy.tangent(&case.u, &mut gradient, &mut tangent).unwrap();
        let name = &case.name;
        let counts = [energy.report().bonds, energy.report().triangles, energy.report().tetrahedra];
        for (k, part) in
            [parts.of("psi(l)"), parts.of("psi(a)"), parts.of("psi(v)")].into_iter().enumerate()
        {
            let key = (k + 1).to_string();
            let expected = case.json["energy_parts"][&key].as_f64().unwrap_or(0.0);
            assert!((part - expected).abs() <= 1.2e-14 * expected, "{name} part {key}: {part:e}");
            let count = case.json["ncliques"][&key].as_u64().unwrap_or(0);
            assert_eq!(counts[k], count, "{name} cliques {key}");
        }
        let d = case.body.dimension();
        let found = case.body.to_user_order(&gradient, d);
        let error = distance(&found, &numbers(&case.json["gradient"]));
        assert!(error <= 1.5e-14, "{name} gradient {error:e}");
        let found = matrix_in_user_order(&case.body, &dense(&tangent));
        let error = distance(&found, &numbers(&case.json["hessian_rowmajor"]));
        assert!(error <= 4e-14, "{name} hessian {error:e}");
    }
}

#[test]
fn the_cheaper_orders_give_the_same_bits() {
    for case in cases() {
        let laws = laws(case.coefficients, case.n);
        let energy =
            DiscreteEnergy::new(case.body, case.horizon, Weights::Truncated, laws).unwrap();
        let (mut first, mut second) = (vec![1.0; case.u.len()], vec![2.0; case.u.len()]);
        let mut tangent = BlockMatrix::zeros(energy.pattern());
        let parts = energy.tangent(&case.u, &mut first, &mut tangent).unwrap();
        assert_eq!(energy.forces(&case.u, &mut second).unwrap(), parts);
        assert_eq!(energy.energy(&case.u).unwrap(), parts);
        assert_eq!(first, second);
        tangent.values.fill(3.0);
        let mut again = BlockMatrix::zeros(energy.pattern());
        energy.tangent(&case.u, &mut first, &mut tangent).unwrap();
        energy.tangent(&case.u, &mut first, &mut again).unwrap();
        assert_eq!(tangent.values, again.values, "what was in the matrix before does not matter");
    }
}

#[test]
fn unit_weights_agree_kind_by_kind() {
    for case in cases() {
        for k in 0..3 {
            let key = (k + 1).to_string();
            let Some(expected) = case.json["unit_weight_energy"][&key].as_f64() else { continue };
            let mut coefficients = [0.0; 3];
            coefficients[k] = case.coefficients[k];
            let laws: Laws = laws(coefficients, case.n);
            let body = Arc::clone(&case.body);
            let energy = DiscreteEnergy::new(body, case.horizon, Weights::Unit, laws).unwrap();
            let mut gradient = vec![0.0; case.u.len()];
            let parts = energy.forces(&case.u, &mut gradient).unwrap();
            let name = format!("{} {key}", case.name);
            assert!((parts.total() - expected).abs() <= 1.2e-14 * expected, "{name}");
            let found = case.body.to_user_order(&gradient, case.body.dimension());
            let error = distance(&found, &numbers(&case.json["unit_weight_gradient"][&key]));
            assert!(error <= 1.5e-14, "{name} {error:e}");
        }
    }
}
