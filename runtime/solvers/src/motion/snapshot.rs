//! A motion between two steps, to be taken up again with the same bits.

use std::borrow::Cow;

use piola_mechanics::energy::Energy;
use piola_mechanics::fracture::Fracture;
use piola_mechanics::kernel::Measure;

use super::balance::Balance;
use super::others::Nobody;
use super::{CriticalStep, Initial, Motion, MotionDrive, MotionError, MotionSettings};
use crate::watch::Watch;

/// Where a motion stands between two steps: all that its next steps rest on.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot<'a> {
    /// One array per name of [`Snapshot::NAMES`]: scalars, then vectors `n x d` in the body's order;
    /// displacements in m, velocities in the middle of the step to come in m/s, each with what rounding
    /// left behind, and `dE/du` in N, by which a body is known again; then the numbers of the bonds that are
    /// broken, behind all of these those of triangles that broke themselves, and of tetrahedra; what bonds
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
}

/// How many numbers bonds have, triangles with criteria of their own, and tetrahedra.
fn numbers_of(fracture: &dyn Fracture) -> [usize; 3] {
    let [areas, volumes] =
        CLIQUES.map(|measure| fracture.counts_of(measure).map_or(0, |counts| counts[0]));
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
        let n = energy.positions().len();
        let Snapshot { arrays, notes } = snapshot;
        let arrays = arrays.map(Cow::into_owned);
        let [numbers, u, u_low, v, v_low, forces, broken, states, before] = arrays;
        let is_of_body = [&u, &u_low, &v, &v_low, &forces].iter().all(|array| array.len() == n);
        let other = |what| MotionError::OtherMotion { what };
        if !is_of_body || numbers.len() != N_SCALARS + Balance::N_NUMBERS {
            return Err(other("its arrays are of another size"));
        }
        let start = Initial { displacements: u, velocities: v };
        let mut motion = Motion::of((energy, &Nobody), masses, start, drive, settings, watch)?;
        motion.join();
        (motion.u.low, motion.v.low) = (u_low, v_low);
        match &mut motion.viscous {
            Some(viscous) if before.len() == n => viscous.earlier = before,
            None if before.is_empty() => {}
            _ => return Err(other("what its bonds dissipate is another")),
        }
        motion.notes = notes.into_owned();
        let (scalars, balance) = numbers.split_at(N_SCALARS);
        let &[step, steps, dt, least, seconds, frequency, viscosity, uncertainty, products] =
            scalars
        else {
            return Err(other("its arrays are of another size"));
        };
        if !(dt > 0.0 && step <= steps && settings.end / steps == dt) {
            return Err(other("its steps are others"));
        }
        (motion.done, motion.n_steps, motion.dt) = (step as usize, steps as usize, dt);
        motion.least_critical = least;
        motion.critical = seconds.is_finite().then_some(CriticalStep {
            seconds,
            frequency,
            viscosity,
            uncertainty,
            products: products as usize,
        });
        motion.balance = Balance::of(balance);
        match energy.fracture() {
            Some(fracture) => {
                let broken: Vec<usize> = broken.iter().map(|bond| *bond as usize).collect();
                let n: [usize; 3] = numbers_of(fracture);
                let is_beyond = broken.last().is_some_and(|last| *last >= n.iter().sum());
                if is_beyond || states.len() != fracture.states().len() {
                    return Err(other("its bonds are others"));
                }
                take_out_all(fracture, &broken);
                fracture.remember(&states);
            }
            None if broken.is_empty() => {}
            None => return Err(other("bonds of it are broken")),
        }
        motion.set_parameters_now()?;
        motion.ask_forces(false)?;
        let bits = |(one, other): (&f64, &f64)| one.to_bits() == other.to_bits();
        if !motion.forces.iter().zip(&forces).all(bits) {
            return Err(other("the forces of this body are others at its displacements"));
        }
        motion.ask_loads(true)?;
        if motion.done < motion.n_steps {
            motion.ask_displacements(motion.time(motion.done + 1))?;
        }
        Ok(motion)
    }
}

impl<O> Motion<'_, O> {
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
