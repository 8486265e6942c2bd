//! The program `piola`.

use std::process::ExitCode;

fn main() -> ExitCode {
    piola::command_line()
}
