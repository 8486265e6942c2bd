//! `piola run`: solves a scene.

use std::io::IsTerminal as _;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use piola_runtime::assembly::Inverted;
use piola_runtime::output::OutputFolder;
use piola_runtime::output::summary::ExitReason;
use piola_runtime::simulation::{Case, Ending, RunError, RunOptions, run};
use piola_runtime::solve::steps::StepRecord;

use super::{Exit, scene};
use crate::cli::Run;
use crate::render;

pub(super) fn execute(arguments: &Run) -> Exit {
    let Some(case) = scene::read(&arguments.scene, &arguments.settings) else {
        return Exit::Input;
    };
    match scene::with_threads(arguments.threads, || solve(&case, arguments)) {
        Some(exit) => exit,
        None => Exit::Input,
    }
}

fn solve(case: &Case, arguments: &Run) -> Exit {
    let plan = match case.plan(rayon::current_num_threads()) {
        Ok(plan) => plan,
        Err(error) => {
            scene::print_error(&error);
            return Exit::Input;
        }
    };
    if let Some(refusal) = plan.refusal() {
        if !arguments.yes {
            render::error(&refusal, Some("make the body smaller, or try all the same with --yes"));
            return Exit::Input;
        }
        render::warning(&refusal);
    }
    let warnings = match scene::warnings(case) {
        Ok(warnings) => warnings,
        Err(error) => {
            scene::print_error(&error);
            return Exit::Input;
        }
    };
    let mut warnings = scene::print_warnings(case, warnings);
    for note in plan.kernels.iter().filter(|note| !note.modelled) {
        eprintln!("note: {}", note.reason);
        warnings.push(note.reason.clone());
    }
    let folder = match OutputFolder::create(&arguments.out, arguments.force) {
        Ok(folder) => folder,
        Err(error) => {
            render::error(&error.to_string(), error.help());
            return Exit::Input;
        }
    };
    let title = title(&arguments.scene);
    let progress = Progress::new(case.scene.steps.end);
    let options = RunOptions { title: &title, warnings };
    match run(case, &folder, options, &mut |record| progress.step(record)) {
        Ok(ending) => {
            progress.finish();
            report(&ending, &folder)
        }
        Err(RunError::Case(error)) => {
            progress.finish();
            folder.remove_if_empty();
            scene::print_error(&error);
            Exit::Input
        }
        Err(RunError::Output(message)) => {
            progress.finish();
            render::error(&message, None);
            Exit::Input
        }
    }
}

/// The name of the scene's folder, also for a scene in the current one.
pub(super) fn title(scene: &std::path::Path) -> String {
    std::path::absolute(scene)
        .ok()
        .and_then(|path| Some(path.parent()?.file_name()?.to_string_lossy().into_owned()))
        .unwrap_or_default()
}

fn report(ending: &Ending, folder: &OutputFolder) -> Exit {
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
    match ending.reason {
        ExitReason::Completed => {
            eprintln!(
                "{} steps converged; results in {path}: picture.png, run.pvd, summary.json",
                ending.steps
            );
            Exit::Done
        }
        _ => {
            render::error(&ending.message, None);
            eprintln!("the {} steps that converged are in {path}", ending.steps);
            Exit::NotConverged
        }
    }
}

/// A bar on a terminal, a line per step in a pipe.
struct Progress {
    bar: ProgressBar,
    end: f64,
    plain: bool,
}

impl Progress {
    fn new(end: f64) -> Progress {
        let plain = !std::io::stderr().is_terminal();
        let bar = ProgressBar::new(1000);
        if plain {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        let style =
            ProgressStyle::with_template("{bar:30} {percent:>3} %  {elapsed} ({eta} left)  {msg}");
        if let Ok(style) = style {
            bar.set_style(style);
        }
        Progress { bar, end, plain }
    }

    fn step(&self, record: &StepRecord) {
        let ratio = record.residual_over_reaction.last().copied().unwrap_or(0.0);
        let stable = match record.definiteness.positive_definite {
            Some(false) => ", NOT STABLE",
            _ => "",
        };
        let line = format!(
            "t = {:.6}: {} iterations, residual/reaction {ratio:.1e}{stable}",
            record.t, record.iterations
        );
        if self.plain {
            eprintln!("{line}");
        } else {
            self.bar.set_position((1000.0 * record.t / self.end) as u64);
            self.bar.set_message(line);
        }
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
