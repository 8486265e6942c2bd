//! `piola check`: every error of every file.

use super::Exit;
use crate::cli::{Check, Format};
use crate::potential;

pub(super) fn execute(arguments: &Check) -> Exit {
    let mut exit = Exit::Done;
    for file in &arguments.files {
        let Some(text) = potential::read(file) else { return Exit::Input };
        match potential::load_text(file, text, arguments.format) {
            Some(loaded) if arguments.format == Format::Human => {
                let energies: Vec<String> = loaded
                    .model
                    .measures()
                    .iter()
                    .map(|m| format!("psi({})", m.symbol()))
                    .collect();
                let dimensions: Vec<String> =
                    loaded.model.dimensions().map(|d| d.to_string()).collect();
                let units = if loaded.model.has_units() {
                    "dimensions agree"
                } else {
                    "no units are stated, so dimensions were not checked"
                };
                eprintln!(
                    "{file}: {} in {} dimensions; {units}",
                    energies.join(", "),
                    dimensions.join(" and ")
                );
            }
            Some(_) => {}
            None => exit = Exit::Findings,
        }
    }
    exit
}
