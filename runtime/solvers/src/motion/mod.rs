//! Bodies that move: `m a = f - dE/du` with lumped masses, integrated explicitly.
//!
//! | module | does |
//! |---|---|
//! | `verlet` | takes velocities and displacements on by a step |
//! | [`critical`] | the largest stable step |
//! | [`balance`] | the account of energy, and its rows |
//! | `settings` | the rule of integration and its choices, what drives a body, where it starts |
//! | `dissipation` | what bonds dissipate on the way |
//! | `midpoint` | a step of the implicit midpoint rule |
//! | `parameters` | of energies that change with time |
//! | `advance` | goes from row to row |
//! | `others` | other parts of a body that many processes share |
//! | `flown` | points that fly off |
//! | `snapshot` | where a motion stands, to go on from there with the same bits |
//! | `error` | why a motion cannot start or go on |
//!
//! Velocity Verlet (partmann2026, section 3.7, Eqs. (3.60)-(3.68)) in its form of two leaps: velocities
//! are known in the middle of steps, `v_(n+1/2) = v_(n-1/2) + dt a_n`, `u_(n+1) = u_n + dt v_(n+1/2)`,
//! and at the end of a step, where forces are, half of the kick is still to come:
//! `v_n = v_(n-1/2) + dt/2 a_n`. Forces are evaluated once a step, the energy where a row is due.

mod advance;
pub mod balance;
pub mod critical;
mod dissipation;
mod error;
mod flown;
mod midpoint;
mod others;
mod parameters;
mod settings;
mod snapshot;
mod verlet;

#[cfg(test)]
mod midpoint_tests;
#[cfg(test)]
mod tests;

use std::time::{Duration, Instant};

use piola_mechanics::energy::{Energy, NonFinite, Wanted};

use crate::constraint::Constraints;
use crate::singular::Watched;
use crate::watch::{Event, Watch};
use advance::LOOK;
use balance::Balance;
pub use balance::Row;
use critical::Hessians;
pub use critical::{CriticalStep, Precision, step_by_row_sums};
use dissipation::Viscous;
pub use error::{FlownOff, MotionError};
use others::agreed;
pub use others::{Nobody, Others};
pub use settings::{Initial, Method, MotionDrive, MotionSettings};
pub use snapshot::Snapshot;
use verlet::{Kick, Sides, Summed, Sums, n_pieces};

/// Steps of the midpoint rule over critical ones, where the scene does not say.
const IMPLICIT_STEPS: f64 = 10.0;

/// A step that divides the way up to here needs no further one.
const ROUNDED: f64 = 1e-12;

/// How many steps of about this length lead to the end, both in s; as a number, for there may be more than
/// can be counted.
pub fn n_steps(end: f64, step: f64) -> f64 {
    (end / step * (1.0 - ROUNDED)).ceil().max(1.0)
}

/// A body on its way in time, whole or one of the parts that [others](Others) are beside.
pub struct Motion<'a, O = Nobody> {
    energy: &'a dyn Energy,
    drive: &'a dyn MotionDrive,
    others: &'a O,
    watch: Watch,
    settings: MotionSettings,
    constraints: Constraints,
    families: Watched,
    critical: Option<CriticalStep>,
    /// The smallest critical step that was found on the way, in s.
    least_critical: f64,
    /// The step in s, how many there are, and how many are done.
    dt: f64,
    n_steps: usize,
    done: usize,
    /// One per point, in kg.
    masses: Vec<f64>,
    is_fixed: Vec<bool>,
    /// At the present time.
    u: Summed,
    forces: Vec<f64>,
    /// Where bonds dissipate.
    viscous: Option<Viscous>,
    loads: Vec<f64>,
    parts: Vec<f64>,
    /// In the middle of the step to come.
    v: Summed,
    /// At the present time, where a row is due.
    mean: Vec<f64>,
    /// What is prescribed: displacements at the end of the step to come, velocities in its middle,
    /// accelerations where forces are.
    displacements: Vec<f64>,
    velocities: Vec<f64>,
    accelerations: Vec<f64>,
    /// A point that goes further than this in one step has flown off, in m.
    extent: f64,
    /// How many degrees of freedom of the body are free.
    n_free: usize,
    /// The largest component of a velocity that the last kick led to, in m/s; not a number where some are not.
    fastest: f64,
    pieces: Vec<Sums>,
    balance: Balance,
    /// What this part released in the present step, and dissipated, in J.
    left_behind: [f64; 2],
    notes: Vec<String>,
    /// Whether who looks on wanted an end.
    is_over: bool,
    /// Whether they want one now.
    wants_end: bool,
    /// What a snapshot knows before the row of an end between two rows.
    before_end: Option<BeforeRow>,
    /// Why there is no next step, told behind the row of the last one.
    stopped: Option<MotionError>,
    /// How long it goes on at a stretch, and since when it does.
    pauses: Option<(Duration, Instant)>,
    /// Whether one is due, in any part.
    is_pause_due: bool,
}

/// What the row at an end between two rows changes: scalars of a snapshot, and how many notes there were.
struct BeforeRow {
    numbers: Vec<f64>,
    n_notes: usize,
}

impl<'a> Motion<'a> {
    /// At the start, with the forces there; `masses` has one entry per point, in kg. The first row is
    /// [`Motion::advance_to`] step 0.
    ///
    /// # Errors
    /// Settings and masses that cannot be used, a step beyond the critical one, energies or
    /// conditions that are not finite at the start.
    pub fn new(
        energy: &'a dyn Energy,
        masses: &[f64],
        initial: Initial,
        drive: &'a dyn MotionDrive,
        settings: &MotionSettings,
        watch: &Watch,
    ) -> Result<Motion<'a>, MotionError> {
        Motion::among(&Nobody, energy, masses, initial, drive, settings, watch)
    }
}

impl<'a, O: Others> Motion<'a, O> {
    /// The same of a part of a body, whose other parts other processes move: of the energies, displacements and
    /// forces of this one those of the points that [count](Energy::counted) matter, and others come from where
    /// they do. Rows are those of the whole body. Implicit rules are of whole bodies alone.
    /// Collective, as all that leads on.
    ///
    /// # Errors
    /// As [`Motion::new`]; [`MotionError::Elsewhere`] where another part has one.
    pub fn among(
        others: &'a O,
        energy: &'a dyn Energy,
        masses: &[f64],
        initial: Initial,
        drive: &'a dyn MotionDrive,
        settings: &MotionSettings,
        watch: &Watch,
    ) -> Result<Motion<'a, O>, MotionError> {
        let placed = || {
            let mut motion = Motion::of((energy, others), masses, initial, drive, settings, watch)?;
            motion.place(0.0)?;
            motion.set_parameters(0.0)?;
            Ok(motion)
        };
        let mut motion = agreed(others, placed())?;
        motion.join();
        motion.choose_step()?;
        motion.start()?;
        Ok(motion)
    }

    /// Before its first step, without forces.
    fn of(
        (energy, others): (&'a dyn Energy, &'a O),
        masses: &[f64],
        mut initial: Initial,
        drive: &'a dyn MotionDrive,
        settings: &MotionSettings,
        watch: &Watch,
    ) -> Result<Motion<'a, O>, MotionError> {
        error::check(settings, masses)?;
        if settings.method == Method::Midpoint && energy.dissipation().is_some() {
            return Err(MotionError::ImplicitDissipation);
        }
        let (n, d) = (energy.positions().len(), energy.dimension());
        assert!(masses.len() * d == n && initial.displacements.len() == n, "a mass per point");
        // Points that others move are not free here, and have no velocity: what adds up knows nothing of them.
        let counted = energy.counted();
        let is_moved = |dof: &usize| !counted.contains(&(dof / d));
        let moved = || (0..n).filter(is_moved);
        moved().for_each(|dof| initial.velocities[dof] = 0.0);
        let mut fixed = drive.fixed();
        fixed.extend(moved());
        fixed.sort_unstable();
        let constraints = Constraints::new(n, &fixed)?;
        Ok(Motion {
            energy,
            drive,
            others,
            watch: watch.clone(),
            settings: *settings,
            critical: None,
            least_critical: f64::INFINITY,
            dt: 0.0,
            n_steps: 0,
            done: 0,
            masses: masses.to_vec(),
            is_fixed: (0..n).map(|dof| constraints.is_fixed(dof)).collect(),
            constraints,
            families: Watched::new(energy, settings.singular),
            u: Summed::new(initial.displacements),
            forces: vec![0.0; n],
            viscous: energy.dissipation().map(|_| Viscous::new(n)),
            loads: vec![0.0; n],
            parts: vec![0.0; energy.parts().len()],
            v: Summed::new(initial.velocities),
            mean: vec![0.0; n],
            displacements: vec![0.0; drive.displaced().len()],
            velocities: vec![0.0; drive.driven().len()],
            accelerations: vec![0.0; drive.accelerated().len()],
            extent: 0.0,
            n_free: 0,
            fastest: 0.0,
            pieces: vec![Sums::default(); n_pieces(n)],
            balance: Balance::default(),
            left_behind: [0.0; 2],
            notes: Vec::new(),
            is_over: false,
            wants_end: watch.wants_end(),
            before_end: None,
            stopped: None,
            pauses: None,
            is_pause_due: false,
        })
    }

    /// The step in s: the largest part of the way that the settings allow.
    pub fn step(&self) -> f64 {
        self.dt
    }

    /// How many steps lead to the end.
    pub fn n_steps(&self) -> usize {
        self.n_steps
    }

    /// How many steps are done.
    pub fn step_reached(&self) -> usize {
        self.done
    }

    /// The time after them, in s.
    pub fn time_reached(&self) -> f64 {
        self.time(self.done)
    }

    /// The critical step at the start; nothing where the body has no stiffness there.
    pub fn critical(&self) -> Option<CriticalStep> {
        self.critical
    }

    /// The smallest critical step that was found on the way, in s; infinite without stiffness.
    pub fn least_critical(&self) -> f64 {
        self.least_critical
    }

    /// What the reader should know, sentences without full stops.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Of the point that a degree of freedom is of, in kg.
    fn mass(&self, dof: usize) -> f64 {
        self.masses[dof / self.energy.dimension()]
    }

    fn time(&self, step: usize) -> f64 {
        match step == self.n_steps {
            true => self.settings.end,
            false => self.settings.end * (step as f64 / self.n_steps as f64),
        }
    }

    /// Puts the points with prescribed displacements where they are at `t`.
    fn place(&mut self, t: f64) -> Result<(), MotionError> {
        self.ask_displacements(t)?;
        for (&dof, &value) in self.drive.displaced().iter().zip(&self.displacements) {
            self.u.set(dof, value);
        }
        Ok(())
    }

    fn ask_displacements(&mut self, t: f64) -> Result<(), MotionError> {
        self.drive.displacements(t, &mut self.displacements);
        let (dofs, values) = (self.drive.displaced(), &self.displacements);
        self.check_given("prescribed displacement", t, dofs.iter().copied().zip(values))
    }

    fn ask_velocities(&mut self, t: f64) -> Result<(), MotionError> {
        self.drive.velocities(t, &mut self.velocities);
        let (dofs, values) = (self.drive.driven(), &self.velocities);
        self.check_given("prescribed velocity", t, dofs.iter().copied().zip(values))
    }

    fn ask_accelerations(&mut self, t: f64) -> Result<(), MotionError> {
        self.drive.accelerations(t, &mut self.accelerations);
        let (dofs, values) = (self.drive.accelerated(), &self.accelerations);
        self.check_given("prescribed acceleration", t, dofs.iter().copied().zip(values))
    }

    fn check_given<'v>(
        &self,
        what: &'static str,
        t: f64,
        mut values: impl Iterator<Item = (usize, &'v f64)>,
    ) -> Result<(), MotionError> {
        let Some((dof, &value)) = values.find(|(_, value)| !value.is_finite()) else {
            return Ok(());
        };
        let d = self.energy.dimension();
        Err(MotionError::Drive { what, point: dof / d, component: dof % d, value, t })
    }

    /// The step and how many there are.
    fn choose_step(&mut self) -> Result<(), MotionError> {
        self.watch.notice(Event::Phase("critical step"));
        let critical = self.find_critical()?;
        self.least_critical = critical;
        let wanted = match self.settings.step {
            Some(step) => step,
            None if critical.is_finite() && self.is_implicit() => {
                IMPLICIT_STEPS * self.settings.safety * critical
            }
            None if critical.is_finite() => self.settings.safety * critical,
            None if self.n_free == 0 => return Err(MotionError::NothingFree),
            None => return Err(MotionError::NoStiffness),
        };
        let mut count = n_steps(self.settings.end, wanted);
        if self.settings.even {
            let rows = self.settings.rows.max(1) as f64;
            count = (count / rows).ceil() * rows;
        }
        if count > error::MOST_STEPS {
            return Err(MotionError::TooMany { count, step: wanted });
        }
        self.n_steps = count as usize;
        self.dt = self.settings.end / count;
        if self.dt > critical && !self.is_implicit() && !self.settings.unstable {
            return Err(MotionError::TooLong { step: self.dt, critical });
        }
        Ok(())
    }

    /// The critical step in s, infinite without stiffness. Where a step is wanted that is below what a few products
    /// say, which errs on the safe side, that is enough.
    fn find_critical(&mut self) -> Result<f64, MotionError> {
        let is_below =
            |found: &CriticalStep| self.settings.step.is_some_and(|wanted| wanted <= found.seconds);
        let known = match self.settings.step {
            Some(_) => self.look(LOOK)?,
            None => None,
        };
        let found = match known.filter(is_below) {
            Some(found) => Some(found),
            None => self.look(Precision::default())?,
        };
        self.critical = found;
        Ok(found.map_or(f64::INFINITY, |found| found.seconds))
    }

    fn look(&self, precision: Precision) -> Result<Option<CriticalStep>, MotionError> {
        let hessians = Hessians::of(self.energy, (&self.u.value, &self.v.value));
        let hessians = agreed(self.others, hessians.map_err(|cause| self.not_finite(cause)))?;
        let (d, masses) = (self.energy.dimension(), &self.masses);
        Ok(hessians.critical(self.others, d, masses, &self.constraints, precision))
    }

    /// Forces at the start, and the velocity half a step before it.
    fn start(&mut self) -> Result<(), MotionError> {
        let judged = self.judge_families(true);
        let begun = judged.and_then(|()| self.begin());
        let broken = agreed(self.others, begun)?;
        self.tell_of_start(broken);
        if self.is_implicit() {
            let free = self.constraints.free().iter();
            let of = |dof: &usize| 0.5 * self.mass(*dof) * self.v.value[*dof] * self.v.value[*dof];
            self.balance.begin(free.map(of).fold(0.0, |sum, part| sum + part));
            return Ok(());
        }
        self.foresee_velocities();
        let begun = self.ask_dissipation().and_then(|()| self.begin_leaps());
        self.meet(begun)
    }

    /// What there is at the start: velocities, loads and forces, behind what breaks, of which it says how many.
    fn begin(&mut self) -> Result<[usize; 3], MotionError> {
        self.ask_velocities(0.0)?;
        for (&dof, &value) in self.drive.driven().iter().zip(&self.velocities) {
            self.v.set(dof, value);
        }
        self.mean.copy_from_slice(&self.v.value);
        self.ask_loads(true)?;
        let broken = self.break_at_start()?;
        self.ask_forces(true)?;
        if !self.is_implicit() {
            self.begin_dissipation()?;
        }
        Ok(broken)
    }

    /// The velocity half a step before the start, and the first kick.
    fn begin_leaps(&mut self) -> Result<(), MotionError> {
        let (c, dt) = (self.settings.damping, self.dt);
        if self.settings.method != Method::Kinematic {
            let over = 1.0 + c * dt * (self.settings.method.damped_part() - 0.5);
            for dof in 0..self.forces.len() {
                if !self.is_fixed[dof] {
                    let force = self.loads[dof] - self.forces[dof] - self.lost_force(dof);
                    let push = force / self.mass(dof);
                    let a = (push - c * self.v.value[dof]) / over;
                    let before = self.v.value[dof] - 0.5 * dt * a;
                    self.v.set(dof, before);
                }
            }
            self.ask_accelerations(0.0)?;
            for (&dof, a) in self.drive.accelerated().iter().zip(&self.accelerations) {
                let before = self.v.value[dof] - 0.5 * dt * a;
                self.v.set(dof, before);
            }
        }
        self.kick(true)
    }

    fn ask_loads(&mut self, first: bool) -> Result<(), MotionError> {
        if !first && !self.drive.loads_change() {
            return Ok(());
        }
        let t = self.time(match self.settings.method {
            Method::Kinematic => (self.done + 1).min(self.n_steps),
            Method::Verlet | Method::LeapFrog | Method::Midpoint => self.done,
        });
        self.drive.loads(t, &mut self.loads);
        if first { self.check_loads(t) } else { Ok(()) }
    }

    fn check_loads(&self, t: f64) -> Result<(), MotionError> {
        self.check_given("load", t, self.loads.iter().enumerate())
    }

    fn ask_forces(&mut self, wants_energy: bool) -> Result<(), MotionError> {
        let (u, forces) = (&self.u.value, &mut self.forces);
        let evaluated = match wants_energy {
            true => self.energy.counted_energy(u, Some(forces), &mut self.parts),
            false => self.energy.evaluate(u, Wanted::Forces(forces), &mut []),
        };
        evaluated.map_err(|cause| self.not_finite(cause))
    }

    fn not_finite(&self, cause: NonFinite) -> MotionError {
        let t = if self.n_steps == 0 { 0.0 } else { self.time(self.done) };
        MotionError::NonFinite { t, step: self.done, unstable: self.is_unstable(), cause }
    }

    fn is_implicit(&self) -> bool {
        self.settings.method == Method::Midpoint
    }

    /// The critical step in s, where the present one is beyond it and that matters.
    fn is_unstable(&self) -> Option<f64> {
        (!self.is_implicit() && self.dt > self.least_critical).then_some(self.least_critical)
    }

    /// The same, with a look at where the body is now.
    fn unstable_by_now(&self) -> Option<f64> {
        if self.is_implicit() {
            return None;
        }
        let now = self.look(LOOK).ok().flatten().map(|found| found.seconds);
        self.is_unstable().or(now.filter(|critical| self.dt > *critical))
    }

    /// Takes velocities on to the middle of the step to come, and the account to the present time.
    fn kick(&mut self, wants_row: bool) -> Result<(), MotionError> {
        self.remember_velocities();
        let kick = Kick {
            internal: &self.forces,
            viscous: self.viscous.as_ref().map(|viscous| &viscous.forces[..]),
            loads: &self.loads,
            masses: (&self.masses, self.energy.dimension()),
            is_fixed: &self.is_fixed,
            step: self.dt,
            damping: self.settings.damping,
            part: self.settings.method.damped_part(),
        };
        let wants_mean = wants_row && self.settings.method == Method::Verlet;
        if wants_row && !wants_mean && self.done > 0 {
            self.mean.copy_from_slice(&self.v.value);
        }
        let mean = if wants_mean { &mut self.mean[..] } else { &mut [] };
        let sums = kick.apply(&mut self.v, mean, &mut self.pieces);
        let [prescribed, held] = self.kick_prescribed(wants_mean)?;
        // What is not a number is in the sum, what is too fast among the fastest.
        self.fastest = if sums.kinetic.is_finite() { sums.fastest } else { f64::NAN };
        self.balance.arrive(self.dt, &sums, [prescribed, held]);
        Ok(())
    }

    /// The same where something is prescribed: the powers of `dE/du` there, and of what is dissipated.
    fn kick_prescribed(&mut self, wants_mean: bool) -> Result<[Sides; 2], MotionError> {
        let mut sides = [Sides::default(); 2];
        let given = [&self.displacements, &self.velocities, &self.accelerations];
        if given.iter().all(|values| values.is_empty()) {
            return Ok(sides);
        }
        let (t, is_last) = (self.time(self.done), self.done == self.n_steps);
        if wants_mean {
            self.ask_velocities(t)?;
            for (&dof, &value) in self.drive.driven().iter().zip(&self.velocities) {
                self.mean[dof] = value;
            }
        }
        // Nobody says what is prescribed behind the end.
        if !is_last {
            self.ask_displacements(self.time(self.done + 1))?;
            self.ask_velocities(t + 0.5 * self.dt)?;
        }
        for (k, &dof) in self.drive.displaced().iter().enumerate() {
            let before = self.v.value[dof];
            let after = match is_last {
                true => before,
                false => (self.displacements[k] - self.u.value[dof]) / self.dt,
            };
            self.add_powers(&mut sides, dof, before, after);
            self.v.set(dof, after);
            if self.done == 0 {
                self.mean[dof] = after;
            } else if wants_mean {
                self.mean[dof] = 0.5 * (before + after);
            }
        }
        for (k, &dof) in self.drive.driven().iter().enumerate() {
            let after = if is_last { self.v.value[dof] } else { self.velocities[k] };
            self.add_powers(&mut sides, dof, self.v.value[dof], after);
            self.v.set(dof, after);
        }
        self.ask_accelerations(t)?;
        for (&dof, a) in self.drive.accelerated().iter().zip(&self.accelerations) {
            let before = self.v.value[dof];
            self.v.add(dof, self.dt * a);
            let after = self.v.value[dof];
            self.add_powers(&mut sides, dof, before, after);
            if wants_mean {
                self.mean[dof] = 0.5 * (before + after);
            }
        }
        Ok(sides)
    }

    fn add_powers(&self, [stored, lost]: &mut [Sides; 2], dof: usize, before: f64, after: f64) {
        stored.add(self.forces[dof], before, after);
        lost.add(self.lost_force(dof), before, after);
    }
}
