//! A text as its smallest parts, right or wrong: for what looks at a text and does not read it.

use crate::Span;
use crate::names::{KEYWORDS, name_length};
use crate::parse::number_length;

/// What a part of a text is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TokenKind {
    /// A name, the language's own among them.
    Name,
    /// A word of the grammar.
    Keyword,
    /// A number without its sign.
    Number,
    /// A text in quotes; one that is not closed ends with its line.
    Text,
    /// From `#` to the end of the line.
    Comment,
    /// An operator, a parenthesis, or what is no part of the language.
    Mark,
    /// The end of a line.
    Newline,
}

/// A part of a text and its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Token {
    /// What it is.
    pub kind: TokenKind,
    /// Its place.
    pub span: Span,
}

impl Token {
    /// What stands at its place.
    pub fn text(self, text: &str) -> &str {
        &text[self.span.range()]
    }
}

/// Marks of two characters.
const LONG_MARKS: [&str; 4] = ["==", "!=", "<=", ">="];

/// All parts of a text but blanks, in its order.
pub fn tokens(text: &str) -> Vec<Token> {
    let mut all = Vec::new();
    let mut at = if text.starts_with('\u{FEFF}') { '\u{FEFF}'.len_utf8() } else { 0 };
    while let Some(c) = text[at..].chars().next() {
        let rest = &text[at..];
        let (kind, length) = match c {
            ' ' | '\t' => {
                at += 1;
                continue;
            }
            '\r' if rest.starts_with("\r\n") => (TokenKind::Newline, 2),
            '\r' | '\n' => (TokenKind::Newline, 1),
            '#' => (TokenKind::Comment, to_line_end(rest)),
            '"' => (TokenKind::Text, text_length(rest)),
            '0'..='9' => (TokenKind::Number, number_length(rest)),
            '.' if rest[1..].starts_with(|c: char| c.is_ascii_digit()) => {
                (TokenKind::Number, number_length(rest))
            }
            _ => match name_length(rest) {
                0 if LONG_MARKS.iter().any(|mark| rest.starts_with(mark)) => (TokenKind::Mark, 2),
                0 => (TokenKind::Mark, c.len_utf8()),
                length if KEYWORDS.contains(&&rest[..length]) => (TokenKind::Keyword, length),
                length => (TokenKind::Name, length),
            },
        };
        all.push(Token { kind, span: Span::new(at, at + length) });
        at += length;
    }
    all
}

/// The parts of a text by its statements: what stands between ends of lines outside of parentheses.
/// Comments and empty lines are statements of their own.
pub fn statements<'t>(text: &str, tokens: &'t [Token]) -> Vec<&'t [Token]> {
    let mut depth = 0usize;
    let ends = |token: &Token| {
        match (token.kind, token.text(text)) {
            (TokenKind::Newline, _) => return depth == 0,
            (TokenKind::Mark, "(" | "[") => depth += 1,
            (TokenKind::Mark, ")" | "]") => depth = depth.saturating_sub(1),
            _ => {}
        }
        false
    };
    tokens.split(ends).collect()
}

fn to_line_end(rest: &str) -> usize {
    rest.find(['\n', '\r']).unwrap_or(rest.len())
}

fn text_length(rest: &str) -> usize {
    match rest[1..].find(['"', '\n', '\r']) {
        Some(end) if rest[1 + end..].starts_with('"') => end + 2,
        Some(end) => end + 1,
        None => rest.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_has_its_kind_and_place() {
        let text = "psi(λ) = -.5e-3*l' # \"no\"\nin \"not closed\r\n1.e2e <=\u{2264}";
        let parts: Vec<(TokenKind, &str)> =
            tokens(text).into_iter().map(|token| (token.kind, token.text(text))).collect();
        use TokenKind::{Comment, Keyword, Mark, Name, Newline, Number, Text};
        let expected = [
            (Name, "psi"),
            (Mark, "("),
            (Name, "λ"),
            (Mark, ")"),
            (Mark, "="),
            (Mark, "-"),
            (Number, ".5e-3"),
            (Mark, "*"),
            (Name, "l"),
            (Mark, "'"),
            (Comment, "# \"no\""),
            (Newline, "\n"),
            (Keyword, "in"),
            (Text, "\"not closed"),
            (Newline, "\r\n"),
            (Number, "1.e2"),
            (Name, "e"),
            (Mark, "<="),
            (Mark, "\u{2264}"),
        ];
        assert_eq!(parts, expected);
    }
}
