//! One linear system in three dimensions against faer's Cholesky factorisation.

use std::time::Instant;

use piola_compiler::Measure;
use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::{LinearMethod, LinearOptions, LinearReport, LinearSolver};
use piola_runtime::weights::Weights;

use crate::newton::{STIFFNESS_PER_K3, clamped};
use crate::ours::{SethHill, cube, discrete, displacement, with_threads};
use crate::record::{Bar, Division, Statistic, Table};

const POINTS: usize = 20;
const HORIZON: f64 = 3.0;
const TOLERANCE: f64 = 1e-10;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "solve",
        "20^3 points (24,000 unknowns), horizon 3, two faces held, one thread: a system with the tangent at rest \
         solved to 1e-10 by the default method, set-up included, against faer's Cholesky factorisation.",
        ["ours, s", "Cholesky, s"],
        Division::TheirsByOurs,
    );
    with_threads(1, || {
        compare(&mut table, "bonds", 0.0);
        compare(&mut table, "C1 + C3, k3 = 26", 26.0);
    });
    vec![table]
}

fn compare(table: &mut Table, what: &str, k3: f64) {
    let (kinds, c3): (&[Measure], f64) = match k3 {
        0.0 => (&[Measure::Length], 1.0),
        _ => (&[Measure::Length, Measure::Volume], k3 * STIFFNESS_PER_K3),
    };
    let material = SethHill::with_stiffness(1.0, [1.0, 0.0, c3]);
    let element = |measure| material.element(measure);
    let energy = discrete(&cube(POINTS), HORIZON, Weights::Uniform, kinds, element);
    let u = displacement(energy.body());
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    // The tangent at rest is positive definite; the right-hand side is that of strains of some percent.
    let at_rest = vec![0.0; u.len()];
    energy.tangent(&at_rest, &mut gradient, &mut tangent).expect("all is finite");
    energy.forces(&u, &mut gradient).expect("all is finite");
    let (theirs, _) = solve(&energy, &tangent, &gradient, LinearMethod::Cholesky);
    let (ours, report) = solve(&energy, &tangent, &gradient, LinearMethod::Auto);
    let what = format!(
        "{what}, {}, {} iterations, residual {:.1e}",
        report.method.name(),
        report.iterations,
        report.relative_residual
    );
    table.ratio(what, [ours, theirs], Statistic::Once, Bar::AtLeast(15.0, 30.0));
}

fn solve(
    energy: &DiscreteEnergy,
    tangent: &BlockMatrix,
    rhs: &[f64],
    method: LinearMethod,
) -> (f64, LinearReport) {
    let options = LinearOptions { method, cg_tolerance: TOLERANCE, ..LinearOptions::default() };
    let constraints = Constraints::new(rhs.len(), &clamped(energy.body())).expect("ascending");
    let mut solution = vec![0.0; rhs.len()];
    let start = Instant::now();
    let mut solver =
        LinearSolver::new(energy.pattern(), energy.body().positions(), &constraints, options)
            .expect("it fits");
    let report = solver.solve(tangent, rhs, &mut solution).expect("it can be solved");
    (start.elapsed().as_secs_f64(), report)
}
