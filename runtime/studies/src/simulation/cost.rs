//! What a scene costs: time and memory of every phase, from its energies to the first linear system, or to
//! the steps of a motion.

use std::time::Instant;

use piola_mechanics::energy::{Energy, NonFinite, Wanted};
use piola_mechanics::interaction::Report;
use piola_mechanics::words::Words;
use piola_output::summary::{Phase, PhaseClock, memory};
use piola_solvers::HeldTangent;
use piola_solvers::constraint::Constraints;
use piola_solvers::linear::{LinearReport, LinearSolver, Tangent};
use piola_solvers::rigid_modes::check_rigid_motions;
use serde::Serialize;

use super::run;
use super::work::{Pass, Terms, Work};
use crate::case::{Case, CaseError};
use crate::machine::Rates;
use crate::scene::DerivativeSource;
use crate::scene::boundary::BoundaryConditions;

/// Runs of every pass over the interactions; the least time counts.
const ROUNDS: usize = 5;

/// Passes end early after so many seconds.
const PATIENCE: f64 = 10.0;

/// What a scene costs.
#[derive(Clone, Debug, Serialize)]
pub struct SceneCost {
    /// How many threads worked.
    pub threads: usize,
    /// Points.
    pub points: usize,
    /// Displacement components that are solved for.
    pub unknowns: usize,
    /// Bonds, triangles and tetrahedra that were visited.
    pub interactions: [u64; 3],
    /// Time and memory, in the order of the work.
    pub phases: Vec<Phase>,
    /// How passes go over the body and get derivatives: `compiled batches`, `interpreter families`.
    pub ways: Vec<String>,
    /// What so many threads of this machine can do.
    pub rates: Rates,
    /// Passes over all interactions: energy; and gradient; and tangent, or where that is not stored
    /// what preconditions it, and a product with it. Of a motion forces alone, loads that depend on time,
    /// and all of a step.
    pub passes: Vec<PassCost>,
    /// Bytes of the tangent, or of springs like it where it is not stored: the blocks on and above
    /// the diagonal.
    pub matrix_bytes: u64,
    /// The linear system; nothing if it cannot be posed or solved.
    pub linear: Option<LinearCost>,
    /// How a motion goes; nothing of equilibria.
    pub motion: Option<MotionCost>,
    /// Why there is no linear system, why the passes were made at rest, why a motion did not go on.
    pub notes: Vec<String>,
    /// Largest memory of the process, in bytes.
    pub peak_memory_bytes: Option<u64>,
}

/// The steps of a motion.
#[derive(Clone, Debug, Serialize)]
pub struct MotionCost {
    /// The rule of integration.
    pub method: &'static str,
    /// The step in s.
    pub step_seconds: f64,
    /// The critical one at the start in s; nothing without stiffness.
    pub critical_step_seconds: Option<f64>,
    /// How many lead to the end.
    pub steps: usize,
    /// What they take together, in s, as far as steps could be timed.
    pub wall_seconds: Option<f64>,
}

/// A pass over all interactions.
#[derive(Clone, Debug, Serialize)]
pub struct PassCost {
    /// Which one.
    pub name: Pass,
    /// Wall time in s.
    pub seconds: f64,
    /// The same per interaction, in ns.
    pub nanoseconds_per_interaction: f64,
    /// Bytes that it reads and writes at least: every array that it needs once.
    pub bytes: f64,
    /// Multiply-adds that it makes at least: those of its geometry, not of its energy densities.
    pub multiply_adds: f64,
    /// `bytes` over those that the memory moves in the time; above 1 where caches hold them.
    pub share_of_bandwidth: f64,
    /// `multiply_adds` over those that the processors make in the time at most.
    pub share_of_arithmetic: f64,
}

/// The linear system of the first step.
#[derive(Clone, Debug, Serialize)]
pub struct LinearCost {
    /// Which method gave the solution.
    pub method: &'static str,
    /// Iterations of conjugate gradients.
    pub iterations: usize,
    /// `norm(K x - b)/norm(b)`.
    pub relative_residual: f64,
    /// Bytes of the factor's values, where there is a factor.
    pub factor_bytes: Option<u64>,
    /// Fallbacks and what caused them.
    pub notes: Vec<String>,
}

/// Measures a case. `clock` has the phases before this one, that is the reading of the scene; `rates`, asked
/// at the end, are those of as many threads as work: to measure them takes memory.
///
/// The tangent at rest and the conditions of the first increment make the linear system; its
/// solution is the displacement of the passes.
///
/// # Errors
/// What is wrong with the body, the energies or the conditions.
pub fn cost(
    case: &Case,
    mut clock: PhaseClock,
    rates: impl FnOnce() -> Rates,
) -> Result<SceneCost, CaseError> {
    if let Some(scene) = &case.scene.motion {
        return super::motion::cost(case, scene, clock, rates);
    }
    clock.enter("compile");
    let compiled = case.compile()?;
    let terms = Terms::of(case, &compiled);
    clock.enter("interactions");
    let energy = &case.energy(compiled)? as &dyn Energy;
    clock.enter("conditions");
    let posed = Posed::new(case, energy)?;
    clock.enter("linear system: set up");
    let solver = posed.solver(case, energy);
    let stored = match &solver {
        Ok(solver) => solver.stores_matrix(),
        Err(_) => energy.bond_pattern().is_none(),
    };
    clock.enter("tangent at rest");
    let describe = |found| CaseError::Body { message: case.describe(&found) };
    let mut tangent = HeldTangent::new(energy, stored);
    let rhs = posed.right_hand_side(energy, &mut tangent).map_err(describe)?;
    let Posed { constraints, mut moved, .. } = posed;
    let (mut gradient, mut parts) = (vec![0.0; moved.len()], vec![0.0; energy.parts().len()]);
    let mut notes = Vec::new();
    let solved = solver.and_then(|solver| {
        let tangent = tangent.tangent().map_err(|found| case.describe(&found))?;
        solve(solver, tangent, &rhs, &mut moved, &mut clock)
    });
    clock.leave();
    let linear = match solved {
        Ok(report) => Some(report),
        Err(reason) => {
            notes.push(format!("no linear system was solved: {reason}"));
            None
        }
    };
    if linear.is_none() || tangent.evaluate(&moved, &mut gradient, &mut parts).is_err() {
        notes.push("the passes are at rest".to_string());
        moved.fill(0.0);
    }
    let passes = passes(energy, &moved, &mut gradient, &mut tangent);
    let report = energy.report();
    let matrix_bytes = tangent.bytes();
    let work = |pass| terms.work(pass, energy, &report, matrix_bytes);
    let common = SceneCost::of(case, &report, &passes, &work, rates);
    Ok(SceneCost {
        unknowns: constraints.n_free(),
        phases: clock.phases().to_vec(),
        matrix_bytes,
        linear,
        notes,
        ..common
    })
}

impl SceneCost {
    /// What equilibria and motions have in common; `passes` have the least times in s, `rates` is asked
    /// last.
    pub(super) fn of(
        case: &Case,
        report: &Report,
        passes: &[(Pass, f64)],
        work: &dyn Fn(Pass) -> Work,
        rates: impl FnOnce() -> Rates,
    ) -> SceneCost {
        let peak_memory_bytes = memory().map(|memory| memory.peak);
        let rates = rates();
        let derivatives = match case.scene.solver.derivatives {
            DerivativeSource::Jit => "compiled",
            other => other.word(),
        };
        let interactions = (report.bonds + report.triangles + report.tetrahedra).max(1);
        let pass = |(name, seconds): &(Pass, f64)| {
            let (name, seconds, work) = (*name, *seconds, work(*name));
            PassCost {
                name,
                seconds,
                nanoseconds_per_interaction: seconds / interactions as f64 * 1e9,
                bytes: work.bytes,
                multiply_adds: work.multiply_adds,
                share_of_bandwidth: work.bytes / (seconds * rates.bandwidth),
                share_of_arithmetic: work.multiply_adds / (seconds * rates.arithmetic),
            }
        };
        SceneCost {
            threads: rayon::current_num_threads(),
            points: report.n_points,
            unknowns: 0,
            interactions: [report.bonds, report.triangles, report.tetrahedra],
            phases: Vec::new(),
            passes: passes.iter().map(pass).collect(),
            rates,
            ways: report.ways.iter().map(|way| named(way, derivatives)).collect(),
            matrix_bytes: 0,
            linear: None,
            motion: None,
            notes: Vec::new(),
            peak_memory_bytes,
        }
    }
}

/// How passes go over the body, and by which derivatives; affine laws in rows and in fours need none.
fn named(way: &str, derivatives: &str) -> String {
    if ["rows", "fours"].contains(&way) { way.to_string() } else { format!("{derivatives} {way}") }
}

/// The linear system of the first increment, from rest.
struct Posed {
    constraints: Constraints,
    /// Displacements with what is prescribed, 0 elsewhere, in m.
    moved: Vec<f64>,
    loads: Vec<f64>,
}

impl Posed {
    fn new(case: &Case, energy: &dyn Energy) -> Result<Posed, CaseError> {
        let selection = case.selection()?;
        let boundary = BoundaryConditions::new(&case.scene, &case.body, &selection)?;
        let n_dofs = energy.positions().len();
        let constraints = Constraints::new(n_dofs, boundary.fixed_dofs())?;
        let first = case.scene.steps.end / case.scene.steps.increments.max(1) as f64;
        let mut moved = vec![0.0; n_dofs];
        let prescribed = boundary.prescribed(first)?;
        constraints.scatter_fixed(&prescribed, &mut moved);
        let loads = boundary.loads(first)?;
        Ok(Posed { constraints, moved, loads })
    }

    /// The solver that a run would take; the reason if there is none.
    fn solver(&self, case: &Case, energy: &dyn Energy) -> Result<LinearSolver, String> {
        check_rigid_motions(energy.bonds(), case.body.positions(), &self.constraints)
            .map_err(|error| error.to_string())?;
        let options = run::settings(&case.scene).linear;
        LinearSolver::of_energy(energy, &self.constraints, options)
            .map_err(|error| error.to_string())
    }

    /// Loads minus forces at rest and those of what is prescribed, in N; evaluates the tangent at
    /// rest.
    fn right_hand_side(
        &self,
        energy: &dyn Energy,
        tangent: &mut HeldTangent<'_>,
    ) -> Result<Vec<f64>, NonFinite> {
        let rest = vec![0.0; self.moved.len()];
        let (mut gradient, mut forced) = (rest.clone(), rest.clone());
        energy.hessian(&rest)?.multiply(&self.moved, &mut forced);
        tangent.evaluate(&rest, &mut gradient, &mut vec![0.0; energy.parts().len()])?;
        let force = |dof: usize| self.loads[dof] - gradient[dof] - forced[dof];
        Ok((0..rest.len()).map(force).collect())
    }
}

/// Adds the solution of the first linear system to `moved`; the reason if there is none.
fn solve(
    mut solver: LinearSolver,
    tangent: Tangent<'_>,
    rhs: &[f64],
    moved: &mut [f64],
    clock: &mut PhaseClock,
) -> Result<LinearCost, String> {
    clock.enter("linear system: prepare");
    solver.factorize(tangent).map_err(|error| error.to_string())?;
    clock.enter("linear system: solve");
    let mut solution = vec![0.0; rhs.len()];
    let report =
        solver.solve_factorized(tangent, rhs, &mut solution).map_err(|error| error.to_string())?;
    for (u, step) in moved.iter_mut().zip(&solution) {
        *u += step;
    }
    Ok(linear_cost(report))
}

fn linear_cost(report: LinearReport) -> LinearCost {
    LinearCost {
        method: report.method.name(),
        iterations: report.iterations,
        relative_residual: report.relative_residual,
        factor_bytes: report.factor_nonzeros.map(|n| (n * size_of::<f64>()) as u64),
        notes: report.notes,
    }
}

/// The least times of passes in turn, in s.
fn passes(
    energy: &dyn Energy,
    u: &[f64],
    gradient: &mut [f64],
    tangent: &mut HeldTangent<'_>,
) -> Vec<(Pass, f64)> {
    let direction = energy.positions().to_vec();
    let (mut product, mut parts) = (vec![0.0; u.len()], vec![0.0; energy.parts().len()]);
    let mut found = Pass::OF_EQUILIBRIA.map(|pass| (pass, f64::INFINITY)).to_vec();
    found.truncate(if tangent.is_stored() { 3 } else { 4 });
    // Once at `u`; products share it, as in a linear system.
    let hessian = if tangent.is_stored() { None } else { energy.hessian(u).ok() };
    let begin = Instant::now();
    for round in 0..ROUNDS {
        if round > 0 && begin.elapsed().as_secs_f64() > PATIENCE {
            break;
        }
        for (pass, least) in &mut found {
            let start = Instant::now();
            // All of it was evaluated at `u` before.
            let _ = match pass {
                Pass::Energy => energy.evaluate(u, Wanted::Energy, &mut parts),
                Pass::Gradient => energy.evaluate(u, Wanted::Forces(gradient), &mut parts),
                Pass::Tangent => tangent.evaluate(u, gradient, &mut parts),
                _ => {
                    hessian.iter().for_each(|hessian| hessian.multiply(&direction, &mut product));
                    Ok(())
                }
            };
            *least = least.min(start.elapsed().as_secs_f64());
        }
    }
    found
}
