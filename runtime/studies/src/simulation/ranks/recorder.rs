//! What a motion over ranks leaves, row by row: on rank 0.

use std::borrow::Cow;

use piola_mechanics::energy::Energy as _;
use piola_output::checkpoint::{Checkpoint, Header, Parts};
use piola_output::motion::{MotionColumns, MotionTables};
use piola_output::picture::{Charts, Picture};
use piola_output::pvd::FrameSeries;
use piola_output::{OutputError, OutputFolder};
use piola_solvers::motion::{Motion, Row};

use super::Begun;
use super::exchange::Exchange;
use super::moves::Sight;
use super::view::{Look, Shown, Sketch};
use crate::simulation::motion::Mark;
use crate::simulation::motion::course::Unclosed;
use crate::simulation::motion::told::{self, Seen};
use crate::simulation::tracks::{self, Log};

/// The array of what names the parts of a checkpoint that tells at which step they stand.
pub(super) const STEP: &str = "step";

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
    /// From the start, where this is seen of cracks; or from where the output of an earlier run was, with its frames at
    /// these times in s: what it wrote after that is written again.
    pub(super) fn new(
        (sight, folder, sketch): (&'a Sight<'a>, &'a OutputFolder, &'a Sketch),
        known: Header,
        cracks: Option<tracks::Seen>,
        earlier: Option<(Mark, Vec<f64>)>,
    ) -> Result<Recorder<'a>, OutputError> {
        let Begun { case, energy, selection, .. } = *sight.begun;
        let extent = |axis: usize| sight.extents.sides[axis];
        let mut log = cracks.map(|seen| Log::new(case, &extent, seen, true));
        let columns = told::columns(case, energy, selection, log.as_ref().map(Log::columns));
        let (tables, frames, worst) = match earlier {
            None => {
                let tables = MotionTables::new(folder, &columns)?;
                (tables, sight.view.series(folder, sketch)?, Unclosed::default())
            }
            Some((mark, times)) => {
                if let Some((log, progress)) = log.as_mut().zip(mark.tracks) {
                    log.resume(progress);
                }
                let tables = MotionTables::resume(folder, &columns, &mark.tables)?;
                (tables, sight.view.series_behind(folder, sketch, times)?, mark.worst)
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
        let mut arrays = mark.arrays(self.frames.times());
        arrays.push((STEP.to_owned(), Cow::Owned(vec![motion.step_reached() as f64])));
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
