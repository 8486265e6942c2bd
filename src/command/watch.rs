//! `piola watch`: a scene is run anew whenever one of its files changes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

use piola_runtime::output::report;
use piola_runtime::output::results::ResultsError;

use super::Exit;
use crate::cli::Watch;
use crate::console::{self, Verbosity};
use crate::interrupt::{Interrupt, Signal};
use crate::render;

/// How often files are looked at.
const PAUSE: Duration = Duration::from_millis(200);

/// How long a run may take to end by itself.
const PATIENCE: Duration = Duration::from_secs(5);

/// Endings of files that a scene may name.
const ENDINGS: [&str; 7] = ["toml", "piola", "csv", "txt", "msh", "inp", "stl"];

/// When files were changed, and how long they are.
type State = BTreeMap<PathBuf, (Option<SystemTime>, u64)>;

pub(super) fn execute(arguments: &Watch) -> Exit {
    let [out, folder] =
        [arguments.out.as_path(), folder_of(&arguments.scene)].map(std::path::absolute);
    if let (Ok(out), Ok(folder)) = (out, folder)
        && out.components().eq(folder.components())
    {
        render::error(
            "results beside the scene would count as changes of it",
            ["name another folder, such as `--out out`"],
        );
        return Exit::Input;
    }
    let interrupt = Interrupt::listen();
    let mut seen = state(&arguments.scene);
    let mut running = match start(arguments) {
        Ok(child) => Some(child),
        Err(exit) => return exit,
    };
    loop {
        match interrupt.signal() {
            Some(signal) => {
                if let Some(child) = running {
                    end(child);
                }
                return if signal == Signal::Interrupt {
                    Exit::Interrupted
                } else {
                    Exit::Terminated
                };
            }
            None => std::thread::sleep(PAUSE),
        }
        if let Some(child) = &mut running
            && let Ok(Some(_)) = child.try_wait()
        {
            running = None;
            finished(arguments);
        }
        let now = state(&arguments.scene);
        if now == seen {
            continue;
        }
        seen = now;
        // What is no longer asked for is ended; its files are whole, and the next run takes them away.
        if let Some(mut child) = running.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
        running = match start(arguments) {
            Ok(child) => Some(child),
            Err(exit) => return exit,
        };
    }
}

/// Ends a run. One that a terminal has told, too, ends by itself; what is written is whole either way.
fn end(mut child: Child) {
    let start = Instant::now();
    while start.elapsed() < PATIENCE && matches!(child.try_wait(), Ok(None)) {
        std::thread::sleep(PAUSE);
    }
    let _ = child.kill();
    let _ = child.wait();
}

fn folder_of(scene: &Path) -> &Path {
    let folder = scene.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// The files beside a scene that it may name.
fn state(scene: &Path) -> State {
    let entries = std::fs::read_dir(folder_of(scene)).into_iter().flatten().flatten();
    let has_ending = |path: &PathBuf| {
        path.extension().and_then(|end| end.to_str()).is_some_and(|end| ENDINGS.contains(&end))
    };
    let of = |path: PathBuf| {
        let data = std::fs::metadata(&path).ok()?;
        Some((path, (data.modified().ok(), data.len())))
    };
    entries.map(|entry| entry.path()).filter(has_ending).filter_map(of).collect()
}

/// A run of its own process: what goes wrong in it ends it and not the watch.
fn start(arguments: &Watch) -> Result<Child, Exit> {
    let failed = |error: std::io::Error| {
        render::error(&format!("cannot start a run: {error}"), None);
        Exit::Input
    };
    let mut command = Command::new(std::env::current_exe().map_err(failed)?);
    command.arg("run").arg(&arguments.scene).arg("--out").arg(&arguments.out).arg("--force");
    // The run speaks as the watch does.
    command.args(["--color", if console::color() { "always" } else { "never" }]);
    match console::verbosity() {
        Verbosity::Quiet => command.arg("--quiet"),
        Verbosity::Normal => &mut command,
        Verbosity::Verbose => command.arg("--verbose"),
    };
    for setting in &arguments.settings {
        command.arg("--set").arg(setting);
    }
    if let Some(threads) = arguments.threads {
        command.args(["--threads", &threads.to_string()]);
    }
    command.stdin(Stdio::null()).spawn().map_err(failed)
}

/// A page of what the run has left, also where it did not reach its end.
fn finished(arguments: &Watch) {
    match report::write(&arguments.out, None, &arguments.scene.display().to_string()) {
        Ok(file) => console::tell(&format!("{}: load it anew", file.display())),
        // The run has said what was wrong.
        Err(ResultsError::NoRun { .. }) => {}
        Err(error) => render::error(&error.to_string(), None),
    }
    console::tell("waiting for a change of the scene or a file beside it; Ctrl-C ends");
}
