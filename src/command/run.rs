//! `piola run`: solves a scene.

use std::path::Path;
use std::sync::Arc;

use piola_runtime::case::Case;
use piola_runtime::interaction::Inverted;
use piola_runtime::output::OutputFolder;
use piola_runtime::output::summary::ExitReason;
use piola_runtime::plan::Plan;
use piola_runtime::simulation::{Ending, RunError, RunOptions, run};
use piola_runtime::solve::Watch;

use super::{Exit, scene};
use crate::cli::Run;
use crate::console;
use crate::interrupt::{Interrupt, Signal};
use crate::progress::Progress;
use crate::render;

pub(super) fn execute(arguments: &Run) -> Exit {
    let Some(out) = &arguments.out else {
        let name = title(&arguments.scene);
        let help = format!("name a new or empty one: `-o out/{name}`");
        render::error("a run leaves files, and there is no folder for them", [help.as_str()]);
        return Exit::Input;
    };
    let Some(case) = scene::read_for_plan(&arguments.scene, &arguments.settings) else {
        return Exit::Input;
    };
    scene::with_threads(arguments.threads, || solve(case, out, arguments)).unwrap_or(Exit::Input)
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

fn solve(mut case: Case, out: &Path, arguments: &Run) -> Exit {
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
    let folder = match OutputFolder::create(out, arguments.force) {
        Ok(folder) => folder,
        Err(error) => {
            render::error(&error.to_string(), error.help());
            return Exit::Input;
        }
    };
    let title = title(&arguments.scene);
    let interrupt = Interrupt::listen();
    let end = case.scene.motion.as_ref().map_or(case.scene.steps.end, |motion| motion.end);
    let progress = Arc::new(Progress::new(end, interrupt.clone()));
    let shown = progress.show();
    let options = RunOptions { title: &title, warnings };
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
            render::error(&message, None);
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

fn report(case: &Case, ending: &Ending, folder: &OutputFolder, signal: Option<Signal>) -> Exit {
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
    match ending.reason {
        ExitReason::Completed if ending.fails => render::error(
            "the end state is not stable: its tangent is not positive definite, so no body stays in it",
            [
                "follow the load in smaller steps, or look at psi'' and the coefficients: `piola moduli`",
                "if such states are what the scene is about: unstable = \"accept\" in [solver]",
            ],
        ),
        ExitReason::Completed => {
            console::tell(&format!(
                "{}; results in {path}: {}, run.pvd, summary.json",
                ending.done,
                if is_motion { "motion.csv" } else { "picture.png" }
            ));
            return Exit::Done;
        }
        ExitReason::Interrupted => render::warning(&ending.message),
        _ => render::error(&ending.message, None),
    }
    match is_motion {
        true => console::tell(&format!("{} are in {path}", ending.done)),
        false => console::tell(&format!("the {} steps that converged are in {path}", ending.steps)),
    }
    match (ending.reason, signal) {
        (ExitReason::Completed, _) => Exit::Findings,
        (ExitReason::Interrupted, Some(Signal::Terminate)) => Exit::Terminated,
        (ExitReason::Interrupted, _) => Exit::Interrupted,
        _ => Exit::NotConverged,
    }
}
