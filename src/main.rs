//! The command line of piola: `piola --help`.
//!
//! stdout carries data, stderr everything else. Exit codes: 0 done, 1 findings or failed checks,
//! 2 wrong usage or input, 3 the solver did not converge.

mod cli;
mod codes;
mod command;
mod library;
mod potential;
mod render;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match cli::Cli::try_parse() {
        Ok(cli) => command::execute(cli.command).code(),
        Err(error) => {
            let _ = error.print();
            // `--help` and `--version` are no errors.
            if error.use_stderr() { command::Exit::Input.code() } else { ExitCode::SUCCESS }
        }
    }
}
