//! Forces of triangles and of tetrahedra.

use piola_compiler::Measure;
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::neighborhood::Neighborhood;

use super::{HORIZON, ROUNDS, both_ways, in_three_ways};
use crate::ours::{SethHill, cube, displacement};
use crate::record::{Bar, Division, Statistic, Table};

pub(super) fn run() -> [Table; 2] {
    let triangles = Table::of_ratios(
        "triangle-forces",
        "Forces of triangles alone, from displacements, per triangle, psi = 1/2 A (a/A - 1)^2, 24^3 points, horizon 3; \
         runs in turn. Theirs: a scalar loop by hand over a list of the same triangles with their areas at rest.",
        ["ours, ns", "by hand, ns"],
        Division::OursByTheirs,
    );
    let tetrahedra = Table::of_ratios(
        "tetrahedron-forces",
        "Forces of tetrahedra alone, from displacements, per tetrahedron, psi = 1/2 V (v/V - 1)^2, 16^3 points, \
         horizon 3; runs in turn. Theirs: a scalar loop by hand over a list of the same tetrahedra with their volumes \
         at rest.",
        ["ours, ns", "by hand, ns"],
        Division::OursByTheirs,
    );
    [
        compare::<Triangles>(triangles, 24, Measure::Area, Bar::AtMost(0.5, 0.25)),
        compare::<Tetrahedra>(tetrahedra, 16, Measure::Volume, Bar::AtMost(0.5, 0.25)),
    ]
}

/// A list of interactions with a loop for their forces.
trait ByHand {
    fn new(body: &Body) -> Self;
    fn len(&self) -> usize;
    fn forces(&self, u: &[[f64; 3]], out: &mut [[f64; 3]]);
}

fn compare<L: ByHand>(mut table: Table, points: usize, measure: Measure, bar: Bar) -> Table {
    let body = cube(points);
    let [on_rows, in_batches] = both_ways(&SethHill::new(1.0), &body, measure);
    let u = displacement(&body);
    let list = L::new(&body);
    let count = match measure {
        Measure::Volume => on_rows.report().tetrahedra,
        _ => on_rows.report().triangles,
    };
    assert_eq!(list.len() as u64, count, "the same interactions");
    let by_hand = |out: &mut [[f64; 3]]| list.forces(u.as_chunks::<3>().0, out);
    let times = in_three_ways([&on_rows, &in_batches], &u, by_hand);
    let [rows, batches, theirs] = times.map(|seconds| seconds / count as f64 * 1e9);
    let of = Statistic::Least(ROUNDS);
    table.ratio("owners abreast", [rows, theirs], of, bar);
    table.ratio("in batches", [batches, theirs], of, Bar::None);
    table
}

/// Triangles with their areas at rest.
struct Triangles {
    positions: Vec<[f64; 3]>,
    corners: Vec<[u32; 3]>,
    areas: Vec<f64>,
}

fn minus(p: &[f64; 3], q: &[f64; 3]) -> [f64; 3] {
    [p[0] - q[0], p[1] - q[1], p[2] - q[2]]
}

fn plus(p: &[f64; 3], q: &[f64; 3]) -> [f64; 3] {
    [p[0] + q[0], p[1] + q[1], p[2] + q[2]]
}

fn cross(p: &[f64; 3], q: &[f64; 3]) -> [f64; 3] {
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
}

fn dot(p: &[f64; 3], q: &[f64; 3]) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

impl ByHand for Triangles {
    fn new(body: &Body) -> Triangles {
        let lists = Neighborhood::new(body, HORIZON).expect("a cube has neighbours");
        let positions = body.positions().as_chunks::<3>().0.to_vec();
        let mut all = Triangles { positions, corners: Vec::new(), areas: Vec::new() };
        for i in 0..body.n_points() {
            for (place, j) in lists.upper(i).iter().enumerate() {
                for k in lists.upper(i).iter().skip(place + 1) {
                    if lists.row(j as usize).contains(k) {
                        let [x, y, z] = [i, j as usize, k as usize].map(|p| all.positions[p]);
                        let normal = cross(&minus(&y, &x), &minus(&z, &x));
                        // On a lattice of unit spacing.
                        if dot(&normal, &normal) > 0.5 {
                            all.corners.push([i as u32, j, k]);
                            all.areas.push(dot(&normal, &normal).sqrt());
                        }
                    }
                }
            }
        }
        all
    }

    fn len(&self) -> usize {
        self.corners.len()
    }

    fn forces(&self, u: &[[f64; 3]], out: &mut [[f64; 3]]) {
        out.fill([0.0; 3]);
        for (&[i, j, k], &area) in self.corners.iter().zip(&self.areas) {
            let [i, j, k] = [i, j, k].map(|point| point as usize);
            let x = &self.positions;
            let (xi1, xi2) = (minus(&x[j], &x[i]), minus(&x[k], &x[i]));
            let (eta1, eta2) = (minus(&u[j], &u[i]), minus(&u[k], &u[i]));
            let (x1, x2) = (plus(&xi1, &eta1), plus(&xi2, &eta2));
            let at_rest = cross(&xi1, &xi2);
            let change = plus(&cross(&xi1, &eta2), &cross(&eta1, &x2));
            let normal = plus(&at_rest, &change);
            let grown = dot(&change, &plus(&normal, &at_rest));
            let now = dot(&normal, &normal).sqrt();
            let pull = grown / (area * (now + area) * now);
            let scaled = normal.map(|x| pull * x);
            let (p, q) = (cross(&x2, &scaled), cross(&scaled, &x1));
            for axis in 0..3 {
                out[j][axis] += p[axis];
                out[k][axis] += q[axis];
                out[i][axis] -= p[axis] + q[axis];
            }
        }
    }
}

/// Tetrahedra with their volumes at rest, which have the sign of their corners' order.
struct Tetrahedra {
    positions: Vec<[f64; 3]>,
    corners: Vec<[u32; 4]>,
    volumes: Vec<f64>,
}

impl ByHand for Tetrahedra {
    fn new(body: &Body) -> Tetrahedra {
        let lists = Neighborhood::new(body, HORIZON).expect("a cube has neighbours");
        let positions = body.positions().as_chunks::<3>().0.to_vec();
        let mut all = Tetrahedra { positions, corners: Vec::new(), volumes: Vec::new() };
        for i in 0..body.n_points() {
            let later: Vec<u32> = lists.upper(i).iter().collect();
            for (first, &j) in later.iter().enumerate() {
                let near_j = |k: &&u32| lists.row(j as usize).contains(**k);
                let near: Vec<u32> = later[first + 1..].iter().filter(near_j).copied().collect();
                for (second, &k) in near.iter().enumerate() {
                    for &l in near[second + 1..].iter() {
                        if lists.row(k as usize).contains(l) {
                            all.add([i as u32, j, k, l]);
                        }
                    }
                }
            }
        }
        all
    }

    fn len(&self) -> usize {
        self.corners.len()
    }

    fn forces(&self, u: &[[f64; 3]], out: &mut [[f64; 3]]) {
        out.fill([0.0; 3]);
        for (corners, &volume) in self.corners.iter().zip(&self.volumes) {
            let [i, j, k, l] = corners.map(|point| point as usize);
            let x = &self.positions;
            let [xi1, xi2, xi3] = [j, k, l].map(|other| minus(&x[other], &x[i]));
            let [eta1, eta2, eta3] = [j, k, l].map(|other| minus(&u[other], &u[i]));
            let [x1, x2, x3] = [plus(&xi1, &eta1), plus(&xi2, &eta2), plus(&xi3, &eta3)];
            let normal = cross(&x1, &x2);
            let change = plus(&cross(&xi1, &eta2), &cross(&eta1, &x2));
            let grown = dot(&normal, &eta3) + dot(&change, &xi3);
            // Where volumes are negative, so is how they grow.
            let pull = grown / volume.abs();
            let parts = [cross(&x2, &x3), cross(&x3, &x1), normal];
            for axis in 0..3 {
                let [p, q, r] = parts.map(|part| pull * part[axis]);
                out[j][axis] += p;
                out[k][axis] += q;
                out[l][axis] += r;
                out[i][axis] -= p + q + r;
            }
        }
    }
}

impl Tetrahedra {
    fn add(&mut self, corners: [u32; 4]) {
        let [w, x, y, z] = corners.map(|point| self.positions[point as usize]);
        let volume = dot(&cross(&minus(&x, &w), &minus(&y, &w)), &minus(&z, &w));
        // On a lattice of unit spacing.
        if volume.abs() > 0.5 {
            self.corners.push(corners);
            self.volumes.push(volume);
        }
    }
}
