//! Bodies of bonds, triangles and tetrahedra of which some are gone, against sums over what is left, one by
//! one, from its definition: cliques of points that are pairwise within the horizon.

use std::collections::BTreeSet;
use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, check_text};
use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::fracture::Release;
use piola_runtime::interaction::{Ranks, Slabs};
use piola_runtime::kernel::{Law, Measure};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::weights::Weights;

use crate::common::{Random, cloud, dense, displacements, distance, lattice, norm};

/// Squares of strains: of the ways through a body the laws decide, and the lattice.
fn energy(body: &Arc<Body>, horizon: f64, level: Level, with_bonds: bool) -> DiscreteEnergy {
    let d = body.dimension();
    let mut text = String::from("potential p\npsi(a) = 1/2*A*(a/A - 1)^2\n");
    if with_bonds {
        text.push_str("psi(l) = 1/2*L*(l/L - 1)^2\n");
    }
    if d == 3 {
        text.push_str("psi(v) = 1/2*V*(v/V - 1)^2\n");
    }
    let (_, model) = check_text(&text).unwrap();
    let values = model.values(d, &[], None).unwrap();
    let kernels = model.compile(&values, Mode::Jit(level), Form::Accurate).unwrap().kernels;
    let mut laws = Laws::default();
    for kernel in kernels {
        let place = match kernel.measure() {
            Measure::Length => &mut laws.bond,
            Measure::Area => &mut laws.triangle,
            Measure::Volume => &mut laws.tetrahedron,
        };
        *place = Some(Box::new(kernel) as Box<dyn Law>);
    }
    DiscreteEnergy::new(Arc::clone(body), horizon, Weights::Volumes, laws).unwrap()
}

/// All cliques of so many points by loops over neighbours, in lexicographic order.
fn cliques(neighborhood: &Neighborhood, body: &Body, points: usize) -> Vec<Vec<usize>> {
    let mut all: Vec<Vec<usize>> = (0..body.n_points()).map(|point| vec![point]).collect();
    for _ in 1..points {
        let longer = |clique: &Vec<usize>| {
            let last = clique[clique.len() - 1];
            let near = |p: usize, q: usize| neighborhood.row(p).contains(q as u32);
            let nexts = neighborhood.row(clique[0]).iter().map(|k| k as usize);
            let nexts = nexts.filter(|next| *next > last && clique.iter().all(|p| near(*p, *next)));
            nexts.map(|next| [&clique[..], &[next]].concat()).collect::<Vec<_>>()
        };
        all = all.iter().flat_map(longer).collect();
    }
    all.retain(|clique| {
        let at_rest = still(&vec![0.0; body.positions().len()]);
        let edges = (0..points).flat_map(|p| (0..p).map(move |q| [p, q]));
        let length = |[p, q]: [usize; 2]| {
            let edge = minus(&place(body, &at_rest, clique[p]), &place(body, &at_rest, clique[q]));
            norm(&values(&edge))
        };
        let longest = edges.map(length).fold(0.0, f64::max);
        let (measure, _) = measure(body, &at_rest, clique);
        measure.0 > 1e-8 * (1..points).fold(1.0, |power, _| power * longest)
    });
    all
}

/// A number with its derivative along a direction.
#[derive(Clone, Copy)]
struct Dual(f64, f64);

impl std::ops::Add for Dual {
    type Output = Dual;

    fn add(self, other: Dual) -> Dual {
        Dual(self.0 + other.0, self.1 + other.1)
    }
}

impl std::ops::Sub for Dual {
    type Output = Dual;

    fn sub(self, other: Dual) -> Dual {
        Dual(self.0 - other.0, self.1 - other.1)
    }
}

impl std::ops::Mul for Dual {
    type Output = Dual;

    fn mul(self, other: Dual) -> Dual {
        Dual(self.0 * other.0, self.1 * other.0 + self.0 * other.1)
    }
}

impl Dual {
    fn sqrt(self) -> Dual {
        let root = self.0.sqrt();
        Dual(root, 0.5 * self.1 / root)
    }

    fn recip(self) -> Dual {
        Dual(1.0 / self.0, -self.1 / (self.0 * self.0))
    }
}

/// Numbers that stay as they are.
fn still(x: &[f64]) -> Vec<Dual> {
    x.iter().map(|x| Dual(*x, 0.0)).collect()
}

fn values(x: &[Dual]) -> Vec<f64> {
    x.iter().map(|x| x.0).collect()
}

type Point = [Dual; 3];

fn place(body: &Body, u: &[Dual], point: usize) -> Point {
    let d = body.dimension();
    std::array::from_fn(|axis| match axis < d {
        true => u[point * d + axis] + Dual(body.position(point)[axis], 0.0),
        false => Dual(0.0, 0.0),
    })
}

fn minus(p: &Point, q: &Point) -> Point {
    std::array::from_fn(|axis| p[axis] - q[axis])
}

fn cross(p: &Point, q: &Point) -> Point {
    let at = |a: usize, b: usize| p[a] * q[b] - p[b] * q[a];
    [at(1, 2), at(2, 0), at(0, 1)]
}

fn dot(p: &Point, q: &Point) -> Dual {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

fn scaled(p: &Point, by: Dual) -> Point {
    p.map(|x| x * by)
}

/// The measure of a clique, and its gradient by all corners but the first. Signed in as many dimensions as
/// it has edges from a corner, with the sign at rest; else the size.
fn measure(body: &Body, u: &[Dual], clique: &[usize]) -> (Dual, Vec<Point>) {
    let first = place(body, u, clique[0]);
    let x: Vec<Point> =
        clique[1..].iter().map(|point| minus(&place(body, u, *point), &first)).collect();
    let rest = still(&vec![0.0; body.positions().len()]);
    let first = place(body, &rest, clique[0]);
    let xi: Vec<Point> =
        clique[1..].iter().map(|point| minus(&place(body, &rest, *point), &first)).collect();
    match x.len() {
        1 => {
            let length = dot(&x[0], &x[0]).sqrt();
            (length, vec![scaled(&x[0], length.recip())])
        }
        2 => {
            let normal = cross(&x[0], &x[1]);
            let size = dot(&normal, &normal).sqrt();
            let (area, unit) = match body.dimension() {
                2 => {
                    let sign = Dual(cross(&xi[0], &xi[1])[2].0.signum(), 0.0);
                    (normal[2] * sign, [Dual(0.0, 0.0), Dual(0.0, 0.0), sign])
                }
                _ => (size, scaled(&normal, size.recip())),
            };
            (area, vec![cross(&x[1], &unit), cross(&unit, &x[0])])
        }
        _ => {
            let sign = Dual(dot(&xi[0], &cross(&xi[1], &xi[2])).0.signum(), 0.0);
            let gradient =
                [[1, 2], [2, 0], [0, 1]].map(|[p, q]| scaled(&cross(&x[p], &x[q]), sign));
            (dot(&x[0], &gradient[0]), gradient.to_vec())
        }
    }
}

/// Energies of points, and forces, of some cliques.
fn by_hand(body: &Body, all: &[&Vec<usize>], u: &[Dual]) -> (Vec<Dual>, Vec<Dual>) {
    let d = body.dimension();
    let rest = still(&vec![0.0; body.positions().len()]);
    let (mut shares, mut forces) =
        (vec![Dual(0.0, 0.0); body.n_points()], vec![Dual(0.0, 0.0); u.len()]);
    for clique in all {
        // Integrals over the neighbours of a point see each set of them in any order.
        let orders = [1.0, 2.0, 6.0][clique.len() - 2];
        let weight = orders * clique.iter().map(|point| body.volumes()[*point]).product::<f64>();
        let ((now, gradient), (at_rest, _)) =
            (measure(body, u, clique), measure(body, &rest, clique));
        let strain = now * at_rest.recip() - Dual(1.0, 0.0);
        let part = Dual(0.5 * at_rest.0 * weight / clique.len() as f64, 0.0);
        let energy = strain * strain * part;
        clique.iter().for_each(|point| shares[*point] = shares[*point] + energy);
        for (point, by) in clique[1..].iter().zip(&gradient) {
            for axis in 0..d {
                let part = by[axis] * strain * Dual(weight, 0.0);
                let [own, first] = [point, &clique[0]].map(|point| point * d + axis);
                forces[own] = forces[own] + part;
                forces[first] = forces[first] - part;
            }
        }
    }
    (shares, forces)
}

/// A body with all its cliques, of which some are gone.
struct Reference {
    body: Arc<Body>,
    neighborhood: Neighborhood,
    /// By their number of points less two.
    all: [Vec<Vec<usize>>; 3],
    /// Of triangles and tetrahedra that broke themselves.
    gone: [BTreeSet<usize>; 2],
    is_broken: Vec<bool>,
    with_bonds: bool,
}

impl Reference {
    fn new(body: &Arc<Body>, horizon: f64, with_bonds: bool) -> Reference {
        let neighborhood = Neighborhood::new(body, horizon).unwrap();
        let tetrahedra = if body.dimension() == 3 { 4 } else { 0 };
        let all = [2, 3, tetrahedra].map(|points| match points {
            0 => Vec::new(),
            points => cliques(&neighborhood, body, points),
        });
        let is_broken = vec![false; neighborhood.n_bonds()];
        Reference {
            body: Arc::clone(body),
            neighborhood,
            all,
            gone: Default::default(),
            is_broken,
            with_bonds,
        }
    }

    fn left(&self) -> Vec<&Vec<usize>> {
        let is_broken = |p: usize, q: usize| {
            let own = self.neighborhood.upper(p).iter().position(|k| k as usize == q).unwrap();
            self.is_broken[self.neighborhood.bonds(p).start + own]
        };
        let is_whole = |clique: &&Vec<usize>| {
            let mut edges = clique
                .iter()
                .enumerate()
                .flat_map(|(k, p)| clique[k + 1..].iter().map(move |q| (*p, *q)));
            !edges.any(|(p, q)| is_broken(p, q))
        };
        let mut left = Vec::new();
        for (kind, all) in self.all.iter().enumerate() {
            if kind == 0 && !self.with_bonds {
                continue;
            }
            let stays = |(number, _): &(usize, &Vec<usize>)| {
                kind == 0 || !self.gone[kind - 1].contains(number)
            };
            left.extend(all.iter().enumerate().filter(stays).map(|(_, c)| c).filter(is_whole));
        }
        left
    }
}

/// What is found of a body against its reference; energy and forces.
fn check(energy: &DiscreteEnergy, of: &Reference, u: &[f64], what: &str) -> (f64, Vec<f64>) {
    let (n, p) = (u.len(), Random(13).vector(u.len()));
    let left = of.left();
    let along: Vec<Dual> = u.iter().zip(&p).map(|(u, p)| Dual(*u, *p)).collect();
    let (shares, changed) = by_hand(&of.body, &left, &along);
    let (shares, forces) = (values(&shares), values(&changed));
    let product: Vec<f64> = changed.iter().map(|x| x.1).collect();
    let total: f64 = shares.iter().sum();
    let near = |found: &[f64], expected: &[f64], order: &str| {
        let error = if norm(expected) == 0.0 { norm(found) } else { distance(found, expected) };
        assert!(error < 1e-12, "{what}: {order} by {error}");
    };
    let mut found = vec![0.0; n];
    near(&[energy.forces(u, &mut found).unwrap().total()], &[total], "energy");
    near(&found, &forces, "forces");
    near(&[energy.energy(u).unwrap().total()], &[total], "energy alone");
    let mut alone = vec![0.0; n];
    energy.evaluate(u, piola_runtime::energy::Wanted::Forces(&mut alone), &mut []).unwrap();
    near(&alone, &forces, "forces alone");
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let mut beside = vec![0.0; n];
    near(
        &[energy.tangent(u, &mut beside, &mut tangent).unwrap().total()],
        &[total],
        "energy beside",
    );
    near(&beside, &forces, "forces beside");
    let matrix = dense(&tangent);
    let stored: Vec<f64> = (0..n).map(|r| (0..n).map(|c| matrix[r * n + c] * p[c]).sum()).collect();
    near(&stored, &product, "stored tangent");
    let mut quick = vec![0.0; n];
    energy.hessian(u).unwrap().multiply(&p, &mut quick);
    near(&quick, &product, "product");
    let mut own = vec![0.0; of.body.n_points()];
    energy.shares(u, &mut own).unwrap();
    near(&own, &shares, "shares");
    (total, found)
}

fn some(n: usize, share: f64, random: &mut Random) -> Vec<usize> {
    (0..n).filter(|_| random.next() < 2.0 * share - 1.0).collect()
}

#[test]
fn what_is_left_is_the_sum_over_cliques_that_are_left() {
    let bodies = [
        (cloud(&[11, 8], 0.1, 5), 0.29),
        (cloud(&[6, 5, 4], 0.1, 6), 0.21),
        (lattice(&[0.0, 0.0], &[20, 16], 0.1), 0.31),
        (lattice(&[0.0, 0.0, 0.0], &[11, 3, 9], 0.1), 0.181),
    ];
    for (number, (body, horizon)) in bodies.iter().enumerate() {
        for (level, with_bonds) in [(Level::Fast, true), (Level::Strict, false)] {
            let mut energy = energy(body, *horizon, level, with_bonds);
            assert!(energy.can_lose_bonds());
            // At the strict level nothing goes along rows.
            let goes_along_rows = body.spacing().is_some() && level == Level::Fast;
            for measure in &Measure::ALL[1..body.dimension()] {
                assert_eq!(energy.along_rows().contains(measure), goes_along_rows);
            }
            let mut of = Reference::new(body, *horizon, with_bonds);
            let ranks = ranks(body, &of.neighborhood);
            for (ranks, all) in ranks.iter().zip(&of.all[1..body.dimension()]) {
                assert_eq!(ranks.count(), all.len());
            }
            let u = displacements(body, 0.08, 3);
            let way = Random(11).vector(u.len());
            let mut random = Random(7);
            let mut old = check(&energy, &of, &u, &format!("body {number}, whole"));
            for (step, share) in [0.02, 0.1, 1.0].into_iter().enumerate() {
                let mut lost = some(of.is_broken.len(), share, &mut random);
                lost.retain(|bond| !of.is_broken[*bond]);
                let release = energy.break_bonds(&u, (0.5, &way), &lost).unwrap();
                lost.iter().for_each(|bond| of.is_broken[*bond] = true);
                let what = format!("body {number}, bonds {step}");
                old = released(old, check(&energy, &of, &u, &what), &release, &way, &what);
                for (kind, measure) in [Measure::Area, Measure::Volume].into_iter().enumerate() {
                    let own = some(of.all[kind + 1].len(), share, &mut random);
                    let cliques = (measure, &ranks[kind], &own[..]);
                    let release = energy.break_cliques(&u, (0.5, &way), cliques).unwrap();
                    of.gone[kind].extend(own);
                    let what = format!("body {number}, {measure:?} {step}");
                    old = released(old, check(&energy, &of, &u, &what), &release, &way, &what);
                }
            }
            assert_eq!((old.0, norm(&old.1)), (0.0, 0.0), "nothing is left");
        }
    }
}

fn ranks(body: &Body, neighborhood: &Neighborhood) -> [Ranks; 2] {
    let slabs = Slabs::new(neighborhood);
    match body.dimension() {
        2 => [2, 3].map(|_| Ranks::new::<2, 2>(body, neighborhood, &slabs)),
        _ => [
            Ranks::new::<3, 2>(body, neighborhood, &slabs),
            Ranks::new::<3, 3>(body, neighborhood, &slabs),
        ],
    }
}

/// What is released is what is missing, and so is the power of its forces.
fn released(
    (before, old): (f64, Vec<f64>),
    (after, new): (f64, Vec<f64>),
    release: &Release,
    way: &[f64],
    what: &str,
) -> (f64, Vec<f64>) {
    let error = (release.energy - (before - after)).abs();
    assert!(error <= 1e-13 * before, "{what}: {error} of {before}");
    let power: f64 = (0..way.len()).map(|k| (old[k] - new[k]) * way[k]).sum();
    let size: f64 = (0..way.len()).map(|k| (old[k] * way[k]).abs()).sum();
    assert!((release.timing - 0.25 * power).abs() <= 1e-13 * size, "{what}: timing");
    (after, new)
}

/// Broken cliques may be anywhere: flat, turned over, as large as they like.
#[test]
fn a_point_without_bonds_flies_off() {
    for (body, horizon) in
        [(cloud(&[11, 8], 0.1, 5), 0.29), (lattice(&[0.0, 0.0, 0.0], &[9, 4, 3], 0.1), 0.181)]
    {
        let mut energy = energy(&body, horizon, Level::Fast, true);
        let neighborhood = Neighborhood::new(&body, horizon).unwrap();
        let (point, d) = (body.n_points() / 2, body.dimension());
        let own = |bond: &usize| neighborhood.ends(*bond).contains(&point);
        energy.lose(&(0..neighborhood.n_bonds()).filter(own).collect::<Vec<_>>());
        for far in [-1e9, 1e12] {
            let mut u = displacements(&body, 0.01, 4);
            u[point * d..(point + 1) * d].fill(far);
            let mut forces = vec![0.0; u.len()];
            let stored = energy.forces(&u, &mut forces).unwrap().total();
            assert!(stored.is_finite() && forces.iter().all(|x| x.is_finite()));
            assert!(forces[point * d..(point + 1) * d].iter().all(|x| *x == 0.0));
        }
    }
}
