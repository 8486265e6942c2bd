//! Triangles of owners abreast: a table of the pairs of bonds whose ends are neighbours.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use pulp::Simd;

use super::super::axes::{Axes, Wanted};
use super::super::kind::{AffineLaws, Kind};
use super::super::quadratic::{Changed, Quadratic, Quadratics, ROOT, SIGNED, SQUARE};
use super::super::rows::Rows;
use super::super::sum::Sum;
use super::fans::{FanSweep, Fans, FansByWay};
use super::{
    Abreast, AbreastRoom, Added, Beside, Cliques, CornerShares, NONE, Register, cross, growth,
    weighed,
};
use crate::element::THIN;
use crate::energy::Limits;
use crate::geometry::lanes::Lanes;
use crate::geometry::{Scalar, dot, each};
use crate::interaction::runs::Runs;
use crate::interaction::{Bits, Degeneracy, Slabs};
use crate::neighborhood::{HORIZON_TOLERANCE, Neighborhood};

/// The triangles of a lattice body with an affine law.
pub(in crate::assembly) struct TriangleRuns {
    abreast: Abreast,
    /// Pairs of bonds by the first of them.
    pairs: Vec<Pair>,
    /// Where those of each vector start.
    start: Vec<usize>,
    by_square: bool,
    /// What weights have in common.
    common: f64,
    shape: Shape,
    /// What tangents need beside; made when the first is asked for, nothing where they do not go so.
    fans: OnceLock<Option<Fans>>,
}

/// Two bonds of an owner whose other ends are neighbours.
pub(super) struct Pair {
    /// The number of the second vector.
    pub(super) vector: u32,
    /// The cross product at rest, in m^2; in the plane a number, positive in tables of owners, and zeros.
    pub(super) normal: [f64; 3],
    pub(super) law: Quadratic,
}

impl TriangleRuns {
    /// Nothing of laws that are not affine, and where triangles are so thin at rest that they need twice
    /// the digits.
    pub(in crate::assembly) fn new(
        runs: &Arc<Runs>,
        kind: &Kind,
        (dimension, horizon): (usize, f64),
        degeneracy: Degeneracy,
    ) -> Option<TriangleRuns> {
        let (abreast, common) = Abreast::new(runs, kind, 3);
        let shape = Shape { horizon, degeneracy };
        let table = Table::new(runs, kind, common, shape)?;
        let by_square = table.laws.by_square;
        let (pairs, start) = match dimension {
            2 => table.pairs::<2>()?,
            _ => table.pairs::<3>()?,
        };
        let fans = OnceLock::new();
        Some(TriangleRuns { abreast, pairs, start, by_square, common, shape, fans })
    }

    /// Whether tangents go so, of all slabs: a fan has triangles of owners of several.
    pub(in crate::assembly) fn has_blocks<const D: usize>(
        &self,
        kind: &Kind,
        slabs: &Slabs,
    ) -> bool {
        let fans = || {
            let table = Table::new(&self.abreast.runs, kind, self.common, self.shape)?;
            Fans::new::<D>(&table, slabs)
        };
        self.fans.get_or_init(fans).is_some()
    }

    /// Adds the blocks of bonds from a slab's points to later ones, and what these have in the own blocks of their
    /// ends, at displacements of the slab and of those beside it.
    pub(in crate::assembly) fn add_blocks<const D: usize>(
        &self,
        (neighborhood, slabs): (&Neighborhood, &Slabs),
        axes: &Axes,
        room: &mut AbreastRoom<D>,
        rows: &mut Rows<'_>,
    ) {
        let Some(Some(fans)) = self.fans.get() else { return };
        let of = &self.abreast;
        let sweep = FanSweep { of, fans, neighborhood, slabs, axes, room, rows };
        match (D, self.by_square) {
            (2, _) => of.arch.dispatch(FansByWay::<D, SIGNED>(sweep)),
            (_, false) => of.arch.dispatch(FansByWay::<D, ROOT>(sweep)),
            (_, true) => of.arch.dispatch(FansByWay::<D, SQUARE>(sweep)),
        }
    }

    /// See [`crate::energy::Energy::watch_cliques`].
    pub(in crate::assembly) fn watch(&mut self, dimension: usize, limits: &Limits<'_>) -> bool {
        let share = |size: f64| {
            let shares = limits(size)?.map(|grown| grown / size);
            // Passes know squares of areas in space, which have no sign there.
            let squared = |share: f64| match share > -1.0 {
                true => share * (2.0 + share),
                false => f64::NEG_INFINITY,
            };
            Some(if dimension == 2 { shares } else { shares.map(squared) })
        };
        self.abreast.watch(self.pairs.iter().map(|pair| pair.law.reference), share)
    }

    /// How many vectors the bonds of these have.
    pub(in crate::assembly) fn n_vectors<const D: usize>(&self) -> usize {
        self.abreast.runs.n_vectors::<D>()
    }

    /// Works out what is wanted of the triangles of a slab's owners but for some; nothing where something is not finite,
    /// or thin.
    pub(in crate::assembly) fn add<const D: usize>(
        &self,
        owners: (Range<usize>, Option<&Bits>),
        wanted: Wanted,
        axes: &mut Axes,
        room: &mut AbreastRoom<D>,
    ) -> Option<Sum> {
        let of = &self.abreast;
        match (D, self.by_square) {
            (2, _) => of.sweep(ByWay::<SIGNED>(self), (owners, wanted), axes, room),
            (_, false) => of.sweep(ByWay::<ROOT>(self), (owners, wanted), axes, room),
            (_, true) => of.sweep(ByWay::<SQUARE>(self), (owners, wanted), axes, room),
        }
    }
}

/// What tables of triangles follow from.
pub(super) struct Table<'a> {
    laws: AffineLaws<'a>,
    kind: &'a Kind,
    pub(super) runs: &'a Runs,
    common: f64,
    shape: Shape,
}

/// Which triangles a body has.
#[derive(Clone, Copy)]
struct Shape {
    /// In m.
    horizon: f64,
    degeneracy: Degeneracy,
}

/// A triangle at rest.
pub(super) struct Corner {
    /// The cross product of its bonds, in m^2; in the plane a number and zeros.
    pub(super) normal: [f64; 3],
    area_squared: f64,
    /// Of the bonds, in m^2.
    squares: [f64; 2],
    materials: [u8; 3],
}

impl<'a> Table<'a> {
    /// Nothing of laws that are not affine.
    fn new(runs: &'a Runs, kind: &'a Kind, common: f64, shape: Shape) -> Option<Table<'a>> {
        let laws = kind.affine_laws().filter(|_| !kind.forbids_inversion())?;
        Some(Table { laws, kind, runs, common, shape })
    }

    /// The triangle on two bonds of a point of a material, each with the material of its other end; nothing where
    /// these ends are no neighbours, or the bonds on one line.
    pub(super) fn triangle<const D: usize>(
        &self,
        own: u8,
        [(q, first), (r, second)]: [(&[f64; D], u8); 2],
    ) -> Option<Corner> {
        let between: [f64; D] = each(|axis| r[axis] - q[axis]);
        let (squares, across) = ([dot(q, q), dot(r, r)], dot(&between, &between));
        let reach = self.shape.horizon * (1.0 + HORIZON_TOLERANCE);
        let normal = cross(q, r);
        let area_squared = dot(&normal, &normal);
        let longest = squares[0].max(squares[1]).max(across);
        let is_edge = across <= reach * reach;
        let is_one = is_edge && !self.shape.degeneracy.is_collinear(area_squared, longest);
        let materials = [own, first, second];
        is_one.then_some(Corner { normal, area_squared, squares, materials })
    }

    /// Its energy; nothing where that is not finite.
    pub(super) fn law(&self, of: &Corner) -> Option<Quadratic> {
        self.laws.at(self.kind.parts(&of.materials), of.area_squared.sqrt(), &[], self.common)
    }

    /// The pairs of bonds of an owner, the first of higher number; nothing where triangles are thin.
    fn pairs<const D: usize>(&self) -> Option<(Vec<Pair>, Vec<usize>)> {
        let vectors = self.runs.vectors::<D>();
        let mut listed: Vec<Vec<Pair>> = vectors.iter().map(|_| Vec::new()).collect();
        for (a, xa) in vectors.iter().enumerate() {
            for (b, xb) in vectors.iter().enumerate().take(a) {
                let [[own, of_a], [of_second, of_b]] = [a, b].map(|v| self.runs.materials(v));
                if of_second != own {
                    continue;
                }
                let Some(corner) = self.triangle(own, [(xa, of_a), (xb, of_b)]) else { continue };
                let [square_a, square_b] = corner.squares;
                if corner.area_squared < THIN * THIN * square_a * square_b {
                    return None;
                }
                let (law, normal) = (self.law(&corner)?, corner.normal);
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

/// `x` cross a normal.
#[inline(always)]
pub(super) fn turned<T: Scalar, const D: usize>(x: &[T; D], normal: &[T; 3]) -> [T; D] {
    if D == 2 {
        return each(|axis| if axis == 0 { x[1] * normal[0] } else { -(x[0] * normal[0]) });
    }
    let all = cross(&[x[0], x[1], x[2 % D]], normal);
    each(|axis| all[axis])
}

/// Triangles whose measure is of one kind.
struct ByWay<'a, const WAY: u8>(&'a TriangleRuns);

impl<const D: usize, const WAY: u8> Cliques<D> for ByWay<'_, WAY> {
    #[inline(always)]
    fn add<S: Simd, const MASKED: bool, const PRODUCT: bool>(
        &self,
        at: Register<'_, S>,
        bonds: &mut [Beside<D>],
        first_of: &[u32],
        out: &mut Added<'_, S>,
    ) {
        let TriangleRuns { abreast, pairs, start, .. } = self.0;
        let (vectors, here) = (abreast.runs.vectors::<D>(), at.owners());
        for number in 0..bonds.len() {
            let bond = &bonds[number];
            let (vector, owners) = (bond.vector as usize, bond.owners & here);
            if MASKED && owners == 0 {
                continue;
            }
            let rest = &vectors[vector];
            let mut first = First {
                rest: each(|axis| at.splat(rest[axis])),
                eta: at.load_all(&bond.eta),
                now: at.load_all(&bond.now),
                square: at.load(&bond.square),
                way: if PRODUCT { at.load_all(&bond.way) } else { [at.splat(0.0); D] },
                force: at.load_all(&bond.force),
                shares: at.own_share::<MASKED>().with::<MASKED, D>(at, bond),
            };
            for pair in &pairs[start[vector]..start[vector + 1]] {
                let mut other = first_of[pair.vector as usize];
                while other != NONE {
                    let second = &mut bonds[other as usize];
                    if !MASKED || second.owners & owners != 0 {
                        first.with::<WAY, MASKED, PRODUCT>(at, second, pair, out);
                    }
                    other = second.next;
                }
            }
            for axis in 0..D {
                first.force[axis].store(&mut bonds[number].force[axis], at.number);
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
    way: [Lanes<S>; D],
    force: [Lanes<S>; D],
    /// Of the owner and of the other end.
    shares: CornerShares<S>,
}

impl<S: Simd, const D: usize> First<S, D> {
    /// The triangles with a second bond.
    #[inline(always)]
    fn with<const WAY: u8, const MASKED: bool, const PRODUCT: bool>(
        &mut self,
        at: Register<'_, S>,
        second: &mut Beside<D>,
        pair: &Pair,
        out: &mut Added<'_, S>,
    ) {
        let (eta, now) = (at.load_all(&second.eta), at.load_all(&second.now));
        let at_rest: [Lanes<S>; 3] = each(|axis| at.splat(pair.normal[axis]));
        let grown = growth(&self.rest, &self.eta, (&eta, &now));
        let normal: [Lanes<S>; 3] = each(|axis| at_rest[axis] + grown[axis]);
        let is_signed = WAY == SIGNED;
        let square = if is_signed { normal[0] * normal[0] } else { dot(&normal, &normal) };
        let by = if is_signed {
            grown[0]
        } else {
            dot(&grown, &each::<_, 3>(|axis| normal[axis] + at_rest[axis]))
        };
        let law = Quadratics::new(at.simd, &pair.law);
        let changed: Changed<S> = law.changed::<WAY, PRODUCT>(square, by);
        let shares = self.shares.with::<MASKED, D>(at, second);
        if !PRODUCT {
            let size = law.reference;
            out.watch(by, if is_signed { size } else { size * size }, shares.inside);
        }
        let weight = shares.weight();
        let first = weighed(changed.first, weight);
        let (zero, nothing) = (at.splat(0.0), at.splat(f64::NAN));
        let mut thin = at.splat(THIN * THIN) * self.square * at.load(&second.square);
        if let Some(inside) = shares.inside {
            thin = thin * inside;
        }
        // Bonds without length are none that a normal says something about.
        out.refused = out.refused + thin.where_less(square, zero, nothing);
        if out.has_forces {
            out.refused = out.refused + first.zero_or_nan();
            let scaled: [Lanes<S>; 3] =
                if is_signed { [first, zero, zero] } else { each(|axis| first * normal[axis]) };
            let (mut p, mut q) = (turned(&now, &scaled), turned(&self.now, &scaled));
            if PRODUCT {
                // What a direction changes `now x scaled` by, on both sides.
                let way = at.load_all(&second.way);
                let turn = growth(&self.now, &self.way, (&way, &now));
                let along = if is_signed { turn[0] } else { dot(&normal, &turn) };
                let bent = weighed(changed.second, weight) * along;
                out.refused = out.refused + bent.zero_or_nan();
                let change: [Lanes<S>; 3] = if is_signed {
                    [bent, zero, zero]
                } else {
                    each(|axis| first * turn[axis] + bent * normal[axis])
                };
                (p, q) = (turned(&way, &scaled), turned(&self.way, &scaled));
                let (r, s) = (turned(&now, &change), turned(&self.now, &change));
                (p, q) = (each(|axis| p[axis] + r[axis]), each(|axis| q[axis] + s[axis]));
            }
            self.force = each(|axis| self.force[axis] + p[axis]);
            for axis in 0..D {
                let force = &mut second.force[axis];
                (at.load(force) - q[axis]).store(force, at.number);
            }
        }
        if let Some(sum) = &mut out.sum {
            let energy = weighed(law.energy(&changed), weight);
            out.refused = out.refused + energy.zero_or_nan();
            sum.add_lanes(at.simd, at.number, energy);
        }
    }
}
