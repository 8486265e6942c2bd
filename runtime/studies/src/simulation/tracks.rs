//! The tips of cracks, and what breaks, row by row: `fracture.csv`.
//!
//! A point is of the crack where its damage is at least the threshold. Two such points hang together where
//! their cells touch: their bond at rest is no longer than sqrt(d) spacings, of a cloud sqrt(d) times the edge
//! of the mean volume. The crack is all that hangs together with the points that are damaged before anything
//! moves or, where none is, with those that are damaged first; its tip is the farthest of them along the axis.

use piola_mechanics::energy::{Energy as _, Total};
use piola_mechanics::kernel::Measure;
use piola_output::fracture::{FractureColumns, FractureRow, TrackColumns, TrackRow};

use crate::case::Case;
use crate::moduli::rayleigh_speeds;
use crate::scene::selection::{Selection, typical_spacing};
use crate::scene::{Points, Track};

/// The part of a length by which rounding may make it longer.
const ROUNDED: f64 = 1e-6;

/// The cracks of a body that are followed.
pub(super) struct Tracks<'a> {
    case: &'a Case,
    energy: &'a Total<'a>,
    paths: Vec<Path<'a>>,
    /// The longest distance of points that hang together, in m.
    reach: f64,
    progress: Progress,
}

/// What stays as it is of a track.
struct Path<'a> {
    track: &'a Track,
    /// Whether a point counts; nothing where all do.
    is_in: Option<Vec<bool>>,
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
    /// The point at the tip.
    tip: Option<usize>,
    /// Of each place of the tip the first row that had it there, back to a horizon behind the tip; of the place
    /// where it began the last.
    passed: Vec<Passed>,
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
        let damage = energy.fracture()?.damage();
        let d = case.body.dimension();
        let path = |track: &'a Track| {
            let [side, across] = sides(case, track);
            let is_in = track.set.map(|set| {
                let mut is_in = vec![false; case.body.n_points()];
                selection.sets[set.value].points.iter().for_each(|point| is_in[*point] = true);
                is_in
            });
            let (axis, _) = track.axis.number_and_sign();
            let rayleigh = if motion { rayleigh_speeds(case, axis, side.0) } else { Vec::new() };
            let thickness = track.thickness.unwrap_or(match d {
                2 => case.thickness(),
                _ => across.1,
            });
            Path { track, is_in, thickness, rayleigh, has_speed: motion }
        };
        let spacing = typical_spacing(d, case.body.volumes(), case.body.spacing());
        let mut tracks = Tracks {
            case,
            energy,
            paths: case.scene.tracks.iter().map(path).collect(),
            reach: (d as f64).sqrt() * spacing * (1.0 + ROUNDED),
            progress: Progress::default(),
        };
        let way = |path: &Path<'_>| Way { seeds: path.damaged(&damage), ..Way::default() };
        tracks.progress.tracks = tracks.paths.iter().map(way).collect();
        tracks.progress.broken = tracks.broken();
        Some(tracks)
    }

    pub(super) fn columns(&self) -> FractureColumns {
        let track = |path: &Path<'_>| TrackColumns {
            name: path.track.name.value.clone(),
            has_speed: path.has_speed,
            has_rayleigh: path.rayleigh.iter().any(Option::is_some),
        };
        FractureColumns {
            cliques: [Measure::Area, Measure::Volume].map(|measure| self.counts(measure).is_some()),
            tracks: self.paths.iter().map(track).collect(),
        }
    }

    pub(super) fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Goes on where rows of an earlier run ended.
    pub(super) fn resume(&mut self, progress: Progress) {
        self.progress = progress;
    }

    fn counts(&self, measure: Measure) -> Option<usize> {
        Some(self.energy.fracture()?.counts_of(measure)?[1])
    }

    fn broken(&self) -> [usize; 3] {
        self.energy.fracture().map_or([0; 3], |fracture| fracture.n_broken())
    }

    /// The row at `t`, when the broken bonds had held so much, in J.
    pub(super) fn row(&mut self, t: f64, released: f64) -> FractureRow {
        let now = self.broken();
        let before = std::mem::replace(&mut self.progress.broken, now);
        let has_changed = before != now || self.progress.tracks.iter().any(|way| way.tip.is_none());
        let fracture = self.energy.fracture().filter(|_| has_changed && !self.paths.is_empty());
        if let Some(damage) = fracture.map(|fracture| fracture.damage()) {
            for (path, way) in self.paths.iter().zip(&mut self.progress.tracks) {
                if way.seeds.is_empty() {
                    way.seeds = path.damaged(&damage);
                }
                way.tip = path.tip((self.case, self.energy), self.reach, &damage, &way.seeds);
            }
        }
        let horizon = self.case.scene.horizon_radius();
        let paths = self.paths.iter().zip(&mut self.progress.tracks);
        let tracks = paths.map(|(path, way)| {
            let Some(tip) = way.tip else { return NOWHERE };
            let now = Passed { t, at: path.place(self.case, tip), released };
            way.take(now, horizon);
            path.row(way.window(horizon), now, self.case, tip)
        });
        let tracks = tracks.collect();
        // Bonds that load steps put back were never broken.
        let counts = |kind: usize| [now[kind].saturating_sub(before[kind]), now[kind]];
        FractureRow {
            t,
            bonds: counts(0),
            cliques: [(1, Measure::Area), (2, Measure::Volume)]
                .map(|(kind, measure)| self.counts(measure).map(|_| counts(kind))),
            released,
            tracks,
        }
    }
}

/// A track without a tip.
const NOWHERE: TrackRow =
    TrackRow { tip: f64::NAN, speed: 0.0, over_rayleigh: 0.0, released_per_area: f64::NAN };

/// The two axes beside that of a track, with the extents of the body along them in m: first the longer one.
fn sides(case: &Case, track: &Track) -> [(usize, f64); 2] {
    let (own, _) = track.axis.number_and_sign();
    let d = case.body.dimension();
    let extent = |axis: usize| match &case.scene.body.points {
        Points::Lattice(shape) => shape.high[axis] - shape.low[axis],
        Points::Cloud { .. } | Points::Mesh(_) => {
            let along = || case.body.positions().iter().skip(axis).step_by(d).copied();
            let edge = typical_spacing(d, case.body.volumes(), None);
            edge + along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
        }
    };
    let mut others: Vec<(usize, f64)> =
        (0..d).filter(|axis| *axis != own).map(|axis| (axis, extent(axis))).collect();
    others.sort_by(|one, other| other.1.total_cmp(&one.1));
    [others[0], others[others.len() - 1]]
}

impl Path<'_> {
    /// The points that are damaged.
    fn damaged(&self, damage: &[f64]) -> Vec<usize> {
        let is_in = |point: usize| self.is_in.as_ref().is_none_or(|is_in| is_in[point]);
        let points = 0..damage.len();
        points.filter(|point| damage[*point] >= self.track.threshold && is_in(*point)).collect()
    }

    /// How far along the way of the track a point is, in m.
    fn place(&self, case: &Case, point: usize) -> f64 {
        let (axis, sign) = self.track.axis.number_and_sign();
        sign * case.body.position(point)[axis]
    }

    /// The farthest of the damaged points that hang together with the seeds.
    fn tip(
        &self,
        (case, energy): (&Case, &Total<'_>),
        reach: f64,
        damage: &[f64],
        seeds: &[usize],
    ) -> Option<usize> {
        let damaged = self.damaged(damage);
        let mut pieces = Pieces::of(damaged.len());
        let bonds = energy.bonds();
        for (number, &point) in damaged.iter().enumerate() {
            let row = &bonds.columns[bonds.row_start[point]..bonds.row_start[point + 1]];
            for other in row.iter().map(|other| *other as usize).filter(|other| *other > point) {
                let Ok(other_number) = damaged.binary_search(&other) else { continue };
                let [p, q] = [point, other].map(|point| case.body.position(point));
                let squared = p.iter().zip(q).map(|(p, q)| (p - q) * (p - q)).sum::<f64>();
                if squared <= reach * reach {
                    pieces.join(number, other_number);
                }
            }
        }
        let mut is_of_crack = vec![false; damaged.len()];
        for number in seeds.iter().filter_map(|seed| damaged.binary_search(seed).ok()) {
            is_of_crack[pieces.root(number)] = true;
        }
        let own = (0..damaged.len()).filter(|number| is_of_crack[pieces.root(*number)]);
        let own = own.map(|number| damaged[number]);
        // Of those that are equally far, the first in the body's order.
        own.fold(None, |tip: Option<usize>, point| {
            let is_farther = tip.is_none_or(|tip| self.place(case, point) > self.place(case, tip));
            if is_farther { Some(point) } else { tip }
        })
    }

    /// The row of a track whose tip is `now` there, and has come there by this window.
    fn row(&self, window: Option<[Passed; 2]>, now: Passed, case: &Case, tip: usize) -> TrackRow {
        let (_, sign) = self.track.axis.number_and_sign();
        let law = case.materials.as_ref().map_or(0, |materials| usize::from(materials.of(tip)));
        let rayleigh = self.rayleigh.get(law).copied().flatten();
        let mut row = TrackRow { tip: sign * now.at, ..NOWHERE };
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

/// Numbers that hang together.
struct Pieces(Vec<usize>);

impl Pieces {
    fn of(n: usize) -> Pieces {
        Pieces((0..n).collect())
    }

    fn root(&mut self, mut number: usize) -> usize {
        while self.0[number] != number {
            self.0[number] = self.0[self.0[number]];
            number = self.0[number];
        }
        number
    }

    fn join(&mut self, one: usize, other: usize) {
        let (one, other) = (self.root(one), self.root(other));
        self.0[one.max(other)] = one.min(other);
    }
}

impl Progress {
    /// As numbers, for a checkpoint.
    pub(super) fn numbers(&self) -> Vec<f64> {
        let mut numbers: Vec<f64> = self.broken.iter().map(|n| *n as f64).collect();
        for Way { seeds, tip, passed } in &self.tracks {
            numbers.push(tip.map_or(-1.0, |tip| tip as f64));
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
            let tip = count(numbers.next()?).filter(|tip| *tip < n_points);
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
        let mut way = Way { seeds: vec![3, 5], tip: Some(7), passed: Vec::new() };
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
