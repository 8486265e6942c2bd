//! Findings for people and for programs.

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use piola_grammar::{Diagnostic, Severity, shortened};
use serde_json::{Value, json};

use crate::cli::Format;
use crate::console;

/// A text and its name.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Source<'a> {
    pub(crate) name: &'a str,
    pub(crate) text: &'a str,
}

/// Findings as rustc prints them.
fn human(source: Source<'_>, diagnostics: &[Diagnostic], color: bool) -> String {
    let renderer = if color { Renderer::styled() } else { Renderer::plain() };
    let mut out = String::new();
    for diagnostic in diagnostics {
        out.push_str(&renderer.render(&report(source, diagnostic)));
        out.push_str("\n\n");
    }
    out
}

fn report<'a>(source: Source<'a>, diagnostic: &'a Diagnostic) -> Vec<Group<'a>> {
    let level = match diagnostic.severity {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
    };
    let mut snippet = Snippet::source(source.text).path(source.name);
    let primary = AnnotationKind::Primary.span(visible(source.text, diagnostic.span.range()));
    snippet = snippet.annotation(if diagnostic.label.is_empty() {
        primary
    } else {
        primary.label(diagnostic.label.as_str())
    });
    for note in &diagnostic.notes {
        let span = visible(source.text, note.span.range());
        snippet = snippet.annotation(AnnotationKind::Context.span(span).label(note.label.as_str()));
    }
    let title = level.primary_title(diagnostic.message.as_str()).id(diagnostic.code);
    let mut group = title.element(snippet);
    for help in &diagnostic.helps {
        group = group.element(Level::HELP.message(help.as_str()));
    }
    vec![group]
}

/// A range that lies in the text and does not cut a character.
fn visible(text: &str, range: std::ops::Range<usize>) -> std::ops::Range<usize> {
    let start = text.floor_char_boundary(range.start.min(text.len()));
    let end = text.ceil_char_boundary(range.end.clamp(start, text.len()));
    start..end
}

/// Findings as objects with file, line and column (both from 1, columns in characters).
fn json(source: Source<'_>, diagnostics: &[Diagnostic]) -> Vec<Value> {
    let place = |start: u32| {
        let start = visible(source.text, start as usize..start as usize).start;
        let before = &source.text[..start];
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let line = before.matches('\n').count() + 1;
        (line, before[line_start..].chars().count() + 1)
    };
    let one = |d: &Diagnostic| {
        let (line, column) = place(d.span.start);
        let notes: Vec<Value> = d
            .notes
            .iter()
            .map(|note| {
                let (line, column) = place(note.span.start);
                json!({ "line": line, "column": column, "label": note.label })
            })
            .collect();
        json!({
            "code": d.code,
            "severity": match d.severity { Severity::Error => "error", Severity::Warning => "warning" },
            "message": d.message,
            "file": source.name,
            "line": line,
            "column": column,
            "start": d.span.start,
            "end": d.span.end,
            "label": d.label,
            "notes": notes,
            "helps": d.helps,
        })
    };
    diagnostics.iter().map(one).collect()
}

/// Prints findings: people read them on stderr, programs on stdout.
pub(crate) fn print(source: Source<'_>, diagnostics: &[Diagnostic], format: Format) {
    match format {
        Format::Human => findings(source, diagnostics),
        Format::Json => {
            for line in json(source, diagnostics) {
                console::out(&format!("{line}\n"));
            }
        }
    }
}

/// Prints findings for people.
pub(crate) fn findings(source: Source<'_>, diagnostics: &[Diagnostic]) {
    console::say(&human(source, diagnostics, console::color()));
}

/// A message with the user's words in it, for a terminal.
fn plain(message: &str) -> String {
    console::printable(&shortened(message))
}

/// Prints an error that has no place in a text, and the ways out.
pub(crate) fn error<'a>(message: &str, helps: impl IntoIterator<Item = &'a str>) {
    let mut text = format!("error: {}\n", plain(message));
    for help in helps {
        text.push_str(&format!("  help: {}\n", plain(help)));
    }
    console::say(&text);
}

/// Prints a warning that has no place in a text.
pub(crate) fn warning(message: &str) {
    console::say(&format!("warning: {}\n", plain(message)));
}
