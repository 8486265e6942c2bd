//! Marks and words of other languages, of mathematics and of word processors.

use super::super::parser::Rule;
use super::token::Kind;
use super::{Failure, Goal};
use crate::names::KEYWORDS;
use crate::{Diagnostic, Span};

/// What people write, and what to write instead. Longer marks before their beginnings.
const FOREIGN_MARKS: &[(&str, &str)] = &[
    ("**", "a power is written `^`"),
    ("&&", "write `and`"),
    ("||", "write `or`"),
    ("<>", "write `!=`"),
    ("=<", "write `<=`"),
    ("=>", "write `>=`"),
    ("=!", "write `!=`"),
    (":=", "write `=`"),
    ("//", "division is `/`; a comment begins with `#`"),
    ("/*", "a comment begins with `#` and ends with its line"),
    ("+=", "a name gets its value once: `name = ...`"),
    ("-=", "a name gets its value once: `name = ...`"),
    ("*=", "a name gets its value once: `name = ...`"),
    ("/=", "write `!=` for unequal"),
    ("->", "write `if c then x else y` or `name(x) = ...`"),
    ("&", "write `and`"),
    ("|", "an absolute value is `abs(x)`; the logical operator is `or`"),
    ("~", "write `not`"),
    ("?", "write `if c then x else y`"),
    (";", "a statement ends with its line: begin a new line"),
    ("{", "write parentheses `( )`"),
    ("}", "write parentheses `( )`"),
    ("%", "a comment begins with `#`"),
    ("\\", "write the name without the backslash, e.g. `psi` or `ψ`"),
    (
        "'",
        "a transpose stands behind its tensor, `F'`; texts stand in double quotes `\"...\"`; derivatives are taken by the tool",
    ),
    ("`", "texts stand in double quotes `\"...\"`"),
    ("@", "a product of tensors is written `*`"),
    ("⊗", "the tensor n m of two vectors is `dyad(n, m)`, with `n = vector(x, y, z)`"),
    ("ᵀ", "a transpose is written `F'`"),
    ("·", "write `*`"),
    ("⋅", "write `*`"),
    ("∙", "write `*`"),
    ("×", "write `*`"),
    ("÷", "write `/`"),
    ("−", "write the plain minus sign `-`"),
    ("–", "write the plain minus sign `-`"),
    ("—", "write the plain minus sign `-`"),
    ("≤", "write `<=`"),
    ("≥", "write `>=`"),
    ("≠", "write `!=`"),
    ("∧", "write `and`"),
    ("∨", "write `or`"),
    ("¬", "write `not`"),
    ("√", "write `sqrt(x)`"),
    ("∞", "write `inf`"),
    ("⁰", "write `^0`"),
    ("¹", "write `^1`"),
    ("²", "write `^2`"),
    ("³", "write `^3`"),
    ("⁴", "write `^4`"),
    ("⁻", "write `^-1` and so on"),
    ("½", "write `1/2`"),
    ("¼", "write `1/4`"),
    ("“", "write plain quotes `\"...\"`"),
    ("”", "write plain quotes `\"...\"`"),
    ("„", "write plain quotes `\"...\"`"),
    ("«", "write plain quotes `\"...\"`"),
    ("‘", "write plain quotes `\"...\"`"),
    ("’", "write plain quotes `\"...\"`"),
];

/// Words of other languages, in lower case, with the words of this one.
const FOREIGN_WORDS: &[(&str, &str)] = &[
    ("elif", "write `else if c then x else y`"),
    ("elsif", "write `else if c then x else y`"),
    ("elseif", "write `else if c then x else y`"),
    ("endif", "an `if c then x else y` needs no end"),
    ("end", "an `if c then x else y` needs no end"),
    ("fi", "an `if c then x else y` needs no end"),
    ("where", "define names on lines of their own, before they are used"),
    ("mod", "there is no remainder"),
    ("xor", "write `a != b`"),
    ("is", "write `==`"),
    ("and", "write it in lower case: `and`"),
    ("or", "write it in lower case: `or`"),
    ("not", "write it in lower case: `not`"),
    ("if", "write it in lower case: `if`"),
    ("then", "write it in lower case: `then`"),
    ("else", "write it in lower case: `else`"),
    ("in", "write it in lower case: `in`"),
];

pub(super) fn explain(failure: &Failure<'_>) -> Option<Diagnostic> {
    equals_sign(failure)
        .or_else(|| exclamation_mark(failure))
        .or_else(|| absolute_value(failure))
        .or_else(|| member(failure))
        .or_else(|| foreign_mark(failure))
        .or_else(|| unknown_character(failure))
        .or_else(|| foreign_word(failure))
}

/// `=` where values are compared.
fn equals_sign(failure: &Failure<'_>) -> Option<Diagnostic> {
    let next = failure.after().filter(|next| next.start == failure.at + 1);
    let single = failure.found_text() == "="
        && !next.is_some_and(|next| matches!(next.text, "=" | "<" | ">" | "!"));
    let before = failure.before().filter(|before| before.end() == failure.at);
    let doubled = before.is_some_and(|before| matches!(before.text, ":" | "+" | "-" | "*" | "/"));
    (single && !doubled && failure.expects(Rule::infix)).then(|| {
        failure
            .error("`=` defines a name and does not compare")
            .label("not a comparison")
            .help("write `==` to compare")
    })
}

/// `!c` for `not c`.
fn exclamation_mark(failure: &Failure<'_>) -> Option<Diagnostic> {
    let rest = failure.rest();
    (rest.starts_with('!') && !rest.starts_with("!=")).then(|| {
        failure.error("there is no operator `!`").help("write `not c` for a condition `c`")
    })
}

/// `|x|` where a value should stand.
fn absolute_value(failure: &Failure<'_>) -> Option<Diagnostic> {
    if !failure.rest().starts_with('|') || !failure.expects_operand() {
        return None;
    }
    let inside = &failure.rest()[1..];
    let help = match inside.find('|') {
        Some(end @ 1..=40) => {
            let inside = inside[..end].trim();
            format!("write `abs({inside})`; of a vector or a tensor `norm({inside})`")
        }
        _ => "write `abs(x)`; the norm of a vector or a tensor is `norm(A)`".into(),
    };
    Some(failure.error("there are no bars for the absolute value").help(help))
}

/// `F.T`, `E.norm`: what other languages hang on a name.
fn member(failure: &Failure<'_>) -> Option<Diagnostic> {
    let next = failure.after().filter(|next| next.start == failure.at + 1)?;
    if failure.found_text() != "." || next.kind != Kind::Word || !failure.expects(Rule::infix) {
        return None;
    }
    let tensor = failure.before().map_or("F", |before| match before.text {
        ")" => "(..)",
        text => text,
    });
    let finding = failure.error(format!("there is no `.{}` in the language", next.text));
    Some(match next.text {
        "T" | "t" => finding.help(format!("a transpose is written `{tensor}'`")),
        _ => finding.help(
            "a function stands before its argument: `tr(E)`; a product of tensors is `F'*F`, a sum \
             of products of components `E : E`",
        ),
    })
}

fn foreign_mark(failure: &Failure<'_>) -> Option<Diagnostic> {
    for &(mark, help) in FOREIGN_MARKS {
        // The grammar may have taken the first half of the mark for an operator.
        for start in failure.at.saturating_sub(mark.len() - 1)..=failure.at {
            if failure.text.get(start..).is_some_and(|text| text.starts_with(mark)) {
                let place = Span::new(start, start + mark.len());
                let message = format!("there is no `{mark}` in the language");
                return Some(Diagnostic::error("syntax", place, message).help(help));
            }
        }
    }
    None
}

/// A character that can stand nowhere outside a text or a comment.
fn unknown_character(failure: &Failure<'_>) -> Option<Diagnostic> {
    let c = failure.rest().chars().next()?;
    if failure.found_kind() != Some(Kind::Mark) || "+-*/^=<>!()[],.:".contains(c) {
        return None;
    }
    let message = format!("unexpected character {}", quoted(c.encode_utf8(&mut [0; 4])));
    let finding = failure.error(message).label("not part of the language");
    Some(if c.is_whitespace() || ('\u{200B}'..='\u{200F}').contains(&c) {
        finding.help("replace this invisible character by a plain blank")
    } else if c.is_alphabetic() {
        finding.help("names are made of the letters a-z and A-Z, Greek letters, digits and `_`")
    } else {
        finding
    })
}

fn foreign_word(failure: &Failure<'_>) -> Option<Diagnostic> {
    let word = failure.found_text();
    if failure.found_kind() != Some(Kind::Word) || failure.goal == Goal::Unit {
        return None;
    }
    if KEYWORDS.contains(&word) {
        return None;
    }
    let lower = word.to_ascii_lowercase();
    let (_, help) = FOREIGN_WORDS.iter().find(|(foreign, _)| *foreign == lower)?;
    Some(failure.error(format!("`{word}` is not a word of the language")).help(*help))
}

/// A character for a message: itself, or its number where it cannot be seen.
pub(super) fn quoted(mark: &str) -> String {
    let visible = |c: char| !c.is_control() && !c.is_whitespace() && !is_formatting(c);
    match mark.chars().next() {
        Some(c) if visible(c) => format!("`{c}`"),
        Some(c) => format!("U+{:04X}", c as u32),
        None => "nothing".into(),
    }
}

/// Invisible characters that change how text around them is shown.
fn is_formatting(c: char) -> bool {
    matches!(c as u32, 0xAD | 0x200B..=0x200F | 0x202A..=0x202E | 0x2060..=0x206F | 0xFEFF)
}
