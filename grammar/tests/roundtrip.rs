//! parse -> print -> parse, over generated programs and arbitrary text.

#[path = "support/reads.rs"]
mod reads;

use std::path::Path;

use piola_grammar::generate::{condition_text, number_text, potential_text};
use piola_grammar::{
    Ast, ExpressionAst, parse, parse_expression, print, print_expression, same_expression,
    same_tree,
};
use proptest::prelude::*;

fn reparsed(ast: &Ast) -> Ast {
    let text = print(ast);
    parse(&text).unwrap_or_else(|found| panic!("{found:#?} in\n{text}"))
}

/// Every pair of parentheses in `text` that can be left out without changing the tree.
fn superfluous(text: &str, ast: &ExpressionAst) -> Option<String> {
    let mut open = Vec::new();
    for (at, c) in text.char_indices() {
        match c {
            '(' => open.push(at),
            ')' => {
                let start = open.pop()?;
                let is_call = text[..start].ends_with(|c: char| c.is_alphanumeric() || c == '_');
                // Kept for the reader, see the module `print`.
                if is_call || text[start + 1..].starts_with("if ") {
                    continue;
                }
                let shorter =
                    [&text[..start], " ", &text[start + 1..at], " ", &text[at + 1..]].concat();
                if parse_expression(&shorter).is_ok_and(|other| same_expression(ast, &other)) {
                    return Some(shorter);
                }
            }
            _ => {}
        }
    }
    None
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn generated_programs_print_and_parse_to_the_same_tree(
        bytes in prop::collection::vec(any::<u8>(), 0..400),
    ) {
        let text = potential_text(&bytes);
        let ast = parse(&text).unwrap_or_else(|found| panic!("{found:#?} in\n{text}"));
        let again = reparsed(&ast);
        prop_assert!(same_tree(&ast, &again), "{}\n{}", text, print(&ast));
        prop_assert_eq!(print(&ast), print(&again));
    }

    #[test]
    fn no_printed_parentheses_can_be_left_out(
        bytes in prop::collection::vec(any::<u8>(), 0..120),
        conditional in any::<bool>(),
    ) {
        let names = ["X", "Y", "t"];
        let text = if conditional { condition_text(&bytes, &names) } else { number_text(&bytes, &names) };
        let ast = parse_expression(&text).unwrap_or_else(|found| panic!("{found:#?} in\n{text}"));
        let printed = print_expression(&ast.arena, ast.root);
        prop_assert!(same_expression(&ast, &parse_expression(&printed).unwrap()));
        prop_assert_eq!(superfluous(&printed, &ast), None);
    }

    #[test]
    fn arbitrary_text_never_panics(text in "\\PC{0,200}") {
        check_any(&text);
    }

    #[test]
    fn pieces_of_the_language_in_any_order_never_panic(
        pieces in prop::collection::vec(prop::sample::select(PIECES), 0..40),
    ) {
        check_any(&pieces.concat());
        check_any(&format!("potential p\n{}", pieces.join(" ")));
    }

    #[test]
    fn a_valid_program_with_one_character_changed_never_panics(
        bytes in prop::collection::vec(any::<u8>(), 0..200),
        place in any::<prop::sample::Index>(),
        other in any::<char>(),
    ) {
        let mut chars: Vec<char> = potential_text(&bytes).chars().collect();
        let place = place.index(chars.len());
        chars[place] = other;
        check_any(&chars.into_iter().collect::<String>());
    }
}

const PIECES: &[&str] = &[
    "potential",
    "parameter",
    "source",
    "allow",
    "dimensions",
    "domain",
    "psi",
    "(",
    ")",
    "[",
    "]",
    "l",
    "=",
    "==",
    "<",
    "<=",
    "!",
    "in",
    "Pa",
    "m^2",
    ",",
    "\"",
    "\"t\"",
    "#",
    "\n",
    "\r",
    "if",
    "then",
    "else",
    "and",
    "or",
    "not",
    "-",
    "+",
    "*",
    "/",
    "^",
    "1",
    ".5",
    "1e",
    "1.",
    "inf",
    "x",
    "λ",
    "|",
    "“",
    ";",
    "\u{feff}",
    "\u{a0}",
    "²",
    "\t",
    " ",
    "psi(l) = ",
    "k = ",
    "2",
    "3",
    "'",
    "&&",
    "?",
];

/// What holds for every text, whatever it is read as.
fn check_any(text: &str) {
    reads::file(text);
    reads::expression(text);
    reads::unit(text);
}

/// The inputs that a fuzzer found worth keeping.
#[test]
fn the_corpus_of_the_fuzz_target_holds() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus/parse_print_parse");
    let mut n_inputs = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        println!("{}", path.display());
        reads::input(&std::fs::read(&path).unwrap());
        n_inputs += 1;
    }
    assert!(n_inputs >= 80, "{n_inputs}");
}
