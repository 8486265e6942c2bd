//! Laws of the deformation gradient written by hand, clouds, and the reference data.

use std::path::Path;
use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::correspondence::influence::{
    Constant, CubicSpline, Gaussian, Influence, InverseLength,
};
use piola_runtime::correspondence::{
    Correspondence, Discretisation, Formulation, OperatorOrder, Stabilisation,
};
use piola_runtime::kernel::{Variables, VariablesLaw};

/// St Venant-Kirchhoff: `psi = lambda/2 tr(E)^2 + mu E:E`, from `H = F - I`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StVenantKirchhoff {
    pub(crate) dimension: usize,
    pub(crate) lambda: f64,
    pub(crate) mu: f64,
}

impl StVenantKirchhoff {
    /// In plane strain, for two dimensions.
    pub(crate) fn new(dimension: usize, young: f64, poisson: f64) -> StVenantKirchhoff {
        let mu = young / (2.0 * (1.0 + poisson));
        StVenantKirchhoff { dimension, lambda: 2.0 * mu * poisson / (1.0 - 2.0 * poisson), mu }
    }

    /// Strain and second Piola-Kirchhoff stress.
    fn state(&self, h: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let d = self.dimension;
        let e: Vec<f64> = (0..d * d)
            .map(|k| {
                let (r, c) = (k / d, k % d);
                let square: f64 = (0..d).map(|s| h[s * d + r] * h[s * d + c]).sum();
                0.5 * (h[r * d + c] + h[c * d + r] + square)
            })
            .collect();
        let s = self.stress(&e);
        (e, s)
    }

    fn stress(&self, e: &[f64]) -> Vec<f64> {
        let d = self.dimension;
        let trace: f64 = (0..d).map(|r| e[r * d + r]).sum();
        let on_diagonal =
            |k: usize| if k.is_multiple_of(d + 1) { self.lambda * trace } else { 0.0 };
        e.iter().enumerate().map(|(k, e)| 2.0 * self.mu * e + on_diagonal(k)).collect()
    }
}

/// `a b`.
fn product(d: usize, a: &[f64], b: &[f64]) -> Vec<f64> {
    (0..d * d).map(|k| (0..d).map(|s| a[k / d * d + s] * b[s * d + k % d]).sum()).collect()
}

fn transposed(d: usize, a: &[f64]) -> Vec<f64> {
    (0..d * d).map(|k| a[k % d * d + k / d]).collect()
}

impl VariablesLaw for StVenantKirchhoff {
    fn n_variables(&self) -> usize {
        self.dimension * self.dimension
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        let (d, n) = (self.dimension, at.n);
        for p in 0..n {
            let take = |from: &[f64]| (0..d * d).map(|k| from[k * n + p]).collect::<Vec<f64>>();
            let (e, s) = self.state(&take(at.change));
            psi[p] = 0.5 * e.iter().zip(&s).map(|(e, s)| e * s).sum::<f64>();
            if !gradient.is_empty() {
                for (k, x) in product(d, &take(at.current), &s).iter().enumerate() {
                    gradient[k * n + p] = *x;
                }
            }
        }
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], out: &mut [f64]) {
        let (d, n) = (self.dimension, at.n);
        for p in 0..n {
            let take = |from: &[f64]| (0..d * d).map(|k| from[k * n + p]).collect::<Vec<f64>>();
            let (f, df) = (take(at.current), take(direction));
            let (_, s) = self.state(&take(at.change));
            let half = product(d, &transposed(d, &f), &df);
            let de: Vec<f64> =
                half.iter().zip(transposed(d, &half)).map(|(x, y)| 0.5 * (x + y)).collect();
            let ds = self.stress(&de);
            let (first, second) = (product(d, &df, &s), product(d, &f, &ds));
            for k in 0..d * d {
                out[k * n + p] = first[k] + second[k];
            }
        }
    }
}

/// All discretisations, the stiffness of Silling's being of the size of the others'.
pub(crate) const DISCRETISATIONS: [Discretisation; 5] = [
    Discretisation::Nodal,
    Discretisation::Stabilised(Stabilisation::Silling { stiffness: 500.0 }),
    Discretisation::Stabilised(Stabilisation::Wan),
    Discretisation::Stabilised(Stabilisation::Isotropic),
    Discretisation::BondQuadrature,
];

pub(crate) const ORDERS: [OperatorOrder; 3] =
    [OperatorOrder::First, OperatorOrder::FirstWithConstant, OperatorOrder::Second];

/// The influence functions by name.
pub(crate) fn influence(name: &str, dimension: usize, horizon: f64) -> Box<dyn Influence> {
    match name {
        "one" => Box::new(Constant),
        "inv" => Box::new(InverseLength),
        "cubic" => Box::new(CubicSpline { dimension, horizon }),
        "gauss" => Box::new(Gaussian { width: 0.5 * horizon }),
        _ => panic!("no influence function is called {name}"),
    }
}

/// An energy with St Venant-Kirchhoff material, E = 210, nu = 0.3.
pub(crate) fn energy(
    body: &Arc<Body>,
    horizon: f64,
    order: OperatorOrder,
    discretisation: Discretisation,
    kernel: &str,
) -> Correspondence {
    let influence = influence(kernel, body.dimension(), horizon);
    let formulation = Formulation { horizon, order, discretisation, influence: &*influence };
    let law = StVenantKirchhoff::new(body.dimension(), 210.0, 0.3);
    Correspondence::new(Arc::clone(body), formulation, Box::new(law)).unwrap()
}

/// Reproducible pseudo-random numbers in -1..1.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub(crate) fn vector(&mut self, n: usize) -> Vec<f64> {
        (0..n).map(|_| self.next()).collect()
    }
}

/// A lattice of unit spacing whose points are moved at random by up to 0.3 spacings, with volumes
/// that vary by a factor of 3.
pub(crate) fn cloud(counts: &[usize], seed: u64) -> Arc<Body> {
    let mut random = Random(seed);
    let d = counts.len();
    let n: usize = counts.iter().product();
    let mut positions = Vec::with_capacity(n * d);
    for point in 0..n {
        let mut rest = point;
        for count in counts {
            positions.push((rest % count) as f64 + 0.3 * random.next());
            rest /= count;
        }
    }
    let volumes: Vec<f64> = (0..n).map(|_| 1.0 + 0.5 * random.next()).collect();
    Arc::new(Body::new(d, &positions, &volumes, None))
}

/// `H X + a`, and some noise.
pub(crate) fn displacements(body: &Body, h: &[f64], noise: f64, seed: u64) -> Vec<f64> {
    let mut random = Random(seed);
    let d = body.dimension();
    let mut u = Vec::new();
    for x in body.positions().chunks_exact(d) {
        for r in 0..d {
            let linear: f64 = (0..d).map(|c| h[r * d + c] * x[c]).sum();
            u.push(linear + noise * random.next());
        }
    }
    u
}

/// A displacement gradient of about 0.1.
pub(crate) const H: [f64; 9] = [0.1, 0.05, -0.08, 0.02, -0.06, 0.11, -0.03, 0.07, 0.04];

pub(crate) fn h_of(d: usize) -> Vec<f64> {
    H[..d * d].to_vec()
}

pub(crate) fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

pub(crate) fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most, x| most.max(x.abs()))
}

/// The largest difference over the largest of the second.
pub(crate) fn error(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let difference: Vec<f64> = found.iter().zip(expected).map(|(f, e)| f - e).collect();
    largest(&difference) / largest(expected)
}

/// A reference file of the repository.
pub(crate) fn reference(name: &str) -> serde_json::Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/reference").join(name);
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// All numbers of a JSON array, or array of arrays, in order.
pub(crate) fn numbers(value: &serde_json::Value) -> Vec<f64> {
    match value.as_array() {
        Some(items) => items.iter().flat_map(numbers).collect(),
        None => vec![value.as_f64().unwrap()],
    }
}
