//! Bodies whose parameters change with time: they warm up, swell or grow on their way.
//!
//! Over a step the energy is that of its middle, `E(u; p(t + dt/2))`: half of the change comes before the
//! body moves and half behind it, which is of second order as the rest of the rule is. What the stored energy
//! changes by while the body moves is summed up; all else that it changes by, and that does not break or
//! remember, is the work of changing the parameters.

use piola_mechanics::energy::total;

use super::{Motion, MotionError, Others};

impl<O: Others> Motion<'_, O> {
    /// Gives parameters their values at the `middle` of a step, in s; the energy in J before the body moves,
    /// where any change.
    pub(super) fn begin_way(&mut self, middle: f64) -> Result<Option<f64>, MotionError> {
        if !self.drive.parameters_change() {
            return Ok(None);
        }
        self.set_parameters(middle)?;
        Ok(Some(self.energy_now()?))
    }

    /// At the end of the way: what the energy has changed by from what it was `before`, and parameters at the
    /// present time.
    pub(super) fn end_way(&mut self, before: Option<f64>) -> Result<(), MotionError> {
        let Some(before) = before else { return Ok(()) };
        let now = self.energy_now()?;
        self.balance.go(now - before);
        self.set_parameters_now()
    }

    /// Parameters at the present time.
    pub(super) fn set_parameters_now(&mut self) -> Result<(), MotionError> {
        self.set_parameters(self.time(self.done))
    }

    /// Parameters at `t` in s.
    pub(super) fn set_parameters(&mut self, t: f64) -> Result<(), MotionError> {
        match !self.drive.parameters_change() || self.drive.set_parameters(t) {
            true => Ok(()),
            false => Err(MotionError::Parameters { t }),
        }
    }

    fn energy_now(&self) -> Result<f64, MotionError> {
        let mut parts = vec![0.0; self.parts.len()];
        let found = self.energy.counted_energy(&self.u.value, None, &mut parts);
        found.map_err(|cause| self.not_finite(cause))?;
        Ok(total(&parts))
    }
}
