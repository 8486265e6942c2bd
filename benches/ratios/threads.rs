//! Two threads against one.

use piola_compiler::Measure;
use piola_runtime::energy::TotalEnergy;
use piola_runtime::matrix::BlockMatrix;

use crate::clock::{Clock, in_turn};
use crate::ours::{SethHill, cube, displacement, with_threads};
use crate::table::{Bar, head, row};

const ROUNDS: usize = 4;

pub(crate) fn run() {
    head(
        "Two threads",
        "Assembled gradient and tangent; time on the wall, medians of runs in turn.",
        "2 threads, s",
        "1 thread, s",
    );
    measure("triangles, 30^3 points", 30, Measure::Area);
    measure("tetrahedra, 16^3 points", 16, Measure::Volume);
}

fn measure(what: &str, points: usize, measure: Measure) {
    let body = cube(points);
    let u = displacement(&body);
    let energy = SethHill::new(1.0).energy(&body, 3.0, &[measure]);
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let mut first = || {
        with_threads(1, || energy.tangent(&u, &mut gradient, &mut tangent).map(drop))
            .expect("all is finite");
    };
    let mut second_gradient = vec![0.0; u.len()];
    let mut second_tangent = BlockMatrix::zeros(energy.pattern());
    let mut second = || {
        with_threads(2, || energy.tangent(&u, &mut second_gradient, &mut second_tangent).map(drop))
            .expect("all is finite");
    };
    let [one, two] = in_turn(ROUNDS, Clock::Wall, [&mut first, &mut second]);
    assert!(tangent.values == second_tangent.values, "the same bits for any number of threads");
    let ratio = one.median() / two.median();
    row(what, two.median(), one.median(), ratio, Bar::AtLeast(1.8, 1.95));
}
