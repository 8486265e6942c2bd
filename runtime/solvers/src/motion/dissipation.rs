//! What bonds dissipate on the way.
//!
//! Where forces are, at the ends of steps, the velocities of explicit rules are not known yet: those before
//! and after the kick have dissipative forces in between. They are taken where a straight line through the last
//! two leads, `v_n = v_(n-1/2) + 1/2 (v_(n-1/2) - v_(n-3/2))`: of second order in the step, as the rule itself,
//! and without an equation to solve. What that costs of the step says [`super::critical`].

use super::{Motion, MotionError, Others};

/// Dissipative forces, and what they follow from; vectors are `n x d`.
pub(super) struct Viscous {
    /// `dR/dv` in N at the present time.
    pub(super) forces: Vec<f64>,
    /// Velocities in m/s before the last kick.
    pub(super) earlier: Vec<f64>,
    /// At the present time, in m/s.
    velocities: Vec<f64>,
    /// `dE/du + dR/dv` in N.
    pub(super) together: Vec<f64>,
}

impl Viscous {
    /// Of so many degrees of freedom, at rest.
    pub(super) fn new(n: usize) -> Viscous {
        let [forces, earlier, velocities, together] = [(); 4].map(|()| vec![0.0; n]);
        Viscous { forces, earlier, velocities, together }
    }
}

impl<O: Others> Motion<'_, O> {
    /// The velocities at the start, by which bonds dissipate there; points with prescribed displacements have
    /// those of the first step.
    pub(super) fn begin_dissipation(&mut self) -> Result<(), MotionError> {
        if self.viscous.is_none() {
            return Ok(());
        }
        self.ask_displacements(self.time(1))?;
        for (&dof, &value) in self.drive.displaced().iter().zip(&self.displacements) {
            self.v.set(dof, (value - self.u.value[dof]) / self.dt);
        }
        self.remember_velocities();
        Ok(())
    }

    /// The velocities that the coming kick takes on.
    pub(super) fn remember_velocities(&mut self) {
        if let Some(viscous) = &mut self.viscous {
            viscous.earlier.copy_from_slice(&self.v.value);
        }
    }

    /// The velocities at the end of the step that is made, before its forces are known. Collective.
    pub(super) fn foresee_velocities(&mut self) {
        let Some(Viscous { earlier, velocities, .. }) = &mut self.viscous else { return };
        for (dof, (last, earlier)) in self.v.value.iter().zip(&*earlier).enumerate() {
            velocities[dof] = last + 0.5 * (last - earlier);
        }
        self.others.bring(velocities);
    }

    /// Dissipative forces at the present time, with the velocities that are [foreseen](Motion::foresee_velocities).
    pub(super) fn ask_dissipation(&mut self) -> Result<(), MotionError> {
        let (Some(viscous), Some(dissipation)) = (&mut self.viscous, self.energy.dissipation())
        else {
            return Ok(());
        };
        let Viscous { forces, velocities, together, .. } = viscous;
        let found = dissipation.forces(&self.u.value, velocities, forces);
        let all = together.iter_mut().zip(&self.forces).zip(&*forces);
        all.for_each(|((sum, stored), lost)| *sum = stored + lost);
        found.map_err(|cause| self.not_finite(cause))
    }

    /// The dissipative force on a degree of freedom in N.
    pub(super) fn lost_force(&self, dof: usize) -> f64 {
        self.viscous.as_ref().map_or(0.0, |viscous| viscous.forces[dof])
    }

    /// `dE/du + dR/dv` in N.
    pub(super) fn all_forces(&self) -> &[f64] {
        self.viscous.as_ref().map_or(&self.forces, |viscous| &viscous.together)
    }
}
