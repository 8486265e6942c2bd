//! The assembled tangent against plain code that leaves out what ours has to do.

use piola_compiler::Measure;
use piola_runtime::assembly::DiscreteEnergy;
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
         runs in turn. In batches: along lists of neighbours, as on clouds. The plain code knows neither \
         displacements nor guards nor energies.",
        ["ours, ns", "plain, ns"],
        Division::OursByTheirs,
    );
    let mut rows = Table::of_ratios(
        "assembly-on-rows",
        "The same passes along the rows of the lattice against those in batches.",
        ["along rows, ns", "in batches, ns"],
        Division::OursByTheirs,
    );
    with_threads(1, || {
        let tables = &mut [&mut table, &mut rows];
        compare(tables, "triangles, 20^3 points", 20, Measure::Area, Plain::triangles);
        compare(tables, "tetrahedra, 12^3 points", 12, Measure::Volume, Plain::tetrahedra);
    });
    vec![table, rows]
}

fn compare(
    [table, on_rows]: &mut [&mut Table; 2],
    what: &str,
    points: usize,
    measure: Measure,
    theirs: fn(&mut Plain) -> u64,
) {
    let body = cube(points);
    let u = displacement(&body);
    let energy = || SethHill::new(1.0).energy(&body, HORIZON, &[measure]);
    let ways = [energy(), energy().in_batches()];
    let mut plain = Plain::new(&body, HORIZON, &u);
    let tangent = BlockMatrix::zeros(ways[0].pattern());
    let mut found = [(vec![0.0; u.len()], tangent.clone()), (vec![0.0; u.len()], tangent)];
    let [first, second] = &mut found;
    let assemble = |energy: &DiscreteEnergy, (gradient, tangent): &mut (Vec<f64>, BlockMatrix)| {
        energy.tangent(&u, gradient, tangent).expect("all is finite");
    };
    let mut count = 0;
    let times = in_turn(
        ROUNDS,
        Clock::Thread,
        [&mut || assemble(&ways[0], first), &mut || assemble(&ways[1], second), &mut || {
            count = theirs(&mut plain)
        }],
    );
    let report = ways[0].report();
    assert_eq!(count, report.triangles + report.tetrahedra, "the same interactions");
    for (gradient, tangent) in &found {
        assert_close("gradient", gradient, plain.gradient.as_flattened());
        assert_close("tangent", &tangent.values, plain.tangent.as_flattened());
    }
    let [ours, batches, theirs] = times.map(|times| times.least() / count as f64 * 1e9);
    let of = Statistic::Least(ROUNDS);
    table.ratio(what, [ours, theirs], of, Bar::AtMost(1.0, 0.55));
    table.ratio(format!("{what}, in batches"), [batches, theirs], of, Bar::None);
    on_rows.ratio(what, [ours, batches], of, Bar::AtMost(0.7, 0.35));
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
