//! A motion between two steps, to be taken up again with the same bits.

use std::borrow::Cow;

use piola_mechanics::energy::Energy;
use piola_mechanics::fracture::Fracture;
use piola_mechanics::kernel::Measure;

use super::balance::Balance;
use super::others::{Nobody, agreed, flag};
use super::{CriticalStep, Initial, Motion, MotionDrive, MotionError, MotionSettings, Others};
use crate::watch::Watch;

/// Where a motion stands between two steps: all that its next steps rest on.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot<'a> {
    /// One array per name of [`Snapshot::NAMES`]: scalars, then vectors `n x d` in the body's order;
    /// displacements in m, velocities in the middle of the step to come in m/s, each with what rounding
    /// left behind, and `dE/du` in N, by which a body is known again, if they are there; then the numbers of the bonds
    /// that are broken, behind all of these those of triangles that broke themselves, and of tetrahedra; what bonds
    /// remember; and velocities before the last kick, where bonds dissipate.
    pub arrays: [Cow<'a, [f64]>; 9],
    /// What the reader was told so far.
    pub notes: Cow<'a, [String]>,
}

impl Snapshot<'_> {
    /// What its arrays are.
    pub const NAMES: [&'static str; 9] = [
        "numbers",
        "displacements",
        "displacements_low",
        "velocities",
        "velocities_low",
        "forces",
        "broken",
        "states",
        "velocities_before",
    ];

    /// The places of arrays among these.
    pub const NUMBERS: usize = 0;
    /// `dE/du`.
    pub const FORCES: usize = 5;
    /// What is broken.
    pub const BROKEN: usize = 6;
    /// What is remembered.
    pub const STATES: usize = 7;
    /// Empty where nothing dissipates.
    pub const VELOCITIES_BEFORE: usize = 8;
    /// All that are vectors.
    pub const VECTORS: [usize; 6] = [1, 2, 3, 4, Snapshot::FORCES, Snapshot::VELOCITIES_BEFORE];

    /// The numbers of two parts of a body as those of one: sums of the account are added up.
    pub fn add_numbers(numbers: &mut [f64], more: &[f64]) {
        Balance::add_numbers(&mut numbers[N_SCALARS..], &more[N_SCALARS..]);
    }

    /// The numbers of a part of a body of which another part has all sums so far.
    pub fn without_sums(numbers: &[f64]) -> Vec<f64> {
        let (scalars, balance) = numbers.split_at(N_SCALARS);
        [scalars, &Balance::nothing_beside(balance)].concat()
    }
}

/// How many numbers bonds have, triangles with criteria of their own, and tetrahedra.
fn numbers_of(fracture: &dyn Fracture) -> [usize; 3] {
    let [areas, volumes] = CLIQUES.map(|measure| fracture.n_cliques(measure));
    [fracture.n_bonds(), areas, volumes]
}

/// All that is broken, with numbers one behind the other.
fn all_broken(fracture: &dyn Fracture) -> Vec<usize> {
    let [bonds, areas, _] = numbers_of(fracture);
    let mut all = fracture.broken();
    for (measure, first) in CLIQUES.into_iter().zip([bonds, bonds + areas]) {
        all.extend(fracture.broken_cliques(measure).into_iter().map(|number| first + number));
    }
    all
}

/// Takes out what [`all_broken`] told of.
fn take_out_all(fracture: &dyn Fracture, broken: &[usize]) {
    let [bonds, areas, _] = numbers_of(fracture);
    let behind = |first: usize| broken.partition_point(|number| *number < first);
    let (areas_from, volumes_from) = (behind(bonds), behind(bonds + areas));
    fracture.take_out(&broken[..areas_from]);
    let parts =
        [(bonds, &broken[areas_from..volumes_from]), (bonds + areas, &broken[volumes_from..])];
    for (measure, (first, part)) in CLIQUES.into_iter().zip(parts) {
        let numbers: Vec<usize> = part.iter().map(|number| number - first).collect();
        fracture.take_out_cliques(measure, &numbers);
    }
}

/// What may have criteria of its own beside bonds.
const CLIQUES: [Measure; 2] = [Measure::Area, Measure::Volume];

/// Scalars in a snapshot before those of the account.
const N_SCALARS: usize = 9;

impl<'a> Motion<'a> {
    /// Goes on where a motion of the same body, conditions and settings stood: the next bits are
    /// those that it would have had.
    ///
    /// # Errors
    /// As [`Motion::new`]; a snapshot of another motion.
    pub fn resume(
        energy: &'a dyn Energy,
        masses: &[f64],
        drive: &'a dyn MotionDrive,
        settings: &MotionSettings,
        watch: &Watch,
        snapshot: Snapshot<'_>,
    ) -> Result<Motion<'a>, MotionError> {
        Motion::resume_among(&Nobody, energy, masses, drive, settings, watch, snapshot)
    }
}

impl<'a, O: Others> Motion<'a, O> {
    /// The same of a part of a body, as [`Motion::among`] has it: of points that do not count vectors of the snapshot
    /// have zeros. Collective.
    ///
    /// # Errors
    /// As [`Motion::resume`]; [`MotionError::Elsewhere`] where another part has one.
    pub fn resume_among(
        others: &'a O,
        energy: &'a dyn Energy,
        masses: &[f64],
        drive: &'a dyn MotionDrive,
        settings: &MotionSettings,
        watch: &Watch,
        snapshot: Snapshot<'_>,
    ) -> Result<Motion<'a, O>, MotionError> {
        let Snapshot { arrays, notes } = snapshot;
        let arrays = arrays.map(Cow::into_owned);
        let [numbers, u, u_low, v, v_low, forces, broken, states, before] = arrays;
        let placed = || {
            let n = energy.positions().len();
            let is_of_body = [&u, &u_low, &v, &v_low].iter().all(|array| array.len() == n);
            let has_forces = forces.len() == n || forces.is_empty();
            if !is_of_body || !has_forces || numbers.len() != N_SCALARS + Balance::N_NUMBERS {
                return Err(other("its arrays are of another size"));
            }
            let start = Initial { displacements: u, velocities: v };
            let mut motion = Motion::of((energy, others), masses, start, drive, settings, watch)?;
            motion.restore_account(&numbers)?;
            (motion.u.low, motion.v.low) = (u_low, v_low);
            match &mut motion.viscous {
                Some(viscous) if before.len() == n => viscous.earlier = before,
                None if before.is_empty() => {}
                _ => return Err(other("what its bonds dissipate is another")),
            }
            motion.notes = notes.into_owned();
            motion.restore_status(&broken, &states)?;
            Ok(motion)
        };
        let mut motion = agreed(others, placed())?;
        motion.join();
        let known = motion.know_again(&forces);
        agreed(others, known)?;
        // Who looks on may want an end already, of some parts.
        let mut wants_end = [flag(motion.wants_end)];
        others.max(&mut wants_end);
        motion.wants_end = wants_end[0] > 0.0;
        Ok(motion)
    }

    /// Takes what the numbers of a snapshot say.
    fn restore_account(&mut self, numbers: &[f64]) -> Result<(), MotionError> {
        let (scalars, balance) = numbers.split_at(N_SCALARS);
        let &[step, steps, dt, least, seconds, frequency, viscosity, uncertainty, products] =
            scalars
        else {
            return Err(other("its arrays are of another size"));
        };
        if !(dt > 0.0 && step <= steps && self.settings.end / steps == dt) {
            return Err(other("its steps are others"));
        }
        (self.done, self.n_steps, self.dt) = (step as usize, steps as usize, dt);
        self.least_critical = least;
        self.critical = seconds.is_finite().then_some(CriticalStep {
            seconds,
            frequency,
            viscosity,
            uncertainty,
            products: products as usize,
        });
        self.balance = Balance::of(balance);
        Ok(())
    }

    /// Takes out what is broken, and gives back what is remembered.
    fn restore_status(&mut self, broken: &[f64], states: &[f64]) -> Result<(), MotionError> {
        match self.energy.fracture() {
            Some(fracture) => {
                let broken: Vec<usize> = broken.iter().map(|bond| *bond as usize).collect();
                let n: [usize; 3] = numbers_of(fracture);
                let is_beyond = broken.last().is_some_and(|last| *last >= n.iter().sum());
                if is_beyond || states.len() != fracture.states().len() {
                    return Err(other("its bonds are others"));
                }
                take_out_all(fracture, &broken);
                fracture.remember(states);
                Ok(())
            }
            None if broken.is_empty() => Ok(()),
            None => Err(other("bonds of it are broken")),
        }
    }

    /// Works out forces, which are to be these if there are any, and what drives the next step.
    fn know_again(&mut self, forces: &[f64]) -> Result<(), MotionError> {
        self.set_parameters_now()?;
        self.ask_forces(false)?;
        let is_same = |(dof, (one, other)): (usize, (&f64, &f64))| {
            !self.counts(dof) || one.to_bits() == other.to_bits()
        };
        if !self.forces.iter().zip(forces).enumerate().all(is_same) {
            return Err(other("the forces of this body are others at its displacements"));
        }
        self.ask_loads(true)?;
        if self.done < self.n_steps {
            self.ask_displacements(self.time(self.done + 1))?;
        }
        Ok(())
    }

    /// Whether a degree of freedom is of a point that counts.
    fn counts(&self, dof: usize) -> bool {
        self.energy.counted().contains(&(dof / self.energy.dimension()))
    }
}

fn other(what: &'static str) -> MotionError {
    MotionError::OtherMotion { what }
}

impl<O> Motion<'_, O> {
    /// Where the motion stands. If it was ended between two rows, the row there is none that
    /// it would have had, and the snapshot knows nothing of it.
    pub fn snapshot(&self) -> Snapshot<'_> {
        let before = self.before_end.as_ref();
        let numbers = before.map_or_else(|| self.numbers(), |before| before.numbers.clone());
        let n_notes = before.map_or(self.notes.len(), |before| before.n_notes);
        let vectors = [&self.u.value, &self.u.low, &self.v.value, &self.v.low, &self.forces];
        let [u, u_low, v, v_low, forces] = vectors.map(|vector| Cow::Borrowed(&vector[..]));
        let notes = Cow::Borrowed(&self.notes[..n_notes]);
        let fracture = self.energy.fracture();
        let broken = fracture.map(all_broken).unwrap_or_default();
        let broken = Cow::Owned(broken.into_iter().map(|bond| bond as f64).collect());
        let states = Cow::Owned(fracture.map(|fracture| fracture.states()).unwrap_or_default());
        let numbers = Cow::Owned(numbers);
        let before = self.viscous.as_ref().map_or(&[][..], |viscous| &viscous.earlier);
        let before = Cow::Borrowed(before);
        let arrays = [numbers, u, u_low, v, v_low, forces, broken, states, before];
        Snapshot { arrays, notes }
    }

    /// Whether the motion was ended between two rows.
    pub fn is_between_rows(&self) -> bool {
        self.before_end.is_some()
    }

    /// Scalars of a snapshot.
    pub(super) fn numbers(&self) -> Vec<f64> {
        let critical = self.critical.map_or([f64::NAN; 5], |found| {
            let CriticalStep { seconds, frequency, viscosity, uncertainty, products } = found;
            [seconds, frequency, viscosity, uncertainty, products as f64]
        });
        let (step, steps) = (self.done as f64, self.n_steps as f64);
        let mut numbers = vec![step, steps, self.dt, self.least_critical];
        numbers.extend(critical);
        assert_eq!(numbers.len(), N_SCALARS, "as many as are read");
        numbers.extend(self.balance.numbers());
        numbers
    }
}
