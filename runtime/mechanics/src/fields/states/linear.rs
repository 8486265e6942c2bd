//! What products with the Hessian need at fixed displacements, worked out once.
//!
//! Of integrals that do not change to first order nothing is kept. With `x = n.(p_j - p_i)` for each
//! bond the others change by `dI_i = sum_j V_j g' x`, their adjoints by
//! `dA_i = S_i dI_i + sum_j V_j c_i x` with `S = d2w/dI2` and `c_i = 1/2 d2phi/dl dI`, and the tension of
//! a bond by `k x + c_i.dI_i + c_j.dI_j + (dA_i + dA_j).g'`.

use std::ops::Range;

use pulp::Arch;
use rayon::prelude::*;

use super::passes::{States, clear};
use super::{StateEnergy, at_points, by_variables};
use crate::energy::NonFinite;
use crate::interaction::schedule::{Layout, Part, Touched, visit};
use crate::kernel::{Order, Variables};

/// Points per task; fixed, so that results do not depend on threads.
const POINTS: usize = 64;

/// Bonds or points whose derivatives are looked at together.
const CHECKED: usize = 1024;

/// Second derivatives at some displacements.
pub(super) struct Linear {
    /// Integrals that change to first order, and their places among those that change at all.
    active: Vec<usize>,
    places: Vec<usize>,
    /// Whether energies of bonds have mixed derivatives.
    is_mixed: bool,
    /// Of each bond: the unit vector, `V_i V_j` times stiffness less tension over length and times the
    /// latter; then `g'` and, where mixed, `c_i`, `c_j` of the active integrals.
    bonds: Vec<f64>,
    /// `S_i`, row by row.
    by_states: Vec<f64>,
}

impl Linear {
    /// Numbers per bond before those of integrals.
    #[inline(always)]
    fn fixed(d: usize) -> usize {
        d + 2
    }

    #[inline(always)]
    fn width(&self, d: usize) -> usize {
        Linear::fixed(d) + self.active.len() * if self.is_mixed { 3 } else { 1 }
    }

    /// How many integrals change.
    pub(super) fn n_active(&self) -> usize {
        self.active.len()
    }

    /// Whether energies of bonds have mixed derivatives.
    pub(super) fn is_mixed(&self) -> bool {
        self.is_mixed
    }

    /// `S_i` of all points, row by row.
    pub(super) fn by_states(&self) -> &[f64] {
        &self.by_states
    }

    /// All that is known of a bond.
    #[inline(always)]
    pub(super) fn bond<const D: usize>(&self, bond: usize) -> OfBond<'_, D> {
        let (width, a) = (self.width(D), self.active.len());
        let row = &self.bonds[bond * width..(bond + 1) * width];
        let (slopes, mixed) = row[Linear::fixed(D)..].split_at(a);
        OfBond {
            normal: std::array::from_fn(|c| row[c]),
            along_less_across: row[D],
            across: row[D + 1],
            slopes,
            mixed: if self.is_mixed { mixed.split_at(a).into() } else { [&[], &[]] },
        }
    }

    /// The first point with a derivative that is not finite: its own, or that of a bond that it owns.
    fn not_finite(&self, bond_start: &[usize], d: usize) -> Option<usize> {
        // Without branches, so that many are looked at at once.
        let is_bad = |numbers: &[f64]| numbers.iter().fold(false, |bad, x| bad | !x.is_finite());
        let first = |numbers: &[f64], width: usize| {
            let width = width.max(1);
            let bad = numbers.par_chunks(width * CHECKED).position_first(is_bad)? * CHECKED;
            let within = numbers[bad * width..].chunks(width).position(is_bad)?;
            Some(bad + within)
        };
        let squares = self.active.len() * self.active.len();
        let of_states = first(&self.by_states, squares);
        let of_bonds = first(&self.bonds, self.width(d))
            .map(|bond| bond_start.partition_point(|start| *start <= bond) - 1);
        [of_states, of_bonds].into_iter().flatten().min()
    }
}

/// Second derivatives of one bond.
pub(super) struct OfBond<'a, const D: usize> {
    /// The unit vector from the owner to the other end.
    pub(super) normal: [f64; D],
    /// By the displacement along the bond at fixed integrals, less that across it, and the latter: the
    /// tension over the length; in N/m.
    pub(super) along_less_across: f64,
    pub(super) across: f64,
    /// `g'` of the active integrals.
    pub(super) slopes: &'a [f64],
    /// `c_i`, `c_j`.
    pub(super) mixed: [&'a [f64]; 2],
}

/// Second derivatives of the bonds' energies by themselves, as laws give them.
struct Seconds {
    /// By the length, the mean over both ends.
    stiffness: Vec<f64>,
    /// `c_i`, `c_j` of the active integrals of each bond.
    mixed: Vec<f64>,
    by_states: Vec<f64>,
}

impl StateEnergy {
    /// Works out the second derivatives at `u`; refuses those that are not finite.
    pub(super) fn finite<const D: usize>(&self, u: &[f64]) -> Result<Linear, NonFinite> {
        let linear = self.linear::<D>(u)?;
        match linear.not_finite(self.neighborhood.bond_starts(), D) {
            None => Ok(linear),
            Some(point) => Err(self.named(point, None, u)),
        }
    }

    fn linear<const D: usize>(&self, u: &[f64]) -> Result<Linear, NonFinite> {
        let states = self.states::<D>(u, Order::Tangent)?;
        let changes = |slab: usize, k: usize| {
            let slopes = self.slopes(slab, &states);
            self.bonds_of(slab).any(|b| slopes(k, b) != 0.0)
        };
        let is_active = |k: &usize| (0..self.slabs.len()).any(|slab| changes(slab, *k));
        let places: Vec<usize> = (0..self.changing.len()).filter(is_active).collect();
        let active: Vec<usize> = places.iter().map(|place| self.changing[*place]).collect();
        let seconds = self.seconds(&states, &active);
        let is_mixed = seconds.mixed.iter().any(|c| *c != 0.0);
        let by_states = seconds.by_states;
        let mut linear = Linear { active, places, is_mixed, bonds: Vec::new(), by_states };
        linear.bonds = self.pack::<D>(&states, &linear, &seconds.stiffness, &seconds.mixed);
        Ok(linear)
    }

    fn seconds(&self, states: &States, active: &[usize]) -> Seconds {
        let (n, a) = (self.rest.len(), active.len());
        let has_mixed = self.laws.bonds.is_some();
        let mut stiffness = vec![0.0; n];
        let mut mixed = vec![0.0; if has_mixed { 2 * a * n } else { 0 }];
        let mut by_states = self.seconds_of_points(states, active);
        let own = (
            Part::new(self.per_bond(1), &mut stiffness),
            Part::new(self.per_bond(2 * a), &mut mixed),
        );
        let shared = Part::new(Layout::Points(a * a), &mut by_states);
        visit(&self.slabs, shared, own, |slab, [here, next], (stiffness, mixed)| {
            let own = [stiffness.into_values(), mixed.into_values()];
            self.seconds_of_slab(states, active, slab, Touched::new(here, next), own);
        });
        Seconds { stiffness, mixed, by_states }
    }

    pub(super) fn seconds_of_points(&self, states: &States, active: &[usize]) -> Vec<f64> {
        let (m, a) = (self.n_integrals(), active.len());
        let mut by_states = vec![0.0; self.body.n_points() * a * a];
        let Some(law) = self.laws.points.as_ref().filter(|_| a > 0) else { return by_states };
        let work = |(chunk, (rows, out)): (usize, (&[f64], &mut [f64]))| {
            let n = rows.len() / m;
            let laws = self.laws_of(chunk * POINTS..chunk * POINTS + n);
            let (mut current, mut given) = (Vec::new(), Vec::new());
            by_variables(rows, m, &mut current);
            self.give(n, |p| [chunk * POINTS + p; 2], &mut given);
            let mut product = vec![0.0; m * n];
            for (row, &k) in active.iter().enumerate() {
                let mut unit = vec![0.0; m * n];
                unit[k * n..(k + 1) * n].fill(1.0);
                law.product(at_points(&current, (laws, &given), n), &unit, &mut product);
                for (column, &l) in active.iter().enumerate() {
                    for (p, x) in product[l * n..(l + 1) * n].iter().enumerate() {
                        out[(p * a + row) * a + column] = *x;
                    }
                }
            }
        };
        let rows = states.integrals.par_chunks(POINTS * m);
        rows.zip(by_states.par_chunks_mut(POINTS * a * a)).enumerate().for_each(work);
        by_states
    }

    fn seconds_of_slab(
        &self,
        states: &States,
        active: &[usize],
        slab: usize,
        mut by_states: Touched<'_, f64>,
        [stiffness, mixed]: [&mut [f64]; 2],
    ) {
        let (volumes, m, a) = (self.body.volumes(), self.n_integrals(), active.len());
        let start = self.bonds_of(slab).start;
        let (mut taken, mut direction) = (self.work(), Vec::new());
        let work = &mut *taken;
        for (owners, all) in self.chunks(self.slabs.owners(slab)) {
            self.ends(owners, &mut work.ends);
            let (length, change) = (&states.length[all.clone()], &states.change[all.clone()]);
            let rest = &self.rest[all.clone()];
            let (n, own) = (all.len(), all.start - start..all.end - start);
            let stiffness = &mut stiffness[own.clone()];
            for end in 0..2 {
                let Some(law) = &self.laws.bonds else { break };
                work.take(length, &states.integrals, m, end);
                work.set_laws(self.materials.as_deref(), end);
                work.slopes.resize((1 + m) * n, 0.0);
                work.give(self, rest, end);
                let (current, laws) = (&work.variables[..], &work.laws[..]);
                let at = Variables { n, current, change, given: &work.given, laws };
                direction.clear();
                direction.resize((1 + m) * n, 0.0);
                direction[..n].fill(1.0);
                law.product(at, &direction, &mut work.slopes);
                stiffness.iter_mut().zip(&work.slopes).for_each(|(k, x)| *k += 0.5 * x);
                for (place, &k) in active.iter().enumerate() {
                    for b in 0..n {
                        let out = (own.start + b) * 2 * a + end * a + place;
                        mixed[out] = 0.5 * work.slopes[(1 + k) * n + b];
                    }
                }
                for (row, &k) in active.iter().enumerate() {
                    direction.fill(0.0);
                    direction[(1 + k) * n..(2 + k) * n].fill(1.0);
                    law.product(at, &direction, &mut work.slopes);
                    for (b, ends) in work.ends.iter().enumerate() {
                        let (point, other) = (ends[end] as usize, ends[1 - end] as usize);
                        for (column, &l) in active.iter().enumerate() {
                            by_states[(point * a + row) * a + column] +=
                                0.5 * volumes[other] * work.slopes[(1 + l) * n + b];
                        }
                    }
                }
            }
        }
    }

    /// All that is kept of the bonds.
    fn pack<const D: usize>(
        &self,
        states: &States,
        linear: &Linear,
        stiffness: &[f64],
        mixed: &[f64],
    ) -> Vec<f64> {
        let (m, a, width) = (self.n_integrals(), linear.active.len(), linear.width(D));
        let (volumes, normals) = (self.body.volumes(), states.normals::<D>());
        let mut bonds = vec![0.0; self.rest.len() * width];
        let own = Part::new(self.per_bond(width), &mut bonds);
        visit(&self.slabs, (), own, |slab, _, own| {
            let (slopes, bends) = (self.slopes(slab, states), self.bends(slab, states));
            let mut work = self.work();
            self.ends(self.slabs.owners(slab), &mut work.ends);
            let rows = own.into_values().chunks_exact_mut(width);
            for ((b, row), ends) in self.bonds_of(slab).zip(rows).zip(&work.ends) {
                let [i, j] = ends.map(|end| end as usize);
                let (mut tension, mut along) = (states.tension[b], stiffness[b]);
                for (place, k) in self.changing.iter().enumerate() {
                    let both = states.adjoint[i * m + k] + states.adjoint[j * m + k];
                    tension += both * slopes(place, b);
                    along += both * bends(place, b);
                }
                let weight = volumes[i] * volumes[j];
                let across = tension / states.length[b];
                row[..D].copy_from_slice(&normals[b]);
                row[D] = weight * (along - across);
                row[D + 1] = weight * across;
                for (out, place) in row[D + 2..].iter_mut().zip(&linear.places) {
                    *out = slopes(*place, b);
                }
                if linear.is_mixed {
                    row[D + 2 + a..].copy_from_slice(&mixed[b * 2 * a..(b + 1) * 2 * a]);
                }
            }
        });
        bonds
    }

    /// Adds the Hessian times `p` to `product`, both `n x d`; `changes` is room.
    pub(super) fn multiply<const D: usize>(
        &self,
        at: &Linear,
        p: &[f64],
        changes: &mut Vec<f64>,
        product: &mut [f64],
    ) {
        let p = p.as_chunks::<D>().0;
        self.changes(at, p, changes);
        let arch = Arch::new();
        let product = Part::new(Layout::Points(1), product.as_chunks_mut::<D>().0);
        visit(&self.slabs, product, (), |slab, [here, next], ()| {
            let out = Touched::new(here, next);
            arch.dispatch(
                #[inline(always)]
                || match (at.active.len(), at.is_mixed) {
                    (1, false) => self.multiply_slab((1, false), at, (p, changes), slab, out),
                    shape => self.multiply_slab(shape, at, (p, changes), slab, out),
                },
            );
        });
    }

    /// Of each point what its active integrals change by, then what their adjoints do.
    fn changes<const D: usize>(&self, at: &Linear, p: &[[f64; D]], changes: &mut Vec<f64>) {
        let a = at.active.len();
        clear(changes, self.body.n_points() * 2 * a);
        if a == 0 {
            return;
        }
        let arch = Arch::new();
        let shared = Part::new(Layout::Points(2 * a), changes);
        visit(&self.slabs, shared, (), |slab, [here, next], ()| {
            let out = Touched::new(here, next);
            arch.dispatch(
                #[inline(always)]
                || match (a, at.is_mixed) {
                    (1, false) => self.changes_of_slab((1, false), at, p, slab, out),
                    shape => self.changes_of_slab(shape, at, p, slab, out),
                },
            );
        });
        let points = changes.par_chunks_exact_mut(2 * a).zip(at.by_states.par_chunks_exact(a * a));
        points.with_min_len(POINTS).for_each(|(change, by_states)| {
            let (integrals, adjoint) = change.split_at_mut(a);
            for (adjoint, row) in adjoint.iter_mut().zip(by_states.chunks_exact(a)) {
                *adjoint += row.iter().zip(&*integrals).fold(0.0, |sum, (s, x)| sum + s * x);
            }
        });
    }

    #[inline(always)]
    fn changes_of_slab<const D: usize>(
        &self,
        (a, is_mixed): (usize, bool),
        at: &Linear,
        p: &[[f64; D]],
        slab: usize,
        mut out: Touched<'_, f64>,
    ) {
        let volumes = self.body.volumes();
        let width = Linear::fixed(D) + a * if is_mixed { 3 } else { 1 };
        for i in self.slabs.owners(slab) {
            let Range { start, end } = self.neighborhood.bonds(i);
            for k in 0..a {
                let (integral, adjoint) = (i * 2 * a + k, i * 2 * a + a + k);
                // What the owner gets stays in registers.
                let mut own = [out[integral], out[adjoint]];
                let bonds = at.bonds[start * width..end * width].chunks_exact(width);
                for (bond, j) in bonds.zip(self.neighborhood.upper(i)) {
                    let j = j as usize;
                    let along = (0..D).fold(0.0, |sum, c| sum + bond[c] * (p[j][c] - p[i][c]));
                    let part = bond[D + 2 + k] * along;
                    own[0] += volumes[j] * part;
                    out[j * 2 * a + k] += volumes[i] * part;
                    if is_mixed {
                        let (here, there) = (bond[D + 2 + a + k], bond[D + 2 + 2 * a + k]);
                        own[1] += volumes[j] * here * along;
                        out[j * 2 * a + a + k] += volumes[i] * there * along;
                    }
                }
                [out[integral], out[adjoint]] = own;
            }
        }
    }

    #[inline(always)]
    fn multiply_slab<const D: usize>(
        &self,
        (a, is_mixed): (usize, bool),
        at: &Linear,
        (p, changes): (&[[f64; D]], &[f64]),
        slab: usize,
        mut out: Touched<'_, [f64; D]>,
    ) {
        let volumes = self.body.volumes();
        let width = Linear::fixed(D) + a * if is_mixed { 3 } else { 1 };
        for i in self.slabs.owners(slab) {
            let Range { start, end } = self.neighborhood.bonds(i);
            let bonds = at.bonds[start * width..end * width].chunks_exact(width);
            let here = &changes[i * 2 * a..(i + 1) * 2 * a];
            let mut sum = [0.0; D];
            for (bond, j) in bonds.zip(self.neighborhood.upper(i)) {
                let j = j as usize;
                let there = &changes[j * 2 * a..(j + 1) * 2 * a];
                let moved: [f64; D] = std::array::from_fn(|c| p[j][c] - p[i][c]);
                let along = (0..D).fold(0.0, |sum, c| sum + bond[c] * moved[c]);
                let mut shared = 0.0;
                for k in 0..a {
                    shared += (here[a + k] + there[a + k]) * bond[D + 2 + k];
                    if is_mixed {
                        shared +=
                            here[k] * bond[D + 2 + a + k] + there[k] * bond[D + 2 + 2 * a + k];
                    }
                }
                let pull = bond[D] * along + volumes[i] * volumes[j] * shared;
                // Read in full before it is written: the compiler cannot tell that it is nothing else.
                let other = &mut out[j];
                let mut row = *other;
                for c in 0..D {
                    let part = pull * bond[c] + bond[D + 1] * moved[c];
                    row[c] += part;
                    sum[c] += part;
                }
                *other = row;
            }
            let out = &mut out[i];
            for c in 0..D {
                out[c] -= sum[c];
            }
        }
    }
}
