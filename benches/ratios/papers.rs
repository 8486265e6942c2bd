//! The assembled tangent against the papers' way: ordered loops over the neighbours of every point,
//! second derivatives by hyper-dual numbers.

mod ordered;

use piola_compiler::Measure;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;

use crate::assembly::assert_close;
use crate::clock::{Clock, in_turn};
use crate::ours::{SethHill, cube, displacement, with_threads};
use crate::record::{Bar, Division, Statistic, Table};
use ordered::Ordered;

const ROUNDS: usize = 3;
const HORIZON: f64 = 3.0;
const KINDS: [Measure; 2] = [Measure::Length, Measure::Volume];

pub(crate) fn run() -> Vec<Table> {
    with_threads(1, || {
        check();
        let mut table = Table::of_ratios(
            "papers",
            "Energy, gradient and tangent of bonds and tetrahedra, n = 1, on one thread, in ms per point far from \
             the surface. Theirs: every point, its ordered neighbours and triples of neighbours (2 visits of a \
             bond, 24 of a tetrahedron), one pass of compiled hyper-dual numbers per entry of the compact tangent \
             (eight interactions side by side, as in `kernels`), added to a dense matrix; measured on the middle point of 7^3 (a body takes some minutes). Ours: whole \
             cubes, time per interaction times the interactions of a point of the bulk; of 12^3 points an eighth are \
             no nearer to a face than the horizon, of 20^3 a third.",
            ["ours, ms", "ordered loops, ms"],
            Division::TheirsByOurs,
        );
        compare(&mut table);
        vec![table]
    })
}

fn compare(table: &mut Table) {
    let middle = cube(7);
    let mut theirs = Ordered::new(&middle, HORIZON, &displacement(&middle));
    let point = theirs.middle();
    for side in [12, 20] {
        let body = cube(side);
        let u = displacement(&body);
        let energy = SethHill::new(1.0).energy(&body, HORIZON, &KINDS);
        let mut gradient = vec![0.0; u.len()];
        let mut tangent = BlockMatrix::zeros(energy.pattern());
        let mut ours = || {
            energy.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
        };
        let mut visits = (0, 0);
        let mut visit = || visits = theirs.visit(point);
        let [ours, theirs] = in_turn(ROUNDS, Clock::Thread, [&mut ours, &mut visit]);
        // Every unordered interaction is visited once per order of its corners.
        let per_point = visits.0 as f64 / 2.0 + visits.1 as f64 / 24.0;
        let report = energy.report();
        let each = ours.least() / (report.bonds + report.tetrahedra) as f64;
        let (ours, theirs) = (each * per_point * 1e3, theirs.least() * 1e3);
        let (of, bar) = (Statistic::Least(ROUNDS), Bar::AtLeast(900.0, 2000.0));
        table.ratio(format!("C1 + C3, horizon 3, {side}^3 points"), [ours, theirs], of, bar);
    }
}

/// Both ways give one tangent on a body that is small enough.
fn check() {
    let body = cube(4);
    let u = displacement(&body);
    let horizon = 1.8;
    let energy = SethHill::new(1.0).energy(&body, horizon, &KINDS);
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    energy.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
    let mut ordered = Ordered::new(&body, horizon, &u);
    for point in 0..body.n_points() {
        ordered.visit(point);
    }
    let n = u.len();
    let mut dense = vec![0.0; n * n];
    for (row, column, value) in tangent.entries() {
        dense[row * n + column] = value;
    }
    assert_close("gradient", &gradient, &ordered.sums.gradient);
    assert_close("tangent", &dense, &ordered.sums.tangent);
}
