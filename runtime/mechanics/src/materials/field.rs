//! Parameters that vary from point to point, and maybe in time.
//!
//! A point has the values of the parameters of its material. What belongs to a point alone takes them; an
//! interaction takes the mean of its corners, of those that have a value: where materials meet, the
//! parameters of one are not those of the other. A field may also be a state: then each bond has a value of
//! its own, which it remembers.

use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// The fields of all laws, one after the other, at all points.
#[derive(Debug)]
pub struct Fields {
    n_points: usize,
    /// Where the fields of each law start among all, and the end.
    first: Vec<usize>,
    typical: Vec<f64>,
    /// Bits of numbers, field by field: they may be set anew between passes.
    values: Vec<AtomicU64>,
    is_steady: bool,
    /// Which of them are states.
    is_state: Vec<bool>,
    /// Which of them are the time step in which laws follow their states, at most one of each law: it is
    /// below 0 where states are held.
    time_steps: Vec<usize>,
    /// What bonds have of each that is one, by their numbers; once there are bonds.
    of_bonds: OnceLock<Vec<Option<Box<[AtomicU64]>>>>,
}

impl Fields {
    /// `of_laws` has typical values of the fields of each law, in SI units; points have none yet. They
    /// are steady unless they are set again after energies were made.
    pub fn new(n_points: usize, of_laws: &[Vec<f64>], is_steady: bool) -> Fields {
        let mut first = vec![0];
        first.extend(of_laws.iter().scan(0, |end, own| {
            *end += own.len();
            Some(*end)
        }));
        let typical = of_laws.concat();
        let nothing = || AtomicU64::new(f64::NAN.to_bits());
        let values = (0..n_points * typical.len()).map(|_| nothing()).collect();
        let is_state = vec![false; typical.len()];
        let (time_steps, of_bonds) = (Vec::new(), OnceLock::new());
        Fields { n_points, first, typical, values, is_steady, is_state, time_steps, of_bonds }
    }

    /// The same where some fields are states: each bond has a value of its own.
    pub fn with_states(self, is_state: Vec<bool>) -> Fields {
        assert_eq!(is_state.len(), self.len(), "one for each field");
        Fields { is_state, ..self }
    }

    /// The same where some fields, by their numbers, are the time step in s in which laws follow their states;
    /// below 0 laws hold them. They are not steady.
    pub fn with_time_steps(self, time_steps: Vec<usize>) -> Fields {
        let is_steady = self.is_steady && time_steps.is_empty();
        Fields { is_steady, time_steps, ..self }
    }

    /// The fields that are the time step, by their numbers.
    pub(crate) fn time_steps(&self) -> &[usize] {
        &self.time_steps
    }

    /// Gives all points a time step in s; below 0 for laws that hold their states.
    pub(crate) fn set_time_step(&self, dt: f64) {
        for field in &self.time_steps {
            (0..self.n_points).for_each(|point| self.set(*field, point, dt));
        }
    }

    /// Gives bonds, by their numbers with these ends, the states that they begin with: the mean of what
    /// their points have. Nothing happens where they have some.
    pub(crate) fn begin_states(&self, ends: impl Iterator<Item = [usize; 2]> + Clone) {
        let begin = |field: usize| {
            let own = ends.clone().map(|ends| self.mean(field, ends.into_iter()));
            self.is_state[field].then(|| own.map(|value| AtomicU64::new(value.to_bits())).collect())
        };
        self.of_bonds.get_or_init(|| (0..self.len()).map(begin).collect());
    }

    /// Whether some of these fields are states.
    #[inline(always)]
    pub(crate) fn have_states(&self, fields: Range<usize>) -> bool {
        self.is_state[fields].contains(&true)
    }

    fn states(&self, field: usize) -> Option<&[AtomicU64]> {
        self.of_bonds.get()?[field].as_deref()
    }

    /// The numbers of the fields that are states.
    pub(crate) fn numbers_of_states(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.len()).filter(|field| self.is_state[*field])
    }

    /// What a bond remembers as a field that is a state; nothing before bonds have begun.
    pub(crate) fn state(&self, field: usize, bond: usize) -> Option<f64> {
        let value = &self.states(field)?[bond];
        Some(f64::from_bits(value.load(Ordering::Relaxed)))
    }

    /// Gives a bond another state.
    pub(crate) fn set_state(&self, field: usize, bond: usize, value: f64) {
        if let Some(states) = self.states(field) {
            states[bond].store(value.to_bits(), Ordering::Relaxed);
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.typical.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.typical.is_empty()
    }

    /// Whether they stay as they are.
    pub fn is_steady(&self) -> bool {
        self.is_steady
    }

    /// The numbers of the fields of a law.
    pub fn of_law(&self, law: usize) -> Range<usize> {
        let end = |law: usize| self.first.get(law).copied().unwrap_or(self.len());
        end(law)..end(law + 1)
    }

    /// Gives a point the value of a field, in SI units. What was worked out before is that of the values
    /// before.
    pub fn set(&self, field: usize, point: usize, value: f64) {
        self.values[field * self.n_points + point].store(value.to_bits(), Ordering::Relaxed);
    }

    /// The value of a field at a point; not a number where the point has none.
    #[inline(always)]
    pub fn at(&self, field: usize, point: usize) -> f64 {
        f64::from_bits(self.values[field * self.n_points + point].load(Ordering::Relaxed))
    }

    /// What an interaction of some points takes: the mean of those that have a value, a typical one where
    /// none has.
    #[inline(always)]
    pub fn mean(&self, field: usize, points: impl Iterator<Item = usize> + Clone) -> f64 {
        let all = points.clone().map(|point| self.at(field, point));
        let (sum, n) = all.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
        if sum.is_nan() { self.mean_of_some(field, points) } else { sum / n }
    }

    #[cold]
    fn mean_of_some(&self, field: usize, points: impl Iterator<Item = usize>) -> f64 {
        let some = points.map(|point| self.at(field, point)).filter(|value| !value.is_nan());
        let (sum, n) = some.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
        if n == 0.0 { self.typical[field] } else { sum / n }
    }

    /// Adds to `out` what places take of some fields: field by field, of each all places in their order.
    #[inline(always)]
    pub(crate) fn add<I: Iterator<Item = usize> + Clone>(
        &self,
        fields: Range<usize>,
        n: usize,
        points: impl Fn(usize) -> I,
        out: &mut Vec<f64>,
    ) {
        for field in fields {
            out.extend((0..n).map(|place| self.mean(field, points(place))));
        }
    }

    /// The same of bonds, which have states of their own: their points and their numbers.
    #[inline(always)]
    pub(crate) fn add_of_bonds(
        &self,
        fields: Range<usize>,
        n: usize,
        bond: impl Fn(usize) -> ([usize; 2], usize),
        out: &mut Vec<f64>,
    ) {
        for field in fields {
            match self.states(field) {
                Some(states) => out
                    .extend((0..n).map(|place| {
                        f64::from_bits(states[bond(place).1].load(Ordering::Relaxed))
                    })),
                None => out.extend((0..n).map(|k| self.mean(field, bond(k).0.into_iter()))),
            }
        }
    }

    /// Adds typical values of all fields at so many places.
    pub(crate) fn add_typical(&self, n: usize, out: &mut Vec<f64>) {
        for value in &self.typical {
            out.resize(out.len() + n, *value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interactions_take_the_mean_of_the_corners_that_have_a_value() {
        let fields = Fields::new(3, &[vec![7.0], vec![], vec![8.0, 9.0]], true);
        assert_eq!([0, 1, 2].map(|law| fields.of_law(law)), [0..1, 1..1, 1..3]);
        for (point, value) in [(0, 1.0), (1, 3.0)] {
            fields.set(0, point, value);
        }
        fields.set(2, 2, 5.0);
        let mean = |field, points: &[usize]| fields.mean(field, points.iter().copied());
        assert_eq!(mean(0, &[0, 1]), 2.0);
        assert_eq!(mean(0, &[1, 2]), 3.0);
        assert_eq!(mean(0, &[2]), 7.0);
        assert_eq!(mean(2, &[0, 1, 2]), 5.0);
        let mut out = vec![-1.0];
        fields.add(0..3, 2, |place| [place, place + 1].into_iter(), &mut out);
        assert_eq!(out, [-1.0, 2.0, 3.0, 8.0, 8.0, 9.0, 5.0]);
    }
}
