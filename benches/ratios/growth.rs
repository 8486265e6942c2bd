//! How cost grows with points, horizon and threads.

use std::time::Instant;

use piola_compiler::Measure;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;

use crate::clock::{Clock, in_turn};
use crate::ours::{SethHill, cube, displacement, with_threads};
use crate::record::Table;

/// After one that is not counted.
const ROUNDS: usize = 2;

const TRIANGLES: [Measure; 2] = [Measure::Length, Measure::Area];
const TETRAHEDRA: [Measure; 2] = [Measure::Length, Measure::Volume];

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::plain(
        "growth",
        "Cubes, n = 1; *build* finds the neighbours, counts all interactions and lays out the matrix, the other \
         columns are one assembly of gradient and tangent, the less of two; times on the wall in s. Per point the number of bonds \
         goes with the horizon to the third power, of triangles to the sixth, of tetrahedra to the ninth.",
        &[
            "body",
            "horizon",
            "interactions",
            "build, 1 thread",
            "tangent, 1 thread",
            "2 threads",
            "ns per interaction",
            "matrix, MB",
        ],
    );
    for (points, horizon) in [(10, 3.0), (20, 3.0), (30, 3.0), (20, 2.0), (12, 4.0)] {
        measure(&mut table, "C1 + C2", points, horizon, &TRIANGLES);
    }
    for (points, horizon) in [(8, 3.0), (12, 3.0), (16, 3.0), (16, 2.0), (7, 4.0)] {
        measure(&mut table, "C1 + C3", points, horizon, &TETRAHEDRA);
    }
    vec![table]
}

fn measure(table: &mut Table, kinds: &str, points: usize, horizon: f64, measures: &[Measure]) {
    let body = cube(points);
    let u = displacement(&body);
    let law = SethHill::new(1.0);
    let start = Instant::now();
    let energy = with_threads(1, || law.energy(&body, horizon, measures));
    let build = start.elapsed().as_secs_f64();
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let times = [1, 2].map(|threads| {
        let mut assemble = || {
            energy.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
        };
        let [times] = with_threads(threads, || in_turn(ROUNDS, Clock::Wall, [&mut assemble]));
        times.least()
    });
    let report = energy.report();
    let interactions = (report.bonds + report.triangles + report.tetrahedra) as f64;
    table.row([
        format!("{points}^3, {kinds}").into(),
        format!("{horizon}").into(),
        format!("{interactions:.2e}").into(),
        build.into(),
        times[0].into(),
        times[1].into(),
        (times[0] / interactions * 1e9).into(),
        (size_of_val(tangent.values.as_slice()) as f64 * 1e-6).into(),
    ]);
}
