//! The assembly as plain code would do it: n = 1, current positions instead of displacements, no
//! guards against thin or inverted interactions, no energies, one thread.
//!
//! Triangles send the block of their two members straight to the matrix and add up the rest per
//! owner; tetrahedra add up everything in a dense array per owner. Both were the fastest of five
//! designs when the assembly was laid out.

mod kernel;

use piola_runtime::body::Body;
use piola_runtime::neighborhood::Neighborhood;

use kernel::{LANES, Tetrahedra, Triangles};

type Vector = [f64; 3];
/// A block, row by row.
type Block = [f64; 9];

/// Measures below this are no interactions; points are a unit apart.
const FLAT: f64 = 1e-9;

/// Points with their later neighbours, and room for the gradient and the upper blocks of the tangent.
pub(crate) struct Plain {
    at_rest: Vec<Vector>,
    now: Vec<Vector>,
    /// Blocks `row_start[i]..row_start[i + 1]`: the diagonal one, then those of `columns`.
    row_start: Vec<usize>,
    columns: Vec<u32>,
    pub(crate) gradient: Vec<Vector>,
    pub(crate) tangent: Vec<Block>,
}

impl Plain {
    /// At most 64 later neighbours per point.
    pub(crate) fn new(body: &Body, horizon: f64, u: &[f64]) -> Plain {
        let neighborhood = Neighborhood::new(body, horizon).expect("a cube has neighbours");
        let n = body.n_points();
        let rows =
            |x: &[f64]| -> Vec<Vector> { x.chunks_exact(3).map(|x| [x[0], x[1], x[2]]).collect() };
        let at_rest = rows(body.positions());
        let now = at_rest.iter().zip(rows(u)).map(|(x, u)| sum(x, &u)).collect();
        let (mut row_start, mut columns) = (vec![0], Vec::new());
        for point in 0..n {
            assert!(neighborhood.upper(point).len() <= 64, "one word per row");
            columns.push(point as u32);
            columns.extend_from_slice(neighborhood.upper(point));
            row_start.push(columns.len());
        }
        let (gradient, tangent) = (vec![[0.0; 3]; n], vec![[0.0; 9]; columns.len()]);
        Plain { at_rest, now, row_start, columns, gradient, tangent }
    }

    /// Gradient and tangent of all triangles; how many there are.
    pub(crate) fn triangles(&mut self) -> u64 {
        self.clear();
        let mut count = 0;
        let mut owner = Owner::default();
        for point in 0..self.now.len() {
            owner.set(self, point);
            let (mut batch, mut lanes) = (Triangles::default(), [(0, 0); LANES]);
            let mut filled = 0;
            for j in 0..owner.members.len() {
                let mut bits = owner.bits[j];
                while bits != 0 {
                    let k = bits.trailing_zeros() as usize;
                    bits &= bits - 1;
                    let normal = cross(&owner.at_rest[j], &owner.at_rest[k]);
                    let area = dot(&normal, &normal).sqrt();
                    if area < FLAT {
                        continue;
                    }
                    batch.set(filled, &owner.now[j], &owner.now[k], 1.0 / area);
                    lanes[filled] = (j, k);
                    filled += 1;
                    count += 1;
                    if filled == LANES {
                        batch.evaluate();
                        self.scatter_triangles(&mut owner, &batch, &lanes);
                        filled = 0;
                    }
                }
            }
            if filled > 0 {
                batch.evaluate();
                self.scatter_triangles(&mut owner, &batch, &lanes[..filled]);
            }
            self.write_owner(&mut owner);
        }
        count
    }

    fn scatter_triangles(
        &mut self,
        owner: &mut Owner,
        batch: &Triangles,
        lanes: &[(usize, usize)],
    ) {
        for (lane, &(j, k)) in lanes.iter().enumerate() {
            for axis in 0..3 {
                owner.gradient[j][axis] += batch.out.gradient[axis][lane];
                owner.gradient[k][axis] += batch.out.gradient[3 + axis][lane];
            }
            let block = &mut self.tangent[owner.place[j * 64 + k] as usize];
            for entry in 0..9 {
                let mixed = batch.out.mixed[entry][lane];
                block[entry] += mixed;
                owner.column[k][entry] += mixed;
                owner.column[j][entry % 3 * 3 + entry / 3] += mixed;
            }
            for (part, entry) in UPPER.into_iter().enumerate() {
                owner.diagonal[j][entry] += batch.out.own[0][part][lane];
                owner.diagonal[k][entry] += batch.out.own[1][part][lane];
            }
        }
    }

    /// Gradient and tangent of all tetrahedra; how many there are.
    pub(crate) fn tetrahedra(&mut self) -> u64 {
        self.clear();
        let mut count = 0;
        let mut owner = Owner { pairs: vec![[0.0; 9]; 64 * 64], ..Owner::default() };
        for point in 0..self.now.len() {
            owner.set(self, point);
            let (mut batch, mut lanes) = (Tetrahedra::default(), [(0, 0, 0); LANES]);
            let mut filled = 0;
            for j in 0..owner.members.len() {
                let mut bits = owner.bits[j];
                while bits != 0 {
                    let k = bits.trailing_zeros() as usize;
                    bits &= bits - 1;
                    let normal = cross(&owner.at_rest[j], &owner.at_rest[k]);
                    let mut common = owner.bits[j] & owner.bits[k];
                    while common != 0 {
                        let l = common.trailing_zeros() as usize;
                        common &= common - 1;
                        let volume = dot(&normal, &owner.at_rest[l]);
                        if volume.abs() < FLAT {
                            continue;
                        }
                        let corners = [&owner.now[j], &owner.now[k], &owner.now[l]];
                        batch.set(filled, corners, volume);
                        lanes[filled] = (j, k, l);
                        filled += 1;
                        count += 1;
                        if filled == LANES {
                            batch.evaluate();
                            owner.add_tetrahedra(&batch, &lanes);
                            filled = 0;
                        }
                    }
                }
            }
            if filled > 0 {
                batch.evaluate();
                owner.add_tetrahedra(&batch, &lanes[..filled]);
            }
            self.write_pairs(&mut owner);
            self.write_owner(&mut owner);
        }
        count
    }

    /// Sends the blocks of pairs of members to the matrix and adds them to the columns.
    fn write_pairs(&mut self, owner: &mut Owner) {
        for j in 0..owner.members.len() {
            let mut bits = owner.bits[j];
            while bits != 0 {
                let k = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let part = std::mem::take(&mut owner.pairs[j * 64 + k]);
                let block = &mut self.tangent[owner.place[j * 64 + k] as usize];
                for entry in 0..9 {
                    block[entry] += part[entry];
                    owner.column[k][entry] += part[entry];
                    owner.column[j][entry % 3 * 3 + entry / 3] += part[entry];
                }
            }
        }
    }

    /// The members' own blocks, and the owner's row: minus the sum of the others.
    fn write_owner(&mut self, owner: &mut Owner) {
        let row = self.row_start[owner.point];
        let mut total = [0.0; 9];
        for (member, &point) in owner.members.iter().enumerate() {
            let mut own = owner.diagonal[member];
            (own[3], own[6], own[7]) = (own[1], own[2], own[5]);
            let diagonal = &mut self.tangent[self.row_start[point as usize]];
            let gradient = &mut self.gradient[point as usize];
            for entry in 0..9 {
                diagonal[entry] += own[entry];
            }
            for axis in 0..3 {
                gradient[axis] += owner.gradient[member][axis];
            }
            let coupling = &mut self.tangent[row + 1 + member];
            for entry in 0..9 {
                let column = own[entry] + owner.column[member][entry];
                coupling[entry] -= column;
                total[entry] += column;
            }
            for axis in 0..3 {
                self.gradient[owner.point][axis] -= owner.gradient[member][axis];
            }
        }
        for entry in 0..9 {
            self.tangent[row][entry] += total[entry];
        }
    }

    fn clear(&mut self) {
        self.gradient.fill([0.0; 3]);
        self.tangent.fill([0.0; 9]);
    }
}

/// Places of the upper triangle in a block.
const UPPER: [usize; 6] = [0, 1, 2, 4, 5, 8];

/// What is known of and added up for the owner at hand.
#[derive(Default)]
struct Owner {
    point: usize,
    members: Vec<u32>,
    /// From the owner to its members.
    at_rest: Vec<Vector>,
    now: Vec<Vector>,
    /// Bit `k` of row `j`: members `j < k` are neighbours.
    bits: Vec<u64>,
    /// Where the block of members `j`, `k` stands.
    place: Vec<u32>,
    /// Member number of a point, plus one.
    member: Vec<u32>,
    gradient: Vec<Vector>,
    diagonal: Vec<Block>,
    column: Vec<Block>,
    pairs: Vec<Block>,
}

impl Owner {
    fn set(&mut self, plain: &Plain, point: usize) {
        self.point = point;
        let upper = |point: usize| plain.row_start[point] + 1..plain.row_start[point + 1];
        self.members.clear();
        self.members.extend_from_slice(&plain.columns[upper(point)]);
        let n = self.members.len();
        let relative = |all: &[Vector], to: &mut Vec<Vector>| {
            to.clear();
            let from = all[point];
            to.extend(self.members.iter().map(|&m| difference(&all[m as usize], &from)));
        };
        relative(&plain.at_rest, &mut self.at_rest);
        relative(&plain.now, &mut self.now);
        self.member.resize(plain.now.len(), 0);
        self.place.resize(64 * 64, 0);
        for (number, &point) in self.members.iter().enumerate() {
            self.member[point as usize] = number as u32 + 1;
        }
        self.bits.clear();
        for (j, &point) in self.members.iter().enumerate() {
            let mut bits = 0;
            for place in upper(point as usize) {
                let k = self.member[plain.columns[place] as usize];
                if k > 0 {
                    bits |= 1 << (k - 1);
                    self.place[j * 64 + k as usize - 1] = place as u32;
                }
            }
            self.bits.push(bits);
        }
        for &point in &self.members {
            self.member[point as usize] = 0;
        }
        self.gradient.clear();
        self.gradient.resize(n, [0.0; 3]);
        for blocks in [&mut self.diagonal, &mut self.column] {
            blocks.clear();
            blocks.resize(n, [0.0; 9]);
        }
    }

    fn add_tetrahedra(&mut self, batch: &Tetrahedra, lanes: &[(usize, usize, usize)]) {
        for (lane, &(j, k, l)) in lanes.iter().enumerate() {
            for (corner, member) in [j, k, l].into_iter().enumerate() {
                for axis in 0..3 {
                    self.gradient[member][axis] += batch.out.gradient[3 * corner + axis][lane];
                }
                for (part, entry) in UPPER.into_iter().enumerate() {
                    self.diagonal[member][entry] += batch.out.own[corner][part][lane];
                }
            }
            for (number, pair) in [j * 64 + k, j * 64 + l, k * 64 + l].into_iter().enumerate() {
                for entry in 0..9 {
                    self.pairs[pair][entry] += batch.out.pairs[number][entry][lane];
                }
            }
        }
    }
}

fn sum(p: &Vector, q: &Vector) -> Vector {
    std::array::from_fn(|axis| p[axis] + q[axis])
}

#[inline(always)]
fn difference(p: &Vector, q: &Vector) -> Vector {
    std::array::from_fn(|axis| p[axis] - q[axis])
}

#[inline(always)]
fn dot(p: &Vector, q: &Vector) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

#[inline(always)]
fn cross(p: &Vector, q: &Vector) -> Vector {
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
}
