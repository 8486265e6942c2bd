//! How far a load step goes.

/// The smallest part of a nominal increment is one of this many.
pub(super) const TICKS: u32 = 1024;

/// A step of at most this many iterations is easy.
const EASY_ITERATIONS: usize = 6;

/// The length of the next attempts in ticks, and the easy steps since it last changed.
pub(super) struct Increment {
    pub(super) ticks: u32,
    easy: usize,
}

impl Increment {
    pub(super) fn nominal() -> Increment {
        Increment { ticks: TICKS, easy: 0 }
    }

    /// `false` when it cannot be halved any more.
    pub(super) fn halve(&mut self, tried: u32) -> bool {
        self.ticks = tried / 2;
        self.easy = 0;
        self.ticks > 0
    }

    pub(super) fn note_success(&mut self, iterations: usize) {
        self.easy = if iterations <= EASY_ITERATIONS { self.easy + 1 } else { 0 };
        if self.easy >= 2 && self.ticks < TICKS {
            self.ticks *= 2;
            self.easy = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn increments_halve_to_a_limit_and_double_after_two_easy_steps() {
        let mut increment = Increment { ticks: TICKS, easy: 0 };
        for left in (0..10).rev() {
            assert!(increment.halve(increment.ticks));
            assert_eq!(increment.ticks, 1 << left);
        }
        assert!(!increment.halve(increment.ticks));
        let mut increment = Increment { ticks: TICKS / 4, easy: 0 };
        let mut sizes = Vec::new();
        for iterations in [3, 3, 6, 7, 2, 2, 1, 1] {
            increment.note_success(iterations);
            sizes.push(increment.ticks * 4 / TICKS);
        }
        assert_eq!(sizes, [1, 2, 2, 2, 2, 4, 4, 4]);
    }
}
