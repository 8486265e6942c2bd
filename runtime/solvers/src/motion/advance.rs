//! A motion on its way from row to row.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use piola_mechanics::energy::{EnergyParts, total};
use piola_mechanics::fracture::{Fracture, OnThreshold, Release};
use piola_mechanics::kernel::Measure;

use super::balance::Row;
use super::critical::Precision;
use super::verlet::drift;
use super::{BeforeRow, Motion, MotionError, Others};
use crate::march::{Advance, March, State};

/// The critical step is looked at again after so many steps, and at the end: a body that is stretched
/// gets stiffer.
const STEPS_BETWEEN_LOOKS: usize = 1000;

/// How notes of energy from nothing begin.
const CREATED: &str = "breaking creates energy";

/// Which part of the largest column of the account a step must create to be told.
const TOLD: f64 = 1e-9;

/// How exactly it is then: few products.
pub(super) const LOOK: Precision = Precision { tolerance: 1e-2, products: 30 };

impl<O: Others> Motion<'_, O> {
    /// Comes back with [`Advance::Pause`] after so long, between two steps and also between two rows, and
    /// then again.
    pub fn pause_every(&mut self, time: Duration) {
        self.pauses = Some((time, Instant::now()));
    }

    /// Whether this part wants a pause.
    pub(super) fn wants_pause(&self) -> bool {
        self.pauses.is_some_and(|(time, since)| since.elapsed() >= time)
    }

    /// Whether it is time for a pause, which begins the next stretch.
    fn pauses_now(&mut self) -> bool {
        let pauses = std::mem::take(&mut self.is_pause_due);
        if let Some((_, since)) = self.pauses.as_mut().filter(|_| pauses) {
            *since = Instant::now();
        }
        pauses
    }

    /// One step; the energy is worked out where a row is due at its end. It breaks where an end is wanted
    /// before the step is done: then nothing has moved.
    pub(super) fn go(&mut self, wants_row: bool) -> Result<ControlFlow<()>, MotionError> {
        if self.is_implicit() {
            return match self.is_over {
                true => Ok(ControlFlow::Break(())),
                false => self.go_implicitly(wants_row),
            };
        }
        self.done += 1;
        let begun = self.begin_way(self.time(self.done) - 0.5 * self.dt);
        drift(self.dt, &self.v.value, &mut self.u);
        for (&dof, &value) in self.drive.displaced().iter().zip(&self.displacements) {
            self.u.set(dof, value);
        }
        self.others.bring(&mut self.u.value);
        self.foresee_velocities();
        let ready = begun.and_then(|before| self.end_way(before));
        let judged = self.judge_families(ready.is_ok());
        let broken = ready.and(judged).and_then(|()| self.arrive_with_forces(wants_row));
        self.hear_of_stops();
        broken?;
        self.ask_dissipation()?;
        self.kick(wants_row || self.stopped.is_some())?;
        Ok(ControlFlow::Continue(()))
    }

    /// Forces where a step has led, and what breaks there.
    fn arrive_with_forces(&mut self, wants_row: bool) -> Result<(), MotionError> {
        self.ask_loads(false)?;
        let remembers = self.energy.fracture().is_some_and(|fracture| fracture.n_states() > 0);
        if remembers {
            self.change_status(self.dt)?;
        }
        self.ask_forces(wants_row || self.stopped.is_some())?;
        if !remembers {
            self.break_behind_forces(wants_row)?;
        }
        Ok(())
    }

    /// Breaks what has gone too far in a step, where forces are those of the bonds that were there; they are
    /// worked out again if any break.
    fn break_behind_forces(&mut self, wants_row: bool) -> Result<(), MotionError> {
        let Some(fracture) = self.energy.fracture() else { return Ok(()) };
        let released = fracture.advance_behind_forces(&self.u.value, (self.dt, &self.v.value));
        let released = released.map_err(|cause| self.not_finite(cause))?;
        self.tell_ties(fracture);
        if !released.has_changed() {
            return Ok(());
        }
        self.take_in(&released);
        self.ask_forces(wants_row || self.stopped.is_some())
    }

    /// Tells of bonds at their threshold, once.
    fn tell_ties(&mut self, fracture: &dyn Fracture) {
        let is_told = |note: &String| note.contains(OnThreshold::CODE);
        if let Some(found) = fracture.on_threshold()
            && !self.notes.iter().any(is_told)
        {
            self.notes.push(format!("at t = {:e} s {found}", self.time(self.done)));
        }
    }

    /// Takes what bonds leave into the account; where families that end a motion have become too small, this step is the
    /// last.
    fn take_in(&mut self, released: &Release) {
        self.balance.release(released);
        if released.breaks() {
            self.stopped = self.too_small();
        }
        self.left_behind[0] += released.energy;
        self.left_behind[1] += released.dissipated;
    }

    /// Takes energy that comes out of nothing into the account, and tells of it the first time, where so much was
    /// released in a step and dissipated, in J, by all parts.
    pub(super) fn tell_of_gains(&mut self, [released, dissipated]: [f64; 2]) {
        let gained = -(released.min(0.0) + dissipated.min(0.0));
        self.balance.create(gained);
        let is_told = self.notes.iter().any(|note| note.contains(CREATED));
        if gained > TOLD * self.balance.largest() && !is_told {
            let t = self.time(self.done);
            self.notes.push(format!(
                "{CREATED} from t = {t:e} s on, {gained:e} J in a step: families that lose bonds have other \
                 gradients and sums, or what is remembered creates it"
            ));
        }
    }

    /// Breaks what has gone too far in a step, and changes what bonds remember, before forces. Those that go
    /// count as having acted over the last `over` s, up to now: behind an implicit step, over which forces in
    /// its middle count, for none.
    pub(super) fn change_status(&mut self, over: f64) -> Result<(), MotionError> {
        if let Some(fracture) = self.energy.fracture() {
            let released = fracture.advance(&self.u.value, self.dt, (over, &self.v.value));
            let released = released.map_err(|cause| self.not_finite(cause))?;
            self.tell_ties(fracture);
            if released.has_changed() {
                self.take_in(&released);
            }
        }
        Ok(())
    }

    /// Why the motion ends where something has just broken.
    fn too_small(&self) -> Option<MotionError> {
        let families = self.families.failed(self.energy)?;
        Some(MotionError::Singular { t: self.time(self.done), step: self.done, families })
    }

    /// Breaks what has gone too far before anything moves: the account begins behind that. How many bonds, triangles
    /// and tetrahedra of this part do.
    pub(super) fn break_at_start(&mut self) -> Result<[usize; 3], MotionError> {
        let Some(fracture) = self.energy.fracture() else { return Ok([0; 3]) };
        let before = fracture.n_broken();
        let released = fracture.advance(&self.u.value, 0.0, (0.0, &self.v.value));
        released.map_err(|cause| self.not_finite(cause))?;
        self.tell_ties(fracture);
        let now = fracture.n_broken();
        let broken = [0, 1, 2].map(|kind| now[kind] - before[kind]);
        self.too_small().map_or(Ok(broken), Err)
    }

    /// Tells of what broke at the start, in this part and others. Collective.
    pub(super) fn tell_of_start(&mut self, own: [usize; 3]) {
        let mut broken = own.map(|count| count as f64);
        self.others.sum(&mut broken);
        let [bonds, areas, volumes] = broken;
        if bonds > 0.0 {
            self.notes.push(format!(
                "{bonds} bonds break before the first step: the displacements of the start are beyond their \
                 criterion"
            ));
        }
        if areas + volumes > 0.0 {
            self.notes.push(format!(
                "{areas} triangles and {volumes} tetrahedra break before the first step: the displacements \
                 of the start are beyond their criterion"
            ));
        }
    }

    /// Goes to the end of this step, and gives the row there. Where who looks on wants an end, explicit
    /// rules make one more step; an implicit step is given up. Then, and where there is no next step, the
    /// row is that of the last step that was made.
    ///
    /// # Errors
    /// Energies and conditions that are not finite, points that fly off, implicit steps without a
    /// solution.
    pub fn advance_to(&mut self, step: usize) -> Result<Advance<Row>, MotionError> {
        assert!(step >= self.done && step <= self.n_steps, "steps lead on, up to the last");
        if let Some(error) = self.stopped.take() {
            return Err(error);
        }
        if self.is_over {
            return Ok(Advance::Interrupted);
        }
        let first = self.done;
        while self.done < step && !self.is_over && self.stopped.is_none() {
            if self.done > first && self.pauses_now() {
                self.rest()?;
                return Ok(Advance::Pause);
            }
            self.is_over = self.wants_end;
            let before = self.done;
            let went = self.go(self.is_over || self.done + 1 == step);
            match self.meet(went) {
                Ok(ControlFlow::Continue(())) => self.arrived()?,
                Ok(ControlFlow::Break(())) => self.is_over = true,
                Err(error) if self.done == before => self.stopped = Some(error),
                Err(error) => return Err(error),
            }
        }
        if self.done == step {
            return Ok(Advance::Step(self.row()));
        }
        if self.is_at_row() {
            return self.stopped.take().map_or(Ok(Advance::Interrupted), Err);
        }
        if self.is_implicit() {
            self.stand()?;
        }
        self.before_end = Some(BeforeRow { numbers: self.numbers(), n_notes: self.notes.len() });
        Ok(Advance::Step(self.row()))
    }

    /// Leaves behind a step what snapshots hold: implicit steps leave forces in their middle.
    fn rest(&mut self) -> Result<(), MotionError> {
        if !self.is_implicit() {
            return Ok(());
        }
        self.set_parameters_now()?;
        self.ask_forces(false)
    }

    /// At the end of a step.
    fn arrived(&mut self) -> Result<(), MotionError> {
        if self.done.is_multiple_of(STEPS_BETWEEN_LOOKS) || self.done == self.n_steps {
            self.look_again()?;
        }
        Ok(())
    }

    fn look_again(&mut self) -> Result<(), MotionError> {
        if self.is_implicit() {
            return Ok(());
        }
        let found = self.look(LOOK)?;
        // The residual is as large as the tolerance: what errs on the safe side is no reproach.
        let critical =
            found.map_or(f64::INFINITY, |found| found.seconds * (1.0 + found.uncertainty).sqrt());
        if self.dt > critical && self.least_critical >= self.dt {
            let t = self.time(self.done);
            self.notes.push(format!(
                "the body has become stiffer: the step {:e} s is beyond the critical one, \
                 {critical:.4e} s, from t = {t:e} s or earlier",
                self.dt
            ));
        }
        self.least_critical = self.least_critical.min(critical);
        Ok(())
    }

    /// The row of the whole body at the present time. Collective.
    fn row(&mut self) -> Row {
        let of_dof = |(dof, v): (usize, &f64)| 0.5 * self.mass(dof) * v * v;
        let kinetic = self.mean.iter().enumerate().map(of_dof).fold(0.0, |sum, part| sum + part);
        let (linear, angular) = self.momenta();
        let broken = self.energy.fracture().map(|fracture| fracture.n_broken()).unwrap_or_default();
        self.balance.open(total(&self.parts));
        let sums = [
            &[kinetic][..],
            &self.parts,
            &linear,
            &angular,
            &broken.map(|count| count as f64),
            &self.balance.numbers(),
        ];
        let mut sums = sums.concat();
        self.others.sum(&mut sums);
        let (kinetic, rest) = (sums[0], &sums[1..]);
        let (parts, rest) = rest.split_at(self.parts.len());
        let (linear, rest) = rest.split_at(linear.len());
        let (angular, rest) = rest.split_at(angular.len());
        let (broken, balance) = rest.split_at(broken.len());
        let parts = EnergyParts::new(self.energy.parts(), parts.to_vec());
        let changes = self.drive.parameters_change();
        let (step, t) = (self.done, self.time(self.done));
        let mut row = self.balance.row_of(balance, (step, t), (parts, changes), kinetic);
        (row.momentum, row.angular_momentum) = (linear.to_vec(), angular.to_vec());
        row.broken = self.energy.fracture().map(|_| broken[0] as usize);
        row.broken_cliques = [(Measure::Area, 1), (Measure::Volume, 2)].map(|(measure, kind)| {
            self.energy.fracture()?.counts_of(measure).map(|_| broken[kind] as usize)
        });
        if !self.balance.closes(&row) && self.notes.iter().all(|note| !note.contains("account")) {
            self.notes.push(format!(
                "the account of energy does not close at t = {:e} s: {:e} J are left over, of {:e} J",
                row.t,
                row.rounding,
                self.balance.largest()
            ));
        }
        row
    }

    /// Linear and angular momentum.
    fn momenta(&self) -> (Vec<f64>, Vec<f64>) {
        let d = self.energy.dimension();
        let (mut linear, mut angular) = (vec![0.0; d], vec![0.0; if d == 2 { 1 } else { 3 }]);
        let rest = self.energy.positions();
        for (point, mass) in self.masses.iter().enumerate() {
            let range = point * d..(point + 1) * d;
            let v = &self.mean[range.clone()];
            let x: Vec<f64> = range.map(|dof| rest[dof] + self.u.value[dof]).collect();
            (0..d).for_each(|axis| linear[axis] += mass * v[axis]);
            let turn = |a: usize, b: usize| mass * (x[a] * v[b] - x[b] * v[a]);
            if d == 2 {
                angular[0] += turn(0, 1);
            } else {
                (0..3).for_each(|axis| angular[axis] += turn((axis + 1) % 3, (axis + 2) % 3));
            }
        }
        (linear, angular)
    }

    /// The step of the first row behind so many steps.
    fn row_behind(&self, done: usize) -> usize {
        let rows = self.settings.rows.clamp(1, self.n_steps) as u128;
        let (done, all) = (done as u128, self.n_steps as u128);
        let next = done * rows / all + 1;
        (next * all).div_ceil(rows).min(all) as usize
    }

    /// The step at which the next row is due.
    pub(super) fn next_row(&self) -> usize {
        self.row_behind(self.done)
    }

    /// Whether there is a row at the present step.
    fn is_at_row(&self) -> bool {
        self.done == 0 || self.row_behind(self.done - 1) == self.done
    }
}

impl<O: Others> March for Motion<'_, O> {
    type Step = Row;
    type Stop = MotionError;

    /// Goes to the next row.
    fn advance(&mut self) -> Result<Advance<Row>, MotionError> {
        if self.done == self.n_steps && self.stopped.is_none() {
            return Ok(Advance::End);
        }
        self.advance_to(self.next_row())
    }

    fn state(&self) -> State<'_> {
        State {
            t: self.time(self.done),
            displacements: &self.u.value,
            velocities: &self.mean,
            internal_forces: self.all_forces(),
            loads: &self.loads,
        }
    }
}
