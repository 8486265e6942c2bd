//! The papers' loops, written plainly: for every point each neighbour, and each ordered triple of
//! neighbours that are within the horizon of each other.

use piola_runtime::body::Body;
use piola_runtime::neighborhood::Neighborhood;

use crate::hyperdual::{self, Linear};
use crate::samples::measure;

/// Smaller volumes are no interactions; points are a unit apart.
const FLAT: f64 = 1e-9;

/// A body with its dense tangent.
pub(super) struct Ordered {
    at_rest: Vec<[f64; 3]>,
    now: Vec<[f64; 3]>,
    neighbors: Vec<Vec<usize>>,
    /// Whether two points are within the horizon of each other.
    near: Vec<bool>,
    pub(super) gradient: Vec<f64>,
    pub(super) tangent: Vec<f64>,
}

impl Ordered {
    pub(super) fn new(body: &Body, horizon: f64, u: &[f64]) -> Ordered {
        let n = body.n_points();
        let neighborhood = Neighborhood::new(body, horizon).expect("a cube has neighbours");
        let row = |x: &[f64], point: usize| std::array::from_fn(|axis| x[3 * point + axis]);
        let at_rest: Vec<[f64; 3]> = (0..n).map(|point| row(body.positions(), point)).collect();
        let moved = |point: usize| {
            let u: [f64; 3] = row(u, point);
            std::array::from_fn(|axis| at_rest[point][axis] + u[axis])
        };
        let now = (0..n).map(moved).collect();
        let mut near = vec![false; n * n];
        let mut neighbors = Vec::new();
        for point in 0..n {
            let row: Vec<usize> = neighborhood.row(point).iter().map(|&q| q as usize).collect();
            for &other in &row {
                near[point * n + other] = true;
            }
            neighbors.push(row);
        }
        let (gradient, tangent) = (vec![0.0; 3 * n], vec![0.0; 9 * n * n]);
        Ordered { at_rest, now, neighbors, near, gradient, tangent }
    }

    /// The point nearest to the middle of the body.
    pub(super) fn middle(&self) -> usize {
        self.at_rest.len() / 2
    }

    /// The interactions of a point; how many bonds and tetrahedra it visits.
    pub(super) fn visit(&mut self, point: usize) -> (u64, u64) {
        let n = self.at_rest.len();
        let neighbors = self.neighbors[point].clone();
        let (mut bonds, mut tetrahedra) = (0, 0);
        for &i in &neighbors {
            self.bond([point, i]);
            bonds += 1;
            for &j in &neighbors {
                if !self.near[i * n + j] {
                    continue;
                }
                for &k in &neighbors {
                    if self.near[i * n + k] && self.near[j * n + k] {
                        tetrahedra += u64::from(self.tetrahedron([point, i, j, k]));
                    }
                }
            }
        }
        (bonds, tetrahedra)
    }

    fn bond(&mut self, corners: [usize; 2]) {
        let mut out = hyperdual::Result { energy: 0.0, gradient: [0.0; 3], tangent: [[0.0; 3]; 3] };
        let reference = measure(&self.relative::<2, 3>(&self.at_rest, corners));
        let now = self.relative(&self.now, corners);
        hyperdual::evaluate::<Linear, 3>(&now, reference, 1.0 / 2.0, &mut out);
        self.add(corners, &out);
    }

    /// Whether there is one: four points in a plane have no volume.
    fn tetrahedron(&mut self, corners: [usize; 4]) -> bool {
        let mut out = hyperdual::Result { energy: 0.0, gradient: [0.0; 9], tangent: [[0.0; 9]; 9] };
        let reference = measure(&self.relative::<4, 9>(&self.at_rest, corners));
        if reference.abs() < FLAT {
            return false;
        }
        let now = self.relative(&self.now, corners);
        hyperdual::evaluate::<Linear, 9>(&now, reference, 1.0 / 24.0, &mut out);
        self.add(corners, &out);
        true
    }

    /// Vectors from the first corner to the others.
    fn relative<const K: usize, const C: usize>(
        &self,
        x: &[[f64; 3]],
        corners: [usize; K],
    ) -> [f64; C] {
        std::array::from_fn(|c| x[corners[1 + c / 3]][c % 3] - x[corners[0]][c % 3])
    }

    /// Adds derivatives in the relative vectors to all corners: the first moves against them.
    fn add<const K: usize, const C: usize>(
        &mut self,
        corners: [usize; K],
        out: &hyperdual::Result<C>,
    ) {
        let n = 3 * self.at_rest.len();
        let owner = 3 * corners[0];
        for row in 0..C {
            let to_row = 3 * corners[1 + row / 3] + row % 3;
            self.gradient[to_row] += out.gradient[row];
            self.gradient[owner + row % 3] -= out.gradient[row];
            for column in 0..C {
                let entry = out.tangent[row.max(column)][row.min(column)];
                let to_column = 3 * corners[1 + column / 3] + column % 3;
                self.tangent[to_row * n + to_column] += entry;
                self.tangent[to_row * n + owner + column % 3] -= entry;
                self.tangent[(owner + row % 3) * n + to_column] -= entry;
                self.tangent[(owner + row % 3) * n + owner + column % 3] += entry;
            }
        }
    }
}
