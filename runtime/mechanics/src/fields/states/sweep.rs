//! The bonds of a slab run by run: geometry, integrands and sums in one go.
//!
//! Lanes of a register are the bonds of consecutive points. Displacements and all else that points know
//! come from arrays of one kind of number each; nothing is looked up, nothing of a bond is kept from pass
//! to pass but its own law.

use pulp::{Simd, WithSimd};

use super::rows::AlongRows;
use crate::assembly::quadratic::Quadratic;
use crate::assembly::sum::Sum;
use crate::element::WIDEST;
use crate::geometry::bond::Bond;
use crate::geometry::lanes::Lanes;
use crate::geometry::squares::Root;
use crate::geometry::{Scalar, dot, each};
use crate::interaction::runs::there;

/// What passes read at points: of each kind of number one array over the whole body, with room for a
/// register before and behind. Kinds that a pass does not read are empty.
#[derive(Clone, Copy, Default)]
pub(super) struct AtPoints<'a> {
    /// In m.
    pub(super) displacement: &'a [f64],
    /// Of a product.
    pub(super) direction: &'a [f64],
    /// Derivatives of the energy per volume by the integrals.
    pub(super) adjoint: &'a [f64],
    /// What these change by along the direction.
    pub(super) change: &'a [f64],
}

/// The runs of a slab on their way.
pub(super) struct Pass<'a> {
    pub(super) rows: &'a AlongRows,
    pub(super) slab: usize,
    /// The first point that the slab touches, and the number of its first bond.
    pub(super) first: usize,
    pub(super) first_bond: usize,
    pub(super) points: AtPoints<'a>,
    /// What the touched points get as owners and otherwise, one kind of number after the other.
    pub(super) own: &'a mut [f64],
    pub(super) other: &'a mut [f64],
}

/// Integrals, with the energies of bonds; of a `PRODUCT` what integrals change by. Gives back the
/// energies, or nothing where something is not finite.
pub(super) struct Gathering<'a, const D: usize, const N: usize, const PRODUCT: bool>(
    pub(super) Pass<'a>,
);

/// Forces, or a `PRODUCT`. Gives back whether all is finite.
pub(super) struct Pulling<'a, const D: usize, const N: usize, const PRODUCT: bool>(
    pub(super) Pass<'a>,
);

impl<const D: usize, const N: usize, const PRODUCT: bool> WithSimd
    for Gathering<'_, D, N, PRODUCT>
{
    type Output = Option<Sum>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Option<Sum> {
        let mut sum = Sum::default();
        let zero = Lanes::splat(simd, 0.0);
        let (mut refused, mut beyond) = (zero, zero);
        let (watched, slab) = (self.0.rows.watched.as_ref(), self.0.slab);
        walk::<S, D, N, N, PRODUCT>(
            simd,
            self.0,
            #[inline(always)]
            |bonds, ends, group, inside| {
                let now = Now::at(simd, bonds, ends, group, inside);
                let [here, there] = ends.volumes(simd, group);
                let mut parts = [[zero; N]; 2];
                let along = if PRODUCT { now.along(&ends.moved(simd, group)) } else { zero };
                for k in 0..N {
                    let law = &bonds.integrands[k];
                    let mut part =
                        if PRODUCT { law.slope(now.t) * along } else { law.value(now.t) };
                    if let Some(inside) = inside {
                        part = part * inside;
                    }
                    (parts[0][k], parts[1][k]) = (part * there, part * here);
                }
                if !PRODUCT {
                    if let Some(limit) = bonds.limit {
                        let excess = now.t - limit;
                        beyond = beyond.max(match inside {
                            Some(inside) => inside.where_equal(zero, zero, excess),
                            None => excess,
                        });
                    }
                    let mut slope = Lanes::new(simd, ends.bent[group]) * now.t;
                    if let Some(linear) = ends.linear {
                        slope = slope + Lanes::new(simd, linear[group]);
                    }
                    let energy = slope * now.t;
                    // Products have the square of what a length is divided by.
                    refused = refused + energy.zero_or_nan();
                    refused = refused + (now.over * now.over).zero_or_nan();
                    sum.add_lanes(simd, group % (WIDEST / Lanes::<S>::WIDTH), energy);
                }
                parts
            },
        );
        if let (Some(watched), false) = (watched, PRODUCT) {
            watched.note(slab, beyond.largest() > 0.0);
        }
        is_fine(refused).then_some(sum)
    }
}

impl<const D: usize, const N: usize, const PRODUCT: bool> WithSimd for Pulling<'_, D, N, PRODUCT> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let zero = Lanes::splat(simd, 0.0);
        let mut refused = zero;
        walk::<S, D, N, D, PRODUCT>(
            simd,
            self.0,
            #[inline(always)]
            |bonds, ends, group, inside| {
                let now = Now::at(simd, bonds, ends, group, inside);
                let [here, there] = ends.volumes(simd, group);
                let weight = here * there;
                let bent = Lanes::new(simd, ends.bent[group]);
                let stiffness = bent + bent;
                let mut tension = stiffness * now.t;
                if let Some(linear) = ends.linear {
                    tension = tension + Lanes::new(simd, linear[group]);
                }
                let (mut shared, mut bend, mut change) = (zero, zero, zero);
                for k in 0..N {
                    let law = &bonds.integrands[k];
                    let both = sum_of(simd, &ends.adjoint, k, group);
                    let slope = law.slope(now.t);
                    shared = shared + both * slope;
                    if PRODUCT {
                        bend = bend + both * law.bend();
                        change = change + sum_of(simd, &ends.change, k, group) * slope;
                    }
                }
                tension = tension + weight * shared;
                let mut part: [Lanes<S>; D] = [zero; D];
                if PRODUCT {
                    let moved = ends.moved(simd, group);
                    let mut across = tension * now.over;
                    let along = stiffness + weight * bend - across;
                    let mut pull = (along * now.along(&moved) + weight * change) * now.over;
                    if let Some(inside) = inside {
                        (across, pull) = (across * inside, pull * inside);
                    }
                    for axis in 0..D {
                        part[axis] = across * moved[axis] + pull * now.x[axis];
                    }
                } else {
                    let mut pull = tension * now.over;
                    if let Some(inside) = inside {
                        pull = pull * inside;
                    }
                    refused = refused + pull.zero_or_nan();
                    for axis in 0..D {
                        part[axis] = pull * now.x[axis];
                    }
                }
                [part; 2]
            },
        );
        is_fine(refused)
    }
}

#[inline(always)]
fn is_fine<S: Simd>(refused: Lanes<S>) -> bool {
    let (zero, one) = (refused.alike(0.0), refused.alike(1.0));
    refused.where_equal(zero, zero, one).largest() == 0.0
}

/// An integrand of the bonds of a run, in every lane: `rest + t*(linear + bent*t)` with `t = l - L`.
#[derive(Clone, Copy)]
struct Integrand<S: Simd> {
    rest: Lanes<S>,
    linear: Lanes<S>,
    bent: Lanes<S>,
}

impl<S: Simd> Integrand<S> {
    #[inline(always)]
    fn new(simd: S, of: &Quadratic) -> Integrand<S> {
        let all = |x: f64| Lanes::splat(simd, x);
        Integrand { rest: all(of.rest), linear: all(of.linear), bent: all(of.bent) }
    }

    #[inline(always)]
    fn value(&self, t: Lanes<S>) -> Lanes<S> {
        self.rest + t * (self.linear + self.bent * t)
    }

    #[inline(always)]
    fn slope(&self, t: Lanes<S>) -> Lanes<S> {
        self.linear + self.bend() * t
    }

    #[inline(always)]
    fn bend(&self) -> Lanes<S> {
        self.bent + self.bent
    }
}

/// What the bonds of a run have in common.
struct Alike<S: Simd, const D: usize, const N: usize> {
    vector: [Lanes<S>; D],
    length: Lanes<S>,
    integrands: [Integrand<S>; N],
    /// How much longer they may become before they may break, where somebody watches.
    limit: Option<Lanes<S>>,
}

/// A register of bonds as they are.
struct Now<S: Simd, const D: usize> {
    /// From the owner to the other end.
    x: [Lanes<S>; D],
    /// `l - L`, with the digits of displacements.
    t: Lanes<S>,
    /// `1/l`.
    over: Lanes<S>,
}

impl<S: Simd, const D: usize> Now<S, D> {
    /// Where only some lanes are bonds, the others are bonds at rest.
    #[inline(always)]
    fn at<const N: usize>(
        simd: S,
        bonds: &Alike<S, D, N>,
        ends: &Ends<'_, S, D, N>,
        group: usize,
        inside: Option<Lanes<S>>,
    ) -> Now<S, D> {
        let mut eta = relative(simd, &ends.displacement, group);
        if let Some(inside) = inside {
            eta = each(|axis| eta[axis] * inside);
        }
        let squares = Bond::squares(&bonds.vector, &eta);
        // One division for 1/l and 1/(l + L).
        let length = squares.now.sqrt();
        let sum = length + bonds.length;
        let both = length.alike(1.0) / (length * sum);
        Now {
            x: each(|axis| bonds.vector[axis] + eta[axis]),
            t: squares.grown * (length * both),
            over: sum * both,
        }
    }

    /// What lengths change by where ends move so.
    #[inline(always)]
    fn along(&self, moved: &[Lanes<S>; D]) -> Lanes<S> {
        dot(&self.x, moved) * self.over
    }
}

/// What the bonds of a run read, register by register: at their owners and at the other ends.
struct Ends<'a, S: Simd, const D: usize, const N: usize> {
    displacement: [[&'a [S::f64s]; D]; 2],
    direction: [[&'a [S::f64s]; D]; 2],
    adjoint: [[&'a [S::f64s]; N]; 2],
    change: [[&'a [S::f64s]; N]; 2],
    volume: [[&'a [S::f64s]; 1]; 2],
    /// The derivative of the bonds' own energies at rest, and half of the second, times volumes.
    linear: Option<&'a [S::f64s]>,
    bent: &'a [S::f64s],
}

impl<S: Simd, const D: usize, const N: usize> Ends<'_, S, D, N> {
    #[inline(always)]
    fn volumes(&self, simd: S, group: usize) -> [Lanes<S>; 2] {
        each(|end| Lanes::new(simd, self.volume[end][0][group]))
    }

    #[inline(always)]
    fn moved(&self, simd: S, group: usize) -> [Lanes<S>; D] {
        relative(simd, &self.direction, group)
    }
}

/// At the other end less at the owner.
#[inline(always)]
fn relative<S: Simd, const D: usize>(
    simd: S,
    ends: &[[&[S::f64s]; D]; 2],
    group: usize,
) -> [Lanes<S>; D] {
    each(|axis| Lanes::new(simd, ends[1][axis][group]) - Lanes::new(simd, ends[0][axis][group]))
}

/// Of both ends together.
#[inline(always)]
fn sum_of<S: Simd, const N: usize>(
    simd: S,
    ends: &[[&[S::f64s]; N]; 2],
    k: usize,
    group: usize,
) -> Lanes<S> {
    Lanes::new(simd, ends[0][k][group]) + Lanes::new(simd, ends[1][k][group])
}

/// Takes the runs of a slab through `step`, register by register, which says what owners and other ends
/// get.
#[inline(always)]
fn walk<S: Simd, const D: usize, const N: usize, const K: usize, const PRODUCT: bool>(
    simd: S,
    pass: Pass<'_>,
    mut step: impl FnMut(
        &Alike<S, D, N>,
        &Ends<'_, S, D, N>,
        usize,
        Option<Lanes<S>>,
    ) -> [[Lanes<S>; K]; 2],
) {
    let Pass { rows, slab, first, first_bond: mut bond, points, own, other } = pass;
    let vectors = rows.runs.vectors::<D>();
    let (stride, local) = (rows.stride(), own.len() / K);
    let displacement = arrays::<D>(points.displacement, stride);
    let direction = arrays::<D>(points.direction, stride);
    let (adjoint, change) =
        (arrays::<N>(points.adjoint, stride), arrays::<N>(points.change, stride));
    let volume = [&rows.volumes[..]];
    let (mut own, mut other) = (arrays_mut::<K>(own, local), arrays_mut::<K>(other, local));
    for (run, place) in rows.runs.of_slab(slab).iter().zip(rows.runs.places(slab)) {
        let (vector, len) = (run.vector as usize, run.len as usize);
        let padded = len.next_multiple_of(Lanes::<S>::WIDTH);
        let laws = &rows.integrands[vector];
        let bonds = Alike {
            vector: each(|axis| Lanes::splat(simd, vectors[vector][axis])),
            length: Lanes::splat(simd, laws[0].reference),
            integrands: each(|k| Integrand::new(simd, &laws[k])),
            limit: rows.watched.as_ref().map(|of| Lanes::splat(simd, of.limits[vector])),
        };
        let [i, j] = [run.owner, run.other].map(|point| point as usize + WIDEST);
        let ends = Ends::<S, D, N> {
            displacement: both_ends::<S, D>(&displacement, [i, j], padded),
            direction: both_ends::<S, D>(&direction, [i, j], padded),
            adjoint: both_ends::<S, N>(&adjoint, [i, j], padded),
            change: both_ends::<S, N>(&change, [i, j], padded),
            volume: both_ends::<S, 1>(&volume, [i, j], padded),
            linear: rows.linear.as_ref().map(|of| S::as_simd_f64s(&of[bond..bond + padded]).0),
            bent: S::as_simd_f64s(&rows.bent[bond..bond + padded]).0,
        };
        let [i, j] = [i - first, j - first];
        let mut own = own.each_mut().map(|to| S::as_mut_simd_f64s(&mut to[i..i + padded]).0);
        let mut other = other.each_mut().map(|to| S::as_mut_simd_f64s(&mut to[j..j + padded]).0);
        let kept = rows.kept(place);
        for group in 0..padded / Lanes::<S>::WIDTH {
            let parts = match inside_of(simd, (len, kept), group) {
                None => step(&bonds, &ends, group, None),
                inside => step(&bonds, &ends, group, inside),
            };
            add(simd, &parts, [&mut own, &mut other], group);
        }
        bond += len;
    }
}

/// 1 for the lanes of a register of a run of so many bonds that are bonds, and kept, else 0; nothing where all are.
#[inline(always)]
fn inside_of<S: Simd>(
    simd: S,
    (len, kept): (usize, Option<&[u8]>),
    group: usize,
) -> Option<Lanes<S>> {
    let (width, first) = (Lanes::<S>::WIDTH, group * Lanes::<S>::WIDTH);
    let last = (first + width > len).then(|| Lanes::ones(simd, len - first));
    let Some(kept) = kept else { return last };
    let (byte, shift) = (kept[first / WIDEST], first % WIDEST);
    let all = u8::MAX >> (WIDEST - width);
    if byte >> shift & all == all {
        return last;
    }
    let there = there(simd, kept, group);
    Some(match last {
        Some(last) => last * there,
        None => there,
    })
}

#[inline(always)]
fn add<S: Simd, const K: usize>(
    simd: S,
    parts: &[[Lanes<S>; K]; 2],
    to: [&mut [&mut [S::f64s]; K]; 2],
    group: usize,
) {
    let [own, other] = to;
    for k in 0..K {
        own[k][group] = (Lanes::new(simd, own[k][group]) + parts[0][k]).numbers();
        other[k][group] = (Lanes::new(simd, other[k][group]) + parts[1][k]).numbers();
    }
}

/// The arrays of some kinds of numbers; empty ones where there are none.
#[inline(always)]
fn arrays<const K: usize>(of: &[f64], stride: usize) -> [&[f64]; K] {
    each(|k| if of.is_empty() { of } else { &of[k * stride..][..stride] })
}

#[inline(always)]
fn arrays_mut<const K: usize>(of: &mut [f64], stride: usize) -> [&mut [f64]; K] {
    let mut arrays = of.chunks_exact_mut(stride);
    [(); K].map(|()| arrays.next().unwrap_or_default())
}

#[inline(always)]
fn both_ends<'a, S: Simd, const K: usize>(
    of: &[&'a [f64]; K],
    ends: [usize; 2],
    padded: usize,
) -> [[&'a [S::f64s]; K]; 2] {
    let registers = |array: &'a [f64], point: usize| {
        if array.is_empty() { &[] } else { S::as_simd_f64s(&array[point..point + padded]).0 }
    };
    each(|end| each(|k| registers(of[k], ends[end])))
}
