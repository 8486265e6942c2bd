//! One Newton step: what assembly and solution cost, and what hyper-dual coordinates would.

use std::time::Instant;

use piola_compiler::Measure;
use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::energy::TotalEnergy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::{LinearOptions, LinearSolver};
use piola_runtime::weights::Weights;

use crate::clock::{Clock, in_turn};
use crate::ours::{SethHill, cube, discrete, displacement, with_threads};
use crate::record::Table;

const KINDS: [Measure; 2] = [Measure::Length, Measure::Volume];
const HORIZON: f64 = 3.0;
/// C3 for `k3 = C3 delta^8/C1 = 1` at this horizon and C1 = 1.
pub(crate) const STIFFNESS_PER_K3: f64 = 1.0 / 6561.0;
/// firooz2023, Fig. 6.
const STIFFNESS: [f64; 3] = [1.0, 0.0, 1.7 * STIFFNESS_PER_K3];

pub(crate) fn run() -> Vec<Table> {
    let mut table = Table::plain(
        "newton",
        "Cube of firooz2023, Fig. 6 (k3 = 1.7), C1 + C3, n = 1, horizon 3, one thread: the tangent assembled and \
         one linear system solved by the default method, in s. *Hyper-dual* is `derivatives = \
         \"hyperdual-coordinates\"`, scaled from 4^3 points with horizon 2 by the number of interactions. The paper's \
         Fig. 3 plots assembly over solution.",
        &[
            "unknowns",
            "assembly",
            "solution",
            "by",
            "assembly/solution",
            "share of assembly",
            "hyper-dual assembly",
            "over solution",
            "Newton step, times faster",
        ],
    );
    with_threads(1, || {
        let hyper_dual = hyper_dual_interaction();
        for points in [9, 13, 17, 21] {
            step(&mut table, points, hyper_dual);
        }
    });
    vec![table]
}

fn step(table: &mut Table, points: usize, hyper_dual: f64) {
    let energy = firooz_cube(points, &KINDS);
    let u = displacement(energy.body());
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let mut assembly = f64::INFINITY;
    for _ in 0..2 {
        let start = Instant::now();
        energy.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
        assembly = assembly.min(start.elapsed().as_secs_f64());
    }
    let constraints = Constraints::new(u.len(), &clamped(energy.body())).expect("ascending");
    let mut solution = vec![0.0; u.len()];
    let start = Instant::now();
    let mut solver = LinearSolver::new(
        energy.pattern(),
        energy.body().positions(),
        &constraints,
        LinearOptions::default(),
    )
    .expect("it fits");
    let report = solver.solve(&tangent, &gradient, &mut solution).expect("it can be solved");
    let solve = start.elapsed().as_secs_f64();
    let theirs = hyper_dual * interactions(&energy);
    table.row([
        u.len().to_string().into(),
        assembly.into(),
        solve.into(),
        report.method.name().into(),
        (assembly / solve).into(),
        format!("{:.1} %", 100.0 * assembly / (assembly + solve)).into(),
        theirs.into(),
        (theirs / solve).into(),
        ((theirs + solve) / (assembly + solve)).into(),
    ]);
}

/// Seconds that an interaction takes with hyper-dual coordinates, from a body that is small enough.
fn hyper_dual_interaction() -> f64 {
    let material = SethHill::with_stiffness(1.0, STIFFNESS);
    let element = |measure| material.coordinate_element(measure);
    let energy = discrete(&cube(4), 2.0, Weights::Uniform, &KINDS, element);
    let u = displacement(energy.body());
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let mut run = || {
        energy.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
    };
    let [times] = in_turn(3, Clock::Wall, [&mut run]);
    times.least() / interactions(&energy)
}

fn interactions(energy: &DiscreteEnergy) -> f64 {
    (energy.report().bonds + energy.report().tetrahedra) as f64
}

/// The cube of firooz2023, Fig. 6, with `points^3` points a unit apart.
pub(crate) fn firooz_cube(points: usize, measures: &[Measure]) -> DiscreteEnergy {
    let material = SethHill::with_stiffness(1.0, STIFFNESS);
    let element = |measure| material.element(measure);
    discrete(&cube(points), HORIZON, Weights::Uniform, measures, element)
}

/// All components of the points of the first and the last layer.
pub(crate) fn clamped(body: &Body) -> Vec<usize> {
    let last = body.positions().iter().fold(0.0, |last: f64, x| last.max(*x));
    let on_face = |point: &usize| [0.0, last].contains(&body.position(*point)[0]);
    (0..body.n_points()).filter(on_face).flat_map(|point| 3 * point..3 * point + 3).collect()
}
