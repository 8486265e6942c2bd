//! What a body in motion leaves, row by row.

use std::borrow::Cow;

use piola_mechanics::energy::Energy as _;
use piola_mechanics::interaction::Inverted;
use piola_output::checkpoint::{Checkpoint, Header};
use piola_output::motion::{MotionColumns, MotionSummary, MotionTables};
use piola_output::picture::{Charts, Picture};
use piola_output::pvd::FrameSeries;
use piola_output::{Frame, OutputError, OutputFile, OutputFolder, Points, table};
use piola_solvers::march::State;
use piola_solvers::motion::{self, Row, Snapshot};

use super::course::Unclosed;
use super::told::{self, Seen};
use crate::case::Case;
use crate::scene::Motion;
use crate::simulation::point_fields::PointFields;
use crate::simulation::run::{Origin, frame};
use crate::simulation::tracks::{Progress, Tracks};

/// What is recorded, and where.
pub(super) struct Run<'a> {
    /// The body, its energy, its sets and what frames have of them.
    pub(super) fields: PointFields<'a>,
    /// Of a body that can break, before anything moved.
    pub(super) tracks: Option<Tracks<'a>>,
    pub(super) folder: &'a OutputFolder,
    pub(super) points: &'a Points,
}

/// What checkpoints know of a run.
pub(in crate::simulation) fn header(origin: Origin<'_>, hash: &str) -> Header {
    let (scene, settings) = (origin.scene.to_owned(), origin.settings.to_vec());
    Header { scene, settings, scene_hash: hash.to_owned(), ..Header::default() }
}

fn columns(fields: &PointFields<'_>, tracks: Option<&Tracks<'_>>) -> MotionColumns {
    let PointFields { case, energy, selection, .. } = *fields;
    told::columns(case, energy, selection, tracks.map(Tracks::columns))
}

/// Writes what the rows bring.
pub(super) struct Recorder<'a> {
    fields: PointFields<'a>,
    tracks: Option<Tracks<'a>>,
    folder: &'a OutputFolder,
    points: &'a Points,
    frames: FrameSeries<'a>,
    tables: MotionTables,
    last: Option<(Row, Frame)>,
    /// How many steps led to the last row, and its time in s.
    reached: (usize, f64),
    /// When the last frame was written.
    framed: Option<f64>,
    /// The largest part of the account that did not close, over the largest energy.
    worst: Unclosed,
    /// What every checkpoint of the run begins with.
    known: Header,
    /// What a checkpoint before the last row would hold of the output.
    before: Mark,
    /// From which step the run was taken up.
    resumed: Option<usize>,
}

/// How far the output is.
#[derive(Clone, Debug, Default)]
pub(in crate::simulation) struct Mark {
    /// Lengths in bytes.
    pub(in crate::simulation) tables: Vec<u64>,
    pub(in crate::simulation) frames: usize,
    pub(in crate::simulation) worst: Unclosed,
    pub(in crate::simulation) tracks: Option<Progress>,
}

/// Arrays of a checkpoint beside those of the motion.
const FRAME_TIMES: &str = "frame_times";
const WORST: &str = "worst";
const TRACKS: &str = "tips";

impl Mark {
    /// As arrays of a checkpoint, where frames are at these times in s, and maybe later ones; its header has the tables.
    pub(in crate::simulation) fn arrays<'t>(
        &self,
        times: &'t [f64],
    ) -> Vec<(String, Cow<'t, [f64]>)> {
        let worst = vec![self.worst.rounding, self.worst.largest];
        let mut arrays = vec![
            (FRAME_TIMES.to_owned(), Cow::Borrowed(&times[..self.frames])),
            (WORST.to_owned(), Cow::Owned(worst)),
        ];
        let tracks = self.tracks.as_ref().map(|progress| Cow::Owned(progress.numbers()));
        arrays.extend(tracks.map(|numbers| (TRACKS.to_owned(), numbers)));
        arrays
    }

    /// What [`Mark::arrays`] made of one, with the times of frames in s: of a case of so many points, `breaks` where
    /// something in it can. Nothing where arrays are missing.
    pub(in crate::simulation) fn of(
        earlier: &Checkpoint<'_>,
        (case, n_points, breaks): (&Case, usize, bool),
    ) -> Option<(Mark, Vec<f64>)> {
        let times = earlier.array(FRAME_TIMES)?.to_vec();
        let &[rounding, largest] = earlier.array(WORST)? else { return None };
        let tracks = match breaks {
            true => {
                let n_tracks = case.scene.tracks.len();
                Some(Progress::of_numbers(earlier.array(TRACKS)?, n_tracks, n_points)?)
            }
            false => None,
        };
        let worst = Unclosed { rounding, largest };
        let (tables, frames) = (earlier.header.tables.clone(), times.len());
        Some((Mark { tables, frames, worst, tracks }, times))
    }
}

impl<'a> Recorder<'a> {
    pub(super) fn new(run: Run<'a>, known: Header) -> Result<Recorder<'a>, OutputError> {
        let columns = columns(&run.fields, run.tracks.as_ref());
        let tables = MotionTables::new(run.folder, &columns)?;
        let frames = FrameSeries::new(run.folder, run.points)?;
        Ok(Recorder::with(run, known, frames, tables))
    }

    /// Goes on where an earlier run stood; what it wrote after that is written again.
    pub(super) fn resume(
        mut run: Run<'a>,
        known: Header,
        earlier: &Checkpoint<'_>,
        motion: &motion::Motion<'_>,
    ) -> Result<Recorder<'a>, OutputError> {
        let case = run.fields.case;
        let mark = Mark::of(earlier, (case, case.body.n_points(), run.tracks.is_some()));
        let path = || run.folder.path_of(OutputFile::Checkpoint);
        let (mark, times) = mark.ok_or_else(|| OutputError::Checkpoint { path: path() })?;
        let framed = times.last().copied();
        if let Some((tracks, progress)) = run.tracks.as_mut().zip(mark.tracks) {
            tracks.resume(progress);
        }
        let columns = columns(&run.fields, run.tracks.as_ref());
        let tables = MotionTables::resume(run.folder, &columns, &mark.tables)?;
        let frames = FrameSeries::resume(run.folder, run.points, times)?;
        let mut recorder = Recorder::with(run, known, frames, tables);
        recorder.worst = mark.worst;
        recorder.reached = (motion.step_reached(), motion.time_reached());
        recorder.resumed = Some(motion.step_reached());
        recorder.framed = framed;
        Ok(recorder)
    }

    fn with(
        run: Run<'a>,
        known: Header,
        frames: FrameSeries<'a>,
        tables: MotionTables,
    ) -> Recorder<'a> {
        let Run { fields, tracks, folder, points } = run;
        Recorder {
            fields,
            tracks,
            folder,
            points,
            frames,
            tables,
            last: None,
            reached: (0, 0.0),
            framed: None,
            worst: Unclosed::default(),
            known,
            before: Mark::default(),
            resumed: None,
        }
    }

    fn mark(&self) -> Mark {
        Mark {
            tables: self.tables.lengths(),
            frames: self.frames.n_frames(),
            worst: self.worst,
            tracks: self.tracks.as_ref().map(|tracks| tracks.progress().clone()),
        }
    }

    /// A checkpoint where the motion stands. Of a row that is there only because the run was ended it
    /// knows nothing: who goes on leaves the same files as who was never interrupted.
    pub(super) fn save(&mut self, motion: &motion::Motion<'_>) -> Result<(), OutputError> {
        let mark = if motion.is_between_rows() { self.before.clone() } else { self.mark() };
        let Snapshot { arrays, notes } = motion.snapshot();
        let names = Snapshot::NAMES.map(str::to_owned);
        let mut all: Vec<_> = names.into_iter().zip(arrays).collect();
        all.extend(mark.arrays(self.frames.times()));
        let header = Header { notes: notes.to_vec(), tables: mark.tables, ..self.known.clone() };
        // No checkpoint of lines that a power cut could take.
        let checkpoint = Checkpoint { header, arrays: all };
        self.tables.synchronise()?;
        checkpoint.write(self.folder)
    }

    pub(super) fn t(&self) -> f64 {
        self.reached.1
    }

    /// What the output of a run that failed reaches to.
    pub(super) fn behind(&self) -> String {
        match self.last {
            Some(_) => format!("the last row is that of t = {:e} s", self.t()),
            None => format!("no row was written since the checkpoint of t = {:e} s", self.t()),
        }
    }

    pub(super) fn steps(&self) -> usize {
        self.reached.0
    }

    pub(super) fn record(&mut self, row: &Row, state: &State<'_>) -> Result<(), OutputError> {
        let PointFields { case, selection, .. } = self.fields;
        let (body, d) = (&case.body, case.body.dimension());
        self.before = self.mark();
        let residual: Vec<f64> =
            state.internal_forces.iter().zip(state.loads).map(|(g, f)| g - f).collect();
        let seen = Seen {
            reactions: selection.reactions(&residual, d),
            probes: selection.displacements(state.displacements, d),
            fracture: self.tracks.as_mut().map(|tracks| tracks.row(row.t, row.released)),
        };
        let written = told::row(row, self.fields.energy, seen);
        self.worst.note(row);
        let is_due = told::is_due(case, self.frames.n_frames(), row.t);
        // Of large bodies one frame is enough in memory.
        self.last = None;
        let mut now = frame(case, row.t, state.displacements, &residual);
        drop(residual);
        now.velocity = body.to_user_order(state.velocities, d);
        if is_due {
            self.fields.fill(&mut now);
        }
        self.tables.push(&written)?;
        if is_due {
            self.frames.push(&now)?;
            self.framed = Some(row.t);
        }
        self.reached = (row.step, row.t);
        self.last = Some((row.clone(), now));
        Ok(())
    }

    pub(super) fn summary(
        &self,
        motion: &motion::Motion<'_>,
        masses: &[f64],
        scene: &Motion,
    ) -> Option<MotionSummary> {
        let (row, _) = self.last.as_ref()?;
        let mass = masses.iter().fold(0.0, |sum, mass| sum + mass);
        let told = (row, self.worst.share(), self.resumed);
        Some(told::summary((scene, motion), told, self.fields.energy, mass))
    }

    /// What is turned inside out at the last row.
    pub(super) fn inverted(&self) -> Inverted {
        let Some((_, last)) = &self.last else { return Inverted::default() };
        let body = &self.fields.case.body;
        self.fields.energy.inverted(&body.from_user_order(&last.displacement, body.dimension()))
    }

    /// The frame of the last row, which may not be due, and the displacements at the end.
    pub(super) fn finish(mut self, title: &str) -> Result<(), OutputError> {
        let Some((row, mut last)) = self.last.take() else { return Ok(()) };
        if self.framed.is_none_or(|t| t < row.t) {
            self.fields.fill(&mut last);
            self.frames.push(&last)?;
        }
        table::write_displacement(self.folder, self.points, &last.displacement)?;
        let columns = columns(&self.fields, self.tracks.as_ref());
        let [energies, probes] = MotionTables::series(self.folder, &columns)?;
        let (sets, colour) = (self.fields.named_sets(), self.fields.colour(&last));
        let title = &self.fields.case.headline(title, self.fields.energy.parts());
        let picture = Picture {
            title,
            points: self.points,
            n_points: self.points.n_points(),
            frame: &last,
            sets: &sets,
            colour: colour.as_ref(),
            charts: Charts::Times { energies: &energies, probes: &probes },
        };
        picture.write(self.folder)
    }
}
