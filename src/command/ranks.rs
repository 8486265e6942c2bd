//! `piola run --petsc`: solves a scene over many processes.

use std::path::Path;
use std::sync::Arc;

use piola_runtime::output::OutputFolder;
use piola_runtime::simulation::ranks::{self, Engine};
use piola_runtime::simulation::{Origin, RunError, RunOptions};
use piola_runtime::solve::Watch;

use super::run::{report, title};
use super::{Exit, scene};
use crate::cli::Run;
use crate::console;
use crate::interrupt::Interrupt;
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
    if let Err(error) = pool.use_current_thread().build_global() {
        render::error(&format!("cannot start the threads: {error}"), None);
        return Exit::Input;
    }
    let exit = solve(arguments, &engine);
    drop(engine);
    exit
}

fn solve(arguments: &Run, engine: &Engine) -> Exit {
    let scene_file = arguments.scene.clone().unwrap_or_default();
    let Some(out) = arguments.out.as_deref() else {
        let help = format!("name a new or empty one: `-o out/{}`", title(&scene_file));
        render::error("a run leaves files, and there is no folder for them", [help.as_str()]);
        return Exit::Input;
    };
    // All processes read the same, and find the same wrong with it.
    let Some(case) = scene::read(&scene_file, &arguments.settings) else { return Exit::Input };
    let warnings = match scene::warnings(&case) {
        Ok(warnings) => scene::print_warnings(&case, warnings),
        Err(error) => {
            scene::print_error(&error);
            return Exit::Input;
        }
    };
    let folder = match folder(out, arguments.force, engine) {
        Ok(folder) => folder,
        Err(exit) => return exit,
    };
    let title = title(&scene_file);
    let place = std::path::absolute(&scene_file).unwrap_or(scene_file).display().to_string();
    let progress = Arc::new(Progress::new(case.scene.steps.end, Interrupt::default()));
    let shown = (engine.rank() == 0).then(|| progress.show());
    let origin = Origin { scene: &place, settings: &arguments.settings };
    let options = RunOptions { title: &title, warnings, origin, resumes: false };
    let ran = ranks::run(&case, engine, folder.as_ref(), options, &Watch::by(progress));
    drop(shown);
    match (ran, folder) {
        (Ok(ending), Some(folder)) => report(&case, &ending, &folder, None),
        // What it ended with the first process knows.
        (Ok(_), None) => Exit::Done,
        (Err(RunError::Case(error)), folder) => {
            if let Some(folder) = folder {
                folder.remove_if_empty();
            }
            scene::print_error(&error);
            Exit::Input
        }
        (Err(RunError::Output(message)), _) => {
            render::error(&message, None);
            Exit::Input
        }
    }
}

/// The folder of the results, which the first process makes.
fn folder(out: &Path, force: bool, engine: &Engine) -> Result<Option<OutputFolder>, Exit> {
    let made = match engine.rank() {
        0 => Some(OutputFolder::create(out, force)),
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
