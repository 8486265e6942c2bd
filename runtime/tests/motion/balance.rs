//! The account of energy, order, momenta and bits with real energies.

use std::sync::Arc;

use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::energy::Energy;
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::{Advance, March};
use piola_runtime::solve::motion::{Initial, Motion, MotionSettings, Row};
use piola_runtime::weights::Weights;

use crate::bonds::{self, Random, laws};
use crate::{Conditions, families};

fn go(motion: &mut Motion<'_>, step: usize) -> Row {
    match motion.advance_to(step).unwrap() {
        Advance::Step(row) => row,
        _ => panic!("nobody looks on"),
    }
}

fn norm_of_change(now: &[f64], then: &[f64]) -> f64 {
    bonds::norm(&now.iter().zip(then).map(|(x, y)| x - y).collect::<Vec<_>>())
}

/// A chain of unit masses and springs, whose motion is not linear.
fn chain(n: usize, exponent: i32) -> (Arc<Body>, DiscreteEnergy) {
    let positions: Vec<f64> = (0..n).flat_map(|i| [i as f64, 0.0]).collect();
    let body = Arc::new(Body::new(2, &positions, &vec![1.0; n], None));
    let bonds = laws([1.0, 0.0, 0.0], exponent);
    let energy = DiscreteEnergy::new(Arc::clone(&body), 2.0, Weights::Volumes, bonds).unwrap();
    (body, energy)
}

/// A hundred thousand steps close to the critical one. (Half a million were tried, too: 5e-14.)
#[test]
fn the_account_of_a_long_run_closes() {
    for exponent in [1, 2] {
        let (body, energy) = chain(16, exponent);
        let n = body.positions().len();
        let mut random = Random(5);
        let velocities = (0..n).map(|_| 0.05 * random.next()).collect();
        let initial = Initial { displacements: vec![0.0; n], velocities };
        let free = Conditions { loads: vec![0.0; n], ..Conditions::default() };
        let steps = 100_000;
        let dt = 0.6;
        let settings = MotionSettings {
            end: dt * f64::from(steps),
            step: Some(dt),
            rows: 50,
            ..MotionSettings::default()
        };
        let masses = vec![1.0; body.n_points()];
        let watch = Watch::default();
        let mut motion = Motion::new(&energy, &masses, initial, &free, &settings, &watch).unwrap();
        let first = go(&mut motion, 0);
        let total = first.kinetic + first.energy.total();
        let (mut worst, mut error) = ([0.0_f64; 3], 0.0_f64);
        while let Advance::Step(row) = motion.advance().unwrap() {
            let found = [
                row.rounding.abs() / total,
                norm_of_change(&row.momentum, &first.momentum),
                norm_of_change(&row.angular_momentum, &first.angular_momentum) / 16.0,
            ];
            (0..3).for_each(|k| worst[k] = worst[k].max(found[k]));
            error = error.max(row.quadrature.abs() / total);
        }
        println!("n = {exponent}: left over, momenta {worst:?}; quadrature {error:e}");
        assert!(motion.notes().is_empty(), "{:?}", motion.notes());
        assert!(worst[0] <= 1e-12 && worst[1] <= 1e-11 && worst[2] <= 1e-11, "{worst:?}");
        assert!(error > 1e-6, "the step has an error, which the account shows: {error:e}");
    }
}

/// Energies of bonds and of deformation gradients of a cloud that takes several slabs.
#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let body = bonds::cloud(&[14, 9, 8], 1.0, 3);
    let n = body.positions().len();
    let of_bonds =
        DiscreteEnergy::new(Arc::clone(&body), 2.1, Weights::Volumes, laws([1.0, 0.0, 0.0], 1));
    let of_bonds = of_bonds.unwrap();
    let kind = piola_runtime::deformation::Discretisation::BondQuadrature;
    let order = piola_runtime::deformation::OperatorOrder::First;
    let of_gradients = families::energy(&body, 2.1, order, kind, "cubic");
    for energy in [&of_bonds as &dyn Energy, &of_gradients] {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut random = Random(7);
                let velocities = (0..n).map(|_| 0.01 * random.next()).collect();
                let initial = Initial { displacements: vec![0.0; n], velocities };
                let drive = Conditions {
                    displaced: vec![0, 1, 2],
                    displacements: vec![0.01; 3],
                    loads: vec![1e-3; n],
                    ramp: 0.1,
                    ..Conditions::default()
                };
                let masses = vec![1.0; n / 3];
                let watch = Watch::default();
                let settings =
                    MotionSettings { end: 1.0, damping: 0.1, ..MotionSettings::default() };
                let mut motion =
                    Motion::new(energy, &masses, initial, &drive, &settings, &watch).unwrap();
                let last = motion.n_steps();
                let row = go(&mut motion, last);
                let state = motion.state();
                (row, state.displacements.to_vec(), state.velocities.to_vec(), motion.step())
            })
        };
        let one = run(1);
        assert!(one == run(2) && one == run(4));
    }
}
