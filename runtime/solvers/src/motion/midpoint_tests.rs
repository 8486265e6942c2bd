//! The implicit midpoint rule on networks of springs.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use piola_mechanics::testing::{SpringNetwork, linear, pseudo_random, softening};

use piola_mechanics::vector::norm_of;

use super::tests::{Conditions, begin, block, go, initial, over};
use super::*;
use crate::march::{Advance, March as _};
use crate::watch::{Event, Observer};

fn midpoint(end: f64, step: f64) -> MotionSettings {
    MotionSettings { method: Method::Midpoint, tolerance: 1e-13, ..over(end, step) }
}

fn distance(x: &[f64], y: &[f64]) -> f64 {
    norm_of(&x.iter().zip(y).map(|(x, y)| x - y).collect::<Vec<_>>())
}

#[test]
fn errors_go_with_the_square_of_the_step_and_both_rules_agree() {
    let (springs, mut drive, start) = block(softening);
    drive.driven = springs.dofs_where(|x| x[0] > 3.5 && x[1] < 1.5);
    drive.velocity = |t| 0.02 * t;
    drive.accelerated = springs.dofs_where(|x| x[0] > 3.5 && x[1] > 1.5);
    drive.acceleration = |t| 0.02 * libm::cos(3.0 * t);
    drive.load = |t, dof| if dof.is_multiple_of(2) { 1e-3 * libm::sin(t) } else { 0.0 };
    let at_end = |halvings: i32, settings: MotionSettings| {
        let mut motion = begin(&springs, start.clone(), &drive, settings).unwrap();
        go(&mut motion, 16 << halvings);
        let state = motion.state();
        [state.displacements.to_vec(), state.velocities.to_vec()]
    };
    for damping in [0.0, 0.3] {
        let step = |halvings: i32| 0.125 / f64::from(1 << halvings);
        let settings = |h: i32| MotionSettings { damping, ..midpoint(2.0, step(h)) };
        let ends: Vec<_> = (0..7).map(|h| at_end(h, settings(h))).collect();
        let explicit = at_end(6, MotionSettings { damping, ..over(2.0, step(6)) });
        for k in 0..2 {
            let changes: Vec<f64> =
                ends.windows(2).map(|pair| distance(&pair[0][k], &pair[1][k])).collect();
            let orders: Vec<f64> = changes.windows(2).map(|c| libm::log2(c[0] / c[1])).collect();
            assert!(orders.iter().all(|order| (order - 2.0).abs() <= 0.03), "{orders:?}");
            let apart = distance(&ends[6][k], &explicit[k]);
            assert!(apart < 3.0 * changes[5], "{apart:e} {changes:?}");
        }
    }
}

/// Steps beyond the critical one, with all that takes part in the account.
#[test]
fn the_account_closes_and_nothing_grows() {
    for law in [linear, softening] {
        let (springs, mut drive, mut start) = block(law);
        drive.driven = springs.dofs_where(|x| x[0] > 3.5 && x[1] < 1.5);
        drive.velocity = |t| 0.01 * libm::sin(t);
        drive.accelerated = springs.dofs_where(|x| x[0] > 3.5 && x[1] > 1.5);
        drive.acceleration = |t| 0.01 * libm::cos(t);
        drive.accelerated.iter().for_each(|dof| start.velocities[*dof] = 0.0);
        drive.load = |t, dof| if dof.is_multiple_of(3) { 1e-3 * t.min(1.0) } else { 0.0 };
        for (step, damping) in [(1.0, 0.0), (1.0, 0.1), (0.4, 0.02)] {
            let settings = MotionSettings { damping, rows: 7, ..midpoint(400.0 * step, step) };
            let mut motion = begin(&springs, start.clone(), &drive, settings).unwrap();
            let mut rows = vec![go(&mut motion, 0)];
            while let Advance::Step(row) = motion.advance().unwrap() {
                rows.push(row);
            }
            assert!(motion.step() > motion.critical().unwrap().seconds || step < 1.0);
            let worst = rows.iter().map(|row| row.rounding.abs()).fold(0.0, f64::max);
            assert!(worst <= 1e-12 * motion.balance.largest(), "{worst:e}");
            assert!(motion.notes().is_empty(), "{:?}", motion.notes());
            let last = rows.last().unwrap();
            assert!(last.prescribed != 0.0 && last.external != 0.0, "{last:?}");
            assert_eq!(last.damping > 0.0, damping > 0.0);
            assert!(last.kinetic < 10.0, "{last:?}");
        }
    }
}

/// A square that turns by a twentieth of a turn in a step beyond the critical one.
#[test]
fn momenta_are_kept_by_large_steps() {
    let springs = SpringNetwork::lattice(&[3, 3], 1.5, softening);
    let x = springs.positions.clone();
    let velocities: Vec<f64> =
        x.chunks_exact(2).flat_map(|x| [0.1 - 0.2 * (x[1] - 1.0), 0.2 * (x[0] - 1.0)]).collect();
    let drive = Conditions::default();
    let start = initial(vec![0.0; x.len()], velocities);
    let mut motion = begin(&springs, start, &drive, midpoint(1500.0, 1.5)).unwrap();
    let first = go(&mut motion, 0);
    let last = go(&mut motion, 1000);
    let spun = (last.angular_momentum[0] - first.angular_momentum[0]) / first.angular_momentum[0];
    assert!(spun.abs() <= 1e-11, "{spun:e}");
    for (p, known) in last.momentum.iter().zip(&first.momentum) {
        assert!((p - known).abs() <= 1e-12, "{:?}", last.momentum);
    }
    let energy = |row: &Row| row.kinetic + row.energy.total();
    let grown = energy(&last) / energy(&first) - 1.0;
    assert!(grown.abs() < 0.2, "{grown}");
    assert!(motion.step() > 1.2 * motion.critical().unwrap().seconds);
}

#[test]
fn it_goes_back_the_way_it_came_and_on_from_a_snapshot() {
    let (springs, held, start) = block(softening);
    let settings = MotionSettings { rows: 20, ..midpoint(200.0, 0.5) };
    let end = |start: &Initial| {
        let mut motion = begin(&springs, start.clone(), &held, settings).unwrap();
        go(&mut motion, 400);
        let state = motion.state();
        let turned = state.velocities.iter().map(|v| -v).collect();
        initial(state.displacements.to_vec(), turned)
    };
    let back = end(&end(&start));
    // Where nothing is held, which begins where the drive puts it.
    let free = |u: &[f64]| -> Vec<f64> {
        let dofs = (0..u.len()).filter(|dof| !held.displaced.contains(dof));
        dofs.map(|dof| u[dof]).collect()
    };
    let off = distance(&free(&back.displacements), &free(&start.displacements));
    assert!(off < 1e-9, "{off:e}");

    let masses = vec![1.0; springs.n_points()];
    let mut whole = begin(&springs, start.clone(), &held, settings).unwrap();
    go(&mut whole, 0);
    go(&mut whole, 60);
    let watch = Watch::default();
    let resumed = Motion::resume(&springs, &masses, &held, &settings, &watch, whole.snapshot());
    let mut resumed = resumed.unwrap();
    assert_eq!(go(&mut whole, 400), go(&mut resumed, 400));
    assert_eq!(whole.u.value, resumed.u.value);
}

#[test]
fn a_step_without_a_solution_is_named() {
    let springs = SpringNetwork::lattice(&[3, 2], 1.5, softening);
    let n = springs.positions.len();
    let velocities = pseudo_random(n, 8).iter().map(|x| 50.0 * x).collect();
    let drive = Conditions::default();
    let start = initial(vec![0.0; n], velocities);
    let found = begin(&springs, start, &drive, midpoint(1000.0, 100.0))
        .and_then(|mut motion| motion.advance_to(1).map(|_| ()));
    let told = found.unwrap_err().to_string();
    assert!(told.contains("t = "), "{told}");
}

/// Gives an end once so many were asked for.
struct Impatient {
    asked: AtomicUsize,
    end: usize,
}

impl Observer for Impatient {
    fn notice(&self, _: Event<'_>) {}

    fn wants_end(&self) -> bool {
        self.asked.fetch_add(1, Ordering::Relaxed) >= self.end
    }
}

#[test]
fn an_end_gives_a_step_up_and_is_followed_by_the_same_bits() {
    let (springs, drive, start) = block(softening);
    let masses = vec![1.0; springs.n_points()];
    let settings = MotionSettings { rows: 3, ..midpoint(6.0, 0.5) };
    let mut whole = begin(&springs, start.clone(), &drive, settings).unwrap();
    let last = go(&mut whole, 12);
    let mut seen = Vec::new();
    for end in (0..2000).step_by(9) {
        let watch = Watch::by(Arc::new(Impatient { asked: AtomicUsize::new(0), end }));
        let begun = Motion::new(&springs, &masses, start.clone(), &drive, &settings, &watch);
        let mut motion = begun.unwrap();
        motion.advance_to(0).unwrap();
        let see = &mut |row: &Row, _: &Motion<'_>| {
            seen.push(row.step);
            std::ops::ControlFlow::Continue(())
        };
        if crate::march::march(&mut motion, see).unwrap().is_continue() {
            break;
        }
        let (watch, snapshot) = (Watch::default(), motion.snapshot());
        let resumed = Motion::resume(&springs, &masses, &drive, &settings, &watch, snapshot);
        let mut resumed = resumed.unwrap();
        assert_eq!(go(&mut resumed, 12).energy, last.energy, "{end}");
        assert_eq!(resumed.u.value, whole.u.value, "{end}");
    }
    // Ends at and between rows, which are at steps 4, 8 and 12.
    assert!(seen.contains(&3) && seen.contains(&4), "{seen:?}");
}

#[test]
fn pauses_come_between_rows_and_change_nothing() {
    let (springs, drive, start) = block(softening);
    let settings = MotionSettings { rows: 2, ..midpoint(6.0, 0.5) };
    let mut whole = begin(&springs, start.clone(), &drive, settings).unwrap();
    let rows: Vec<Row> = [0, 6, 12].map(|step| go(&mut whole, step)).to_vec();
    let masses = vec![1.0; springs.n_points()];
    let mut motion = begin(&springs, start, &drive, settings).unwrap();
    motion.pause_every(Duration::ZERO);
    let (mut found, mut pauses) = (vec![go(&mut motion, 0)], 0);
    loop {
        match motion.advance().unwrap() {
            Advance::Step(row) => found.push(row),
            Advance::Pause => {
                pauses += 1;
                let (watch, snapshot) = (Watch::default(), motion.snapshot());
                let resumed =
                    Motion::resume(&springs, &masses, &drive, &settings, &watch, snapshot);
                assert_eq!(go(&mut resumed.unwrap(), 12), rows[2]);
            }
            _ => break,
        }
    }
    assert_eq!((found, pauses), (rows, 10));
}
