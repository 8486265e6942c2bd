//! The built-in discretisations of deformation gradients against the same as text, which gathers tensors: energies,
//! forces, products, stored Hessians and shares, on the reference clouds and on clouds of points of other volumes.

use std::path::Path;
use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Setting, VectorKernels, check_text};
use piola_runtime::body::Body;
use piola_runtime::deformation::{Discretisation, OperatorOrder, Stabilisation};
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::vectors::{VectorEnergy, VectorLaws};

use crate::common::{energy, error, numbers, reference, shown};

const YOUNG: f64 = 210.0;
const POISSON: f64 = 0.3;

/// Texts with what they are the text of.
fn texts(stiffness: f64) -> [(&'static str, OperatorOrder, Discretisation); 6] {
    use Discretisation::{BondQuadrature, Nodal, Stabilised};
    let first = OperatorOrder::First;
    [
        ("nodal", first, Nodal),
        ("nodal_with_constant", OperatorOrder::FirstWithConstant, Nodal),
        ("silling", first, Stabilised(Stabilisation::Silling { stiffness })),
        ("wan", first, Stabilised(Stabilisation::Wan)),
        ("isotropic", first, Stabilised(Stabilisation::Isotropic)),
        ("bond_quadrature", first, BondQuadrature),
    ]
}

/// The influence functions as text.
fn influence(kernel: &str) -> &'static str {
    match kernel {
        "one" => "w(L) = 1 + 0*L",
        "inv" => "w(L) = 1/L",
        // The cubic B-spline without its factor, of which nothing depends.
        _ => {
            "w(L) = if L <= delta/2 then 1 - 6*(L/delta)^2*max(1 - L/delta, 0) else 2*max(1 - L/delta, 0)^3"
        }
    }
}

fn text(name: &str, kernel: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/correspondence_as_text");
    let text = std::fs::read_to_string(folder.join(format!("{name}.piola"))).unwrap();
    assert!(text.contains("w(L) = 1/L"));
    text.replace("w(L) = 1/L", influence(kernel))
}

/// The functions of a text with the material of the references.
fn kernels(text: &str, stiffness: f64, mode: Mode, d: usize, horizon: f64) -> VectorKernels {
    let (_, model) = check_text(text).unwrap_or_else(|found| panic!("{text}\n{found:?}"));
    let mu = YOUNG / (2.0 * (1.0 + POISSON));
    let lambda = 2.0 * mu * POISSON / (1.0 - 2.0 * POISSON);
    let all = [("lambda", lambda), ("mu", mu), ("Cs", stiffness)];
    let own = all.into_iter().filter(|(name, _)| text.contains(&format!("parameter {name} ")));
    let own: Vec<(String, Setting)> =
        own.map(|(name, x)| (name.to_string(), Setting::Number(x))).collect();
    let values = model.values(d, &own, Some(horizon)).unwrap();
    model.compile(&values, mode, Form::Accurate).unwrap().vectors.unwrap()
}

fn of_text(body: &Arc<Body>, horizon: f64, text: &str, stiffness: f64, mode: Mode) -> VectorEnergy {
    let kernels = kernels(text, stiffness, mode, body.dimension(), horizon);
    let neighborhood = Arc::new(Neighborhood::new(body, horizon).unwrap());
    let arguments = ["H".to_string(), "xi, H".to_string()];
    let laws = VectorLaws { of_law: vec![Some(kernels)], thickness: 1.0, arguments };
    VectorEnergy::new(Arc::clone(body), neighborhood, None, laws).unwrap()
}

/// What two energies are held against each other by: the energy, forces, a product, the stored Hessian, shares
/// and virials.
fn all_of(energy: &dyn Energy, u: &[f64], v: &[f64]) -> Vec<Vec<f64>> {
    let n = u.len();
    let d = energy.dimension();
    let (mut forces, mut product) = (vec![0.0; n], vec![0.0; n]);
    let total = energy.forces(u, &mut forces).unwrap().total();
    energy.hessian(u).unwrap().multiply(v, &mut product);
    let mut stored = BlockMatrix::zeros(energy.pattern());
    energy.tangent(u, &mut forces, &mut stored).unwrap();
    let by_stored = stored.multiply(v);
    let (mut shares, mut virials) = (vec![0.0; n / d], vec![0.0; n * d]);
    energy.shares(u, &mut shares).unwrap();
    energy.virials(u, &mut virials).unwrap();
    let of_body = |c: usize| virials.iter().skip(c).step_by(d * d).sum::<f64>();
    vec![vec![total], forces, product, by_stored, shares, (0..d * d).map(of_body).collect()]
}

/// Errors of what texts give, in parts of the largest of each, against the built-in discretisations, over what they
/// may be: 1e-13, and what inverting a shape tensor of this condition takes.
fn errors(body: &Arc<Body>, horizon: f64, (u, v): (&[f64], &[f64]), mode: Mode) -> [f64; 6] {
    let mut worst = [0.0_f64; 6];
    let stiffness = 300.0;
    for (name, order, discretisation) in texts(stiffness) {
        for kernel in ["one", "inv", "cubic"] {
            let built_in = energy(body, horizon, order, discretisation, kernel);
            let bar = f64::max(1e-13, built_in.condition() * f64::EPSILON);
            let expected = all_of(&built_in, u, v);
            let text = of_text(body, horizon, &text(name, kernel), stiffness, mode);
            let found = all_of(&text, u, v);
            let errors: Vec<f64> = found
                .iter()
                .zip(&expected)
                .map(|(found, expected)| error(found, expected))
                .collect();
            println!("{name} {kernel}: {} of {bar:.1e}", shown(&errors));
            worst.iter_mut().zip(errors).for_each(|(worst, error)| *worst = worst.max(error / bar));
        }
    }
    worst
}

#[test]
fn texts_are_the_discretisations_on_the_reference_clouds() {
    let files = [
        (reference("correspondence_cloud_A.json")["cloud_A"].clone(), 3),
        (reference("correspondence_clouds_DE.json")["clouds"]["D"].clone(), 2),
        (reference("correspondence_clouds_DE.json")["clouds"]["E"].clone(), 3),
    ];
    for (data, d) in files {
        let take = |name: &str| numbers(&data[name]);
        let body = Arc::new(Body::new(d, &take("X"), &take("V"), None));
        let [u, v] = ["u", "v"].map(|name| body.from_user_order(&take(name), d));
        let horizon = data["delta"].as_f64().unwrap();
        let worst = errors(&body, horizon, (&u, &v), Mode::Jit(Level::Fast));
        println!("energy, forces, products, stored, shares, virials: {}", shown(&worst));
        assert!(worst.iter().all(|error| *error < 1.0), "{worst:?}");
    }
}
