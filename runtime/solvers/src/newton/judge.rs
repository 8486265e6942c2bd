//! What the tangent says of an equilibrium: definiteness and condition.

use super::{Newton, NewtonFailure};
use crate::clock::timed;
use crate::linear::{Definiteness, LinearMethod};

impl Newton<'_> {
    /// Whether the tangent of the last state is positive definite.
    ///
    /// Modified Newton has no tangent of that state yet and assembles it. Factors and preconditioner
    /// serve the next solve if it starts from the same state, and with modified Newton any.
    pub fn judge(&mut self) -> Result<Definiteness, NewtonFailure> {
        if let Some(u) = self.evaluated_at.clone() {
            self.evaluate(&u, true)?;
        }
        let definiteness = self.with_tangent(|linear, tangent, _| linear.judge(tangent))?;
        // Explicitly chosen LU and LDLT start their own way next time.
        self.factorized = !matches!(self.linear.method(), LinearMethod::Ldlt | LinearMethod::Lu);
        Ok(definiteness)
    }

    /// Works out forces and tangent at displacements in m, to be judged there.
    ///
    /// # Errors
    /// What is not finite.
    pub fn look_at(&mut self, u: &[f64]) -> Result<(), NewtonFailure> {
        Ok(self.evaluate(u, true)?)
    }

    /// The condition of the tangent just judged, on the free degrees of freedom, where it can be
    /// estimated.
    pub fn condition(&mut self) -> Result<Option<f64>, NewtonFailure> {
        let (linear, tangent) = (&mut self.linear, self.tangent.tangent()?);
        Ok(timed(&mut self.times.linear, || linear.condition(tangent))?)
    }
}
