//! Wrong energies of deformation gradients, and what is said to them: `tensor_mistakes.txt` beside this file.
//!
//! A case is a line with `> ` in front, below a head that declares `mu` and the vector `n` in three dimensions;
//! its findings stand below it. `PIOLA_BLESS=1 cargo test -p piola-compiler --test tensor_mistakes` writes what is
//! said now.

use std::fmt::Write as _;

use piola_compiler::check_text;

const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/tensor_mistakes.txt");

const HEAD: &str = "potential p\ndimensions 3\nparameter mu = 1\nn = vector(1, 0, 0)\n";

/// How many wrong programs there are at least.
const AT_LEAST: usize = 100;

#[test]
fn wrong_energies_of_gradients_are_answered_as_recorded() {
    let recorded = std::fs::read_to_string(PATH).unwrap();
    let mut now = String::new();
    let cases: Vec<&str> = recorded.lines().filter_map(|line| line.strip_prefix("> ")).collect();
    assert!(cases.len() >= AT_LEAST, "{} cases", cases.len());
    for case in cases {
        let text = format!("{HEAD}{case}\n");
        let found = check_text(&text).expect_err(case);
        let _ = writeln!(now, "> {case}");
        // One mistake hides no other, and stands in the line that has it.
        for finding in found {
            let place = text.get(finding.span.range()).unwrap_or("");
            assert!(finding.span.start as usize >= HEAD.len(), "{case}: at `{place}` of the head");
            let label = if finding.label.is_empty() {
                String::new()
            } else {
                format!(", {}", finding.label)
            };
            let _ = writeln!(now, "  [{}] {}: `{place}`{label}", finding.code, finding.message);
            for help in &finding.helps {
                let _ = writeln!(now, "    {help}");
            }
        }
    }
    if std::env::var_os("PIOLA_BLESS").is_some() {
        std::fs::write(PATH, &now).unwrap();
        return;
    }
    assert!(now == recorded, "findings changed; expected:\n{recorded}\nfound:\n{now}");
}
