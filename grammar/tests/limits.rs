//! Large and deep texts: bounded in stack, time and findings.

use piola_grammar::{
    MAX_BYTES, MAX_NESTING, parse, parse_expression, print, print_expression, same_expression,
    same_tree,
};

/// Runs a test on a stack of 1 MiB, half of what Rust gives a thread and an eighth of a main thread.
fn on_a_small_stack(test: impl FnOnce() + Send + 'static) {
    let thread = std::thread::Builder::new().stack_size(1 << 20).spawn(test).unwrap();
    thread.join().unwrap();
}

/// The ways to nest, as what opens, what stands innermost and what closes.
const NESTS: [(&str, &str, &str); 9] = [
    ("(", "1", ")"),
    ("f(", "1", ")"),
    ("f(1, ", "1", ")"),
    ("-", "1", ""),
    ("2^", "1", ""),
    ("not ", "c", ""),
    ("if c then 1 else ", "1", ""),
    ("if c then ", "1", " else 2"),
    ("if ", "c", " then c else c"),
];

#[test]
fn the_deepest_nesting_parses_and_prints() {
    on_a_small_stack(|| {
        for (open, inner, close) in NESTS {
            let text = format!("{}{inner}{}", open.repeat(MAX_NESTING), close.repeat(MAX_NESTING));
            let ast = parse_expression(&text).unwrap_or_else(|found| panic!("{open}: {found:?}"));
            let printed = print_expression(&ast.arena, ast.root);
            assert!(same_expression(&ast, &parse_expression(&printed).unwrap()), "{open}");
        }
        let mixed = "(if -2^f(".repeat(MAX_NESTING / 5);
        let close = ") then 1 else 2)".repeat(MAX_NESTING / 5);
        parse_expression(&format!("{mixed}x{close}")).unwrap();
    });
}

#[test]
fn what_nests_deeper_is_refused_at_its_place() {
    on_a_small_stack(|| {
        for (open, inner, close) in NESTS {
            for count in [MAX_NESTING + 1, 50_000] {
                let text = format!("{}{inner}{}", open.repeat(count), close.repeat(count));
                if text.len() > MAX_BYTES {
                    continue;
                }
                let found = parse_expression(&text).unwrap_err();
                assert_eq!(found.len(), 1, "{open}");
                assert_eq!(found[0].code, "nesting-too-deep", "{open}");
                let level = text[..found[0].span.start as usize].matches(open).count();
                assert_eq!(level, MAX_NESTING, "{open}");
            }
        }
        for open in ["(", "-", "["] {
            let found = parse(&format!("potential p\nk = {}", open.repeat(100_000))).unwrap_err();
            assert_eq!(found.len(), 1);
            assert_eq!(found[0].code, "nesting-too-deep");
        }
    });
}

#[test]
fn long_chains_do_not_recurse() {
    on_a_small_stack(|| {
        for (operator, terms) in [("+", 400_000), ("*", 400_000), ("-", 400_000), (" or ", 150_000)]
        {
            let text = vec!["1"; terms].join(operator);
            let ast = parse_expression(&text).unwrap();
            assert_eq!(ast.arena.len(), 2 * terms - 1);
            let again = print_expression(&ast.arena, ast.root);
            if again.len() <= MAX_BYTES {
                assert!(same_expression(&ast, &parse_expression(&again).unwrap()));
            }
        }
        let arguments = vec!["1"; 300_000].join(",");
        parse_expression(&format!("f({arguments})")).unwrap();
    });
}

#[test]
fn many_statements_and_many_mistakes_take_linear_time() {
    let lines = 20_000;
    let good = format!("potential p\n{}", "k = 1 # one\r\n".repeat(lines));
    let ast = parse(&good).unwrap();
    assert_eq!(ast.statements.len(), lines);
    assert!(same_tree(&ast, &parse(&print(&ast)).unwrap()));

    let bad = format!("potential p\n{}", "@\n".repeat(400_000));
    assert_eq!(parse(&bad).unwrap_err().len(), 100, "the rest is not reported");
    for long in ["x ", "(\n", "(k\n", "1 <", "\"", "f(", "if ", "k = \n", "|", "“", "])"] {
        let text = format!("potential p\nk = {}", long.repeat(1_000_000 / long.len()));
        assert!(parse(&text).is_err(), "{long}");
    }
    let text = format!("potential p\nk = ({}{}", "if ".repeat(150_000), "\n".repeat(500_000));
    assert_eq!(parse(&text).unwrap_err().len(), 1);
}

#[test]
fn a_text_of_the_largest_size_is_read_and_a_larger_one_is_not() {
    let head = "potential p\n";
    let full = format!("{head}{}", "#".repeat(MAX_BYTES - head.len()));
    assert!(parse(&full).is_ok());
    for found in
        [parse(&format!("{full}#")).unwrap_err(), parse_expression(&full.repeat(2)).unwrap_err()]
    {
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].code, "file-too-large");
    }
}
