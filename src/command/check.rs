//! `piola check`: every error of every file, and what is probably a mistake.

use std::path::Path;

use piola_runtime::case::Case;

use super::{Exit, scene};
use crate::cli::{Check, Findings};
use crate::console;
use crate::potential::{self, Loaded};
use crate::render::{Printer, Source};

pub(super) fn execute(arguments: &Check) -> Exit {
    let mut printer = Printer::new(arguments.format);
    let exit = check(arguments, &mut printer);
    printer.finish();
    exit
}

fn check(arguments: &Check, printer: &mut Printer) -> Exit {
    let mut exit = Exit::Done;
    let mut unread = false;
    for file in &arguments.files {
        if file.ends_with(".toml") {
            match scene::check(Path::new(file), &arguments.settings, printer) {
                Ok(case) if arguments.format == Findings::Human => {
                    console::tell(&format!("{file}: {}", of_scene(&case)));
                }
                Ok(_) => {}
                Err(Exit::Input) => unread = true,
                Err(_) => exit = Exit::Findings,
            }
            continue;
        }
        let text = match potential::try_read(file) {
            Ok(text) => text,
            Err(found) => {
                printer.unplaced(file, &found);
                unread = true;
                continue;
            }
        };
        let Some(loaded) = potential::load_text(file, text, printer) else {
            exit = Exit::Findings;
            continue;
        };
        let warnings = loaded.model.lint(arguments.pedantic);
        let source = Source { name: &loaded.name, text: &loaded.text };
        printer.print(source, &warnings);
        if arguments.format == Findings::Human {
            console::tell(&format!("{file}: {}", describe(&loaded)));
        }
    }
    if unread { Exit::Input } else { exit }
}

/// What was checked of a scene, in one line.
fn of_scene(case: &Case) -> String {
    let points = case.body.n_points();
    let mut names: Vec<&str> = case.potentials.iter().map(|p| p.text.name.as_str()).collect();
    names.dedup();
    let (potential, dimension) = (names.join(" and "), case.body.dimension());
    match case.large_box() {
        Some(_) => {
            format!("{potential} in {dimension} dimensions; too many points to be looked at")
        }
        None => format!("{points} points of {potential} in {dimension} dimensions"),
    }
}

/// What was checked, in one line.
fn describe(loaded: &Loaded) -> String {
    let model = &loaded.model;
    let mut energies: Vec<String> =
        model.arguments().iter().map(|argument| format!("psi({argument})")).collect();
    energies.extend((!model.dissipations().is_empty()).then(|| "dissipation(l)".to_string()));
    let dimensions: Vec<String> = model.dimensions().map(|d| d.to_string()).collect();
    let units = if model.has_units() {
        "dimensions agree"
    } else {
        "no units are stated, so dimensions were not checked"
    };
    format!("{} in {} dimensions; {units}", energies.join(", "), dimensions.join(" and "))
}
