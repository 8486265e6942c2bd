//! What went wrong, where, and what to write instead: plain data, rendered at the edge.

use crate::Span;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Something the user should know; the work goes on.
    Warning,
    /// The input cannot be used.
    Error,
}

/// A second place that explains the first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// Where.
    pub span: Span,
    /// What stands there, in the user's words.
    pub label: String,
}

/// One finding about one text.
///
/// `message` names the mistake, `label` stands under the caret, `helps` say what to write instead.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Stable kebab-case name, e.g. `dimension-mismatch`.
    pub code: &'static str,
    /// Error or warning.
    pub severity: Severity,
    /// The mistake in one sentence, lower case, no full stop.
    pub message: String,
    /// The place of the mistake.
    pub span: Span,
    /// Short text under the caret; may be empty.
    pub label: String,
    /// Further places.
    pub notes: Vec<Note>,
    /// Ways out.
    pub helps: Vec<String>,
}

/// A word longer than this is shortened in messages.
const LONG_WORD: usize = 64;

/// The text with words that are too long cut in their middle; paths stay whole.
pub fn shortened(text: &str) -> String {
    let short = |word: &str| {
        let is_path = word.contains(['/', '\\']);
        let letters: Vec<char> = word.chars().collect();
        if letters.len() <= LONG_WORD || is_path {
            return word.to_string();
        }
        let (first, last) = (&letters[..LONG_WORD / 2], &letters[letters.len() - LONG_WORD / 8..]);
        first.iter().chain(&['.', '.']).chain(last).collect()
    };
    text.split(' ').map(short).collect::<Vec<String>>().join(" ")
}

impl Diagnostic {
    /// An error with this code at this place.
    pub fn error(code: &'static str, span: Span, message: impl Into<String>) -> Self {
        Diagnostic {
            code,
            severity: Severity::Error,
            message: shortened(&message.into()),
            span,
            label: String::new(),
            notes: Vec::new(),
            helps: Vec::new(),
        }
    }

    /// A warning with this code at this place.
    pub fn warning(code: &'static str, span: Span, message: impl Into<String>) -> Self {
        Diagnostic { severity: Severity::Warning, ..Diagnostic::error(code, span, message) }
    }

    /// Text under the caret.
    pub fn label(mut self, label: impl Into<String>) -> Self {
        self.label = shortened(&label.into());
        self
    }

    /// One more place that explains the mistake.
    pub fn note(mut self, span: Span, label: impl Into<String>) -> Self {
        self.notes.push(Note { span, label: label.into() });
        self
    }

    /// One more way out.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.helps.push(help.into());
        self
    }

    /// The same finding in a text in which the parsed part starts `offset` bytes later.
    pub fn shifted(mut self, offset: usize) -> Self {
        self.span = self.span.shifted(offset);
        for note in &mut self.notes {
            note.span = note.span.shifted(offset);
        }
        self
    }
}
