//! `piola explain`: what the code of a message means.

use piola_grammar::suggest;

use super::Exit;
use crate::cli::Explain;
use crate::codes::{Section, sections};
use crate::console;
use crate::render;

pub(super) fn execute(arguments: &Explain) -> Exit {
    let sections = sections();
    let Some(code) = &arguments.code else {
        console::out(&list(&sections));
        return Exit::Done;
    };
    match sections.iter().find(|section| section.code == code) {
        Some(section) => {
            console::out(&section.plain());
            Exit::Done
        }
        None => {
            let help = match suggest(code, sections.iter().map(|section| section.code)) {
                Some(near) => format!("did you mean `{near}`?"),
                None => "`piola explain` lists all codes".to_string(),
            };
            render::error(&format!("no message has the code `{code}`"), Some(help.as_str()));
            Exit::Input
        }
    }
}

/// All codes, part by part, a line each.
fn list(sections: &[Section]) -> String {
    let mut out = String::new();
    let mut part = "";
    for section in sections {
        if section.part != part {
            part = section.part;
            let gap = if out.is_empty() { "" } else { "\n" };
            out.push_str(&format!("{gap}{part}\n"));
        }
        out.push_str(&format!("  {:26} {}\n", section.code, section.summary));
    }
    out
}
