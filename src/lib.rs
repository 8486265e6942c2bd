//! The command line of piola: `piola --help`, for its program and for programs that have it inside.
//!
//! stdout carries data, stderr everything else. Exit codes: 0 done, 1 findings or failed checks,
//! 2 wrong usage or input, 3 the solver did not converge, 130 or 143 a signal ended the run.

// These macros panic where the stream is closed or its disk full: `console` writes to the streams.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod cli;
mod codes;
mod command;
mod console;
pub mod embedded;
mod interrupt;
pub mod library;
mod lsp;
mod pages;
mod potential;
mod progress;
mod render;
mod schema;
mod table;

use std::ffi::OsString;

use clap::Parser;

/// Executes a command line on the streams of the process; `words` begin with the name of the program. The
/// exit code, 2 also where the data that were printed are not whole.
pub fn command_line(words: impl Iterator<Item = OsString>) -> u8 {
    let exit = execute(words);
    match console::finish() {
        Ok(()) => exit as u8,
        Err(error) => {
            let message = format!("the data on the standard output are not whole: {error}");
            render::error(&message, None);
            command::Exit::Input as u8
        }
    }
}

fn execute(words: impl Iterator<Item = OsString>) -> command::Exit {
    match cli::Cli::try_parse_from(words) {
        Ok(cli) => {
            console::set_up(cli.voice.color, cli.voice.verbosity());
            if let Some(Err(message)) = cli.voice.log.as_deref().map(console::log_to) {
                render::error(&message, None);
                return command::Exit::Input;
            }
            command::execute(cli.command)
        }
        Err(error) if error.use_stderr() => {
            console::usage(&error);
            command::Exit::Input
        }
        // `--help` and `--version` are no errors.
        Err(error) => {
            console::out(&error.render().to_string());
            command::Exit::Done
        }
    }
}
