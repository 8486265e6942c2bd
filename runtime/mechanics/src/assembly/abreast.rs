//! Triangles of affine laws on a lattice, eight owners abreast.
//!
//! Consecutive owners have the same bonds but for those that end at the surface. What their bonds have
//! become is worked out first, each bond of all owners in one register; then every pair of bonds whose
//! ends are neighbours is a triangle of each owner that has both. What triangles are at rest stands in a
//! table of pairs; forces of a bond's other end are summed where the bond is, and go to their points
//! with the group.

use std::ops::Range;
use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};

use super::axes::{Axes, Wanted};
use super::kind::{AffineLaws, Kind};
use super::quadratic::{Changed, Quadratic, Quadratics, ROOT, SIGNED, SQUARE, Shares};
use super::sum::Sum;
use crate::element::{THIN, WIDEST};
use crate::geometry::lanes::Lanes;
use crate::geometry::{Scalar, dot, each};
use crate::interaction::runs::{Bundle, GroupRoom, Runs};
use crate::interaction::{Bits, Degeneracy};
use crate::neighborhood::HORIZON_TOLERANCE;

/// One number of eight owners.
type Eight = [f64; WIDEST];

/// The triangles of a lattice body with an affine law.
pub(super) struct TriangleRuns {
    runs: Arc<Runs>,
    /// Pairs of bonds by the first of them.
    pairs: Vec<Pair>,
    /// Where those of each vector start.
    start: Vec<usize>,
    by_square: bool,
    /// What is left of weights where they are not the same for all.
    shares: Option<Shares>,
    /// Thirds of the values of the field that the law is a multiple of, point by point: those of the corners
    /// make the mean.
    thirds: Option<Shares>,
    arch: Arch,
}

/// Two bonds of an owner whose other ends are neighbours.
struct Pair {
    /// The number of the second vector.
    vector: u32,
    /// The cross product at rest, in m^2; in the plane a positive number and zeros.
    normal: [f64; 3],
    law: Quadratic,
}

impl TriangleRuns {
    /// Nothing of laws that are not affine, and where triangles are so thin at rest that they need twice
    /// the digits.
    pub(super) fn new(
        runs: &Arc<Runs>,
        kind: &Kind,
        (dimension, horizon): (usize, f64),
        degeneracy: Degeneracy,
    ) -> Option<TriangleRuns> {
        let laws = kind.affine_laws().filter(|_| !kind.forbids_inversion())?;
        let (common, shares) = Shares::of(&kind.weights, 3);
        let by_square = laws.by_square;
        let table = Table { laws, kind, runs, common, horizon, degeneracy };
        let (pairs, start) = match dimension {
            2 => table.pairs::<2>(runs.vectors())?,
            _ => table.pairs::<3>(runs.vectors())?,
        };
        let (runs, thirds) = (Arc::clone(runs), kind.parts_of_field(3));
        Some(TriangleRuns { runs, pairs, start, by_square, shares, thirds, arch: Arch::new() })
    }

    /// Works out the triangles of a slab's owners but for the `rest`; nothing where something is not finite,
    /// or thin.
    pub(super) fn add<const D: usize>(
        &self,
        (owners, rest): (Range<usize>, Option<&Bits>),
        of: Wanted,
        axes: &mut Axes,
        room: &mut AbreastRoom<D>,
    ) -> Option<Sum> {
        let mut sum = Sum::default();
        let pass = Pass { of: self, owners, rest, wanted: of, axes, room, sum: &mut sum };
        let is_fine = match (D, self.by_square) {
            (2, _) => self.arch.dispatch(Sweep::<D, SIGNED>(pass)),
            (_, false) => self.arch.dispatch(Sweep::<D, ROOT>(pass)),
            (_, true) => self.arch.dispatch(Sweep::<D, SQUARE>(pass)),
        };
        is_fine.then_some(sum)
    }
}

/// What the table of pairs follows from.
struct Table<'a> {
    laws: AffineLaws<'a>,
    kind: &'a Kind,
    runs: &'a Runs,
    common: f64,
    horizon: f64,
    degeneracy: Degeneracy,
}

impl Table<'_> {
    fn pairs<const D: usize>(&self, vectors: &[[f64; D]]) -> Option<(Vec<Pair>, Vec<usize>)> {
        let mut listed: Vec<Vec<Pair>> = vectors.iter().map(|_| Vec::new()).collect();
        let reach = self.horizon * (1.0 + HORIZON_TOLERANCE);
        for (a, xa) in vectors.iter().enumerate() {
            for (b, xb) in vectors.iter().enumerate().take(a) {
                let [[own, first], [of_second, second]] = [a, b].map(|v| self.runs.materials(v));
                if of_second != own {
                    continue;
                }
                let between: [f64; D] = each(|axis| xb[axis] - xa[axis]);
                let squares = [dot(xa, xa), dot(xb, xb), dot(&between, &between)];
                if squares[2] > reach * reach {
                    continue;
                }
                let normal = cross(xa, xb);
                let area_squared = dot(&normal, &normal);
                let longest = squares.iter().fold(0.0, |most: f64, x| most.max(*x));
                if self.degeneracy.is_collinear(area_squared, longest) {
                    continue;
                }
                if area_squared < THIN * THIN * squares[0] * squares[1] {
                    return None;
                }
                let parts = self.kind.parts(&[own, first, second]);
                let law = self.laws.at(parts, area_squared.sqrt(), &[], self.common)?;
                // In the plane the second bond lies to the left of the first.
                let turned = D == 2 && normal[0] < 0.0;
                let (first, second) = if turned { (b, a) } else { (a, b) };
                let normal = if turned { normal.map(|x| 0.0 - x) } else { normal };
                listed[first].push(Pair { vector: second as u32, normal, law });
            }
        }
        let mut start = vec![0];
        start.extend(listed.iter().scan(0, |end, pairs| {
            *end += pairs.len();
            Some(*end)
        }));
        Some((listed.into_iter().flatten().collect(), start))
    }
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

/// `x` cross a normal.
#[inline(always)]
fn turned<T: Scalar, const D: usize>(x: &[T; D], normal: &[T; 3]) -> [T; D] {
    if D == 2 {
        return each(|axis| if axis == 0 { x[1] * normal[0] } else { -(x[0] * normal[0]) });
    }
    let all = cross(&[x[0], x[1], x[2 % D]], normal);
    each(|axis| all[axis])
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
    /// The sum of the forces on the other end.
    force: [Eight; D],
    /// A bit for each owner that has the bond; and 1 for these, 0 for all others.
    owners: u8,
    inside: Eight,
    /// Of the other end in the weights.
    share: Eight,
    /// Of the other end in the mean of the field.
    third: Eight,
    /// The next bond of the same vector, of other owners; [`NONE`] of the last.
    next: u32,
}

/// No bond.
const NONE: u32 = u32::MAX;

/// Work arrays of a thread for owners abreast.
pub(super) struct AbreastRoom<const D: usize> {
    groups: GroupRoom,
    bonds: Vec<Beside<D>>,
    /// The first bond of each vector.
    first: Vec<u32>,
}

impl<const D: usize> AbreastRoom<D> {
    pub(super) fn new(of: Option<&TriangleRuns>) -> AbreastRoom<D> {
        let n = of.map_or(0, |of| of.runs.n_vectors::<D>());
        // Few groups have bonds of one vector with more than two places.
        let groups = GroupRoom::with_capacity(3 * n);
        AbreastRoom { groups, bonds: Vec::with_capacity(3 * n), first: vec![NONE; n] }
    }
}

/// The triangles of a slab on their way.
struct Pass<'a, const D: usize> {
    of: &'a TriangleRuns,
    owners: Range<usize>,
    rest: Option<&'a Bits>,
    wanted: Wanted,
    axes: &'a mut Axes,
    room: &'a mut AbreastRoom<D>,
    sum: &'a mut Sum,
}

/// The same for measures of one kind. Gives back whether all is finite and nothing is thin.
struct Sweep<'a, const D: usize, const WAY: u8>(Pass<'a, D>);

impl<const D: usize, const WAY: u8> WithSimd for Sweep<'_, D, WAY> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Pass { of, owners, rest, wanted, axes, room, sum } = self.0;
        let AbreastRoom { groups, bonds, first: first_of } = room;
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let sum = wanted.has_energy().then_some(sum);
        let mut out = Added { refused: zero, sum, has_forces: wanted.has_forces() };
        let mut groups = of.runs.groups(axes.slab, owners, groups);
        while let Some((owners, bundles)) = groups.next() {
            let here = owners_of(owners.clone(), rest);
            if here == 0 {
                continue;
            }
            let whole = here == u8::MAX && bundles.iter().all(|bundle| bundle.owners == u8::MAX);
            let group = Group { of, first: owners.start, here };
            group.gather(simd, bundles, axes, bonds, first_of);
            for register in 0..WIDEST / Lanes::<S>::WIDTH {
                if whole {
                    group.triangles::<S, D, WAY, false>(simd, register, bonds, first_of, &mut out);
                } else {
                    group.triangles::<S, D, WAY, true>(simd, register, bonds, first_of, &mut out);
                }
            }
            if out.has_forces {
                group.scatter(simd, bonds, axes);
            }
            bonds.iter().for_each(|bond| first_of[bond.vector as usize] = NONE);
        }
        out.refused.where_equal(zero, zero, one).largest() == 0.0
    }
}

/// A bit for each of at most eight owners, but for the `rest`.
fn owners_of(owners: Range<usize>, rest: Option<&Bits>) -> u8 {
    let goes = |owner: &usize| rest.is_none_or(|rest| !rest.has(*owner));
    let first = owners.start;
    owners.filter(goes).fold(0, |all, owner| all | 1 << (owner - first))
}

/// What is added up over all triangles of a slab.
struct Added<'a, S: Simd> {
    /// 0 as long as all is well.
    refused: Lanes<S>,
    sum: Option<&'a mut Sum>,
    has_forces: bool,
}

/// Eight consecutive owners.
struct Group<'a> {
    of: &'a TriangleRuns,
    /// The first of them.
    first: usize,
    /// A bit for each that goes with the group.
    here: u8,
}

impl Group<'_> {
    /// What the bonds of the group have become.
    #[inline(always)]
    fn gather<S: Simd, const D: usize>(
        &self,
        simd: S,
        bundles: &[Bundle],
        axes: &Axes,
        bonds: &mut Vec<Beside<D>>,
        first_of: &mut [u32],
    ) {
        let vectors = self.of.runs.vectors::<D>();
        let place = |point: isize| (point + WIDEST as isize - axes.first as isize) as usize;
        let own = place(self.first as isize);
        bonds.clear();
        for (number, &Bundle { vector, other, owners }) in bundles.iter().enumerate() {
            let owners = owners & self.here;
            let mut bond = Beside {
                vector,
                other,
                owners,
                eta: [[0.0; WIDEST]; D],
                now: [[0.0; WIDEST]; D],
                square: [0.0; WIDEST],
                force: [[0.0; WIDEST]; D],
                inside: each(|lane| f64::from(owners >> lane & 1)),
                share: [0.0; WIDEST],
                third: [0.0; WIDEST],
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
                }
                dot(&now, &now).store(&mut bond.square, register);
                if let Some(shares) = &self.of.shares {
                    let share = Lanes::load(simd, shares.from(other), register);
                    share.store(&mut bond.share, register);
                }
                if let Some(thirds) = &self.of.thirds {
                    let third = Lanes::load(simd, thirds.from(other), register);
                    third.store(&mut bond.third, register);
                }
            }
            bonds.push(bond);
        }
    }

    /// One register of all triangles of the group. `MASKED`: not every owner has every bond.
    #[inline(always)]
    fn triangles<S: Simd, const D: usize, const WAY: u8, const MASKED: bool>(
        &self,
        simd: S,
        register: usize,
        bonds: &mut [Beside<D>],
        first_of: &[u32],
        out: &mut Added<'_, S>,
    ) {
        let of = self.of;
        let vectors = of.runs.vectors::<D>();
        let load = |channel: &Eight| Lanes::load(simd, channel, register);
        // The owners of this register.
        let width = Lanes::<S>::WIDTH;
        let here = (u8::MAX >> (WIDEST - width)) << (register * width);
        for number in 0..bonds.len() {
            let bond = &bonds[number];
            let (vector, own_bits) = (bond.vector as usize, bond.owners);
            if MASKED && own_bits & here == 0 {
                continue;
            }
            let mut own = None;
            if let Some(shares) = &of.shares {
                let all = Lanes::load(simd, shares.from(self.first as isize), register);
                let share = load(&bond.share);
                own = Some(if shares.are_added { all + share } else { all * share });
            }
            let mut first = First {
                rest: each(|axis| Lanes::splat(simd, vectors[vector][axis])),
                eta: each(|axis| load(&bond.eta[axis])),
                now: each(|axis| load(&bond.now[axis])),
                square: load(&bond.square),
                force: each(|axis| load(&bond.force[axis])),
                inside: load(&bond.inside),
                own,
                thirds: of.thirds.as_ref().map(|thirds| {
                    Lanes::load(simd, thirds.from(self.first as isize), register)
                        + load(&bond.third)
                }),
            };
            for pair in &of.pairs[of.start[vector]..of.start[vector + 1]] {
                let mut other = first_of[pair.vector as usize];
                while other != NONE {
                    let second = &mut bonds[other as usize];
                    if !MASKED || second.owners & own_bits & here != 0 {
                        first.with::<WAY, MASKED>(simd, register, second, pair, &of.shares, out);
                    }
                    other = second.next;
                }
            }
            for axis in 0..D {
                first.force[axis].store(&mut bonds[number].force[axis], register);
            }
        }
    }

    /// Adds the forces to their points.
    #[inline(always)]
    fn scatter<S: Simd, const D: usize>(&self, simd: S, bonds: &[Beside<D>], axes: &mut Axes) {
        let place = |point: isize| (point + WIDEST as isize - axes.first as isize) as usize;
        let own = place(self.first as isize);
        for axis in 0..D {
            let force = &mut axes.other[axis * axes.stride..][..axes.stride];
            for register in 0..WIDEST / Lanes::<S>::WIDTH {
                let mut sum = Lanes::splat(simd, 0.0);
                for bond in bonds {
                    let part = Lanes::load(simd, &bond.force[axis], register);
                    sum = sum + part;
                    let to = &mut force[place(bond.other)..];
                    (Lanes::load(simd, to, register) + part).store(to, register);
                }
                let from = &mut force[own..];
                (Lanes::load(simd, from, register) - sum).store(from, register);
            }
        }
    }
}

/// The first bond of triangles, in a register.
struct First<S: Simd, const D: usize> {
    rest: [Lanes<S>; D],
    eta: [Lanes<S>; D],
    now: [Lanes<S>; D],
    square: Lanes<S>,
    force: [Lanes<S>; D],
    inside: Lanes<S>,
    /// What the owner and the other end have in the weights.
    own: Option<Lanes<S>>,
    /// The same in the mean of the field.
    thirds: Option<Lanes<S>>,
}

impl<S: Simd, const D: usize> First<S, D> {
    /// The triangles with a second bond.
    #[inline(always)]
    fn with<const WAY: u8, const MASKED: bool>(
        &mut self,
        simd: S,
        register: usize,
        second: &mut Beside<D>,
        pair: &Pair,
        shares: &Option<Shares>,
        out: &mut Added<'_, S>,
    ) {
        let load = |channel: &Eight| Lanes::load(simd, channel, register);
        let eta: [Lanes<S>; D] = each(|axis| load(&second.eta[axis]));
        let now: [Lanes<S>; D] = each(|axis| load(&second.now[axis]));
        let at_rest: [Lanes<S>; 3] = each(|axis| Lanes::splat(simd, pair.normal[axis]));
        let (p, q) = (cross(&self.rest, &eta), cross(&self.eta, &now));
        let grown: [Lanes<S>; 3] = each(|axis| p[axis] + q[axis]);
        let normal: [Lanes<S>; 3] = each(|axis| at_rest[axis] + grown[axis]);
        let is_signed = WAY == SIGNED;
        let square = if is_signed { normal[0] * normal[0] } else { dot(&normal, &normal) };
        let by = if is_signed {
            grown[0]
        } else {
            dot(&grown, &each::<_, 3>(|axis| normal[axis] + at_rest[axis]))
        };
        let law = Quadratics::new(simd, &pair.law);
        let changed: Changed<S> = law.changed::<WAY, false>(square, by);
        let mut weight = None;
        if MASKED {
            weight = Some(self.inside * load(&second.inside));
        }
        if let (Some(own), Some(shares)) = (self.own, shares) {
            let share = load(&second.share);
            let all = if shares.are_added { own + share } else { own * share };
            weight = Some(if MASKED { all * (self.inside * load(&second.inside)) } else { all });
        }
        if let Some(thirds) = self.thirds {
            let mean = thirds + load(&second.third);
            weight = Some(match weight {
                Some(weight) => weight * mean,
                None => mean,
            });
        }
        let mut first = changed.first;
        if let Some(weight) = weight {
            first = first * weight;
        }
        let (zero, nothing) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, f64::NAN));
        let mut thin = Lanes::splat(simd, THIN * THIN) * self.square * load(&second.square);
        if MASKED {
            thin = thin * (self.inside * load(&second.inside));
        }
        out.refused = out.refused + square.where_less(thin, nothing, zero);
        if out.has_forces {
            out.refused = out.refused + first.zero_or_nan();
            let scaled: [Lanes<S>; 3] =
                if is_signed { [first, zero, zero] } else { each(|axis| first * normal[axis]) };
            let (p, q) = (turned(&now, &scaled), turned(&self.now, &scaled));
            self.force = each(|axis| self.force[axis] + p[axis]);
            for axis in 0..D {
                let force = &mut second.force[axis];
                (load(force) - q[axis]).store(force, register);
            }
        }
        if let Some(sum) = &mut out.sum {
            let mut energy = law.energy(&changed);
            if let Some(weight) = weight {
                energy = energy * weight;
            }
            out.refused = out.refused + energy.zero_or_nan();
            sum.add_lanes(simd, register, energy);
        }
    }
}
