//! Bodies in motion at the extremes: long spins, far from the origin, tiny and huge, alone.

use std::sync::Arc;

use piola_runtime::assembly::DiscreteEnergy;
use piola_runtime::body::Body;
use piola_runtime::solve::Watch;
use piola_runtime::solve::march::{Advance, March as _};
use piola_runtime::solve::motion::{Initial, Motion, MotionError, MotionSettings, Row};
use piola_runtime::weights::Weights;

use crate::Conditions;
use crate::bonds::{Random, laws};

fn free(n: usize) -> Conditions {
    Conditions { loads: vec![0.0; n], ..Conditions::default() }
}

/// A row of unit masses held together by bonds, areas and volumes.
fn body(positions: &[f64], d: usize) -> (Arc<Body>, DiscreteEnergy) {
    let volumes = vec![1.0; positions.len() / d];
    let body = Arc::new(Body::new(d, positions, &volumes, None));
    let c = if d == 2 { [1.0, 0.5, 0.0] } else { [1.0, 0.5, 0.5] };
    let energy = DiscreteEnergy::new(Arc::clone(&body), 1.8, Weights::Volumes, laws(c, 1)).unwrap();
    (body, energy)
}

struct Run {
    rows: Vec<Row>,
    u: Vec<f64>,
    v: Vec<f64>,
}

fn run(
    (body, energy): &(Arc<Body>, DiscreteEnergy),
    masses: &[f64],
    initial: Initial,
    settings: MotionSettings,
) -> Run {
    let (drive, watch) = (free(body.positions().len()), Watch::default());
    let mut motion = Motion::new(energy, masses, initial, &drive, &settings, &watch).unwrap();
    let mut rows = Vec::new();
    if let Advance::Step(row) = motion.advance_to(0).unwrap() {
        rows.push(row);
    }
    while let Advance::Step(row) = motion.advance().unwrap() {
        rows.push(row);
    }
    assert!(motion.notes().is_empty(), "{:?}", motion.notes());
    let state = motion.state();
    Run { rows, u: state.displacements.to_vec(), v: state.velocities.to_vec() }
}

/// A square of four points that turns ten thousand times.
#[test]
fn a_long_spin_keeps_its_angular_momentum() {
    let spun = body(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0], 2);
    let x = spun.0.positions();
    let omega = 0.5;
    let velocities: Vec<f64> =
        x.chunks_exact(2).flat_map(|x| [-omega * (x[1] - 0.5), omega * (x[0] - 0.5)]).collect();
    let initial = Initial { displacements: vec![0.0; 8], velocities };
    let turns = 10_000.0;
    // It widens as it turns, so it turns a little slower.
    let end = 1.2 * turns * 2.0 * std::f64::consts::PI / omega;
    let settings = MotionSettings { end, rows: 100, ..MotionSettings::default() };
    let Run { rows, u, .. } = run(&spun, &[1.0; 4], initial, settings);
    let first = &rows[0];
    let momentum = first.angular_momentum[0];
    for row in &rows {
        let off = (row.angular_momentum[0] - momentum).abs() / momentum;
        assert!(off <= 1e-12, "{off:e} at t = {}", row.t);
        assert!(row.rounding.abs() <= 1e-12 * first.kinetic, "{:e}", row.rounding);
        assert!(row.momentum.iter().all(|p| p.abs() <= 1e-11), "{:?}", row.momentum);
    }
    // It is where it was, and a square.
    let side = |i: usize, j: usize| {
        let at = |k: usize| [x[2 * k] + u[2 * k], x[2 * k + 1] + u[2 * k + 1]];
        libm::hypot(at(j)[0] - at(i)[0], at(j)[1] - at(i)[1])
    };
    assert!((1.0..1.6).contains(&side(0, 1)) && (side(0, 1) - side(2, 3)).abs() < 1e-6);
}

/// The same body a thousand kilometres away: strains come from displacements.
#[test]
fn a_body_far_from_the_origin_moves_as_at_home() {
    let corners = |shift: f64| {
        let axis = |k: usize, bit: usize| shift + f64::from((k >> bit & 1) as u8);
        (0..8).flat_map(|k| [axis(k, 2), axis(k, 1), axis(k, 0)]).collect::<Vec<f64>>()
    };
    let mut random = Random(3);
    let velocities: Vec<f64> = (0..24).map(|_| 1e-8 * random.next()).collect();
    let moved = |shift: f64| {
        let initial = Initial { displacements: vec![0.0; 24], velocities: velocities.clone() };
        let settings = MotionSettings { end: 50.0, rows: 10, ..MotionSettings::default() };
        run(&body(&corners(shift), 3), &[1.0; 8], initial, settings)
    };
    // Powers of two: the differences of positions are the same.
    let (home, away) = (moved(0.0), moved(1_048_576.0));
    assert_eq!(home.u, away.u);
    for (row, other) in home.rows.iter().zip(&away.rows) {
        assert_eq!(row.energy, other.energy);
    }
    let largest = home.u.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
    assert!(largest > 1e-8 && largest < 1e-6, "{largest:e}");
}

/// Lengths, times and forces by powers of two, from nanometres to gigametres: no number in the program has a
/// unit.
#[test]
fn scaling_by_powers_of_two_changes_no_bit() {
    let d = 3;
    let positions: Vec<f64> =
        (0..12).flat_map(|k| [k / 4, k / 2 % 2, k % 2].map(f64::from)).collect();
    let mut random = Random(9);
    let velocities: Vec<f64> = (0..36).map(|_| 0.02 * random.next()).collect();
    let moved = |length: f64, time: f64, mass: f64| {
        let scaled = |of: &[f64], by: f64| of.iter().map(|x| x * by).collect::<Vec<f64>>();
        let volume = length * length * length;
        let body = Body::new(d, &scaled(&positions, length), &[volume; 12], None);
        let body = Arc::new(body);
        // Energies of bonds per volume squared times length, of energy mass length^2/time^2.
        let energy = mass * length * length / (time * time);
        let c1 = energy / (length * volume * volume);
        let c2 = energy / (length * length * volume * volume * volume);
        let bonds = laws([c1, c2, 0.0], 1);
        let horizon = 1.8 * length;
        let made = DiscreteEnergy::new(Arc::clone(&body), horizon, Weights::Volumes, bonds);
        let initial = Initial {
            displacements: vec![0.0; 36],
            velocities: scaled(&velocities, length / time),
        };
        let settings = MotionSettings { end: 20.0 * time, rows: 5, ..MotionSettings::default() };
        run(&(body, made.unwrap()), &[mass; 12], initial, settings)
    };
    let two = |exponent: i32| libm::ldexp(1.0, exponent);
    let one = moved(1.0, 1.0, 1.0);
    for (length, time, mass) in [(-30, -40, -60), (30, 20, 80), (3, -7, 11)] {
        let (length, time, mass) = (two(length), two(time), two(mass));
        let other = moved(length, time, mass);
        let back: Vec<f64> = other.u.iter().map(|u| u / length).collect();
        assert_eq!(one.u, back, "length {length:e}, time {time:e}, mass {mass:e}");
        let back: Vec<f64> = other.v.iter().map(|v| v * time / length).collect();
        assert_eq!(one.v, back);
        let energy = mass * length * length / (time * time);
        for (row, other) in one.rows.iter().zip(&other.rows) {
            assert_eq!(row.kinetic, other.kinetic / energy);
            assert_eq!(row.energy.total(), other.energy.total() / energy);
        }
    }
}

/// Half of a body flies off, a thousand times as far as it is long, and is what it was.
#[test]
fn a_fragment_that_flies_far_stays_whole() {
    let pair = body(&[0.0, 0.0, 1.0, 0.0], 2);
    let initial =
        Initial { displacements: vec![0.0; 4], velocities: vec![0.5, 0.0, 0.5 + 1e-6, 0.0] };
    let settings =
        MotionSettings { end: 2000.0, step: Some(0.1), rows: 10, ..MotionSettings::default() };
    let Run { rows, u, .. } = run(&pair, &[1.0; 2], initial, settings);
    assert!((u[0] - 1000.0).abs() < 2e-3, "{u:?}");
    // A spring of stiffness 1 with half a mass at 2e-6 m/s for each of them.
    let energy = 0.5 * 0.5 * 1e-12;
    for row in &rows[1..] {
        let stored = row.energy.total();
        assert!(stored <= 1.02 * energy, "{stored:e}, not at most {energy:e}");
    }
}

#[test]
fn points_alone_and_points_without_mass_are_refused() {
    let body = Arc::new(Body::new(2, &[0.0, 0.0, 5.0, 0.0], &[1.0; 2], None));
    let alone = DiscreteEnergy::new(body, 1.8, Weights::Volumes, laws([1.0, 0.0, 0.0], 1));
    assert!(alone.is_err_and(|error| error.to_string().contains("neighbo")));
    let pair = self::body(&[0.0, 0.0, 1.0, 0.0], 2);
    let initial = Initial { displacements: vec![0.0; 4], velocities: vec![0.0; 4] };
    let (drive, watch, settings) = (free(4), Watch::default(), MotionSettings::default());
    let none = Motion::new(&pair.1, &[1.0, 0.0], initial, &drive, &settings, &watch);
    assert!(matches!(none, Err(MotionError::Mass { point: 1, .. })));
}
