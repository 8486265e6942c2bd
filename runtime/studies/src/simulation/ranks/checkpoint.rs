//! Where a motion over ranks stands: of each rank a part, that any number of ranks can read.
//!
//! A part has what is known of the rank's own points, and of the bonds, triangles and tetrahedra whose lowest point is its
//! own: these by the numbers of their points in the body, whose order is the same for any number of ranks. Parts are
//! written first, in files that take turns with those of the checkpoint before; then rank 0 writes the one that names
//! them. So there is a whole one at any time.

use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;

use piola_mechanics::energy::{Energy as _, Total};
use piola_mechanics::fracture::Fracture;
use piola_mechanics::kernel::Measure;
use piola_mechanics::materials::StateOf;
use piola_output::checkpoint::{Checkpoint, Header, Parts};
use piola_output::{OutputError, OutputFile};
use piola_petsc::Engine;
use piola_solvers::motion::{Motion, Snapshot};

use super::Begun;
use super::exchange::Exchange;
use super::share::Share;
use super::steps::agreed;
use crate::simulation::run::{RunError, hash};

/// Arrays of a part: of what points it is; of bonds, triangles and tetrahedra what is broken, by the points of each; of
/// those that remember how many each own point has, and their other points; and the states.
const RANGE: &str = "range";
const BROKEN: [&str; 3] = ["broken_bonds", "broken_areas", "broken_volumes"];
const COUNTS: [&str; 3] = ["bonds_of_point", "areas_of_point", "volumes_of_point"];
const MEMBERS: [&str; 3] = ["bonds", "areas", "volumes"];
const STATES: &str = "states";
/// Where families remember, the states of all that the rank holds: sums over families of the halo may have gone in another
/// order than their owners', and have other last bits.
const HELD_STATES: &str = "held_states";

type Arrays = Vec<(String, Cow<'static, [f64]>)>;

/// Writes and reads the parts.
pub(super) struct Store<'a> {
    engine: &'a Engine,
    share: &'a Share,
    energy: &'a Total<'a>,
    n_points: usize,
    /// Of the run, as rank 0 names it.
    pub(super) folder: &'a Path,
    pub(super) hash: String,
}

impl<'a> Store<'a> {
    pub(super) fn new(begun: &Begun<'a>) -> Store<'a> {
        let Begun { engine, share, energy, case, path: folder, .. } = *begun;
        let (n_points, hash) = (begun.parts.n_points, hash(case, &case.scene.resolved_toml()));
        Store { engine, share, energy, n_points, folder, hash }
    }

    /// Writes the parts of a checkpoint. Collective.
    ///
    /// # Errors
    /// A file that a rank cannot write.
    pub(super) fn write(
        &self,
        motion: &Motion<'_, Exchange<'_>>,
        turn: usize,
    ) -> Result<(), RunError> {
        let snapshot = motion.snapshot();
        let header = Header {
            scene_hash: self.hash.clone(),
            notes: snapshot.notes.to_vec(),
            ..Header::default()
        };
        let part = Checkpoint { header, arrays: self.arrays(&snapshot) };
        let written = part.write_part(self.folder, (turn, self.engine.rank()));
        agreed(self.engine, written.map_err(RunError::from))
    }

    fn arrays(&self, snapshot: &Snapshot<'_>) -> Arrays {
        let (own, d) = (self.share.own_of_held(), self.energy.dimension());
        let range = [self.share.own.start, self.share.own.end].map(|point| point as f64);
        let mut arrays: Vec<(&str, Vec<f64>)> = vec![
            (RANGE, range.to_vec()),
            (Snapshot::NAMES[Snapshot::NUMBERS], snapshot.arrays[Snapshot::NUMBERS].to_vec()),
        ];
        for place in Snapshot::VECTORS {
            let whole = &snapshot.arrays[place];
            let own = whole.get(own.start * d..own.end * d).unwrap_or_default().to_vec();
            arrays.push((Snapshot::NAMES[place], own));
        }
        if let Some(fracture) = self.energy.fracture() {
            self.add_status(fracture, &snapshot.arrays[Snapshot::STATES], &mut arrays);
        }
        arrays.into_iter().map(|(name, values)| (name.to_owned(), Cow::Owned(values))).collect()
    }

    /// What is broken and what is remembered of own interactions, of the states of all that are held.
    fn add_status(&self, fracture: &dyn Fracture, all: &[f64], arrays: &mut Vec<(&str, Vec<f64>)>) {
        let (own, first) = (self.share.own_of_held(), self.share.held.start);
        let number = |point: &usize| (first + point) as f64;
        let remembering = fracture.remembering();
        // Of each kind the numbers of own ones, and how many there are in all.
        let mut listed: [(Vec<usize>, usize); 3] = Default::default();
        for (kind, measure) in Measure::ALL.into_iter().enumerate() {
            let broken = broken(fracture, measure);
            let remembers = remembering.contains(&StateOf::Interactions(measure));
            let (mut gone, mut counts) = (Vec::new(), vec![0.0; own.len()]);
            let (mut members, (numbers, n)) = (Vec::new(), &mut listed[kind]);
            fracture.each(measure, &mut |place, points| {
                *n += 1;
                if !own.contains(&points[0]) {
                    return;
                }
                if broken.binary_search(&place).is_ok() {
                    gone.extend(points.iter().map(number));
                }
                if remembers {
                    numbers.push(place);
                    counts[points[0] - own.start] += 1.0;
                    members.extend(points[1..].iter().map(number));
                }
            });
            arrays.push((BROKEN[kind], gone));
            if remembers {
                arrays.extend([(COUNTS[kind], counts), (MEMBERS[kind], members)]);
            }
        }
        let (mut begin, mut states) = (0, Vec::new());
        for of in remembering {
            let n = match of {
                StateOf::Points => {
                    states.extend_from_slice(&all[begin + own.start..begin + own.end]);
                    self.share.held.len()
                }
                StateOf::Interactions(measure) => {
                    let (numbers, n) = &listed[measure as usize];
                    states.extend(numbers.iter().map(|number| all[begin + number]));
                    *n
                }
            };
            begin += n;
        }
        arrays.push((STATES, states));
        if !fracture.can_follow() {
            arrays.push((HELD_STATES, all.to_vec()));
        }
    }

    /// Where this rank's part of the motion stood, at a step of the motion. Of another number of ranks rank 0 takes over
    /// all sums and notes.
    ///
    /// # Errors
    /// A file that is not there, is damaged, or not of that checkpoint.
    pub(super) fn read(&self, parts: Parts, step: f64) -> Result<Snapshot<'static>, OutputError> {
        let rank = self.engine.rank();
        let is_alike = parts.n == self.engine.ranks();
        let ranges = Share::ranges(self.n_points, parts.n);
        let held = self.share.held.start as u64..self.share.held.end as u64;
        let mut vectors = Snapshot::VECTORS.map(|_| Vec::new());
        let (mut notes, mut numbers) = (Vec::new(), Vec::new());
        let mut status = Status::new(self.energy.fracture());
        let mut held_states = None;
        for (part, ends) in ranges.windows(2).enumerate() {
            let is_near = ends[0] < held.end && held.start < ends[1];
            let sums_here = if is_alike { part == rank } else { rank == 0 };
            if !is_near && !sums_here {
                continue;
            }
            let read = self.part((parts.turn, part), (ends, step))?;
            let told = read.array(Snapshot::NAMES[Snapshot::NUMBERS]).unwrap_or_default();
            match (sums_here, numbers.is_empty()) {
                (true, true) => numbers = told.to_vec(),
                (true, false) if !is_alike => Snapshot::add_numbers(&mut numbers, told),
                (false, true) if !is_alike => numbers = Snapshot::without_sums(told),
                _ => {}
            }
            if sums_here {
                let known = |note: &&String| !notes.contains(*note);
                let new: Vec<String> = read.header.notes.iter().filter(known).cloned().collect();
                notes.extend(new);
            }
            if is_alike && part == rank {
                held_states = read.array(HELD_STATES).map(<[f64]>::to_vec);
            }
            if is_near {
                self.take(&read, ends, &mut vectors);
                let taken = status.add(&read, ends, &self.share.held);
                taken.ok_or_else(|| self.damaged((parts.turn, part)))?;
            }
        }
        let [broken, states] =
            status.numbers(self.energy.fracture()).ok_or_else(|| self.damaged((parts.turn, 0)))?;
        let mut arrays: [Cow<'static, [f64]>; 9] = Default::default();
        arrays[Snapshot::NUMBERS] = Cow::Owned(numbers);
        for (place, vector) in Snapshot::VECTORS.into_iter().zip(vectors) {
            arrays[place] = Cow::Owned(vector);
        }
        if !is_alike {
            // They have other last bits.
            arrays[Snapshot::FORCES] = Cow::default();
        }
        arrays[Snapshot::BROKEN] = Cow::Owned(broken);
        arrays[Snapshot::STATES] = Cow::Owned(held_states.unwrap_or(states));
        Ok(Snapshot { arrays, notes: Cow::Owned(notes) })
    }

    /// The same with what was told on any rank, where there were others. Collective.
    pub(super) fn with_all_notes<'s>(&self, mut from: Snapshot<'s>, parts: Parts) -> Snapshot<'s> {
        if parts.n != self.engine.ranks() {
            let mut notes = from.notes.join("\n").into_bytes();
            self.engine.broadcast(&mut notes);
            let notes = String::from_utf8_lossy(&notes);
            from.notes = Cow::Owned(notes.lines().map(str::to_owned).collect());
        }
        from
    }

    fn damaged(&self, (turn, part): (usize, usize)) -> OutputError {
        let path = self.folder.join(OutputFile::CheckpointPart(turn, part).name());
        OutputError::Checkpoint { path }
    }

    /// A part, of the points between these, at that step.
    fn part(
        &self,
        place: (usize, usize),
        (ends, step): (&[u64], f64),
    ) -> Result<Checkpoint<'static>, OutputError> {
        let read = Checkpoint::read_part(self.folder, place)?;
        let expected: Vec<f64> = ends.iter().map(|end| *end as f64).collect();
        let d = self.energy.dimension();
        let n = (ends[1] - ends[0]) as usize * d;
        let has_size = |place: usize| {
            let length = read.array(Snapshot::NAMES[place]).map(<[f64]>::len);
            length == Some(n) || place == Snapshot::VELOCITIES_BEFORE && length == Some(0)
        };
        let is_it = read.header.scene_hash == self.hash
            && read.array(RANGE) == Some(&expected)
            && read.array(Snapshot::NAMES[Snapshot::NUMBERS]).and_then(<[f64]>::first)
                == Some(&step)
            && Snapshot::VECTORS.into_iter().all(has_size);
        if is_it { Ok(read) } else { Err(self.damaged(place)) }
    }

    /// Takes numbers of own points from a part: vectors of all that are held.
    fn take(&self, read: &Checkpoint<'_>, ends: &[u64], vectors: &mut [Vec<f64>]) {
        let (d, Share { own, held, .. }) = (self.energy.dimension(), self.share);
        let from = own.start.max(ends[0] as usize);
        let to = own.end.min(ends[1] as usize);
        for (place, vector) in Snapshot::VECTORS.into_iter().zip(vectors) {
            let values = read.array(Snapshot::NAMES[place]).unwrap_or_default();
            if values.is_empty() {
                continue;
            }
            vector.resize(held.len() * d, 0.0);
            if from < to {
                let begin = (from - ends[0] as usize) * d;
                let n = (to - from) * d;
                let there = (from - held.start) * d;
                vector[there..there + n].copy_from_slice(&values[begin..begin + n]);
            }
        }
    }
}

/// The numbers of what is broken of a kind, ascending.
fn broken(fracture: &dyn Fracture, measure: Measure) -> Vec<usize> {
    match measure {
        Measure::Length => fracture.broken(),
        Measure::Area | Measure::Volume => fracture.broken_cliques(measure),
    }
}

/// What parts tell of the status of what a rank holds: points by their places among those that are held, and the owner
/// again where an interaction has fewer than four.
#[derive(Default)]
struct Status {
    /// What is broken, and what remembers, of each kind in the order of its points.
    broken: [Vec<[u32; 4]>; 3],
    remembering: [Vec<[u32; 4]>; 3],
    kinds: Vec<StateOf>,
    /// State by state, in the order of what remembers it.
    states: Vec<Vec<f64>>,
}

impl Status {
    fn new(fracture: Option<&dyn Fracture>) -> Status {
        let kinds = fracture.map(|fracture| fracture.remembering()).unwrap_or_default();
        Status { states: kinds.iter().map(|_| Vec::new()).collect(), kinds, ..Status::default() }
    }

    /// Adds what a part tells of points between these ends; nothing if it is damaged.
    fn add(&mut self, read: &Checkpoint<'_>, ends: &[u64], held: &Range<usize>) -> Option<()> {
        let place = |number: &f64| {
            let number = *number as usize;
            held.contains(&number).then(|| (number - held.start) as u32)
        };
        let mut taken: [Vec<bool>; 3] = Default::default();
        for (kind, measure) in Measure::ALL.into_iter().enumerate() {
            let n = measure.points();
            for points in read.array(BROKEN[kind]).unwrap_or_default().chunks(n) {
                self.broken[kind].extend(corners(points.iter().map(place)));
            }
            let counts = read.array(COUNTS[kind]).unwrap_or_default();
            let mut members = read.array(MEMBERS[kind]).unwrap_or_default().chunks(n - 1);
            for (owner, count) in (ends[0]..).zip(counts) {
                for _ in 0..*count as usize {
                    let owner = owner as f64;
                    let points =
                        [place(&owner)].into_iter().chain(members.next()?.iter().map(place));
                    let found = corners(points);
                    taken[kind].push(found.is_some());
                    self.remembering[kind].extend(found);
                }
            }
        }
        let mut values = read.array(STATES).unwrap_or_default();
        for (kind, states) in self.kinds.iter().zip(&mut self.states) {
            let n = match kind {
                StateOf::Points => (ends[1] - ends[0]) as usize,
                StateOf::Interactions(measure) => taken[*measure as usize].len(),
            };
            let (own, rest) = values.split_at_checked(n)?;
            values = rest;
            let is_taken = |(place, value): (usize, &f64)| {
                let is_taken = match kind {
                    StateOf::Points => held.contains(&(ends[0] as usize + place)),
                    StateOf::Interactions(measure) => taken[*measure as usize][place],
                };
                is_taken.then_some(*value)
            };
            states.extend(own.iter().enumerate().filter_map(is_taken));
        }
        values.is_empty().then_some(())
    }

    /// The numbers of what is broken, kind behind kind, and all states, as snapshots have them; nothing where some are
    /// missing.
    fn numbers(&self, fracture: Option<&dyn Fracture>) -> Option<[Vec<f64>; 2]> {
        let Some(fracture) = fracture else { return Some(Default::default()) };
        let (mut gone, mut first) = (Vec::new(), 0);
        let mut all_remember = true;
        for (kind, measure) in Measure::ALL.into_iter().enumerate() {
            let mut broken = self.broken[kind].iter().peekable();
            let mut remembering = self.remembering[kind].iter();
            let remembers = self.kinds.contains(&StateOf::Interactions(measure));
            fracture.each(measure, &mut |number, points| {
                let points = corners(points.iter().map(|point| Some(*point as u32)));
                if broken.next_if(|one| Some(**one) == points).is_some() {
                    gone.push((first + number) as f64);
                }
                all_remember &= !remembers || remembering.next().copied() == points;
            });
            all_remember &= broken.next().is_none() && remembering.next().is_none();
            first += match measure {
                Measure::Length => fracture.n_bonds(),
                Measure::Area | Measure::Volume => fracture.n_cliques(measure),
            };
        }
        all_remember.then(|| [gone, self.states.concat()])
    }
}

/// Points of an interaction, where all are there.
fn corners(mut points: impl Iterator<Item = Option<u32>>) -> Option<[u32; 4]> {
    let owner = points.next()??;
    let mut corners = [owner; 4];
    for (corner, point) in corners[1..].iter_mut().zip(points) {
        *corner = point?;
    }
    Some(corners)
}
