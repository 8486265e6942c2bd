//! Laws of the deformation gradient written by hand, clouds, and the reference data.

use std::path::Path;
use std::sync::Arc;

use piola_runtime::body::Body;
use piola_runtime::deformation::influence::{
    Constant, CubicSpline, Gaussian, Influence, InverseLength,
};
use piola_runtime::deformation::{
    DeformationEnergy, Discretisation, Formulation, OperatorOrder, Stabilisation,
};
use piola_runtime::kernel::{Variables, VariablesLaw};

type Tensor<const D: usize> = [[f64; D]; D];

/// St Venant-Kirchhoff: `psi = lambda/2 tr(E)^2 + mu E:E`, from `H = F - I`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StVenantKirchhoff<const D: usize> {
    lambda: f64,
    mu: f64,
}

/// St Venant-Kirchhoff material of Young's modulus and Poisson's ratio, in plane strain in two
/// dimensions.
pub(crate) fn st_venant_kirchhoff(
    dimension: usize,
    young: f64,
    poisson: f64,
) -> Box<dyn VariablesLaw> {
    let mu = young / (2.0 * (1.0 + poisson));
    let lambda = 2.0 * mu * poisson / (1.0 - 2.0 * poisson);
    match dimension {
        2 => Box::new(StVenantKirchhoff::<2> { lambda, mu }),
        _ => Box::new(StVenantKirchhoff::<3> { lambda, mu }),
    }
}

fn tensor<const D: usize>(entry: impl Fn(usize, usize) -> f64) -> Tensor<D> {
    std::array::from_fn(|r| std::array::from_fn(|c| entry(r, c)))
}

/// `a b`.
fn product<const D: usize>(a: &Tensor<D>, b: &Tensor<D>) -> Tensor<D> {
    tensor(|r, c| (0..D).fold(0.0, |sum, s| sum + a[r][s] * b[s][c]))
}

impl<const D: usize> StVenantKirchhoff<D> {
    /// Strain and second Piola-Kirchhoff stress.
    fn state(&self, h: &Tensor<D>) -> (Tensor<D>, Tensor<D>) {
        let square = |r: usize, c: usize| (0..D).fold(0.0, |sum, s| sum + h[s][r] * h[s][c]);
        let e = tensor(|r, c| 0.5 * (h[r][c] + h[c][r] + square(r, c)));
        (e, self.stress(&e))
    }

    fn stress(&self, e: &Tensor<D>) -> Tensor<D> {
        let trace = (0..D).fold(0.0, |sum, r| sum + e[r][r]);
        let diagonal = self.lambda * trace;
        tensor(|r, c| 2.0 * self.mu * e[r][c] + if r == c { diagonal } else { 0.0 })
    }
}

impl<const D: usize> VariablesLaw for StVenantKirchhoff<D> {
    fn n_variables(&self) -> usize {
        D * D
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        let n = at.n;
        for p in 0..n {
            let (e, s) = self.state(&tensor::<D>(|r, c| at.change[(r * D + c) * n + p]));
            let terms = e.as_flattened().iter().zip(s.as_flattened());
            psi[p] = 0.5 * terms.fold(0.0, |sum, (e, s)| sum + e * s);
            if !gradient.is_empty() {
                let stress = product(&tensor::<D>(|r, c| at.current[(r * D + c) * n + p]), &s);
                for (k, x) in stress.as_flattened().iter().enumerate() {
                    gradient[k * n + p] = *x;
                }
            }
        }
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], out: &mut [f64]) {
        let n = at.n;
        for p in 0..n {
            let take = |from: &[f64]| tensor::<D>(|r, c| from[(r * D + c) * n + p]);
            let (f, df) = (take(at.current), take(direction));
            let (_, s) = self.state(&take(at.change));
            let half = |r: usize, c: usize| (0..D).fold(0.0, |sum, t| sum + f[t][r] * df[t][c]);
            let half = tensor::<D>(half);
            let ds = self.stress(&tensor(|r, c| 0.5 * (half[r][c] + half[c][r])));
            let (first, second) = (product(&df, &s), product(&f, &ds));
            for k in 0..D * D {
                out[k * n + p] = first.as_flattened()[k] + second.as_flattened()[k];
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
) -> DeformationEnergy {
    let influence = influence(kernel, body.dimension(), horizon);
    let formulation = Formulation { horizon, order, discretisation, influence: &*influence };
    let law = st_venant_kirchhoff(body.dimension(), 210.0, 0.3);
    DeformationEnergy::new(Arc::clone(body), formulation, law).unwrap()
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

/// Displacements that alternate from point to point (partmann2026 4.44).
pub(crate) struct Checkerboard {
    pub(crate) body: Arc<Body>,
    pub(crate) horizon: f64,
    /// In m, in the body's order.
    pub(crate) u: Vec<f64>,
    /// Largest component of a displacement in m.
    pub(crate) amplitude: f64,
    /// The point in the middle, in the body's order.
    pub(crate) centre: usize,
}

impl Checkerboard {
    /// A cube of 15^3 points at integer multiples of 25 mm: its middle is out of reach of the surface,
    /// 6 spacings deep.
    pub(crate) fn new() -> Checkerboard {
        let (n, spacing) = (15, 0.025);
        let cell = |p: usize| [p / (n * n), p / n % n, p % n];
        let positions: Vec<f64> =
            (0..n * n * n).flat_map(cell).map(|k| k as f64 * spacing).collect();
        let volumes = vec![spacing * spacing * spacing; n * n * n];
        let body = Arc::new(Body::new(3, &positions, &volumes, Some(spacing)));
        let amplitude = 1e-3 * spacing;
        let mut u = Vec::new();
        for x in body.positions().chunks_exact(3) {
            // cos(pi k) of the number of the layer.
            let sign = |a: usize| if libm::round(x[a] / spacing) % 2.0 == 0.0 { 1.0 } else { -1.0 };
            for (p, q) in [(1, 2), (0, 2), (0, 1)] {
                u.push(amplitude * sign(p) * sign(q));
            }
        }
        let user = ((n / 2 * n + n / 2) * n + n / 2) as u32;
        let centre = body.user_index().iter().position(|&p| p == user).unwrap();
        Checkerboard { body, horizon: 3.015 * spacing, u, amplitude, centre }
    }
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

/// Errors for people: 1.6e-15, 3.0e-14.
pub(crate) fn shown(errors: &[f64]) -> String {
    errors.iter().map(|error| format!("{error:.1e}")).collect::<Vec<_>>().join(", ")
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
