//! What is done to whole blocks in vector registers.

use pulp::{Simd, WithSimd};

use super::super::sum::Sum;
use super::block::{Block, Thirds};
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
        let groups = thirds.width() / Lanes::<S>::WIDTH;
        let mut thin = zero;
        for (number, row) in block.rows.iter().enumerate() {
            let rest = splat_all(&owner.cliques.reference()[row.j]);
            let eta = splat_all(&owner.displacement[row.j]);
            let now = splat_all(&members.now[row.j]);
            let squares: [Lanes<S>; 2] = each(|k| splat(THIN * THIN * row.squares[k]));
            // Lanes without a tetrahedron are evaluated as if they had this volume, unstrained.
            let some_volume = splat(row.longest[0] * row.longest[0].sqrt());
            for group in 0..groups {
                let lanes = number * groups + group;
                let load = |channel: &[f64]| Lanes::load(simd, channel, group);
                let load_all = |channels: &[Vec<f64>; 3]| -> [Lanes<S>; 3] {
                    each(|axis| load(&channels[axis]))
                };
                let (normal_at_rest, normal) =
                    (load_all(&thirds.normal_at_rest), load_all(&thirds.normal));
                let at_rest = dot(&rest, &normal_at_rest);
                let volume = dot(&now, &normal);
                let grown = dot(&eta, &normal) + dot(&rest, &load_all(&thirds.turned));
                let sign = at_rest.sign();
                let is_clique = Lanes::load(simd, &block.weight, lanes);
                let square = load(&thirds.square_at_rest);
                let volume_squared = at_rest * at_rest;
                // No edge is longer than twice the longest at the owner, and those are edges: nearly
                // always that decides.
                let bound = splat(4.0) * splat(row.longest[0]).max(square);
                let mut edge = splat(row.longest[1]).max(square);
                let mut coplanar = degeneracy.coplanar(volume_squared, edge);
                let possible = degeneracy.coplanar(volume_squared, bound);
                if (is_clique * (possible - coplanar)).largest() > 0.0 {
                    let third = load_all(&thirds.rest);
                    for corner in [row.j, thirds.k] {
                        let corner = splat_all(&owner.cliques.reference()[corner]);
                        let away: [Lanes<S>; 3] = each(|axis| third[axis] - corner[axis]);
                        edge = edge.max(dot(&away, &away));
                    }
                    coplanar = possible * degeneracy.coplanar(volume_squared, edge);
                }
                let weight = is_clique * weights.join_last(row.weight, load(&thirds.shares));
                let weight = coplanar.where_equal(zero, weight, zero);
                weight.store(&mut block.weight, lanes);
                let used =
                    |value: Lanes<S>, other: Lanes<S>| weight.where_equal(zero, other, value);
                used(sign * volume, some_volume).store(&mut block.measure, lanes);
                used(sign * at_rest, some_volume).store(&mut block.reference, lanes);
                used(grown / at_rest, zero).store(&mut block.change, lanes);
                sign.store(&mut block.sign, lanes);
                let is_thin = volume_squared.where_less(squares[0] * square, one, zero);
                let largest_now = squares[1] * load(&thirds.square);
                let is_thin = (volume * volume).where_less(largest_now, one, is_thin);
                thin = thin + used(is_thin, zero);
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
            Order::Gradient => self.sum_moments::<S, 3>(simd),
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
        for lanes in 0..block.weight.len() / Lanes::<S>::WIDTH {
            let load = |channel: &[f64]| Lanes::load(simd, channel, lanes);
            let weight = load(&block.weight);
            let part = weight * load(&block.psi);
            part.store(&mut block.psi, lanes);
            let change = load(&block.change);
            refused = refused + part.zero_or_nan() + change.zero_or_nan();
            refused = load(&block.measure).where_less(least, nothing, refused);
            if order >= Order::Gradient {
                let first = weight * load(&block.sign) * load(&block.first);
                first.store(&mut block.first, lanes);
                refused = refused + first.zero_or_nan();
            }
            if order == Order::Tangent {
                let second = weight * load(&block.second);
                second.store(&mut block.second, lanes);
                refused = refused + second.zero_or_nan();
            }
        }
        energy.add(&block.psi[..block.weight.len()]);
        refused.where_equal(zero, zero, one).largest() == 0.0
    }

    /// Sums the first `PARTS` moments. Sums over lanes have one order, whatever the width of the
    /// registers: that of the widest.
    #[inline(always)]
    fn sum_moments<S: Simd, const PARTS: usize>(&mut self, simd: S) {
        let (block, thirds) = (&*self.block, &mut *self.thirds);
        let groups = thirds.width() / Lanes::<S>::WIDTH;
        let registers = WIDEST / Lanes::<S>::WIDTH;
        for (number, row) in block.rows.iter().enumerate() {
            let near = &self.members.moments[row.j];
            let mut totals = [[0.0; WIDEST]; PARTS];
            for register in 0..registers {
                let mut sums: [Lanes<S>; PARTS] = each(|_| Lanes::splat(simd, 0.0));
                for group in (register..groups).step_by(registers) {
                    let lanes = number * groups + group;
                    let first = Lanes::load(simd, &block.first, lanes);
                    let second = match PARTS {
                        3 => first,
                        _ => Lanes::load(simd, &block.second, lanes),
                    };
                    for part in 0..PARTS {
                        let factor = if part < 3 { first } else { second };
                        let far = Lanes::load(simd, &thirds.moments[part], group);
                        sums[part] = sums[part] + factor * far;
                        let outer = Lanes::load(simd, &thirds.sums[part], group);
                        let outer = outer + factor * Lanes::splat(simd, near[part]);
                        outer.store(&mut thirds.sums[part], group);
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
