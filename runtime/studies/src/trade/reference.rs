//! What errors are measured against, and below which size they are only rounding.

use std::time::{Duration, Instant};

use super::axes::reference_overrides;
use super::quantity::worst;
use super::{Quantity, ROUNDOFF, ReadCase, TradeError};
use crate::simulation::{Attempt, Equilibrium, solve};

/// Tolerances that are tried, the tightest first.
const TOLERANCES: [&str; 7] = ["1e-15", "1e-14", "1e-13", "1e-12", "1e-11", "1e-10", "1e-8"];

/// Runs that differ from the reference by rounding alone: the same tolerance on another way.
const WITNESSES: [&str; 2] = ["solver.linear=ldlt", "solver.start=tangent"];

/// Differences of fewer roundings are rounding in any scene: forces are sums of some 100 terms.
const LEAST_LEVEL: f64 = 32.0 * ROUNDOFF;

/// How far two runs of rounding errors differ, over how far the witnesses did.
const SPREAD: f64 = 2.0;

/// The run that the others are compared with.
#[derive(Clone, Debug)]
pub struct Reference {
    /// What was set in the scene for it.
    pub overrides: Vec<String>,
    /// Its tolerance, the tightest that converged.
    pub tolerance: &'static str,
    /// Its end.
    pub equilibrium: Equilibrium,
    /// What it took in s.
    pub seconds: f64,
    /// The error below which there is only rounding: twice the largest distance of equally exact
    /// runs from the reference, at least 32 units of 2^-53.
    pub level: f64,
    /// These runs, and how far each was.
    pub witnesses: Vec<(String, f64)>,
}

impl Reference {
    /// The relative error of the displacements that rounding implies at most: the condition of the
    /// tangent times 2^-53, where there were factors to estimate it from.
    pub fn displacement_error(&self) -> Option<f64> {
        Some(self.equilibrium.condition? * ROUNDOFF)
    }
}

/// Solves the scene as exactly as it can be: the reference words of all axes, and the tightest
/// tolerance that converges within `limit`.
///
/// # Errors
/// A scene that cannot be read or started, or that no tolerance converges for.
pub fn reference(
    read: &ReadCase<'_>,
    quantities: &[Quantity],
    limit: Duration,
    progress: &mut dyn FnMut(&str),
) -> Result<Reference, TradeError> {
    let fixed = reference_overrides(&read(&[])?.scene.resolved_toml());
    let started = Instant::now();
    let mut reason = String::new();
    for tolerance in TOLERANCES {
        let overrides = [fixed.as_slice(), &[format!("solver.tolerance={tolerance}")]].concat();
        progress(&format!("reference with tolerance {tolerance}"));
        let case = read(&overrides)?;
        let start = Instant::now();
        match solve(&case, limit.saturating_sub(started.elapsed()))? {
            Attempt::Reached(equilibrium) => {
                let seconds = start.elapsed().as_secs_f64();
                let mut reference = Reference {
                    overrides,
                    tolerance,
                    equilibrium: *equilibrium,
                    seconds,
                    level: LEAST_LEVEL,
                    witnesses: Vec::new(),
                };
                let left = limit.saturating_sub(started.elapsed());
                reference.add_witnesses(read, quantities, left, progress);
                return Ok(reference);
            }
            Attempt::NotConverged(message) => reason = message,
            Attempt::OutOfTime(t) => {
                reason = format!("the time was up at t = {t}");
                break;
            }
        }
    }
    Err(TradeError::NoReference { reason })
}

impl Reference {
    fn add_witnesses(
        &mut self,
        read: &ReadCase<'_>,
        quantities: &[Quantity],
        limit: Duration,
        progress: &mut dyn FnMut(&str),
    ) {
        let start = Instant::now();
        for witness in WITNESSES {
            let left = limit.saturating_sub(start.elapsed());
            if left.as_secs_f64() < self.seconds {
                continue;
            }
            progress(&format!("reference once more with {witness}"));
            let overrides = [self.overrides.as_slice(), &[witness.to_string()]].concat();
            // A witness that cannot speak is none: the level rests on the others.
            let Ok(case) = read(&overrides) else { continue };
            let Ok(Attempt::Reached(found)) = solve(&case, left) else { continue };
            let compared: Vec<Quantity> =
                quantities.iter().filter(|q| **q != Quantity::Residual).cloned().collect();
            let errors: Vec<f64> =
                compared.iter().map(|q| q.error(&found, &self.equilibrium)).collect();
            let distance = worst(&compared, &errors);
            if distance.is_finite() {
                self.level = self.level.max(SPREAD * distance);
                self.witnesses.push((witness.to_string(), distance));
            }
        }
    }
}
