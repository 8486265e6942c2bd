//! What a scene costs: time and memory of every phase, from its energies to the first linear system.

use std::time::Instant;

use piola_mechanics::energy::{Energy, NonFinite, Wanted};
use piola_mechanics::interaction::Report;
use piola_output::summary::{Phase, PhaseClock, memory};
use piola_solvers::HeldTangent;
use piola_solvers::constraint::Constraints;
use piola_solvers::linear::{LinearReport, LinearSolver, Tangent};
use piola_solvers::rigid_modes::check_rigid_motions;
use serde::Serialize;

use super::run;
use crate::case::{Case, CaseError};
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
    /// Passes over all interactions: energy; and gradient; and tangent, or where that is not stored
    /// what preconditions it, and a product with it.
    pub passes: Vec<PassCost>,
    /// Bytes of the tangent, or of springs like it where it is not stored: the blocks on and above
    /// the diagonal.
    pub matrix_bytes: u64,
    /// The linear system; nothing if it cannot be posed or solved.
    pub linear: Option<LinearCost>,
    /// Why there is no linear system, or why the passes were made at rest.
    pub notes: Vec<String>,
    /// Largest memory of the process, in bytes.
    pub peak_memory_bytes: Option<u64>,
}

/// A pass over all interactions.
#[derive(Clone, Debug, Serialize)]
pub struct PassCost {
    /// `energy`, `gradient`, `tangent` or `product`.
    pub name: &'static str,
    /// Wall time in s.
    pub seconds: f64,
    /// The same per interaction, in ns.
    pub nanoseconds_per_interaction: f64,
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

/// Measures a case. `clock` has the phases before this one, that is the reading of the scene.
///
/// The tangent at rest and the conditions of the first increment make the linear system; its
/// solution is the displacement of the passes.
///
/// # Errors
/// What is wrong with the body, the energies or the conditions.
pub fn cost(case: &Case, mut clock: PhaseClock) -> Result<SceneCost, CaseError> {
    clock.enter("compile");
    let compiled = case.compile()?;
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
    Ok(SceneCost {
        threads: rayon::current_num_threads(),
        points: report.n_points,
        unknowns: constraints.n_free(),
        interactions: [report.bonds, report.triangles, report.tetrahedra],
        phases: clock.phases().to_vec(),
        passes: passes.into_iter().map(|(name, seconds)| pass(name, seconds, &report)).collect(),
        matrix_bytes: tangent.bytes(),
        linear,
        notes,
        peak_memory_bytes: memory().map(|memory| memory.peak),
    })
}

fn pass(name: &'static str, seconds: f64, report: &Report) -> PassCost {
    let interactions = (report.bonds + report.triangles + report.tetrahedra).max(1);
    PassCost { name, seconds, nanoseconds_per_interaction: seconds / interactions as f64 * 1e9 }
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
) -> Vec<(&'static str, f64)> {
    let direction = energy.positions().to_vec();
    let (mut product, mut parts) = (vec![0.0; u.len()], vec![0.0; energy.parts().len()]);
    let mut names = vec!["energy", "gradient", "tangent", "product"];
    names.truncate(if tangent.is_stored() { 3 } else { 4 });
    let mut found: Vec<(&'static str, f64)> =
        names.into_iter().map(|name| (name, f64::INFINITY)).collect();
    // Once at `u`; products share it, as in a linear system.
    let hessian = if tangent.is_stored() { None } else { energy.hessian(u).ok() };
    let begin = Instant::now();
    for round in 0..ROUNDS {
        if round > 0 && begin.elapsed().as_secs_f64() > PATIENCE {
            break;
        }
        for (name, least) in &mut found {
            let start = Instant::now();
            // All of it was evaluated at `u` before.
            let _ = match *name {
                "energy" => energy.evaluate(u, Wanted::Energy, &mut parts),
                "gradient" => energy.evaluate(u, Wanted::Forces(gradient), &mut parts),
                "tangent" => tangent.evaluate(u, gradient, &mut parts),
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
