//! Triangles and tetrahedra of affine laws on a lattice, eight owners abreast.
//!
//! Consecutive owners have the same bonds but for those that end at the surface. What their bonds have
//! become is worked out first, each bond of all owners in one register; then every pair of bonds whose
//! ends are neighbours is a triangle of each owner that has both, and three of them a tetrahedron. What
//! these are at rest stands in tables ([`triangles`], [`tetrahedra`]); forces of a bond's other end are
//! summed where the bond is, and go to their points with the group.

mod blocks;
mod fans;
pub(super) mod tetrahedra;
pub(super) mod triangles;

use std::ops::Range;
use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};

use blocks::Member;
use fans::FanRoom;

use super::axes::{Axes, Wanted};
use super::kind::Kind;
use super::quadratic::Shares;
use super::sum::Sum;
use crate::element::WIDEST;
use crate::geometry::lanes::Lanes;
use crate::geometry::{Scalar, dot, each};
use crate::interaction::Bits;
use crate::interaction::runs::{Bundle, GroupRoom, Groups, Runs};

/// One number of eight owners.
type Eight = [f64; WIDEST];

/// What a body has for interactions of one kind.
struct Abreast {
    runs: Arc<Runs>,
    /// What is left of weights where they are not the same for all.
    shares: Option<Shares>,
    /// Equal parts of the values of the field that the law is a multiple of, point by point: those of the
    /// corners make the mean.
    parts: Option<Shares>,
    /// How far measures may be from those at rest: shares of these, in space of their squares for areas. All may go
    /// anywhere where nobody watches: to ask for each whether somebody does took twice as long for tetrahedra.
    limits: [f64; 2],
    arch: Arch,
}

impl Abreast {
    /// For interactions of so many corners; and what all weights have in common.
    fn new(runs: &Arc<Runs>, kind: &Kind, corners: usize) -> (Abreast, f64) {
        let (common, shares) = Shares::of(&kind.weights, corners);
        let (runs, parts) = (Arc::clone(runs), kind.parts_of_field(corners));
        (Abreast { runs, shares, parts, limits: ANYWHERE, arch: Arch::new() }, common)
    }

    /// Watches interactions, of which these are at rest, from how far each may go as a share: all may go as far as the
    /// one that may least. Whether that is known.
    fn watch(
        &mut self,
        mut at_rest: impl Iterator<Item = f64>,
        shares: impl Fn(f64) -> Option<[f64; 2]>,
    ) -> bool {
        let least = |[low, high]: [f64; 2], size: f64| {
            let [own_low, own_high] = shares(size)?;
            Some([low.max(own_low), high.min(own_high)])
        };
        let found = at_rest.try_fold(ANYWHERE, least);
        self.limits = found.unwrap_or(ANYWHERE);
        found.is_some()
    }

    /// Works out what is wanted of the interactions of a slab's owners, but for some, and adds forces to
    /// `axes`; the energy, or nothing where something is not finite, or thin.
    fn sweep<C: Cliques<D>, const D: usize>(
        &self,
        cliques: C,
        (owners, wanted): ((Range<usize>, Option<&Bits>), Wanted),
        axes: &mut Axes,
        room: &mut AbreastRoom<D>,
    ) -> Option<Sum> {
        let mut sum = Sum::default();
        let sweep = Sweep { of: self, cliques, owners, wanted, axes, room, sum: &mut sum };
        let is_well = match wanted {
            Wanted::Product => self.arch.dispatch(Multiplied(sweep)),
            Wanted::Order(_) => self.arch.dispatch(sweep),
        };
        is_well.then_some(sum)
    }
}

/// A bond of eight owners.
#[derive(Clone)]
struct Beside<const D: usize> {
    vector: u32,
    other: isize,
    /// How far the other end has moved from the owner, where it is, and the square of that.
    eta: [Eight; D],
    now: [Eight; D],
    square: Eight,
    /// How far a direction moves the other end from the owner; only of products.
    way: [Eight; D],
    /// The sum of the forces on the other end, or of what the direction changes them by.
    force: [Eight; D],
    /// A bit for each owner that has the bond; and 1 for these, 0 for all others.
    owners: u8,
    inside: Eight,
    /// Of the other end in the weights.
    share: Eight,
    /// Of the other end in the mean of the field.
    part: Eight,
    /// The next bond of the same vector, of other owners; [`NONE`] of the last.
    next: u32,
}

/// No limits.
const ANYWHERE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// The upper triangle of a block in space, row by row.
const UPPER: [[usize; 2]; 6] = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]];

/// No bond.
const NONE: u32 = u32::MAX;

/// Work arrays of a thread for owners abreast.
pub(super) struct AbreastRoom<const D: usize> {
    groups: GroupRoom,
    bonds: Vec<Beside<D>>,
    /// The first bond of each vector.
    first: Vec<u32>,
    /// What tangents add to the ends of bonds.
    members: Vec<Member>,
    /// The triangles on a bond.
    fans: FanRoom,
}

impl<const D: usize> AbreastRoom<D> {
    /// For bonds of so many vectors, and for tangents of tetrahedra.
    pub(super) fn new(n_vectors: usize, has_blocks: bool) -> AbreastRoom<D> {
        // Few groups have bonds of one vector with more than two places; tangents of triangles have them both ways.
        let bonds = Vec::with_capacity(6 * n_vectors);
        let members = Vec::with_capacity(if has_blocks { 3 * n_vectors } else { 0 });
        let first = vec![NONE; 2 * n_vectors];
        let fans = FanRoom::with_capacity(6 * n_vectors);
        AbreastRoom { groups: GroupRoom::new(n_vectors), bonds, first, members, fans }
    }
}

/// The interactions of one kind, from a table.
trait Cliques<const D: usize> {
    /// Those of one register of a group. `MASKED`: not every owner has every bond, or weights are not the
    /// same for all. `PRODUCT`: what a direction changes forces by in place of these.
    fn add<S: Simd, const MASKED: bool, const PRODUCT: bool>(
        &self,
        at: Register<'_, S>,
        bonds: &mut [Beside<D>],
        first_of: &[u32],
        out: &mut Added<'_, S>,
    );
}

/// The interactions of a slab on their way. Gives back whether all is finite and nothing is thin.
struct Sweep<'a, C, const D: usize> {
    of: &'a Abreast,
    cliques: C,
    owners: (Range<usize>, Option<&'a Bits>),
    wanted: Wanted,
    axes: &'a mut Axes,
    room: &'a mut AbreastRoom<D>,
    sum: &'a mut Sum,
}

impl<C: Cliques<D>, const D: usize> WithSimd for Sweep<'_, C, D> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        self.run::<S, false>(simd)
    }
}

/// The same for products.
struct Multiplied<'a, C, const D: usize>(Sweep<'a, C, D>);

impl<C: Cliques<D>, const D: usize> WithSimd for Multiplied<'_, C, D> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        self.0.run::<S, true>(simd)
    }
}

impl<C: Cliques<D>, const D: usize> Sweep<'_, C, D> {
    #[inline(always)]
    fn run<S: Simd, const PRODUCT: bool>(self, simd: S) -> bool {
        let Sweep { of, cliques, owners, wanted, axes, room, sum } = self;
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let sum = wanted.has_energy().then_some(sum);
        let limits = of.limits.map(|x| Lanes::splat(simd, x));
        let has_forces = wanted.has_forces();
        let mut out = Added { refused: zero, sum, has_forces, limits, beyond: zero };
        let AbreastRoom { groups, bonds, first: first_of, .. } = room;
        let mut walk = Walk::new(of, axes.slab, owners, groups);
        // Loops and no closures: these would be functions of their own, without the machine's registers.
        while let Some((group, is_whole)) = walk.next::<S, D, PRODUCT>(simd, axes, bonds, first_of)
        {
            for number in 0..WIDEST / Lanes::<S>::WIDTH {
                let at = Register { simd, group: &group, number };
                if is_whole {
                    cliques.add::<S, false, PRODUCT>(at, bonds, first_of, &mut out);
                } else {
                    cliques.add::<S, true, PRODUCT>(at, bonds, first_of, &mut out);
                }
            }
            if out.has_forces {
                group.scatter(simd, bonds, axes);
            }
        }
        axes.is_clique_beyond = out.beyond.largest() > 0.0;
        out.refused.where_equal(zero, zero, one).largest() == 0.0
    }
}

/// The owners of a slab, but for some, group by group.
struct Walk<'a> {
    of: &'a Abreast,
    groups: Groups<'a>,
    rest: Option<&'a Bits>,
}

impl<'a> Walk<'a> {
    fn new(
        of: &'a Abreast,
        slab: usize,
        (owners, rest): (Range<usize>, Option<&'a Bits>),
        room: &'a mut GroupRoom,
    ) -> Walk<'a> {
        Walk { of, groups: of.runs.groups(slab, owners, room), rest }
    }

    /// The next group, and whether each of it has all of its bonds, with weights that are the same for all;
    /// what these bonds have become, and the first of them of each vector.
    #[inline(always)]
    fn next<S: Simd, const D: usize, const PRODUCT: bool>(
        &mut self,
        simd: S,
        axes: &Axes,
        bonds: &mut Vec<Beside<D>>,
        first_of: &mut [u32],
    ) -> Option<(Group<'a>, bool)> {
        bonds.iter().for_each(|bond| first_of[bond.vector as usize] = NONE);
        bonds.clear();
        loop {
            let (owners, bundles) = self.groups.next()?;
            let here = owners_of(owners.clone(), self.rest);
            if here != 0 {
                let has_all = |bundle: &Bundle| bundle.owners == u8::MAX;
                let is_even = self.of.shares.is_none() && self.of.parts.is_none();
                let is_whole = is_even && here == u8::MAX && bundles.iter().all(has_all);
                let group = Group { of: self.of, first: owners.start, here };
                let bundles = (bundles, self.of.runs.vectors::<D>());
                group.gather::<S, D, PRODUCT>(simd, bundles, axes, bonds, first_of);
                return Some((group, is_whole));
            }
        }
    }
}

/// A bit for each of at most eight owners, but for the `rest`.
fn owners_of(owners: Range<usize>, rest: Option<&Bits>) -> u8 {
    let goes = |owner: &usize| rest.is_none_or(|rest| !rest.has(*owner));
    let first = owners.start;
    owners.filter(goes).fold(0, |all, owner| all | 1 << (owner - first))
}

/// What is added up over all interactions of a slab.
struct Added<'a, S: Simd> {
    /// 0 as long as all is well.
    refused: Lanes<S>,
    sum: Option<&'a mut Sum>,
    has_forces: bool,
    /// See [`Abreast::limits`].
    limits: [Lanes<S>; 2],
    /// Above 0 where something has gone beyond them.
    beyond: Lanes<S>,
}

impl<S: Simd> Added<'_, S> {
    /// Looks at interactions that have grown by so much, times what shares are of, which is the other number; those of
    /// owners that do not have them all are at rest.
    #[inline(always)]
    fn watch(&mut self, grown: Lanes<S>, whole: Lanes<S>, inside: Option<Lanes<S>>) {
        let [low, high] = self.limits;
        let grown = weighed(grown, inside);
        self.beyond = self.beyond.max(grown - high * whole).max(low * whole - grown);
    }
}

/// Eight consecutive owners.
struct Group<'a> {
    of: &'a Abreast,
    /// The first of them.
    first: usize,
    /// A bit for each that goes with the group.
    here: u8,
}

impl Group<'_> {
    /// What the bonds of the group have become, from their vectors at rest in m.
    #[inline(always)]
    fn gather<S: Simd, const D: usize, const PRODUCT: bool>(
        &self,
        simd: S,
        (bundles, vectors): (&[Bundle], &[[f64; D]]),
        axes: &Axes,
        bonds: &mut Vec<Beside<D>>,
        first_of: &mut [u32],
    ) {
        let place = |point: isize| (point + WIDEST as isize - axes.first as isize) as usize;
        let own = place(self.first as isize);
        for (number, &Bundle { vector, other, owners }) in bundles.iter().enumerate() {
            let (owners, other) = (owners & self.here, other as isize);
            let mut bond = Beside {
                vector,
                other,
                owners,
                eta: [[0.0; WIDEST]; D],
                now: [[0.0; WIDEST]; D],
                square: [0.0; WIDEST],
                way: [[0.0; WIDEST]; D],
                force: [[0.0; WIDEST]; D],
                inside: each(|lane| f64::from(owners >> lane & 1)),
                share: [0.0; WIDEST],
                part: [0.0; WIDEST],
                next: std::mem::replace(&mut first_of[vector as usize], number as u32),
            };
            let rest = &vectors[vector as usize];
            for register in 0..WIDEST / Lanes::<S>::WIDTH {
                let inside = Lanes::load(simd, &bond.inside, register);
                // Beyond the owners that have it there is the bond at rest, without weight.
                let mut now = [inside; D];
                for axis in 0..D {
                    let u = &axes.displacement[axis * axes.stride..][..axes.stride];
                    let at = |place: usize| Lanes::load(simd, &u[place..], register);
                    let eta = (at(place(other)) - at(own)) * inside;
                    eta.store(&mut bond.eta[axis], register);
                    now[axis] = Lanes::splat(simd, rest[axis]) + eta;
                    now[axis].store(&mut bond.now[axis], register);
                    if PRODUCT {
                        let p = &axes.direction[axis * axes.stride..][..axes.stride];
                        let at = |place: usize| Lanes::load(simd, &p[place..], register);
                        let way = (at(place(other)) - at(own)) * inside;
                        way.store(&mut bond.way[axis], register);
                    }
                }
                dot(&now, &now).store(&mut bond.square, register);
                if let Some(shares) = &self.of.shares {
                    let share = Lanes::load(simd, shares.from(other), register);
                    share.store(&mut bond.share, register);
                }
                if let Some(parts) = &self.of.parts {
                    let part = Lanes::load(simd, parts.from(other), register);
                    part.store(&mut bond.part, register);
                }
            }
            bonds.push(bond);
        }
    }

    /// Adds the forces to their points, bond by bond for all owners, whatever the width of registers.
    #[inline(always)]
    fn scatter<S: Simd, const D: usize>(&self, simd: S, bonds: &[Beside<D>], axes: &mut Axes) {
        let place = |point: isize| (point + WIDEST as isize - axes.first as isize) as usize;
        let own = place(self.first as isize);
        for axis in 0..D {
            let force = &mut axes.other[axis * axes.stride..][..axes.stride];
            let mut sum = [0.0; WIDEST];
            for bond in bonds {
                let to = &mut force[place(bond.other)..];
                for register in 0..WIDEST / Lanes::<S>::WIDTH {
                    let part = Lanes::load(simd, &bond.force[axis], register);
                    (Lanes::load(simd, &sum, register) + part).store(&mut sum, register);
                    (Lanes::load(simd, to, register) + part).store(to, register);
                }
            }
            let from = &mut force[own..];
            for register in 0..WIDEST / Lanes::<S>::WIDTH {
                let sum = Lanes::load(simd, &sum, register);
                (Lanes::load(simd, from, register) - sum).store(from, register);
            }
        }
    }
}

/// Those owners of a group that are in one register.
#[derive(Clone, Copy)]
struct Register<'a, S: Simd> {
    simd: S,
    group: &'a Group<'a>,
    number: usize,
}

impl<S: Simd> Register<'_, S> {
    #[inline(always)]
    fn load(self, channel: &Eight) -> Lanes<S> {
        Lanes::load(self.simd, channel, self.number)
    }

    #[inline(always)]
    fn load_all<const D: usize>(self, channels: &[Eight; D]) -> [Lanes<S>; D] {
        each(|axis| self.load(&channels[axis]))
    }

    /// The same number for all of them.
    #[inline(always)]
    fn splat(self, x: f64) -> Lanes<S> {
        Lanes::splat(self.simd, x)
    }

    /// A bit of the group for each of them.
    #[inline(always)]
    fn owners(self) -> u8 {
        let width = Lanes::<S>::WIDTH;
        (u8::MAX >> (WIDEST - width)) << (self.number * width)
    }

    /// What the owners have in weights; nothing where these are the same for all.
    #[inline(always)]
    fn own_share<const MASKED: bool>(self) -> CornerShares<S> {
        if !MASKED {
            return CornerShares { inside: None, share: None, part: None };
        }
        let Group { of, first, .. } = *self.group;
        let of_owners =
            |shares: &Shares| Lanes::load(self.simd, shares.from(first as isize), self.number);
        CornerShares {
            inside: None,
            share: of.shares.as_ref().map(of_owners),
            part: of.parts.as_ref().map(of_owners),
        }
    }
}

/// How much the cross product of two bonds has grown, from the first at rest and from how far the ends of both
/// have moved; in the plane a number and zeros.
#[inline(always)]
fn growth<S: Simd, const D: usize>(
    rest: &[Lanes<S>; D],
    eta: &[Lanes<S>; D],
    (eta_there, now_there): (&[Lanes<S>; D], &[Lanes<S>; D]),
) -> [Lanes<S>; 3] {
    let (p, q) = (cross(rest, eta_there), cross(eta, now_there));
    each(|axis| p[axis] + q[axis])
}

/// The cross product; in the plane a number and zeros.
#[inline(always)]
fn cross<T: Scalar, const D: usize>(p: &[T; D], q: &[T; D]) -> [T; 3] {
    let at = |r: usize, s: usize| p[r] * q[s] - p[s] * q[r];
    if D == 2 {
        let zero = p[0].alike(0.0);
        return [at(0, 1), zero, zero];
    }
    [at(1, 2 % D), at(2 % D, 0), at(0, 1)]
}

/// What corners have in the weight of an interaction, from the owner on.
#[derive(Clone, Copy)]
struct CornerShares<S: Simd> {
    /// 1 for owners that have the bonds with all others, else 0.
    inside: Option<Lanes<S>>,
    share: Option<Lanes<S>>,
    /// The same in the mean of the field.
    part: Option<Lanes<S>>,
}

impl<S: Simd> CornerShares<S> {
    /// With the other end of a bond.
    #[inline(always)]
    fn with<const MASKED: bool, const D: usize>(
        mut self,
        at: Register<'_, S>,
        bond: &Beside<D>,
    ) -> CornerShares<S> {
        if !MASKED {
            return self;
        }
        let inside = at.load(&bond.inside);
        self.inside = Some(match self.inside {
            Some(all) => all * inside,
            None => inside,
        });
        if let (Some(all), Some(shares)) = (self.share, &at.group.of.shares) {
            let share = at.load(&bond.share);
            self.share = Some(if shares.are_added { all + share } else { all * share });
        }
        if let Some(all) = self.part {
            self.part = Some(all + at.load(&bond.part));
        }
        self
    }

    /// The weight of the interactions; nothing where it is 1. Iterators over these three would stay loops,
    /// which write them to memory.
    #[inline(always)]
    fn weight(self) -> Option<Lanes<S>> {
        let times = |p: Option<Lanes<S>>, q: Option<Lanes<S>>| match (p, q) {
            (Some(p), Some(q)) => Some(p * q),
            (p, None) => p,
            (None, q) => q,
        };
        times(times(self.share, self.inside), self.part)
    }
}

/// A number times a weight.
#[inline(always)]
fn weighed<S: Simd>(number: Lanes<S>, weight: Option<Lanes<S>>) -> Lanes<S> {
    match weight {
        Some(weight) => number * weight,
        None => number,
    }
}
