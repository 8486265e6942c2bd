//! Sums of energies that do not lose what is small.

use pulp::Simd;

use crate::element::WIDEST;
use crate::geometry::lanes::Lanes;

/// Sums side by side, each with its rounding error carried along (Knuth's exact sum of two numbers):
/// together as good as one sum with twice the digits.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sum {
    pub(crate) sum: [f64; WIDEST],
    pub(crate) error: [f64; WIDEST],
}

impl Sum {
    /// Adds whole groups of terms, the first of a group to the first of the sums.
    #[inline(always)]
    pub(crate) fn add(&mut self, terms: &[f64]) {
        for group in terms.as_chunks::<WIDEST>().0 {
            for lane in 0..WIDEST {
                let (sum, term) = (self.sum[lane], group[lane]);
                let total = sum + term;
                let taken = total - sum;
                self.sum[lane] = total;
                self.error[lane] += (sum - (total - taken)) + (term - taken);
            }
        }
    }

    /// Adds a register of terms, to the sums of its lanes in their group of registers.
    #[inline(always)]
    pub(crate) fn add_lanes<S: Simd>(&mut self, simd: S, register: usize, term: Lanes<S>) {
        let sum = Lanes::load(simd, &self.sum, register);
        let total = sum + term;
        let taken = total - sum;
        let error = Lanes::load(simd, &self.error, register);
        total.store(&mut self.sum, register);
        (error + ((sum - (total - taken)) + (term - taken))).store(&mut self.error, register);
    }

    /// The sum of the products of two arrays.
    pub(crate) fn of_products(values: &[f64], weights: &[f64]) -> Sum {
        let mut sum = Sum::default();
        for (values, weights) in values.chunks(WIDEST).zip(weights.chunks(WIDEST)) {
            let mut terms = [0.0; WIDEST];
            for (term, (value, weight)) in terms.iter_mut().zip(values.iter().zip(weights)) {
                *term = weight * value;
            }
            sum.add(&terms);
        }
        sum
    }

    /// Adds another sum, lane by lane.
    pub(crate) fn join(&mut self, other: &Sum) {
        self.add(&other.sum);
        self.add(&other.error);
    }

    /// The sum of all lanes.
    pub(crate) fn value(&self) -> f64 {
        let mut whole = Sum::default();
        for part in self.sum.iter().chain(&self.error) {
            let mut group = [0.0; WIDEST];
            group[0] = *part;
            whole.add(&group);
        }
        whole.sum[0] + whole.error[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_small_is_not_lost() {
        let mut sum = Sum::default();
        let mut terms = [1.0; 2 * WIDEST];
        terms[0] = 1e100;
        terms[WIDEST] = -1e100;
        sum.add(&terms);
        assert_eq!(sum.value(), (2 * WIDEST - 2) as f64);
        let mut other = Sum::default();
        let tiny = libm::ldexp(1.0, -80);
        other.add(&[tiny; WIDEST]);
        sum.join(&other);
        sum.add(&[-(2.0 * WIDEST as f64 - 2.0) / WIDEST as f64; WIDEST]);
        assert_eq!(sum.value(), WIDEST as f64 * tiny);
    }
}
