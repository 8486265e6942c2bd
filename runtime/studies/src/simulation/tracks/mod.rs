//! The tips of cracks, and what breaks, row by row: `fracture.csv`.
//!
//! A point is of the crack where its damage is at least the threshold. Two such points hang together where
//! their cells touch: their bond at rest is no longer than sqrt(d) spacings, of a cloud sqrt(d) times the edge
//! of the mean volume. The crack is all that hangs together with the points that are damaged before anything
//! moves or, where none is, with those that are damaged first; its tip is the farthest of them along the axis.
//!
//! What there is to see says a [`Lookout`], of a body or of the part that a process has of it; a [`Log`] makes
//! the rows of it.

mod lookout;

use piola_mechanics::energy::Total;
use piola_output::fracture::{FractureColumns, FractureRow, TrackColumns, TrackRow};

use crate::case::Case;
use crate::moduli::rayleigh_speeds;
use crate::scene::selection::{Selection, typical_spacing};
use crate::scene::{Points, Scene, Track};
pub(super) use lookout::{Damaged, Lookout, Seen};

/// The part of a length by which rounding may make it longer.
const ROUNDED: f64 = 1e-6;

/// The cracks of a body that are followed, in one process.
pub(super) struct Tracks<'a> {
    lookout: Lookout<'a>,
    log: Log<'a>,
}

/// The rows of what is followed.
pub(super) struct Log<'a> {
    case: &'a Case,
    paths: Vec<Path<'a>>,
    /// Whether triangles and tetrahedra break by criteria of their own.
    has_cliques: [bool; 2],
    progress: Progress,
}

/// What stays as it is of a track.
struct Path<'a> {
    track: &'a Track,
    /// How long the front is across the body, in m.
    thickness: f64,
    /// Of each material, in m/s.
    rayleigh: Vec<Option<f64>>,
    has_speed: bool,
}

/// How far the rows are.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Progress {
    /// Bonds, triangles and tetrahedra that are broken.
    broken: [usize; 3],
    tracks: Vec<Way>,
}

/// How far a tip is.
#[derive(Clone, Debug, Default, PartialEq)]
struct Way {
    /// The points with which a crack hangs together.
    seeds: Vec<usize>,
    tip: Option<Tip>,
    /// Of each place of the tip the first row that had it there, back to a horizon behind the tip; of the place
    /// where it began the last.
    passed: Vec<Passed>,
}

/// The tip of a crack.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tip {
    /// The number of its point.
    point: usize,
    /// In m along the way of the track.
    at: f64,
    /// The number of its material.
    law: usize,
}

/// A row with a tip.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Passed {
    t: f64,
    /// In m along the way of the track.
    at: f64,
    /// In J.
    released: f64,
}

impl<'a> Tracks<'a> {
    /// Of a body before anything moves; nothing where nothing can break. A `motion` has speeds.
    pub(super) fn new(
        case: &'a Case,
        energy: &'a Total<'a>,
        selection: &Selection,
        motion: bool,
    ) -> Option<Tracks<'a>> {
        let spacing =
            typical_spacing(case.body.dimension(), case.body.volumes(), case.body.spacing());
        let lookout = Lookout::new(case, energy, selection, (spacing, 0))?;
        let log = Log::new(case, &|axis| extent(case, axis), lookout.seen(), motion);
        Some(Tracks { lookout, log })
    }

    pub(super) fn columns(&self) -> FractureColumns {
        self.log.columns()
    }

    pub(super) fn progress(&self) -> &Progress {
        &self.log.progress
    }

    /// Goes on where rows of an earlier run ended.
    pub(super) fn resume(&mut self, progress: Progress) {
        self.log.resume(progress);
    }

    /// The row at `t`, when the broken bonds had held so much, in J.
    pub(super) fn row(&mut self, t: f64, released: f64) -> FractureRow {
        let broken = self.lookout.broken();
        let damaged = self.log.wants_look(broken).then(|| self.lookout.damaged());
        self.log.row(t, released, Seen { broken, damaged: damaged.unwrap_or_default() })
    }
}

impl<'a> Log<'a> {
    /// Of a body of which so much is broken before anything moves, and whose extent along an axis is known, in m.
    pub(super) fn new(
        case: &'a Case,
        extent: &dyn Fn(usize) -> f64,
        seen: Seen,
        motion: bool,
    ) -> Log<'a> {
        let path = |track: &'a Track| {
            let (axis, _) = track.axis.number_and_sign();
            let [side, across] = sides(case.body.dimension(), axis, extent);
            let rayleigh = if motion { rayleigh_speeds(case, axis, side.0) } else { Vec::new() };
            let thickness = track.thickness.unwrap_or(match case.body.dimension() {
                2 => case.thickness(),
                _ => across.1,
            });
            Path { track, thickness, rayleigh, has_speed: motion }
        };
        let way = |damaged: &Damaged| Way { seeds: damaged.points.clone(), ..Way::default() };
        let broken = seen.broken.map(Option::unwrap_or_default);
        Log {
            case,
            paths: case.scene.tracks.iter().map(path).collect(),
            has_cliques: [seen.broken[1].is_some(), seen.broken[2].is_some()],
            progress: Progress { broken, tracks: seen.damaged.iter().map(way).collect() },
        }
    }

    pub(super) fn columns(&self) -> FractureColumns {
        let track = |path: &Path<'_>| TrackColumns {
            name: path.track.name.value.clone(),
            has_speed: path.has_speed,
            has_rayleigh: path.rayleigh.iter().any(Option::is_some),
        };
        let tracks = self.paths.iter().map(track).collect();
        FractureColumns { cliques: self.has_cliques, tracks }
    }

    #[cfg(feature = "petsc")]
    pub(super) fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Goes on where rows of an earlier run ended.
    pub(super) fn resume(&mut self, progress: Progress) {
        self.progress = progress;
    }

    /// Whether tips may be elsewhere than in the last row, where so much is broken.
    fn wants_look(&self, broken: [Option<usize>; 3]) -> bool {
        let has_changed = self.progress.broken != broken.map(Option::unwrap_or_default);
        has_changed || self.progress.tracks.iter().any(|way| way.tip.is_none())
    }

    /// The row at `t`, when the broken bonds had held so much, in J: damaged points are there if
    /// [they are wanted](Log::wants_look).
    pub(super) fn row(&mut self, t: f64, released: f64, seen: Seen) -> FractureRow {
        let now = seen.broken.map(Option::unwrap_or_default);
        let before = std::mem::replace(&mut self.progress.broken, now);
        let paths = self.paths.iter().zip(&mut self.progress.tracks);
        for ((path, way), damaged) in paths.zip(&seen.damaged) {
            if way.seeds.is_empty() {
                way.seeds.clone_from(&damaged.points);
            }
            way.tip = damaged.farthest(&way.seeds, path.sign()).map(|number| Tip {
                point: damaged.points[number],
                at: path.sign() * damaged.places[number],
                law: damaged.laws[number],
            });
        }
        let horizon = self.case.scene.horizon_radius();
        let paths = self.paths.iter().zip(&mut self.progress.tracks);
        let tracks = paths.map(|(path, way)| {
            let Some(tip) = way.tip else { return NOWHERE };
            let now = Passed { t, at: tip.at, released };
            way.take(now, horizon);
            path.row(way.window(horizon), now, tip)
        });
        let tracks = tracks.collect();
        // Bonds that load steps put back were never broken.
        let counts = |kind: usize| [now[kind].saturating_sub(before[kind]), now[kind]];
        FractureRow {
            t,
            bonds: counts(0),
            cliques: [1, 2].map(|kind| seen.broken[kind].map(|_| counts(kind))),
            released,
            tracks,
        }
    }
}

/// A track without a tip.
const NOWHERE: TrackRow =
    TrackRow { tip: f64::NAN, speed: 0.0, over_rayleigh: 0.0, released_per_area: f64::NAN };

/// How far the body reaches along an axis, in m: a box as the scene says, others as their points do.
pub(super) fn side(scene: &Scene, axis: usize, of_points: impl FnOnce() -> f64) -> f64 {
    match &scene.body.points {
        Points::Lattice(shape) => shape.high[axis] - shape.low[axis],
        Points::Cloud { .. } | Points::Mesh(_) => of_points(),
    }
}

/// The same of a body that is whole.
fn extent(case: &Case, axis: usize) -> f64 {
    side(&case.scene, axis, || {
        let d = case.body.dimension();
        let along = || case.body.positions().iter().skip(axis).step_by(d).copied();
        let edge = typical_spacing(d, case.body.volumes(), None);
        edge + along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    })
}

/// The two axes beside that of a track, with the extents of the body along them in m: first the longer one.
fn sides(d: usize, own: usize, extent: &dyn Fn(usize) -> f64) -> [(usize, f64); 2] {
    let mut others: Vec<(usize, f64)> =
        (0..d).filter(|axis| *axis != own).map(|axis| (axis, extent(axis))).collect();
    others.sort_by(|one, other| other.1.total_cmp(&one.1));
    [others[0], others[others.len() - 1]]
}

impl Path<'_> {
    /// 1 or -1.
    fn sign(&self) -> f64 {
        self.track.axis.number_and_sign().1
    }

    /// The row of a track whose tip is `now` there, and has come there by this window.
    fn row(&self, window: Option<[Passed; 2]>, now: Passed, tip: Tip) -> TrackRow {
        let rayleigh = self.rayleigh.get(tip.law).copied().flatten();
        let mut row = TrackRow { tip: self.sign() * now.at, ..NOWHERE };
        if let Some([then, there]) = window {
            let (way, time) = (there.at - then.at, there.t - then.t);
            let stands = now.t - there.t > time;
            row.speed = if stands { 0.0 } else { way / time };
            row.released_per_area = (there.released - then.released) / (way * self.thickness);
        }
        row.over_rayleigh = row.speed / rayleigh.unwrap_or(f64::NAN);
        row
    }
}

impl Way {
    /// Takes in a row with a tip.
    fn take(&mut self, row: Passed, horizon: f64) {
        match &mut self.passed[..] {
            // The clock of a crack that waits begins when it leaves.
            [first] if first.at == row.at => *first = row,
            [.., last] if last.at == row.at => {}
            _ => self.passed.push(row),
        }
        let is_behind = |passed: &Passed| row.at - passed.at >= horizon * (1.0 - ROUNDED);
        let behind = self.passed.iter().rposition(is_behind);
        self.passed.drain(..behind.unwrap_or(0));
    }

    /// Where the tip came to a place a horizon or more behind, and where it came to where it is; nothing as long
    /// as it has not run so far.
    fn window(&self, horizon: f64) -> Option<[Passed; 2]> {
        let (then, now) = (self.passed.first()?, self.passed.last()?);
        (now.at - then.at >= horizon * (1.0 - ROUNDED)).then_some([*then, *now])
    }
}

impl Progress {
    /// As numbers, for a checkpoint.
    pub(super) fn numbers(&self) -> Vec<f64> {
        let mut numbers: Vec<f64> = self.broken.iter().map(|n| *n as f64).collect();
        for Way { seeds, tip, passed } in &self.tracks {
            let tip = tip.map(|tip| [tip.point as f64, tip.at, tip.law as f64]);
            numbers.extend(tip.unwrap_or([-1.0; 3]));
            numbers.push(seeds.len() as f64);
            numbers.extend(seeds.iter().map(|seed| *seed as f64));
            numbers.push(passed.len() as f64);
            numbers.extend(passed.iter().flat_map(|one| [one.t, one.at, one.released]));
        }
        numbers
    }

    /// What [`Progress::numbers`] made of one with so many tracks on a body of so many points.
    pub(super) fn of_numbers(
        numbers: &[f64],
        n_tracks: usize,
        n_points: usize,
    ) -> Option<Progress> {
        let mut numbers = numbers.iter().copied();
        let count = |x: f64| (x >= 0.0 && x.fract() == 0.0).then_some(x as usize);
        let broken = [count(numbers.next()?)?, count(numbers.next()?)?, count(numbers.next()?)?];
        let mut tracks = Vec::new();
        for _ in 0..n_tracks {
            let tip = [numbers.next()?, numbers.next()?, numbers.next()?];
            let point = count(tip[0]).filter(|point| *point < n_points);
            let tip = point.zip(count(tip[2])).map(|(point, law)| Tip { point, at: tip[1], law });
            let n = count(numbers.next()?).filter(|n| *n <= n_points)?;
            let seeds: Option<Vec<usize>> = (0..n).map(|_| count(numbers.next()?)).collect();
            let n = count(numbers.next()?).filter(|n| *n <= numbers.len() / 3)?;
            let mut passed = || {
                Some(Passed { t: numbers.next()?, at: numbers.next()?, released: numbers.next()? })
            };
            let passed: Option<Vec<Passed>> = (0..n).map(|_| passed()).collect();
            tracks.push(Way { seeds: seeds?, tip, passed: passed? });
        }
        numbers.next().is_none().then_some(Progress { broken, tracks })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_are_over_the_last_horizon_and_progress_is_kept_to_the_bit() {
        let mut way = Way {
            seeds: vec![3, 5],
            tip: Some(Tip { point: 7, at: 0.5, law: 1 }),
            passed: Vec::new(),
        };
        let mut row = |t: f64, at: f64| {
            way.take(Passed { t, at, released: 10.0 * at }, 3.0);
            way.window(3.0).map(|window| window.map(|one| (one.t, one.at)))
        };
        for (t, at) in [(0.0, 0.0), (1.0, 0.0), (2.0, 1.0), (3.0, 2.0)] {
            assert_eq!(row(t, at), None, "no horizon yet");
        }
        // From when it left where it began.
        assert_eq!(row(4.0, 3.0), Some([(1.0, 0.0), (4.0, 3.0)]));
        assert_eq!(row(5.0, 5.5), Some([(3.0, 2.0), (5.0, 5.5)]));
        assert_eq!(row(9.0, 5.5), Some([(3.0, 2.0), (5.0, 5.5)]), "it has stopped");
        assert_eq!(way.passed.len(), 3, "what is farther behind is forgotten");
        let progress = Progress { broken: [1, 2, 3], tracks: vec![way, Way::default()] };
        let numbers = progress.numbers();
        assert_eq!(Progress::of_numbers(&numbers, 2, 8), Some(progress));
        for wrong in [&numbers[1..], &numbers[..numbers.len() - 1], &[]] {
            assert_eq!(Progress::of_numbers(wrong, 2, 8), None);
        }
    }
}
