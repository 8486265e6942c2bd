//! The assembled tangent against plain code that leaves out what ours has to do.

use piola_compiler::Measure;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;

use crate::clock::{Clock, in_turn};
use crate::ours::{SethHill, cube, displacement, with_threads};
use crate::plain::Plain;
use crate::record::{Bar, Division, Statistic, Table};

const ROUNDS: usize = 5;
const HORIZON: f64 = 3.0;

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::of_ratios(
        "assembly",
        "Gradient and tangent of n = 1 per interaction, horizon 3, one thread, time of the thread; \
         runs in turn. The plain code knows neither displacements nor guards nor energies.",
        ["ours, ns", "plain, ns"],
        Division::OursByTheirs,
    );
    with_threads(1, || {
        compare(&mut table, "triangles, 20^3 points", 20, Measure::Area, Plain::triangles);
        compare(&mut table, "tetrahedra, 12^3 points", 12, Measure::Volume, Plain::tetrahedra);
    });
    vec![table]
}

fn compare(
    table: &mut Table,
    what: &str,
    points: usize,
    measure: Measure,
    theirs: fn(&mut Plain) -> u64,
) {
    let body = cube(points);
    let u = displacement(&body);
    let energy = SethHill::new(1.0).energy(&body, HORIZON, &[measure]);
    let mut plain = Plain::new(&body, HORIZON, &u);
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let mut count = 0;
    let mut ours = || {
        energy.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
    };
    let mut reference = || count = theirs(&mut plain);
    let [ours, theirs] = in_turn(ROUNDS, Clock::Thread, [&mut ours, &mut reference]);
    let report = energy.report();
    assert_eq!(count, report.triangles + report.tetrahedra, "the same interactions");
    assert_close("gradient", &gradient, plain.gradient.as_flattened());
    assert_close("tangent", &tangent.values, plain.tangent.as_flattened());
    let each = |seconds: f64| seconds / count as f64 * 1e9;
    let (ours, theirs) = (each(ours.least()), each(theirs.least()));
    table.ratio(what, [ours, theirs], Statistic::Least(ROUNDS), Bar::AtMost(1.0, 0.55));
}

/// Both compute the same, to rounding.
pub(crate) fn assert_close(what: &str, found: &[f64], expected: &[f64]) {
    let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
    let apart = norm(&mut found.iter().zip(expected).map(|(f, e)| f - e));
    let size = norm(&mut expected.iter().copied());
    assert!(
        found.len() == expected.len() && apart <= 1e-11 * size,
        "{what}: {apart:e} of {size:e}"
    );
}
