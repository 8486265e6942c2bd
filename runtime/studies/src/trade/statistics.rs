//! Times of repeated runs, and how often what is repeated.

use std::time::Duration;

/// Times of the runs of a setting, in s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Times {
    /// The shortest.
    pub min: f64,
    /// The middle one; of an even number the mean of the two in the middle.
    pub median: f64,
    /// The longest.
    pub max: f64,
    /// How many.
    pub runs: usize,
}

/// Fewer runs than this show no noise, and it is taken to be [`UNSEEN_NOISE`].
const ENOUGH: usize = 3;
const UNSEEN_NOISE: f64 = 2.0;

impl Times {
    /// From where to where the time may be: the shortest and the longest run, and more where there
    /// were few.
    pub fn range(&self) -> (f64, f64) {
        let noise = if self.runs < ENOUGH { UNSEEN_NOISE } else { 1.0 };
        (self.min / noise, self.max * noise)
    }

    /// The statistics of some times; `None` for none.
    pub fn of(times: &[Duration]) -> Option<Times> {
        let mut sorted: Vec<f64> = times.iter().map(Duration::as_secs_f64).collect();
        sorted.sort_by(f64::total_cmp);
        let runs = sorted.len();
        let (first, last) = (sorted.first()?, sorted.last()?);
        let median = 0.5 * (sorted[(runs - 1) / 2] + sorted[runs / 2]);
        Some(Times { min: *first, median, max: *last, runs })
    }
}

/// How many runs each of some settings gets, by the time of one run: up to `wanted`, at least the
/// one that was made, and together no longer than `budget`.
///
/// Each has an equal share; what quick settings leave of theirs is shared by the others.
pub fn allot(one: &[Duration], wanted: usize, budget: Duration) -> Vec<usize> {
    let mut order: Vec<usize> = (0..one.len()).collect();
    order.sort_by_key(|&index| one[index]);
    let mut left = budget;
    let mut runs = vec![1; one.len()];
    for (rank, &index) in order.iter().enumerate() {
        let share = left / (order.len() - rank) as u32;
        let more = share.as_secs_f64() / one[index].as_secs_f64().max(1e-9);
        let more = (more as usize).min(wanted.saturating_sub(1));
        runs[index] += more;
        left = left.saturating_sub(one[index] * more as u32);
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn millis(times: &[u64]) -> Vec<Duration> {
        times.iter().map(|&t| Duration::from_millis(t)).collect()
    }

    #[test]
    fn medians_are_in_the_middle() {
        assert_eq!(Times::of(&[]), None);
        let odd = Times::of(&millis(&[3000, 1000, 2000])).unwrap();
        assert_eq!(odd, Times { min: 1.0, median: 2.0, max: 3.0, runs: 3 });
        let even = Times::of(&millis(&[4000, 1000, 2000, 3000])).unwrap();
        assert_eq!((even.median, even.runs), (2.5, 4));
    }

    #[test]
    fn runs_fill_the_budget_and_no_more() {
        // Plenty: all are repeated as often as wanted.
        assert_eq!(allot(&millis(&[10, 20]), 7, Duration::from_secs(1)), [7, 7]);
        // A slow one does not take from the quick ones.
        assert_eq!(allot(&millis(&[10, 1000, 10]), 7, Duration::from_millis(300)), [7, 1, 7]);
        // Quick ones leave their share to the slow one.
        assert_eq!(allot(&millis(&[10, 100]), 7, Duration::from_millis(460)), [7, 5]);
        assert_eq!(allot(&millis(&[10, 20]), 7, Duration::ZERO), [1, 1]);
        assert_eq!(allot(&millis(&[10, 20]), 0, Duration::from_secs(9)), [1, 1]);
        let times = millis(&[3, 50, 7, 200, 11]);
        let budget = Duration::from_millis(900);
        let spent: Duration = allot(&times, 9, budget)
            .iter()
            .zip(&times)
            .map(|(runs, time)| *time * (*runs as u32 - 1))
            .sum();
        assert!(spent <= budget, "{spent:?}");
    }
}
