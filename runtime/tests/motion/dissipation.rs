//! Bonds that dissipate by their rates: against a difference equation and an exact motion, at the critical
//! step, with the account of energy, momenta, threads, checkpoints and bonds that break.

use std::sync::Arc;

use piola_compiler::{Form, Level, Mode, Setting, check_text};
use piola_runtime::assembly::{DiscreteEnergy, Laws};
use piola_runtime::body::Body;
use piola_runtime::dissipation::{Dashpots, Layer};
use piola_runtime::energy::{Energy, Total};
use piola_runtime::kernel::Law;
use piola_runtime::lattice::{Lattice, Nodes};
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::solve::Watch;
use piola_runtime::solve::motion::{Initial, Method, Motion, MotionError, MotionSettings, Row};
use piola_runtime::weights::Weights;

use crate::Conditions;
use crate::families::largest;
use crate::reference::{go, off};
use crate::states::remembering;

/// A spring and a dashpot, both linear in the length.
const LINEAR: &str = "potential linear
parameter k = 1
parameter eta
psi(l) = 1/2*k*(l - L)^2
dissipation(l) = 1/2*eta*rate(l)^2";

/// What depends on the length and goes with the square of the rate and more.
const CURVED: &str = "potential curved
parameter eta
psi(l) = 1/2*L*(l/L - 1)^2
dissipation(l) = 1/2*eta*l*(rate(l)/L)^2
dissipation(l) = eta*abs(rate(l))^3/L";

fn settings(parameters: &[(&str, f64)]) -> Vec<(String, Setting)> {
    parameters.iter().map(|(name, x)| (name.to_string(), Setting::Number(*x))).collect()
}

fn dashpots(
    (body, horizon): (&Arc<Body>, f64),
    text: &str,
    parameters: &[(&str, f64)],
) -> Dashpots {
    let (_, model) = check_text(text).unwrap();
    let values = model.values(body.dimension(), &settings(parameters), Some(horizon)).unwrap();
    let kernel = model.dissipation(&values, Mode::Jit(Level::Fast)).unwrap().unwrap();
    let of_law: Vec<Option<Box<dyn Law>>> = vec![Some(Box::new(kernel))];
    let neighborhood = Arc::new(Neighborhood::new(body, horizon).unwrap());
    let layer = Layer { of_law, materials: None };
    Dashpots::new((Arc::clone(body), neighborhood), Weights::Volumes, vec![layer]).unwrap()
}

/// The body of one potential, with what it dissipates.
fn viscous(
    (body, horizon): (&Arc<Body>, f64),
    text: &str,
    parameters: &[(&str, f64)],
) -> Total<'static> {
    let (_, model) = check_text(text).unwrap();
    let values = model.values(body.dimension(), &settings(parameters), Some(horizon)).unwrap();
    let compiled = model.compile(&values, Mode::Jit(Level::Fast), Form::Accurate).unwrap();
    let bond = compiled.kernels.into_iter().next().map(|kernel| Box::new(kernel) as Box<dyn Law>);
    let laws = Laws { bond, ..Laws::default() };
    let energy = DiscreteEnergy::new(Arc::clone(body), horizon, Weights::Volumes, laws).unwrap();
    Total::of(Box::new(energy)).with_dissipation(dashpots((body, horizon), text, parameters))
}

/// Points in a row along x, 1 m apart, each of volume 1.
fn row_of(n: usize) -> (Arc<Body>, f64) {
    let positions: Vec<f64> = (0..n).flat_map(|k| [k as f64, 0.0]).collect();
    (Arc::new(Body::new(2, &positions, &vec![1.0; n], None)), 1.5)
}

fn block(sides: &[f64]) -> (Arc<Body>, f64) {
    let (lower, upper) = (vec![0.0; sides.len()], sides.to_vec());
    let points = Lattice { lower, upper, spacing: 1.0, nodes: Nodes::Cells }.points().unwrap();
    (Arc::new(Body::new(sides.len(), &points.positions, &points.volumes, Some(1.0))), 1.6)
}

fn over(end: f64, step: f64) -> MotionSettings {
    MotionSettings { end, step: Some(step), rows: 10, ..MotionSettings::default() }
}

fn noise(n: usize, size: f64, seed: u64) -> Vec<f64> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..n).map(|_| size * next()).collect()
}

fn begin<'a>(
    energy: &'a dyn Energy,
    start: (Vec<f64>, Vec<f64>),
    drive: &'a Conditions,
    settings: &MotionSettings,
) -> Result<Motion<'a>, MotionError> {
    let masses = vec![1.0; energy.positions().len() / energy.dimension()];
    let start = Initial { displacements: start.0, velocities: start.1 };
    Motion::new(energy, &masses, start, drive, settings, &Watch::default())
}

fn u_of(motion: &Motion<'_>) -> Vec<f64> {
    motion.snapshot().arrays[1].to_vec()
}

/// A point on a spring and a dashpot, the other end of which is held.
fn oscillate(eta: f64, [u, v]: [f64; 2], end: f64, step: f64) -> (f64, Row) {
    let (body, horizon) = row_of(2);
    let energy = viscous((&body, horizon), LINEAR, &[("eta", eta)]);
    let drive = Conditions {
        displaced: vec![0, 1],
        displacements: vec![0.0; 2],
        loads: vec![0.0; 4],
        ..Conditions::default()
    };
    let start = (vec![0.0, 0.0, u, 0.0], vec![0.0, 0.0, v, 0.0]);
    let mut motion = begin(&energy, start, &drive, &over(end, step)).unwrap();
    let n = motion.n_steps();
    go(&mut motion, 0);
    let row = go(&mut motion, n);
    (u_of(&motion)[2], row)
}

#[test]
fn a_dashpot_follows_its_difference_equation() {
    let (eta, dt) = (0.3, 0.2);
    let [mut u, v] = [0.1, 0.05];
    let mut before = v - 0.5 * dt * (-u - eta * v);
    let mut after = v + 0.5 * dt * (-u - eta * v);
    for _ in 1..200 {
        u += dt * after;
        let now = after + 0.5 * (after - before);
        (before, after) = (after, after + dt * (-u - eta * now));
    }
    u += dt * after;
    let (found, row) = oscillate(eta, [0.1, 0.05], 200.0 * dt, dt);
    assert!((found - u).abs() <= 1e-15, "{found:e} {u:e}");
    assert!(row.damping > 0.0 && row.rounding.abs() < 1e-17, "{row:?}");
}

/// `e^(-eta t/2)` times a swing of frequency `sqrt(1 - eta^2/4)`.
#[test]
fn errors_of_a_dashpot_go_with_the_square_of_the_step() {
    let (eta, t) = (0.4, 10.0);
    let [u, v] = [0.1, 0.05];
    let omega = libm::sqrt(1.0 - 0.25 * eta * eta);
    let swing = u * libm::cos(omega * t) + (v + 0.5 * eta * u) / omega * libm::sin(omega * t);
    let exact = libm::exp(-0.5 * eta * t) * swing;
    let errors: Vec<f64> = (4..10)
        .map(|k| oscillate(eta, [u, v], t, 10.0 / (20.0 * f64::from(1 << (k - 4)))).0 - exact)
        .collect();
    for pair in errors.windows(2).skip(2) {
        let order = libm::log2(pair[0] / pair[1]);
        assert!((order - 2.0).abs() < 0.04, "{order}: {errors:?}");
    }
}

/// Bonds that are as viscous as stiff: the motion of highest frequency is that of highest viscosity.
#[test]
fn a_chain_is_stable_just_below_the_critical_step_and_not_just_above() {
    let n = 12;
    let (body, horizon) = row_of(n);
    let drive = Conditions { loads: vec![0.0; 2 * n], ..Conditions::default() };
    for eta in [0.01, 0.3, 2.0] {
        let energy = viscous((&body, horizon), LINEAR, &[("eta", eta)]);
        let half = libm::sin(0.5 * std::f64::consts::PI * (n - 1) as f64 / n as f64);
        let square = 4.0 * half * half;
        let mu = eta * square;
        let exact = 2.0 / (libm::sqrt(square + mu * mu) + mu);
        let start = || {
            let v = noise(2 * n, 1e-3, 5).into_iter().enumerate();
            (vec![0.0; 2 * n], v.map(|(dof, v)| if dof % 2 == 0 { v } else { 0.0 }).collect())
        };
        let run = |part: f64| {
            let step = part * exact;
            let settings = MotionSettings { unstable: true, ..over(3000.0 * step, step) };
            let mut motion = begin(&energy, start(), &drive, &settings).unwrap();
            let found = motion.critical().unwrap();
            // On the safe side, by no more than it says.
            let (short, more) = (1.0 - found.seconds / exact, found.viscosity / mu - 1.0);
            let uncertain = -1e-12..found.uncertainty.max(1e-12);
            assert!(found.uncertainty < 1e-2, "{found:?}");
            assert!(uncertain.contains(&short) && uncertain.contains(&more), "{found:?} {exact}");
            let first = go(&mut motion, 0).kinetic;
            let mut last = first;
            for row in 1..=10 {
                match motion.advance_to(300 * row) {
                    Ok(piola_runtime::solve::march::Advance::Step(row)) => last = row.kinetic,
                    _ => return f64::INFINITY,
                }
            }
            last / first
        };
        let [below, above] = [run(0.995), run(1.005)];
        assert!(below < 1.0, "{eta}: {below}");
        assert!(above > 100.0, "{eta}: {above}");
    }
}

#[test]
fn longer_steps_are_refused_and_the_implicit_rule_too() {
    let (body, horizon) = row_of(3);
    let energy = viscous((&body, horizon), LINEAR, &[("eta", 1.0)]);
    let drive = Conditions { loads: vec![0.0; 6], ..Conditions::default() };
    let start = || (vec![0.0; 6], vec![0.0; 6]);
    let refused = |settings: MotionSettings| begin(&energy, start(), &drive, &settings).err();
    assert!(matches!(refused(over(10.0, 1.0)), Some(MotionError::TooLong { .. })));
    let midpoint = MotionSettings { method: Method::Midpoint, ..over(10.0, 0.1) };
    assert_eq!(refused(midpoint), Some(MotionError::ImplicitDissipation));
}

/// Everything that moves a body at once, for 10,000 steps.
#[test]
fn the_account_closes_with_dissipation_and_all_else() {
    let (body, horizon) = block(&[5.0, 3.0]);
    let n = body.positions().len();
    let energy = viscous((&body, horizon), CURVED, &[("eta", 0.05)]);
    let drive = Conditions {
        displaced: vec![0, 1],
        displacements: vec![0.1, -0.05],
        driven: vec![n - 2, n - 1],
        velocities: vec![[0.02, -0.002], [0.0, 0.001]],
        loads: noise(n, 1e-3, 9),
        ramp: 20.0,
    };
    for method in [Method::Verlet, Method::LeapFrog, Method::Kinematic] {
        let settings = MotionSettings { method, damping: 0.01, ..over(100.0, 0.01) };
        let start = (noise(n, 0.01, 3), noise(n, 0.1, 4));
        let mut motion = begin(&energy, start, &drive, &settings).unwrap();
        let mut most = 0.0_f64;
        let mut last = None;
        for row in 0..=10 {
            let row = go(&mut motion, 1000 * row);
            let columns = [row.kinetic, row.energy.total(), row.damping, row.prescribed];
            most = columns.iter().fold(most, |most, x| most.max(x.abs()));
            assert!(row.rounding.abs() <= 1e-12 * most, "{method:?}: {row:?}");
            assert!(row.quadrature.abs() <= 1e-3 * most, "{method:?}: {row:?}");
            last = Some(row);
        }
        assert!(motion.notes().is_empty(), "{:?}", motion.notes());
        assert!(last.unwrap().damping > 0.01 * most);
    }
}

#[test]
fn momenta_stay_and_energy_falls() {
    for sides in [&[5.0, 3.0][..], &[4.0, 3.0, 2.0]] {
        let (body, horizon) = block(sides);
        let n = body.positions().len();
        let energy = viscous((&body, horizon), CURVED, &[("eta", 0.2)]);
        let drive = Conditions { loads: vec![0.0; n], ..Conditions::default() };
        let start = (noise(n, 0.02, 3), noise(n, 0.2, 4));
        let mut motion = begin(&energy, start, &drive, &over(40.0, 0.02)).unwrap();
        let rows: Vec<Row> = (0..=10).map(|row| go(&mut motion, 200 * row)).collect();
        let first = &rows[0];
        let mut damping = -1.0;
        for row in &rows {
            let scale = 1.0 + largest(&first.angular_momentum);
            assert!(off(&row.momentum, &first.momentum, 1.0) < 1e-13, "{row:?}");
            let turned = off(&row.angular_momentum, &first.angular_momentum, scale);
            assert!(turned < 1e-13, "{turned:e}");
            assert!(row.damping > damping);
            damping = row.damping;
        }
        assert!(rows[10].damping > 0.5 * rows[0].kinetic);
    }
}

#[test]
fn a_disc_that_turns_stretched_dissipates_nothing() {
    let (body, horizon) = row_of(2);
    let energy = viscous((&body, horizon), LINEAR, &[("eta", 0.5)]);
    let drive = Conditions { loads: vec![0.0; 4], ..Conditions::default() };
    // Two points on a circle of radius 1: k (l - L) = m omega^2 l/2 with l = 2, L = 1.
    let start = (vec![-0.5, 0.0, 0.5, 0.0], vec![0.0, -1.0, 0.0, 1.0]);
    let mut motion = begin(&energy, start, &drive, &over(20.0, 1e-3)).unwrap();
    let rows: Vec<Row> = (0..=10).map(|row| go(&mut motion, 2000 * row)).collect();
    let last = &rows[10];
    assert!((last.kinetic - 1.0).abs() < 1e-6 && last.damping.abs() < 1e-9, "{last:?}");
}

#[test]
fn a_resumed_motion_and_any_number_of_threads_give_the_same_bits() {
    let (body, horizon) = block(&[40.0, 30.0]);
    let n = body.positions().len();
    let energy = viscous((&body, horizon), CURVED, &[("eta", 0.05)]);
    let drive = Conditions {
        displaced: vec![0, 1],
        displacements: vec![0.1, -0.05],
        loads: vec![0.0; n],
        ramp: 20.0,
        ..Conditions::default()
    };
    let settings = over(8.0, 0.1);
    let start = || (noise(n, 0.01, 3), noise(n, 0.1, 4));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut motion = begin(&energy, start(), &drive, &settings).unwrap();
            go(&mut motion, 0);
            let row = go(&mut motion, 80);
            (row, u_of(&motion))
        })
    };
    let whole = run(1);
    assert!(whole == run(3));
    let mut part = begin(&energy, start(), &drive, &settings).unwrap();
    go(&mut part, 0);
    let masses = vec![1.0; body.n_points()];
    for stop in [0, 8, 40] {
        while part.step_reached() < stop {
            let next = part.step_reached() + 8;
            go(&mut part, next);
        }
        let (watch, snapshot) = (Watch::default(), part.snapshot());
        let resumed = Motion::resume(&energy, &masses, &drive, &settings, &watch, snapshot);
        let mut resumed = resumed.unwrap();
        assert_eq!(resumed.critical(), part.critical());
        let row = go(&mut resumed, 80);
        assert!((row, u_of(&resumed)) == whole, "from {stop}");
    }
}

#[test]
fn broken_bonds_dissipate_nothing() {
    let text = "potential brittle
parameter eta = 0.3
psi(l) = 1/2*(l - L)^2
dissipation(l) = 1/2*eta*rate(l)^2
break when l/L - 1 > 0.5";
    let (body, horizon) = row_of(2);
    let energy = remembering((&body, horizon), text, &[], Level::Fast);
    let energy = energy.with_dissipation(dashpots((&body, horizon), text, &[]));
    let drive = Conditions { loads: vec![0.0; 4], ..Conditions::default() };
    let start = (vec![0.0; 4], vec![-1.0, 0.0, 1.0, 0.0]);
    let mut motion = begin(&energy, start, &drive, &over(2.0, 1e-3)).unwrap();
    let rows: Vec<Row> = (0..=10).map(|row| go(&mut motion, 200 * row)).collect();
    let broken: Vec<&Row> = rows.iter().filter(|row| row.broken == Some(1)).collect();
    assert!(broken.len() > 5 && rows[1].broken == Some(0));
    let last = broken[broken.len() - 1];
    assert!(last.damping > 0.05 && last.released > 0.1);
    for row in broken {
        assert_eq!((row.damping, row.kinetic), (last.damping, last.kinetic));
        assert!(row.rounding.abs() < 1e-14, "{row:?}");
    }
    let mut forces = vec![f64::NAN; 4];
    let dissipation = energy.dissipation().unwrap();
    dissipation.forces(&u_of(&motion), &[-1.0, 0.0, 1.0, 0.0], &mut forces).unwrap();
    assert_eq!(forces, [0.0; 4]);
}
