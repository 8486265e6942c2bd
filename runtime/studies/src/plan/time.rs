//! How long a run takes.

use piola_solvers::linear::{Choice, LinearMethod};
use serde::Serialize;

use super::{FactorEstimate, InteractionCount, matrix_bytes};
use crate::machine::Machine;

/// Assembling the energy, gradient and tangent of one bond, triangle or tetrahedron on one core, in s: in batches
/// through kernels, and without them.
const ASSEMBLY_SECONDS: [[f64; 2]; 3] = [[10e-9, 10e-9], [55e-9, 38e-9], [50e-9, 24e-9]];

/// A product with the tangent that is not stored, the same way.
const PRODUCT_SECONDS: [[f64; 2]; 3] = [[20e-9, 4e-9], [40e-9, 11e-9], [150e-9, 7e-9]];

/// Finding one bond and placing its block in the matrix, in s.
const BOND_SETUP_SECONDS: f64 = 150e-9;

/// How much of a further thread's arithmetic adds to the speed of assembly.
const THREAD_GAIN: f64 = 0.7;

/// Operations of sparse Cholesky over those of a dense one in the same time; it does not gain from threads.
const FACTOR_SHARE_2D: f64 = 0.45;
const FACTOR_SHARE_3D: f64 = 0.67;

/// Work of LU over that of Cholesky.
pub(super) const LU_WORK: f64 = 4.0;

/// Bytes of a matrix in an iteration over those of a triad in the same time: 0.4 to 1 for matrices of
/// 5 to 60 MB.
const MATRIX_SHARE: f64 = 0.75;

/// Iterations of conjugate gradients to 1e-10 with block Jacobi: so many per horizon that fits into
/// the body's longest side (126 for 7 horizons in 3D, 442 for 33 in 2D).
const CG_ITERATIONS_PER_HORIZON: f64 = 16.0;
const CG_ITERATIONS: f64 = 20.0;

/// The same with two levels, for bodies of any size: 27 for bonds in 3D, 60 for a nearly
/// incompressible cube. The coarse system takes half as long as a product with the matrix.
const TWO_LEVEL_ITERATIONS: f64 = 50.0;
const COARSE_TIME: f64 = 0.5;

/// Newton iterations that an increment usually takes.
const NEWTON_ITERATIONS: f64 = 5.0;

/// How fast the machine is, as far as times depend on it. Those of interactions do little: with registers of
/// half the width they take 1.00 to 1.13 times as long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Bytes per s of a triad of all threads.
    bandwidth: f64,
    /// Operations per s of a dense Cholesky factorisation.
    factorisation: f64,
    /// How many times the arithmetic of one thread all of them have.
    gain: f64,
}

impl Pace {
    /// Of so many threads of a machine.
    pub fn of(machine: &Machine, threads: usize) -> Pace {
        let (one, all) = (machine.rates(1), machine.rates(threads));
        let gain = all.arithmetic / one.arithmetic;
        Pace { bandwidth: all.bandwidth, factorisation: machine.factorisation, gain }
    }

    /// Of so many threads of the machine that other constants were measured on, a server's processor with
    /// AVX-512: for a plan that need not be more exact.
    pub fn usual(threads: usize) -> Pace {
        Pace { bandwidth: 14e9, factorisation: 4.5e10, gain: threads.max(1) as f64 }
    }

    /// How much faster assembly is than on one thread.
    pub(super) fn speed(self) -> f64 {
        1.0 + THREAD_GAIN * (self.gain - 1.0)
    }

    /// One Cholesky factorisation, in s.
    pub(super) fn factorisation(self, factor: FactorEstimate, dimension: usize) -> f64 {
        let share = if dimension == 2 { FACTOR_SHARE_2D } else { FACTOR_SHARE_3D };
        factor.flops / (share * self.factorisation)
    }
}

/// Time by phase, in s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TimeEstimate {
    /// Finding neighbours and laying out the matrix; and, where a stored tangent took over, all until its
    /// first system was solved.
    pub setup: f64,
    /// Energy, forces and tangent, per Newton iteration.
    pub assembly: f64,
    /// The linear system, per Newton iteration.
    pub linear: f64,
    /// An increment with all its Newton iterations, line searches and cut-backs.
    pub increment: f64,
    /// All of it.
    pub total: f64,
    /// What it rests on.
    pub basis: Basis,
}

/// What a time rests on, from the least sure to the surest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Basis {
    /// Counts, and 5 Newton iterations per increment.
    Estimate,
    /// The first Newton iterations of the run.
    Iterations,
    /// The first increment of the run.
    Increment,
}

/// The first increment of a run, as far as it was solved.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FirstIncrement {
    /// Newton iterations that were finished, those that a cut-back threw away among them.
    pub iterations: usize,
    /// Products with the tangent.
    pub products: usize,
    /// How often the increment was halved.
    pub cut_backs: usize,
    /// Time of energies, forces and tangents, in s.
    pub assembly: f64,
    /// Time of linear systems, in s.
    pub linear: f64,
    /// Time of line searches, in s.
    pub line_search: f64,
    /// What part of the increment was reached: 1 where all of it was solved.
    pub solved: f64,
    /// Why no equilibrium was found, if none was.
    pub failure: Option<String>,
    /// When a stored tangent took over from products, if one did.
    pub stored: Option<ChangeOver>,
}

/// A stored tangent took over from products.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChangeOver {
    /// Why, in words.
    pub reason: String,
    /// Newton iterations that were finished by then.
    pub iterations: usize,
    /// Time until the first system with it was solved, in s.
    pub seconds: f64,
}

/// The passes over bonds, triangles and tetrahedra.
#[derive(Clone, Copy, Debug)]
pub(super) struct Passes {
    counts: [u64; 3],
    /// How many energies of each there are.
    energies: [usize; 3],
    /// Whether they need no kernels: see [`super::PlanInput::without_kernels`].
    without_kernels: [bool; 3],
}

impl Passes {
    pub(super) fn new(
        found: &InteractionCount,
        energies: [usize; 3],
        without_kernels: [bool; 3],
    ) -> Passes {
        let counts = [found.bonds, found.triangles, found.tetrahedra];
        Passes { counts, energies, without_kernels }
    }

    /// Energies, forces and tangents once on one core, in s.
    pub(super) fn assembly(self) -> f64 {
        self.seconds(ASSEMBLY_SECONDS)
    }

    /// A product with the tangent that is not stored on one core, in s.
    pub(super) fn product(self) -> f64 {
        self.seconds(PRODUCT_SECONDS)
    }

    /// Whether products take less than those with a stored tangent: of bonds alone, without kernels.
    fn are_quick(self) -> bool {
        self.without_kernels[0] && self.energies[1..] == [0; 2]
    }

    fn seconds(self, of_one: [[f64; 2]; 3]) -> f64 {
        let of_kind = |kind: usize| {
            let seconds = of_one[kind][usize::from(self.without_kernels[kind])];
            self.counts[kind] as f64 * self.energies[kind] as f64 * seconds
        };
        (0..3).map(of_kind).sum()
    }
}

impl TimeEstimate {
    /// `horizons` that fit into the body's longest side decide how conjugate gradients converge; `None` with two
    /// levels, where they do not.
    pub(super) fn new(
        passes: Passes,
        (dimension, blocks): (usize, f64),
        linear: &Choice,
        factor: FactorEstimate,
        horizons: Option<f64>,
        pace: Pace,
    ) -> TimeEstimate {
        let assembly = passes.assembly() / pace.speed();
        let iterations =
            horizons.map(|horizons| CG_ITERATIONS + CG_ITERATIONS_PER_HORIZON * horizons);
        let linear = match linear.method {
            LinearMethod::Cholesky => pace.factorisation(factor, dimension),
            LinearMethod::Lu => LU_WORK * pace.factorisation(factor, dimension),
            _ => {
                let matrix = matrix_bytes(dimension, blocks).0 / (MATRIX_SHARE * pace.bandwidth);
                let product = match linear.stores_matrix {
                    true if !passes.are_quick() => matrix,
                    _ => passes.product() / pace.speed(),
                };
                let coarse = if linear.stores_matrix { COARSE_TIME * matrix } else { 0.0 };
                match iterations {
                    Some(iterations) => iterations * product,
                    None => TWO_LEVEL_ITERATIONS * (product + coarse),
                }
            }
        };
        let setup = passes.counts[0] as f64 * BOND_SETUP_SECONDS;
        TimeEstimate::per_iteration(setup, assembly, linear)
    }

    /// With the usual Newton iterations.
    pub(super) fn per_iteration(setup: f64, assembly: f64, linear: f64) -> TimeEstimate {
        let increment = NEWTON_ITERATIONS * (assembly + linear);
        TimeEstimate { setup, assembly, linear, increment, total: 0.0, basis: Basis::Estimate }
    }

    /// With every increment like the first.
    pub(super) fn for_increments(self, increments: usize) -> TimeEstimate {
        TimeEstimate { total: self.setup + increments as f64 * self.increment, ..self }
    }

    /// With what was seen of the first increment. `stored` is what a Newton iteration is estimated to take
    /// with a stored tangent that may take over: assembly and linear system.
    pub(super) fn of(
        self,
        first: &FirstIncrement,
        stored: Option<(f64, f64)>,
        increments: usize,
    ) -> TimeEstimate {
        let time = match &first.stored {
            Some(change) => {
                self.after(change, first, stored.unwrap_or((self.assembly, self.linear)))
            }
            None => self.throughout(first),
        };
        time.for_increments(increments)
    }

    /// With one method for the whole run.
    fn throughout(self, first: &FirstIncrement) -> TimeEstimate {
        let FirstIncrement { iterations, assembly, linear, line_search, solved, .. } = *first;
        let all = assembly + linear + line_search;
        let n = iterations.max(1) as f64;
        let (basis, increment) = match (solved > 0.0, iterations) {
            (true, _) => (Basis::Increment, all / solved),
            // What is left of a linear system nobody knows: at least as much again is taken.
            (false, 0) => (Basis::Iterations, NEWTON_ITERATIONS * (assembly + 2.0 * linear)),
            (false, _) => (Basis::Iterations, all / n * NEWTON_ITERATIONS.max(n + 1.0)),
        };
        let linear = if iterations == 0 { 2.0 * linear } else { linear / n };
        TimeEstimate { assembly: assembly / n, linear, increment, basis, ..self }
    }

    /// With a stored tangent from some iteration of the first increment on: what went before is taken once,
    /// and every increment has as many iterations as the first, all of them like those after.
    fn after(
        self,
        change: &ChangeOver,
        first: &FirstIncrement,
        (assembly, linear): (f64, f64),
    ) -> TimeEstimate {
        let n = first.iterations as f64;
        let all = first.assembly + first.linear + first.line_search;
        let seen = (first.iterations - change.iterations.min(first.iterations)) as f64;
        let estimated = assembly + linear;
        let iteration = if seen > 0.0 { (all - change.seconds) / seen } else { estimated };
        let (basis, increment) = match first.solved > 0.0 {
            true => (Basis::Increment, iteration * n / first.solved),
            false => (Basis::Iterations, iteration * NEWTON_ITERATIONS.max(n + 1.0)),
        };
        let setup = self.setup + change.seconds;
        let part = iteration / estimated;
        let (assembly, linear) = (assembly * part, linear * part);
        TimeEstimate { setup, assembly, linear, increment, basis, ..self }
    }
}
