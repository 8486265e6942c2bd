//! Parameters that vary from point to point, and maybe in time.
//!
//! A point has the values of the parameters of its material. What belongs to a point alone takes them; an
//! interaction takes the mean of its corners, of those that have a value: where materials meet, the
//! parameters of one are not those of the other.

use std::ops::Range;
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
        Fields { n_points, first, typical, values, is_steady }
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
