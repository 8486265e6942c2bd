//! Tangents of triangles of points abreast: a table of the triangles on each bond, its fan.
//!
//! All triangles on a bond, wherever their third corners are, have in common the block of the tangent that
//! couples its ends. With vectors `q` and `r` from a point to the other end and to a third corner, `n = q x r`,
//! and derivatives `f` and `g` of the energy by `s` ([`super::super::quadratic`]), a triangle adds to it
//!
//! ```text
//! f (r r' - 2 r q' + q r' - (r - q).r 1) - g ((r - q) x n) (r x n)'
//! ```
//!
//! and in the plane, where `n` is a number, `f e - g ((r - q) x 1) (r x 1)'` with `e = [0, 1; -1, 0]`. In space
//! `r = rho q + h`, where `h = n x q/q^2` is the height of the triangle on the bond, and the sum over triangles is
//!
//! ```text
//! A h h' + B h q' + C q h' + D q q' - E 1
//! A = f - g q^4 rho (rho - 1),  B = f (rho - 2) + g q^2 h^2 (rho - 1),  C = f (rho + 1) + g q^2 h^2 rho
//! D = f rho (rho - 1) - g h^4,  E = f (q^2 rho (rho - 1) + h^2)
//! ```
//!
//! Sums stay in registers while third corners go by, and each block is written once. Rows of a tangent sum to
//! nothing: the own blocks of both ends lose what couples them.

use pulp::{Simd, WithSimd};

use super::super::axes::Axes;
use super::super::quadratic::{Quadratics, SIGNED};
use super::super::rows::Rows;
use super::triangles::{Pair, Table, turned};
use super::{Abreast, AbreastRoom, Beside, Eight, Group, NONE, Register, UPPER, growth, weighed};
use crate::element::WIDEST;
use crate::geometry::lanes::Lanes;
use crate::geometry::{Scalar, cross, dot, each};
use crate::interaction::Slabs;
use crate::interaction::runs::Directed;
use crate::neighborhood::{Neighborhood, PlaceOfStep};

/// Most triangles on all bonds of a point, 64 MiB of them: a horizon of six spacings has 0.2 million, one of
/// seven 0.5.
const MOST: usize = 1 << 20;

/// What tangents need of the triangles of a lattice body.
pub(super) struct Fans {
    /// The bonds of groups of points, slab by slab, and where the groups of each slab start.
    directed: Directed,
    groups: Vec<usize>,
    /// At rest in m, those of runs and then each of them turned around; `D` numbers each.
    vectors: Vec<f64>,
    /// The triangles on bonds to later points, by their vectors: the third corner is at the other bond, and the
    /// normal is `q x r` at rest.
    thirds: Vec<Pair>,
    /// Where those of each vector start.
    start: Vec<usize>,
}

impl Fans {
    /// Nothing where there are too many triangles, or a law is not finite.
    pub(super) fn new<const D: usize>(table: &Table<'_>, slabs: &Slabs) -> Option<Fans> {
        let n = table.runs.n_vectors::<D>();
        let later = table.runs.vectors::<D>();
        let vectors: Vec<[f64; D]> =
            later.iter().copied().chain(later.iter().map(|x| x.map(|x| 0.0 - x))).collect();
        let materials = |number: usize| {
            let [own, other] = table.runs.materials(number % n);
            if number < n { [own, other] } else { [other, own] }
        };
        let (mut thirds, mut start) = (Vec::new(), vec![0]);
        for q in 0..n {
            for r in (0..2 * n).filter(|r| materials(*r)[0] == materials(q)[0]) {
                let ends = [q, r].map(|number| (&vectors[number], materials(number)[1]));
                if let Some(corner) = table.triangle(materials(q)[0], ends) {
                    let law = table.law(&corner)?;
                    thirds.push(Pair { vector: r as u32, normal: corner.normal, law });
                }
            }
            start.push(thirds.len());
            if thirds.len() > MOST {
                return None;
            }
        }
        let ranges = || (0..slabs.len()).map(|slab| slabs.owners(slab));
        let mut groups = vec![0];
        groups.extend(ranges().scan(0, |end, points| {
            *end += points.len().div_ceil(WIDEST);
            Some(*end)
        }));
        let directed = table.runs.directed::<D>(ranges());
        let vectors = vectors.into_iter().flatten().collect();
        Some(Fans { directed, groups, vectors, thirds, start })
    }
}

/// The blocks of a slab on their way, at displacements that reach from the slab before to the slab behind.
pub(super) struct FanSweep<'a, 'r, const D: usize> {
    pub(super) of: &'a Abreast,
    pub(super) fans: &'a Fans,
    pub(super) neighborhood: &'a Neighborhood,
    pub(super) slabs: &'a Slabs,
    pub(super) axes: &'a Axes,
    pub(super) room: &'a mut AbreastRoom<D>,
    pub(super) rows: &'a mut Rows<'r>,
}

/// The same of laws by one way.
pub(super) struct FansByWay<'a, 'r, const D: usize, const WAY: u8>(pub(super) FanSweep<'a, 'r, D>);

impl<const D: usize, const WAY: u8> WithSimd for FansByWay<'_, '_, D, WAY> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let FanSweep { of, fans, neighborhood, slabs, axes, room, rows } = self.0;
        let AbreastRoom { bonds, first: first_of, fans: room, .. } = room;
        let (slab, vectors) = (axes.slab, fans.vectors.as_chunks::<D>().0);
        let points = slabs.owners(slab);
        for (number, group) in (fans.groups[slab]..fans.groups[slab + 1]).enumerate() {
            let first = points.start + number * WIDEST;
            let n = WIDEST.min(points.end - first);
            let group_of = Group { of, first, here: u8::MAX >> (WIDEST - n) };
            bonds.iter().for_each(|bond| first_of[bond.vector as usize] = NONE);
            bonds.clear();
            let bundles = fans.directed.of_group(group);
            group_of.gather::<S, D, false>(simd, (bundles, vectors), axes, bonds, first_of);
            room.provide(bonds.len());
            let is_even = of.shares.is_none() && of.parts.is_none();
            let is_whole = is_even && bundles.iter().all(|bundle| bundle.owners == u8::MAX);
            let group = &group_of;
            let points = OfPoints { simd, group, fans, vectors, neighborhood, bonds, first_of };
            if is_whole {
                points.add::<WAY, false>(room, rows);
            } else {
                points.add::<WAY, true>(room, rows);
            }
        }
    }
}

/// The triangles of a bond, in a register. Laws have roots and quotients, which take long: that many of these are
/// on their way at once, triangles are listed first, then derived, then summed.
pub(super) struct FanRoom {
    /// The numbers of each triangle in the table, and of the bond with its third corner.
    listed: Vec<[u32; 2]>,
    /// [`NUMBERS`] of each triangle, register by register.
    numbers: Vec<f64>,
}

/// In space the normal, its square, how much that has grown and a weight, which become the derivatives; in the plane
/// the derivatives are all.
const NUMBERS: usize = 6;

impl FanRoom {
    /// For so many bonds of a group.
    pub(super) fn with_capacity(bonds: usize) -> FanRoom {
        let numbers = Vec::with_capacity(bonds * NUMBERS * WIDEST);
        FanRoom { listed: Vec::with_capacity(bonds), numbers }
    }

    /// A group has each bond once.
    fn provide(&mut self, bonds: usize) {
        self.listed.resize(bonds, [0; 2]);
        self.numbers.resize(bonds * NUMBERS * WIDEST, 0.0);
    }
}

/// The fans of a group of points.
struct OfPoints<'a, S: Simd, const D: usize> {
    simd: S,
    group: &'a Group<'a>,
    fans: &'a Fans,
    vectors: &'a [[f64; D]],
    neighborhood: &'a Neighborhood,
    bonds: &'a [Beside<D>],
    first_of: &'a [u32],
}

impl<S: Simd, const D: usize> OfPoints<'_, S, D> {
    #[inline(always)]
    fn add<const WAY: u8, const MASKED: bool>(&self, room: &mut FanRoom, rows: &mut Rows<'_>) {
        let mut own = [[[0.0; WIDEST]; D]; D];
        for bond in self.bonds {
            // The others are those of the points before.
            let is_later = (bond.vector as usize) < self.fans.start.len() - 1;
            if !is_later || bond.owners == 0 {
                continue;
            }
            let mut block = [[[0.0; WIDEST]; D]; D];
            for number in 0..WIDEST / Lanes::<S>::WIDTH {
                let at = Register { simd: self.simd, group: self.group, number };
                if !MASKED || bond.owners & at.owners() != 0 {
                    let n = self.list::<WAY, MASKED>(at, bond, room);
                    if WAY != SIGNED {
                        self.derive::<WAY, MASKED>(at, n, room);
                    }
                    let found = self.block::<WAY>(at, bond, n, room);
                    for (i, j) in (0..D * D).map(|part| (part / D, part % D)) {
                        found[i][j].store(&mut block[i][j], at.number);
                        (at.load(&own[i][j]) + found[i][j]).store(&mut own[i][j], at.number);
                    }
                }
            }
            self.write(bond, &block, rows);
        }
        for lane in (0..WIDEST).filter(|lane| self.group.here >> lane & 1 == 1) {
            rows.add_block(self.group.first + lane, 0, &negative_symmetric(&own, lane));
        }
    }

    /// Lists the triangles on a bond; how many there are.
    #[inline(always)]
    fn list<const WAY: u8, const MASKED: bool>(
        &self,
        at: Register<'_, S>,
        bond: &Beside<D>,
        room: &mut FanRoom,
    ) -> usize {
        let (vector, fans) = (bond.vector as usize, self.fans);
        let rest: [Lanes<S>; D] = each(|axis| at.splat(self.vectors[vector][axis]));
        let eta = at.load_all(&bond.eta);
        let (shares, owners) = (at.own_share::<MASKED>(), bond.owners & at.owners());
        let shares = shares.with::<MASKED, D>(at, bond);
        let numbers = S::as_mut_simd_f64s(&mut room.numbers).0;
        let mut listed = room.listed.iter_mut().zip(numbers.chunks_exact_mut(NUMBERS));
        let mut n = 0;
        for place in fans.start[vector]..fans.start[vector + 1] {
            let third = &fans.thirds[place];
            let mut other = self.first_of[third.vector as usize];
            while other != NONE {
                let to = &self.bonds[other as usize];
                if !MASKED || to.owners & owners != 0 {
                    let Some((listed, numbers)) = listed.next() else { return n };
                    *listed = [place as u32, other];
                    let there = (&at.load_all(&to.eta), &at.load_all(&to.now));
                    let grown = growth(&rest, &eta, there);
                    let weight = shares.with::<MASKED, D>(at, to).weight();
                    if WAY == SIGNED {
                        in_plane(at, third, grown[0], weight, numbers);
                    } else {
                        in_space(at, third, grown, weight, numbers);
                    }
                    n += 1;
                }
                other = to.next;
            }
        }
        n
    }

    /// Works out the derivatives of the energies of listed triangles in space.
    #[inline(always)]
    fn derive<const WAY: u8, const MASKED: bool>(
        &self,
        at: Register<'_, S>,
        n: usize,
        room: &mut FanRoom,
    ) {
        let numbers = S::as_mut_simd_f64s(&mut room.numbers).0;
        for (listed, numbers) in room.listed[..n].iter().zip(numbers.chunks_exact_mut(NUMBERS)) {
            let lanes = |number: usize| Lanes::new(at.simd, numbers[number]);
            let law = Quadratics::new(at.simd, &self.fans.thirds[listed[0] as usize].law);
            let changed = law.changed::<WAY, true>(lanes(3), lanes(4));
            let weight = MASKED.then_some(lanes(5));
            numbers[4] = weighed(changed.first, weight).numbers();
            numbers[5] = weighed(changed.second, weight).numbers();
        }
    }

    /// The block of a bond, from the list of its triangles.
    #[inline(always)]
    fn block<const WAY: u8>(
        &self,
        at: Register<'_, S>,
        bond: &Beside<D>,
        n: usize,
        room: &FanRoom,
    ) -> [[Lanes<S>; D]; D] {
        let q = at.load_all(&bond.now);
        let numbers = S::as_simd_f64s(&room.numbers).0;
        let mut block = [[at.splat(0.0); D]; D];
        let mut sums = Heights::new(at, &q, at.load(&bond.square));
        for (listed, numbers) in room.listed[..n].iter().zip(numbers.chunks_exact(NUMBERS)) {
            let lanes = |number: usize| Lanes::new(at.simd, numbers[number]);
            let r = at.load_all(&self.bonds[listed[1] as usize].now);
            let derivatives = [lanes(4), lanes(5)];
            if WAY == SIGNED {
                add_in_plane(&mut block, &q, &r, derivatives);
            } else {
                sums.add(&r, ([lanes(0), lanes(1), lanes(2)], lanes(3)), derivatives);
            }
        }
        if WAY == SIGNED { block } else { sums.block() }
    }

    /// Adds the block of a bond, and takes it off the own blocks of its other ends.
    #[inline(always)]
    fn write(&self, bond: &Beside<D>, block: &[[Eight; D]; D], rows: &mut Rows<'_>) {
        let mut step = PlaceOfStep::default();
        for lane in (0..WIDEST).filter(|lane| bond.owners >> lane & 1 == 1) {
            let (point, other) = (self.group.first + lane, (bond.other + lane as isize) as usize);
            if rows.has_couplings() {
                let place = step.before(self.neighborhood.upper(point), other as u32);
                let coupling = each(|r| each(|c| block[r][c][lane]));
                rows.add_block::<D>(point, 1 + place, &coupling);
            }
            rows.add_block(other, 0, &negative_symmetric(block, lane));
        }
    }
}

/// Minus the symmetric part of a block.
#[inline(always)]
fn negative_symmetric<const D: usize>(block: &[[Eight; D]; D], lane: usize) -> [[f64; D]; D] {
    each(|r| each(|c| -0.5 * (block[r][c][lane] + block[c][r][lane])))
}

/// Writes the derivatives of the energy of a triangle in the plane, whose cross product has grown.
#[inline(always)]
fn in_plane<S: Simd>(
    at: Register<'_, S>,
    third: &Pair,
    grown: Lanes<S>,
    weight: Option<Lanes<S>>,
    numbers: &mut [S::f64s],
) {
    // Areas are positive: where the third corner lies to the right, the cross product is minus the area.
    let sign = at.splat(1.0_f64.copysign(third.normal[0]));
    let law = Quadratics::new(at.simd, &third.law);
    let changed = law.changed::<SIGNED, true>(sign, sign * grown);
    numbers[4] = weighed(sign * changed.first, weight).numbers();
    numbers[5] = weighed(changed.second, weight).numbers();
}

/// Adds a triangle in the plane to the block of a bond `q`, with its derivatives.
#[inline(always)]
fn add_in_plane<S: Simd, const D: usize>(
    block: &mut [[Lanes<S>; D]; D],
    q: &[Lanes<S>; D],
    r: &[Lanes<S>; D],
    [first, second]: [Lanes<S>; 2],
) {
    let one = first.alike(1.0);
    let across: [Lanes<S>; D] = each(|axis| r[axis] - q[axis]);
    let (p, m) = (turned(&across, &[one; 3]), turned(r, &[one; 3]));
    for i in 0..D {
        let scaled = second * p[i];
        for j in 0..D {
            block[i][j] = block[i][j] - scaled * m[j];
        }
    }
    block[0][1] = block[0][1] + first;
    block[1][0] = block[1][0] - first;
}

/// Writes what derivatives in space follow from.
#[inline(always)]
fn in_space<S: Simd>(
    at: Register<'_, S>,
    third: &Pair,
    grown: [Lanes<S>; 3],
    weight: Option<Lanes<S>>,
    numbers: &mut [S::f64s],
) {
    let at_rest: [Lanes<S>; 3] = each(|axis| at.splat(third.normal[axis]));
    let normal: [Lanes<S>; 3] = each(|axis| at_rest[axis] + grown[axis]);
    for axis in 0..3 {
        numbers[axis] = normal[axis].numbers();
    }
    numbers[3] = dot(&normal, &normal).numbers();
    numbers[4] = dot(&grown, &each::<_, 3>(|axis| normal[axis] + at_rest[axis])).numbers();
    if let Some(weight) = weight {
        numbers[5] = weight.numbers();
    }
}

/// The sums over the triangles of a bond `q` in space.
struct Heights<S: Simd, const D: usize> {
    q: [Lanes<S>; D],
    square: Lanes<S>,
    /// One over the square.
    over: Lanes<S>,
    /// Of `A h h'`, the upper triangle row by row.
    dyad: [Lanes<S>; 6],
    /// Of `B h` and of `C h`.
    left: [Lanes<S>; 3],
    right: [Lanes<S>; 3],
    /// Of `D` and of `E`.
    along: Lanes<S>,
    alike: Lanes<S>,
}

impl<S: Simd, const D: usize> Heights<S, D> {
    #[inline(always)]
    fn new(at: Register<'_, S>, q: &[Lanes<S>; D], square: Lanes<S>) -> Heights<S, D> {
        let (zero, over) = (at.splat(0.0), at.splat(1.0) / square);
        let (q, dyad, [left, right]) = (*q, [zero; 6], [[zero; 3]; 2]);
        Heights { q, square, over, dyad, left, right, along: zero, alike: zero }
    }

    /// Adds a triangle with its normal, the square of that, and its derivatives.
    #[inline(always)]
    fn add(
        &mut self,
        r: &[Lanes<S>; D],
        (normal, square): ([Lanes<S>; 3], Lanes<S>),
        [f, g]: [Lanes<S>; 2],
    ) {
        let (one, q2) = (square.alike(1.0), self.square);
        let (rho, h2) = (dot(r, &self.q) * self.over, square * self.over);
        let less = rho - one;
        let both = rho * less;
        let bent = g * q2;
        let crossed = bent * h2;
        self.along = self.along + (f * both - g * h2 * h2);
        self.alike = self.alike + f * (q2 * both + h2);
        let h = cross(&normal, &[self.q[0], self.q[1], self.q[2 % D]]);
        let h: [Lanes<S>; 3] = each(|axis| h[axis] * self.over);
        let a = f - bent * q2 * both;
        let b = f * (less - one) + crossed * less;
        let c = f * (rho + one) + crossed * rho;
        let scaled: [Lanes<S>; 3] = each(|axis| a * h[axis]);
        for place in 0..6 {
            let [i, j] = UPPER[place];
            self.dyad[place] = self.dyad[place] + scaled[i] * h[j];
        }
        for axis in 0..3 {
            self.left[axis] = self.left[axis] + b * h[axis];
            self.right[axis] = self.right[axis] + c * h[axis];
        }
    }

    #[inline(always)]
    fn block(&self) -> [[Lanes<S>; D]; D] {
        let Heights { q, dyad, left, right, along, alike, .. } = self;
        let places = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
        let mut block = [[*alike; D]; D];
        for i in 0..D {
            for j in 0..D {
                let with_bond = left[i] * q[j] + q[i] * right[j] + *along * q[i] * q[j];
                block[i][j] = dyad[places[i][j]] + with_bond;
            }
            block[i][i] = block[i][i] - *alike;
        }
        block
    }
}
