//! The programs in LANGUAGE.md mean something: the right ones pass `check` and `verify` in every
//! dimension without lints, the wrong ones are refused with the code they state, and those with a
//! lint have it.

#[path = "support/property.rs"]
#[allow(dead_code)] // the rest is for the other tests
mod property;

use std::collections::BTreeSet;

use piola_compiler::verify::verify;
use piola_compiler::{CODES, LINTS, check_text};
use property::some_values;

const LANGUAGE: &str = include_str!("../../grammar/LANGUAGE.md");

/// The fenced blocks: line, what stands behind the fence, text.
fn blocks() -> Vec<(usize, &'static str, String)> {
    let mut found = Vec::new();
    let mut lines = LANGUAGE.lines().enumerate();
    while let Some((i, line)) = lines.next() {
        let Some(info) = line.strip_prefix("```") else { continue };
        let block: Vec<&str> =
            lines.by_ref().map(|(_, line)| line).take_while(|line| *line != "```").collect();
        found.push((i + 1, info, block.join("\n") + "\n"));
    }
    found
}

#[test]
fn right_programs_are_compiled_and_verified() {
    let mut n_programs = 0;
    for (line, _, text) in blocks().into_iter().filter(|(_, info, _)| *info == "piola") {
        let (_, model) = check_text(&text).unwrap_or_else(|e| panic!("LANGUAGE.md:{line}: {e:#?}"));
        assert_eq!(model.lint(false), [], "LANGUAGE.md:{line}");
        for dimension in model.dimensions().collect::<Vec<_>>() {
            let values = some_values(&model, dimension).unwrap();
            for energy in verify(&model, &values, 200).unwrap().0 {
                assert!(energy.passed(), "LANGUAGE.md:{line}: {energy:#?}");
            }
        }
        n_programs += 1;
    }
    assert!(n_programs >= 6, "{n_programs}");
}

#[test]
fn wrong_programs_are_refused_as_they_say() {
    let mut shown = BTreeSet::new();
    for (line, info, text) in blocks() {
        let Some(code) = info.strip_prefix("piola-error code=") else { continue };
        let found = check_text(&text).expect_err("a wrong program");
        let codes: BTreeSet<&str> = found.iter().map(|finding| finding.code).collect();
        assert_eq!(codes.into_iter().collect::<Vec<_>>(), [code], "LANGUAGE.md:{line}");
        shown.insert(code);
    }
    assert!(shown.len() >= 10, "{shown:?}");
}

#[test]
fn doubtful_programs_have_the_lint_they_state() {
    let mut n_programs = 0;
    for (line, info, text) in blocks() {
        let Some(code) = info.strip_prefix("piola-lint code=") else { continue };
        let (_, model) = check_text(&text).unwrap_or_else(|e| panic!("LANGUAGE.md:{line}: {e:#?}"));
        let codes: Vec<&str> = model.lint(false).iter().map(|warning| warning.code).collect();
        assert_eq!(codes, [code], "LANGUAGE.md:{line}");
        n_programs += 1;
    }
    assert!(n_programs >= 2, "{n_programs}");
}

#[test]
fn every_code_is_explained() {
    for code in CODES.into_iter().chain(LINTS.map(|lint| lint.code)) {
        assert!(LANGUAGE.contains(&format!("| `{code}` |")), "LANGUAGE.md misses `{code}`");
    }
}
