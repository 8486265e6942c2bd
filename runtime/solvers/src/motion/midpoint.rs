//! A step of the implicit midpoint rule: `u' = u + dt w`, `v' = 2 w - v` with the velocity
//! `w = v + dt/2 a(u + dt/2 w)` in its middle.
//!
//! The middle `u + dt/2 w` is the stationary point of the energy, the loads and springs of stiffness
//! `4 m/dt^2 + 2 c m/dt` that hold every point near where it would fly to: Newton's method finds it. Of the
//! rules that need no unsymmetric tangent it is the one that keeps angular momentum, too; it is stable for
//! any step where forces are linear, of second order, and goes back the way it came (Hairer, Lubich, Wanner,
//! Geometric Numerical Integration, VI.4). The velocity is worked out from the forces there, and the
//! displacement from the velocity, so that the account of energy closes however exactly the middle is known.

use std::ops::ControlFlow;
use std::sync::Arc;

use piola_mechanics::energy::inertia::Inertia;
use piola_mechanics::energy::{Energy as _, Total, Wanted};
use piola_mechanics::vector::norm;

use super::{Motion, MotionError, Others};
use crate::linear::{LinearMethod, LinearOptions};
use crate::newton::{Newton, NewtonFailure, NewtonSettings, NewtonVariant};

/// The account of a step: works in J.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Works {
    pub(super) internal: f64,
    pub(super) external: f64,
    pub(super) damping: f64,
    pub(super) prescribed: f64,
    /// `1/2 m v.v` of the free degrees of freedom behind the step.
    pub(super) kinetic: f64,
    /// The largest component of a velocity in m/s; NaN counts as none.
    pub(super) fastest: f64,
}

impl<O: Others> Motion<'_, O> {
    /// Loads and what is prescribed half a step on, and where the body would be then without forces;
    /// prescribed points half way to where they are at the end of the step.
    fn flight(&mut self) -> Result<Vec<f64>, MotionError> {
        let (t, half) = (self.time(self.done) + 0.5 * self.dt, 0.5 * self.dt);
        self.drive.loads(t, &mut self.loads);
        self.check_loads(t)?;
        self.ask_displacements(self.time(self.done + 1))?;
        self.ask_velocities(t)?;
        let mut middle: Vec<f64> =
            self.u.value.iter().zip(&self.v.value).map(|(u, v)| u + half * v).collect();
        for (k, &dof) in self.drive.displaced().iter().enumerate() {
            middle[dof] = 0.5 * (self.u.value[dof] + self.displacements[k]);
        }
        for (k, &dof) in self.drive.driven().iter().enumerate() {
            middle[dof] = self.u.value[dof] + half * self.velocities[k];
        }
        self.ask_accelerations(t)?;
        for (&dof, a) in self.drive.accelerated().iter().zip(&self.accelerations) {
            middle[dof] = self.u.value[dof] + half * (self.v.value[dof] + half * a);
        }
        Ok(middle)
    }

    /// Where the body is half a step on, from where it would fly to; nothing where an end is wanted first.
    fn middle(&mut self, flown: Vec<f64>) -> Result<Option<Vec<f64>>, MotionError> {
        let (dt, c, d) = (self.dt, self.settings.damping, self.energy.dimension());
        let spring = |dof: usize| match self.is_fixed[dof] {
            true => 0.0,
            false => self.mass(dof) * (4.0 / (dt * dt) + 2.0 * c / dt),
        };
        let stiffness: Vec<f64> = (0..flown.len()).map(spring).collect();
        // Of damping, springs hold to where the body is.
        let inert = 4.0 / (dt * dt) / (4.0 / (dt * dt) + 2.0 * c / dt);
        let place = |(flown, u): (&f64, &f64)| u + inert * (flown - u);
        let places: Vec<f64> = flown.iter().zip(&self.u.value).map(place).collect();
        let inertia = Inertia::new(d, self.energy.positions(), stiffness, places);
        let names: Arc<[String]> =
            self.energy.parts().iter().chain(inertia.parts().iter()).cloned().collect();
        let both = Total::named(
            vec![self.energy.into(), (&inertia as &dyn piola_mechanics::energy::Energy).into()],
            names,
        );
        let settings = NewtonSettings {
            tolerance: self.settings.tolerance,
            variant: NewtonVariant::Inexact,
            ..NewtonSettings::default()
        };
        let (start, push) = self.start_from(flown)?;
        let solve = |method: LinearMethod| -> Result<Vec<f64>, NewtonFailure> {
            let linear = LinearOptions { method, ..LinearOptions::default() };
            let mut newton = Newton::new(&both, &self.constraints, settings, linear)?;
            newton.watched(&self.watch.in_silence());
            newton.compare_with(push);
            let mut middle = start.clone();
            match newton.solve(&mut middle, &self.loads).map_err(|error| error.failure) {
                // Short steps ask for more than rounding leaves of a middle; velocities come from forces.
                Ok(_) | Err(NewtonFailure::RoundingFloor { .. }) => Ok(middle),
                Err(failure) => Err(failure),
            }
        };
        // Inertia makes the tangent so even that few products do, unless it is indefinite all the same.
        let found = match solve(LinearMethod::MatrixFree) {
            Err(failure) if failure != NewtonFailure::Interrupted => solve(LinearMethod::Auto),
            found => found,
        };
        match found {
            Ok(middle) => Ok(Some(middle)),
            Err(NewtonFailure::Interrupted) => Ok(None),
            Err(failure) => Err(self.no_step(failure)),
        }
    }

    /// Where Newton's method starts: where the body would fly to, or where it is if no energy is known
    /// there; and the forces in N that accelerate it there, which residuals are compared with.
    fn start_from(&self, flown: Vec<f64>) -> Result<(Vec<f64>, f64), MotionError> {
        let mut forces = vec![0.0; flown.len()];
        let mut evaluate =
            |at: &[f64]| self.energy.evaluate(at, Wanted::Forces(&mut forces), &mut []);
        let start = match evaluate(&flown) {
            Ok(()) => flown,
            Err(_) => {
                let own =
                    |dof: usize| if self.is_fixed[dof] { flown[dof] } else { self.u.value[dof] };
                let start: Vec<f64> = (0..flown.len()).map(own).collect();
                evaluate(&start).map_err(|cause| self.not_finite(cause))?;
                start
            }
        };
        let free = self.constraints.free().iter();
        let push = norm(free.map(|&dof| self.loads[dof] - forces[dof]));
        Ok((start, push))
    }

    fn no_step(&self, failure: NewtonFailure) -> MotionError {
        match failure {
            NewtonFailure::NonFinite(cause) => self.not_finite(cause),
            failure => {
                let (t, step) = (self.time(self.done), self.done);
                MotionError::NoStep { t, step, dt: self.dt, failure: Box::new(failure) }
            }
        }
    }

    /// One step; forces and energy are worked out at its end where a row is due. It breaks where an end is
    /// wanted first.
    pub(super) fn go_implicitly(
        &mut self,
        wants_row: bool,
    ) -> Result<ControlFlow<()>, MotionError> {
        let flown = self.flight()?;
        let before = self.begin_way(self.time(self.done) + 0.5 * self.dt)?;
        let Some(middle) = self.middle(flown)? else {
            self.set_parameters_now()?;
            return Ok(ControlFlow::Break(()));
        };
        let evaluated = self.energy.evaluate(&middle, Wanted::Forces(&mut self.forces), &mut []);
        evaluated.map_err(|cause| self.not_finite(cause))?;
        let works = self.arrive();
        self.done += 1;
        self.balance.step(&works);
        let is_near = self.dt * works.fastest <= self.extent || self.stays_together();
        if !(works.kinetic.is_finite() && is_near) {
            return Err(self.flown_off());
        }
        self.end_way(before)?;
        // Forces in the middle of the step were those of the bonds that were there.
        self.change_status(0.0)?;
        if wants_row {
            self.stand()?;
        }
        Ok(ControlFlow::Continue(()))
    }

    /// Loads, forces, energy and velocities where the last step has led, for a row there.
    pub(super) fn stand(&mut self) -> Result<(), MotionError> {
        let t = self.time(self.done);
        self.set_parameters_now()?;
        self.drive.loads(t, &mut self.loads);
        self.check_loads(t)?;
        self.ask_forces(true)?;
        self.mean.copy_from_slice(&self.v.value);
        self.ask_velocities(t)?;
        for (&dof, &value) in self.drive.driven().iter().zip(&self.velocities) {
            self.mean[dof] = value;
        }
        Ok(())
    }

    /// Velocities and displacements at the end of the step, from the forces in its middle.
    fn arrive(&mut self) -> Works {
        let (dt, c) = (self.dt, self.settings.damping);
        let mut works = Works::default();
        for dof in 0..self.forces.len() {
            if self.is_fixed[dof] {
                continue;
            }
            let (mass, force, load) = (self.mass(dof), self.forces[dof], self.loads[dof]);
            let v = self.v.value[dof];
            let w = (v + 0.5 * dt * (load - force) / mass) / (1.0 + 0.5 * c * dt);
            let way = dt * w;
            self.u.add(dof, way);
            self.v.add(dof, 2.0 * (w - v));
            works.internal += force * way;
            works.external += load * way;
            works.damping += mass * c * w * way;
            let v = self.v.value[dof];
            works.kinetic += 0.5 * mass * v * v;
            works.fastest = works.fastest.max(v.abs());
        }
        for (k, &dof) in self.drive.displaced().iter().enumerate() {
            let way = self.displacements[k] - self.u.value[dof];
            works.prescribed += self.forces[dof] * way;
            self.u.set(dof, self.displacements[k]);
            self.v.set(dof, way / dt);
        }
        for (k, &dof) in self.drive.driven().iter().enumerate() {
            let way = dt * self.velocities[k];
            works.prescribed += self.forces[dof] * way;
            self.u.add(dof, way);
            self.v.set(dof, self.velocities[k]);
        }
        for (&dof, a) in self.drive.accelerated().iter().zip(&self.accelerations) {
            let way = dt * (self.v.value[dof] + 0.5 * dt * a);
            works.prescribed += self.forces[dof] * way;
            self.u.add(dof, way);
            self.v.add(dof, dt * a);
        }
        works
    }
}
