//! What parses prints, and what was printed parses to the same tree; what does not parse has
//! findings inside the text.
//!
//! The first byte chooses: the rest is taken as text, as an expression, as a unit, or as the choices
//! of the program generator (whose programs must all parse).

#![no_main]

use libfuzzer_sys::fuzz_target;
use piola_grammar::generate::potential_text;
use piola_grammar::{
    Diagnostic, parse, parse_expression, parse_unit, print, print_expression, print_unit,
    same_expression, same_tree,
};

fuzz_target!(|bytes: &[u8]| {
    let Some((&choice, rest)) = bytes.split_first() else { return };
    let text = String::from_utf8_lossy(rest);
    match choice % 4 {
        0 => file(&text, false),
        1 => expression(&text),
        2 => unit(&text),
        _ => file(&potential_text(rest), true),
    }
});

fn file(text: &str, must_parse: bool) {
    match parse(text) {
        Ok(ast) => {
            let printed = print(&ast);
            // Canonical text may be longer than the original and so too long to read.
            if printed.len() <= piola_grammar::MAX_BYTES {
                assert!(same_tree(&ast, &parse(&printed).unwrap()), "{printed}");
            }
        }
        Err(found) => {
            assert!(!must_parse, "{found:#?}\n{text}");
            findings(text, &found);
        }
    }
}

fn expression(text: &str) {
    match parse_expression(text) {
        Ok(ast) => {
            let printed = print_expression(&ast.arena, ast.root);
            if printed.len() <= piola_grammar::MAX_BYTES {
                assert!(same_expression(&ast, &parse_expression(&printed).unwrap()), "{printed}");
            }
        }
        Err(found) => findings(text, &found),
    }
}

fn unit(text: &str) {
    match parse_unit(text) {
        Ok((unit, arena)) => {
            let printed = print_unit(&arena, &unit);
            let (again, arena) = parse_unit(&printed).unwrap();
            assert_eq!(print_unit(&arena, &again), printed);
        }
        Err(found) => findings(text, &found),
    }
}

/// Findings can be shown: they lie inside the text, between characters.
fn findings(text: &str, found: &[Diagnostic]) {
    assert!(!found.is_empty());
    for finding in found {
        assert!(text.get(finding.span.range()).is_some(), "{finding:?}");
        for note in &finding.notes {
            assert!(text.get(note.span.range()).is_some(), "{finding:?}");
        }
    }
}
