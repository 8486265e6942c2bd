//! `piola fmt`: potentials in the layout of the library.

use std::io::Read as _;
use std::path::Path;

use piola_runtime::output::atomic::write_atomically;

use super::Exit;
use crate::cli::{Fmt, Format};
use crate::console;
use crate::potential;
use crate::render::{self, Printer, Source};

/// What stands for the standard input.
const STDIN: &str = "-";

pub(super) fn execute(arguments: &Fmt) -> Exit {
    let mut exit = Exit::Done;
    let (mut changed, mut same) = (Vec::new(), 0);
    for file in &arguments.files {
        let Some(text) = read(file) else {
            exit = Exit::Input;
            continue;
        };
        let formatted = match piola_grammar::format(&text) {
            Ok(formatted) => formatted,
            Err(found) => {
                let source = Source { name: file, text: &text };
                Printer::new(Format::Human).print(source, &found);
                exit = if exit == Exit::Input { exit } else { Exit::Findings };
                continue;
            }
        };
        if file == STDIN && !arguments.check {
            console::out(&formatted);
        } else if formatted == text {
            same += 1;
        } else if arguments.check {
            changed.push(file.as_str());
        } else if let Err(message) = replace(Path::new(file), &formatted) {
            render::error(&message, None);
            exit = Exit::Input;
        } else {
            changed.push(file.as_str());
        }
    }
    for file in &changed {
        console::tell(file);
    }
    if arguments.files.iter().all(|file| file == STDIN) && !arguments.check {
        return exit;
    }
    let n = changed.len();
    match arguments.check {
        true => console::tell(&format!("{n} to be formatted, {same} as they should be")),
        false => console::tell(&format!("{n} formatted, {same} as they should be")),
    }
    if arguments.check && n > 0 && exit == Exit::Done { Exit::Findings } else { exit }
}

/// Puts another text into a file: into that behind a link, with the permissions that it has.
fn replace(file: &Path, text: &str) -> Result<(), String> {
    let failed = |error: std::io::Error| format!("cannot write {}: {error}", file.display());
    let target = std::fs::canonicalize(file).map_err(failed)?;
    let permissions = std::fs::metadata(&target).map_err(failed)?.permissions();
    if !target.is_file() || permissions.readonly() {
        return Err(format!("cannot write {}: it may only be read", file.display()));
    }
    write_atomically(&target, |out| out.write_all(text.as_bytes()))
        .map_err(|error| error.to_string())?;
    std::fs::set_permissions(&target, permissions).map_err(failed)
}

fn read(file: &str) -> Option<String> {
    if file != STDIN {
        return potential::read_limited(Path::new(file), piola_grammar::MAX_BYTES);
    }
    let mut text = String::new();
    let limit = piola_grammar::MAX_BYTES as u64 + 1;
    match std::io::stdin().lock().take(limit).read_to_string(&mut text) {
        Ok(_) => Some(text),
        Err(error) => {
            render::error(&format!("cannot read the standard input: {error}"), None);
            None
        }
    }
}
