//! `piola completions`: for the shell.

use clap::CommandFactory as _;

use super::Exit;
use crate::cli::Cli;
use crate::console;

pub(super) fn execute(shell: clap_complete::Shell) -> Exit {
    let mut buffer = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "piola", &mut buffer);
    console::out(&String::from_utf8_lossy(&buffer));
    Exit::Done
}
