//! Dynamic relaxation: the equilibrium as the rest of a damped motion with masses that nobody has.
//!
//! Points get the masses that make all of them about equally fast, those of the diagonal of the
//! Hessian, and the longest step that is stable with these, from exact products (`motion/critical`). The
//! damping is critical for the slowest part that still moves: twice its frequency, by Rayleigh's
//! quotient of the last step and the change of the forces along it (Underwood 1983; Kilic and Madenci,
//! Theor. Appl. Fract. Mech. 53, 2010). No linear system is solved and no tangent stored.

use piola_mechanics::energy::{EnergyParts, NonFinite, Wanted};

use super::{History, Newton, NewtonError, NewtonFailure, NewtonReport};
use crate::clock::timed;
use crate::motion::{CriticalStep, Precision};

/// The part of the critical step that is taken.
const SAFETY: f64 = 0.9;

/// How exactly the critical step is known.
const PRECISION: Precision = Precision { tolerance: 1e-2, products: 60 };

/// Steps between two looks at masses and critical step: large strains change both.
const STEPS_BETWEEN_LOOKS: usize = 500;

/// Steps between two entries of the history.
const STEPS_PER_ENTRY: usize = 100;

/// A residual so many times as large as the least tells of a step beyond the critical one.
const GROWN: f64 = 100.0;

/// How often a step is halved after it was too long.
const MOST_HALVINGS: usize = 20;

/// Steps without a smaller residual before it is compared with rounding.
const PATIENCE: usize = 2000;

/// What a motion with masses of its own goes by.
struct Pace {
    /// Per point, in N/m: the time has no unit.
    masses: Vec<f64>,
    step: f64,
}

/// A body on its way to rest.
struct Way {
    pace: Pace,
    /// In m: the time has no unit.
    v: Vec<f64>,
    /// `dE/du` before the last step, in N.
    before: Vec<f64>,
    /// Where the residual was least, that residual in N, and how many steps ago.
    best: Vec<f64>,
    least: f64,
    since: usize,
    /// How often the step was halved, and what part of it is left.
    halvings: usize,
    part: f64,
}

impl Way {
    fn new(u: &[f64], gradient: &[f64], pace: Pace) -> Way {
        Way {
            pace,
            v: vec![0.0; u.len()],
            before: gradient.to_vec(),
            best: u.to_vec(),
            least: f64::INFINITY,
            since: 0,
            halvings: 0,
            part: 1.0,
        }
    }

    fn note(&mut self, u: &[f64], residual: f64) {
        self.since += 1;
        if residual < self.least {
            (self.least, self.since) = (residual, 0);
            self.best.copy_from_slice(u);
        }
    }

    /// Whether it is time to ask why the residual falls no more.
    fn is_stuck(&self) -> bool {
        self.since > 0 && self.since.is_multiple_of(PATIENCE)
    }

    fn step(&self) -> f64 {
        self.part * self.pace.step
    }
}

impl Newton<'_> {
    /// Moves the free entries of `u` to equilibrium with `loads` (both `n x d`), in at most so many
    /// steps. The history has every hundredth of them. After a failure `u` is undefined.
    ///
    /// # Errors
    /// As [`Newton::solve`].
    pub fn relax(
        &mut self,
        u: &mut [f64],
        loads: &[f64],
        most: usize,
    ) -> Result<NewtonReport, NewtonError> {
        let mut history = History::default();
        match self.relaxed(u, loads, most, &mut history) {
            Ok(report) => Ok(NewtonReport { history, ..report }),
            Err(failure) => Err(NewtonError { failure, history }),
        }
    }

    fn relaxed(
        &mut self,
        u: &mut [f64],
        loads: &[f64],
        most: usize,
        history: &mut History,
    ) -> Result<NewtonReport, NewtonFailure> {
        self.forces_alone(u)?;
        let pace = self.pace(u)?;
        let mut way = Way::new(u, &self.gradient, pace);
        let mut done = 0;
        loop {
            let (residual, force) = (self.residual_norm(loads), self.force(loads));
            let is_stuck = way.is_stuck() && self.is_rounding(u, residual)?;
            let converged =
                residual <= self.settings.tolerance * force || (is_stuck && force <= residual);
            if done % STEPS_PER_ENTRY == 0 || converged || is_stuck {
                history.residual.push(residual);
                let ratio = if residual == 0.0 { 0.0 } else { residual / force };
                history.residual_over_reaction.push(ratio);
                self.tell(done, history);
            }
            if converged {
                return self.at_rest(u, loads, done);
            }
            if is_stuck {
                let floor = super::ROUNDING_MULTIPLE * self.rounding();
                let (tolerance, within) = (self.settings.tolerance, floor / force);
                return Err(NewtonFailure::RoundingFloor { residual, floor, tolerance, within });
            }
            if done == most {
                return Err(NewtonFailure::Iterations { limit: most });
            }
            if self.watch.wants_end() {
                return Err(NewtonFailure::Interrupted);
            }
            way.note(u, residual);
            let has_grown = residual > GROWN * way.least && way.halvings < MOST_HALVINGS;
            if has_grown {
                self.go_back(u, &mut way)?;
            }
            if has_grown || (done > 0 && done % STEPS_BETWEEN_LOOKS == 0) {
                way.pace = self.pace(u)?;
            }
            self.move_on(u, loads, &mut way);
            if let Err(problem) = self.forces_alone(u) {
                if way.halvings == MOST_HALVINGS {
                    return Err(problem.into());
                }
                self.go_back(u, &mut way)?;
            }
            done += 1;
        }
    }

    /// Back to the best state, at rest, and on with a step of half the length.
    fn go_back(&mut self, u: &mut [f64], way: &mut Way) -> Result<(), NewtonFailure> {
        way.halvings += 1;
        way.part *= 0.5;
        u.copy_from_slice(&way.best);
        way.v.fill(0.0);
        Ok(self.forces_alone(u)?)
    }

    /// `dE/du` at `u` without the energy, which nobody asks for on the way.
    fn forces_alone(&mut self, u: &[f64]) -> Result<(), NonFinite> {
        self.evaluated_at = None;
        self.rounding.set(None);
        self.counters.gradients += 1;
        let (energy, gradient) = (self.energy, &mut self.gradient);
        let wanted = Wanted::Forces(gradient);
        timed(&mut self.times.assembly, || energy.evaluate(u, wanted, &mut []))
    }

    /// One step of the motion.
    fn move_on(&self, u: &mut [f64], loads: &[f64], way: &mut Way) {
        let (d, dt) = (self.energy.dimension(), way.step());
        let damped = 0.5 * dt * self.damping(way);
        let (kept, pushed) = ((1.0 - damped) / (1.0 + damped), dt / (1.0 + damped));
        way.before.copy_from_slice(&self.gradient);
        for &dof in self.constraints.free() {
            let push = (loads[dof] - self.gradient[dof]) / way.pace.masses[dof / d];
            way.v[dof] = kept * way.v[dof] + pushed * push;
            u[dof] += dt * way.v[dof];
        }
    }

    /// Whether a residual is no more than what rounding the displacements makes of the forces.
    fn is_rounding(&mut self, u: &[f64], residual: f64) -> Result<bool, NewtonFailure> {
        self.evaluate(u, true)?;
        Ok(residual <= super::ROUNDING_MULTIPLE * self.rounding())
    }

    fn at_rest(
        &mut self,
        u: &[f64],
        loads: &[f64],
        iterations: usize,
    ) -> Result<NewtonReport, NewtonFailure> {
        // Products that say how exactly forces are known.
        self.evaluate(u, true)?;
        Ok(NewtonReport {
            iterations,
            history: History::default(),
            energy: EnergyParts::new(self.energy.parts(), self.parts.clone()),
            linear: Vec::new(),
            step_lengths: Vec::new(),
            rounding_floor: self.rounding_floor(loads),
            notes: Vec::new(),
        })
    }

    /// Masses and step at `u`.
    fn pace(&mut self, u: &[f64]) -> Result<Pace, NewtonFailure> {
        let d = self.energy.dimension();
        let mut diagonal = vec![0.0; u.len() * d];
        let (mut forces, mut parts) = (vec![0.0; u.len()], vec![0.0; self.parts.len()]);
        let wanted = Wanted::Diagonal(&mut forces, &mut diagonal);
        self.counters.tangents += 1;
        let energy = self.energy;
        timed(&mut self.times.assembly, || energy.evaluate(u, wanted, &mut parts))?;
        let block = |own: &[f64]| {
            let row = |row: &[f64]| row.iter().fold(0.0, |sum, x| sum + x.abs());
            own.chunks_exact(d).map(row).fold(0.0, f64::max)
        };
        let mut masses: Vec<f64> = diagonal.chunks_exact(d * d).map(block).collect();
        // A point that nothing holds here may be held elsewhere.
        let largest = masses.iter().fold(0.0_f64, |most, x| most.max(*x));
        let least = if largest > 0.0 { 1e-3 * largest } else { 1.0 };
        masses.iter_mut().for_each(|mass| *mass = mass.max(least));
        let constraints = &self.constraints;
        let critical = timed(&mut self.times.linear, || {
            CriticalStep::find(energy, u, &masses, constraints, PRECISION)
        })?;
        // Without stiffness any step is as good as another.
        let step = SAFETY * critical.map_or(1.0, |found| found.seconds);
        Ok(Pace { masses, step })
    }

    /// Twice the frequency of what moves: along the last step, `v.dg/dt` over `v.M v`.
    fn damping(&self, way: &Way) -> f64 {
        let (d, Way { pace, v, before, .. }) = (self.energy.dimension(), way);
        let (mut change, mut inertia) = (0.0, 0.0);
        for &dof in self.constraints.free() {
            change += v[dof] * (self.gradient[dof] - before[dof]);
            inertia += pace.masses[dof / d] * v[dof] * v[dof];
        }
        let squared = change / (way.step() * inertia);
        if !(squared > 0.0 && squared.is_finite()) {
            return 0.0;
        }
        // No more than what stops a step at once.
        (2.0 * squared.sqrt()).min(2.0 * SAFETY / way.step())
    }
}
