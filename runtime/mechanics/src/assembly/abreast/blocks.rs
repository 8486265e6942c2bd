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
    Abreast, AbreastRoom, Beside, CornerShares, Eight, Group, NONE, Register, UPPER, Walk, growth,
    weighed,
};
use crate::element::WIDEST;
use crate::geometry::lanes::Lanes;
use crate::geometry::{cross, dot, each};
use crate::interaction::Bits;
use crate::interaction::runs::Runs;
use crate::neighborhood::{Neighborhood, PlaceOfStep};

/// What tangents need of the tetrahedra of a lattice body.
pub(super) struct Edges {
    edges: Vec<Edge>,
    thirds: Vec<Third>,
}

/// Two bonds of an owner whose other ends are neighbours: an edge of its tetrahedra.
pub(super) struct Edge {
    /// Their numbers, the higher first.
    pub(super) vectors: [u32; 2],
    /// The cross product at rest, in m^2.
    pub(super) normal: [f64; 3],
    /// Where the third bonds stand in a table.
    pub(super) thirds: Range<usize>,
}

/// A bond whose other end is a neighbour of those of two others.
#[derive(Clone, Copy)]
pub(super) struct Third {
    pub(super) vector: u32,
    /// The number of the law, by the volume with the sign of the three bonds in their order; that of the other
    /// sign differs in the last bit.
    pub(super) law: u32,
}

impl Edges {
    /// From triples of vectors, the second of lower number than the first and the third than the second, with
    /// their laws.
    pub(super) fn new(runs: &Runs, tetrahedra: impl Iterator<Item = ([u32; 3], u32)>) -> Edges {
        let mut of_pairs: BTreeMap<[u32; 2], Vec<Third>> = BTreeMap::new();
        for ([a, b, c], law) in tetrahedra {
            // The volume changes its sign when two of the three change places.
            for (pair, vector, law) in [([a, b], c, law), ([b, c], a, law), ([a, c], b, law ^ 1)] {
                of_pairs.entry(pair).or_default().push(Third { vector, law });
            }
        }
        let (mut edges, mut all) = (Vec::new(), Vec::new());
        for (vectors, thirds) in of_pairs {
            let [a, b] = vectors.map(|vector| runs.vectors::<3>()[vector as usize]);
            let (first, normal) = (all.len(), cross(&a, &b));
            all.extend(thirds);
            edges.push(Edge { vectors, normal, thirds: first..all.len() });
        }
        Edges { edges, thirds: all }
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
    pub(super) neighborhood: &'a Neighborhood,
    pub(super) owners: (Range<usize>, Option<&'a Bits>),
    pub(super) axes: &'a Axes,
    pub(super) room: &'a mut AbreastRoom<3>,
    pub(super) rows: &'a mut Rows<'r>,
}

impl WithSimd for BlockSweep<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let BlockSweep { of, edges, laws, neighborhood, owners, axes, room, rows } = self;
        let AbreastRoom { groups, bonds, first: first_of, members, .. } = room;
        let mut walk = Walk::new(of, axes.slab, owners, groups);
        while let Some((group, is_whole)) = walk.next::<S, 3, false>(simd, axes, bonds, first_of) {
            members.clear();
            let nothing = Member { own: [[0.0; WIDEST]; 6], column: [[0.0; WIDEST]; 9] };
            members.resize(bonds.len(), nothing);
            let group = &group;
            let on_edges = OnEdges { simd, group, edges, laws, neighborhood, bonds, first_of };
            if is_whole {
                on_edges.add::<false>(members, rows);
            } else {
                on_edges.add::<true>(members, rows);
            }
            on_edges.write(members, rows);
        }
    }
}

/// The edges of a group of owners.
struct OnEdges<'a, S: Simd> {
    simd: S,
    group: &'a Group<'a>,
    edges: &'a Edges,
    laws: &'a [Quadratic],
    neighborhood: &'a Neighborhood,
    bonds: &'a [Beside<3>],
    first_of: &'a [u32],
}

type Matrix<S> = [[Lanes<S>; 3]; 3];

impl<S: Simd> OnEdges<'_, S> {
    #[inline(always)]
    fn add<const MASKED: bool>(&self, members: &mut [Member], rows: &mut Rows<'_>) {
        for edge in &self.edges.edges {
            let mut a = self.first_of[edge.vectors[0] as usize];
            while a != NONE {
                let mut b = self.first_of[edge.vectors[1] as usize];
                while b != NONE {
                    self.add_edge::<MASKED>(edge, [a, b], members, rows);
                    b = self.bonds[b as usize].next;
                }
                a = self.bonds[a as usize].next;
            }
        }
    }

    /// Adds the edge between the ends of two bonds, for all owners that have both.
    #[inline(always)]
    fn add_edge<const MASKED: bool>(
        &self,
        edge: &Edge,
        [a, b]: [u32; 2],
        members: &mut [Member],
        rows: &mut Rows<'_>,
    ) {
        let [bond_a, bond_b] = [a, b].map(|bond| &self.bonds[bond as usize]);
        let owners = bond_a.owners & bond_b.owners;
        if MASKED && owners == 0 {
            return;
        }
        let mut block = [[0.0; WIDEST]; 9];
        for number in 0..WIDEST / Lanes::<S>::WIDTH {
            let at = Register { simd: self.simd, group: self.group, number };
            if !MASKED || owners & at.owners() != 0 {
                let moments = self.moments::<MASKED>(at, edge, bond_a, bond_b);
                let ends = [(a, &bond_a.now), (b, &bond_b.now)];
                add_blocks(at, moments, ends, members, &mut block);
            }
        }
        if rows.has_couplings() {
            self.write_block([bond_a.other, bond_b.other], owners, &block, rows);
        }
    }

    /// The moments of an edge: the sums over its third bonds of the first derivatives of energies times the
    /// bond, and of the second ones times its dyad with itself.
    #[inline(always)]
    fn moments<const MASKED: bool>(
        &self,
        at: Register<'_, S>,
        edge: &Edge,
        bond_a: &Beside<3>,
        bond_b: &Beside<3>,
    ) -> ([Lanes<S>; 3], Matrix<S>) {
        let (zero, owners) = (at.splat(0.0), bond_a.owners & bond_b.owners & at.owners());
        let vectors = at.group.of.runs.vectors::<3>();
        let rest: [Lanes<S>; 3] = each(|axis| at.splat(vectors[edge.vectors[0] as usize][axis]));
        let (eta, eta_there) = (at.load_all(&bond_a.eta), at.load_all(&bond_b.eta));
        let grown = growth(&rest, &eta, (&eta_there, &at.load_all(&bond_b.now)));
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
                let change = dot(&grown, &now) + dot(&normal, &at.load_all(&bond.eta));
                let changed = law.changed::<SIGNED, true>(zero, change);
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

    /// Adds the blocks of an edge to the rows of the first of its points, which is the same end for all owners.
    #[inline(always)]
    fn write_block(&self, [a, b]: [isize; 2], owners: u8, block: &[Eight; 9], rows: &mut Rows<'_>) {
        let (low, high, order) = match a < b {
            true => (a, b, [0, 1, 2, 3, 4, 5, 6, 7, 8]),
            false => (b, a, [0, 3, 6, 1, 4, 7, 2, 5, 8]),
        };
        let mut step = PlaceOfStep::default();
        for lane in (0..WIDEST).filter(|lane| owners >> lane & 1 == 1) {
            let [low, high] = [low, high].map(|point| (point + lane as isize) as usize);
            let place = step.before(self.neighborhood.upper(low), high as u32);
            let to = rows.blocks::<3>(low, 1 + place, 1);
            for (to, part) in to.iter_mut().zip(order) {
                *to += block[part][lane];
            }
        }
    }

    /// Adds what the members and owners of the group have: their own blocks, and those of owners with members,
    /// for rows of a tangent sum to nothing.
    fn write(&self, members: &[Member], rows: &mut Rows<'_>) {
        for lane in (0..WIDEST).filter(|lane| self.group.here >> lane & 1 == 1) {
            let (owner, mut total) = (self.group.first + lane, [[0.0; 3]; 3]);
            for (bond, member) in self.bonds.iter().zip(members) {
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
                let point = (bond.other + lane as isize) as usize;
                rows.add_block(point, 0, &own);
                if rows.has_couplings() {
                    let place = self.neighborhood.upper(owner).before(point as u32);
                    rows.add_block(owner, 1 + place, &coupling);
                }
            }
            rows.add_block(owner, 0, &symmetrised(&total));
        }
    }
}

/// The block of an edge, which is also added to what its ends have.
#[inline(always)]
fn add_blocks<S: Simd>(
    at: Register<'_, S>,
    (p, m): ([Lanes<S>; 3], Matrix<S>),
    [(a, now_a), (b, now_b)]: [(u32, &[Eight; 3]); 2],
    members: &mut [Member],
    block: &mut [Eight; 9],
) {
    let (xa, xb) = (at.load_all(now_a), at.load_all(now_b));
    let (from_a, from_b) = (rows_crossed(&xa, &m), rows_crossed(&xb, &m));
    let mixed = crossed(&xb, &from_a);
    let zero = at.splat(0.0);
    let twist = [[zero, p[2], -p[1]], [-p[2], zero, p[0]], [p[1], -p[0], zero]];
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
}

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

fn symmetric(upper: &[Eight; 6], lane: usize) -> [[f64; 3]; 3] {
    let [xx, xy, xz, yy, yz, zz] = upper.map(|part| part[lane]);
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
}
