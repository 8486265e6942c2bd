//! The words and marks of a refused line: only for messages, the grammar knows no tokens.

use crate::Span;
use crate::names;
use crate::parse::scan::number_length;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Word,
    Number,
    String,
    /// Any other single character.
    Mark,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Token<'t> {
    pub kind: Kind,
    pub text: &'t str,
    pub start: usize,
}

impl Token<'_> {
    pub(super) fn end(&self) -> usize {
        self.start + self.text.len()
    }

    pub(super) fn span(&self) -> Span {
        Span::new(self.start, self.end())
    }
}

/// Cuts a line into tokens, up to its comment.
pub(super) fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut tokens = Vec::new();
    let mut start = 0;
    while let Some(c) = text[start..].chars().next() {
        let rest = &text[start..];
        let (kind, length) = match c {
            ' ' | '\t' => {
                start += 1;
                continue;
            }
            '#' => break,
            '"' => (Kind::String, rest[1..].find('"').map_or(rest.len(), |i| i + 2)),
            '0'..='9' => (Kind::Number, number_length(rest)),
            '.' if rest[1..].starts_with(|c: char| c.is_ascii_digit()) => {
                (Kind::Number, number_length(rest))
            }
            _ => match names::name_length(rest) {
                0 => (Kind::Mark, c.len_utf8()),
                length => (Kind::Word, length),
            },
        };
        tokens.push(Token { kind, text: &rest[..length], start });
        start += length;
    }
    tokens
}
