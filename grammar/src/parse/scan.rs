//! From a text to its logical lines, before any grammar.
//!
//! Before: any text. After: at most [`MAX_BYTES`] bytes, cut into logical lines; in [`Scan::text`],
//! which is as long as the original (so spans hold for both), newlines and comments inside
//! parentheses are blanks. A line marked sound closes its parentheses and strings and nests at most
//! [`MAX_NESTING`] deep, so the recursive grammar rules may run on it.

use crate::names::{self, STATEMENT_KEYWORDS};
use crate::{Diagnostic, Span};

/// Longest text that is read, in bytes.
pub const MAX_BYTES: usize = 1 << 20;

/// How many parentheses, `if`s, prefix operators and powers may be open at one place.
pub const MAX_NESTING: usize = 256;

/// What ends a logical line.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    /// A newline outside parentheses: a file of statements.
    Statements,
    /// Nothing: a lone expression, in which all newlines are blanks.
    Lone,
}

/// The bytes `start..end` of [`Scan::text`], one statement.
pub(super) struct Line {
    pub start: usize,
    pub end: usize,
    /// Whether the scanner found nothing wrong.
    pub sound: bool,
}

/// What the scanner found.
pub(super) struct Scan {
    pub text: String,
    /// Lines that hold more than blanks and comments.
    pub lines: Vec<Line>,
    /// At most one for each line.
    pub findings: Vec<Diagnostic>,
}

/// Scans `text`; the error is the one about its size.
pub(super) fn scan(text: &str, layout: Layout) -> Result<Scan, Vec<Diagnostic>> {
    if text.len() > MAX_BYTES {
        let message = format!("this text has {} bytes; at most {MAX_BYTES} are read", text.len());
        let finding = Diagnostic::error("file-too-large", Span::new(0, 0), message);
        return Err(vec![finding.label("1 MiB is the limit of a piola file")]);
    }
    let mut scanner = Scanner {
        text,
        layout,
        masked: text.as_bytes().to_vec(),
        open: Vec::new(),
        at: 0,
        line_start: 0,
        after_operand: false,
        has_content: false,
        problem: None,
        lines: Vec::new(),
        findings: Vec::new(),
    };
    if text.starts_with('\u{FEFF}') {
        scanner.blank(0, '\u{FEFF}'.len_utf8());
        scanner.at = '\u{FEFF}'.len_utf8();
    }
    scanner.run();
    // Only whole characters and whole comments were overwritten, so this never replaces anything.
    let text = String::from_utf8_lossy(&scanner.masked).into_owned();
    Ok(Scan { text, lines: scanner.lines, findings: scanner.findings })
}

/// Something that is open at the current place and makes what follows nest deeper.
enum Open {
    /// `(` or `[` at this byte.
    Bracket(usize),
    /// `if`, and whether its `then` and `else` have come.
    If { then: bool, otherwise: bool },
    /// A prefix operator or `^`, which ends with its operand.
    Operator,
}

struct Scanner<'t> {
    text: &'t str,
    layout: Layout,
    masked: Vec<u8>,
    open: Vec<Open>,
    at: usize,
    line_start: usize,
    /// Whether the last token ended an operand, so that `-` subtracts.
    after_operand: bool,
    /// Whether the line holds more than blanks and comments.
    has_content: bool,
    /// What is wrong with this line, if anything.
    problem: Option<Diagnostic>,
    lines: Vec<Line>,
    findings: Vec<Diagnostic>,
}

impl Scanner<'_> {
    fn run(&mut self) {
        while let Some(c) = self.text[self.at..].chars().next() {
            let length = match c {
                '\n' => self.newline(1),
                '\r' if self.text[self.at..].starts_with("\r\n") => self.newline(2),
                '\r' => self.newline(1),
                ' ' | '\t' => 1,
                '#' => self.comment(),
                _ => {
                    self.has_content = true;
                    self.token(c)
                }
            };
            self.at += length;
        }
        self.end_line(self.text.len());
    }

    /// Takes one token and returns its length in bytes.
    fn token(&mut self, c: char) -> usize {
        match c {
            '"' => self.string(),
            '(' | '[' => self.open(1, Open::Bracket(self.at)),
            ')' | ']' => {
                self.close_until(|open| matches!(open, Open::Bracket(_)));
                self.open.pop();
                self.after_operand = true;
                1
            }
            ',' => self.separator(),
            '-' if !self.after_operand => self.open(1, Open::Operator),
            '^' => self.open(1, Open::Operator),
            '+' | '-' | '*' | '/' | ':' | '<' | '>' | '=' | '!' => self.infix(1),
            '.' | '0'..='9' => {
                self.after_operand = true;
                number_length(&self.text[self.at..])
            }
            _ => match names::name_length(&self.text[self.at..]) {
                0 => c.len_utf8(),
                length => self.word(length),
            },
        }
    }

    fn word(&mut self, length: usize) -> usize {
        match &self.text[self.at..self.at + length] {
            "if" => return self.open(length, Open::If { then: false, otherwise: false }),
            "not" => return self.open(length, Open::Operator),
            "and" | "or" | "in" => return self.infix(length),
            "then" => {
                self.close_until(|open| {
                    matches!(open, Open::Bracket(_) | Open::If { then: false, .. })
                });
                if let Some(Open::If { then, .. }) = self.open.last_mut() {
                    *then = true;
                }
                self.after_operand = false;
            }
            "else" => {
                self.close_until(|open| {
                    matches!(open, Open::Bracket(_) | Open::If { otherwise: false, .. })
                });
                if let Some(Open::If { otherwise, .. }) = self.open.last_mut() {
                    *otherwise = true;
                }
                self.after_operand = false;
            }
            _ => self.after_operand = true,
        }
        length
    }

    fn open(&mut self, length: usize, what: Open) -> usize {
        self.after_operand = false;
        let too_deep = self.open.len() >= MAX_NESTING;
        // Beyond the limit only brackets still matter: they say where the line ends.
        if !too_deep || matches!(what, Open::Bracket(_)) {
            self.open.push(what);
        }
        if too_deep && self.problem.is_none() {
            let span = Span::new(self.at, self.at + length);
            let message = format!("this nests deeper than {MAX_NESTING} levels");
            self.problem = Some(
                Diagnostic::error("nesting-too-deep", span, message)
                    .label(format!("level {}", MAX_NESTING + 1))
                    .help("give the inner part a name: `part = ...`, and use the name here"),
            );
        }
        length
    }

    /// An operator between operands ends the powers and signs before it.
    fn infix(&mut self, length: usize) -> usize {
        self.close_until(|open| !matches!(open, Open::Operator));
        self.after_operand = false;
        length
    }

    fn separator(&mut self) -> usize {
        self.close_until(|open| matches!(open, Open::Bracket(_)));
        self.after_operand = false;
        1
    }

    /// Drops what is open down to the first for which `stays` holds.
    fn close_until(&mut self, stays: impl Fn(&Open) -> bool) {
        while self.open.last().is_some_and(|open| !stays(open)) {
            self.open.pop();
        }
    }

    fn string(&mut self) -> usize {
        let rest = &self.text[self.at + 1..];
        let end = rest.find(['"', '\n', '\r']).unwrap_or(rest.len());
        if rest[end..].starts_with('"') {
            return end + 2;
        }
        let line = &rest[..end];
        let span = Span::new(self.at, self.at + 1 + line.trim_end().len());
        let finding = Diagnostic::error("syntax", span, "this text has no closing quote")
            .label("opened here")
            .help("close it with `\"` on the same line");
        self.problem.get_or_insert(finding);
        line.len() + 1
    }

    fn comment(&mut self) -> usize {
        let rest = &self.text[self.at..];
        let length = rest.find(['\n', '\r']).unwrap_or(rest.len());
        if self.innermost_bracket().is_some() || self.layout == Layout::Lone {
            self.blank(self.at, self.at + length);
        }
        length
    }

    fn newline(&mut self, length: usize) -> usize {
        let next = self.at + length;
        let goes_on = match self.layout {
            Layout::Lone => true,
            Layout::Statements => {
                self.innermost_bracket().is_some() && !begins_statement(&self.text[next..])
            }
        };
        if goes_on {
            self.blank(self.at, next);
        } else {
            self.end_line(self.at);
            self.line_start = next;
        }
        length
    }

    fn end_line(&mut self, end: usize) {
        if let Some(at) = self.innermost_bracket() {
            let mark = &self.text[at..at + 1];
            let closing = if mark == "(" { ")" } else { "]" };
            let finding = Diagnostic::error(
                "unclosed-parenthesis",
                Span::new(at, at + 1),
                format!("this `{mark}` is never closed"),
            )
            .help(format!("add the missing `{closing}`"));
            self.problem.get_or_insert(finding);
        }
        if self.has_content {
            let sound = self.problem.is_none();
            self.lines.push(Line { start: self.line_start, end, sound });
        }
        self.findings.extend(self.problem.take());
        self.open.clear();
        self.has_content = false;
        self.after_operand = false;
    }

    fn innermost_bracket(&self) -> Option<usize> {
        self.open.iter().rev().find_map(|open| match open {
            Open::Bracket(at) => Some(*at),
            _ => None,
        })
    }

    fn blank(&mut self, start: usize, end: usize) {
        self.masked[start..end].fill(b' ');
    }
}

/// The length of the number at the start of `text`, at least 1.
pub(crate) fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digit = |i: usize| bytes.get(i).is_some_and(u8::is_ascii_digit);
    let mut length = 0;
    while digit(length) || bytes.get(length) == Some(&b'.') {
        length += 1;
    }
    if matches!(bytes.get(length), Some(b'e' | b'E')) {
        let signed = usize::from(matches!(bytes.get(length + 1), Some(b'+' | b'-')));
        if digit(length + 1 + signed) {
            length += 1 + signed;
            while digit(length) {
                length += 1;
            }
        }
    }
    length.max(1)
}

/// Whether a line begins as only a statement can: then an open parenthesis before it was forgotten.
fn begins_statement(text: &str) -> bool {
    let line = text[..text.find(['\n', '\r']).unwrap_or(text.len())].trim_start();
    let length = names::name_length(line);
    if length == 0 {
        return false;
    }
    let (word, rest) = (&line[..length], line[length..].trim_start());
    if STATEMENT_KEYWORDS.contains(&word) {
        return true;
    }
    let defines = |text: &str| text.starts_with('=') && !text.starts_with("==");
    match rest.strip_prefix('(') {
        None => defines(rest),
        Some(inside) => inside.split_once(')').is_some_and(|(formals, after)| {
            defines(after.trim_start())
                && formals.chars().all(|c| names::continues_name(c) || ", ".contains(c))
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Vec<String> {
        let scan = scan(text, Layout::Statements).unwrap();
        assert_eq!(scan.text.len(), text.len());
        scan.lines.iter().map(|line| scan.text[line.start..line.end].to_string()).collect()
    }

    fn codes(text: &str) -> Vec<(&'static str, u32)> {
        let scan = scan(text, Layout::Statements).unwrap();
        scan.findings.iter().map(|finding| (finding.code, finding.span.start)).collect()
    }

    #[test]
    fn newlines_and_comments_inside_parentheses_are_blanks() {
        assert_eq!(
            lines("a = (1 # one\n + 2)\nb"),
            ["a = (1      \n + 2)".replace('\n', " "), "b".into()]
        );
        assert_eq!(lines("a\r\n\r\n# c (\r\nb # d"), ["a", "b # d"]);
        assert_eq!(lines("\u{FEFF}a"), ["   a"]);
        assert_eq!(lines("s \"(#\" # (\nt"), ["s \"(#\" # (", "t"]);
    }

    #[test]
    fn a_forgotten_parenthesis_ends_before_the_next_statement() {
        for next in ["parameter x", "S(x, y) = 1", "k = 2", "psi(l) = 3"] {
            let text = format!("a = (1 +\n 2\n{next}");
            assert_eq!(codes(&text), [("unclosed-parenthesis", 4)], "{next}");
            assert_eq!(lines(&text).len(), 2, "{next}");
        }
        assert_eq!(codes("a = (b\n == c)"), []);
    }

    fn deepest(unit: &str, count: usize) -> bool {
        let text = format!("a = {}", unit.repeat(count));
        codes(&text).iter().all(|(code, _)| *code != "nesting-too-deep")
    }

    #[test]
    fn everything_that_nests_is_counted() {
        for unit in ["(", "-", "not ", "2^", "f(", "if ", "if a then b else ", "if a then "] {
            assert!(deepest(unit, MAX_NESTING), "{unit}");
            assert!(!deepest(unit, MAX_NESTING + 1), "{unit}");
            assert!(!deepest(unit, 50_000), "{unit}");
        }
        assert!(!deepest("2^-", MAX_NESTING / 2 + 1), "2^- opens two");
        assert!(!deepest("2e-3^", MAX_NESTING + 1), "the sign of an exponent is no operator");
        for flat in ["-x*", "x^2+", "(1)+", "(-x)", "f(-x, if a then b else c)+"] {
            assert!(deepest(flat, 5_000), "{flat}");
        }
        assert!(deepest("(if if a then b else c then d else e)", 5_000));
    }

    #[test]
    fn too_large_a_text_is_refused() {
        let text = " ".repeat(MAX_BYTES + 1);
        assert_eq!(scan(&text, Layout::Lone).err().unwrap()[0].code, "file-too-large");
        assert!(scan(&text[1..], Layout::Lone).is_ok());
    }
}
