//! Tangents of tetrahedra of owners abreast: a table of the edges of an owner's tetrahedra that do not
//! touch it, each with all bonds whose ends are neighbours of both its own.
//!
//! With the moments of an edge (see [`super::super::tetrahedra`]), which stay in registers while its third
//! corners go by, a tetrahedron is seen three times, once from each of its edges, and costs nine sums each
//! time; what is added to the tangent is one block an edge.

use std::collections::BTreeMap;
use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::super::accumulate::symmetrised;
use super::super::axes::Axes;
use super::super::quadratic::{Quadratic, Quadratics, SIGNED};
use super::super::rows::Rows;
use super::{
    Abreast, AbreastRoom, Beside, CornerShares, Eight, Group, NONE, Register, Walk, weighed,
};
use crate::element::WIDEST;
use crate::geometry::lanes::Lanes;
use crate::geometry::{cross, dot, each};
use crate::interaction::Bits;
use crate::interaction::runs::Runs;
use crate::neighborhood::Neighborhood;

/// What tangents need of the tetrahedra of a lattice body.
pub(super) struct Edges {
    edges: Vec<Edge>,
    thirds: Vec<Third>,
    places: Places,
}

/// Two bonds of an owner whose other ends are neighbours, the end of the first before that of the second.
struct Edge {
    vectors: [u32; 2],
    /// The bond between their ends.
    between: u32,
    /// The cross product at rest, in m^2.
    normal: [f64; 3],
    thirds: Range<usize>,
}

/// A bond whose other end is a neighbour of those of two others.
#[derive(Clone, Copy)]
pub(super) struct Third {
    pub(super) vector: u32,
    /// The number of the law, by the volume with the sign of the three bonds in their order; behind it comes
    /// that of the other sign, whose number differs in the last bit.
    pub(super) law: u32,
}

impl Edges {
    /// From triples of vectors with their laws; nothing where a point has too many neighbours.
    pub(super) fn new(
        runs: &Runs,
        neighborhood: &Neighborhood,
        tetrahedra: impl Iterator<Item = ([u32; 3], u32)>,
    ) -> Option<Edges> {
        let mut of_pairs: BTreeMap<[u32; 2], Vec<Third>> = BTreeMap::new();
        for ([a, b, c], law) in tetrahedra {
            // The volume is the same when the three go round, and changes its sign when two change places.
            let turned = law ^ 1;
            for (pair, vector) in [([a, b], c), ([b, c], a), ([c, a], b)] {
                of_pairs.entry(pair).or_default().push(Third { vector, law });
                let [first, second] = pair;
                of_pairs.entry([second, first]).or_default().push(Third { vector, law: turned });
            }
        }
        let (mut edges, mut all) = (Vec::new(), Vec::new());
        for (pair, thirds) in of_pairs {
            let [a, b] = pair.map(|vector| runs.vectors::<3>()[vector as usize]);
            let way: [f64; 3] = each(|axis| b[axis] - a[axis]);
            let of_ends = pair.map(|vector| runs.materials(vector as usize)[1]);
            // Of the two orders of a pair that of the points has a bond; both, where bonds go both ways.
            let Some(between) = runs.vector(&way, of_ends) else { continue };
            let (first, normal) = (all.len(), cross(&a, &b));
            all.extend(thirds);
            edges.push(Edge { vectors: pair, between, normal, thirds: first..all.len() });
        }
        let places = Places::new(runs, neighborhood)?;
        Some(Edges { edges, thirds: all, places })
    }
}

/// Which of a point's later neighbours is at the end of each vector.
struct Places {
    places: Vec<u16>,
    n_vectors: usize,
}

impl Places {
    fn new(runs: &Runs, neighborhood: &Neighborhood) -> Option<Places> {
        let n_vectors = runs.n_vectors::<3>();
        let mut places = vec![u16::MAX; n_vectors * neighborhood.n_points()];
        for ([owner, other], vector) in runs.bonds() {
            let place = neighborhood.upper(owner).before(other as u32);
            places[owner * n_vectors + vector] = u16::try_from(place).ok()?;
        }
        Some(Places { places, n_vectors })
    }

    #[inline(always)]
    fn of(&self, point: usize, vector: u32) -> usize {
        usize::from(self.places[point * self.n_vectors + vector as usize])
    }
}

/// Sums over the members at the ends of one bond of a group.
#[derive(Clone)]
pub(super) struct Member {
    /// The upper triangle of its own block.
    own: [Eight; 6],
    /// The sum over the other members of their blocks with it, row by row.
    column: [Eight; 9],
}

/// The blocks of a slab on their way.
pub(super) struct BlockSweep<'a, 'r> {
    pub(super) of: &'a Abreast,
    pub(super) edges: &'a Edges,
    pub(super) laws: &'a [Quadratic],
    pub(super) owners: (Range<usize>, Option<&'a Bits>),
    pub(super) axes: &'a Axes,
    pub(super) room: &'a mut AbreastRoom<3>,
    pub(super) rows: &'a mut Rows<'r>,
}

impl WithSimd for BlockSweep<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let BlockSweep { of, edges, laws, owners, axes, room, rows } = self;
        let AbreastRoom { groups, bonds, first: first_of, members } = room;
        let mut walk = Walk::new(of, axes.slab, owners, groups);
        while let Some((group, is_whole)) = walk.next(simd, axes, bonds, first_of) {
            members.clear();
            let nothing = Member { own: [[0.0; WIDEST]; 6], column: [[0.0; WIDEST]; 9] };
            members.resize(bonds.len(), nothing);
            for number in 0..WIDEST / Lanes::<S>::WIDTH {
                let at = Register { simd, group: &group, number };
                let on_edges = OnEdges { edges, laws, bonds, first_of, at };
                if is_whole {
                    on_edges.add::<false>(members, rows);
                } else {
                    on_edges.add::<true>(members, rows);
                }
            }
            write(&group, &edges.places, (bonds, members), rows);
        }
    }
}

/// The edges of the owners in one register.
struct OnEdges<'a, S: Simd> {
    edges: &'a Edges,
    laws: &'a [Quadratic],
    bonds: &'a [Beside<3>],
    first_of: &'a [u32],
    at: Register<'a, S>,
}

type Matrix<S> = [[Lanes<S>; 3]; 3];

impl<S: Simd> OnEdges<'_, S> {
    #[inline(always)]
    fn add<const MASKED: bool>(&self, members: &mut [Member], rows: &mut Rows<'_>) {
        let here = self.at.owners();
        for edge in &self.edges.edges {
            let mut a = self.first_of[edge.vectors[0] as usize];
            while a != NONE {
                let bond_a = &self.bonds[a as usize];
                let mut b = self.first_of[edge.vectors[1] as usize];
                while b != NONE {
                    let bond_b = &self.bonds[b as usize];
                    let owners = bond_a.owners & bond_b.owners & here;
                    // Where points do not follow each other as their vectors do, both orders are listed.
                    let is_in_order = bond_a.other < bond_b.other;
                    if is_in_order && (!MASKED || owners != 0) {
                        let ends = (&bond_a.now, &bond_b.now);
                        let (p, m) = self.moments::<MASKED>(edge, owners, bond_a, bond_b);
                        let block = self.blocks((p, m), ends, [a, b], members);
                        if rows.has_couplings() {
                            self.write_block(edge, bond_a, owners, &block, rows);
                        }
                    }
                    b = bond_b.next;
                }
                a = bond_a.next;
            }
        }
    }

    /// The moments of an edge: the sums over its third bonds of the first derivatives of energies times the
    /// bond, and of the second ones times its dyad with itself.
    #[inline(always)]
    fn moments<const MASKED: bool>(
        &self,
        edge: &Edge,
        owners: u8,
        bond_a: &Beside<3>,
        bond_b: &Beside<3>,
    ) -> ([Lanes<S>; 3], Matrix<S>) {
        let (at, zero) = (self.at, self.at.splat(0.0));
        let vectors = at.group.of.runs.vectors::<3>();
        let rest: [Lanes<S>; 3] = each(|axis| at.splat(vectors[edge.vectors[0] as usize][axis]));
        let p = cross(&rest, &at.load_all(&bond_b.eta));
        let q = cross(&at.load_all(&bond_a.eta), &at.load_all(&bond_b.now));
        let turned: [Lanes<S>; 3] = each(|axis| p[axis] + q[axis]);
        let normal: [Lanes<S>; 3] = each(|axis| at.splat(edge.normal[axis]));
        let shares: CornerShares<S> = at.own_share::<MASKED>();
        let shares = shares.with::<MASKED, 3>(at, bond_a).with::<MASKED, 3>(at, bond_b);
        let (mut p, mut m) = ([zero; 3], [zero; 6]);
        for third in &self.edges.thirds[edge.thirds.clone()] {
            let law = Quadratics::new(at.simd, &self.laws[third.law as usize]);
            let mut other = self.first_of[third.vector as usize];
            while other != NONE {
                let bond = &self.bonds[other as usize];
                other = bond.next;
                if MASKED && bond.owners & owners == 0 {
                    continue;
                }
                let now = at.load_all(&bond.now);
                let grown = dot(&turned, &now) + dot(&normal, &at.load_all(&bond.eta));
                let changed = law.changed::<SIGNED, true>(zero, grown);
                let shares = shares.with::<MASKED, 3>(at, bond);
                let weight = shares.weight();
                let first = weighed(changed.first, weight);
                let second = weighed(changed.second, weight);
                let [x, y, z] = now;
                p = [p[0] + first * x, p[1] + first * y, p[2] + first * z];
                let [sx, sy, sz] = [second * x, second * y, second * z];
                m = [
                    m[0] + sx * x,
                    m[1] + sx * y,
                    m[2] + sx * z,
                    m[3] + sy * y,
                    m[4] + sy * z,
                    m[5] + sz * z,
                ];
            }
        }
        let [xx, xy, xz, yy, yz, zz] = m;
        (p, [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    }

    /// The block of an edge, which is added to what its ends have.
    #[inline(always)]
    fn blocks(
        &self,
        (p, m): ([Lanes<S>; 3], Matrix<S>),
        (now_a, now_b): (&[Eight; 3], &[Eight; 3]),
        [a, b]: [u32; 2],
        members: &mut [Member],
    ) -> [Eight; 9] {
        let at = self.at;
        let (xa, xb) = (at.load_all(now_a), at.load_all(now_b));
        let (from_a, from_b) = (rows_crossed(&xa, &m), rows_crossed(&xb, &m));
        let mixed = crossed(&xb, &from_a);
        let zero = at.splat(0.0);
        let twist = [[zero, p[2], -p[1]], [-p[2], zero, p[0]], [p[1], -p[0], zero]];
        let mut block = [[0.0; WIDEST]; 9];
        for r in 0..3 {
            for c in 0..3 {
                let part = twist[r][c] - mixed[r][c];
                part.store(&mut block[3 * r + c], at.number);
                for (member, place) in [(b, 3 * r + c), (a, 3 * c + r)] {
                    let sum = &mut members[member as usize].column[place];
                    (at.load(sum) + part).store(sum, at.number);
                }
            }
        }
        for (member, full) in [(a, crossed(&xb, &from_b)), (b, crossed(&xa, &from_a))] {
            let own = &mut members[member as usize].own;
            for (place, [r, c]) in UPPER.into_iter().enumerate() {
                let part = at.splat(0.5) * full[r][c];
                (at.load(&own[place]) + part).store(&mut own[place], at.number);
            }
        }
        block
    }

    /// Adds the block of an edge to the rows of its first ends.
    #[inline(always)]
    fn write_block(
        &self,
        edge: &Edge,
        bond_a: &Beside<3>,
        owners: u8,
        block: &[Eight; 9],
        rows: &mut Rows<'_>,
    ) {
        let width = Lanes::<S>::WIDTH;
        for lane in self.at.number * width..(self.at.number + 1) * width {
            if owners >> lane & 1 == 1 {
                let point = (bond_a.other + lane as isize) as usize;
                let place = self.edges.places.of(point, edge.between);
                let to = rows.blocks::<3>(point, 1 + place, 1);
                for (to, part) in to.iter_mut().zip(block) {
                    *to += part[lane];
                }
            }
        }
    }
}

/// The upper triangle of a block, row by row.
const UPPER: [[usize; 2]; 6] = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]];

/// `x` cross each row.
#[inline(always)]
fn rows_crossed<S: Simd>(x: &[Lanes<S>; 3], rows: &Matrix<S>) -> Matrix<S> {
    [cross(x, &rows[0]), cross(x, &rows[1]), cross(x, &rows[2])]
}

/// `x` cross each column.
#[inline(always)]
fn crossed<S: Simd>(x: &[Lanes<S>; 3], rows: &Matrix<S>) -> Matrix<S> {
    let mut product = *rows;
    for column in 0..3 {
        let crossed = cross(x, &[rows[0][column], rows[1][column], rows[2][column]]);
        for row in 0..3 {
            product[row][column] = crossed[row];
        }
    }
    product
}

/// Adds what the members and owners of a group have: their own blocks, and those of owners with members,
/// for rows of a tangent sum to nothing.
fn write(
    group: &Group<'_>,
    places: &Places,
    (bonds, members): (&[Beside<3>], &[Member]),
    rows: &mut Rows<'_>,
) {
    for lane in (0..WIDEST).filter(|lane| group.here >> lane & 1 == 1) {
        let (owner, mut total) = (group.first + lane, [[0.0; 3]; 3]);
        for (bond, member) in bonds.iter().zip(members) {
            if bond.owners >> lane & 1 == 0 {
                continue;
            }
            let own = symmetric(&member.own, lane);
            let mut coupling = [[0.0; 3]; 3];
            for r in 0..3 {
                for c in 0..3 {
                    let sum = member.column[3 * r + c][lane] + own[r][c];
                    total[r][c] += sum;
                    coupling[r][c] = -sum;
                }
            }
            rows.add_block((bond.other + lane as isize) as usize, 0, &own);
            if rows.has_couplings() {
                rows.add_block(owner, 1 + places.of(owner, bond.vector), &coupling);
            }
        }
        rows.add_block(owner, 0, &symmetrised(&total));
    }
}

fn symmetric(upper: &[Eight; 6], lane: usize) -> [[f64; 3]; 3] {
    let [xx, xy, xz, yy, yz, zz] = upper.map(|part| part[lane]);
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
}
