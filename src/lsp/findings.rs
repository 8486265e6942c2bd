//! What is wrong with a text as it is, and what would make it right.

use std::collections::HashMap;

use lsp_types::{
    CodeAction, CodeActionKind, CodeActionOrCommand, DiagnosticRelatedInformation,
    DiagnosticSeverity, Location, NumberOrString, Range, TextEdit, WorkspaceEdit,
};
use piola_compiler::check_text_with;
use piola_grammar::{Diagnostic, Severity, Span};
use piola_runtime::case::{Case, CaseError, Library};
use piola_runtime::scene::files_below;

use super::text::{Document, Kind};
use crate::library;

/// A finding with its place in the editor.
pub(super) struct Found {
    /// As the checker has it, in a text of the document.
    finding: Diagnostic,
    pub(super) diagnostic: lsp_types::Diagnostic,
}

/// Every finding about a text.
pub(super) fn of(document: &Document) -> Vec<Found> {
    let found = look(document, &document.text);
    found.into_iter().map(|finding| placed(document, finding)).collect()
}

/// The errors of a text alone; lints take longer.
pub(super) fn errors_of(document: &Document) -> Vec<Found> {
    let found = match document.kind() {
        Kind::Potential => check_text_with(&document.text, &files_below(document.folder())).err(),
        _ => Some(look(document, &document.text)),
    };
    let found = found.unwrap_or_default();
    found.into_iter().map(|finding| placed(document, finding)).collect()
}

/// The findings about a text that might stand in a document.
fn look(document: &Document, text: &str) -> Vec<Diagnostic> {
    match document.kind() {
        Kind::Potential => match check_text_with(text, &files_below(document.folder())) {
            Ok((_, model)) => model.lint(false),
            Err(found) => found,
        },
        Kind::Scene => of_scene(document, text),
        Kind::Other => Vec::new(),
    }
}

fn of_scene(document: &Document, text: &str) -> Vec<Diagnostic> {
    let names = library::names();
    let library = Library { find: &library::find, names: &names };
    let error = match Case::outline_of(text, &document.path, &[], &library) {
        Ok(case) => return case.warnings,
        Err(error) => error,
    };
    let own = document.name();
    match error {
        CaseError::Scene(report) => {
            let own = |source: usize| report.sources[source].name == own;
            let findings = report.findings.iter().filter(|found| own(found.source));
            findings.map(|found| found.diagnostic.clone()).collect()
        }
        // In a file that the scene names: told where it does.
        CaseError::Text { name, diagnostics, .. } => {
            let file = std::path::Path::new(&name)
                .file_name()
                .map_or(name.as_str().into(), |n| n.to_string_lossy());
            let quoted = text.find(&*file).map(|at| Span::new(at, at + file.len()));
            let place = quoted.unwrap_or(Span::new(0, 0));
            let told = |found: Diagnostic| {
                let message = format!("{file}: {}", found.message);
                Diagnostic { span: place, notes: Vec::new(), message, ..found }
            };
            diagnostics.into_iter().map(told).collect()
        }
        other => vec![other.unplaced()],
    }
}

fn placed(document: &Document, finding: Diagnostic) -> Found {
    let parts = [finding.message.clone(), finding.label.clone()]
        .into_iter()
        .filter(|part| !part.is_empty());
    let helps = finding.helps.iter().map(|help| format!("help: {help}"));
    let note = |note: &piola_grammar::diagnostic::Note| DiagnosticRelatedInformation {
        location: Location::new(document.uri.clone(), document.range(note.span)),
        message: note.label.clone(),
    };
    let diagnostic = lsp_types::Diagnostic {
        range: document.range(finding.span),
        severity: Some(match finding.severity {
            Severity::Error => DiagnosticSeverity::ERROR,
            Severity::Warning => DiagnosticSeverity::WARNING,
        }),
        code: Some(NumberOrString::String(finding.code.to_string())),
        source: Some("piola".to_string()),
        message: parts.chain(helps).collect::<Vec<String>>().join("\n"),
        related_information: Some(finding.notes.iter().map(note).collect()),
        ..lsp_types::Diagnostic::default()
    };
    Found { finding, diagnostic }
}

/// Repairs of the findings in a range: of what the helps name, that after which less is wrong.
pub(super) fn repairs(document: &Document, range: Range) -> Vec<CodeActionOrCommand> {
    let meets = |found: &Found| {
        let (start, end) = (found.diagnostic.range.start, found.diagnostic.range.end);
        start <= range.end && range.start <= end
    };
    let all = of(document);
    let mut actions = Vec::new();
    for found in all.iter().filter(|found| meets(found)) {
        let helps = found.finding.helps.iter().chain([&found.finding.label]);
        // Words of scenes stand in quotes.
        let replacements = helps
            .flat_map(|help| quoted(help))
            .flat_map(|new| [new.to_string(), format!("\"{new}\"")]);
        let places = [Some(found.finding.span), statement(document, found.finding.span)];
        let mut tried = replacements
            .flat_map(|new| places.into_iter().flatten().map(move |at| (at, new.clone())));
        let better = tried.find(|(place, new)| is_better(document, *place, new, &all));
        if let Some((place, new)) = better {
            let edit = TextEdit::new(document.range(place), new.clone());
            actions.push(action(document, found, &format!("write `{new}`"), edit, true));
        }
        if found.finding.severity == Severity::Warning && document.kind() == Kind::Potential {
            let end = document.range(Span::new(document.text.len(), document.text.len()));
            let line = match document.text.ends_with('\n') || document.text.is_empty() {
                true => "",
                false => "\n",
            };
            let code = found.finding.code;
            let edit = TextEdit::new(end, format!("{line}allow \"{code}\" \"why it is right\"\n"));
            actions.push(action(document, found, &format!("allow `{code}`"), edit, false));
        }
    }
    actions
}

/// What a help names between quotes: in its own quotes, or in backquotes.
fn quoted(help: &str) -> Vec<&str> {
    let is_offer = ["did you mean ", "write "].iter().find_map(|start| help.strip_prefix(start));
    let Some(offer) = is_offer else { return Vec::new() };
    let mut all: Vec<&str> = offer.split('`').skip(1).step_by(2).collect();
    if offer.starts_with('"') && offer[1..].contains('"') {
        all.extend(offer[1..].find('"').map(|end| &offer[..end + 2]));
    }
    // `write weights = "truncated"`
    if all.is_empty() && offer.contains(" = ") {
        all.push(offer);
    }
    all.retain(|new| !new.contains(".."));
    all
}

/// The line of a finding.
fn statement(document: &Document, span: Span) -> Option<Span> {
    let (start, end) = (span.start as usize, span.end as usize);
    let from = document.text.get(..start)?.rfind('\n').map_or(0, |at| at + 1);
    let to = document.text.get(end..)?.find('\n').map_or(document.text.len(), |at| end + at);
    Some(Span::new(from, to))
}

/// Whether with this in that place nothing is wrong that was not before, and less.
fn is_better(document: &Document, place: Span, new: &str, before: &[Found]) -> bool {
    let mut text = document.text.clone();
    let range = place.range();
    if text.get(range.clone()).is_none_or(|old| old == new) {
        return false;
    }
    text.replace_range(range, new);
    let after = look(document, &text);
    let was = |found: &Diagnostic| {
        before
            .iter()
            .any(|old| old.finding.code == found.code && old.finding.message == found.message)
    };
    // Lints are looked for where there are no errors.
    let errors = |found: &&Diagnostic| found.severity == Severity::Error;
    let had_errors = before.iter().any(|old| errors(&&old.finding));
    let counted: Vec<&Diagnostic> =
        after.iter().filter(|found| !had_errors || errors(found)).collect();
    counted.len() < before.len() && counted.into_iter().all(was)
}

/// Whether the text with another word in these places has no error that it did not have.
pub(super) fn check_renamed(document: &Document, places: &[Span], new: &str) -> Result<(), String> {
    let mut text = document.text.clone();
    let mut places = places.to_vec();
    places.sort_unstable();
    places.iter().rev().for_each(|place| text.replace_range(place.range(), new));
    let errors = |text: &str| -> Vec<Diagnostic> {
        let found = look(document, text).into_iter();
        found.filter(|found| found.severity == Severity::Error).collect()
    };
    let (before, after) = (errors(&document.text), errors(&text));
    let is_new = |found: &&Diagnostic| {
        before.iter().filter(|old| old.code == found.code).count()
            < after.iter().filter(|other| other.code == found.code).count()
    };
    match after.iter().find(is_new) {
        Some(found) => Err(format!("with `{new}` the file would be wrong: {}", found.message)),
        None => Ok(()),
    }
}

fn action(
    document: &Document,
    found: &Found,
    title: &str,
    edit: TextEdit,
    is_preferred: bool,
) -> CodeActionOrCommand {
    CodeAction {
        title: title.to_string(),
        kind: Some(CodeActionKind::QUICKFIX),
        diagnostics: Some(vec![found.diagnostic.clone()]),
        edit: Some(self::edit(document, vec![edit])),
        is_preferred: Some(is_preferred),
        ..CodeAction::default()
    }
    .into()
}

/// Changes of one document.
#[allow(clippy::mutable_key_type)] // The type of the protocol; an address does not change.
pub(super) fn edit(document: &Document, edits: Vec<TextEdit>) -> WorkspaceEdit {
    WorkspaceEdit::new(HashMap::from([(document.uri.clone(), edits)]))
}
