//! Wrong energies of tensors, and what is said to them: of deformation gradients in `tensor_mistakes.txt` beside this
//! file, of what points gather in `gathered_mistakes.txt`.
//!
//! A case is a line with `> ` in front, below a head that declares what it needs; its findings stand below it.
//! `PIOLA_BLESS=1 cargo test -p piola-compiler --test tensor_mistakes` writes what is said now.

use std::fmt::Write as _;
use std::path::Path;

use piola_compiler::check_text;

/// Of gradients: `mu` and the vector `n` in three dimensions.
const GRADIENTS: &str = "potential p\ndimensions 3\nparameter mu = 1\nn = vector(1, 0, 0)\n";

/// Of gathered tensors: a shape tensor and a gradient less 1.
const GATHERED: &str = "potential p\ndimensions 3\nparameter mu = 1\nn = vector(1, 0, 0)\nw(L) = 1/L\n\
     K = integral(w*dyad(Xi, Xi))\nH = integral(w*dyad(xi - Xi, Xi))*inv(K)\n";

#[test]
fn wrong_energies_of_gradients_are_answered_as_recorded() {
    answered_as_recorded("tensor_mistakes.txt", GRADIENTS, 100);
}

#[test]
fn wrong_energies_of_gathered_tensors_are_answered_as_recorded() {
    answered_as_recorded("gathered_mistakes.txt", GATHERED, 40);
}

fn answered_as_recorded(file: &str, head: &str, at_least: usize) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(file);
    let recorded = std::fs::read_to_string(&path).unwrap();
    let mut now = String::new();
    let cases: Vec<&str> = recorded.lines().filter_map(|line| line.strip_prefix("> ")).collect();
    assert!(cases.len() >= at_least, "{} cases", cases.len());
    for case in cases {
        let lines = case.replace("; ", "\n");
        let text = format!("{head}{lines}\n");
        let Err(found) = check_text(&text) else { panic!("nothing is said to {case}") };
        let _ = writeln!(now, "> {case}");
        // One mistake hides no other, and stands in the line that has it.
        for finding in found {
            let place = text.get(finding.span.range()).unwrap_or("");
            assert!(finding.span.start as usize >= head.len(), "{case}: at `{place}` of the head");
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
        std::fs::write(path, &now).unwrap();
        return;
    }
    assert!(now == recorded, "findings changed; expected:\n{recorded}\nfound:\n{now}");
}
