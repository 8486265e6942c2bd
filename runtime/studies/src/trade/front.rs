//! Who is beaten: settings by time and error, with the noise of both.

use super::statistics::Times;

/// Where a setting stands among the others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Standing {
    /// No other is as fast with as small an error, by medians.
    Front,
    /// Another is, but within noise.
    Near,
    /// Another (its index) is faster in all its runs, and its error is no larger or below rounding.
    Dominated(usize),
}

/// Time and error of a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dot {
    /// Its times.
    pub times: Times,
    /// Its error, relative, 0 for the same bits.
    pub error: f64,
}

impl Dot {
    /// The error, or `level` where it is smaller: below there is only luck.
    fn effective(&self, level: f64) -> f64 {
        self.error.max(level)
    }

    /// Whether `other` is faster beyond noise and no less accurate.
    fn is_dominated_by(&self, other: &Dot, level: f64) -> bool {
        other.times.range().1 < self.times.range().0
            && other.effective(level) <= self.effective(level)
    }

    /// Whether `other` is as good in both by medians, and better in one.
    fn is_behind(&self, other: &Dot, level: f64) -> bool {
        let (here, there) = (self.effective(level), other.effective(level));
        let (time, faster) = (self.times.median, other.times.median);
        faster <= time && there <= here && (faster < time || there < here)
    }
}

/// Where each setting stands; `level` is the error below which there is only rounding.
pub fn standings(dots: &[Dot], level: f64) -> Vec<Standing> {
    let standing = |dot: &Dot| {
        let beating = dots.iter().enumerate().filter(|(_, o)| dot.is_dominated_by(o, level));
        // The most accurate of those that beat it, of these the fastest.
        let order = |(_, p): &(usize, &Dot), (_, q): &(usize, &Dot)| {
            let errors = p.effective(level).total_cmp(&q.effective(level));
            errors.then(p.times.median.total_cmp(&q.times.median))
        };
        match beating.min_by(order) {
            Some((index, _)) => Standing::Dominated(index),
            None if dots.iter().any(|other| dot.is_behind(other, level)) => Standing::Near,
            None => Standing::Front,
        }
    };
    dots.iter().map(standing).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn dot(min: f64, median: f64, max: f64, error: f64) -> Dot {
        Dot { times: Times { min, median, max, runs: 7 }, error }
    }

    #[test]
    fn noise_dominates_nobody() {
        // Overlapping times: the second is slower and worse, but not beyond noise.
        let close = [dot(1.0, 1.1, 1.3, 1e-9), dot(1.2, 1.4, 1.6, 1e-6)];
        assert_eq!(standings(&close, 1e-15), [Standing::Front, Standing::Near]);
        // The same apart.
        let apart = [dot(1.0, 1.1, 1.19, 1e-9), dot(1.2, 1.4, 1.6, 1e-6)];
        assert_eq!(standings(&apart, 1e-15), [Standing::Front, Standing::Dominated(0)]);
        // Slower, and its errors are smaller by rounding alone.
        let rounding = [dot(1.0, 1.0, 1.0, 3e-16), dot(2.0, 2.0, 2.0, 0.0)];
        assert_eq!(standings(&rounding, 1e-15), [Standing::Front, Standing::Dominated(0)]);
        // Slower, and really more accurate.
        assert_eq!(standings(&rounding, 1e-16), [Standing::Front, Standing::Front]);
        // Equal dots do not beat each other.
        let twins = [dot(1.0, 1.0, 1.0, 1e-9); 2];
        assert_eq!(standings(&twins, 1e-15), [Standing::Front, Standing::Front]);
        assert_eq!(standings(&[], 1e-15), []);
    }

    fn any_dot() -> impl Strategy<Value = Dot> {
        // Few values, so that ties are frequent.
        (1..6u32, 0..4u32, 0..4u32, 0..6i32).prop_map(|(min, up, further, exponent)| {
            let [min, up, further] = [min, up, further].map(f64::from);
            let error = if exponent == 0 { 0.0 } else { libm::exp10(-3.0 * f64::from(exponent)) };
            dot(min, min + up, min + up + further, error)
        })
    }

    proptest! {
        #[test]
        fn the_front_answers_for_everyone(
            dots in proptest::collection::vec(any_dot(), 1..12),
            level in prop_oneof![Just(0.0), Just(1e-10)],
        ) {
            let standings = standings(&dots, level);
            let front: Vec<&Dot> = dots
                .iter()
                .zip(&standings)
                .filter(|(_, standing)| **standing == Standing::Front)
                .map(|(dot, _)| dot)
                .collect();
            prop_assert!(!front.is_empty());
            for (dot, standing) in dots.iter().zip(&standings) {
                let error = |dot: &Dot| dot.error.max(level);
                let covers = |f: &&&Dot| f.times.median <= dot.times.median && error(f) <= error(dot);
                let covered = front.iter().any(|f| covers(&f));
                // On the front or behind someone who is on it.
                prop_assert!(covered);
                if *standing == Standing::Front {
                    let ahead = front.iter().any(|f| {
                        f.times.median <= dot.times.median && error(f) <= error(dot)
                            && (f.times.median, error(f)) != (dot.times.median, error(dot))
                    });
                    prop_assert!(!ahead);
                }
                if let Standing::Dominated(by) = standing {
                    prop_assert!(dots[*by].times.max < dot.times.min);
                    prop_assert!(error(&dots[*by]) <= error(dot));
                }
            }
        }
    }
}
