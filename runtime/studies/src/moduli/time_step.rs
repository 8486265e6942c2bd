//! The largest stable step of central differences.

use piola_mechanics::energy::{Energy, NonFinite};
use piola_solvers::constraint::Constraints;
use piola_solvers::motion::{CriticalStep, Precision};
use serde::Serialize;

/// The largest stable step of central differences at rest, with lumped masses.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TimeStep {
    /// In s: 2 over the largest angular frequency.
    pub seconds: f64,
    /// The largest angular frequency in 1/s; the residual of the eigenvalue is added, so that the
    /// step errs on the safe side.
    pub frequency: f64,
    /// The residual over the eigenvalue.
    pub uncertainty: f64,
    /// Products with the tangent.
    pub products: usize,
    /// Points of the body.
    pub points: usize,
}

impl TimeStep {
    /// Of the whole free body. `masses` has one entry per point, in kg. Nothing for a body whose
    /// largest eigenvalue is not positive.
    pub(super) fn new(energy: &dyn Energy, masses: &[f64]) -> Result<Option<TimeStep>, NonFinite> {
        let n = energy.positions().len();
        let (rest, free) = (vec![0.0; n], Constraints::none(n));
        let found = CriticalStep::find(energy, &rest, masses, &free, Precision::default())?;
        Ok(found.map(|CriticalStep { seconds, frequency, uncertainty, products, .. }| TimeStep {
            seconds,
            frequency,
            uncertainty,
            products,
            points: masses.len(),
        }))
    }
}
