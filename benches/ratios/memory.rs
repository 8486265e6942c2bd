//! Peak memory relative to the matrix, of a process that does nothing else.

use std::process::Command;

use piola_compiler::Measure;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::output::summary::memory;
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::{LinearOptions, LinearSolver};

use crate::newton::{clamped, firooz_cube};
use crate::ours::displacement;
use crate::record::{Bar, Division, Statistic, Table};

/// Set for the process that is measured.
pub(crate) const CHILD: &str = "PIOLA_BENCH_MEMORY";
const POINTS: usize = 30;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "memory",
        "Peak of resident memory of a process that assembles the tangent of 30^3 points, C1 + C3, horizon 3, and \
         then solves one linear system, relative to the stored half of the matrix.",
        ["peak, MB", "matrix, MB"],
        Division::OursByTheirs,
    );
    let program = std::env::current_exe().expect("this program has a path");
    let output = Command::new(program).env(CHILD, "1").output().expect("it is running");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("plain text");
    for line in text.lines() {
        let Some((what, numbers)) = line.split_once(':') else { continue };
        let mut numbers = numbers.split_whitespace().map(|x| x.parse().expect("a number"));
        if let (Some(peak), Some(matrix)) = (numbers.next(), numbers.next()) {
            let mb = |bytes: f64| bytes * 1e-6;
            let bar = Bar::AtMost(2.5, 0.3);
            table.ratio(what, [mb(peak), mb(matrix)], Statistic::Once, bar);
        }
    }
    vec![table]
}

/// Does the work and prints the peaks.
pub(crate) fn child() {
    let energy = firooz_cube(POINTS, &[Measure::Length, Measure::Volume]);
    let u = displacement(energy.body());
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    energy.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
    let matrix = size_of_val(tangent.values.as_slice());
    print_peak("assembled", matrix);
    let constraints = Constraints::new(u.len(), &clamped(energy.body())).expect("ascending");
    let mut solver = LinearSolver::new(
        energy.pattern(),
        energy.body().positions(),
        &constraints,
        LinearOptions::default(),
    )
    .expect("it fits");
    let mut solution = vec![0.0; u.len()];
    let report = solver.solve(&tangent, &gradient, &mut solution).expect("it can be solved");
    print_peak(&format!("and solved by {}", report.method.name()), matrix);
}

fn print_peak(what: &str, matrix: usize) {
    match memory() {
        Some(memory) => println!("{what}: {} {matrix}", memory.peak),
        None => println!("{what}: this system does not tell"),
    }
}
