//! Where the time of a solve goes.

use std::time::{Duration, Instant};

/// Wall time by phase.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhaseTimes {
    /// Energies, gradients and tangents at the points that full Newton steps reach.
    pub assembly: Duration,
    /// Linear systems, and the factorisation that judges the tangent.
    pub linear: Duration,
    /// Energies and gradients of shortened steps.
    pub line_search: Duration,
}

impl PhaseTimes {
    /// The time of all phases.
    pub fn total(&self) -> Duration {
        self.assembly + self.linear + self.line_search
    }

    /// Adds the times of another span.
    pub fn add(&mut self, other: &PhaseTimes) {
        self.assembly += other.assembly;
        self.linear += other.linear;
        self.line_search += other.line_search;
    }
}

/// Runs `work` and adds its wall time to `phase`.
pub(crate) fn timed<T>(phase: &mut Duration, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    *phase += start.elapsed();
    result
}

/// How often the derivatives of the energy were evaluated and systems solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Energy with gradient.
    pub gradients: usize,
    /// Energy with gradient and tangent.
    pub tangents: usize,
    /// Linear systems.
    pub linear_solves: usize,
    /// Factorisations tried, those that judge the tangent included.
    pub factorizations: usize,
}
