//! What a linear system costs: Cholesky, and conjugate gradients with either preconditioner.
//!
//! `cargo bench -p piola-runtime --bench solvers` prints a table. Bodies are cubes with a horizon of
//! three spacings, clamped at one face, with Seth-Hill energies of n = 1; systems are solved to 1e-10
//! for a right-hand side without pattern. The rows of one body run in turn in one process, iterations
//! several times, and the fastest is shown; Cholesky runs once, without its ordering.

use std::sync::Arc;
use std::time::Instant;

use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::energy::TotalEnergy;
use piola_runtime::kernel::{Batch, Law, Order, Outputs};
use piola_runtime::lattice::{Lattice, Nodes};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::{
    LinearMethod, LinearOptions, LinearReport, LinearSolver, PreconditionerChoice,
};
use piola_runtime::weights::Weights;

/// How often a solve by iterations is repeated.
const RUNS: usize = 5;

fn main() {
    println!("| body | tangent MB | method | iterations | preparation, s | solution, s | ratio |");
    println!("|---|---|---|---|---|---|---|");
    compare("8^3 points, bonds", 8, 0.0);
    compare("10^3 points, bonds", 10, 0.0);
    compare("20^3 points, bonds", 20, 0.0);
    compare("14^3 points, k3 = 26", 14, 26.0);
}

/// `psi = C/2 M (m/M - 1)^2`.
fn linear(c: f64) -> Option<Box<dyn Law>> {
    if c == 0.0 {
        return None;
    }
    Some(Box::new(move |batch: Batch<'_>, order: Order, out: Outputs<'_>| {
        for p in 0..batch.change.len() {
            out.psi[p] = 0.5 * c * batch.reference[p] * batch.change[p] * batch.change[p];
            if order >= Order::Gradient {
                out.dpsi[p] = c * batch.change[p];
            }
            if order == Order::Tangent {
                out.d2psi[p] = c / batch.reference[p];
            }
        }
    }))
}

/// A cube of unit spacing at rest; `k3 = C3 horizon^8/C1`.
fn tangent(side: usize, k3: f64) -> (Arc<Body>, BlockMatrix, Constraints) {
    let upper = vec![(side - 1) as f64; 3];
    let lattice = Lattice { lower: vec![0.0; 3], upper, spacing: 1.0, nodes: Nodes::Corners };
    let points = lattice.points().expect("the box is a multiple of the spacing");
    let body = Arc::new(Body::new(3, &points.positions, &points.volumes, Some(1.0)));
    let horizon: f64 = 3.0;
    let c3 = k3 / libm::pow(horizon, 8.0);
    let laws = Laws { bond: linear(1.0), tetrahedron: linear(c3), ..Laws::default() };
    let energy = DiscreteEnergy::new(Arc::clone(&body), horizon, Weights::Uniform, laws)
        .expect("a cube can be assembled");
    let u = vec![0.0; body.positions().len()];
    let mut matrix = BlockMatrix::zeros(energy.pattern());
    energy.tangent(&u, &mut u.clone(), &mut matrix).expect("the body at rest is finite");
    let fixed: Vec<usize> = (0..u.len()).filter(|dof| body.position(dof / 3)[0] < 0.5).collect();
    let constraints = Constraints::new(u.len(), &fixed).expect("the list ascends");
    (body, matrix, constraints)
}

fn compare(name: &str, side: usize, k3: f64) {
    let (body, matrix, constraints) = tangent(side, k3);
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
        let runs = if method == LinearMethod::Cholesky { 1 } else { RUNS };
        let options = LinearOptions {
            method,
            preconditioner,
            cg_tolerance: 1e-10,
            ..LinearOptions::default()
        };
        let pattern = &matrix.pattern;
        let mut solver = LinearSolver::new(pattern, body.positions(), &constraints, options)
            .expect("there is enough memory");
        let (prepared, solved, report) = fastest(&mut solver, &matrix, &rhs, runs);
        let total = prepared + solved;
        let direct = *direct.get_or_insert(total);
        println!(
            "| {name} | {:.0} | {method_name} | {} | {prepared:.3} | {solved:.3} | {:.1} |",
            matrix.values.len() as f64 * 8e-6,
            report.iterations,
            direct / total
        );
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
