//! The step itself: velocities are kicked by forces, displacements drift with velocities.
//!
//! `u` and `v` are sums of very many small numbers, so both keep what rounding leaves behind. The
//! entries are cut into fixed pieces, whose sums add up in order: the same bits for any number of
//! threads.

use rayon::prelude::*;

/// Entries of a piece.
const PIECE: usize = 8192;

/// What a kick sums over the free degrees of freedom. Powers in W: of the velocity that leads to the
/// present time (`before`), and of the one that leads on (`after`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sums {
    /// `dE/du . v`.
    pub(super) internal: Sides,
    /// `f . v`.
    pub(super) external: Sides,
    /// Minus the power of the damping forces, and of what bonds dissipate.
    pub(super) damping: Sides,
    /// `1/2 m v_before . v_after` in J.
    pub(super) kinetic: f64,
    /// The largest `|v_after|` of a component in m/s; NaN counts as none.
    pub(super) fastest: f64,
}

/// A power with the velocity before the present time and with that after it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sides {
    pub(super) before: f64,
    pub(super) after: f64,
}

impl Sides {
    pub(super) fn add(&mut self, force: f64, before: f64, after: f64) {
        self.before += force * before;
        self.after += force * after;
    }

    fn join(&mut self, other: Sides) {
        self.before += other.before;
        self.after += other.after;
    }
}

impl Sums {
    fn join(mut self, other: &Sums) -> Sums {
        self.internal.join(other.internal);
        self.external.join(other.external);
        self.damping.join(other.damping);
        self.kinetic += other.kinetic;
        self.fastest = self.fastest.max(other.fastest);
        self
    }
}

/// How many pieces so many entries have.
pub(super) fn n_pieces(n: usize) -> usize {
    n.div_ceil(PIECE)
}

/// A vector whose entries are sums: what is known of them, and what rounding left behind.
#[derive(Clone, Debug)]
pub(super) struct Summed {
    pub(super) value: Vec<f64>,
    pub(super) low: Vec<f64>,
}

impl Summed {
    pub(super) fn new(value: Vec<f64>) -> Summed {
        let low = vec![0.0; value.len()];
        Summed { value, low }
    }

    /// Forgets what an entry was.
    pub(super) fn set(&mut self, entry: usize, value: f64) {
        (self.value[entry], self.low[entry]) = (value, 0.0);
    }
}

impl Summed {
    /// Adds to an entry.
    pub(super) fn add(&mut self, entry: usize, term: f64) {
        add(&mut self.value[entry], &mut self.low[entry], term);
    }
}

/// `sum + low + term` as its nearest number and the rest (Knuth's sum of two numbers).
#[inline]
fn add(sum: &mut f64, low: &mut f64, term: f64) {
    let term = term + *low;
    let whole = *sum + term;
    let part = whole - *sum;
    *low = (*sum - (whole - part)) + (term - part);
    *sum = whole;
}

/// What a kick takes; vectors have one entry per degree of freedom.
pub(super) struct Kick<'a> {
    /// `dE/du` in N.
    pub(super) internal: &'a [f64],
    /// `dR/dv` in N, where bonds dissipate.
    pub(super) viscous: Option<&'a [f64]>,
    /// Loads in N.
    pub(super) loads: &'a [f64],
    /// Of the points, in kg, and how many degrees of freedom each has.
    pub(super) masses: (&'a [f64], usize),
    pub(super) is_fixed: &'a [bool],
    /// In s.
    pub(super) step: f64,
    /// Damping `c` in 1/s: the force `-m c (part v_after + (1 - part) v_before)`.
    pub(super) damping: f64,
    pub(super) part: f64,
}

impl Kick<'_> {
    /// Takes the velocities of the free degrees of freedom on by a step. The force, without what bonds
    /// dissipate, `f - g - m c (p v_after + (1 - p) v_before)` is linear in `v_after`, which is solved for:
    /// `v_after - v_before = (dt a - c dt v_before)/(1 + p c dt)`.
    /// `mean` becomes the mean of both velocities, unless it is empty.
    pub(super) fn apply(&self, v: &mut Summed, mean: &mut [f64], pieces: &mut [Sums]) -> Sums {
        let wants_mean = !mean.is_empty();
        let parts = v.value.par_chunks_mut(PIECE).zip(v.low.par_chunks_mut(PIECE));
        if wants_mean {
            let all = parts.zip(mean.par_chunks_mut(PIECE)).zip(&mut *pieces);
            all.enumerate().for_each(|(piece, (((v, low), mean), sums))| {
                *sums = self.piece(piece * PIECE, v, low, Some(mean));
            });
        } else {
            parts.zip(&mut *pieces).enumerate().for_each(|(piece, ((v, low), sums))| {
                *sums = self.piece(piece * PIECE, v, low, None);
            });
        }
        pieces.iter().fold(Sums::default(), Sums::join)
    }

    fn piece(
        &self,
        start: usize,
        v: &mut [f64],
        low: &mut [f64],
        mut mean: Option<&mut [f64]>,
    ) -> Sums {
        let range = start..start + v.len();
        let viscous = self.viscous.map(|all| &all[range.clone()]);
        let (internal, loads) = (&self.internal[range.clone()], &self.loads[range.clone()]);
        let (is_fixed, (masses, d)) = (&self.is_fixed[range], self.masses);
        let (mut point, mut axis) = (start / d, start % d);
        let rate = self.damping * self.step;
        let divisor = 1.0 + self.part * rate;
        let mut sums = Sums::default();
        for k in 0..v.len() {
            let mass = masses[point];
            axis += 1;
            if axis == d {
                (point, axis) = (point + 1, 0);
            }
            if is_fixed[k] {
                continue;
            }
            let (force, load, before) = (internal[k], loads[k], v[k]);
            let lost = viscous.map_or(0.0, |viscous| viscous[k]);
            let push = self.step * ((load - force - lost) / mass) - rate * before;
            add(&mut v[k], &mut low[k], push / divisor);
            let after = v[k];
            sums.internal.add(force, before, after);
            sums.external.add(load, before, after);
            let damped = self.part * after + (1.0 - self.part) * before;
            sums.damping.add(mass * self.damping * damped + lost, before, after);
            sums.kinetic += 0.5 * mass * before * after;
            sums.fastest = sums.fastest.max(after.abs());
            if let Some(mean) = mean.as_deref_mut() {
                mean[k] = 0.5 * (before + after);
            }
        }
        sums
    }
}

/// `u += dt v`.
pub(super) fn drift(step: f64, v: &[f64], u: &mut Summed) {
    let parts = u.value.par_chunks_mut(PIECE).zip(u.low.par_chunks_mut(PIECE));
    parts.zip(v.par_chunks(PIECE)).for_each(|((u, low), v)| {
        for k in 0..v.len() {
            add(&mut u[k], &mut low[k], step * v[k]);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_terms_are_not_lost() {
        let (mut sum, mut low) = (1.0, 0.0);
        for _ in 0..1_000_000 {
            add(&mut sum, &mut low, 1e-20);
        }
        assert!((((sum - 1.0) + low) - 1e-14).abs() <= 1e-26, "{sum:e} + {low:e}");
    }
}
