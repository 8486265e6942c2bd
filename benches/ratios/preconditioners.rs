//! What a linear system costs: Cholesky, and conjugate gradients with either preconditioner.

use std::time::Instant;

use piola_compiler::Measure;
use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::{
    LinearMethod, LinearOptions, LinearReport, LinearSolver, PreconditionerChoice,
};
use piola_runtime::weights::Weights;

use crate::newton::STIFFNESS_PER_K3;
use crate::ours::{SethHill, cube, discrete, with_threads};
use crate::record::Table;

/// How often a solve by iterations is repeated.
const ROUNDS: usize = 5;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::plain(
        "preconditioners",
        format!(
            "Cubes at rest with a horizon of three spacings, clamped at one face, n = 1, one thread: a system solved to \
             1e-10 for a right-hand side without pattern, without what is done once per body (the ordering). \
             Conjugate gradients: least of {ROUNDS}; Cholesky: once."
        ),
        &[
            "body",
            "tangent, MB",
            "method",
            "iterations",
            "preparation, s",
            "solution, s",
            "Cholesky / this",
        ],
    );
    with_threads(1, || {
        compare(&mut table, "8^3 points, bonds", 8, 0.0);
        compare(&mut table, "10^3 points, bonds", 10, 0.0);
        compare(&mut table, "20^3 points, bonds", 20, 0.0);
        compare(&mut table, "14^3 points, k3 = 26", 14, 26.0);
    });
    vec![table]
}

/// A cube of unit spacing at rest; `k3 = C3 horizon^8/C1`.
fn at_rest(side: usize, k3: f64) -> (DiscreteEnergy, BlockMatrix, Constraints) {
    let kinds: &[Measure] = match k3 {
        0.0 => &[Measure::Length],
        _ => &[Measure::Length, Measure::Volume],
    };
    // Without tetrahedra their stiffness is not looked at.
    let law = SethHill::with_stiffness(1.0, [1.0, 0.0, k3.max(1.0) * STIFFNESS_PER_K3]);
    let energy =
        discrete(&cube(side), 3.0, Weights::Uniform, kinds, |measure| law.element(measure));
    let u = vec![0.0; energy.body().positions().len()];
    let mut matrix = BlockMatrix::zeros(energy.pattern());
    energy.tangent(&u, &mut u.clone(), &mut matrix).expect("the body at rest is finite");
    let fixed: Vec<usize> =
        (0..u.len()).filter(|dof| energy.body().position(dof / 3)[0] < 0.5).collect();
    let constraints = Constraints::new(u.len(), &fixed).expect("the list ascends");
    (energy, matrix, constraints)
}

fn compare(table: &mut Table, name: &str, side: usize, k3: f64) {
    let (energy, matrix, constraints) = at_rest(side, k3);
    let mut state = 1u64;
    let rhs: Vec<f64> = (0..constraints.n_dofs())
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        })
        .collect();
    let methods = [
        ("Cholesky", LinearMethod::Cholesky, PreconditionerChoice::Auto),
        ("block Jacobi", LinearMethod::Cg, PreconditionerChoice::BlockJacobi),
        ("two levels", LinearMethod::Cg, PreconditionerChoice::TwoLevel),
    ];
    let mut direct = None;
    for (method_name, method, preconditioner) in methods {
        let runs = if method == LinearMethod::Cholesky { 1 } else { ROUNDS };
        let options = LinearOptions {
            method,
            preconditioner,
            cg_tolerance: 1e-10,
            ..LinearOptions::default()
        };
        let positions = energy.body().positions();
        let mut solver = LinearSolver::new(&matrix.pattern, positions, &constraints, options)
            .expect("there is enough memory");
        let (prepared, solved, report) = fastest(&mut solver, &matrix, &rhs, runs);
        let total = prepared + solved;
        let direct = *direct.get_or_insert(total);
        table.row([
            name.into(),
            (matrix.values.len() as f64 * 8e-6).into(),
            method_name.into(),
            report.iterations.to_string().into(),
            prepared.into(),
            solved.into(),
            (direct / total).into(),
        ]);
    }
}

/// The fastest run: preparation (factors or preconditioner) and solution in s. What is done once per
/// pattern is left out by a run before.
fn fastest(
    solver: &mut LinearSolver,
    matrix: &BlockMatrix,
    rhs: &[f64],
    runs: usize,
) -> (f64, f64, LinearReport) {
    let mut x = vec![0.0; rhs.len()];
    let mut best: Option<(f64, f64, LinearReport)> = None;
    if runs > 1 {
        solver.solve(matrix, rhs, &mut x).expect("the tangent is definite");
    }
    for _ in 0..runs {
        let start = Instant::now();
        solver.factorize(matrix).expect("the tangent is definite");
        let prepared = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let report = solver.solve_factorized(matrix, rhs, &mut x).expect("it is definite");
        let solved = start.elapsed().as_secs_f64();
        if best.as_ref().is_none_or(|(p, s, _)| prepared + solved < p + s) {
            best = Some((prepared, solved, report));
        }
    }
    best.expect("there is at least one run")
}
