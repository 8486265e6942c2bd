//! Energies of affine laws on lattices: what repeats is known from numbers at rest.
//!
//! psi of an affine law ([`Law::is_affine`]) is a polynomial of second degree in how much a measure has
//! grown. Its coefficients, times what all weights have in common, are those of every interaction that
//! looks the same at rest.

use pulp::Simd;

use crate::element::WIDEST;
use crate::geometry::Scalar;
use crate::geometry::lanes::Lanes;
use crate::kernel::{Batch, Law, Order, Outputs};
use crate::weights::CliqueWeights;

/// A measure is a root, and the law by itself: `t = m - M`, `s = m^2/2`.
pub(super) const ROOT: u8 = 0;
/// A measure is a root, and the law by its square: `t = m^2 - M^2`, `s = m^2/2`.
pub(super) const SQUARE: u8 = 1;
/// A measure has a sign: `t = m - M`, `s = m`.
pub(super) const SIGNED: u8 = 2;

/// The energy of interactions that look the same at rest, `rest + t*(linear + bent*t)` in J, where `t`
/// is how much the measure, or its square, has grown.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Quadratic {
    /// The measure at rest.
    pub(crate) reference: f64,
    pub(crate) rest: f64,
    pub(crate) linear: f64,
    pub(crate) bent: f64,
}

impl Quadratic {
    /// Adds the energy of another law of the same interactions.
    pub(super) fn add(&mut self, other: &Quadratic) {
        self.rest += other.rest;
        self.linear += other.linear;
        self.bent += other.bent;
    }
}

/// A law of which passes need no kernel.
#[derive(Clone, Copy)]
pub(crate) struct AffineLaw<'a> {
    law: &'a dyn Law,
    /// Whether it is by the square of the measure.
    pub(super) by_square: bool,
    /// Whether its fields are the direction of a bond at rest.
    by_direction: bool,
}

impl<'a> AffineLaw<'a> {
    /// By the square of its measure rather than by its root; nothing where it is not affine. Fields may be the
    /// direction of a bond at rest, which `by_direction` says, or one of which it is a multiple.
    pub(super) fn of(law: &'a dyn Law, by_direction: bool) -> Option<AffineLaw<'a>> {
        let serves = |law: &&dyn Law| {
            let is_known = law.fields().is_empty() || by_direction || law.is_multiple_of_field();
            law.is_affine() && is_known
        };
        let square = law.squared().filter(serves);
        let by_square = square.is_some();
        let law = square.or(Some(law).filter(serves))?;
        Some(AffineLaw { law, by_square, by_direction })
    }

    /// By its measure; nothing where it is not affine in that.
    pub(crate) fn by_measure(law: &'a dyn Law) -> Option<AffineLaw<'a>> {
        let serves = law.is_affine() && law.fields().is_empty();
        serves.then_some(AffineLaw { law, by_square: false, by_direction: false })
    }

    /// The energy of interactions of one measure at rest, times what weights have in common, for one unit
    /// of its field where it has one; nothing where psi or a derivative is not finite. `direction` is that of a
    /// bond at rest, for laws that ask for it.
    pub(crate) fn at(self, reference: f64, direction: &[f64], weight: f64) -> Option<Quadratic> {
        let (at, [mut psi, mut dpsi, mut d2psi]) = ([reference], [[0.0]; 3]);
        let fields = match (self.law.fields().is_empty(), self.by_direction) {
            (true, _) => &[][..],
            (false, true) => direction,
            (false, false) => &[1.0],
        };
        let batch = Batch { measure: &at, reference: &at, change: &[0.0], fields };
        let out = Outputs { psi: &mut psi, dpsi: &mut dpsi, d2psi: &mut d2psi };
        self.law.evaluate(batch, Order::Tangent, out);
        // By `q = m^2/M`, of which `m^2 - M^2` is `M` times the change.
        let scale = if self.by_square { 1.0 / reference } else { 1.0 };
        let rest = weight * psi[0];
        let linear = weight * (dpsi[0] * scale);
        let bent = weight * (0.5 * d2psi[0] * scale * scale);
        let all = [rest, linear, bent];
        all.iter().all(|x| x.is_finite()).then_some(Quadratic { reference, rest, linear, bent })
    }
}

/// The same in every lane of a register.
pub(super) struct Quadratics<S: Simd> {
    pub(super) reference: Lanes<S>,
    rest: Lanes<S>,
    linear: Lanes<S>,
    bent: Lanes<S>,
}

/// How much a measure or its square has grown, and the derivatives of the energy by `s`.
pub(super) struct Changed<S: Simd> {
    t: Lanes<S>,
    pub(super) first: Lanes<S>,
    pub(super) second: Lanes<S>,
}

impl<S: Simd> Quadratics<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, of: &Quadratic) -> Quadratics<S> {
        let all = |x: f64| Lanes::splat(simd, x);
        let Quadratic { reference, rest, linear, bent } = *of;
        Quadratics {
            reference: all(reference),
            rest: all(rest),
            linear: all(linear),
            bent: all(bent),
        }
    }

    /// From the square of the measure and from how much it has grown: the square, or a measure with a
    /// sign. Second derivatives are right only where they are wanted.
    #[inline(always)]
    pub(super) fn changed<const WAY: u8, const TWICE: bool>(
        &self,
        square: Lanes<S>,
        grown: Lanes<S>,
    ) -> Changed<S> {
        let twice = self.bent + self.bent;
        if WAY == SIGNED {
            return Changed { t: grown, first: self.linear + twice * grown, second: twice };
        }
        if WAY == SQUARE {
            let slope = self.linear + twice * grown;
            let bend = twice + twice;
            return Changed { t: grown, first: slope + slope, second: bend + bend };
        }
        // One division for 1/m and 1/(m + M).
        let measure = square.sqrt();
        let sum = measure + self.reference;
        let over = measure.alike(1.0) / (measure * sum);
        let (t, over) = (grown * (measure * over), sum * over);
        let first = (self.linear + twice * t) * over;
        let second = if TWICE { (twice - first) * (over * over) } else { twice };
        Changed { t, first, second }
    }

    /// The energy.
    #[inline(always)]
    pub(super) fn energy(&self, changed: &Changed<S>) -> Lanes<S> {
        self.rest + changed.t * (self.linear + self.bent * changed.t)
    }
}

/// What points have in the weights of their interactions.
pub(super) struct Shares {
    /// For each point, with room for a register before and behind.
    padded: Vec<f64>,
    /// Whether they are added, else multiplied.
    pub(super) are_added: bool,
}

impl Shares {
    /// What the weights of interactions of so many points have in common, and what is left of them.
    pub(super) fn of(weights: &CliqueWeights, n_points: usize) -> (f64, Option<Shares>) {
        let (factor, shares, are_added) = match weights {
            CliqueWeights::Unit => return (1.0, None),
            CliqueWeights::Sum { factor, shares } => (*factor, shares, true),
            CliqueWeights::Product { factor, shares } => (*factor, shares, false),
        };
        let first = shares.first().copied().unwrap_or(0.0);
        if shares.iter().all(|share| *share == first) {
            let join = |all: f64, _| if are_added { all + first } else { all * first };
            return (factor * (1..n_points).fold(first, join), None);
        }
        let room = [0.0; WIDEST];
        (factor, Some(Shares { padded: [&room, &shares[..], &room].concat(), are_added }))
    }

    /// Numbers of points that are added.
    pub(super) fn added(numbers: impl Iterator<Item = f64>) -> Shares {
        let room = [0.0; WIDEST];
        Shares { padded: room.into_iter().chain(numbers).chain(room).collect(), are_added: true }
    }

    /// The share of a point.
    pub(super) fn at(&self, point: usize) -> f64 {
        self.padded[WIDEST + point]
    }

    /// The shares of points from one on, which may lie a little before the first.
    #[inline(always)]
    pub(super) fn from(&self, point: isize) -> &[f64] {
        &self.padded[point.wrapping_add(WIDEST as isize) as usize..]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_split_into_what_is_common_and_what_is_not() {
        let same = CliqueWeights::Product { factor: 3.0, shares: vec![2.0; 4] };
        let (common, shares) = Shares::of(&same, 2);
        assert!(common == 12.0 && shares.is_none());
        assert_eq!(Shares::of(&same, 3).0, 24.0);
        let same = CliqueWeights::Sum { factor: 3.0, shares: vec![2.0; 4] };
        assert_eq!(Shares::of(&same, 3).0, 18.0);
        let other = CliqueWeights::Sum { factor: 3.0, shares: vec![2.0, 1.0] };
        let (common, shares) = Shares::of(&other, 2);
        assert_eq!(common, 3.0);
        assert_eq!(shares.unwrap().from(1)[..2], [1.0, 0.0]);
    }
}
