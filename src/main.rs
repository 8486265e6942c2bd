//! The command line of piola: `piola --help`.
//!
//! stdout carries data, stderr everything else. Exit codes: 0 done, 1 findings or failed checks,
//! 2 wrong usage or input, 3 the solver did not converge, 130 or 143 a signal ended the run.

// These macros panic where the stream is closed or its disk full: `console` writes to the streams.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod cli;
mod codes;
mod command;
mod console;
mod interrupt;
mod library;
mod potential;
mod progress;
mod render;
mod table;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let exit = match cli::Cli::try_parse() {
        Ok(cli) => {
            console::set_up(cli.voice.color, cli.voice.verbosity());
            command::execute(cli.command)
        }
        Err(error) if error.use_stderr() => {
            let _ = error.print();
            command::Exit::Input
        }
        // `--help` and `--version` are no errors.
        Err(error) => {
            console::out(&error.render().to_string());
            command::Exit::Done
        }
    };
    match console::finish() {
        Ok(()) => exit.code(),
        Err(error) => {
            let message = format!("the data on the standard output are not whole: {error}");
            render::error(&message, None);
            command::Exit::Input.code()
        }
    }
}
