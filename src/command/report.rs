//! `piola report`: a run on one page of HTML.

use piola_runtime::output::report;

use super::Exit;
use crate::cli::Report;
use crate::console;
use crate::render;

pub(super) fn execute(arguments: &Report) -> Exit {
    let folder = &arguments.folder;
    match report::write(folder, arguments.out.as_deref(), &folder.display().to_string()) {
        Ok(file) => {
            console::tell(&format!("{}: open it in a browser", file.display()));
            Exit::Done
        }
        Err(error) => {
            render::error(&error.to_string(), None);
            Exit::Input
        }
    }
}
