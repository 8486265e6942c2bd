//! The discrete total energy written as plainly as possible, to hold the program against: all
//! pairs, triples and quadruples of points, textbook measures of current positions, the potential
//! as its author wrote it, derivatives by hyper-dual numbers of all coordinates.

use std::f64::consts::PI;

use num_dual::{DualNum, HyperDual64};
use piola_compiler::{Measure, Model, Values};

/// How interactions are weighted; the names of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Weights {
    Uniform,
    Truncated,
    Volumes,
    Unit,
}

impl Weights {
    pub(crate) fn key(self) -> &'static str {
        match self {
            Weights::Uniform => "uniform",
            Weights::Truncated => "truncated",
            Weights::Volumes => "volumes",
            Weights::Unit => "unit",
        }
    }
}

/// Points with their volumes.
#[derive(Clone, Debug)]
pub(crate) struct Points {
    pub(crate) dimension: usize,
    /// `n x d`, in m.
    pub(crate) positions: Vec<f64>,
    pub(crate) volumes: Vec<f64>,
    /// Of a lattice, in m.
    pub(crate) spacing: Option<f64>,
}

impl Points {
    pub(crate) fn n(&self) -> usize {
        self.volumes.len()
    }

    fn position(&self, point: usize) -> &[f64] {
        &self.positions[point * self.dimension..][..self.dimension]
    }
}

/// Points that are pairwise within the horizon.
pub(crate) struct Clique {
    points: Vec<usize>,
    /// Its measure at rest, > 0.
    reference: f64,
    /// Sign of the measure at rest of the points in this order.
    orientation: f64,
    weight: f64,
    /// Its measure over that power of its longest edge: 1 for bonds, small if nearly flat.
    flatness: f64,
}

/// The energy of a body.
pub(crate) struct Witness<'a> {
    points: &'a Points,
    model: &'a Model,
    values: &'a Values,
    /// Bonds, triangles, tetrahedra.
    pub(crate) cliques: [Vec<Clique>; 3],
}

/// Everything that is compared.
pub(crate) struct State {
    pub(crate) parts: [f64; 3],
    /// `n x d`.
    pub(crate) gradient: Vec<f64>,
    /// Row by row.
    pub(crate) tangent: Vec<f64>,
}

impl State {
    pub(crate) fn energy(&self) -> f64 {
        self.parts.iter().sum()
    }
}

const MEASURES: [Measure; 3] = [Measure::Length, Measure::Area, Measure::Volume];

/// Flatter triangles and tetrahedra are no interactions (area over the square, volume over the
/// cube of the longest edge).
const FLAT: f64 = 1e-8;

impl<'a> Witness<'a> {
    pub(crate) fn new(
        points: &'a Points,
        horizon: f64,
        weights: Weights,
        model: &'a Model,
        values: &'a Values,
    ) -> Witness<'a> {
        let mut cliques = cliques(points, horizon);
        weigh(&mut cliques, points, horizon, weights);
        Witness { points, model, values, cliques }
    }

    /// The energy by measure; `x` are current positions.
    fn parts(&self, x: &[HyperDual64]) -> [HyperDual64; 3] {
        let d = self.points.dimension;
        std::array::from_fn(|k| {
            let written = self.model.written(self.values, MEASURES[k]);
            let mut sum = HyperDual64::from(0.0);
            for clique in &self.cliques[k] {
                let corners: Vec<&[HyperDual64]> =
                    clique.points.iter().map(|p| &x[p * d..(p + 1) * d]).collect();
                let measure = measure(&corners) * clique.orientation;
                let reference = HyperDual64::from(clique.reference);
                sum += written.evaluate(measure, reference) * clique.weight;
            }
            sum
        })
    }

    /// Energy, gradient and tangent after a displacement.
    pub(crate) fn state(&self, u: &[f64]) -> State {
        let now: Vec<f64> = self.points.positions.iter().zip(u).map(|(x, u)| x + u).collect();
        let n = now.len();
        let mut state =
            State { parts: [0.0; 3], gradient: vec![0.0; n], tangent: vec![0.0; n * n] };
        for row in 0..n {
            for column in 0..=row {
                let mut x: Vec<HyperDual64> = now.iter().map(|x| HyperDual64::from(*x)).collect();
                x[row].eps1 = 1.0;
                x[column].eps2 = 1.0;
                let parts = self.parts(&x);
                let total = parts[0] + parts[1] + parts[2];
                state.parts = parts.map(|part| part.re);
                state.gradient[row] = total.eps1;
                state.tangent[row * n + column] = total.eps1eps2;
                state.tangent[column * n + row] = total.eps1eps2;
            }
        }
        state
    }

    /// How much rounding of positions is magnified: the flattest triangle or tetrahedron changes its
    /// measure by `1/flatness` as much as a well-shaped one.
    pub(crate) fn magnification(&self) -> f64 {
        self.cliques.iter().flatten().map(|clique| 1.0 / clique.flatness).fold(1.0, f64::max)
    }

    /// The smallest measure over its reference, of all cliques.
    pub(crate) fn smallest_ratio(&self, u: &[f64]) -> f64 {
        let d = self.points.dimension;
        let x: Vec<HyperDual64> =
            self.points.positions.iter().zip(u).map(|(x, u)| (x + u).into()).collect();
        let ratio = |clique: &Clique| {
            let corners: Vec<&[HyperDual64]> =
                clique.points.iter().map(|p| &x[p * d..(p + 1) * d]).collect();
            measure(&corners).re * clique.orientation / clique.reference
        };
        self.cliques.iter().flatten().map(ratio).fold(f64::INFINITY, f64::min)
    }
}

/// Length, area measure or volume measure of two, three or four points, signed where it can be.
fn measure(corners: &[&[HyperDual64]]) -> HyperDual64 {
    let d = corners[0].len();
    let edge = |k: usize| -> Vec<HyperDual64> {
        (0..d).map(|axis| corners[k][axis] - corners[0][axis]).collect()
    };
    let dot = |p: &[HyperDual64], q: &[HyperDual64]| {
        p.iter().zip(q).fold(HyperDual64::from(0.0), |sum, (p, q)| sum + *p * *q)
    };
    let cross = |p: &[HyperDual64], q: &[HyperDual64]| {
        vec![p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
    };
    match (corners.len(), d) {
        (2, _) => dot(&edge(1), &edge(1)).sqrt(),
        (3, 2) => {
            let (p, q) = (edge(1), edge(2));
            p[0] * q[1] - p[1] * q[0]
        }
        (3, _) => {
            let normal = cross(&edge(1), &edge(2));
            dot(&normal, &normal).sqrt()
        }
        _ => dot(&edge(1), &cross(&edge(2), &edge(3))),
    }
}

/// Subsets of two to four points, all pairwise within the horizon, flat ones left out.
fn cliques(points: &Points, horizon: f64) -> [Vec<Clique>; 3] {
    let distance = |i: usize, j: usize| {
        let square = |(x, y): (&f64, &f64)| (x - y) * (x - y);
        points.position(i).iter().zip(points.position(j)).map(square).sum::<f64>().sqrt()
    };
    let near = |i: usize, j: usize| distance(i, j) <= horizon * (1.0 + 1e-6);
    let mut found = [Vec::new(), Vec::new(), Vec::new()];
    let mut add = |members: &[usize]| {
        let corners: Vec<Vec<HyperDual64>> = members
            .iter()
            .map(|p| points.position(*p).iter().map(|x| (*x).into()).collect())
            .collect();
        let corners: Vec<&[HyperDual64]> = corners.iter().map(Vec::as_slice).collect();
        let signed = measure(&corners).re;
        let order = members.len() - 1;
        let pairs = members.iter().flat_map(|i| members.iter().map(move |j| (*i, *j)));
        let longest = pairs.map(|(i, j)| distance(i, j)).fold(0.0, f64::max);
        let flatness = signed.abs() / (0..order).fold(1.0, |power, _| power * longest);
        if flatness > FLAT {
            found[order - 1].push(Clique {
                points: members.to_vec(),
                reference: signed.abs(),
                orientation: signed.signum(),
                weight: 1.0,
                flatness,
            });
        }
    };
    let n = points.n();
    for i in 0..n {
        for j in (i + 1..n).filter(|j| near(i, *j)) {
            add(&[i, j]);
            for k in (j + 1..n).filter(|k| near(i, *k) && near(j, *k)) {
                add(&[i, j, k]);
                if points.dimension == 3 {
                    for m in (k + 1..n).filter(|m| near(i, *m) && near(j, *m) && near(k, *m)) {
                        add(&[i, j, k, m]);
                    }
                }
            }
        }
    }
    found
}

/// The papers' weights, summed over the visits of an unordered clique: `W = f sum V_a V_k(a)` with
/// `V_k(a) = VH^k/#N_k(a)` and `f = 1/2, 2/3, 3/2`.
fn weigh(cliques: &mut [Vec<Clique>; 3], points: &Points, horizon: f64, weights: Weights) {
    let ball = match points.dimension {
        2 => PI * horizon * horizon,
        _ => 4.0 / 3.0 * PI * horizon * horizon * horizon,
    };
    let ordered: Vec<Vec<f64>> = cliques
        .iter()
        .zip([1.0, 2.0, 6.0])
        .map(|(cliques, visits)| {
            let mut counts = vec![0.0; points.n()];
            for point in cliques.iter().flat_map(|clique| &clique.points) {
                counts[*point] += visits;
            }
            counts
        })
        .collect();
    let most = ordered[0].iter().copied().fold(0.0, f64::max);
    let bulk = points.spacing.map(|spacing| bulk_counts(points.dimension, horizon / spacing));
    for (k, cliques) in cliques.iter_mut().enumerate() {
        for clique in cliques {
            let power = |x: f64| (0..=k).fold(1.0, |power, _| power * x);
            let effective = |point: usize| match weights {
                Weights::Uniform => power(ball) / bulk.expect("a lattice")[k],
                _ => power(ball * ordered[0][point] / most) / ordered[k][point],
            };
            clique.weight = match weights {
                Weights::Unit => 1.0,
                Weights::Volumes => {
                    let product: f64 = clique.points.iter().map(|p| points.volumes[*p]).product();
                    [1.0, 2.0, 6.0][k] * product
                }
                Weights::Uniform | Weights::Truncated => {
                    let share = |p: &usize| points.volumes[*p] * effective(*p);
                    [0.5, 2.0 / 3.0, 1.5][k] * clique.points.iter().map(share).sum::<f64>()
                }
            };
        }
    }
}

/// Ordered neighbours, pairs and triples of a point in the middle of a large lattice.
fn bulk_counts(dimension: usize, ratio: f64) -> [f64; 3] {
    let reach = ratio.ceil() as i32;
    let depth = if dimension == 3 { reach } else { 0 };
    let mut positions = vec![0.0; dimension];
    for x in -reach..=reach {
        for y in -reach..=reach {
            for z in -depth..=depth {
                let offset = [f64::from(x), f64::from(y), f64::from(z)];
                let length = offset.iter().map(|x| x * x).sum::<f64>().sqrt();
                if length > 0.0 && length <= ratio * (1.0 + 1e-6) {
                    positions.extend_from_slice(&offset[..dimension]);
                }
            }
        }
    }
    let volumes = vec![1.0; positions.len() / dimension];
    let points = Points { dimension, positions, volumes, spacing: None };
    let found = cliques(&points, ratio);
    std::array::from_fn(|k| {
        let of_the_middle = found[k].iter().filter(|clique| clique.points[0] == 0).count();
        [1.0, 2.0, 6.0][k] * of_the_middle as f64
    })
}
