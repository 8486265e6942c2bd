//! `piola run`: solves a scene.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use piola_runtime::case::Case;
use piola_runtime::interaction::Inverted;
use piola_runtime::output::checkpoint::Header;
use piola_runtime::output::summary::ExitReason;
use piola_runtime::output::{OutputError, OutputFile, OutputFolder};
use piola_runtime::plan::Plan;
use piola_runtime::simulation::{Ending, Origin, RunError, RunOptions, run};
use piola_runtime::solve::Watch;

use super::{Exit, scene};
use crate::cli::Run;
use crate::console;
use crate::interrupt::{Interrupt, Signal};
use crate::progress::Progress;
use crate::render;

pub(super) fn execute(arguments: &Run) -> Exit {
    #[cfg(feature = "petsc")]
    if arguments.petsc {
        return super::ranks::execute(arguments);
    }
    let task = match &arguments.resume {
        Some(folder) => resumed(folder, arguments),
        None => Ok(Task {
            scene: arguments.scene.clone().unwrap_or_default(),
            settings: arguments.settings.clone(),
            folder: None,
        }),
    };
    let task = match task {
        Ok(task) => task,
        Err(error) => {
            render::error(&error.to_string(), error.help());
            return Exit::Input;
        }
    };
    if task.folder.is_none() && arguments.out.is_none() {
        let help = format!("name a new or empty one: `-o out/{}`", title(&task.scene));
        render::error("a run leaves files, and there is no folder for them", [help.as_str()]);
        return Exit::Input;
    }
    let Some(case) = scene::read_for_plan(&task.scene, &task.settings) else {
        return Exit::Input;
    };
    let solve = || solve(case, task, arguments);
    scene::with_threads(arguments.threads, solve).unwrap_or(Exit::Input)
}

/// What is to be run.
pub(super) struct Task {
    pub(super) scene: PathBuf,
    pub(super) settings: Vec<String>,
    /// The folder of the run that is taken up, if one is.
    pub(super) folder: Option<OutputFolder>,
}

/// The run whose results are in a folder.
pub(super) fn resumed(folder: &Path, arguments: &Run) -> Result<Task, OutputError> {
    let folder = OutputFolder::open(folder)?;
    let none = || OutputError::NoCheckpoint { path: folder.path().to_owned() };
    let header = Header::read(&folder)?.ok_or_else(none)?;
    let scene = arguments.scene.clone().unwrap_or_else(|| header.scene.into());
    Ok(Task { scene, settings: header.settings, folder: Some(folder) })
}

/// What the case costs; nothing if it must not be tried, and what is wrong is printed.
fn planned(case: &Case, arguments: &Run) -> Option<Plan> {
    let plan = match case.plan(rayon::current_num_threads()) {
        Ok(plan) => plan,
        Err(error) => {
            scene::print_error(&error);
            return None;
        }
    };
    match plan.refusal() {
        Some(refusal) if !arguments.yes => {
            render::error(&refusal, Some("make the body smaller, or try all the same with --yes"));
            None
        }
        Some(refusal) => {
            render::warning(&refusal);
            Some(plan)
        }
        None => Some(plan),
    }
}

fn solve(mut case: Case, task: Task, arguments: &Run) -> Exit {
    if case.large_box().is_some() {
        // Of removed points the box knows nothing: it may hold far fewer than it seems to.
        if case.scene.body.remove.is_empty() && planned(&case, arguments).is_none() {
            return Exit::Input;
        }
        case = match case.with_points() {
            Ok(case) => case,
            Err(error) => {
                scene::print_error(&error);
                return Exit::Input;
            }
        };
    }
    let case = &case;
    let Some(plan) = planned(case, arguments) else { return Exit::Input };
    let warnings = match scene::warnings(case) {
        Ok(warnings) => warnings,
        Err(error) => {
            scene::print_error(&error);
            return Exit::Input;
        }
    };
    let mut warnings = scene::print_warnings(case, warnings);
    for note in plan.kernels.iter().filter(|note| !note.modelled) {
        console::note(&note.reason);
        warnings.push(note.reason.clone());
    }
    let resumes = task.folder.is_some();
    let out = arguments.out.as_deref().unwrap_or(Path::new(""));
    let folder = match task.folder.map_or_else(|| OutputFolder::create(out, arguments.force), Ok) {
        Ok(folder) => folder,
        Err(error) => {
            render::error(&error.to_string(), error.help());
            return Exit::Input;
        }
    };
    let title = title(&task.scene);
    let place = std::path::absolute(&task.scene).unwrap_or(task.scene).display().to_string();
    let interrupt = Interrupt::listen();
    let end = case.scene.motion.as_ref().map_or(case.scene.steps.end, |motion| motion.end);
    let progress = Arc::new(Progress::new(end, interrupt.clone()));
    let shown = progress.show();
    let origin = Origin { scene: &place, settings: &task.settings };
    let options = RunOptions { title: &title, warnings, origin, resumes };
    let ran = run(case, &folder, options, &Watch::by(progress));
    drop(shown);
    match ran {
        Ok(ending) => report(case, &ending, &folder, interrupt.signal()),
        Err(RunError::Case(error)) => {
            folder.remove_if_empty();
            scene::print_error(&error);
            Exit::Input
        }
        Err(RunError::Output(message)) => {
            let path = folder.path();
            let goes_on = folder.path_of(OutputFile::Checkpoint).exists();
            let help =
                format!("`piola run --resume {}` goes on from its checkpoint", path.display());
            render::error(&message, goes_on.then_some(help.as_str()));
            Exit::Input
        }
    }
}

/// The name of the scene's folder, also for a scene in the current one.
pub(super) fn title(scene: &Path) -> String {
    std::path::absolute(scene)
        .ok()
        .and_then(|path| Some(path.parent()?.file_name()?.to_string_lossy().into_owned()))
        .unwrap_or_default()
}

pub(super) fn report(
    case: &Case,
    ending: &Ending,
    folder: &OutputFolder,
    signal: Option<Signal>,
) -> Exit {
    if ending.indefinite > 0 {
        render::warning(&format!(
            "{} of {} equilibria are not stable: their tangent is not positive definite",
            ending.indefinite, ending.steps
        ));
    }
    for warning in &ending.warnings {
        render::warning(warning);
    }
    let inverted = ending.inverted;
    if inverted != Inverted::default() {
        render::warning(&format!(
            "at the last step {} triangles and {} tetrahedra are turned inside out",
            inverted.triangles, inverted.tetrahedra
        ));
    }
    let path = folder.path().display();
    let is_motion = case.scene.motion.is_some();
    let helps = ending.helps.iter().map(String::as_str);
    match ending.reason {
        ExitReason::Completed if ending.fails => render::error(
            "the end state is not stable: its tangent is not positive definite, so no body stays in it",
            helps,
        ),
        ExitReason::Completed => {
            console::tell(&format!(
                "{}; results in {path}: {}, run.pvd, summary.json",
                ending.done,
                if is_motion { "motion.csv, picture.png" } else { "picture.png" }
            ));
            return Exit::Done;
        }
        ExitReason::Interrupted => render::warning(&ending.message),
        _ => render::error(&ending.message, helps),
    }
    console::tell(&match (is_motion, ending.steps) {
        (true, _) => format!("{} are in {path}", ending.done),
        (false, 0) => format!("no step converged; what was tried is in {path}"),
        (false, 1) => format!("the step that converged is in {path}"),
        (false, n) => format!("the {n} steps that converged are in {path}"),
    });
    match (ending.reason, signal) {
        (ExitReason::Completed, _) => Exit::Findings,
        (ExitReason::Interrupted, Some(Signal::Terminate)) => Exit::Terminated,
        (ExitReason::Interrupted, _) => Exit::Interrupted,
        _ => Exit::NotConverged,
    }
}
