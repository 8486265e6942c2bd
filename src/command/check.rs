//! `piola check`: every error of every file, and what is probably a mistake.

use super::Exit;
use crate::cli::{Check, Format};
use crate::console;
use crate::potential::{self, Loaded};
use crate::render::{self, Source};

pub(super) fn execute(arguments: &Check) -> Exit {
    let mut exit = Exit::Done;
    for file in &arguments.files {
        let Some(text) = potential::read(file) else { return Exit::Input };
        let Some(loaded) = potential::load_text(file, text, arguments.format) else {
            exit = Exit::Findings;
            continue;
        };
        let warnings = loaded.model.lint(arguments.pedantic);
        let source = Source { name: &loaded.name, text: &loaded.text };
        render::print(source, &warnings, arguments.format);
        if arguments.format == Format::Human {
            console::tell(&format!("{file}: {}", describe(&loaded)));
        }
    }
    exit
}

/// What was checked, in one line.
fn describe(loaded: &Loaded) -> String {
    let model = &loaded.model;
    let energies: Vec<String> =
        model.arguments().iter().map(|argument| format!("psi({argument})")).collect();
    let dimensions: Vec<String> = model.dimensions().map(|d| d.to_string()).collect();
    let units = if model.has_units() {
        "dimensions agree"
    } else {
        "no units are stated, so dimensions were not checked"
    };
    format!("{} in {} dimensions; {units}", energies.join(", "), dimensions.join(" and "))
}
