//! Findings for people and for programs.

use std::collections::HashSet;
use std::path::PathBuf;

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use piola_grammar::{Diagnostic, Severity, shortened};
use serde_json::{Value, json};

use crate::cli::Findings;
use crate::codes;
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
    // What `--set` was given is the text that is shown: it is no name of a file.
    let name = if source.name.starts_with("--set ") { "--set" } else { source.name };
    let mut snippet = Snippet::source(source.text).path(name);
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

/// Where something stands: line and column, both from 1, columns in characters.
#[derive(Clone, Copy)]
struct Place {
    line: usize,
    column: usize,
}

impl Place {
    fn of(source: Source<'_>, start: u32) -> Place {
        let start = visible(source.text, start as usize..start as usize).start;
        let before = &source.text[..start];
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let line = before.matches('\n').count() + 1;
        Place { line, column: before[line_start..].chars().count() + 1 }
    }
}

fn word(severity: Severity) -> &'static str {
    match severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
    }
}

/// A finding as an object with file, line and column.
pub(crate) fn json(source: Source<'_>, d: &Diagnostic) -> Value {
    let Place { line, column } = Place::of(source, d.span.start);
    let notes: Vec<Value> = d
        .notes
        .iter()
        .map(|note| {
            let Place { line, column } = Place::of(source, note.span.start);
            json!({ "line": line, "column": column, "label": note.label })
        })
        .collect();
    json!({
        "code": d.code,
        "severity": word(d.severity),
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
}

/// The message with label and ways out, in one line.
fn sentence(d: &Diagnostic) -> String {
    let label = (!d.label.is_empty()).then(|| d.label.clone());
    let parts: Vec<String> =
        std::iter::once(d.message.clone()).chain(label).chain(d.helps.iter().cloned()).collect();
    parts.join("; ")
}

/// `file:3:11: error[unknown-name]: ..`, as compilers write it.
fn short(source: Source<'_>, d: &Diagnostic) -> String {
    let Place { line, column } = Place::of(source, d.span.start);
    let (severity, code) = (word(d.severity), d.code);
    format!("{}:{line}:{column}: {severity}[{code}]: {}\n", source.name, sentence(d))
}

/// A workflow command of GitHub's runners.
fn github(source: Source<'_>, d: &Diagnostic) -> String {
    let [start, end] = [d.span.start, d.span.end].map(|at| Place::of(source, at));
    let escaped = |text: &str, more: &[(char, &str)]| {
        let mut text = text.replace('%', "%25").replace('\r', "%0D").replace('\n', "%0A");
        for (c, code) in more {
            text = text.replace(*c, code);
        }
        text
    };
    let property = |text: &str| escaped(text, &[(':', "%3A"), (',', "%2C")]);
    format!(
        "::{} file={},line={},col={},endLine={},endColumn={},title={}::{}\n",
        word(d.severity),
        property(source.name),
        start.line,
        start.column,
        end.line,
        end.column,
        property(d.code),
        escaped(&sentence(d), &[])
    )
}

/// A result of SARIF 2.1.0 (OASIS).
fn sarif(source: Source<'_>, d: &Diagnostic) -> Value {
    let [start, end] = [d.span.start, d.span.end].map(|at| Place::of(source, at));
    json!({
        "ruleId": d.code,
        "level": word(d.severity),
        "message": { "text": sentence(d) },
        "locations": [{
            "physicalLocation": {
                "artifactLocation": { "uri": uri(source.name) },
                "region": {
                    "startLine": start.line,
                    "startColumn": start.column,
                    "endLine": end.line,
                    "endColumn": end.column,
                },
            },
        }],
    })
}

/// A file's name as a relative reference of RFC 3986.
pub(crate) fn uri(name: &str) -> String {
    let mut uri = String::new();
    for byte in name.replace('\\', "/").bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => {
                uri.push(byte as char);
            }
            _ => uri.push_str(&format!("%{byte:02X}")),
        }
    }
    uri
}

/// A log of SARIF 2.1.0 with these results.
fn sarif_log(results: &[Value]) -> Value {
    let mut codes: Vec<&str> = results.iter().filter_map(|r| r["ruleId"].as_str()).collect();
    codes.sort_unstable();
    codes.dedup();
    let rule =
        |code: &&str| json!({ "id": code, "shortDescription": { "text": codes::summary(code) } });
    json!({
        "version": "2.1.0",
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "runs": [{
            "tool": { "driver": {
                "name": "piola",
                "version": env!("CARGO_PKG_VERSION"),
                "rules": codes.iter().map(rule).collect::<Vec<Value>>(),
            } },
            "columnKind": "unicodeCodePoints",
            "results": results,
        }],
    })
}

/// Prints findings: people read them on stderr, programs on stdout.
pub(crate) struct Printer {
    format: Findings,
    /// What is printed at the end, in one log.
    results: Vec<Value>,
    /// Findings so far, by their files: a potential may be checked alone and with the scene that names it.
    told: HashSet<(PathBuf, u32, String)>,
}

impl Printer {
    pub(crate) fn new(format: impl Into<Findings>) -> Printer {
        Printer { format: format.into(), results: Vec::new(), told: HashSet::new() }
    }

    pub(crate) fn print(&mut self, source: Source<'_>, diagnostics: &[Diagnostic]) {
        let file = std::fs::canonicalize(source.name).unwrap_or_else(|_| source.name.into());
        for diagnostic in diagnostics {
            let found = (file.clone(), diagnostic.span.start, diagnostic.message.clone());
            if self.told.insert(found) {
                self.tell(source, diagnostic);
            }
        }
    }

    fn tell(&mut self, source: Source<'_>, diagnostic: &Diagnostic) {
        match self.format {
            Findings::Human => findings(source, std::slice::from_ref(diagnostic)),
            Findings::Json => console::out(&format!("{}\n", json(source, diagnostic))),
            Findings::Short => console::out(&short(source, diagnostic)),
            Findings::Github => console::out(&github(source, diagnostic)),
            Findings::Sarif => self.results.push(sarif(source, diagnostic)),
        }
    }

    /// Prints an error that has no place in the text of the file: programs are told its beginning.
    pub(crate) fn unplaced(&mut self, name: &str, found: &Diagnostic) {
        match self.format {
            Findings::Human => unplaced(Some(found.code), &found.message, &found.helps),
            _ => self.tell(Source { name, text: "" }, found),
        }
    }

    /// The end of what is printed.
    pub(crate) fn finish(self) {
        if self.format == Findings::Sarif {
            console::out(&format!("{:#}\n", sarif_log(&self.results)));
        }
    }
}

/// Prints findings for people.
pub(crate) fn findings(source: Source<'_>, diagnostics: &[Diagnostic]) {
    diagnostics.iter().for_each(|diagnostic| console::find(|| json(source, diagnostic)));
    console::say(&human(source, diagnostics, console::color()));
}

/// A message with the user's words in it, for a terminal.
fn plain(message: &str) -> String {
    console::printable(&shortened(message))
}

/// Prints an error that has no place in a text, and the ways out.
pub(crate) fn error<'a>(message: &str, helps: impl IntoIterator<Item = &'a str>) {
    let helps: Vec<String> = helps.into_iter().map(str::to_owned).collect();
    unplaced(None, message, &helps);
}

fn unplaced(code: Option<&str>, message: &str, helps: &[String]) {
    console::find(|| {
        let mut found = json!({ "severity": "error", "message": message, "helps": helps });
        if let Some(code) = code {
            found["code"] = json!(code);
        }
        found
    });
    let code = code.map_or(String::new(), |code| format!("[{code}]"));
    let mut text = format!("error{code}: {}\n", plain(message));
    for help in helps {
        text.push_str(&format!("  help: {}\n", plain(help)));
    }
    console::say(&text);
}

/// Prints a warning that has no place in a text.
pub(crate) fn warning(message: &str) {
    console::find(|| json!({ "severity": "warning", "message": message, "helps": [] }));
    console::say(&format!("warning: {}\n", plain(message)));
}
