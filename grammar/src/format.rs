//! A potential file in the layout of the library: blanks, columns and empty lines, and nothing else.
//!
//! | what | becomes |
//! |---|---|
//! | blanks around `*`, `/`, `^`, inside parentheses, before commas | none |
//! | blanks around `=`, comparisons and words | one |
//! | blanks around `+`, `-` | one on both sides where there was one on any, else none |
//! | parameters and states on consecutive lines | units and descriptions in columns |
//! | comments behind statements on consecutive lines | in a column |
//! | empty lines | one at most |
//! | ends of lines | line feeds, and no byte-order mark before them |
//!
//! Names, numbers, comments and where lines end stay as they are written, so that the file means what it meant.

use crate::tokens::{Token, TokenKind, statements, tokens};
use crate::{Diagnostic, parse};

/// What a line is indented by that goes on with a statement, at least.
const INDENT: usize = 4;

/// The text of a potential file in the layout of the library; its lines end as they did.
///
/// # Errors
/// What is wrong with a text that cannot be read: where its statements end is not known.
pub fn format(text: &str) -> Result<String, Vec<Diagnostic>> {
    parse(text)?;
    let mut out = String::new();
    let mut block: Vec<Columns> = Vec::new();
    let all = tokens(text);
    for statement in statements(text, &all) {
        let lines = lines(statement);
        if lines.is_empty() {
            flush(&mut block, &mut out);
            // At most one, and none at the beginning.
            if !(out.is_empty() || out.ends_with("\n\n")) {
                out.push('\n');
            }
        } else if let Some(columns) = Columns::of(text, &lines) {
            if block.last().is_some_and(|last| last.is_declaration != columns.is_declaration) {
                flush(&mut block, &mut out);
            }
            block.push(columns);
        } else {
            flush(&mut block, &mut out);
            write(text, &lines, &mut out);
        }
    }
    flush(&mut block, &mut out);
    out.truncate(out.trim_end().len());
    out.push('\n');
    // Lines end as the first of them does.
    let first = text.split_inclusive('\n').next().unwrap_or_default();
    Ok(if first.ends_with("\r\n") { out.replace('\n', "\r\n") } else { out })
}

/// The lines of a statement that are not empty.
fn lines(statement: &[Token]) -> Vec<&[Token]> {
    let lines = statement.split(|token| token.kind == TokenKind::Newline);
    lines.filter(|line| !line.is_empty()).collect()
}

/// A statement of several lines keeps them, indented as they were.
fn write(text: &str, lines: &[&[Token]], out: &mut String) {
    let mut before = None;
    for (number, line) in lines.iter().enumerate() {
        if number > 0 {
            let start = line[0].span.start as usize;
            let blanks = text[..start].chars().rev().take_while(|c| matches!(c, ' ' | '\t'));
            let width: usize = blanks.map(|c| if c == '\t' { INDENT } else { 1 }).sum();
            out.extend(std::iter::repeat_n(' ', width.max(INDENT)));
        }
        out.push_str(&row(text, line, before));
        out.push('\n');
        before =
            line.iter().rev().find(|token| token.kind != TokenKind::Comment).copied().or(before);
    }
}

/// The parts of a line with blanks between them; `before` is what stands before it.
fn row(text: &str, line: &[Token], before: Option<Token>) -> String {
    let mut out = String::new();
    let mut before = before.map(|token| (token, false));
    for (number, token) in line.iter().enumerate() {
        let is_sign = is_sign(text, *token, before.map(|(before, _)| before));
        if let Some((last, last_is_sign)) = before.filter(|_| number > 0) {
            let after =
                |token: &Token| text[token.span.range().end..].starts_with([' ', '\t', '\n', '\r']);
            let spaced = |of: &Token, left: &Token| after(left) || after(of);
            let blanks = match (last.kind, token.kind) {
                (_, TokenKind::Comment) => 2,
                (_, TokenKind::Text) if is_description(text, line, number) => 2,
                _ if last_is_sign => 0,
                (_, TokenKind::Mark) if is_sum(text, *token) && !is_sign => {
                    usize::from(spaced(token, &last))
                }
                (TokenKind::Mark, _) if is_sum(text, last) => {
                    usize::from(number < 2 || spaced(&last, &line[number - 2]))
                }
                _ => usize::from(is_apart(text, last, *token)),
            };
            out.extend(std::iter::repeat_n(' ', blanks));
        }
        out.push_str(token.text(text).trim_end());
        before = Some((*token, is_sign));
    }
    out
}

/// Whether a text says what a potential, a parameter or a condition is.
fn is_description(text: &str, line: &[Token], number: usize) -> bool {
    number > 1 && ["potential", "parameter", "state", "break"].contains(&line[0].text(text))
}

fn is_sum(text: &str, token: Token) -> bool {
    token.kind == TokenKind::Mark && matches!(token.text(text), "+" | "-")
}

/// Whether it is a `-` with one operand.
fn is_sign(text: &str, token: Token, before: Option<Token>) -> bool {
    let ends_operand = |before: Token| match before.kind {
        TokenKind::Name | TokenKind::Number | TokenKind::Text => true,
        TokenKind::Mark => matches!(before.text(text), ")" | "]" | "'"),
        _ => false,
    };
    is_sum(text, token) && !before.is_some_and(ends_operand)
}

/// Whether a blank stands between two parts that are no signs and no sums.
fn is_apart(text: &str, last: Token, next: Token) -> bool {
    let of = |token: Token| token.text(text);
    let is_word = |token: Token| matches!(token.kind, TokenKind::Keyword);
    if next.kind == TokenKind::Mark && matches!(of(next), "," | ")" | "]" | "'") {
        return false;
    }
    if last.kind == TokenKind::Mark {
        return match of(last) {
            "," | "=" | "==" | "!=" | "<" | "<=" | ">" | ">=" | ":" => true,
            ")" | "]" | "'" => next.kind != TokenKind::Mark || is_relation(of(next)),
            _ => false,
        };
    }
    match of(next) {
        "(" => is_word(last),
        "*" | "/" | "^" => false,
        _ => true,
    }
}

fn is_relation(mark: &str) -> bool {
    matches!(mark, "=" | "==" | "!=" | "<" | "<=" | ">" | ">=" | ":")
}

/// A statement on one line whose parts stand in columns: of a parameter or state its name with its default,
/// its unit with what bounds it, and what follows; of others the statement and a comment behind it.
struct Columns {
    is_declaration: bool,
    head: String,
    unit: String,
    rest: String,
}

impl Columns {
    fn of(text: &str, lines: &[&[Token]]) -> Option<Columns> {
        let [line] = lines else { return None };
        let is_declaration = matches!(line[0].text(text), "parameter" | "state");
        let is_rest = |token: &&Token| match token.kind {
            TokenKind::Comment => true,
            TokenKind::Text => is_declaration,
            _ => false,
        };
        let rest = line.len() - line.iter().rev().take_while(is_rest).count();
        if rest == 0 || !(is_declaration || rest < line.len()) {
            return None;
        }
        let is_in = |token: &Token| is_declaration && token.text(text) == "in";
        let unit = line[..rest].iter().position(is_in).unwrap_or(rest);
        let part = |from: usize, to: usize| row(text, &line[from..to], None);
        Some(Columns {
            is_declaration,
            head: part(0, unit),
            unit: part(unit, rest),
            rest: part(rest, line.len()),
        })
    }
}

fn flush(block: &mut Vec<Columns>, out: &mut String) {
    let width = |text: &str| text.chars().count();
    let heads = block.iter().filter(|row| !row.unit.is_empty()).map(|row| width(&row.head));
    let column = heads.max().unwrap_or(0) + 1;
    let stated = |row: &Columns| match row.unit.is_empty() {
        true => row.head.clone(),
        false => format!("{:column$}{}", row.head, row.unit),
    };
    let rests = block.iter().filter(|row| !row.rest.is_empty()).map(|row| width(&stated(row)));
    let last = rests.max().unwrap_or(0) + 2;
    for row in block.drain(..) {
        let stated = stated(&row);
        let line = if row.rest.is_empty() { stated } else { format!("{stated:last$}{}", row.rest) };
        out.push_str(&line);
        out.push('\n');
    }
}
