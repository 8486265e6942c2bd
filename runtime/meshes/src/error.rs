//! What is wrong with a file, and where.

use std::fmt;

use piola_grammar::{Diagnostic, Span};

/// A mistake in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeshError {
    /// Its place as a span of bytes, and the way out.
    pub diagnostic: Diagnostic,
    /// Whether the place is one of text, that can be shown.
    pub is_text: bool,
}

impl MeshError {
    /// A file that breaks its format's rules at these bytes.
    pub(crate) fn broken(range: (usize, usize), message: impl Into<String>) -> MeshError {
        MeshError::new("broken-mesh", range, message)
    }

    /// What is right and cannot be used.
    pub(crate) fn unusable(range: (usize, usize), message: impl Into<String>) -> MeshError {
        MeshError::new("unusable-mesh", range, message)
    }

    fn new(code: &'static str, range: (usize, usize), message: impl Into<String>) -> MeshError {
        let span = Span::new(range.0, range.1.max(range.0));
        MeshError { diagnostic: Diagnostic::error(code, span, message), is_text: true }
    }

    /// The way out.
    pub(crate) fn help(mut self, help: impl Into<String>) -> MeshError {
        self.diagnostic = self.diagnostic.help(help);
        self
    }

    /// The same in a part of a file that is no text.
    pub(crate) fn in_binary(mut self) -> MeshError {
        self.is_text = false;
        self
    }
}

impl std::error::Error for MeshError {}

impl fmt::Display for MeshError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.is_text {
            write!(f, "byte {}: ", self.diagnostic.span.start)?;
        }
        write!(f, "{}", self.diagnostic.message)?;
        for help in &self.diagnostic.helps {
            write!(f, "; {help}")?;
        }
        Ok(())
    }
}
