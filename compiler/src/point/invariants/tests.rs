//! One test of each rule, by its name, and what no rule may do.

use super::INVARIANTS;
use crate::point::NEAR;
use crate::point::sample::{Sample, evaluate};
use crate::point::truth::{norm, parts, truth};
use crate::specialise::Form;
use crate::test_support::{model, values};
use crate::verify::UNIT_ROUNDOFF;
use crate::verify::sample::Random;
use crate::{Level, Mode};

/// Largest errors of psi, P and dP in u of their norms where stretches are 1e-4, 1 and 1e4.
fn errors(energy: &str, d: usize, form: Form) -> [f64; 3] {
    let model = model(&format!("potential p\ndimensions {d}\npsi(F) = {energy}"));
    let values = values(&model, d, &[]);
    let compiled = model.compile(&values, Mode::Jit(Level::Strict), form).unwrap();
    let kernel = compiled.gradient.unwrap();
    let written = model.written_gradient(&values);
    let mut random = Random::new(7);
    let stretches = [[1e4, 1e-4, 1.0], [3e-4, 2e3, 1.0], [7e3, 3e-4, 2.0]];
    let samples: Vec<Sample> = stretches
        .iter()
        .map(|stretches| {
            let mut gradient = crate::point::sample::diagonal(&stretches[..d]);
            gradient[1] = 0.7 * stretches[0];
            Sample::of_gradient(gradient, &mut random)
        })
        .collect();
    assert!(samples.iter().all(|s| s.change.iter().any(|h| h.abs() > NEAR)));
    let mut worst = [0.0_f64; 3];
    for (sample, found) in samples.iter().zip(evaluate(&kernel, &samples)) {
        let truth = truth(&written, sample).unwrap();
        for (order, part) in parts(d * d).into_iter().enumerate() {
            let size = norm(truth[part.clone()].iter().copied());
            let error = norm(part.map(|k| found[k] - truth[k])) / size / UNIT_ROUNDOFF;
            worst[order] = worst[order].max(error);
        }
    }
    worst
}

fn rules(energy: &str, d: usize) -> Vec<&'static str> {
    let model = model(&format!("potential p\ndimensions {d}\npsi(F) = {energy}"));
    let forms = model.specialise_gradient(&values(&model, d, &[]), Form::Accurate).unwrap().0;
    forms.unwrap().recognised.iter().map(|rule| rule.name).collect()
}

/// All ways to write it are recognised and keep their digits; as it is written one of them does not.
fn keeps_its_digits(rule: &str, d: usize, written: &[&str]) {
    assert!(INVARIANTS.iter().any(|known| known.name == rule));
    for energy in written {
        assert!(rules(energy, d).contains(&rule), "{energy}: {:?}", rules(energy, d));
        let kept = errors(energy, d, Form::Accurate);
        assert!(kept.iter().all(|error| *error < 64.0), "{energy}: {kept:?}");
    }
    let loses = |energy: &&str| errors(energy, d, Form::Textbook).iter().any(|e| *e > 1e4);
    assert!(written.iter().any(loses), "{rule} mends nothing");
}

#[test]
fn every_rule_has_a_test() {
    let source = include_str!("tests.rs");
    for rule in INVARIANTS {
        assert!(source.contains(&format!("fn {}()", rule.name)), "no test of rule {}", rule.name);
    }
}

#[test]
fn second_invariant() {
    let written =
        ["(tr(C)^2 - C : C)/2", "3*((F : F)^2 - tr(C^2))", "(tr(F*F')^2 - (F*F') : (F*F'))/2"];
    keeps_its_digits("second_invariant", 3, &written);
}

#[test]
fn second_invariant_of_plane_strain() {
    let written = ["((tr(C) + 1)^2 - (C : C + 1))/2", "((tr(C) + 1)^2 - tr(C^2) - 1)/2"];
    for energy in written {
        assert!(rules(energy, 2).contains(&"second_invariant_of_plane_strain"), "{energy}");
        let kept = errors(energy, 2, Form::Accurate);
        assert!(kept.iter().all(|error| *error < 64.0), "{energy}: {kept:?}");
    }
}

#[test]
fn determinant_of_cauchy_green() {
    for d in [2, 3] {
        let written = ["det(C)", "det(F*F')", "det(C')", "det(2*E + I)", "1/det(C)"];
        keeps_its_digits("determinant_of_cauchy_green", d, &written);
    }
    keeps_its_digits("determinant_of_cauchy_green", 2, &["(tr(C)^2 - C : C)/2"]);
}

#[test]
fn cofactor_of_cauchy_green() {
    let written = ["inv(C) : dyad(1, 0, 0)"];
    keeps_its_digits("cofactor_of_cauchy_green", 3, &written);
}

#[test]
fn cofactor_by_inverse() {
    let by_direction = ["((J*inv(F)') : dyad(0, 1, 0))^2", "tr(det(C)*inv(C)*dyad(0, 1, 0))"];
    keeps_its_digits("cofactor_by_inverse", 3, &by_direction);
    let written = [
        "(J^2*inv(C)) : (det(C)*inv(C))",
        "(J*inv(F)') : (J*inv(F)')",
        "((-2)*J*inv(F)') : (J*inv(F)')",
        "(J^2*tr(inv(C)))^2",
    ];
    for d in [2, 3] {
        keeps_its_digits("cofactor_by_inverse", d, &written);
    }
}

/// With any factor and between any directions.
#[test]
fn cofactors_by_inverse_are_added_up() {
    let [n, m] = ["vector(0.6, 0.8, 0)", "vector(1, -2, 1)/sqrt(6)"];
    for energy in [
        "((0.7*J*inv(F)') : (J*inv(F)'))^2".to_string(),
        format!("(J^2*({n}*inv(C)*{n}))^2"),
        format!("(0.3*J^2*({n}*inv(C)*{m}) - 1)^2"),
        format!("(J*({m}*inv(F)*{n}))^2"),
        "(J^2*inv(F*F')) : dyad(0, 1, 0)".to_string(),
    ] {
        assert!(rules(&energy, 3).contains(&"cofactor_by_inverse"), "{energy}");
        let kept = errors(&energy, 3, Form::Accurate);
        assert!(kept.iter().all(|error| *error < 64.0), "{energy}: {kept:?}");
    }
}

/// Directions whose length is 1 but for rounding, given by an angle and divided by their length.
#[test]
fn cofactor_of_fibre() {
    let of_c = |n: &str| {
        [
            format!("{n}*C*C*{n} - tr(C)*({n}*C*{n}) + (tr(C)^2 - C : C)/2"),
            format!("(tr(C)*({n}*C*{n}) - {n}*C*C*{n} - 2)^2"),
            format!(
                "{n}*C*C*{n} - 0.5*tr(C)*({n}*C*{n}) + 0.25*(tr(C)^2 - C : C) - 0.5*(tr(C)*({n}*C*{n}) - {n}*C*C*{n})"
            ),
        ]
    };
    let directions =
        ["vector(0.6, 0.8, 0)", "vector(cos(0.5), 0, sin(0.5))", "vector(1, -2, 1)/sqrt(6)"];
    for written in directions.map(of_c) {
        keeps_its_digits("cofactor_of_fibre", 3, &written.each_ref().map(String::as_str));
    }
    let of_b = "(tr(b)*(b : dyad(1, 0, 0)) - (b*b) : dyad(1, 0, 0))^2".replace('b', "(F*F')");
    keeps_its_digits("cofactor_of_fibre", 3, &[&of_b]);
    let n = "vector(0.6, 0.8)";
    let written = format!("(tr(C)*({n}*C*{n}) - {n}*C*C*{n})^2");
    keeps_its_digits("cofactor_of_fibre", 2, &[&written]);
}

/// Sums that are no sums of squares cancel in one form as in the other.
#[test]
fn what_is_no_sum_of_squares_is_no_cofactor_of_fibre() {
    for energy in [
        "C(1,1)*C(2,2) - C(1,1)*C(3,3) - C(1,2)^2 + C(1,3)^2",
        "C(1,2)*C(3,3) - C(1,3)*C(2,3)",
        "vector(1, 0, 0)*C*C*vector(1, 0, 0) - 0.5*tr(C)*C(1,1)",
    ] {
        assert!(!rules(energy, 3).contains(&"cofactor_of_fibre"), "{energy}");
    }
}

#[test]
fn trace_of_inverse() {
    for d in [2, 3] {
        keeps_its_digits("trace_of_inverse", d, &["tr(inv(C))", "tr(inv(F*F'))", "I : inv(C)"]);
    }
}

/// Nothing is lost in either; it takes fewer operations.
#[test]
fn trace_of_square() {
    for d in [2, 3] {
        for energy in ["tr(C*C)", "tr(C^2)", "C : C", "tr(F*F'*F*F')"] {
            assert_eq!(rules(energy, d), ["trace_of_square"], "{energy}");
        }
        let operations = |form| {
            let model = model(&format!("potential p\ndimensions {d}\npsi(F) = tr(F*F'*F*F')"));
            let forms = model.specialise_gradient(&values(&model, d, &[]), form).unwrap().0;
            forms.unwrap().far.graph.operations()
        };
        assert!(operations(Form::Accurate) < operations(Form::Textbook));
    }
}

/// Turned and stretched alike in all directions: the deviator is what is left.
#[test]
fn square_of_deviator() {
    for d in [2, 3] {
        for energy in ["C : C - tr(C)^2/d", "E : E - tr(E)^2/d", "tr(C^2) - 1/d*(F : F)^2"] {
            assert!(rules(energy, d).contains(&"square_of_deviator"), "{energy}");
        }
    }
    let model = |energy| model(&format!("potential p\ndimensions 2\npsi(F) = {energy}"));
    let (a, b) = (1000.3, 0.7e-3);
    let gradient = vec![a, b, 0.0, a];
    let value = |energy, form| {
        let model = model(energy);
        let values = values(&model, 2, &[]);
        let kernel = model.compile(&values, Mode::Interpreter, form).unwrap().gradient.unwrap();
        let samples = [Sample::of_gradient(gradient.clone(), &mut Random::new(1))];
        evaluate(&kernel, &samples)[0][0]
    };
    // ((C11 - C22)^2 + 4 C12^2)/2 with C22 - C11 = b^2, C12 = a*b
    let truth = (b * b * b * b + 4.0 * a * a * b * b) / 2.0;
    let error = |form| (value("C : C - tr(C)^2/2", form) / truth - 1.0).abs();
    assert!(error(Form::Accurate) < 1e-14, "{}", error(Form::Accurate));
    assert!(error(Form::Textbook) > 1e-8, "{}", error(Form::Textbook));
}

/// What has no value where `J = 0`, or where anything else is 0, keeps none; but for `cofactor_by_inverse`.
#[test]
fn no_rule_widens_a_domain() {
    for energy in [
        "tr(C)^2*J/J - C : C",
        "det(C*J)/J^3 + det(C*tr(C))/tr(C)^3",
        "(tr(C)^3 - tr(C)*(C : C))/tr(C)",
        "inv(C) : C*J^2 - 3*J^2 + det(C*J)/J^3",
    ] {
        let model = model(&format!("potential p\ndimensions 3\npsi(F) = {energy}"));
        let values = values(&model, 3, &[]);
        let kernel = |form| {
            let mode = Mode::Interpreter;
            model.compile(&values, mode, form).unwrap().gradient.unwrap()
        };
        let mut random = Random::new(3);
        let samples = [vec![0.0; 9], [1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 3.0].to_vec()]
            .map(|f| Sample::of_gradient(f, &mut random));
        let [accurate, textbook] =
            [Form::Accurate, Form::Textbook].map(|form| evaluate(&kernel(form), &samples));
        for (x, y) in accurate.iter().zip(&textbook) {
            assert!(x[0].is_finite() <= y[0].is_finite(), "{energy}: {} {}", x[0], y[0]);
        }
    }
}

/// What is divided by another power of `J` is no cofactor.
#[test]
fn other_powers_are_no_cofactors() {
    for energy in ["(J*inv(C)) : dyad(1, 1, 0)", "(J^2*inv(F)) : F", "tr(J*inv(C))", "J^3/J"] {
        let found = rules(energy, 3);
        assert!(!found.contains(&"cofactor_by_inverse"), "{energy}: {found:?}");
    }
}

/// Sums that are nothing of that stay what they are.
#[test]
fn what_is_no_invariant_is_left_alone() {
    for energy in ["tr(C)^2 - 2*(C : C)", "F : F", "tr(C) + J^2", "det(E)", "C : C + 1e-9*J"] {
        let found = rules(energy, 3);
        assert!(found.iter().all(|rule| *rule == "trace_of_square"), "{energy}: {found:?}");
    }
}
