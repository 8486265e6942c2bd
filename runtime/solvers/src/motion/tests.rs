//! Networks of springs in motion.

use std::f64::consts::PI;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use piola_mechanics::testing::{SpringNetwork, limited, linear, pseudo_random, softening};

use piola_mechanics::vector::norm_of;

use super::*;
use crate::march::{Advance, March as _};
use crate::watch::Observer;

/// Conditions by closures.
pub(super) struct Conditions {
    pub(super) displaced: Vec<usize>,
    pub(super) driven: Vec<usize>,
    pub(super) displacement: fn(f64) -> f64,
    pub(super) velocity: fn(f64) -> f64,
    pub(super) accelerated: Vec<usize>,
    pub(super) acceleration: fn(f64) -> f64,
    pub(super) load: fn(f64, usize) -> f64,
}

impl Default for Conditions {
    fn default() -> Self {
        Conditions {
            displaced: Vec::new(),
            driven: Vec::new(),
            displacement: |_| 0.0,
            velocity: |_| 0.0,
            accelerated: Vec::new(),
            acceleration: |_| 0.0,
            load: |_, _| 0.0,
        }
    }
}

impl MotionDrive for Conditions {
    fn displaced(&self) -> &[usize] {
        &self.displaced
    }

    fn displacements(&self, t: f64, values: &mut [f64]) {
        values.fill((self.displacement)(t));
    }

    fn driven(&self) -> &[usize] {
        &self.driven
    }

    fn velocities(&self, t: f64, values: &mut [f64]) {
        values.fill((self.velocity)(t));
    }

    fn accelerated(&self) -> &[usize] {
        &self.accelerated
    }

    fn accelerations(&self, t: f64, values: &mut [f64]) {
        values.fill((self.acceleration)(t));
    }

    fn loads(&self, t: f64, loads: &mut [f64]) {
        loads.iter_mut().enumerate().for_each(|(dof, load)| *load = (self.load)(t, dof));
    }
}

pub(super) fn initial(displacements: Vec<f64>, velocities: Vec<f64>) -> Initial {
    Initial { displacements, velocities }
}

pub(super) fn begin<'a>(
    springs: &'a SpringNetwork,
    start: Initial,
    drive: &'a Conditions,
    settings: MotionSettings,
) -> Result<Motion<'a>, MotionError> {
    let masses = vec![1.0; springs.n_points()];
    Motion::new(springs, &masses, start, drive, &settings, &Watch::default())
}

pub(super) fn go(motion: &mut Motion<'_>, step: usize) -> Row {
    match motion.advance_to(step).unwrap() {
        Advance::Step(row) => row,
        _ => panic!("nobody looks on"),
    }
}

/// Two points, one of them held: a spring of stiffness 1 and mass 1 along x.
fn oscillator() -> (SpringNetwork, Conditions) {
    let springs = SpringNetwork::lattice(&[2, 1], 1.0, linear);
    (springs, Conditions { displaced: vec![0, 1], ..Conditions::default() })
}

pub(super) fn over(end: f64, step: f64) -> MotionSettings {
    MotionSettings { end, step: Some(step), ..MotionSettings::default() }
}

/// `u_n = a cos(n phi)` with `sin(phi/2) = omega dt/2` solves the difference equation of a spring
/// exactly, and `v_n = -a sin(n phi) sin(phi)/dt`.
#[test]
fn a_spring_swings_as_its_difference_equation_does() {
    let (springs, held) = oscillator();
    for dt in [0.5, 1.0, 1.9] {
        let start = initial(vec![0.0, 0.0, 0.1, 0.0], vec![0.0; 4]);
        let mut motion = begin(&springs, start, &held, over(100.0 * dt, dt)).unwrap();
        assert!((motion.critical().unwrap().seconds - 2.0).abs() < 1e-12);
        assert_eq!((motion.n_steps(), motion.step()), (100, dt));
        let phi = 2.0 * libm::asin(0.5 * dt);
        for n in [0, 1, 2, 50, 100] {
            let row = go(&mut motion, n);
            let state = motion.state();
            let (sin, cos) = (libm::sin(n as f64 * phi), libm::cos(n as f64 * phi));
            assert!((state.displacements[2] - 0.1 * cos).abs() < 1e-15 * (n + 1) as f64, "{n}");
            let v = -0.1 * sin * libm::sin(phi) / dt;
            assert!((state.velocities[2] - v).abs() < 1e-14, "{n}: {}", state.velocities[2]);
            assert!((row.kinetic - 0.5 * v * v).abs() < 1e-15);
            assert!(row.quadrature.abs() < 1e-16 && row.rounding.abs() < 1e-16, "{row:?}");
        }
    }
}

/// A block with a clamped side, on its way for a while from an uneven start.
pub(super) fn block(
    law: piola_mechanics::testing::SpringLaw,
) -> (SpringNetwork, Conditions, Initial) {
    let springs = SpringNetwork::lattice(&[5, 4], 1.5, law);
    let held = springs.dofs_where(|x| x[0] < 0.5);
    let n = springs.positions.len();
    let scaled = |seed, size: f64| pseudo_random(n, seed).iter().map(|x| size * x).collect();
    let start: Initial = initial(scaled(1, 0.02), scaled(2, 0.05));
    (springs, Conditions { displaced: held, ..Conditions::default() }, start)
}

#[test]
fn errors_go_with_the_square_of_the_step() {
    let (springs, mut drive, start) = block(softening);
    drive.driven = springs.dofs_where(|x| x[0] > 3.5 && x[1] < 1.5);
    drive.velocity = |t| 0.02 * t;
    drive.accelerated = springs.dofs_where(|x| x[0] > 3.5 && x[1] > 1.5);
    drive.acceleration = |t| 0.02 * libm::cos(3.0 * t);
    drive.load = |t, dof| if dof.is_multiple_of(2) { 1e-3 * libm::sin(t) } else { 0.0 };
    for damping in [0.0, 0.3] {
        let at_end = |halvings: i32| {
            let settings =
                MotionSettings { damping, ..over(2.0, 0.125 / f64::from(1 << halvings)) };
            let mut motion = begin(&springs, start.clone(), &drive, settings).unwrap();
            go(&mut motion, 16 << halvings);
            let state = motion.state();
            [state.displacements.to_vec(), state.velocities.to_vec()]
        };
        let ends: Vec<_> = (0..8).map(at_end).collect();
        let distance = |x: &[f64], y: &[f64]| {
            norm_of(&x.iter().zip(y).map(|(x, y)| x - y).collect::<Vec<_>>())
        };
        for k in 0..2 {
            let changes: Vec<f64> =
                ends.windows(2).map(|pair| distance(&pair[0][k], &pair[1][k])).collect();
            let orders: Vec<f64> = changes.windows(2).map(|c| libm::log2(c[0] / c[1])).collect();
            assert_eq!(orders.len(), 6);
            assert!(orders.iter().all(|order| (order - 2.0).abs() <= 0.02), "{orders:?}");
        }
    }
}

/// All that takes part in the account, with steps close to the critical one, small ones and tiny ones.
#[test]
fn the_account_closes_at_any_step() {
    let (springs, mut drive, mut start) = block(linear);
    drive.driven = springs.dofs_where(|x| x[0] > 3.5 && x[1] < 1.5);
    drive.velocity = |t| 0.05 * libm::sin(t);
    drive.accelerated = springs.dofs_where(|x| x[0] > 3.5 && x[1] > 1.5);
    drive.acceleration = |t| 0.05 * libm::cos(t);
    drive.accelerated.iter().for_each(|dof| start.velocities[*dof] = 0.0);
    drive.load = |t, dof| if dof.is_multiple_of(3) { 1e-3 * t.min(1.0) } else { 0.0 };
    for method in [Method::Verlet, Method::LeapFrog, Method::Kinematic] {
        for (step, damping) in [(0.4, 0.0), (0.4, 0.1), (0.1, 0.02), (1e-6, 0.1)] {
            let settings = MotionSettings { method, damping, rows: 7, ..over(2000.0 * step, step) };
            let mut motion = begin(&springs, start.clone(), &drive, settings).unwrap();
            let mut rows = vec![go(&mut motion, 0)];
            while let Advance::Step(row) = motion.advance().unwrap() {
                rows.push(row);
            }
            assert_eq!(rows.iter().map(|row| row.step).collect::<Vec<_>>()[..3], [0, 286, 572]);
            let last = rows.last().unwrap();
            assert_eq!((rows.len(), last.step, last.t), (8, 2000, 2000.0 * step));
            assert!(motion.notes().is_empty(), "{:?}", motion.notes());
            let worst = rows.iter().map(|row| row.rounding.abs()).fold(0.0, f64::max);
            println!("{method:?} {step} {damping}: {worst:e} of {:e} J", motion.balance.largest());
            assert!(worst <= 1e-13 * motion.balance.largest(), "{worst:e}");
            if step == 0.4 {
                assert!(last.prescribed != 0.0 && last.external != 0.0, "{last:?}");
                assert!(last.quadrature.abs() > 1e-7, "large steps have an error: {last:?}");
                assert_eq!(last.damping > 0.0, damping > 0.0);
            }
        }
    }
}

#[test]
fn a_long_run_of_a_chain_drifts_nowhere() {
    let springs = SpringNetwork::lattice(&[12, 1], 3.0, linear);
    let start = initial(vec![0.0; 24], pseudo_random(24, 5).iter().map(|x| 0.1 * x).collect());
    let free = Conditions::default();
    let steps = 200_000;
    let settings = MotionSettings { rows: 20, ..over(0.5 * f64::from(steps), 0.5) };
    let mut motion = begin(&springs, start, &free, settings).unwrap();
    let first = go(&mut motion, 0);
    let mut worst = [0.0_f64; 3];
    while let Advance::Step(row) = motion.advance().unwrap() {
        let drift = |now: &[f64], then: &[f64]| {
            norm_of(&now.iter().zip(then).map(|(x, y)| x - y).collect::<Vec<_>>())
        };
        let found = [
            row.rounding.abs() / motion.balance.largest(),
            drift(&row.momentum, &first.momentum),
            drift(&row.angular_momentum, &first.angular_momentum),
        ];
        (0..3).for_each(|k| worst[k] = worst[k].max(found[k]));
    }
    println!("left over, momentum, angular momentum: {worst:?}");
    assert!(worst[0] <= 1e-12 && worst[1] <= 1e-12 && worst[2] <= 1e-10, "{worst:?}");
    assert!(motion.notes().is_empty(), "{:?}", motion.notes());
}

#[test]
fn there_and_back_is_where_it_began() {
    let (springs, held, start) = block(softening);
    let settings = over(1000.0, 0.1);
    let end = |start: &Initial, sign: f64| {
        let mut motion = begin(&springs, start.clone(), &held, settings).unwrap();
        go(&mut motion, 10_000);
        let state = motion.state();
        let turned = state.velocities.iter().map(|v| sign * v).collect();
        initial(state.displacements.to_vec(), turned)
    };
    let back = end(&end(&start, -1.0), -1.0);
    for dof in (0..start.displacements.len()).filter(|dof| !held.displaced.contains(dof)) {
        let errors = [
            back.displacements[dof] - start.displacements[dof],
            back.velocities[dof] - start.velocities[dof],
        ];
        assert!(errors.iter().all(|error| error.abs() < 1e-10 * 0.05), "{dof}: {errors:?}");
    }
}

/// A million steps of a billionth of the critical one are as long as one of a thousandth.
#[test]
fn tiny_steps_lose_nothing() {
    let (springs, held) = oscillator();
    let at_end = |end: f64, count: usize| {
        let start = initial(vec![0.0, 0.0, 0.1, 0.0], vec![0.0, 0.0, 0.3, 0.0]);
        let step = end / count as f64;
        let mut motion = begin(&springs, start, &held, over(end, step)).unwrap();
        go(&mut motion, count);
        (motion.u.value[2], motion.state().velocities[2])
    };
    let (few, many) = (at_end(2e-3, 1), at_end(2e-3, 1_000_000));
    // A spring of stiffness 1 and mass 1: the same to the square of the larger step, and rounding.
    let exact = |t: f64| {
        let (sin, cos) = (libm::sin(t), libm::cos(t));
        (0.1 * cos + 0.3 * sin, 0.3 * cos - 0.1 * sin)
    };
    let exact = exact(2e-3);
    assert!((few.0 - exact.0).abs() < 1e-9 && (few.1 - exact.1).abs() < 1e-9);
    let errors = [(many.0 - exact.0).abs(), (many.1 - exact.1).abs()];
    println!("{errors:?}");
    assert!(errors.iter().all(|error| *error <= 2e-16), "{errors:?}");
}

#[test]
fn a_step_beyond_the_critical_one_is_refused_and_forced_called_unstable() {
    let (springs, held, start) = block(linear);
    let start = initial(start.displacements.iter().map(|u| 1e-3 * u).collect(), vec![0.0; 40]);
    let critical = begin(&springs, start.clone(), &held, over(1.0, 0.01)).unwrap().critical();
    let critical = critical.unwrap().seconds;
    let run = |part: f64, unstable: bool| {
        let settings =
            MotionSettings { unstable, ..over(1000.0 * part * critical, part * critical) };
        let mut motion = begin(&springs, start.clone(), &held, settings)?;
        motion.advance_to(300).map(|_| ())
    };
    assert!(matches!(run(1.01, false), Err(MotionError::TooLong { .. })));
    let error = run(1.01, true).unwrap_err();
    assert!(error.to_string().contains("unstable"), "{error}");
    let MotionError::FlownOff(found) = error else { panic!("{error}") };
    assert!(found.step < 300 && found.t > 0.0, "{found:?}");
    assert!((found.critical.unwrap() / critical - 1.0).abs() < 1e-3);
    run(0.999, false).unwrap();
    let automatic = MotionSettings { end: 100.0, ..MotionSettings::default() };
    let motion = begin(&springs, start.clone(), &held, automatic).unwrap();
    let part = motion.step() / critical;
    assert!(part <= 0.9 && part > 0.85, "{part}");
}

#[test]
fn the_sums_of_rows_bound_the_critical_step() {
    let (springs, held, _) = block(linear);
    let n = springs.positions.len();
    let masses: Vec<f64> = pseudo_random(n / 2, 7).iter().map(|x| 1.0 + 0.4 * x).collect();
    for fixed in [&[][..], &held.displaced] {
        let constraints = Constraints::new(n, fixed).unwrap();
        let precision = Precision { tolerance: 1e-12, products: 1000 };
        let u = vec![0.0; n];
        let found = CriticalStep::find(&springs, &u, &masses, &constraints, precision);
        let found = found.unwrap().unwrap();
        let sure = step_by_row_sums(&springs, &u, &masses, &constraints).unwrap();
        assert!(found.uncertainty <= 1e-12 && sure < found.seconds, "{found:?}, {sure}");
        assert!(sure > 0.5 * found.seconds, "{found:?}, {sure}");
    }
}

/// Two points, of which one is driven against the other.
#[test]
fn what_goes_wrong_is_named_with_time_and_point() {
    let springs = SpringNetwork::lattice(&[3, 1], 1.0, limited);
    let rest = || initial(vec![0.0; 6], vec![0.0; 6]);
    let held = |load, velocity| Conditions {
        displaced: vec![0, 1],
        driven: vec![4, 5],
        load,
        velocity,
        ..Conditions::default()
    };
    let run = |drive: &Conditions| {
        let mut motion = begin(&springs, rest(), drive, over(10.0, 0.1))?;
        motion.advance_to(100).map(|_| ())
    };
    let error = run(&held(|_, _| 0.0, |_| 0.1)).unwrap_err();
    let MotionError::NonFinite { t, cause, unstable: None, .. } = &error else { panic!("{error}") };
    assert!((2.0..8.0).contains(t) && cause.points.len() == 2, "{error}");
    let error = run(&held(|t, dof| if dof == 3 && t > 2.0 { f64::NAN } else { 0.0 }, |_| 0.0));
    let error = error.unwrap_err();
    let MotionError::Drive { what: "load", point: 1, component: 1, t, .. } = error else {
        panic!("{error}")
    };
    assert!((t - 2.1).abs() < 1e-9, "{t}");
    let error = run(&held(|_, _| 0.0, |t| if t > 1.0 { f64::INFINITY } else { 0.0 })).unwrap_err();
    assert!(matches!(error, MotionError::Drive { what: "prescribed velocity", .. }), "{error}");
    let error = run(&held(|t, dof| if dof == 2 && t > 1.0 { 1e6 } else { 0.0 }, |_| 0.0));
    let MotionError::FlownOff(found) = error.unwrap_err() else { panic!() };
    assert!(found.point == 1 && found.critical.is_none(), "{found:?}");
    let masses = [1.0, 0.0, 1.0];
    let free = Conditions::default();
    let none = Watch::default();
    let refused = Motion::new(&springs, &masses, rest(), &free, &over(1.0, 0.1), &none);
    assert_eq!(refused.err(), Some(MotionError::Mass { point: 1, mass: 0.0 }));
    let twice = Conditions { displaced: vec![0], driven: vec![0], ..Conditions::default() };
    let refused = begin(&springs, rest(), &twice, over(1.0, 0.1));
    assert!(matches!(refused.err(), Some(MotionError::Constraint(_))));
    for settings in
        [over(0.0, 0.1), over(1.0, -0.1), MotionSettings { safety: 1.5, ..over(1.0, 0.1) }]
    {
        let refused = begin(&springs, rest(), &free, settings).err();
        assert!(matches!(refused, Some(MotionError::Settings { .. })), "{refused:?}");
    }
}

/// Displacements that are prescribed are met exactly, velocities that are prescribed add up.
#[test]
fn prescribed_points_go_where_they_are_sent() {
    let springs = SpringNetwork::lattice(&[4, 1], 1.0, linear);
    let drive = Conditions {
        displaced: vec![0, 1],
        driven: vec![6],
        displacement: |t| 0.1 * t * t,
        velocity: |t| 0.2 * t,
        ..Conditions::default()
    };
    let start = initial(vec![0.0; 8], vec![0.0; 8]);
    let mut motion = begin(&springs, start, &drive, over(1.0, 0.1)).unwrap();
    for step in 0..=10 {
        go(&mut motion, step);
        let (state, t) = (motion.state(), step as f64 / 10.0);
        assert_eq!(state.displacements[0], 0.1 * t * t);
        assert!((state.displacements[6] - 0.1 * t * t).abs() < 1e-16, "{step}");
        assert!((state.velocities[6] - 0.2 * t).abs() < 1e-16, "{step}");
        if (1..10).contains(&step) {
            assert!((state.velocities[0] - 0.2 * t).abs() < 1e-15, "{step}");
        }
    }
}

/// Wants an end when 189 steps are made.
struct Impatient(AtomicUsize);

impl Observer for Impatient {
    fn notice(&self, event: Event<'_>) {
        if let Event::Moved { step, .. } = event {
            self.0.store(step, Ordering::Relaxed);
        }
    }

    fn wants_end(&self) -> bool {
        self.0.load(Ordering::Relaxed) >= 189
    }
}

#[test]
fn who_looks_on_may_end_it() {
    let (springs, held) = oscillator();
    let start = initial(vec![0.0, 0.0, 0.1, 0.0], vec![0.0; 4]);
    let watch = Watch::by(Arc::new(Impatient(AtomicUsize::new(0))));
    let settings = MotionSettings { rows: 10, ..over(2.0 * PI, 0.01) };
    let mut motion = Motion::new(&springs, &[1.0; 2], start, &held, &settings, &watch).unwrap();
    let mut rows = Vec::new();
    let ended = crate::march::march(&mut motion, &mut |row, _| {
        rows.push(row.step);
        std::ops::ControlFlow::Continue(())
    });
    assert!(ended.unwrap().is_break());
    // The step after that is the last, and has a row of its own.
    assert_eq!(rows, [63, 126, 189, 190]);
}

/// Softening springs, one side driven, loads and damping that change nothing in what is at stake.
fn stretched() -> (SpringNetwork, Conditions) {
    let springs = SpringNetwork::lattice(&[6, 4], 1.0, softening);
    let drive = Conditions {
        displaced: vec![0, 1],
        driven: vec![46, 47],
        displacement: |t| 0.01 * t,
        velocity: |t| 0.1 - 0.01 * t,
        accelerated: vec![44, 45],
        acceleration: |t| 0.01 * libm::cos(t),
        load: |t, dof| 1e-3 * t * dof as f64,
    };
    (springs, drive)
}

#[test]
fn what_goes_on_from_a_snapshot_goes_on_with_the_same_bits() {
    let (springs, drive) = stretched();
    let n = springs.positions.len();
    let masses = vec![1.0; springs.n_points()];
    for method in [Method::Verlet, Method::LeapFrog, Method::Kinematic] {
        let settings = MotionSettings { method, damping: 0.05, rows: 40, ..over(20.0, 0.01) };
        let first = initial(vec![0.0; n], pseudo_random(n, 3).iter().map(|x| 0.01 * x).collect());
        let mut whole = begin(&springs, first.clone(), &drive, settings).unwrap();
        let rows: Vec<Row> = (0..=40).map(|row| go(&mut whole, 50 * row)).collect();
        assert!(rows[40].external != 0.0 && rows[40].prescribed != 0.0 && rows[40].damping != 0.0);
        let mut part = begin(&springs, first, &drive, settings).unwrap();
        // The looks at the critical step are behind 1000 and 2000 steps.
        go(&mut part, 0);
        for stop in [0, 1, 50, 777, 1000, 1999] {
            while part.done < stop {
                let next = stop.min(part.next_row());
                go(&mut part, next);
            }
            let watch = Watch::default();
            let snapshot = part.snapshot();
            let resumed = Motion::resume(&springs, &masses, &drive, &settings, &watch, snapshot);
            let mut resumed = resumed.unwrap();
            assert_eq!(resumed.critical(), part.critical());
            // What was seen on the way has to stay known.
            for row in rows.iter().filter(|row| row.step > stop) {
                assert_eq!(go(&mut resumed, row.step), *row, "{method:?} from {stop}");
                assert_eq!(resumed.next_row(), (row.step + 50).min(2000));
            }
            assert_eq!(resumed.u.value, whole.u.value);
            assert_eq!(resumed.mean, whole.mean);
            assert_eq!(resumed.least_critical, whole.least_critical);
            assert_eq!(resumed.notes, whole.notes);
        }
    }
}

#[test]
fn an_end_between_rows_leaves_no_trace_in_the_snapshot() {
    let (springs, drive) = stretched();
    let n = springs.positions.len();
    let masses = vec![1.0; springs.n_points()];
    let settings = MotionSettings { rows: 10, ..over(6.0, 0.01) };
    let start = || initial(vec![0.0; n], vec![0.0; n]);
    let watch = Watch::by(Arc::new(Impatient(AtomicUsize::new(0))));
    let mut ended = Motion::new(&springs, &masses, start(), &drive, &settings, &watch).unwrap();
    go(&mut ended, 0);
    let see = &mut |_: &Row, _: &Motion<'_>| std::ops::ControlFlow::Continue(());
    assert!(crate::march::march(&mut ended, see).unwrap().is_break());
    assert!(ended.is_between_rows());
    let mut whole = begin(&springs, start(), &drive, settings).unwrap();
    go(&mut whole, 0);
    while whole.done + 60 <= ended.done {
        let next = whole.next_row();
        go(&mut whole, next);
    }
    while whole.done < ended.done {
        assert!(whole.go(false).unwrap().is_continue());
    }
    assert_eq!(whole.snapshot(), ended.snapshot());
}

#[test]
fn a_snapshot_of_another_motion_is_refused() {
    let (springs, drive) = stretched();
    let n = springs.positions.len();
    let masses = vec![1.0; springs.n_points()];
    let settings = over(6.0, 0.01);
    let mut motion =
        begin(&springs, initial(vec![0.0; n], vec![0.0; n]), &drive, settings).unwrap();
    go(&mut motion, 100);
    let refused = |springs: &SpringNetwork, settings: &MotionSettings, snapshot: Snapshot<'_>| {
        let watch = Watch::default();
        let found = Motion::resume(springs, &masses, &drive, settings, &watch, snapshot);
        match found {
            Err(error @ MotionError::OtherMotion { .. }) => error.to_string(),
            Err(error) => panic!("{error}"),
            Ok(_) => panic!("this was taken"),
        }
    };
    let stiff = SpringNetwork::lattice(&[6, 4], 1.0, linear);
    assert!(refused(&stiff, &settings, motion.snapshot()).contains("forces"));
    let longer = MotionSettings { end: 7.0, ..settings };
    assert!(refused(&springs, &longer, motion.snapshot()).contains("steps"));
    let mut cut = motion.snapshot();
    cut.arrays[1].to_mut().pop();
    assert!(refused(&springs, &settings, cut).contains("size"));
}

/// What a body does does not depend on who looks at it, from a train say.
#[test]
fn a_body_may_fly_further_in_a_step_than_it_is_large() {
    let springs = SpringNetwork::lattice(&[4, 3], 1.0, linear);
    let n = springs.positions.len();
    let swings: Vec<f64> = pseudo_random(n, 3).iter().map(|x| 0.01 * x).collect();
    let fly = |speed: f64| {
        let velocities = swings.iter().map(|v| v + speed).collect();
        let drive = Conditions::default();
        let mut motion =
            begin(&springs, initial(vec![0.0; n], velocities), &drive, over(10.0, 0.1)).unwrap();
        go(&mut motion, 100).energy.total()
    };
    let (slow, fast) = (fly(0.0), fly(1e3));
    assert!((slow - fast).abs() <= 1e-7 * slow, "{slow:e} {fast:e}");
}

#[test]
fn threads_do_not_change_a_bit() {
    let springs = SpringNetwork::lattice(&[150, 70], 1.0, linear);
    let n = springs.positions.len();
    let start = initial(vec![0.0; n], pseudo_random(n, 3).iter().map(|x| 0.01 * x).collect());
    let drive = Conditions { displaced: vec![0, 1], ..Conditions::default() };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let settings = MotionSettings { damping: 0.1, ..over(5.0, 0.1) };
            let mut motion = begin(&springs, start.clone(), &drive, settings).unwrap();
            let row = go(&mut motion, 50);
            (row, motion.u.value.clone(), motion.mean.clone())
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(4));
}
