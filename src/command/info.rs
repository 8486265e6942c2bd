//! `piola info`: the library of potentials, and the machine at hand.

use clap::ValueEnum;
use piola_compiler::{Model, print};

use super::{Exit, machine};
use crate::cli::Info;
use crate::console;
use crate::library::{self, Kind, LIBRARY};
use crate::potential;

pub(super) fn execute(arguments: &Info) -> Exit {
    match &arguments.potential {
        _ if arguments.machine => machine::show(arguments.renew),
        Some(name) => show(name),
        None => list(arguments.kind),
    }
}

/// The titles of the library, of one kind or of all.
fn list(only: Option<Kind>) -> Exit {
    let mut text = format!("piola {}\n\nlibrary of potentials\n", env!("CARGO_PKG_VERSION"));
    let is_wanted = |kind: &&Kind| only.is_none_or(|only| only == **kind);
    for kind in Kind::value_variants().iter().filter(is_wanted) {
        text.push_str(&format!("\n{}: {}\n", kind.word(), kind.title()));
        for entry in LIBRARY.iter().filter(|entry| entry.kind == *kind) {
            let Some(loaded) = potential::load(entry.name) else {
                return Exit::Input;
            };
            let title = loaded.model.title().unwrap_or("");
            text.push_str(&format!("  {:26} {title}\n", entry.name));
        }
    }
    text.push_str("\n`piola info NAME` shows formulas, parameters, units and sources\n");
    console::out(&text);
    Exit::Done
}

fn show(name: &str) -> Exit {
    let Some(loaded) = potential::load(name) else { return Exit::Input };
    console::out(&console::printable(&describe(&loaded.model)));
    if library::find(name).is_some() {
        console::out(&format!("\nfile\n{}", indent(&loaded.text)));
    }
    Exit::Done
}

/// Formulas, sources, parameters and units of a potential.
fn describe(model: &Model) -> String {
    let mut text = format!("{}: {}\n", model.name(), model.title().unwrap_or("no title"));
    for source in model.sources() {
        text.push_str(&format!("source: {source}\n"));
    }
    let dimensions: Vec<String> = model.dimensions().map(|d| d.to_string()).collect();
    text.push_str(&format!("dimensions: {}\n", dimensions.join(", ")));
    if model.weighs_volumes() {
        text.push_str("weights: volumes\n");
    }
    text.push_str("\nparameters\n");
    let variant = model.dimensions().next().and_then(|d| model.variant(d));
    for (i, parameter) in model.parameters().iter().enumerate() {
        let default = variant.and_then(|v| v.defaults[i]).map(|x| format!(" = {x}"));
        let unit = parameter.unit.as_ref().map(|unit| format!(" in {unit}"));
        let description = parameter.description.as_ref().map(|text| format!(": {text}"));
        text.push_str(&format!(
            "  {}{}{}{}\n",
            parameter.name,
            default.unwrap_or_default(),
            unit.unwrap_or_default(),
            description.unwrap_or_default()
        ));
    }
    text.push('\n');
    text.push_str(&print::model_listing(model));
    text
}

fn indent(text: &str) -> String {
    text.lines().map(|line| format!("  {line}\n")).collect()
}
