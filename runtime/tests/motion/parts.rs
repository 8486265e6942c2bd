//! Bodies in parts, each moved by a thread as processes move them, against the same bodies as a whole.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, Barrier, Mutex};

use piola_runtime::body::Body;
use piola_runtime::fracture::Breaking;
use piola_runtime::solve::march::{Advance, March as _};
use piola_runtime::solve::motion::{
    Initial, Motion, MotionError, MotionSettings, Others, Row, Snapshot,
};
use piola_runtime::solve::{Event, Observer, Watch};

use crate::Conditions;
use crate::cliques::{bodies, breaking_from, settings, start};

/// Where threads meet, and lay down what they have.
struct Meeting {
    barrier: Barrier,
    laid_down: Mutex<Vec<Vec<f64>>>,
}

impl Meeting {
    fn of(parts: usize) -> Meeting {
        Meeting { barrier: Barrier::new(parts), laid_down: Mutex::new(vec![Vec::new(); parts]) }
    }
}

/// A part of a body: points that it holds, and those that are its own.
struct Part<'a> {
    meeting: &'a Meeting,
    number: usize,
    held: Range<usize>,
    own: Range<usize>,
    d: usize,
}

impl Part<'_> {
    /// What all parts have.
    fn all(&self, own: &[f64]) -> Vec<Vec<f64>> {
        self.meeting.laid_down.lock().unwrap()[self.number] = own.to_vec();
        self.meeting.barrier.wait();
        let all = self.meeting.laid_down.lock().unwrap().clone();
        self.meeting.barrier.wait();
        all
    }

    fn reduce(&self, numbers: &mut [f64], with: impl Fn(f64, f64) -> f64) {
        let all = self.all(numbers);
        for (k, number) in numbers.iter_mut().enumerate() {
            *number = all[1..].iter().fold(all[0][k], |sum, part| with(sum, part[k]));
        }
    }
}

impl Others for Part<'_> {
    fn first(&self) -> usize {
        self.held.start
    }

    fn bring(&self, values: &mut [f64]) {
        let (d, first) = (self.d, self.held.start);
        let own = (self.own.start - first) * d..(self.own.end - first) * d;
        let whole = self.all(&values[own]).concat();
        values.copy_from_slice(&whole[first * d..self.held.end * d]);
    }

    fn are_there(&self) -> bool {
        true
    }

    fn share(&self, pairs: &mut Vec<[usize; 2]>) {
        let first = self.held.start;
        let own: Vec<f64> = pairs.iter().flatten().map(|point| (first + point) as f64).collect();
        let all = self.all(&own).concat();
        let is_held = |pair: &&[f64; 2]| pair.iter().all(|x| self.held.contains(&(*x as usize)));
        let held = all.as_chunks::<2>().0.iter().filter(is_held);
        *pairs = held.map(|pair| pair.map(|number| number as usize - first)).collect();
        pairs.sort_unstable();
        pairs.dedup();
    }

    fn sum(&self, numbers: &mut [f64]) {
        self.reduce(numbers, |sum, part| sum + part);
    }

    fn max(&self, numbers: &mut [f64]) {
        self.reduce(numbers, |most, part| if part > most || part.is_nan() { part } else { most });
    }
}

/// What a motion leaves of own points: rows, displacements at the end, and why it ended early.
struct Left {
    step: f64,
    rows: Vec<Row>,
    displacements: Vec<f64>,
    error: Option<MotionError>,
}

fn moved(made: Result<Motion<'_, Part<'_>>, MotionError>, own: Range<usize>) -> Left {
    let mut left = Left { step: 0.0, rows: Vec::new(), displacements: Vec::new(), error: None };
    let mut motion = match made {
        Ok(motion) => motion,
        Err(error) => return Left { error: Some(error), ..left },
    };
    let mut next = motion.advance_to(0);
    loop {
        match next {
            Ok(Advance::Step(row)) => left.rows.push(row),
            Ok(Advance::End) => break,
            Ok(_) => panic!("nobody looks on"),
            Err(error) => {
                left.error = Some(error);
                break;
            }
        }
        next = motion.advance();
    }
    left.step = motion.step();
    left.displacements = motion.state().displacements[own].to_vec();
    left
}

/// How far below nothing triangles are at rest: some create energy when they break.
const BELOW: f64 = 0.06;

/// What a part is moved with.
struct Ready<'a> {
    part: Part<'a>,
    energy: Breaking,
    masses: Vec<f64>,
    start: Initial,
    drive: Conditions,
    /// Degrees of freedom of own points.
    own: Range<usize>,
}

/// Of a body in so many parts, in their order: what each leaves.
fn of_parts<T: Send>(
    (body, horizon): (&Arc<Body>, f64),
    parts: usize,
    velocities: f64,
    then: impl Fn(Ready<'_>) -> T + Sync,
) -> Vec<T> {
    let (d, n) = (body.dimension(), body.n_points());
    let meeting = Meeting::of(parts);
    let along = |point: usize| body.position(point)[0];
    let part = |number: usize| {
        let own = n * number / parts..n * (number + 1) / parts;
        let near = |point: &usize| {
            along(own.start) - along(*point) <= 1.001 * horizon
                && along(*point) - along(own.end - 1) <= 1.001 * horizon
        };
        let held: Vec<usize> = (0..n).filter(near).collect();
        let held = held[0]..held[held.len() - 1] + 1;
        Part { meeting: &meeting, number, held, own, d }
    };
    let of_part = |part: Part<'_>| {
        let slab = Arc::new(body.part(part.held.clone(), part.own.clone(), horizon));
        let kept: Vec<usize> =
            [3, 4].into_iter().filter_map(|k: usize| k.checked_sub(part.held.start)).collect();
        let energy = breaking_from((&slab, horizon), &kept, BELOW);
        let whole = start(body, 9);
        let held = part.held.start * d..part.held.end * d;
        let scaled = |x: &f64| velocities * x;
        let start = Initial {
            displacements: whole.displacements[held.clone()].to_vec(),
            velocities: whole.velocities[held].iter().map(scaled).collect(),
        };
        let masses: Vec<f64> = slab.volumes().iter().map(|v| 1e3 * v).collect();
        let drive = Conditions { loads: vec![0.0; d * slab.n_points()], ..Conditions::default() };
        let own = slab.counted();
        let own = own.start * d..own.end * d;
        then(Ready { part, energy, masses, start, drive, own })
    };
    let of_part = &of_part;
    std::thread::scope(|scope| {
        let all: Vec<_> =
            (0..parts).map(|number| scope.spawn(move || of_part(part(number)))).collect();
        all.into_iter().map(|one| one.join().unwrap()).collect()
    })
}

fn in_parts(
    body: (&Arc<Body>, f64),
    parts: usize,
    settings: &MotionSettings,
    velocities: f64,
) -> Vec<Left> {
    of_parts(body, parts, velocities, |ready| {
        let Ready { part, energy, masses, start, drive, own } = ready;
        let watch = Watch::default();
        moved(Motion::among(&part, &energy, &masses, start, &drive, settings, &watch), own)
    })
}

#[test]
fn parts_move_and_break_as_the_whole() {
    for (number, (body, horizon)) in bodies().iter().enumerate() {
        let settings = settings();
        let whole = &in_parts((body, *horizon), 1, &settings, 1.0)[0];
        let last = whole.rows.last().unwrap();
        assert!(last.broken > Some(20) && last.broken_cliques[0] > Some(0), "{last:?}");
        assert!(last.created > 0.0, "{last:?}");
        for parts in 2..=3 {
            let found = in_parts((body, *horizon), parts, &settings, 1.0);
            let displacements: Vec<f64> =
                found.iter().flat_map(|left| left.displacements.clone()).collect();
            let largest = displacements.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
            for (one, other) in whole.displacements.iter().zip(&displacements) {
                assert!((one - other).abs() <= 1e-11 * largest, "{number}: {one} {other}");
            }
            for left in &found {
                assert_eq!(left.rows.len(), whole.rows.len());
                for (one, other) in whole.rows.iter().zip(&left.rows) {
                    assert_eq!(one.broken, other.broken, "{number} at step {}", one.step);
                    assert_eq!(one.broken_cliques, other.broken_cliques);
                    let scale = one.kinetic + one.energy.total().abs() + one.released.abs();
                    let pairs = [
                        (one.kinetic, other.kinetic),
                        (one.energy.total(), other.energy.total()),
                        (one.released, other.released),
                        (one.timing, other.timing),
                        (one.created, other.created),
                        (one.quadrature, other.quadrature),
                        (one.rounding, other.rounding),
                    ];
                    for (own, found) in pairs {
                        assert!((own - found).abs() <= 1e-11 * scale, "{one:?}\n{other:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn all_parts_find_one_critical_step() {
    let (body, horizon) = &bodies()[2];
    let settings = MotionSettings { step: None, end: 0.05, rows: 5, ..settings() };
    let whole = in_parts((body, *horizon), 1, &settings, 0.1);
    for left in in_parts((body, *horizon), 3, &settings, 0.1) {
        assert!((left.step - whole[0].step).abs() <= 1e-9 * whole[0].step);
    }
}

/// One part knows why, the others that there is a reason.
#[test]
fn where_one_part_cannot_go_on_all_stop() {
    let (body, horizon) = &bodies()[2];
    let found = in_parts((body, *horizon), 3, &settings(), 1e6);
    let knows = |left: &&Left| !matches!(left.error, Some(MotionError::Elsewhere));
    let knowing: Vec<&Left> = found.iter().filter(knows).collect();
    assert_eq!(knowing.len(), 1);
    assert!(matches!(knowing[0].error, Some(MotionError::FlownOff(_))), "{:?}", knowing[0].error);
}

/// Who wants an end from the start.
struct Hurried;

impl Observer for Hurried {
    fn notice(&self, _: Event<'_>) {}

    fn wants_end(&self) -> bool {
        true
    }
}

/// One part is told to end before it goes on where it stood; all make the same step, and stop.
#[test]
fn parts_that_go_on_end_together() {
    let (body, horizon) = &bodies()[2];
    let settings = settings();
    let steps = of_parts((body, *horizon), 3, 1.0, |ready| {
        let Ready { part, energy, masses, start, drive, .. } = ready;
        let watch = Watch::default();
        let made = Motion::among(&part, &energy, &masses, start, &drive, &settings, &watch);
        let mut motion = made.unwrap();
        assert!(matches!(motion.advance_to(2), Ok(Advance::Step(_))));
        let Snapshot { arrays, notes } = motion.snapshot();
        let arrays = arrays.map(|array| Cow::Owned(array.into_owned()));
        let snapshot = Snapshot { arrays, notes: Cow::Owned(notes.into_owned()) };
        drop(motion);
        // The energy that goes on has lost what is broken.
        let watch = if part.number == 1 { Watch::by(Arc::new(Hurried)) } else { watch };
        let (masses, drive) = (&masses[..], &drive);
        let again =
            Motion::resume_among(&part, &energy, masses, drive, &settings, &watch, snapshot);
        let mut motion = again.unwrap();
        assert!(matches!(motion.advance(), Ok(Advance::Step(_))));
        assert!(matches!(motion.advance(), Ok(Advance::Interrupted)));
        motion.step_reached()
    });
    assert_eq!(steps, [3; 3]);
}
