//! How far to go along a Newton step.
//!
//! The full step is taken whenever it is acceptable: when the residual falls, or when the step goes
//! downhill and the potential falls as the slope promises (Armijo). Otherwise the step is
//! shortened, by a parabola through what is known, to between a tenth and a half.
//!
//! Changes of the potential below its rounding noise say nothing; there the slope decides, and no
//! step fails because the potential seems to rise.
//!
//! With an indefinite tangent the Newton step may lead uphill, but it always lowers the residual at
//! first: then the residual alone decides.

/// The part of the promised decrease that is enough.
const SUFFICIENT: f64 = 1e-4;

/// Shorter steps are not tried.
const SHORTEST: f64 = 1.0 / 1024.0;

/// A state along the Newton step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Trial {
    /// `E - f.u` in J; not a number where that is no potential of the forces, then residuals alone decide.
    pub(super) potential: f64,
    /// Derivative of the potential along the full Newton step, in J.
    pub(super) slope: f64,
    /// 2-norm of the free residual in N.
    pub(super) residual: f64,
}

/// A search along one Newton step.
#[derive(Debug)]
pub(super) struct LineSearch {
    start: Trial,
    /// Differences of potentials below this are rounding.
    noise: f64,
    /// Residuals below this are rounding.
    floor: f64,
    next: f64,
    any_finite: bool,
}

impl LineSearch {
    pub(super) fn new(start: Trial, noise: f64, floor: f64) -> LineSearch {
        LineSearch { start, noise, floor, next: 1.0, any_finite: false }
    }

    /// Tries no more than this part of the step.
    pub(super) fn no_further_than(&mut self, part: f64) {
        self.next = self.next.min(part);
    }

    /// The part of the step to try next, 1 first; `None` when the search has failed.
    pub(super) fn next_length(&self) -> Option<f64> {
        (self.next >= SHORTEST).then_some(self.next)
    }

    /// Whether no state along the step had a finite energy.
    pub(super) fn all_not_finite(&self) -> bool {
        !self.any_finite
    }

    /// Judges the state at the length last given; `None` stands for an energy that is not finite.
    pub(super) fn accepts(&mut self, trial: Option<Trial>) -> bool {
        let length = self.next;
        let Some(trial) = trial else {
            self.next = 0.5 * length;
            return false;
        };
        self.any_finite = true;
        if self.residual_falls(length, trial) || self.potential_falls(length, trial) {
            return true;
        }
        self.next = self.shortened(length, trial);
        false
    }

    fn residual_falls(&self, length: f64, trial: Trial) -> bool {
        let both_rounding = self.start.residual <= self.floor && trial.residual <= self.floor;
        trial.residual <= (1.0 - SUFFICIENT * length) * self.start.residual || both_rounding
    }

    fn potential_falls(&self, length: f64, trial: Trial) -> bool {
        if self.start.slope >= 0.0 {
            return false;
        }
        let change = trial.potential - self.start.potential;
        if change.abs() <= self.noise {
            return trial.slope.abs() <= 0.9 * self.start.slope.abs();
        }
        change <= SUFFICIENT * length * self.start.slope
    }

    /// The minimum of the parabola through the start (value and slope) and the trial.
    fn shortened(&self, length: f64, trial: Trial) -> f64 {
        let change = trial.potential - self.start.potential;
        let (slope, change) = if self.start.slope < 0.0 && change.abs() > self.noise {
            (self.start.slope, change)
        } else {
            // Half the squared residual: its derivative along the Newton step is -residual^2.
            let ratio = trial.residual / self.start.residual;
            (-1.0, 0.5 * (ratio * ratio - 1.0))
        };
        let minimum = -slope * length * length / (2.0 * (change - slope * length));
        // Not a number is not above a tenth.
        if minimum > 0.1 * length { minimum.min(0.5 * length) } else { 0.1 * length }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(potential: f64, slope: f64, residual: f64) -> Trial {
        Trial { potential, slope, residual }
    }

    #[test]
    fn full_steps_are_taken_when_the_residual_falls_or_the_potential() {
        let start = trial(0.0, -1.0, 1.0);
        assert!(LineSearch::new(start, 0.0, 0.0).accepts(Some(trial(5.0, 0.0, 0.99))));
        assert!(LineSearch::new(start, 0.0, 0.0).accepts(Some(trial(-0.5, 0.0, 9.0))));
        assert!(!LineSearch::new(start, 0.0, 0.0).accepts(Some(trial(-0.5e-4, 0.0, 9.0))));
        let uphill = trial(0.0, 1.0, 1.0);
        assert!(!LineSearch::new(uphill, 0.0, 0.0).accepts(Some(trial(-0.5, 0.0, 1.0))));
        assert!(LineSearch::new(uphill, 0.0, 0.0).accepts(Some(trial(0.5, 0.0, 0.9))));
    }

    #[test]
    fn noise_in_the_potential_rejects_nothing() {
        let start = trial(1.0, -1e-17, 1e-12);
        let rising = trial(1.0 + 2e-15, 1e-18, 1.1e-12);
        assert!(LineSearch::new(start, 1e-14, 0.0).accepts(Some(rising)));
        assert!(!LineSearch::new(start, 1e-16, 0.0).accepts(Some(rising)));
        // At the floor of the residual nothing is left to judge by.
        let at_floor = trial(1.0 + 2e-15, 1e-16, 1.1e-12);
        assert!(!LineSearch::new(start, 1e-14, 0.0).accepts(Some(at_floor)));
        assert!(LineSearch::new(start, 1e-14, 2e-12).accepts(Some(at_floor)));
    }

    #[test]
    fn steps_are_shortened_by_the_parabola_within_bounds() {
        // potential(s) = -s + 2 s^2 has its minimum at 1/4.
        let mut search = LineSearch::new(trial(0.0, -1.0, 1.0), 0.0, 0.0);
        assert!(!search.accepts(Some(trial(1.0, 3.0, 4.0))));
        assert_eq!(search.next_length(), Some(0.25));
        assert!(search.accepts(Some(trial(-0.125, 0.0, 4.0))));
        let mut steep = LineSearch::new(trial(0.0, -1.0, 1.0), 0.0, 0.0);
        steep.accepts(Some(trial(1e9, 3.0, 1e9)));
        assert_eq!(steep.next_length(), Some(0.1));
    }

    #[test]
    fn the_search_ends() {
        let mut search = LineSearch::new(trial(0.0, -1.0, 1.0), 0.0, 0.0);
        let mut tried = 0;
        while search.next_length().is_some() {
            assert!(!search.accepts(None));
            tried += 1;
        }
        assert_eq!((tried, search.all_not_finite()), (11, true));
        let mut search = LineSearch::new(trial(0.0, 1.0, 1.0), 0.0, 0.0);
        while search.next_length().is_some() {
            assert!(!search.accepts(Some(trial(0.0, 1.0, f64::NAN))));
        }
        assert!(!search.all_not_finite());
    }
}
