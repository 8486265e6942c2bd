//! Conditions of deformation gradients under which bonds break: margins as written, at rest and far from it, in
//! all ways to evaluate them; what they are printed as; what is refused.

#[path = "support/machine.rs"]
mod machine;

use std::path::Path;
use std::process::Command;

use piola_compiler::audit::{Settings, functions};
use piola_compiler::verify::{Subject, verify};
use piola_compiler::{
    Argument, Form, GradientBatch, GradientCriterion, Level, Mode, Model, Values, check, print,
};
use piola_grammar::parse;

fn model(conditions: &str) -> Model {
    let text = format!("potential p\nparameter h0 = 0.01\npsi(F) = E : E\n{conditions}\n");
    check(&parse(&text).unwrap()).unwrap()
}

fn criteria(model: &Model, values: &Values, mode: Mode) -> Vec<GradientCriterion> {
    model.gradient_criteria(values, mode, Form::Accurate).unwrap()
}

/// The margins at some `F - I`, row by row.
fn margins(criterion: &GradientCriterion, changes: &[Vec<f64>]) -> Vec<f64> {
    let (n, d) = (changes.len(), criterion.margin.dimension());
    let unit = |k: usize| f64::from(u8::from(k / d == k % d));
    let column = |of: &dyn Fn(usize, &Vec<f64>) -> f64| -> Vec<f64> {
        (0..d * d).flat_map(|k| changes.iter().map(move |h| of(k, h))).collect()
    };
    let (gradient, change) = (column(&|k, h| unit(k) + h[k]), column(&|k, h| h[k]));
    let at = GradientBatch { n, gradient: &gradient, change: &change, fields: &[] };
    let mut found = vec![f64::NAN; n];
    criterion.margin.evaluate(at, &mut found, &mut []);
    found
}

#[test]
fn margins_are_those_as_written_in_every_way() {
    let conditions = "break when J - 1 > h0\nbreak when not (J <= 1 + h0 or E : E <= h0^2)\n\
                      break when tr(ln(U)) >= h0 and J >= 1\nbreak when tr(C) - tr(I) > 2*h0";
    let model = model(conditions);
    assert!(model.can_break() && model.breaks().is_empty());
    let whether: Vec<bool> = model.family_breaks().iter().map(|one| one.holds_at_zero).collect();
    assert_eq!(whether, [false, false, true, false]);
    for d in [2, 3] {
        let values = model.values(d, &[], None).unwrap();
        let (found, _) = verify(&model, &values, 30).unwrap();
        let margins: Vec<_> = found
            .iter()
            .filter(|one| matches!(one.subject, Subject::Margin(Some(Argument::Gradient), _)))
            .collect();
        assert_eq!(margins.len(), 4);
        for one in margins {
            println!("{:?}: {} places, {:?}", one.subject, one.n_places, one.errors);
            assert!(one.passed() && one.n_places > 200, "{:?}", one.misses.first());
        }
    }
}

/// Thresholds are part of a margin at rest too, and near it nothing is lost.
#[test]
fn near_rest_margins_keep_their_digits() {
    let model = model("break when J - 1 > 1e-9\nbreak when E : E > 1e-18");
    for d in [2, 3] {
        let values = model.values(d, &[], None).unwrap();
        for mode in [Mode::Jit(Level::Strict), Mode::Jit(Level::Fast), Mode::Interpreter] {
            let all = criteria(&model, &values, mode);
            let on_diagonal = |size: f64| -> Vec<f64> {
                (0..d * d).map(|k| if k == 0 { size } else { 0.0 }).collect()
            };
            let changes = [0.0, 0.5e-9, 2e-9].map(on_diagonal);
            let found = margins(&all[0], &changes);
            for (found, expected) in found.iter().zip([-1e-9, -0.5e-9, 1e-9]) {
                assert!((found - expected).abs() <= 4e-25, "{found:e}");
            }
            let found = margins(&all[1], &changes);
            for (found, expected) in found.iter().zip([-1e-18, -0.75e-18, 3e-18]) {
                assert!((found - expected).abs() <= 1e-26, "{found:e}");
            }
            assert!(all[0].breaks(1e-300) && !all[0].breaks(0.0) && !all[0].breaks(f64::NAN));
        }
    }
}

/// An audit judges margins, and takes no derivatives of them.
#[test]
fn audits_judge_margins() {
    let model = model("break when J - 1 > h0\nbreak when tr(ln(U)) > h0");
    let values = model.values(3, &[], None).unwrap();
    let (form, level) = (Form::Accurate, Level::Strict);
    let settings = Settings { form, level, points: 4, bar: 64.0 };
    let found = functions(&model, &values, &settings).unwrap();
    let titles: Vec<String> = found.iter().map(|audit| audit.title()).collect();
    assert_eq!(titles, ["break when J - 1 > h0", "break when tr(ln(U)) > h0"]);
    for audit in &found {
        println!("{}: {:?}", audit.title(), audit.worst());
        assert!(audit.n_orders() == 1 && audit.regimes.len() > 20);
        assert!(audit.worst()[0] <= 64.0, "{:?}", audit.worst());
        assert_eq!(audit.worst()[1..], [0.0; 2]);
    }
}

#[test]
fn printed_conditions_are_those_compiled() {
    let model = model(
        "break when l/L > 2\npsi(l) = (l - L)^2\nbreak when J >= 1 + h0\nbreak when tr(ln(U)) > h0",
    );
    let conditions = model.gradient_functions(2, None).unwrap();
    let latex = print::latex_of_gradient_functions(&model, &conditions);
    assert!(latex.contains(r"g_{2} &= ") && latex.contains(r"g_{2} \ge 0"), "{latex}");
    assert!(latex.contains(r"g_{3} > 0"), "{latex}");
    if !machine::has_c_compiler() {
        return;
    }
    let values = model.values(2, &[], Some(1.0)).unwrap();
    let conditions = model.gradient_functions(2, Some(&values)).unwrap();
    let source =
        print::c_source(&model, &[], None) + &print::c_of_gradient_functions(&model, &conditions);
    let changes: Vec<Vec<f64>> = vec![
        vec![0.0; 4],
        vec![0.01, 1e-3, -2e-3, 1e-9],
        vec![-0.5, 0.25, 0.125, 0.5],
        vec![1.5, -0.75, 0.5, 2.0],
    ];
    let column = |unit: f64| -> String {
        let entry = |k: usize, h: &Vec<f64>| h[k] + if k.is_multiple_of(3) { unit } else { 0.0 };
        let all = (0..4).flat_map(|k| changes.iter().map(move |h| format!("{:e}", entry(k, h))));
        all.collect::<Vec<_>>().join(", ")
    };
    let main = format!(
        "#include <stdio.h>\n{source}\nint main(void) {{\n\
         double f[] = {{{}}}, h[] = {{{}}}, m[4];\n\
         p_F_margin_2(4, f, h, m);\nfor (int i = 0; i < 4; i++) printf(\"%.17g\\n\", m[i]);\n\
         p_F_margin_3(4, f, h, m);\nfor (int i = 0; i < 4; i++) printf(\"%.17g\\n\", m[i]);\n\
         return 0;\n}}\n",
        column(1.0),
        column(0.0),
    );
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("piola_c_of_gradients");
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("main.c");
    std::fs::write(&path, main).unwrap();
    let program = folder.join("main");
    let made = Command::new("cc")
        .args(["-std=c99", "-O1", "-ffp-contract=off", "-o"])
        .args([&program, &path])
        .arg("-lm")
        .status();
    assert!(made.unwrap().success());
    let printed = String::from_utf8(Command::new(&program).output().unwrap().stdout).unwrap();
    let printed: Vec<f64> = printed.lines().map(|line| line.parse().unwrap()).collect();
    let all = criteria(&model, &values, Mode::Jit(Level::Strict));
    let expected: Vec<f64> = all.iter().flat_map(|one| margins(one, &changes)).collect();
    assert_eq!(printed.len(), expected.len());
    for (found, expected) in printed.iter().zip(&expected) {
        // Logarithms of the C library are not ours.
        assert!((found - expected).abs() <= 4e-16 * expected.abs().max(1.0), "{found} {expected}");
    }
}

#[test]
fn what_is_no_condition_of_a_gradient_is_refused() {
    for (text, code) in [
        ("psi(F) = J\nbreak when J > 1 and l/L > 2", "wrong-measure"),
        ("psi(F) = J\nbreak when J == 2", "no-threshold"),
        ("psi(l) = l\nbreak when J > 2", "unknown-name"),
        (
            "state k = 0\nupdate k = max(k, l/L)\npsi(l) = k*l\npsi(F) = J\nbreak when J > k",
            "wrong-measure",
        ),
        ("psi(F) = J\nbreak when C > 2", "wrong-shape"),
    ] {
        let checked = check(&parse(&format!("potential p\n{text}")).unwrap());
        let found: Vec<&str> = checked.unwrap_err().iter().map(|error| error.code).collect();
        assert_eq!(found, [code], "{text}");
    }
}
