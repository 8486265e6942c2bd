//! What holds for every text: a tree that prints and parses to itself, or findings inside the text.
//!
//! Used by the property tests, on the committed corpus, and by the fuzz target `parse_print_parse`.

use piola_grammar::generate::potential_text;
use piola_grammar::{
    CODES, Diagnostic, MAX_BYTES, parse, parse_expression, parse_unit, print, print_expression,
    print_unit, same_expression, same_tree,
};

/// What a fuzzer's bytes are: the first one chooses, the rest is taken as a file, as an expression, as
/// a unit, or as the choices of the program generator, whose programs must all parse.
pub(crate) fn input(bytes: &[u8]) {
    let Some((&choice, rest)) = bytes.split_first() else { return };
    let text = String::from_utf8_lossy(rest);
    match choice % 4 {
        0 => drop(file(&text)),
        1 => expression(&text),
        2 => unit(&text),
        _ => {
            let text = potential_text(rest);
            assert!(file(&text), "{text}");
        }
    }
}

/// Whether a file parses. Canonical text may be longer than the original and so too long to read.
pub(crate) fn file(text: &str) -> bool {
    match parse(text) {
        Ok(ast) => {
            let printed = print(&ast);
            if printed.len() <= MAX_BYTES {
                let again = parse(&printed).unwrap_or_else(|e| panic!("{e:#?} in\n{printed}"));
                assert!(same_tree(&ast, &again), "{text}\n{printed}");
                assert_eq!(print(&again), printed);
            }
            true
        }
        Err(found) => {
            findings(text, &found);
            false
        }
    }
}

/// An expression.
pub(crate) fn expression(text: &str) {
    match parse_expression(text) {
        Ok(ast) => {
            let printed = print_expression(&ast.arena, ast.root);
            if printed.len() <= MAX_BYTES {
                let again = parse_expression(&printed).unwrap();
                assert!(same_expression(&ast, &again), "{text}\n{printed}");
            }
        }
        Err(found) => findings(text, &found),
    }
}

/// A unit.
pub(crate) fn unit(text: &str) {
    match parse_unit(text) {
        Ok((unit, arena)) => {
            let printed = print_unit(&arena, &unit);
            let (again, arena) = parse_unit(&printed).unwrap();
            assert_eq!(print_unit(&arena, &again), printed, "{text}");
        }
        Err(found) => findings(text, &found),
    }
}

/// Findings can be shown: they lie inside the text, between characters, and stand in its order.
fn findings(text: &str, found: &[Diagnostic]) {
    assert!(!found.is_empty());
    for finding in found {
        assert!(CODES.contains(&finding.code), "{finding:?}");
        assert!(text.get(finding.span.range()).is_some(), "{finding:?} in {text:?}");
        for note in &finding.notes {
            assert!(text.get(note.span.range()).is_some(), "{finding:?} in {text:?}");
        }
    }
    assert!(found.is_sorted_by_key(|finding| finding.span) || text.len() > MAX_BYTES);
}
