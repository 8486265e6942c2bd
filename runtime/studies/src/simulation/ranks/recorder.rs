//! What a motion over ranks leaves, row by row: on rank 0.

use std::borrow::Cow;

use piola_mechanics::energy::Energy as _;
use piola_output::checkpoint::{Checkpoint, Header, Parts};
use piola_output::motion::{MotionColumns, MotionTables};
use piola_output::picture::{Charts, Picture};
use piola_output::pvd::FrameSeries;
use piola_output::{OutputError, OutputFile, OutputFolder};
use piola_solvers::motion::{Motion, Row};

use super::Begun;
use super::exchange::Exchange;
use super::moves::Sight;
use super::view::{Look, Shown, Sketch};
use crate::simulation::motion::Mark;
use crate::simulation::motion::course::Unclosed;
use crate::simulation::motion::told::{self, Seen};
use crate::simulation::tracks::{self, Log, Progress};

/// Arrays of what names the parts of a checkpoint: the step at which they stand, times of frames, what did not close so
/// far, and how far the rows of cracks are.
pub(super) const STEP: &str = "step";
pub(super) const FRAME_TIMES: &str = "frame_times";
const WORST: &str = "worst";
const TRACKS: &str = "tips";

/// Writes what the rows bring.
pub(super) struct Recorder<'a> {
    sight: &'a Sight<'a>,
    folder: &'a OutputFolder,
    sketch: &'a Sketch,
    columns: MotionColumns,
    frames: FrameSeries<'a>,
    tables: MotionTables,
    log: Option<Log<'a>>,
    pub(super) worst: Unclosed,
    last: Option<Look>,
    /// What every checkpoint of the run begins with.
    known: Header,
    /// What a checkpoint before the last row would hold of the output.
    before: Mark,
}

impl<'a> Recorder<'a> {
    /// From the start, where this is seen of cracks; or where an earlier run stood, what it wrote after that is written
    /// again.
    pub(super) fn new(
        (sight, folder, sketch): (&'a Sight<'a>, &'a OutputFolder, &'a Sketch),
        known: Header,
        cracks: Option<tracks::Seen>,
        earlier: Option<&Checkpoint<'_>>,
    ) -> Result<Recorder<'a>, OutputError> {
        let Begun { case, energy, selection, .. } = *sight.begun;
        let extent = |axis: usize| sight.extents.sides[axis];
        let mut log = cracks.map(|seen| Log::new(case, &extent, seen, true));
        let mut worst = Unclosed::default();
        let columns = told::columns(case, energy, selection, log.as_ref().map(Log::columns));
        let damaged = || OutputError::Checkpoint { path: folder.path_of(OutputFile::Checkpoint) };
        let (tables, frames) = match earlier {
            None => (MotionTables::new(folder, &columns)?, sight.view.series(folder, sketch)?),
            Some(earlier) => {
                let array = |name: &str| earlier.array(name).ok_or_else(damaged);
                if let Some(log) = &mut log {
                    let (n_tracks, n_points) = (case.scene.tracks.len(), sight.view.n_points());
                    let progress = Progress::of_numbers(array(TRACKS)?, n_tracks, n_points);
                    log.resume(progress.ok_or_else(damaged)?);
                }
                if let [rounding, largest] = *array(WORST)? {
                    worst = Unclosed { rounding, largest };
                }
                let times = array(FRAME_TIMES)?.to_vec();
                let tables = MotionTables::resume(folder, &columns, &earlier.header.tables)?;
                (tables, sight.view.series_behind(folder, sketch, times)?)
            }
        };
        let (last, before) = (None, Mark::default());
        Ok(Recorder {
            sight,
            folder,
            sketch,
            columns,
            frames,
            tables,
            log,
            worst,
            last,
            known,
            before,
        })
    }

    fn mark(&self) -> Mark {
        Mark {
            tables: self.tables.lengths(),
            frames: self.frames.n_frames(),
            worst: self.worst,
            tracks: self.log.as_ref().map(|log| log.progress().clone()),
        }
    }

    pub(super) fn record(
        &mut self,
        row: &Row,
        mut seen: Seen,
        cracks: Option<tracks::Seen>,
        shown: Option<Shown>,
    ) -> Result<(), OutputError> {
        self.before = self.mark();
        self.worst.note(row);
        let log = self.log.as_mut().zip(cracks);
        seen.fracture = log.map(|(log, cracks)| log.row(row.t, row.released, cracks));
        self.tables.push(&told::row(row, self.sight.begun.energy, seen))?;
        self.show(shown)
    }

    pub(super) fn show(&mut self, shown: Option<Shown>) -> Result<(), OutputError> {
        let Some(Shown { look, listed }) = shown else { return Ok(()) };
        self.last = Some(look);
        listed.map_or(Ok(()), |frame| self.frames.push(&frame))
    }

    /// Names the parts of a checkpoint where the motion stands. Of a row that is there only because the run was ended it
    /// knows nothing.
    pub(super) fn save(
        &mut self,
        motion: &Motion<'_, Exchange<'_>>,
        parts: Parts,
    ) -> Result<(), OutputError> {
        let mark = if motion.is_between_rows() { self.before.clone() } else { self.mark() };
        let mut arrays: Vec<(&str, Cow<'_, [f64]>)> = vec![
            (STEP, Cow::Owned(vec![motion.step_reached() as f64])),
            (FRAME_TIMES, Cow::Borrowed(&self.frames.times()[..mark.frames])),
            (WORST, Cow::Owned(vec![mark.worst.rounding, mark.worst.largest])),
        ];
        arrays.extend(mark.tracks.map(|progress| (TRACKS, Cow::Owned(progress.numbers()))));
        let arrays = arrays.into_iter().map(|(name, values)| (name.to_owned(), values)).collect();
        let header = Header { tables: mark.tables, parts: Some(parts), ..self.known.clone() };
        // No checkpoint of lines that a power cut could take.
        self.tables.synchronise()?;
        Checkpoint { header, arrays }.write(self.folder)
    }

    /// The picture of the last row.
    pub(super) fn finish(self, title: &str) -> Result<(), OutputError> {
        let Begun { case, energy, .. } = *self.sight.begun;
        let Some(Look { frame, colour }) = &self.last else { return Ok(()) };
        let [energies, probes] = MotionTables::series(self.folder, &self.columns)?;
        let picture = Picture {
            title: &case.headline(title, energy.parts()),
            points: &self.sketch.points,
            n_points: self.sight.view.n_points(),
            frame,
            sets: &self.sketch.sets,
            colour: colour.as_ref(),
            charts: Charts::Times { energies: &energies, probes: &probes },
        };
        picture.write(self.folder)
    }
}
