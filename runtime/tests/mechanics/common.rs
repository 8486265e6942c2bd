//! Laws written by hand, bodies and dense matrices that the tests share.

use std::path::Path;
use std::sync::Arc;

use piola_runtime::assembly::Laws;
use piola_runtime::body::Body;
use piola_runtime::kernel::{Batch, Law, Order, Outputs};
use piola_runtime::lattice::{Lattice, Nodes};
use piola_runtime::matrix::BlockMatrix;

/// Unit round-off.
pub(crate) const U: f64 = f64::EPSILON / 2.0;

/// The Seth-Hill energy `C/2 M S^2` of an integer exponent, in its accurate forms (firooz2023,
/// Eqs. (40)-(42)).
pub(crate) fn seth_hill(c: f64, n: i32) -> Box<dyn Law> {
    Box::new(move |batch: Batch<'_>, order: Order, out: Outputs<'_>| {
        for p in 0..batch.measure.len() {
            let (big, e) = (batch.reference[p], batch.change[p]);
            let x = batch.measure[p] / big;
            let strain = match n {
                1 => e,
                2 => 0.5 * e * (x + 1.0),
                -1 => e / x,
                -2 => e * (x + 1.0) / (2.0 * x * x),
                0 if e.abs() < 0.5 => libm::log1p(e),
                0 => libm::log(x),
                _ => (libm::pow(x, f64::from(n)) - 1.0) / f64::from(n),
            };
            let power = |k: i32| if k == 0 { 1.0 } else { libm::pow(x, f64::from(k)) };
            out.psi[p] = 0.5 * c * big * strain * strain;
            if order == Order::Energy {
                continue;
            }
            out.dpsi[p] = c * strain * power(n - 1);
            if order < Order::Tangent {
                continue;
            }
            let bent = if n == 1 { 0.0 } else { f64::from(n - 1) * strain * power(n - 2) };
            out.d2psi[p] = c / big * (power(2 * n - 2) + bent);
        }
    })
}

/// Seth-Hill energies with coefficients `[C1, C2, C3]`; what is zero is not modelled.
pub(crate) fn laws(c: [f64; 3], n: i32) -> Laws {
    let law = |c: f64| (c != 0.0).then(|| seth_hill(c, n));
    Laws { bond: law(c[0]), triangle: law(c[1]), tetrahedron: law(c[2]) }
}

/// A box of points at the cells' corners.
pub(crate) fn lattice(lower: &[f64], cells: &[usize], spacing: f64) -> Arc<Body> {
    let upper = lower.iter().zip(cells).map(|(x, &n)| x + n as f64 * spacing).collect();
    let lattice = Lattice { lower: lower.to_vec(), upper, spacing, nodes: Nodes::CornersFull };
    let points = lattice.points().unwrap();
    Arc::new(Body::new(points.dimension, &points.positions, &points.volumes, Some(spacing)))
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

/// A cloud: a lattice of the given counts, sheared out of its symmetry, with
/// volumes that vary by a factor of 3.
///
/// Flat cliques stay exactly flat, and are dropped. Points moved at random would make nearly flat
/// ones, whose strains are so large that they decide every norm and hide all others.
pub(crate) fn cloud(counts: &[usize], spacing: f64, seed: u64) -> Arc<Body> {
    let mut random = Random(seed);
    let cells: Vec<usize> = counts.iter().map(|n| n - 1).collect();
    let regular = lattice(&vec![0.0; counts.len()], &cells, spacing);
    let shear = [[1.0, 0.11, -0.07], [0.05, 0.93, 0.09], [-0.04, 0.06, 1.04]];
    let d = counts.len();
    let row = |x: &[f64], r: usize| (0..d).map(|c| shear[r][c] * x[c]).sum::<f64>();
    let sheared: Vec<f64> = regular
        .positions()
        .chunks_exact(d)
        .flat_map(|x| (0..d).map(|r| row(x, r)).collect::<Vec<f64>>())
        .collect();
    let volumes: Vec<f64> =
        regular.volumes().iter().map(|v| v * (1.0 + 0.5 * random.next())).collect();
    Arc::new(Body::new(d, &sheared, &volumes, None))
}

/// A smooth displacement field with some noise, of about the given strain.
pub(crate) fn displacements(body: &Body, strain: f64, seed: u64) -> Vec<f64> {
    let mut random = Random(seed);
    let d = body.dimension();
    let gradient = random.vector(d * d);
    let mut u = Vec::new();
    for point in 0..body.n_points() {
        let x = body.position(point);
        for row in 0..d {
            let linear: f64 = (0..d).map(|c| gradient[row * d + c] * x[c]).sum();
            u.push(strain * (linear + 0.1 * x[0] * random.next()));
        }
    }
    u
}

/// Both triangles of a matrix, row by row.
pub(crate) fn dense(matrix: &BlockMatrix) -> Vec<f64> {
    let (pattern, d) = (&matrix.pattern, matrix.pattern.dimension);
    let n = pattern.n_rows() * d;
    let mut whole = vec![0.0; n * n];
    for row in 0..pattern.n_rows() {
        for place in pattern.row_start[row]..pattern.row_start[row + 1] {
            let column = pattern.columns[place] as usize;
            for r in 0..d {
                for c in 0..d {
                    let value = matrix.values[(place * d + r) * d + c];
                    whole[(row * d + r) * n + column * d + c] = value;
                    whole[(column * d + c) * n + row * d + r] = value;
                }
            }
        }
    }
    whole
}

pub(crate) fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Norm of the difference over the norm of the second.
pub(crate) fn distance(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let difference: Vec<f64> = found.iter().zip(expected).map(|(f, e)| f - e).collect();
    norm(&difference) / norm(expected)
}

/// A reference file of the repository.
pub(crate) fn reference(name: &str) -> serde_json::Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/reference").join(name);
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

pub(crate) fn numbers(value: &serde_json::Value) -> Vec<f64> {
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    value.as_array().unwrap().iter().map(number).collect()
}
