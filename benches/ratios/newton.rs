//! One Newton step: what assembly and solution cost, and what hyper-dual coordinates would.

use std::time::Instant;

use piola_compiler::Measure;
use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::element::Element;
use piola_runtime::energy::Energy;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::{LinearOptions, LinearSolver};
use piola_runtime::weights::Weights;

use crate::assembly::assert_close;
use crate::clock::{Clock, in_turn};
use crate::hyperdual::{HyperDualElement, Linear};
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
         one linear system solved by the default method, in s; each once, after an assembly that is not counted. *Hyper-dual* is our \
         assembly of the same interactions with compiled hyper-dual numbers for their derivatives (see the kernels). The \
         paper's Fig. 3 plots assembly over solution.",
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
        for points in [9, 13, 17, 21] {
            step(&mut table, points);
        }
    });
    vec![table]
}

fn step(table: &mut Table, points: usize) {
    let energy = firooz_cube(points, &KINDS);
    let u = displacement(energy.body());
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    let others = discrete(&cube(points), HORIZON, Weights::Uniform, &KINDS, hyper_dual_element);
    let mut other_gradient = vec![0.0; u.len()];
    let mut other = BlockMatrix::zeros(others.pattern());
    let [assembly, theirs] = in_turn(
        1,
        Clock::Wall,
        [
            &mut || {
                energy.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
            },
            &mut || {
                others.tangent(&u, &mut other_gradient, &mut other).expect("all is finite");
            },
        ],
    )
    .map(|times| times.least());
    assert_close("gradient", &gradient, &other_gradient);
    assert_close("tangent", &tangent.values, &other.values);
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

/// The energies of the cube with compiled hyper-dual numbers.
fn hyper_dual_element(measure: Measure) -> Box<dyn Element> {
    match measure {
        Measure::Length => Box::new(HyperDualElement::<Linear, 3>::new(STIFFNESS[0])),
        Measure::Area => Box::new(HyperDualElement::<Linear, 6>::new(STIFFNESS[1])),
        Measure::Volume => Box::new(HyperDualElement::<Linear, 9>::new(STIFFNESS[2])),
    }
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
