//! Tetrahedra of owners abreast: a table of the triples of bonds whose ends are neighbours.
//!
//! With vectors `a`, `b`, `c` from the owner to the other corners, `v = (a x b).c`. All tetrahedra on a
//! pair of bonds share its normal `a x b`: the force on the end of `c` is `f a x b`, where `f` is the
//! weighted derivative of the energy, and those on the ends of `a` and `b` are `b x s` and `s x a` with
//! the sum `s` of `f c`. A direction of products changes all of these by the product rule: `a x b` by `da x b + a x db`,
//! `v` along that, `f` by what `v` changes by.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use pulp::Simd;

use super::super::axes::{Axes, Wanted};
use super::super::kind::{AffineLaws, Kind};
use super::super::quadratic::{Quadratic, Quadratics, SIGNED};
use super::super::rows::Rows;
use super::super::sum::Sum;
use super::blocks::{BlockSweep, Edge, Edges, Third};
use super::{
    Abreast, AbreastRoom, Added, Beside, Cliques, CornerShares, NONE, Register, growth, weighed,
};
use crate::element::THIN;
use crate::energy::Limits;
use crate::geometry::lanes::Lanes;
use crate::geometry::{cross, dot, each};
use crate::interaction::runs::Runs;
use crate::interaction::{Bits, Degeneracy};
use crate::neighborhood::{HORIZON_TOLERANCE, Neighborhood};

/// Most tetrahedra of an owner, 16 MiB of them here and three times as much for tangents: a horizon of five
/// spacings has 0.9 million, one of six 4 million.
const MOST: usize = 1 << 21;

/// The tetrahedra of a lattice body with an affine law.
pub(in crate::assembly) struct TetrahedronRuns {
    abreast: Abreast,
    /// Pairs of bonds by the first of them, and where those of each vector start.
    bases: Vec<Edge>,
    start: Vec<usize>,
    /// The tetrahedra on each pair, whose third bonds have lower numbers than both.
    thirds: Vec<Third>,
    /// Those that differ, each followed by the same for the other order of the bonds.
    laws: Vec<Quadratic>,
    /// What tangents need beside; made when the first is asked for.
    edges: OnceLock<Edges>,
}

impl TetrahedronRuns {
    /// Nothing of laws that are not affine, and where tetrahedra are so thin at rest that they need twice
    /// the digits, or too many.
    pub(in crate::assembly) fn new(
        runs: &Arc<Runs>,
        kind: &Kind,
        horizon: f64,
        degeneracy: Degeneracy,
    ) -> Option<TetrahedronRuns> {
        // Of a measure with a sign laws are by itself, not by its square.
        let laws =
            kind.affine_laws().filter(|laws| !laws.by_square && !kind.forbids_inversion())?;
        let (abreast, common) = Abreast::new(runs, kind, 4);
        let all = TetrahedronRuns {
            abreast,
            bases: Vec::new(),
            start: vec![0],
            thirds: Vec::new(),
            laws: Vec::new(),
            edges: OnceLock::new(),
        };
        let reach = horizon * (1.0 + HORIZON_TOLERANCE);
        let numbers = BTreeMap::new();
        Table { laws, kind, runs, common, reach, degeneracy, numbers, all }.fill()
    }

    /// See [`crate::energy::Energy::watch_cliques`].
    pub(in crate::assembly) fn watch(&mut self, limits: &Limits<'_>) -> bool {
        let share = |size: f64| Some(limits(size)?.map(|grown| grown / size));
        self.abreast.watch(self.laws.iter().map(|law| law.reference.abs()), share)
    }

    /// How many vectors the bonds of these have.
    pub(in crate::assembly) fn n_vectors(&self) -> usize {
        self.abreast.runs.n_vectors::<3>()
    }

    /// Works out what is wanted of the tetrahedra of a slab's owners but for some; nothing where something
    /// is not finite, or thin.
    pub(in crate::assembly) fn add(
        &self,
        owners: (Range<usize>, Option<&Bits>),
        wanted: Wanted,
        axes: &mut Axes,
        room: &mut AbreastRoom<3>,
    ) -> Option<Sum> {
        self.abreast.sweep(self, (owners, wanted), axes, room)
    }

    /// Adds the tangent of the tetrahedra of a slab's owners, but for some, at the displacements in `axes`.
    pub(in crate::assembly) fn add_blocks(
        &self,
        neighborhood: &Neighborhood,
        owners: (Range<usize>, Option<&Bits>),
        (axes, room): (&mut Axes, &mut AbreastRoom<3>),
        rows: &mut Rows<'_>,
    ) {
        let (of, laws) = (&self.abreast, &self.laws[..]);
        let edges = self.edges.get_or_init(|| Edges::new(&of.runs, self.triples()));
        let sweep = BlockSweep { of, edges, laws, neighborhood, owners, axes, room, rows };
        self.abreast.arch.dispatch(sweep);
    }

    /// The vectors of each tetrahedron, and its law.
    fn triples(&self) -> impl Iterator<Item = ([u32; 3], u32)> + '_ {
        let of_base = |base: &Edge| {
            let ([a, b], thirds) = (base.vectors, &self.thirds[base.thirds.clone()]);
            thirds.iter().map(move |third| ([a, b, third.vector], third.law))
        };
        self.bases.iter().flat_map(of_base)
    }
}

/// The table on its way, and what it follows from.
struct Table<'a> {
    laws: AffineLaws<'a>,
    kind: &'a Kind,
    runs: &'a Runs,
    common: f64,
    reach: f64,
    degeneracy: Degeneracy,
    /// Of laws, by the bits of volumes and the materials of corners.
    numbers: BTreeMap<(u64, [u8; 4]), u32>,
    all: TetrahedronRuns,
}

impl Table<'_> {
    fn fill(mut self) -> Option<TetrahedronRuns> {
        let n = self.runs.n_vectors::<3>();
        for a in 0..n {
            // Later neighbours of the owner that are neighbours of the end of `a`.
            let near: Vec<usize> = (0..a).filter(|b| self.is_edge(a, *b)).collect();
            for (place, &b) in near.iter().enumerate() {
                let first = self.all.thirds.len();
                for &c in &near[..place] {
                    if self.is_edge(b, c) {
                        self.add([a, b, c])?;
                    }
                }
                let thirds = first..self.all.thirds.len();
                if !thirds.is_empty() {
                    let [xa, xb] = [a, b].map(|v| self.runs.vectors::<3>()[v]);
                    let (vectors, normal) = ([a, b].map(|v| v as u32), cross(&xa, &xb));
                    self.all.bases.push(Edge { vectors, normal, thirds });
                }
            }
            self.all.start.push(self.all.bases.len());
        }
        Some(self.all)
    }

    /// Whether bonds are of one owner, and their ends neighbours.
    fn is_edge(&self, a: usize, b: usize) -> bool {
        let vectors = self.runs.vectors::<3>();
        let between: [f64; 3] = each(|axis| vectors[b][axis] - vectors[a][axis]);
        let [of_a, of_b] = [a, b].map(|v| self.runs.materials(v)[0]);
        of_a == of_b && dot(&between, &between) <= self.reach * self.reach
    }

    /// Adds the tetrahedron of three bonds, unless it is flat; nothing where it is thin, or its law not
    /// finite.
    fn add(&mut self, bonds: [usize; 3]) -> Option<()> {
        let vectors = self.runs.vectors::<3>();
        let [xa, xb, xc] = bonds.map(|v| vectors[v]);
        let volume = dot(&cross(&xa, &xb), &xc);
        let squares = [xa, xb, xc].map(|x| dot(&x, &x));
        let edge = |p: &[f64; 3], q: &[f64; 3]| {
            let between: [f64; 3] = each(|axis| q[axis] - p[axis]);
            dot(&between, &between)
        };
        let others = [edge(&xa, &xb), edge(&xa, &xc), edge(&xb, &xc)];
        let longest = squares.iter().chain(&others).fold(0.0, |most: f64, x| most.max(*x));
        if self.degeneracy.is_coplanar(volume * volume, longest) {
            return Some(());
        }
        if volume * volume < THIN * THIN * squares[0] * squares[1] * squares[2] {
            return None;
        }
        let [of_a, of_b, of_c] = bonds.map(|v| self.runs.materials(v));
        let corners = [of_a[0], of_a[1], of_b[1], of_c[1]];
        let known = self.numbers.get(&(volume.to_bits(), corners)).copied();
        let law = match known {
            Some(law) => law,
            None => self.add_law(volume, corners)?,
        };
        self.all.thirds.push(Third { vector: bonds[2] as u32, law });
        (self.all.thirds.len() <= MOST).then_some(())
    }

    /// Adds the law of tetrahedra with this volume at rest, in both orders; nothing where it is not finite.
    fn add_law(&mut self, volume: f64, corners: [u8; 4]) -> Option<u32> {
        let (parts, number) = (self.kind.parts(&corners), self.all.laws.len() as u32);
        let law = self.laws.at(parts, volume.abs(), &[], self.common)?;
        for (turned, volume) in [(0, volume), (1, -volume)] {
            let linear = law.linear * volume.signum();
            self.all.laws.push(Quadratic { reference: volume, linear, ..law });
            self.numbers.insert((volume.to_bits(), corners), number + turned);
        }
        Some(number)
    }
}

impl Cliques<3> for &TetrahedronRuns {
    #[inline(always)]
    fn add<S: Simd, const MASKED: bool, const PRODUCT: bool>(
        &self,
        at: Register<'_, S>,
        bonds: &mut [Beside<3>],
        first_of: &[u32],
        out: &mut Added<'_, S>,
    ) {
        let vectors = self.abreast.runs.vectors::<3>();
        for number in 0..bonds.len() {
            let bond = &bonds[number];
            let (vector, owners) = (bond.vector as usize, bond.owners & at.owners());
            if MASKED && owners == 0 {
                continue;
            }
            let mut first = First {
                owners,
                rest: each(|axis| at.splat(vectors[vector][axis])),
                eta: at.load_all(&bond.eta),
                now: at.load_all(&bond.now),
                way: if PRODUCT { at.load_all(&bond.way) } else { [at.splat(0.0); 3] },
                square: at.splat(THIN * THIN) * at.load(&bond.square),
                force: at.load_all(&bond.force),
                shares: at.own_share::<MASKED>().with::<MASKED, 3>(at, bond),
            };
            for base in &self.bases[self.start[vector]..self.start[vector + 1]] {
                let mut other = first_of[base.vectors[1] as usize];
                while other != NONE {
                    let place = other as usize;
                    other = bonds[place].next;
                    if !MASKED || bonds[place].owners & owners != 0 {
                        let pair = first.with::<MASKED, PRODUCT>(at, &bonds[place], base);
                        let on_pair = (&mut *bonds, first_of);
                        let sums =
                            self.on_pair::<S, MASKED, PRODUCT>(at, &pair, base, on_pair, out);
                        first.pull::<PRODUCT>(at, &mut bonds[place], &sums);
                    }
                }
            }
            for axis in 0..3 {
                first.force[axis].store(&mut bonds[number].force[axis], at.number);
            }
        }
    }
}

/// The first bond of tetrahedra, in a register.
struct First<S: Simd> {
    /// Bits of those that have it.
    owners: u8,
    rest: [Lanes<S>; 3],
    eta: [Lanes<S>; 3],
    now: [Lanes<S>; 3],
    way: [Lanes<S>; 3],
    /// The square, by as much as volumes may be less.
    square: Lanes<S>,
    force: [Lanes<S>; 3],
    /// Of the owner and of the other end.
    shares: CornerShares<S>,
}

impl<S: Simd> First<S> {
    /// It and a second bond.
    #[inline(always)]
    fn with<const MASKED: bool, const PRODUCT: bool>(
        &self,
        at: Register<'_, S>,
        second: &Beside<3>,
        base: &Edge,
    ) -> Pair<S> {
        let now = at.load_all(&second.now);
        let grown = growth(&self.rest, &self.eta, (&at.load_all(&second.eta), &now));
        let turn = match PRODUCT {
            true => growth(&self.now, &self.way, (&at.load_all(&second.way), &now)),
            false => [at.splat(0.0); 3],
        };
        Pair {
            owners: self.owners & second.owners,
            normal: each(|axis| at.splat(base.normal[axis]) + grown[axis]),
            grown,
            turn,
            square: self.square * at.load(&second.square),
            shares: self.shares.with::<MASKED, 3>(at, second),
        }
    }

    /// Adds the forces on the ends of both, from the sums over third bonds; or what the direction changes them by.
    #[inline(always)]
    fn pull<const PRODUCT: bool>(
        &mut self,
        at: Register<'_, S>,
        second: &mut Beside<3>,
        sums: &Sums<S>,
    ) {
        let now = at.load_all(&second.now);
        let last = if PRODUCT { &sums.change } else { &sums.sum };
        let (p, q) = (cross(&now, last), cross(last, &self.now));
        self.take(at, second, (&p, &q));
        if PRODUCT {
            let way = at.load_all(&second.way);
            let (p, q) = (cross(&way, &sums.sum), cross(&sums.sum, &self.way));
            self.take(at, second, (&p, &q));
        }
    }

    /// Adds to the forces on the ends of both.
    #[inline(always)]
    fn take(
        &mut self,
        at: Register<'_, S>,
        second: &mut Beside<3>,
        (p, q): (&[Lanes<S>; 3], &[Lanes<S>; 3]),
    ) {
        for axis in 0..3 {
            self.force[axis] = self.force[axis] + p[axis];
            let force = &mut second.force[axis];
            (at.load(force) + q[axis]).store(force, at.number);
        }
    }
}

/// Two bonds of tetrahedra, in a register.
struct Pair<S: Simd> {
    /// Bits of those that have both.
    owners: u8,
    /// Their cross product, and how much it has grown.
    normal: [Lanes<S>; 3],
    grown: [Lanes<S>; 3],
    /// What the direction of a product changes the cross product by.
    turn: [Lanes<S>; 3],
    /// The product of their squares, by as much as volumes may be less.
    square: Lanes<S>,
    /// Of the owner and of both ends.
    shares: CornerShares<S>,
}

/// Sums over the tetrahedra on a pair of bonds: of the third bonds times the derivatives, and what the direction of a
/// product changes that by.
struct Sums<S: Simd> {
    sum: [Lanes<S>; 3],
    change: [Lanes<S>; 3],
}

impl TetrahedronRuns {
    /// The tetrahedra on a pair of bonds.
    #[inline(always)]
    fn on_pair<S: Simd, const MASKED: bool, const PRODUCT: bool>(
        &self,
        at: Register<'_, S>,
        pair: &Pair<S>,
        base: &Edge,
        (bonds, first_of): (&mut [Beside<3>], &[u32]),
        out: &mut Added<'_, S>,
    ) -> Sums<S> {
        let (zero, nothing) = (at.splat(0.0), at.splat(f64::NAN));
        let at_rest: [Lanes<S>; 3] = each(|axis| at.splat(base.normal[axis]));
        let mut sums = Sums { sum: [zero; 3], change: [zero; 3] };
        for third in &self.thirds[base.thirds.clone()] {
            let law = Quadratics::new(at.simd, &self.laws[third.law as usize]);
            let mut other = first_of[third.vector as usize];
            while other != NONE {
                let bond = &mut bonds[other as usize];
                other = bond.next;
                if MASKED && bond.owners & pair.owners == 0 {
                    continue;
                }
                let now = at.load_all(&bond.now);
                let grown = dot(&pair.grown, &now) + dot(&at_rest, &at.load_all(&bond.eta));
                let changed = law.changed::<SIGNED, PRODUCT>(zero, grown);
                let shares = pair.shares.with::<MASKED, 3>(at, bond);
                let volume = law.reference + grown;
                if !PRODUCT {
                    let whole = law.reference * law.reference;
                    out.watch(grown * law.reference, whole, shares.inside);
                }
                let mut thin = pair.square * at.load(&bond.square);
                if let Some(inside) = shares.inside {
                    thin = thin * inside;
                }
                out.refused = out.refused + (volume * volume).where_less(thin, nothing, zero);
                let weight = shares.weight();
                if out.has_forces {
                    let first = weighed(changed.first, weight);
                    out.refused = out.refused + first.zero_or_nan();
                    let mut part: [Lanes<S>; 3] = each(|axis| first * pair.normal[axis]);
                    if PRODUCT {
                        let way = at.load_all(&bond.way);
                        let along = dot(&pair.turn, &now) + dot(&pair.normal, &way);
                        let bent = weighed(changed.second, weight) * along;
                        out.refused = out.refused + bent.zero_or_nan();
                        part = each(|axis| bent * pair.normal[axis] + first * pair.turn[axis]);
                        for axis in 0..3 {
                            let change = bent * now[axis] + first * way[axis];
                            sums.change[axis] = sums.change[axis] + change;
                        }
                    }
                    for axis in 0..3 {
                        sums.sum[axis] = sums.sum[axis] + first * now[axis];
                        let force = &mut bond.force[axis];
                        (at.load(force) + part[axis]).store(force, at.number);
                    }
                }
                if let Some(sum) = &mut out.sum {
                    let energy = weighed(law.energy(&changed), weight);
                    out.refused = out.refused + energy.zero_or_nan();
                    sum.add_lanes(at.simd, at.number, energy);
                }
            }
        }
        sums
    }
}
