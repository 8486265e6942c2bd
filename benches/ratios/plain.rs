//! The assembly as plain code would do it: n = 1, current positions instead of displacements, no
//! guards against thin or inverted interactions, no energies, one thread.
//!
//! Who of an owner's later neighbours are neighbours of each other, where their blocks stand and which
//! triangles are collinear at rest is found once for the body, as in ours. All loops are compiled for
//! the widest registers of the machine, as ours.
//!
//! Triangles send the block of their two members straight to the matrix and add up the rest per
//! owner; tetrahedra add up everything in a dense array per owner. Both were the fastest of five
//! designs when the assembly was laid out.

mod kernel;

use piola_runtime::body::Body;
use piola_runtime::neighborhood::Neighborhood;
use pulp::{Arch, Simd, WithSimd};

use kernel::{LANES, Tetrahedra, Triangles};

type Vector = [f64; 3];
/// A block, row by row.
type Block = [f64; 9];

/// Measures below this are no interactions; points are a unit apart.
const FLAT: f64 = 1e-9;

/// The members that make triangles with the owner and one of its members.
#[derive(Clone, Copy, Default)]
struct Pairs {
    /// Bit `k`: member `k`.
    members: u64,
    /// As many bits: the places of these members in the row of the one.
    places: u64,
}

impl Pairs {
    /// Members with the places of their blocks, from where the row of the one begins.
    #[inline(always)]
    fn each(self, row: usize) -> impl Iterator<Item = (usize, usize)> {
        let Pairs { mut members, mut places } = self;
        std::iter::from_fn(move || {
            if members == 0 {
                return None;
            }
            let (k, place) = (members.trailing_zeros(), places.trailing_zeros());
            members &= members - 1;
            places &= places - 1;
            Some((k as usize, row + 1 + place as usize))
        })
    }
}

/// Points with their later neighbours, and room for the gradient and the upper blocks of the tangent.
pub(crate) struct Plain {
    at_rest: Vec<Vector>,
    now: Vec<Vector>,
    /// Blocks `row_start[i]..row_start[i + 1]`: the diagonal one, then those of `columns`.
    row_start: Vec<usize>,
    columns: Vec<u32>,
    /// For every block but diagonal ones, that of owner `i` and member `j`: bit `k` is set if members
    /// `j < k` are neighbours and not collinear with the owner.
    pairs: Vec<Pairs>,
    arch: Arch,
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
            columns.extend(neighborhood.upper(point));
            row_start.push(columns.len());
        }
        let (gradient, tangent) = (vec![[0.0; 3]; n], vec![[0.0; 9]; columns.len()]);
        let (pairs, arch) = (vec![Pairs::default(); columns.len()], Arch::new());
        let mut plain = Plain { at_rest, now, row_start, columns, pairs, arch, gradient, tangent };
        plain.find_pairs();
        plain
    }

    fn find_pairs(&mut self) {
        let mut member_of = vec![None; self.now.len()];
        for point in 0..self.now.len() {
            let upper = |point: usize| self.row_start[point] + 1..self.row_start[point + 1];
            for (member, place) in upper(point).enumerate() {
                member_of[self.columns[place] as usize] = Some(member);
            }
            let from_owner = |k: usize| {
                difference(&self.at_rest[self.columns[k] as usize], &self.at_rest[point])
            };
            for place in upper(point) {
                let (first, mut pairs) = (from_owner(place), Pairs::default());
                for (number, other) in upper(self.columns[place] as usize).enumerate() {
                    let Some(k) = member_of[self.columns[other] as usize] else { continue };
                    let normal = cross(&first, &from_owner(upper(point).start + k));
                    if dot(&normal, &normal) >= FLAT * FLAT {
                        pairs.members |= 1 << k;
                        pairs.places |= 1 << number;
                    }
                }
                self.pairs[place] = pairs;
            }
            for place in upper(point) {
                member_of[self.columns[place] as usize] = None;
            }
        }
    }

    /// Gradient and tangent of all triangles; how many there are.
    pub(crate) fn triangles(&mut self) -> u64 {
        self.arch.dispatch(AllTriangles(self))
    }

    #[inline(always)]
    fn add_triangles(&mut self) -> u64 {
        self.clear();
        let mut count = 0;
        let mut owner = Owner::default();
        for point in 0..self.now.len() {
            owner.set(self, point);
            let (mut batch, mut lanes) = (Triangles::default(), [(0, 0, 0); LANES]);
            let mut filled = 0;
            for j in 0..owner.members.len() {
                for (k, place) in owner.pairs[j].each(owner.rows[j]) {
                    let normal = cross(&owner.at_rest[j], &owner.at_rest[k]);
                    batch.set(filled, &owner.now[j], &owner.now[k], dot(&normal, &normal));
                    lanes[filled] = (j, k, place);
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

    #[inline(always)]
    fn scatter_triangles(
        &mut self,
        owner: &mut Owner,
        batch: &Triangles,
        lanes: &[(usize, usize, usize)],
    ) {
        for (lane, &(j, k, place)) in lanes.iter().enumerate() {
            for axis in 0..3 {
                owner.gradient[j][axis] += batch.out.gradient[axis][lane];
                owner.gradient[k][axis] += batch.out.gradient[3 + axis][lane];
            }
            let block = &mut self.tangent[place];
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
        self.arch.dispatch(AllTetrahedra(self))
    }

    #[inline(always)]
    fn add_tetrahedra(&mut self) -> u64 {
        self.clear();
        let mut count = 0;
        let mut owner = Owner { blocks: vec![[0.0; 9]; 64 * 64], ..Owner::default() };
        for point in 0..self.now.len() {
            owner.set(self, point);
            let (mut batch, mut lanes) = (Tetrahedra::default(), [(0, 0, 0); LANES]);
            let mut filled = 0;
            for j in 0..owner.members.len() {
                for (k, _) in owner.pairs[j].each(0) {
                    let normal = cross(&owner.at_rest[j], &owner.at_rest[k]);
                    let mut common = owner.pairs[j].members & owner.pairs[k].members;
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
    #[inline(always)]
    fn write_pairs(&mut self, owner: &mut Owner) {
        for j in 0..owner.members.len() {
            for (k, place) in owner.pairs[j].each(owner.rows[j]) {
                let part = std::mem::take(&mut owner.blocks[j * 64 + k]);
                let block = &mut self.tangent[place];
                for entry in 0..9 {
                    block[entry] += part[entry];
                    owner.column[k][entry] += part[entry];
                    owner.column[j][entry % 3 * 3 + entry / 3] += part[entry];
                }
            }
        }
    }

    /// The members' own blocks, and the owner's row: minus the sum of the others.
    #[inline(always)]
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

    #[inline(always)]
    fn clear(&mut self) {
        self.gradient.fill([0.0; 3]);
        self.tangent.fill([0.0; 9]);
    }
}

/// Places of the upper triangle in a block.
const UPPER: [usize; 6] = [0, 1, 2, 4, 5, 8];

/// All triangles, in registers of whatever width.
struct AllTriangles<'a>(&'a mut Plain);

impl WithSimd for AllTriangles<'_> {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> u64 {
        self.0.add_triangles()
    }
}

/// All tetrahedra, in registers of whatever width.
struct AllTetrahedra<'a>(&'a mut Plain);

impl WithSimd for AllTetrahedra<'_> {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> u64 {
        self.0.add_tetrahedra()
    }
}

/// What is known of and added up for the owner at hand.
#[derive(Default)]
struct Owner {
    point: usize,
    members: Vec<u32>,
    /// From the owner to its members.
    at_rest: Vec<Vector>,
    now: Vec<Vector>,
    /// The triangles of each member.
    pairs: Vec<Pairs>,
    /// Where the rows of the members begin.
    rows: Vec<usize>,
    gradient: Vec<Vector>,
    diagonal: Vec<Block>,
    column: Vec<Block>,
    /// Blocks of pairs of members, 64 to a row.
    blocks: Vec<Block>,
}

impl Owner {
    #[inline(always)]
    fn set(&mut self, plain: &Plain, point: usize) {
        self.point = point;
        let row = plain.row_start[point] + 1..plain.row_start[point + 1];
        self.members.clear();
        self.members.extend_from_slice(&plain.columns[row.clone()]);
        self.pairs.clear();
        self.pairs.extend_from_slice(&plain.pairs[row]);
        self.rows.clear();
        self.rows.extend(self.members.iter().map(|&m| plain.row_start[m as usize]));
        let n = self.members.len();
        let relative = |all: &[Vector], to: &mut Vec<Vector>| {
            to.clear();
            let from = all[point];
            to.extend(self.members.iter().map(|&m| difference(&all[m as usize], &from)));
        };
        relative(&plain.at_rest, &mut self.at_rest);
        relative(&plain.now, &mut self.now);
        self.gradient.clear();
        self.gradient.resize(n, [0.0; 3]);
        for blocks in [&mut self.diagonal, &mut self.column] {
            blocks.clear();
            blocks.resize(n, [0.0; 9]);
        }
    }

    #[inline(always)]
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
                    self.blocks[pair][entry] += batch.out.pairs[number][entry][lane];
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
