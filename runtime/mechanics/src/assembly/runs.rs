//! Bonds of affine laws on a lattice, run by run: geometry, law and sums in one go.
//!
//! Lanes of a register are the bonds of consecutive points. What a bond is at rest stands in the vector
//! of its run; displacements come from arrays of one axis each, and forces go to such arrays: nothing is
//! looked up and nothing scattered, and no kernel is called ([`super::quadratic`]).

use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};

use super::axes::{Axes, Wanted, axes_of, axis_of};
use super::kind::{AffineLaws, Kind};
use super::quadratic::{Quadratic, Quadratics, ROOT, SQUARE, Shares};
use super::sum::Sum;
use crate::body::Body;
use crate::element::WIDEST;
use crate::geometry::bond::Bond;
use crate::geometry::lanes::Lanes;
use crate::geometry::squares::Root;
use crate::geometry::{Scalar, dot, each};
use crate::interaction::runs::{InRuns, KeptInRuns, Runs, there};
use crate::neighborhood::Neighborhood;

/// The bonds of a body in runs, with an affine law.
pub(super) struct BondRuns {
    runs: Arc<Runs>,
    /// Of each vector of the runs.
    laws: Vec<Quadratic>,
    /// Whether laws are by `l^2 - L^2`, else by `l - L`.
    by_square: bool,
    /// What is left of weights where they are not the same for all.
    shares: Option<Shares>,
    /// Half of the values of the field that the law is a multiple of, point by point: those of both ends
    /// make the mean.
    halves: Option<Shares>,
    /// What multiplies the weights where bonds are corrected.
    factors: Option<InRuns>,
    /// Which bonds are not broken, where some are and none is corrected.
    kept: Option<KeptInRuns>,
    /// How much the square of the length of a bond of each vector may grow before it may break, in m^2; none
    /// where nobody watches.
    limits: Vec<f64>,
    arch: Arch,
}

impl BondRuns {
    /// Nothing of laws that are not affine.
    pub(super) fn new(
        runs: &Arc<Runs>,
        kind: &Kind,
        (body, neighborhood): (&Body, &Neighborhood),
    ) -> Option<BondRuns> {
        let all = kind.affine_laws()?;
        let (common, shares) = Shares::of(&kind.weights, 2);
        let laws = match body.dimension() {
            2 => laws_of::<2>(&all, kind, runs, common)?,
            _ => laws_of::<3>(&all, kind, runs, common)?,
        };
        let (runs, arch, halves) = (Arc::clone(runs), Arch::new(), kind.parts_of_field(2));
        let factors = kind.factors.as_ref().map(|factors| runs.in_runs(neighborhood, factors));
        let (by_square, limits) = (all.by_square, Vec::new());
        let kept = None;
        Some(BondRuns { runs, laws, by_square, shares, halves, factors, kept, limits, arch })
    }
}

impl BondRuns {
    /// Takes out bonds.
    pub(super) fn lose(&mut self, neighborhood: &Neighborhood, bonds: &[usize]) {
        if let Some(factors) = &mut self.factors {
            bonds.iter().for_each(|bond| factors.set(*bond, 0.0));
            return;
        }
        let kept = self.kept.get_or_insert_with(|| self.runs.kept(neighborhood));
        bonds.iter().for_each(|bond| kept.lose(*bond));
    }

    /// Puts back a bond that was taken out, with its correction.
    pub(super) fn regain(&mut self, bond: usize, factor: f64) {
        if let Some(factors) = &mut self.factors {
            factors.set(bond, factor);
        } else if let Some(kept) = &mut self.kept {
            kept.regain(bond);
        }
    }

    /// Watches bonds that may grow by so much, in m^2, each by its number: of all with one vector the least.
    pub(super) fn watch<const D: usize>(&mut self, neighborhood: &Neighborhood, limits: &[f32]) {
        self.limits = vec![f64::INFINITY; self.runs.n_vectors::<D>()];
        for ([owner, other], vector) in self.runs.bonds() {
            let later = neighborhood.upper(owner).before(other as u32);
            let own = f64::from(limits[neighborhood.bonds(owner).start + later]);
            self.limits[vector] = self.limits[vector].min(own);
        }
    }

    /// Works out the bonds of a slab; nothing where something is not finite.
    pub(super) fn add<const D: usize>(&self, of: Wanted, axes: &mut Axes) -> Option<Sum> {
        let mut sum = Sum::default();
        let is_product = of == Wanted::Product;
        let pass = Pass::<D> { runs: self, of, axes, energy: of.has_energy().then_some(&mut sum) };
        let is_fine = match (self.by_square, is_product) {
            (false, false) => self.arch.dispatch(Sweep::<D, ROOT, false>(pass)),
            (false, true) => self.arch.dispatch(Sweep::<D, ROOT, true>(pass)),
            (true, false) => self.arch.dispatch(Sweep::<D, SQUARE, false>(pass)),
            (true, true) => self.arch.dispatch(Sweep::<D, SQUARE, true>(pass)),
        };
        is_fine.then_some(sum)
    }
}

/// The energies of the bonds of each vector.
fn laws_of<const D: usize>(
    laws: &AffineLaws<'_>,
    kind: &Kind,
    runs: &Runs,
    common: f64,
) -> Option<Vec<Quadratic>> {
    let law = |(number, vector): (usize, &[f64; D])| {
        let length = dot(vector, vector).sqrt();
        let direction = vector.map(|component| component / length);
        laws.at(kind.parts(&runs.materials(number)), length, &direction, common)
    };
    runs.vectors::<D>().iter().enumerate().map(law).collect()
}

/// The runs of a slab on their way.
struct Pass<'a, const D: usize> {
    runs: &'a BondRuns,
    of: Wanted,
    axes: &'a mut Axes,
    /// Where energies are added.
    energy: Option<&'a mut Sum>,
}

/// The same for laws by lengths or their squares, for forces or products. Gives back whether all is
/// finite.
struct Sweep<'a, const D: usize, const WAY: u8, const PRODUCT: bool>(Pass<'a, D>);

impl<const D: usize, const WAY: u8, const PRODUCT: bool> WithSimd for Sweep<'_, D, WAY, PRODUCT> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Pass { runs, of, axes, energy } = self.0;
        let Axes {
            slab,
            stride,
            first,
            ref displacement,
            ref direction,
            ref mut own,
            ref mut other,
            ref mut is_beyond,
            ..
        } = *axes;
        let vectors = runs.runs.vectors::<D>();
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let beyond = Lanes::splat(simd, f64::NEG_INFINITY);
        let mut out = Added { refused: zero, beyond, energy, has_forces: of.has_forces() };
        let u: [&[f64]; D] = each(|axis| axis_of(displacement, axis, stride));
        let p: [&[f64]; D] =
            if PRODUCT { each(|axis| axis_of(direction, axis, stride)) } else { [&[]; D] };
        let mut own = axes_of::<D>(own, stride);
        let mut other = axes_of::<D>(other, stride);
        for (run, place) in runs.runs.of_slab(slab).iter().zip(runs.runs.places(slab)) {
            let vector = run.vector as usize;
            let bond = Repeated {
                vector: each(|axis| Lanes::splat(simd, vectors[vector][axis])),
                law: Quadratics::new(simd, &runs.laws[vector]),
                limit: runs.limits.get(vector).map(|limit| Lanes::splat(simd, *limit)),
            };
            let [i, j] = [run.owner, run.other].map(|point| point as usize + WIDEST - first);
            let len = run.len as usize;
            let padded = len.next_multiple_of(Lanes::<S>::WIDTH);
            let mut ends = Ends::<S, D> {
                u: [registers_of::<S, D>(&u, i, padded), registers_of::<S, D>(&u, j, padded)],
                p: if PRODUCT {
                    [registers_of::<S, D>(&p, i, padded), registers_of::<S, D>(&p, j, padded)]
                } else {
                    [[&[]; D]; 2]
                },
                own: own.each_mut().map(|axis| S::as_mut_simd_f64s(&mut axis[i..i + padded]).0),
                other: other.each_mut().map(|axis| S::as_mut_simd_f64s(&mut axis[j..j + padded]).0),
                shares: runs.shares.as_ref().map(|shares| {
                    [i, j].map(|point| {
                        let shares = shares.from(point as isize + first as isize - WIDEST as isize);
                        S::as_simd_f64s(&shares[..padded]).0
                    })
                }),
                are_added: runs.shares.as_ref().is_some_and(|shares| shares.are_added),
                halves: runs.halves.as_ref().map(|halves| {
                    [i, j].map(|point| {
                        let halves = halves.from(point as isize + first as isize - WIDEST as isize);
                        S::as_simd_f64s(&halves[..padded]).0
                    })
                }),
                factors: runs
                    .factors
                    .as_ref()
                    .map(|factors| S::as_simd_f64s(&factors.of_run(place)[..padded]).0),
                kept: runs.kept.as_ref().map(|kept| kept.of_run(place)),
            };
            let full = len / Lanes::<S>::WIDTH;
            for group in 0..full {
                step::<S, D, WAY, PRODUCT, false>(simd, &bond, &mut ends, group, one, &mut out);
            }
            if full * Lanes::<S>::WIDTH < len {
                let rest = len - full * Lanes::<S>::WIDTH;
                let inside = Lanes::ones(simd, rest);
                step::<S, D, WAY, PRODUCT, true>(simd, &bond, &mut ends, full, inside, &mut out);
            }
        }
        *is_beyond = out.beyond.largest() >= 0.0;
        out.refused.where_equal(zero, zero, one).largest() == 0.0
    }
}

#[inline(always)]
fn registers_of<'a, S: Simd, const D: usize>(
    of: &[&'a [f64]; D],
    point: usize,
    padded: usize,
) -> [&'a [S::f64s]; D] {
    each(|axis| S::as_simd_f64s(&of[axis][point..point + padded]).0)
}

/// What the bonds of a run read and write, register by register: at their owners and at the other ends.
struct Ends<'a, S: Simd, const D: usize> {
    u: [[&'a [S::f64s]; D]; 2],
    p: [[&'a [S::f64s]; D]; 2],
    own: [&'a mut [S::f64s]; D],
    other: [&'a mut [S::f64s]; D],
    shares: Option<[&'a [S::f64s]; 2]>,
    are_added: bool,
    halves: Option<[&'a [S::f64s]; 2]>,
    factors: Option<&'a [S::f64s]>,
    /// A bit for each bond, a byte for [`WIDEST`] of them.
    kept: Option<&'a [u8]>,
}

/// What is added up over all bonds of a slab.
struct Added<'a, S: Simd> {
    /// 0 as long as all is well.
    refused: Lanes<S>,
    /// The most that a square has grown beyond its limit.
    beyond: Lanes<S>,
    energy: Option<&'a mut Sum>,
    has_forces: bool,
}

/// A register of bonds. Of the last of a run only some lanes are bonds.
#[inline(always)]
fn step<S: Simd, const D: usize, const WAY: u8, const PRODUCT: bool, const LAST: bool>(
    simd: S,
    bond: &Repeated<S, D>,
    ends: &mut Ends<'_, S, D>,
    group: usize,
    inside: Lanes<S>,
    out: &mut Added<'_, S>,
) {
    let lanes = |numbers: S::f64s| Lanes::new(simd, numbers);
    let relative = |of: &[[&[S::f64s]; D]; 2]| -> [Lanes<S>; D] {
        each(|axis| lanes(of[1][axis][group]) - lanes(of[0][axis][group]))
    };
    let mut eta = relative(&ends.u);
    if LAST {
        // Beyond the run there are bonds at rest without weight.
        eta = each(|axis| eta[axis] * inside);
    }
    let x: [Lanes<S>; D] = each(|axis| bond.vector[axis] + eta[axis]);
    let squares = Bond::squares(&bond.vector, &eta);
    let changed = bond.law.changed::<WAY, PRODUCT>(squares.now, squares.grown);
    let (mut first, mut second) = (changed.first, changed.second);
    let mut weight = LAST.then_some(inside);
    if let Some([own, other]) = ends.shares {
        let (own, other) = (lanes(own[group]), lanes(other[group]));
        let both = if ends.are_added { own + other } else { own * other };
        weight = Some(if LAST { both * inside } else { both });
    }
    if let Some([own, other]) = ends.halves {
        let mean = lanes(own[group]) + lanes(other[group]);
        weight = Some(match weight {
            Some(weight) => weight * mean,
            None => mean,
        });
    }
    // Broken bonds have the factor 0.
    let factor = match (ends.factors, ends.kept) {
        (Some(factors), _) => Some(lanes(factors[group])),
        (None, Some(kept)) => Some(there(simd, kept, group)),
        (None, None) => None,
    };
    if let Some(limit) = bond.limit {
        let mut excess = squares.grown - limit;
        if let Some(factor) = factor {
            excess = factor.where_equal(excess.alike(0.0), excess.alike(-1.0), excess);
        }
        out.beyond = out.beyond.max(excess);
    }
    if let Some(factor) = factor {
        weight = Some(match weight {
            Some(weight) => weight * factor,
            None => factor,
        });
    }
    if let Some(weight) = weight {
        (first, second) = (first * weight, second * weight);
    }
    if out.has_forces {
        out.refused = out.refused + first.zero_or_nan();
        let mut part: [Lanes<S>; D] = each(|axis| first * x[axis]);
        if PRODUCT {
            out.refused = out.refused + second.zero_or_nan();
            let along = relative(&ends.p);
            let stretched = second * dot(&x, &along);
            part = each(|axis| first * along[axis] + stretched * x[axis]);
        }
        for axis in 0..D {
            let to = &mut ends.other[axis][group];
            *to = (lanes(*to) + part[axis]).numbers();
            let from = &mut ends.own[axis][group];
            *from = (lanes(*from) + part[axis]).numbers();
        }
    }
    if let Some(sum) = &mut out.energy {
        let mut energy = bond.law.energy(&changed);
        if let Some(weight) = weight {
            energy = energy * weight;
        }
        out.refused = out.refused + energy.zero_or_nan();
        sum.add_lanes(simd, group % (WIDEST / Lanes::<S>::WIDTH), energy);
    }
}

/// A bond of a run, in every lane of a register.
struct Repeated<S: Simd, const D: usize> {
    vector: [Lanes<S>; D],
    law: Quadratics<S>,
    limit: Option<Lanes<S>>,
}
