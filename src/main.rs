//! The program `piola`.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(piola::command_line(std::env::args_os()))
}
