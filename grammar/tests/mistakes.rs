//! Every mistake we explain, with what we say: `mistakes.txt` beside this file.
//!
//! A case begins with `s>` (a statement, below `potential p`), `f>` (a whole file), `e>` (an
//! expression) or `u>` (a unit) and goes on in lines with `+>`; the findings stand below their line. `PIOLA_BLESS=1 cargo test -p piola-grammar --test mistakes` writes what is found now.

use piola_grammar::{CODES, Diagnostic, parse, parse_expression, parse_unit};

const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/mistakes.txt");

#[test]
fn every_mistake_is_explained_as_recorded() {
    let recorded = std::fs::read_to_string(PATH).unwrap();
    let mut now = String::new();
    let mut case: Vec<&str> = Vec::new();
    for line in recorded.lines() {
        if is_input(line) {
            if !line.starts_with('+') {
                finish(&mut now, &mut case);
            }
            case.push(line);
        } else if !line.starts_with("  ") {
            finish(&mut now, &mut case);
            now.push_str(line);
            now.push('\n');
        }
    }
    finish(&mut now, &mut case);
    if std::env::var_os("PIOLA_BLESS").is_some() {
        std::fs::write(PATH, &now).unwrap();
        return;
    }
    assert!(now == recorded, "findings changed; expected:\n{recorded}\nfound:\n{now}");
}

#[test]
fn every_code_has_a_case() {
    let recorded = std::fs::read_to_string(PATH).unwrap();
    for code in CODES.iter().filter(|code| !beyond_a_line(code)) {
        assert!(recorded.contains(&format!("error[{code}]")), "{code}");
    }
}

/// These need large texts: see `limits.rs`.
fn beyond_a_line(code: &str) -> bool {
    matches!(code, "file-too-large" | "nesting-too-deep")
}

fn is_input(line: &str) -> bool {
    line.get(..2).is_some_and(|mark| ["s>", "f>", "e>", "u>", "+>"].contains(&mark))
}

/// Prints the case with what is found in it.
fn finish(out: &mut String, case: &mut Vec<&str>) {
    let Some(first) = case.first() else { return };
    let text: Vec<&str> =
        case.iter().map(|line| line[2..].strip_prefix(' ').unwrap_or("")).collect();
    let text = text.join("\n");
    let (prefix, found) = match &first[..1] {
        "s" => ("potential p\n", parse(&format!("potential p\n{text}")).err()),
        "f" => ("", parse(&text).err()),
        "e" => ("", parse_expression(&text).err()),
        _ => ("", parse_unit(&text).err()),
    };
    let found = found.unwrap_or_else(|| panic!("no mistake in: {text}"));
    let full = format!("{prefix}{text}");
    let first_line = prefix.matches('\n').count();
    for (i, line) in case.iter().enumerate() {
        out.push_str(line);
        out.push('\n');
        for finding in &found {
            if line_of(&full, finding) == i + first_line {
                report(out, &full, finding);
            }
        }
    }
    case.clear();
}

fn line_of(text: &str, finding: &Diagnostic) -> usize {
    text[..finding.span.start as usize].matches('\n').count()
}

fn report(out: &mut String, text: &str, finding: &Diagnostic) {
    assert!(CODES.contains(&finding.code));
    assert!(!finding.message.ends_with('.') && !finding.message.is_empty());
    for note in &finding.notes {
        assert!(text.get(note.span.range()).is_some(), "{note:?}");
    }
    let before = &text[..finding.span.start as usize];
    let column = before.chars().rev().take_while(|&c| c != '\n').count();
    let carets = text[finding.span.range()].chars().count().max(1);
    let indent = " ".repeat(column + 3);
    let label =
        if finding.label.is_empty() { String::new() } else { format!(" {}", finding.label) };
    out.push_str(&format!("{indent}{}{label}\n", "^".repeat(carets)));
    out.push_str(&format!("     error[{}]: {}\n", finding.code, finding.message));
    for note in &finding.notes {
        out.push_str(&format!("     note: `{}`: {}\n", &text[note.span.range()], note.label));
    }
    for help in &finding.helps {
        out.push_str(&format!("     help: {help}\n"));
    }
}
