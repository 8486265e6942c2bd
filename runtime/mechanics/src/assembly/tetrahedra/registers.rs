//! What is done to whole blocks in vector registers.

use pulp::{Simd, WithSimd};

use super::super::sum::Sum;
use super::block::{Block, Eight, Thirds};
use super::{Members, Moments, Owner, Vector};
use crate::element::{Order, THIN, WIDEST};
use crate::geometry::lanes::Lanes;
use crate::geometry::{Scalar, dot, each};
use crate::weights::CliqueWeights;

/// The volumes and weights of a block; coplanar cliques get none. Returns whether some tetrahedra have
/// lost digits.
pub(super) struct Measuring<'a> {
    pub(super) block: &'a mut Block,
    pub(super) thirds: &'a Thirds,
    pub(super) members: &'a Members,
    pub(super) weights: &'a CliqueWeights,
    pub(super) owner: &'a Owner<'a>,
}

impl WithSimd for Measuring<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Measuring { block, thirds, members, weights, owner } = self;
        let degeneracy = owner.cliques.degeneracy();
        let splat = |x: f64| Lanes::splat(simd, x);
        let splat_all = |x: &Vector| -> [Lanes<S>; 3] { each(|axis| splat(x[axis])) };
        let (zero, one) = (splat(0.0), splat(1.0));
        let n = block.weight.len();
        let (weight_of, sign_of) = (&mut block.weight[..n], &mut block.sign[..n]);
        let (measure_of, reference_of) = (&mut block.measure[..n], &mut block.reference[..n]);
        let change_of = &mut block.change[..n];
        let mut thin = zero;
        let mut at = 0;
        for row in &block.rows {
            let rest = splat_all(&owner.cliques.reference()[row.j]);
            let eta = splat_all(&owner.members.displacement[row.j]);
            let now = splat_all(&members.now[row.j]);
            let squares: [Lanes<S>; 2] = each(|k| splat(THIN * THIN * row.squares[k]));
            // Lanes without a tetrahedron are evaluated as if they had this volume, unstrained.
            let some_volume = splat(row.longest[0] * row.longest[0].sqrt());
            for third in &thirds.groups {
                for register in 0..WIDEST / Lanes::<S>::WIDTH {
                    let load = |channel: &Eight| Lanes::load(simd, channel, register);
                    let load_all =
                        |all: &[Eight; 3]| -> [Lanes<S>; 3] { each(|axis| load(&all[axis])) };
                    let (normal_at_rest, normal) =
                        (load_all(&third.normal_at_rest), load_all(&third.normal));
                    let at_rest = dot(&rest, &normal_at_rest);
                    let volume = dot(&now, &normal);
                    let grown = dot(&eta, &normal) + dot(&rest, &load_all(&third.turned));
                    let sign = at_rest.sign();
                    let is_clique = load(&weight_of[at]);
                    let square = load(&third.square_at_rest);
                    let volume_squared = at_rest * at_rest;
                    // No edge is longer than twice the longest at the owner, and those are edges:
                    // nearly always that decides.
                    let bound = splat(4.0) * splat(row.longest[0]).max(square);
                    let mut edge = splat(row.longest[1]).max(square);
                    let mut coplanar = degeneracy.coplanar(volume_squared, edge);
                    let possible = degeneracy.coplanar(volume_squared, bound);
                    if (is_clique * (possible - coplanar)).largest() > 0.0 {
                        let corner_l = load_all(&third.rest);
                        for corner in [row.j, thirds.k] {
                            let corner = splat_all(&owner.cliques.reference()[corner]);
                            let away: [Lanes<S>; 3] = each(|axis| corner_l[axis] - corner[axis]);
                            edge = edge.max(dot(&away, &away));
                        }
                        coplanar = possible * degeneracy.coplanar(volume_squared, edge);
                    }
                    let weight = is_clique * weights.join_last(row.weight, load(&third.share));
                    let weight = coplanar.where_equal(zero, weight, zero);
                    weight.store(&mut weight_of[at], register);
                    let used =
                        |value: Lanes<S>, other: Lanes<S>| weight.where_equal(zero, other, value);
                    used(sign * volume, some_volume).store(&mut measure_of[at], register);
                    used(sign * at_rest, some_volume).store(&mut reference_of[at], register);
                    used(grown / at_rest, zero).store(&mut change_of[at], register);
                    sign.store(&mut sign_of[at], register);
                    let is_thin = volume_squared.where_less(squares[0] * square, one, zero);
                    let largest_now = squares[1] * load(&third.square);
                    let is_thin = (volume * volume).where_less(largest_now, one, is_thin);
                    thin = thin + used(is_thin, zero);
                }
                at += 1;
            }
        }
        thin.largest() > 0.0
    }
}

/// The energy of a block and the moments of its pairs `(j, k)` and `(k, l)`; whether all was finite
/// and no volume below the least.
pub(super) struct Summing<'a> {
    pub(super) block: &'a mut Block,
    pub(super) members: &'a Members,
    pub(super) thirds: &'a mut Thirds,
    pub(super) pairs: &'a mut [Moments],
    pub(super) energy: &'a mut Sum,
    pub(super) order: Order,
    pub(super) least: f64,
}

impl WithSimd for Summing<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> bool {
        let is_fine = self.weigh(simd);
        match self.order {
            Order::Energy => {}
            Order::Force | Order::Gradient => self.sum_moments::<S, 3>(simd),
            Order::Tangent => self.sum_moments::<S, 9>(simd),
        }
        is_fine
    }
}

impl Summing<'_> {
    /// Sums the energies and turns psi' and psi'' into `f` and `s`.
    #[inline(always)]
    fn weigh<S: Simd>(&mut self, simd: S) -> bool {
        let (block, energy, order) = (&mut *self.block, &mut *self.energy, self.order);
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let (least, nothing) = (Lanes::splat(simd, self.least), Lanes::splat(simd, f64::NAN));
        // 0 as long as all is well.
        let mut refused = zero;
        let n = block.weight.len();
        let (weight_of, sign_of, measure_of) =
            (&block.weight[..n], &block.sign[..n], &block.measure[..n]);
        let (change_of, psi_of) = (&block.change[..n], &mut block.psi[..n]);
        let (first_of, second_of) = (&mut block.first[..n], &mut block.second[..n]);
        for at in 0..n {
            for register in 0..WIDEST / Lanes::<S>::WIDTH {
                let load = |channel: &Eight| Lanes::load(simd, channel, register);
                let weight = load(&weight_of[at]);
                refused = refused + load(&change_of[at]).zero_or_nan();
                if order.has_energy() {
                    let part = weight * load(&psi_of[at]);
                    part.store(&mut psi_of[at], register);
                    refused = refused + part.zero_or_nan();
                }
                refused = load(&measure_of[at]).where_less(least, nothing, refused);
                if order >= Order::Force {
                    let first = weight * load(&sign_of[at]) * load(&first_of[at]);
                    first.store(&mut first_of[at], register);
                    refused = refused + first.zero_or_nan();
                }
                if order == Order::Tangent {
                    let second = weight * load(&second_of[at]);
                    second.store(&mut second_of[at], register);
                    refused = refused + second.zero_or_nan();
                }
            }
        }
        if order.has_energy() {
            energy.add(block.psi.as_flattened());
        }
        refused.where_equal(zero, zero, one).largest() == 0.0
    }

    /// Sums the first `PARTS` moments. Sums over lanes have one order, whatever the width of the
    /// registers: that of the widest.
    #[inline(always)]
    fn sum_moments<S: Simd, const PARTS: usize>(&mut self, simd: S) {
        let (block, thirds) = (&*self.block, &mut *self.thirds);
        let groups = thirds.groups.len();
        let (third_groups, third_sums) = (&thirds.groups[..groups], &mut thirds.sums[..groups]);
        for (number, row) in block.rows.iter().enumerate() {
            let near = &self.members.moments[row.j];
            let lanes = number * groups..(number + 1) * groups;
            let (firsts, seconds) = (&block.first[lanes.clone()], &block.second[lanes]);
            let mut totals = [[0.0; WIDEST]; PARTS];
            for register in 0..WIDEST / Lanes::<S>::WIDTH {
                let mut sums: [Lanes<S>; PARTS] = each(|_| Lanes::splat(simd, 0.0));
                for group in 0..groups {
                    let first = Lanes::load(simd, &firsts[group], register);
                    let second = Lanes::load(simd, &seconds[group], register);
                    let (far, outer) = (&third_groups[group].moments, &mut third_sums[group]);
                    for part in 0..PARTS {
                        let factor = if part < 3 { first } else { second };
                        sums[part] = sums[part] + factor * Lanes::load(simd, &far[part], register);
                        let sum = Lanes::load(simd, &outer[part], register)
                            + factor * Lanes::splat(simd, near[part]);
                        sum.store(&mut outer[part], register);
                    }
                }
                for part in 0..PARTS {
                    sums[part].store(&mut totals[part], register);
                }
            }
            let pair = &mut self.pairs[row.pair as usize];
            for part in 0..PARTS {
                let [a, b, c, d, e, f, g, h] = totals[part];
                pair[part] += ((a + e) + (c + g)) + ((b + f) + (d + h));
            }
        }
    }
}
