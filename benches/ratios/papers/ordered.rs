//! The papers' loops, written plainly: for every point each neighbour, and each ordered triple of
//! neighbours that are within the horizon of each other.

use piola_runtime::body::Body;
use piola_runtime::neighborhood::Neighborhood;
use pulp::Arch;

use crate::hyperdual::{self, Block, LANES, Linear, Results};
use crate::samples::measure;

/// Smaller volumes are no interactions; points are a unit apart.
const FLAT: f64 = 1e-9;

/// Interactions evaluated at once: as many as in one of our batches.
const WAITING: usize = 32;

/// A body with its dense tangent.
pub(super) struct Ordered {
    neighbors: Vec<Vec<usize>>,
    /// Whether two points are within the horizon of each other.
    near: Vec<bool>,
    bonds: Waiting<2, 3>,
    tetrahedra: Waiting<4, 9>,
    pub(super) sums: Sums,
}

/// Points and what is added up.
pub(super) struct Sums {
    arch: Arch,
    at_rest: Vec<[f64; 3]>,
    now: Vec<[f64; 3]>,
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
            let row: Vec<usize> = neighborhood.row(point).iter().map(|q| q as usize).collect();
            for &other in &row {
                near[point * n + other] = true;
            }
            neighbors.push(row);
        }
        let (gradient, tangent) = (vec![0.0; 3 * n], vec![0.0; 9 * n * n]);
        let sums = Sums { arch: Arch::new(), at_rest, now, gradient, tangent };
        Ordered { neighbors, near, bonds: Waiting::new(), tetrahedra: Waiting::new(), sums }
    }

    /// The point nearest to the middle of the body.
    pub(super) fn middle(&self) -> usize {
        self.neighbors.len() / 2
    }

    /// The interactions of a point; how many bonds and tetrahedra it visits.
    pub(super) fn visit(&mut self, point: usize) -> (u64, u64) {
        let Ordered { neighbors, near, bonds, tetrahedra, sums } = self;
        let (n, neighbors) = (neighbors.len(), &neighbors[point]);
        let (mut n_bonds, mut n_tetrahedra) = (0, 0);
        for &i in neighbors {
            n_bonds += u64::from(bonds.push([point, i], 1.0 / 2.0, sums));
            for &j in neighbors {
                if !near[i * n + j] {
                    continue;
                }
                for &k in neighbors {
                    if near[i * n + k] && near[j * n + k] {
                        let corners = [point, i, j, k];
                        n_tetrahedra += u64::from(tetrahedra.push(corners, 1.0 / 24.0, sums));
                    }
                }
            }
        }
        bonds.finish(sums);
        tetrahedra.finish(sums);
        (n_bonds, n_tetrahedra)
    }
}

/// Interactions of one kind on their way through the hyper-dual numbers.
struct Waiting<const K: usize, const C: usize> {
    corners: Vec<[usize; K]>,
    blocks: [Block<C>; WAITING / LANES],
    results: [Results<C>; WAITING / LANES],
}

impl<const K: usize, const C: usize> Waiting<K, C> {
    fn new() -> Waiting<K, C> {
        Waiting {
            corners: Vec::with_capacity(WAITING),
            blocks: [Block::EMPTY; WAITING / LANES],
            results: [Results::ZERO; WAITING / LANES],
        }
    }

    /// Whether there is one: four points in a plane have no volume.
    fn push(&mut self, corners: [usize; K], weight: f64, sums: &mut Sums) -> bool {
        let reference = measure(&relative::<K, C>(&sums.at_rest, corners));
        if reference.abs() < FLAT {
            return false;
        }
        let (number, now) = (self.corners.len(), relative(&sums.now, corners));
        self.blocks[number / LANES].set(number % LANES, &now, reference, weight);
        self.corners.push(corners);
        if self.corners.len() == WAITING {
            self.finish(sums);
        }
        true
    }

    /// Evaluates and adds up what waits.
    fn finish(&mut self, sums: &mut Sums) {
        let filled = self.corners.len().div_ceil(LANES);
        let (blocks, results) = (&self.blocks[..filled], &mut self.results[..filled]);
        hyperdual::evaluate::<Linear, C>(sums.arch, blocks, results);
        for (number, corners) in self.corners.drain(..).enumerate() {
            sums.add(corners, &results[number / LANES], number % LANES);
        }
    }
}

/// Vectors from the first corner to the others.
fn relative<const K: usize, const C: usize>(x: &[[f64; 3]], corners: [usize; K]) -> [f64; C] {
    std::array::from_fn(|c| x[corners[1 + c / 3]][c % 3] - x[corners[0]][c % 3])
}

impl Sums {
    /// Adds derivatives in the relative vectors to all corners: the first moves against them.
    fn add<const K: usize, const C: usize>(
        &mut self,
        corners: [usize; K],
        out: &Results<C>,
        lane: usize,
    ) {
        let n = 3 * self.at_rest.len();
        let owner = 3 * corners[0];
        for row in 0..C {
            let to_row = 3 * corners[1 + row / 3] + row % 3;
            self.gradient[to_row] += out.gradient[row][lane];
            self.gradient[owner + row % 3] -= out.gradient[row][lane];
            for column in 0..C {
                let entry = out.tangent[row.max(column)][row.min(column)][lane];
                let to_column = 3 * corners[1 + column / 3] + column % 3;
                self.tangent[to_row * n + to_column] += entry;
                self.tangent[to_row * n + owner + column % 3] -= entry;
                self.tangent[(owner + row % 3) * n + to_column] -= entry;
                self.tangent[(owner + row % 3) * n + owner + column % 3] += entry;
            }
        }
    }
}
