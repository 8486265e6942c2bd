//! The texts of a scene and the findings about them.
//!
//! A scene is read from its file and from the overrides of the command line. While it is read and
//! checked, a span counts through all these texts as if they stood behind one another; a
//! [`SceneReport`] leads each finding back to the text it is about.

use std::fmt;

use piola_grammar::{Diagnostic, Severity, Span};

/// One text that says something about a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceText {
    /// The file's name, or `--set ...` for an override.
    pub name: String,
    /// The whole text.
    pub text: String,
    /// Where the text begins in the spans of the scene.
    pub(super) base: usize,
}

/// The texts of one scene, the file first.
#[derive(Clone, Debug)]
pub struct Sources {
    texts: Vec<SourceText>,
}

impl Sources {
    pub(super) fn new(name: &str, text: &str) -> Sources {
        Sources { texts: vec![SourceText { name: name.into(), text: text.into(), base: 0 }] }
    }

    /// Appends a text; returns where it begins.
    pub(super) fn push(&mut self, name: &str, text: &str) -> usize {
        let last = &self.texts[self.texts.len() - 1];
        // One byte apart, so that an empty span at the end of a text belongs to that text.
        let base = last.base + last.text.len() + 1;
        self.texts.push(SourceText { name: name.into(), text: text.into(), base });
        base
    }

    /// The texts, the file first.
    pub fn texts(&self) -> &[SourceText] {
        &self.texts
    }

    /// Whether a place stands in the scene's file, not in an override.
    pub(super) fn is_in_file(&self, span: Span) -> bool {
        self.index(span) == 0
    }

    /// What stands at a span.
    pub(super) fn slice(&self, span: Span) -> &str {
        let source = &self.texts[self.index(span)];
        let range = span.start as usize - source.base..span.end as usize - source.base;
        source.text.get(range).unwrap_or("")
    }

    fn index(&self, span: Span) -> usize {
        self.texts.partition_point(|source| source.base <= span.start as usize) - 1
    }

    fn local(&self, span: Span) -> Span {
        let base = self.texts[self.index(span)].base;
        Span::new(span.start as usize - base, span.end as usize - base)
    }

    /// Leads every finding back to its text, in the order of the texts.
    pub fn report(&self, mut diagnostics: Vec<Diagnostic>) -> SceneReport {
        diagnostics.sort_by_key(|diagnostic| diagnostic.span.start);
        let findings = diagnostics.into_iter().map(|diagnostic| self.locate(diagnostic)).collect();
        SceneReport { sources: self.texts.clone(), findings }
    }

    fn locate(&self, mut diagnostic: Diagnostic) -> Finding {
        let source = self.index(diagnostic.span);
        diagnostic.span = self.local(diagnostic.span);
        for note in std::mem::take(&mut diagnostic.notes) {
            let other = self.index(note.span);
            if other == source {
                diagnostic = diagnostic.note(self.local(note.span), note.label);
            } else {
                // A note can only stand in the finding's own text.
                let place = format!("{}: `{}`", self.texts[other].name, self.slice(note.span));
                diagnostic = diagnostic.help(format!("{}, in {place}", note.label));
            }
        }
        Finding { source, diagnostic }
    }
}

/// A finding and the text it is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Index into [`SceneReport::sources`].
    pub source: usize,
    /// The finding; spans count from the start of that text.
    pub diagnostic: Diagnostic,
}

/// Everything found about a scene, with the texts that are needed to show it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneReport {
    /// The scene's file and the overrides.
    pub sources: Vec<SourceText>,
    /// The findings in the order of their places.
    pub findings: Vec<Finding>,
}

impl SceneReport {
    /// The place of a text among the sources: of one that the scene names, which findings may be about.
    pub(crate) fn source(&mut self, name: String, text: String) -> usize {
        let known = self.sources.iter().position(|source| source.name == name);
        known.unwrap_or_else(|| {
            self.sources.push(SourceText { name, text, base: 0 });
            self.sources.len() - 1
        })
    }

    /// Whether the scene cannot be used.
    pub fn has_errors(&self) -> bool {
        self.findings.iter().any(|finding| finding.diagnostic.severity == Severity::Error)
    }
}

impl fmt::Display for SceneReport {
    /// One line per finding: `scene.toml:3:11: error[unknown-key]: ...`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, finding) in self.findings.iter().enumerate() {
            let source = &self.sources[finding.source];
            let diagnostic = &finding.diagnostic;
            let (line, column) = line_and_column(&source.text, diagnostic.span.start as usize);
            let severity = match diagnostic.severity {
                Severity::Error => "error",
                Severity::Warning => "warning",
            };
            let end = if i == 0 { "" } else { "\n" };
            write!(
                f,
                "{end}{}:{line}:{column}: {severity}[{}]: {}",
                source.name, diagnostic.code, diagnostic.message
            )?;
        }
        Ok(())
    }
}

impl std::error::Error for SceneReport {}

/// Line and column (in characters) of a byte, both from 1.
fn line_and_column(text: &str, byte: usize) -> (usize, usize) {
    let before = &text.as_bytes()[..byte.min(text.len())];
    let start = before.iter().rposition(|&b| b == b'\n').map_or(0, |newline| newline + 1);
    let line = before.iter().filter(|&&b| b == b'\n').count() + 1;
    (line, String::from_utf8_lossy(&before[start..]).chars().count() + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn findings_are_led_back_to_their_text() {
        let mut sources = Sources::new("scene.toml", "a = 1\nb = 2");
        let base = sources.push("--set c=3", "c=3");
        let first = Diagnostic::error("x", Span::new(base + 2, base + 3), "about the override")
            .note(Span::new(6, 7), "not like this");
        let second = Diagnostic::error("y", Span::new(6, 7), "about b");
        let report = sources.report(vec![first, second]);
        assert_eq!(report.findings[0].source, 0);
        assert_eq!(report.findings[1].source, 1);
        let found = &report.findings[1].diagnostic;
        assert_eq!(found.span, Span::new(2, 3));
        assert_eq!(found.helps, ["not like this, in scene.toml: `b`"]);
        let text = report.to_string();
        assert_eq!(
            text,
            "scene.toml:2:1: error[y]: about b\n--set c=3:1:3: error[x]: about the override"
        );
    }

    #[test]
    fn a_place_at_the_end_of_a_text_stays_in_it() {
        let mut sources = Sources::new("scene.toml", "ab");
        sources.push("--set", "cd");
        assert!(sources.is_in_file(Span::new(2, 2)));
        assert!(!sources.is_in_file(Span::new(3, 3)));
    }
}
