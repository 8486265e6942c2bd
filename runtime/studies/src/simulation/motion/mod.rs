//! A body in motion: integration in time, and everything it leaves in the output folder.

mod cost;
pub(super) mod course;
pub(super) mod driven;
mod ready;
mod recorder;
pub(super) mod told;

use std::borrow::Cow;
use std::ops::ControlFlow;
use std::time::Duration;

use piola_grammar::counted;
use piola_output::checkpoint::Checkpoint;
use piola_output::summary::{ExitReason, PhaseClock};
use piola_output::{OutputError, OutputFile, OutputFolder, Points};
use piola_solvers::Watch;
use piola_solvers::march::{Advance, March as _};
use piola_solvers::motion::{self, MotionDrive as _, MotionError, Snapshot};

use super::run::{Ending, RunError, RunOptions, enter, hash, summary};
use crate::case::{Case, CaseError};
use crate::scene::Motion;
use crate::simulation::point_fields::PointFields;
use crate::simulation::tracks::Tracks;
pub(super) use cost::cost;
pub(super) use course::solve;
pub(super) use ready::{Ready, refused, settings, stopped, with_ready};
use recorder::Recorder;
#[cfg(feature = "petsc")]
pub(super) use recorder::{Mark, header};

/// Runs a case that moves and fills the folder.
pub(super) fn run(
    case: &Case,
    scene: &Motion,
    folder: &OutputFolder,
    options: RunOptions<'_>,
    watch: &Watch,
) -> Result<Ending, RunError> {
    case.check_rest()?;
    let mut clock = PhaseClock::new();
    enter(&mut clock, watch, "compile");
    let compiled = case.compile()?;
    enter(&mut clock, watch, "interactions");
    with_ready(case, compiled, |ready| follow(case, scene, ready, folder, options, watch, clock))?
}

/// The same from there on.
fn follow(
    case: &Case,
    scene: &Motion,
    ready: Ready<'_>,
    folder: &OutputFolder,
    options: RunOptions<'_>,
    watch: &Watch,
    mut clock: PhaseClock,
) -> Result<Ending, RunError> {
    let Ready { energy, selection, masses, drive, start } = ready;
    let settings = settings(case, scene);
    let tracks = Tracks::new(case, energy, selection, true);
    let resolved = case.scene.resolved_toml();
    let hash = hash(case, &resolved);
    let earlier = if options.resumes { Some(earlier(folder, &hash)?) } else { None };
    let made = match &earlier {
        Some(earlier) => {
            not_in_parts(earlier, folder)?;
            let from = snapshot(earlier, folder)?;
            motion::Motion::resume(energy, masses, drive, &settings, watch, from)
        }
        None => motion::Motion::new(energy, masses, start, drive, &settings, watch),
    };
    let mut motion = made.map_err(|error| refused(case, drive, error))?;

    // From here on there is something to keep.
    folder.write(OutputFile::ResolvedScene, resolved.as_bytes())?;
    enter(&mut clock, watch, "move");
    let points =
        Points::of(&case.body).with_mesh(case.mesh.clone()).with_held(&case.body, &drive.fixed());
    let fields = PointFields { case, energy, selection, masses: Some(masses) };
    let run = recorder::Run { fields, tracks, folder, points: &points };
    let known = recorder::header(options.origin, &hash);
    let mut recorder = match &earlier {
        Some(earlier) => Recorder::resume(run, known, earlier, &motion)?,
        None => Recorder::new(run, known)?,
    };
    if let Ok(interval) = Duration::try_from_secs_f64(case.scene.output.checkpoint) {
        motion.pause_every(interval);
    }
    let result = go(&mut motion, &mut recorder, earlier.is_some())?;
    enter(&mut clock, watch, "output");
    let (reason, message) = match result {
        Ok(ControlFlow::Continue(())) => (ExitReason::Completed, String::new()),
        Ok(ControlFlow::Break(())) => {
            let message = format!(
                "interrupted; the motion has come to t = {:e} s, `piola run --resume {}` goes on",
                motion.time_reached(),
                folder.path().display()
            );
            (ExitReason::Interrupted, message)
        }
        Err(error) => {
            let (reason, message) = stopped(case, drive, error);
            (reason, format!("{message}; {}", recorder.behind()))
        }
    };
    let mut warnings: Vec<String> = motion.notes().to_vec();
    warnings.extend(told::unstable(scene, &motion));
    let ending = Ending {
        reason,
        message,
        helps: Vec::new(),
        done: format!("{} of {:.6e} s", counted(recorder.steps(), "step"), motion.step()),
        steps: recorder.steps(),
        indefinite: 0,
        fails: false,
        inverted: recorder.inverted(),
        warnings,
    };
    let told = recorder.summary(&motion, masses, scene);
    let title = options.title;
    let summary = summary(case, energy, (&ending, options), &resolved, &mut clock);
    piola_output::summary::Summary { motion: told, ..summary }.write(folder)?;
    // The picture comes last: it takes longest, and is the smallest loss.
    recorder.finish(title)?;
    if reason == ExitReason::Completed {
        folder.remove(OutputFile::Checkpoint)?;
    }
    Ok(ending)
}

/// Goes to the end, or to where the motion is interrupted, which breaks, or stops; with a checkpoint now and
/// then, and at an interruption.
fn go(
    motion: &mut motion::Motion<'_>,
    recorder: &mut Recorder<'_>,
    is_resumed: bool,
) -> Result<Result<ControlFlow<()>, MotionError>, OutputError> {
    // The row that it starts from stands in the tables of a run that is taken up.
    let mut next = if is_resumed { motion.advance() } else { motion.advance_to(0) };
    loop {
        match next {
            Ok(Advance::Step(row)) => recorder.record(&row, &motion.state())?,
            Ok(Advance::Pause) => recorder.save(motion)?,
            Ok(Advance::End) => return Ok(Ok(ControlFlow::Continue(()))),
            Ok(Advance::Interrupted) => {
                recorder.save(motion)?;
                return Ok(Ok(ControlFlow::Break(())));
            }
            Err(error) => return Ok(Err(error)),
        }
        next = motion.advance();
    }
}

/// What an earlier run in the folder left of this scene.
pub(super) fn earlier(folder: &OutputFolder, hash: &str) -> Result<Checkpoint<'static>, RunError> {
    let none = || OutputError::NoCheckpoint { path: folder.path().to_owned() };
    let earlier = Checkpoint::read(folder)?.ok_or_else(none)?;
    if earlier.header.scene_hash != hash {
        let message = format!(
            "the scene has changed since `{}` was run, or its potential, or a file that one of them reads: a run goes \
             on as it began, or begins anew with `--force`",
            folder.path().display()
        );
        return Err(CaseError::Body { message }.into());
    }
    Ok(earlier)
}

/// Refuses what a run by many processes left.
fn not_in_parts(earlier: &Checkpoint<'_>, folder: &OutputFolder) -> Result<(), CaseError> {
    let Some(parts) = earlier.header.parts else { return Ok(()) };
    let message = format!(
        "the checkpoint is of a run over {}: `mpirun -n {} piola run --petsc --resume {}` goes on, on any number of \
         ranks",
        counted(parts.n, "rank"),
        parts.n,
        folder.path().display()
    );
    Err(CaseError::Body { message })
}

/// Where the motion stood.
fn snapshot<'a>(
    earlier: &'a Checkpoint<'_>,
    folder: &OutputFolder,
) -> Result<Snapshot<'a>, OutputError> {
    let found = Snapshot::NAMES.map(|name| earlier.array(name));
    if found.iter().any(Option::is_none) {
        return Err(OutputError::Checkpoint { path: folder.path_of(OutputFile::Checkpoint) });
    }
    let arrays = found.map(|values| Cow::Borrowed(values.unwrap_or_default()));
    Ok(Snapshot { arrays, notes: Cow::Borrowed(&earlier.header.notes) })
}
