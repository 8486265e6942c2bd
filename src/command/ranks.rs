//! `piola run --petsc`: solves a scene over many processes.

use std::path::Path;
use std::sync::Arc;

use piola_runtime::case::Case;
use piola_runtime::output::{OutputFile, OutputFolder};
use piola_runtime::simulation::ranks::{self, Engine, Parts};
use piola_runtime::simulation::{Origin, RunError, RunOptions};
use piola_runtime::solve::Watch;

use super::run::{Task, report, resumed, title};
use super::{Exit, scene};
use crate::cli::Run;
use crate::console;
use crate::interrupt::{Interrupt, Signal};
use crate::progress::Progress;
use crate::render;

/// All processes run this; the first alone says what there is to say, and writes.
pub(super) fn execute(arguments: &Run) -> Exit {
    let engine = match Engine::start("piola", &arguments.options) {
        Ok(engine) => engine,
        Err(error) => {
            render::error(&error.to_string(), None);
            return Exit::Input;
        }
    };
    if engine.rank() > 0 {
        console::fall_silent();
    }
    // MPI is called by the thread that started it, which is one of those that work.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads.unwrap_or(1));
    let built = pool.use_current_thread().build_global().map_err(|error| error.to_string());
    if let Err(failure) = engine.agree(built) {
        render::error(&format!("cannot start the threads: {}", failure.message), None);
        return Exit::Input;
    }
    solve(arguments, &engine)
}

fn solve(arguments: &Run, engine: &Engine) -> Exit {
    let resumes = arguments.resume.is_some();
    let task = match task(arguments, engine) {
        Ok(task) => task,
        Err(exit) => return exit,
    };
    if !resumes && arguments.out.is_none() {
        let help = format!("name a new or empty one: `-o out/{}`", title(&task.scene));
        render::error("a run leaves files, and there is no folder for them", [help.as_str()]);
        return Exit::Input;
    }
    let parts = match read(&task, engine) {
        Ok(parts) => parts,
        Err(exit) => return exit,
    };
    let case = parts.case();
    let mut warnings = scene::print_warnings(case, parts.warnings().to_vec());
    for reason in case.dropped_energies().unwrap_or_default() {
        console::note(&reason);
        warnings.push(reason);
    }
    let folder = match task.folder {
        None if !resumes => folder(arguments, engine),
        taken_up => Ok(taken_up),
    };
    let folder = match folder {
        Ok(folder) => folder,
        Err(exit) => return exit,
    };
    let title = title(&task.scene);
    let place = std::path::absolute(&task.scene).unwrap_or(task.scene).display().to_string();
    let motion = case.scene.motion.as_ref();
    let end = motion.map_or(case.scene.steps.end, |motion| motion.end);
    // A motion leaves a checkpoint; load steps end at once.
    let interrupt = if motion.is_some() { Interrupt::listen() } else { Interrupt::default() };
    let progress = Arc::new(Progress::new(end, interrupt.clone()));
    let shown = (engine.rank() == 0).then(|| progress.show());
    let origin = Origin { scene: &place, settings: &task.settings };
    let options = RunOptions { title: &title, warnings, origin, resumes };
    let ran = ranks::run(&parts, engine, folder.as_ref(), options, &Watch::by(progress));
    drop(shown);
    match (ran, folder) {
        (Ok(ending), folder) => {
            // Any of the processes may have got the signal.
            let all = engine.all_gather(interrupt.signal().map_or(0, |signal| signal as u64));
            let came = |signal: &Signal| all.contains(&(*signal as u64));
            let signal = [Signal::Terminate, Signal::Interrupt].into_iter().find(came);
            // What it ended with the first process knows.
            folder.map_or(Exit::Done, |folder| report(case, &ending, &folder, signal))
        }
        (Err(RunError::Case(error)), folder) => {
            if let Some(folder) = folder {
                folder.remove_if_empty();
            }
            scene::print_error(&error);
            Exit::Input
        }
        (Err(RunError::Output(message)), folder) => {
            let left = folder.filter(|one| one.path_of(OutputFile::Checkpoint).exists());
            let help = left.map(|one| {
                let folder = one.path().display();
                format!("`piola run --petsc --resume {folder}` goes on from its checkpoint")
            });
            render::error(&message, help.as_deref());
            Exit::Input
        }
    }
}

/// What is to be run, of which the first process knows where a run is taken up: it has the folder.
fn task(arguments: &Run, engine: &Engine) -> Result<Task, Exit> {
    let Some(folder) = &arguments.resume else {
        let scene = arguments.scene.clone().unwrap_or_default();
        return Ok(Task { scene, settings: arguments.settings.clone(), folder: None });
    };
    let own = (engine.rank() == 0).then(|| resumed(folder, arguments)).transpose();
    let told = engine.agree(own.as_ref().map(|_| ()).map_err(ToString::to_string));
    let own = match (own, told) {
        (Ok(own), Ok(())) => own,
        (Err(error), _) => {
            render::error(&error.to_string(), error.help());
            return Err(Exit::Input);
        }
        (Ok(_), Err(_)) => return Err(Exit::Input),
    };
    let words = own.as_ref().map_or_else(Vec::new, |task| {
        [&[task.scene.display().to_string()], &task.settings[..]].concat()
    });
    let mut bytes = words.join("\0").into_bytes();
    engine.broadcast(&mut bytes);
    let words = String::from_utf8_lossy(&bytes).into_owned();
    let mut words = words.split('\0').map(str::to_owned);
    let scene = words.next().unwrap_or_default().into();
    Ok(own.unwrap_or_else(|| Task { scene, settings: words.collect(), folder: None }))
}

/// The scene, which all processes read alike: a folder that some machine does not see, or not yet, ends them all. Of its
/// points each has a part.
fn read(task: &Task, engine: &Engine) -> Result<Parts, Exit> {
    let own = scene::outline(&task.scene, &task.settings);
    let told = engine.agree(own.as_ref().map(|_| ()).map_err(ToString::to_string));
    let outline = match (told, own) {
        (Ok(()), Ok(outline)) => outline,
        (_, Err(error)) => {
            scene::print_error(&error);
            return Err(Exit::Input);
        }
        (Err(failure), Ok(_)) => {
            render::error(&format!("rank {}: {}", failure.rank, failure.message), None);
            return Err(Exit::Input);
        }
    };
    // What they do together from here on must be the same, and files of points as well.
    same(engine, &outline)?;
    let parts = match Parts::read(outline, engine) {
        Ok(parts) => parts,
        Err(RunError::Case(error)) => {
            scene::print_error(&error);
            return Err(Exit::Input);
        }
        Err(RunError::Output(message)) => {
            render::error(&message, None);
            return Err(Exit::Input);
        }
    };
    same(engine, parts.case())?;
    Ok(parts)
}

/// Refuses ranks that have read something else than the first.
fn same(engine: &Engine, case: &Case) -> Result<(), Exit> {
    let hashes = engine.all_gather(ranks::hash(case));
    let Some(rank) = hashes.iter().position(|hash| *hash != hashes[0]) else { return Ok(()) };
    let message = format!("rank {rank} reads another scene, potential or table than rank 0");
    render::error(&message, Some("let all machines see one folder"));
    Err(Exit::Input)
}

/// The folder of the results, which the first process makes.
fn folder(arguments: &Run, engine: &Engine) -> Result<Option<OutputFolder>, Exit> {
    let out = arguments.out.as_deref().unwrap_or(Path::new(""));
    let made = match engine.rank() {
        0 => Some(OutputFolder::create(out, arguments.force)),
        _ => None,
    };
    let told = match &made {
        Some(Err(error)) => Err(error.to_string()),
        _ => Ok(()),
    };
    let is_made = engine.agree(told).is_ok();
    match made {
        Some(Err(error)) => {
            render::error(&error.to_string(), error.help());
            Err(Exit::Input)
        }
        Some(Ok(folder)) if is_made => Ok(Some(folder)),
        _ if is_made => Ok(None),
        _ => Err(Exit::Input),
    }
}
