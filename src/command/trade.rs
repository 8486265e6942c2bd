//! `piola trade`: error and time of a scene over its settings.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

use piola_runtime::case::{Case, CaseError};
use piola_runtime::output::OutputFolder;
use piola_runtime::trade::{AXES, Options, Study, TradeError, axes, study};

use super::{Exit, run, scene};
use crate::cli::{AuditFormat, Trade};
use crate::console;
use crate::progress::Line;
use crate::render;

pub(super) fn execute(arguments: &Trade) -> Exit {
    let Some(path) = &arguments.scene else {
        console::out(&axes_text());
        return Exit::Done;
    };
    if let Err(message) = check(arguments) {
        render::error(&message, None);
        return Exit::Input;
    }
    let Some(case) = scene::read(path, &arguments.settings) else { return Exit::Input };
    match scene::warnings(&case) {
        Ok(warnings) => drop(scene::print_warnings(&case, warnings)),
        Err(error) => {
            scene::print_error(&error);
            return Exit::Input;
        }
    }
    let read = |more: &[String]| read(path, arguments, more);
    if arguments.list {
        return list(&read, arguments);
    }
    scene::with_threads(arguments.threads, || measure(path, &case, arguments))
        .unwrap_or(Exit::Input)
}

fn check(arguments: &Trade) -> Result<(), String> {
    let positive = |x: f64| x.is_finite() && x > 0.0;
    // More than any duration that the clock can count in.
    if !positive(arguments.budget) || arguments.budget > 1e9 {
        return Err(format!("--budget {}: a number of seconds up to 1e9", arguments.budget));
    }
    match arguments.accuracy.filter(|error| !positive(*error)) {
        Some(error) => Err(format!("--accuracy {error}: a positive number")),
        None => Ok(()),
    }
}

/// The scene with the user's overrides and more.
fn read(path: &Path, arguments: &Trade, more: &[String]) -> Result<Case, CaseError> {
    scene::try_read(path, &[arguments.settings.as_slice(), more].concat())
}

/// The table of axes.
fn axes_text() -> String {
    let mut out = String::new();
    for axis in AXES {
        let _ = writeln!(out, "{:15} {}: {}", axis.name, axis.key, axis.about);
        let _ = writeln!(out, "{:15} {}", "", (axis.words)().join(", "));
    }
    out
}

/// The settings that a scene would be solved with.
fn list(read: &dyn Fn(&[String]) -> Result<Case, CaseError>, arguments: &Trade) -> Exit {
    match axes::settings(read, &arguments.axes, &arguments.varied) {
        Ok(settings) => {
            for setting in settings {
                console::out(&format!("{:44} {}\n", setting.name, setting.overrides.join(" ")));
            }
            Exit::Done
        }
        Err(error) => report_error(&error),
    }
}

fn report_error(error: &TradeError) -> Exit {
    match error {
        TradeError::Case(error) => scene::print_error(error),
        _ => render::error(&error.to_string(), error.help().as_deref()),
    }
    match error {
        TradeError::NoReference { .. } => Exit::NotConverged,
        _ => Exit::Input,
    }
}

fn measure(path: &Path, case: &Case, arguments: &Trade) -> Exit {
    if let Some(refusal) = case.plan(rayon::current_num_threads()).ok().and_then(|p| p.refusal()) {
        render::error(&refusal, Some("make the body smaller"));
        return Exit::Input;
    }
    let folder = match &arguments.out {
        None => None,
        Some(path) => match OutputFolder::create_without_frames(path, arguments.force) {
            Ok(folder) => Some(folder),
            Err(error) => {
                render::error(&error.to_string(), error.help());
                return Exit::Input;
            }
        },
    };
    let options = Options {
        quantities: arguments.quantities.clone(),
        axes: arguments.axes.clone(),
        varied: arguments.varied.clone(),
        repeats: usize::from(arguments.repeats),
        budget: Duration::from_secs_f64(arguments.budget),
        accuracy: arguments.accuracy,
    };
    let progress = Line::new();
    console::tell(&format!(
        "up to {} runs of every setting in about {} s on {} threads; `--list` shows the settings",
        arguments.repeats,
        arguments.budget,
        rayon::current_num_threads()
    ));
    let read = |more: &[String]| read(path, arguments, more);
    let studied = study(&read, &options, &mut |what| progress.say(what));
    progress.finish();
    let study = match studied {
        Ok(study) => study,
        Err(error) => {
            if let Some(folder) = folder {
                folder.remove_if_empty();
            }
            return report_error(&error);
        }
    };
    let title = run::title(path);
    print(&study, &title, arguments.format);
    let Some(folder) = folder else { return Exit::Done };
    match study.write(&folder, &title) {
        Ok(()) => {
            let path = folder.path().display();
            console::tell(&format!(
                "results in {path}: trade.png, trade.svg, trade.csv, trade.json"
            ));
            Exit::Done
        }
        Err(error) => {
            render::error(&error.to_string(), error.help());
            Exit::Input
        }
    }
}

fn print(study: &Study, title: &str, format: AuditFormat) {
    console::out(&match format {
        AuditFormat::Human => study.to_text(),
        AuditFormat::Csv => study.to_csv(),
        AuditFormat::Json => study.to_json(title),
    });
}
