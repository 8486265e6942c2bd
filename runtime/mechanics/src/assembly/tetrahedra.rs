//! The tetrahedra of one owner, summed over the pairs of their other corners before any derivative
//! of a volume is written out.
//!
//! With vectors from the owner, `v = xj.(xk x xl)` is linear in each. Let `f` and `s` be the weighted
//! first and second derivatives of the energy in `v`. For a pair `a < b` of an owner's members, with
//! `c` the third corner of each tetrahedron on that pair and `f` negative where `c` lies between `a`
//! and `b` in the order of the points, all that the derivatives need are the moments
//!
//! ```text
//! M = sum of s xc xc^T     p = sum of f xc
//! ```
//!
//! From `xb x xc = [xb] xc` follow the block of the pair and what it adds to its corners:
//!
//! ```text
//! block (a, b):           -[xb] M [xa]^T - [p]
//! block (a, a), (b, b):   [xb] M [xb]^T / 2,  [xa] M [xa]^T / 2
//! gradient at a, at b:    xb x p / 2,         -xa x p / 2
//! ```
//!
//! The halves are there because each tetrahedron is seen on both pairs at a corner. So a tetrahedron
//! costs three times nine products and sums instead of a Hessian of 45 entries and their scattering.
//! Tetrahedra on a fixed pair of members stand side by side in vector registers, and share the normal
//! of their base.

mod block;
mod registers;

use block::{Block, Thirds};
use pulp::Arch;
use registers::{Measuring, Summing};

use super::accumulate::{Added, OwnerSums};
use super::pairs::PairNumbers;
use super::sum::Sum;
use super::visit;
use crate::element::{Order, WIDEST};
use crate::geometry::{cross, dot};
use crate::interaction::{Clique, OwnerCliques};
use crate::kernel::{Batch, Law, Outputs};
use crate::weights::CliqueWeights;

/// Lanes evaluated at once: their numbers stay in the first-level cache.
const CAPACITY: usize = 256;

/// `p`, then `xx, xy, xz, yy, yz, zz` of `M`.
type Moments = [f64; 9];

type Vector = [f64; 3];

/// What is the same for all owners.
pub(super) struct Rules<'a> {
    pub(super) law: &'a dyn Law,
    pub(super) arch: Arch,
    pub(super) weights: &'a CliqueWeights,
    pub(super) order: Order,
    /// Smaller volumes are refused.
    pub(super) least: f64,
}

/// What is known of one owner.
pub(super) struct Owner<'a> {
    pub(super) cliques: &'a OwnerCliques<'a, 3>,
    pub(super) members: &'a visit::Members<3>,
    pub(super) pairs: &'a PairNumbers,
}

/// The members of an owner now.
#[derive(Default)]
struct Members {
    now: Vec<Vector>,
    square: Vec<f64>,
    moments: Vec<Moments>,
}

impl Members {
    fn set(&mut self, owner: &Owner<'_>) {
        self.now.clear();
        let rest = owner.cliques.reference().iter();
        self.now.extend(rest.zip(&owner.members.displacement).map(|(rest, eta)| plus(rest, eta)));
        self.square.clear();
        self.square.extend(self.now.iter().map(|x| dot(x, x)));
        self.moments.clear();
        self.moments.extend(self.now.iter().map(moments));
    }
}

/// Room for the tetrahedra of one owner after the other.
#[derive(Default)]
pub(super) struct TetrahedronSums {
    members: Members,
    pairs: Vec<Moments>,
    thirds: Thirds,
    block: Block,
    /// Tetrahedra that have lost digits and need another treatment.
    pub(super) thin: Vec<Clique>,
    /// The energy of the owner.
    pub(super) energy: Sum,
}

impl TetrahedronSums {
    /// Room for owners of so many members.
    pub(super) fn with_capacity(members: usize) -> TetrahedronSums {
        TetrahedronSums {
            members: Members {
                now: Vec::with_capacity(members),
                square: Vec::with_capacity(members),
                moments: Vec::with_capacity(members),
            },
            pairs: Vec::with_capacity(members * members / 2),
            thirds: Thirds::with_capacity(members),
            block: Block::with_capacity((CAPACITY + members).div_ceil(WIDEST) + 1),
            thin: Vec::with_capacity(CAPACITY),
            energy: Sum::default(),
        }
    }

    /// Sums the tetrahedra of an owner; `false` if one of them was refused: the sums then mean
    /// nothing.
    pub(super) fn fill(&mut self, rules: &Rules<'_>, owner: &Owner<'_>) -> bool {
        self.pairs.clear();
        self.pairs.resize(owner.pairs.count(), [0.0; 9]);
        self.thin.clear();
        self.energy = Sum::default();
        self.members.set(owner);
        for k in 0..owner.cliques.members().len() {
            self.thirds.set(owner, &self.members, k);
            let width = self.thirds.width();
            if width == 0 {
                continue;
            }
            self.block.restart();
            for j in (0..k).filter(|&j| owner.cliques.are_neighbors(j, k)) {
                if WIDEST * self.block.weight.len() + width > CAPACITY && !self.run(rules, owner) {
                    return false;
                }
                self.block.add_row(rules, owner, &self.members, &self.thirds, j);
            }
            if !self.run(rules, owner) {
                return false;
            }
            if rules.order >= Order::Force {
                self.thirds.add_to(&mut self.pairs, owner, k);
            }
        }
        true
    }

    /// Evaluates the block and empties it.
    fn run(&mut self, rules: &Rules<'_>, owner: &Owner<'_>) -> bool {
        let block = &mut self.block;
        if block.rows.is_empty() {
            return true;
        }
        block.make_room();
        let (members, thirds) = (&self.members, &self.thirds);
        let measuring = Measuring { block, thirds, members, weights: rules.weights, owner };
        if rules.arch.dispatch(measuring) {
            block.set_thin_apart(&self.thirds, &mut self.thin);
        }
        let inputs = Batch {
            measure: block.measure.as_flattened(),
            reference: block.reference.as_flattened(),
            change: block.change.as_flattened(),
            fields: &[],
        };
        let outputs = Outputs {
            psi: block.psi.as_flattened_mut(),
            dpsi: block.first.as_flattened_mut(),
            d2psi: block.second.as_flattened_mut(),
        };
        rules.law.evaluate(inputs, rules.order, outputs);
        let summing = Summing {
            block,
            members: &self.members,
            thirds: &mut self.thirds,
            pairs: &mut self.pairs,
            energy: &mut self.energy,
            order: rules.order,
            least: rules.least,
        };
        let is_fine = rules.arch.dispatch(summing);
        if rules.order >= Order::Force {
            block.scatter(&self.members.moments[self.thirds.k], rules.order, &mut self.pairs);
        }
        block.restart();
        is_fine
    }

    /// Writes out the derivatives from the moments.
    pub(super) fn derive(&self, owner: &Owner<'_>, added: Added, sums: &mut OwnerSums<3>) {
        if !added.forces && !added.blocks {
            return;
        }
        let mut number = 0;
        for a in 0..owner.cliques.members().len() {
            let xa = self.members.now[a];
            for (b, _) in owner.cliques.later(a) {
                let xb = self.members.now[b];
                let moments = &self.pairs[number];
                let p = [moments[0], moments[1], moments[2]];
                if added.forces {
                    sums.add_gradient(a, &cross(&xb, &p).map(|g| 0.5 * g));
                    sums.add_gradient(b, &cross(&xa, &p).map(|g| -0.5 * g));
                }
                if added.blocks {
                    add_blocks(moments, (a, &xa), (b, &xb), number, sums);
                }
                number += 1;
            }
        }
    }
}

/// The blocks of one pair.
fn add_blocks(
    moments: &Moments,
    (a, xa): (usize, &Vector),
    (b, xb): (usize, &Vector),
    number: usize,
    sums: &mut OwnerSums<3>,
) {
    let &[px, py, pz, xx, xy, xz, yy, yz, zz] = moments;
    let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    // M [x]^T has the rows x x (row of M): M is symmetric.
    let (from_a, from_b) = (rows.map(|row| cross(xa, &row)), rows.map(|row| cross(xb, &row)));
    let mixed = crossed(xb, &from_a);
    let twist = [[0.0, -pz, py], [pz, 0.0, -px], [-py, px, 0.0]];
    let pair = std::array::from_fn(|r| std::array::from_fn(|c| -mixed[r][c] - twist[r][c]));
    sums.add_pair(number, &pair);
    sums.add_diagonal(a, &crossed(xb, &from_b).map(|row| row.map(|x| 0.5 * x)));
    sums.add_diagonal(b, &crossed(xa, &from_a).map(|row| row.map(|x| 0.5 * x)));
}

/// `[x] R`: the cross products of `x` with the columns of `R`.
fn crossed(x: &Vector, rows: &[Vector; 3]) -> [Vector; 3] {
    let mut product = [[0.0; 3]; 3];
    for column in 0..3 {
        let crossed = cross(x, &[rows[0][column], rows[1][column], rows[2][column]]);
        for row in 0..3 {
            product[row][column] = crossed[row];
        }
    }
    product
}

fn plus(p: &Vector, q: &Vector) -> Vector {
    std::array::from_fn(|axis| p[axis] + q[axis])
}

/// `x` and `x x^T`.
fn moments(x: &Vector) -> Moments {
    let [a, b, c] = *x;
    [a, b, c, a * a, a * b, a * c, b * b, b * c, c * c]
}
