//! `piola sweep`: a scene for many values of some of its keys.

use std::path::Path;
use std::sync::Arc;

use piola_runtime::output::{OutputFile, OutputFolder};
use piola_runtime::solve::{Event, Observer, Watch};
use piola_runtime::sweep::{Outcome, Sweep, SweepError, Variation, sweep};

use super::{Exit, run, scene};
use crate::cli::{self, AuditFormat};
use crate::console;
use crate::interrupt::{Interrupt, Signal};
use crate::progress::Line;
use crate::render;

pub(super) fn execute(arguments: &cli::Sweep) -> Exit {
    let variations = arguments.varied.iter().map(|text| Variation::parse(text));
    let variations: Vec<Variation> = match variations.collect() {
        Ok(variations) => variations,
        Err(error) => return report_error(&error),
    };
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
    let interrupt = Interrupt::listen();
    let watch = Watch::by(Arc::new(Ears(interrupt.clone())));
    let path = &arguments.scene;
    let read = |more: &[String]| scene::try_read(path, &[&arguments.settings[..], more].concat());
    let threads = arguments.threads.unwrap_or_else(rayon::current_num_threads);
    let line = Line::new();
    let title = run::title(path);
    let mut failed = None;
    let swept = sweep(&read, &variations, threads, &watch, &mut |sweep, row| {
        let ended = sweep.count(|outcome| *outcome != Outcome::Interrupted);
        let of = format!("{ended} of {}", sweep.rows.len());
        if let Some(host) = console::host() {
            host.moved(ended as f64 / sweep.rows.len() as f64);
        }
        line.say(&format!("{of}: {}, {}", sweep.title_of(row), row.outcome.word()));
        // What has ended is kept, whatever comes.
        let kept = |folder: &OutputFolder| {
            folder.write(OutputFile::SweepTable, sweep.to_csv().as_bytes()).err()
        };
        failed = failed.take().or(folder.as_ref().and_then(kept));
    });
    line.finish();
    let swept = match swept {
        Ok(swept) => swept,
        Err(error) => {
            if let Some(folder) = folder {
                folder.remove_if_empty();
            }
            return report_error(&error);
        }
    };
    console::out(&match arguments.format {
        AuditFormat::Human => swept.to_text(),
        AuditFormat::Csv => swept.to_csv(),
        AuditFormat::Json => swept.to_json(&title),
    });
    if let Some(folder) = folder {
        if let Some(error) = failed.or(swept.write(&folder, &title).err()) {
            render::error(&error.to_string(), error.help());
            return Exit::Input;
        }
        say_results(folder.path());
    }
    exit(&swept, interrupt.signal())
}

fn say_results(path: &Path) {
    let path = path.display();
    console::tell(&format!("results in {path}: sweep.png, sweep.svg, sweep.csv, sweep.json"));
}

fn exit(sweep: &Sweep, signal: Option<Signal>) -> Exit {
    let any = |is_meant: fn(&Outcome) -> bool| sweep.count(is_meant) > 0;
    match signal {
        Some(Signal::Interrupt) => Exit::Interrupted,
        Some(Signal::Terminate) => Exit::Terminated,
        None if any(|outcome| matches!(outcome, Outcome::Refused(_))) => Exit::Input,
        None if any(|outcome| matches!(outcome, Outcome::NotConverged(_))) => Exit::NotConverged,
        None => Exit::Done,
    }
}

fn report_error(error: &SweepError) -> Exit {
    match error {
        SweepError::Case(error) => scene::print_error(error),
        _ => render::error(&error.to_string(), error.help()),
    }
    Exit::Input
}

/// Hears signals, and nothing of the runs.
struct Ears(Interrupt);

impl Observer for Ears {
    fn notice(&self, _: Event<'_>) {}

    fn wants_end(&self) -> bool {
        self.0.signal().is_some()
    }
}
