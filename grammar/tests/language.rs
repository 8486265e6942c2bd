//! The programs in LANGUAGE.md are read: the right ones parse, the wrong ones fail as they say.

use piola_grammar::names::{BINARY_FUNCTIONS, KEYWORDS, UNARY_FUNCTIONS};
use piola_grammar::{CODES, MAX_NESTING, parse, print, same_tree};

const LANGUAGE: &str = include_str!("../LANGUAGE.md");

/// The fenced blocks: what stands behind the fence, the line it stands on, the text.
fn blocks() -> Vec<(&'static str, usize, String)> {
    let mut blocks = Vec::new();
    let mut open: Option<(&str, usize, String)> = None;
    for (i, line) in LANGUAGE.lines().enumerate() {
        match (line.strip_prefix("```"), &mut open) {
            (Some(info), None) => open = Some((info, i + 1, String::new())),
            (Some(_), Some(_)) => blocks.extend(open.take()),
            (None, Some((_, _, text))) => {
                text.push_str(line);
                text.push('\n');
            }
            (None, None) => {}
        }
    }
    assert!(open.is_none(), "an open fence at the end of LANGUAGE.md");
    blocks
}

#[test]
fn right_programs_parse_and_wrong_ones_fail_as_stated() {
    let (mut right, mut wrong) = (0, 0);
    for (info, line, text) in blocks() {
        let parsed = parse(&text);
        // What a lint warns of is right to the reader.
        if info == "piola" || info.starts_with("piola-lint code=") {
            let ast = parsed.unwrap_or_else(|found| panic!("LANGUAGE.md:{line}: {found:#?}"));
            assert!(same_tree(&ast, &parse(&print(&ast)).unwrap()), "LANGUAGE.md:{line}");
            right += 1;
            continue;
        }
        let code = info.strip_prefix("piola-error code=");
        let code = code.unwrap_or_else(|| panic!("LANGUAGE.md:{line}: fence `{info}`"));
        // Other codes are found by later stages; the text must parse for them to look at it.
        match parsed {
            Err(found) => {
                let codes: Vec<&str> = found.iter().map(|finding| finding.code).collect();
                assert_eq!(codes, [code], "LANGUAGE.md:{line}");
            }
            Ok(_) => assert!(!CODES.contains(&code), "LANGUAGE.md:{line}: parses"),
        }
        wrong += 1;
    }
    assert!(right >= 6 && wrong >= 6, "{right} right and {wrong} wrong programs");
}

#[test]
fn the_reference_names_everything_the_grammar_knows() {
    for word in KEYWORDS {
        assert!(LANGUAGE.contains(word), "{word}");
    }
    for function in UNARY_FUNCTIONS {
        assert!(LANGUAGE.contains(&format!("`{function}(x)`")), "{function}");
    }
    for function in BINARY_FUNCTIONS {
        let given = if function == "atan2" { "y, x" } else { "x, y, .." };
        assert!(LANGUAGE.contains(&format!("`{function}({given})`")), "{function}");
    }
    for code in CODES {
        assert!(LANGUAGE.contains(&format!("`{code}`")), "{code}");
    }
    assert!(LANGUAGE.contains(&format!("| {MAX_NESTING} |")));
}
