//! The laws of mechanics for every energy of the deformation gradient in the library, in every
//! discretisation, from the text to forces and tangents.

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Model, Setting, check};
use piola_runtime::body::Body;
use piola_runtime::deformation::influence::CubicSpline;
use piola_runtime::deformation::{
    DeformationEnergy, Discretisation, Formulation, OperatorOrder, Stabilisation,
};
use piola_runtime::energy::Energy;

use crate::support::{Random, repository};

/// Every potential of the library with an energy of `F`, with values.
pub(crate) const MATERIALS: [(&str, &[(&str, f64)]); 18] = [
    ("arruda_boyce", &[("mu", 1.0), ("N", 5.0), ("K", 5.0)]),
    ("blatz_ko", &[("mu", 1.0), ("f", 0.6), ("nu", 0.3)]),
    ("exponentiated_hencky", &[("mu", 1.0), ("K", 4.0), ("k", 0.6), ("q", 0.4)]),
    (
        "fibre_reinforced",
        &[("mu", 1.0), ("K", 4.0), ("k1", 2.0), ("k2", 1.5), ("nx", 0.6), ("ny", 0.8)],
    ),
    ("fung", &[("c", 2.0), ("g", 0.5), ("b", 1.5)]),
    (
        "gasser_ogden_holzapfel",
        &[("mu", 1.0), ("K", 4.0), ("k1", 2.0), ("kappa", 0.1), ("nz", 0.3), ("my", -0.8)],
    ),
    ("gent", &[("mu", 1.0), ("Jm", 20.0), ("K", 5.0)]),
    (
        "guccione",
        &[("c", 1.0), ("bf", 2.0), ("bt", 1.1), ("bfs", 0.7), ("K", 4.0), ("nx", 0.6), ("ny", 0.8)],
    ),
    ("hencky", &[("lambda", 3.0), ("mu", 1.0)]),
    ("hyperfoam", &[("mu1", 1.0), ("alpha1", 4.5), ("mu2", 0.4), ("alpha2", -2.5), ("beta", 0.33)]),
    (
        "lopez_pamies",
        &[("mu1", 0.8), ("alpha1", 1.1), ("mu2", 0.3), ("alpha2", -2.5), ("lambda", 3.0)],
    ),
    ("mooney_rivlin", &[("C10", 0.7), ("C01", 0.3), ("K", 5.0)]),
    ("neo_hooke", &[("lambda", 3.0), ("mu", 1.0)]),
    ("neo_hooke_stable", &[("lambda", 3.0), ("mu", 1.0)]),
    ("ogden", &[("mu1", 0.8), ("alpha1", 1.3), ("mu2", -0.4), ("mu3", 0.1), ("K", 5.0)]),
    ("st_venant_kirchhoff", &[("lambda", 1.5), ("mu", 1.0)]),
    ("st_venant_kirchhoff_brittle", &[("K", 2.0), ("G", 1.0), ("Gc", 1.0)]),
    ("yeoh", &[("C1", 0.5), ("C2", 0.1), ("C3", 0.2), ("K", 5.0)]),
];

const DISCRETISATIONS: [(&str, Discretisation); 3] = [
    ("nodal", Discretisation::Nodal),
    ("stabilised", Discretisation::Stabilised(Stabilisation::Isotropic)),
    ("bond quadrature", Discretisation::BondQuadrature),
];

fn model(name: &str) -> Model {
    let path = repository("potentials").join(format!("{name}.piola"));
    let text = std::fs::read_to_string(path).unwrap();
    check(&piola_grammar::parse(&text).unwrap()).unwrap()
}

/// A cloud of points in a unit of 0.4 m, and displacements with a gradient of some 20 %.
fn cloud(d: usize) -> (Arc<Body>, Vec<f64>) {
    let mut random = Random(7 + d as u64);
    let counts: &[usize] = if d == 2 { &[5, 5] } else { &[4, 3, 3] };
    let total: usize = counts.iter().product();
    let (mut positions, mut volumes, mut u) = (Vec::new(), Vec::new(), Vec::new());
    let gradient = random.vector(d * d);
    for index in 0..total {
        let mut rest = index;
        let mut position = Vec::new();
        for count in counts.iter().rev() {
            position.push(0.4 * ((rest % count) as f64 + 0.2 * random.next()));
            rest /= count;
        }
        volumes.push((0..d).fold(1.0 + 0.5 * random.next(), |product, _| 0.4 * product));
        for row in 0..d {
            let linear: f64 = (0..d).map(|c| gradient[row * d + c] * position[c]).sum();
            u.push(0.2 * linear + 0.01 * random.next());
        }
        positions.extend(position);
    }
    let body = Arc::new(Body::new(d, &positions, &volumes, None));
    let sorted = body.from_user_order(&u, d);
    (body, sorted)
}

fn energy(
    name: &str,
    d: usize,
    body: &Arc<Body>,
    kind: Discretisation,
) -> Option<DeformationEnergy> {
    let model = model(name);
    model.variant(d)?;
    let parameters = MATERIALS.iter().find(|(known, _)| *known == name).unwrap().1;
    let settings: Vec<(String, Setting)> =
        parameters.iter().map(|(n, x)| (n.to_string(), Setting::Number(*x))).collect();
    let horizon = 0.95;
    let values = model.values(d, &settings, Some(horizon)).unwrap();
    let compiled = model.compile(&values, Mode::Jit(Level::Fast), Form::Accurate).unwrap();
    let formulation = Formulation {
        horizon,
        order: OperatorOrder::First,
        discretisation: kind,
        influence: &CubicSpline { dimension: d, horizon },
    };
    Some(
        DeformationEnergy::new(Arc::clone(body), formulation, Box::new(compiled.gradient.unwrap()))
            .unwrap(),
    )
}

/// Runs a test for every potential, dimension and discretisation.
fn everywhere(test: impl Fn(&str, &DeformationEnergy, &[f64])) {
    let mut tried = 0;
    for d in [2, 3] {
        let (body, u) = cloud(d);
        for (name, _) in MATERIALS {
            for (label, kind) in DISCRETISATIONS {
                if let Some(energy) = energy(name, d, &body, kind) {
                    test(&format!("{name} in {d}D, {label}"), &energy, &u);
                    tried += 1;
                }
            }
        }
    }
    assert_eq!(tried, 3 * (9 * 2 + 9), "potentials, dimensions and discretisations");
}

fn gradient(energy: &DeformationEnergy, u: &[f64]) -> Vec<f64> {
    let mut gradient = vec![0.0; u.len()];
    energy.forces(u, &mut gradient).unwrap();
    gradient
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// `f'(0)` from values at four places: the error is of order `step^4`.
fn slope(step: f64, f: impl Fn(f64) -> f64) -> f64 {
    (8.0 * (f(step) - f(-step)) - (f(2.0 * step) - f(-2.0 * step))) / (12.0 * step)
}

fn moved(u: &[f64], v: &[f64], by: f64) -> Vec<f64> {
    u.iter().zip(v).map(|(u, v)| u + by * v).collect()
}

#[test]
fn forces_are_the_gradient_and_products_the_tangent() {
    everywhere(|label, energy, u| {
        let v = Random(3).vector(u.len());
        let along: f64 = gradient(energy, u).iter().zip(&v).map(|(g, v)| g * v).sum();
        let differences = slope(1e-4, |by| energy.energy(&moved(u, &v, by)).unwrap().total());
        let scale = norm(&gradient(energy, u)) * norm(&v);
        assert!((along - differences).abs() < 6e-13 * scale, "{label}: {along} {differences}");

        let mut product = vec![0.0; u.len()];
        energy.hessian(u).unwrap().multiply(&v, &mut product);
        let differences: Vec<f64> = (0..u.len())
            .map(|k| slope(1e-4, |by| gradient(energy, &moved(u, &v, by))[k]))
            .collect();
        let error = norm(&moved(&product, &differences, -1.0));
        assert!(error < 5e-12 * norm(&product), "{label}: {error:e}");
        let w = Random(4).vector(u.len());
        let mut other = vec![0.0; u.len()];
        energy.hessian(u).unwrap().multiply(&w, &mut other);
        let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        let (first, second) = (dot(&w, &product), dot(&v, &other));
        let scale = norm(&product) * norm(&w);
        assert!((first - second).abs() < 8e-16 * scale, "{label}: {first} {second}");
    });
}

#[test]
fn momentum_balances_and_rotations_cost_nothing() {
    everywhere(|label, energy, u| {
        let d = energy.dimension();
        let forces = gradient(energy, u);
        let size: f64 = forces.iter().map(|f| f.abs()).sum();
        for axis in 0..d {
            let sum: f64 = forces.iter().skip(axis).step_by(d).sum();
            assert!(sum.abs() < 3e-16 * size, "{label}: {sum:e} of {size:e}");
        }
        let current = moved(u, energy.positions(), 1.0);
        let mut torque = 0.0;
        for (x, f) in current.chunks_exact(d).zip(forces.chunks_exact(d)) {
            torque += x[0] * f[1] - x[1] * f[0];
        }
        assert!(torque.abs() < 5e-16 * size, "{label}: torque {torque:e} of {size:e}");

        let (s, c) = (libm::sin(0.7), libm::cos(0.7));
        let mut turned = current.clone();
        for x in turned.chunks_exact_mut(d) {
            (x[0], x[1]) = (c * x[0] - s * x[1], s * x[0] + c * x[1]);
        }
        let turned = moved(&turned, energy.positions(), -1.0);
        let (before, after) =
            (energy.energy(u).unwrap().total(), energy.energy(&turned).unwrap().total());
        assert!((before - after).abs() < 5e-15 * before, "{label}: {before} {after}");
    });
}
