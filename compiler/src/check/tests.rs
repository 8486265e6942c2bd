//! What the checker accepts, and what it says of the rest.

use crate::test_support::{SETH_HILL, codes, model};
use crate::{Measure, OfFamily, Setting, check_text};
use piola_grammar::Diagnostic;

fn errors(text: &str) -> Vec<Diagnostic> {
    super::check(&piola_grammar::parse(text).unwrap()).expect_err("an error was expected")
}

#[test]
fn the_first_file_of_the_design_is_checked_in_both_dimensions() {
    let model = model(SETH_HILL);
    assert_eq!(model.dimensions().collect::<Vec<_>>(), [2, 3]);
    assert_eq!(model.measures(), Measure::ALL);
    assert_eq!(model.variant(2).unwrap().units[1].dimension.unit(), "J/m^8");
    assert_eq!(model.variant(3).unwrap().units[2].dimension.unit(), "J/m^15");
    assert_eq!(model.variant(2).unwrap().defaults, [None, Some(0.0), Some(0.0), Some(1.0)]);
}

#[test]
fn dimensions_are_named_in_words_and_units() {
    let found = errors("potential p\nparameter C in J/m^5\ndimensions 2\npsi(a) = C*(a - L)");
    assert_eq!(found[0].code, "dimension-mismatch");
    assert_eq!(found[0].message, "cannot subtract a length (m) from an area (m^2)");
    assert!(found[0].helps[0].contains("`a/A`"), "{:?}", found[0].helps);
}

#[test]
fn an_energy_in_the_wrong_unit_says_what_is_missing() {
    let found = errors("potential p\nparameter C in J/m^5\ndimensions 2\npsi(l) = C*(l/L - 1)^2");
    assert!(found[0].message.contains("J/m^4"), "{}", found[0].message);
    assert_eq!(found[0].helps[0], "a factor in m is missing, such as `L`");
    // Right in the plane, and in space a factor 1/m^2 too much.
    let found = errors("potential p\nparameter C in J/m^5\npsi(l) = C*L*(l/L - 1)^2");
    assert!(found[0].message.contains("d = 3"), "{}", found[0].message);
    assert!(found[0].helps[0].contains("write `dimensions 2`, or"), "{:?}", found[0].helps);
}

#[test]
fn what_a_newcomer_writes_is_answered() {
    let exponent = "potential p\nparameter D in J/m^(2*d)\nparameter b\n\
        psi(l) = D*(1 - exp(-b*(l - L)))^2";
    let found = errors(exponent);
    assert_eq!(
        found[0].helps,
        ["`l` is the measure of a bond, in m; `l/L` is a pure number"],
        "{found:#?}"
    );
    // `a` was meant as a parameter, and is the measure of a triangle.
    let found =
        errors(&exponent.replace("parameter b\n", "").replace("-b*(l - L)", "-a*(l/L - 1)"));
    assert!(found[0].helps[0].contains("`a` is the measure of a triangle, in m^2"), "{found:#?}");
    let found = errors("potential p\nparameter k in Nm\npsi(l) = k*l/L");
    assert_eq!(found[0].helps, ["a product is written with `*`: `N*m`"]);
}

#[test]
fn functions_are_checked_at_their_calls() {
    let found = errors(
        "potential p\nparameter C in J/m^5\ndimensions 2\nS(x) = ln(x)\npsi(l) = C*L*S(l)^2",
    );
    assert_eq!(found[0].code, "dimension-mismatch");
    assert_eq!(found[0].message, "`ln` needs a pure number, not a length (m)");
    assert!(found[0].notes[0].label.contains("call of `S`, with `x` a length (m)"));
}

#[test]
fn d_folds_before_dimensions_are_checked() {
    let text = "potential p\nparameter C in J/m^(2*d)\n\
        psi(l) = C*(if d == 3 then l*(1/L) else (l/L)^2)\n";
    assert_eq!(codes(text), Vec::<&str>::new());
    assert_eq!(codes(&text.replace("l*(1/L)", "l")), ["dimension-mismatch"]);
    // The branch for three dimensions is never looked at in two.
    let two = text.replace("l*(1/L)", "l").replace("potential p", "potential p\ndimensions 2");
    assert_eq!(codes(&two), Vec::<&str>::new());
}

#[test]
fn a_file_without_units_is_unchecked() {
    assert_eq!(codes("potential p\npsi(l) = l + L^2"), Vec::<&str>::new());
}

#[test]
fn tensors_have_shapes() {
    for text in [
        "psi(F) = F",
        "psi(F) = tr(F + 1)",
        "psi(F) = tr(1 - F)",
        "psi(F) = tr(2)",
        "psi(F) = det(J)",
        "psi(F) = tr(F/F)",
        "psi(F) = tr(2/F)",
        "psi(F) = ln(F)",
        "psi(F) = tr(F^0.5)",
        "psi(F) = tr(2^F)",
        "psi(F) = J'",
        "psi(F) = F : 2",
        "psi(F) = F*F",
        "psi(F) = max(F, F)",
        "psi(F) = if F < 2 then 1 else 2",
    ] {
        assert_eq!(codes(&format!("potential p\n{text}")), ["wrong-shape"], "{text}");
    }
    for (text, code) in [
        ("psi(F) = if J > 1 then C else 2", "type-mismatch"),
        ("psi(F) = if F then 1 else 2", "type-mismatch"),
        ("psi(F) = J*l", "wrong-measure"),
        ("psi(F) = J\npsi(l) = l*tr(C)", "wrong-measure"),
        ("psi(l) = l*tr(l)", "unknown-name"),
        ("psi(l) = l*J", "unknown-name"),
        ("F = 2\npsi(l) = l", "reserved-name"),
        ("parameter mu in Pa\npsi(F) = mu*ln(J)*J + 2*J", "dimension-mismatch"),
        ("parameter mu in Pa\npsi(F) = mu^2*J", "dimension-mismatch"),
        ("parameter mu in Pa\npsi(F) = tr(mu*C + C)", "dimension-mismatch"),
    ] {
        assert_eq!(codes(&format!("potential p\n{text}")), [code], "{text}");
    }
    // A file's own names win, and the tensor's names are free where there is no energy of F.
    for text in [
        "parameter C = 2\nI = 3\ntr(x) = x*x\npsi(F) = C*tr(I) + det(F'*F)",
        "parameter mu in Pa\nE = (F'*F - I)/2\npsi(F) = mu*(E : E)/det(inv(dev(sym(E)) + I))",
        "E = 2\ntr(x) = E*x\npsi(l) = tr(l)",
        "f(x) = tr(x)\npsi(F) = f(C) + f(-F^3*2/J) + f(if J > 1 then C else I)",
        "parameter J in Pa\npsi(F) = J*tr(F)",
    ] {
        let found = codes(&format!("potential p\n{text}"));
        assert!(found.is_empty(), "{text}: {found:?}");
    }
}

/// psi and P of an energy of `F` as written.
fn psi_and_stress(energy: &str, d: usize) -> Vec<f64> {
    let text = format!("potential p\ndimensions {d}\n{energy}");
    let (model, form) = (crate::test_support::model(&text), crate::Form::Textbook);
    let values = crate::test_support::values(&model, d, &[]);
    let kernel = model.compile(&values, crate::Mode::Interpreter, form).unwrap().gradient.unwrap();
    let f = [1.5, 0.25, -0.5, 0.125, 0.75, 0.375, -0.25, 0.625, 1.25];
    let gradient: Vec<f64> = (0..d * d).map(|k| f[k / d * 3 + k % d]).collect();
    let change: Vec<f64> =
        (0..d * d).map(|k| gradient[k] - if k / d == k % d { 1.0 } else { 0.0 }).collect();
    let (mut psi, mut stress) = (vec![0.0], vec![0.0; d * d]);
    let at = crate::GradientBatch { n: 1, gradient: &gradient, change: &change, fields: &[] };
    kernel.evaluate(at, &mut psi, &mut stress);
    psi.extend(stress);
    psi
}

#[test]
fn vectors_and_components_are_what_tensors_make_of_them() {
    for (d, vectors, tensors) in [
        (3, "n = vector(0.6, 0, 0.8)\npsi(F) = n*C*n", "psi(F) = dyad(0.6, 0, 0.8) : C"),
        (2, "n = vector(0.6, 0.8)\npsi(F) = (n*C)*n", "psi(F) = dyad(0.6, 0.8) : C"),
        (3, "n = vector(1, 2, 2)\npsi(F) = norm(F*(n/3))^2", "psi(F) = dyad(1, 2, 2) : C/9"),
        (3, "n = vector(1, 2, 3)\npsi(F) = (F*n)*(F*n)", "psi(F) = tr(F*dyad(1, 2, 3)*F')"),
        (2, "n = vector(1, 2)\npsi(F) = (n*F)*(n*F)", "psi(F) = tr(F'*dyad(1, 2)*F)"),
        (
            3,
            "n = vector(1, 2, 3)\nm = -n + 2*n - vector(0, 1, 0)\npsi(F) = n*F*m",
            "psi(F) = F(1,1) + F(1,2) + 3*F(1,3) + 2*F(2,1) + 2*F(2,2) + 6*F(2,3) + 3*F(3,1) + 3*F(3,2) + 9*F(3,3)",
        ),
        (
            3,
            "n = vector(1, 0, 0)\nm = vector(0, 1, 0)\npsi(F) = dyad(n, m) : F",
            "psi(F) = F(1, 2)",
        ),
        (2, "n = vector(1, 2)\nM = dyad(n)\npsi(F) = M : E", "psi(F) = dyad(1, 2) : E"),
        (3, "psi(F) = norm(F)^2", "psi(F) = F : F"),
        (2, "n = vector(3, 4)\npsi(F) = n(2)*J*norm(n)", "psi(F) = 20*det(F)"),
        (
            3,
            "f(x) = x*C*x\npsi(F) = f(vector(1, 0, 0)) + f(if J > 0 then vector(0, 1, 0) else vector(0, 0, 1))",
            "psi(F) = C(1, 1) + C(2, 2)",
        ),
    ] {
        let (found, expected) = (psi_and_stress(vectors, d), psi_and_stress(tensors, d));
        let size = expected.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
        let errors = found.iter().zip(&expected).map(|(x, y)| (x - y).abs() / size);
        let error = errors.fold(0.0, f64::max);
        assert!(error < 4e-15, "{vectors}: {found:?} {expected:?}");
    }
}

#[test]
fn what_is_no_vector_is_told_so() {
    for (text, code) in [
        ("psi(F) = vector(1, 2)*F", "wrong-number-of-arguments"),
        ("psi(F) = vector(1, 2, 3)", "wrong-shape"),
        ("psi(F) = tr(vector(1, 2, 3))", "wrong-shape"),
        ("psi(F) = tr(F + vector(1, 2, 3))", "wrong-shape"),
        ("psi(F) = vector(1, 2, 3)^2", "wrong-shape"),
        ("psi(F) = vector(1, 2, 3) : F", "wrong-shape"),
        ("psi(F) = norm(J)", "wrong-shape"),
        ("psi(F) = norm(U)", "wrong-shape"),
        ("psi(F) = tr(if J > 1 then F else vector(1, 2, 3))", "type-mismatch"),
        ("psi(F) = F(1)", "wrong-number-of-arguments"),
        ("psi(F) = F(0, 1)", "wrong-shape"),
        ("psi(F) = F(1, 4)", "wrong-shape"),
        ("parameter k = 1\npsi(F) = F(1, k)", "wrong-shape"),
        ("psi(F) = J(1)", "not-a-function"),
        ("k = 2\npsi(F) = k(1 + J)", "not-a-function"),
        ("psi(F) = F(1, 2, 3)", "wrong-number-of-arguments"),
        ("n = vector(1, 2, 3)\npsi(F) = n(1, 2)*J", "wrong-number-of-arguments"),
        ("psi(l) = norm(l)", "unknown-name"),
    ] {
        let text = format!("potential p\ndimensions 3\n{text}");
        assert_eq!(codes(&text), [code], "{text}");
    }
    // Whoever has a norm keeps it.
    for text in ["norm(x) = x*x\npsi(F) = norm(J)", "parameter vector = 2\npsi(F) = vector*J"] {
        assert_eq!(codes(&format!("potential p\n{text}")), Vec::<&str>::new(), "{text}");
    }
}

#[test]
fn names_are_resolved() {
    for (text, code) in [
        ("psi(l) = k*l", "unknown-name"),
        ("psi(l) = k*l\nk = 2", "unknown-name"),
        ("k = 2\nk = 3\npsi(l) = l", "duplicate-name"),
        ("L = 2\npsi(l) = l", "reserved-name"),
        ("exp(x) = x\npsi(l) = l", "reserved-name"),
        ("S(x, x) = x\npsi(l) = l", "duplicate-name"),
        ("S(x) = x\npsi(l) = S(l, L)", "wrong-number-of-arguments"),
        ("psi(l) = exp(l, L)", "wrong-number-of-arguments"),
        ("psi(l) = max(l)", "wrong-number-of-arguments"),
        ("psi(l) = sqrt*l", "function-without-arguments"),
        ("k = 2\npsi(l) = k(l)", "not-a-function"),
        ("psi(l) = log(l)", "unknown-name"),
        ("psi(l) = t*l", "unknown-name"),
        ("psi(l) = a*l", "wrong-measure"),
        ("s = a/A\npsi(l) = s", "wrong-measure"),
        ("psi(L) = l", "unknown-measure"),
        ("psi(x) = 1", "unknown-measure"),
        ("psi(l) = if l then 1 else 2", "type-mismatch"),
        ("psi(l) = l > 1", "type-mismatch"),
        ("psi(l) = if l > 1 then l else l > 1", "type-mismatch"),
        ("parameter c = l\npsi(l) = l", "not-a-constant"),
        ("domain l/A in (0, 1)\npsi(l) = l", "wrong-measure"),
        ("domain l/L in (1, 1)\npsi(l) = l", "empty-domain"),
        ("domain J in (0, inf)\npsi(l) = l", "unknown-name"),
        ("parameter c\ndomain c in (0, inf)\npsi(F) = J", "wrong-measure"),
        ("domain C in (0, inf)\npsi(F) = J", "wrong-shape"),
        ("m = integral(l)\ndomain m in (0, inf)\npsi(m) = m", "wrong-measure"),
        (
            "state k = 0\nupdate k = max(k, J)\ndomain J - k in (0, 2)\npsi(F) = J*k",
            "wrong-measure",
        ),
        ("domain J in (1, 1)\npsi(F) = J", "empty-domain"),
        ("parameter c in furlong\npsi(l) = c*l", "unknown-unit"),
        ("k = 2", "no-energy"),
    ] {
        assert_eq!(codes(&format!("potential p\n{text}")), [code], "{text}");
    }
}

#[test]
fn all_errors_of_a_file_come_at_once() {
    let found = codes("potential p\npsi(l) = k*l\npsi(a) = m*a + exp(a, A)\npsi(v) = w");
    assert_eq!(
        found,
        ["unknown-name", "unknown-name", "wrong-number-of-arguments", "unknown-name"]
    );
}

#[test]
fn a_wrong_name_hides_no_other_mistake() {
    let found = codes(
        "potential p\ndimensions 2\nparameter C in J/m^5\nparameter k in furlong\n\
         w = zz*l\nf(x, x) = x\npsi(l) = C*(l - L^2)\npsi(l) = w + f(l, l)\npsi(a) = C < 1",
    );
    let expected = [
        "unknown-unit",
        "unknown-name",
        "duplicate-name",
        "dimension-mismatch",
        "dimension-mismatch",
    ];
    assert_eq!(found, expected);
    let found = errors("potential p\npsi(l) = t*l");
    assert!(found[0].helps[0].contains("load parameter of a scene"), "{:?}", found[0].helps);
}

#[test]
fn conditions_may_use_definitions_and_the_dimension() {
    let model = model(
        "potential p\nk = 2\nfloor(x) = x + d\nparameter C, C > k, C != floor(7)\n\
         parameter r = 1, r < delta\npsi(l) = C*r*l",
    );
    assert_eq!(model.constraints().len(), 3);
    let broken = |d, c, horizon| {
        let set = [("C".to_string(), Setting::Number(c))];
        match model.values(d, &set, horizon) {
            Ok(_) => Vec::new(),
            Err(errors) => errors.into_iter().map(|e| e.message).collect(),
        }
    };
    assert_eq!(broken(2, 3.0, None), Vec::<String>::new());
    assert_eq!(broken(2, 1.0, None), ["parameter `C` = 1 breaks `C > k`"]);
    assert_eq!(broken(2, 9.0, None), ["parameter `C` = 9 breaks `C != floor(7)`"]);
    assert_eq!(broken(3, 9.0, None), Vec::<String>::new());
    assert_eq!(broken(3, 3.0, Some(2.0)), Vec::<String>::new());
    assert_eq!(broken(3, 3.0, Some(0.5)), ["parameter `r` = 1 breaks `r < delta`"]);
}

#[test]
fn numbers_beyond_all_bounds_are_refused() {
    for (text, code) in [
        ("parameter c = 1/0\npsi(l) = c*l", "not-a-constant"),
        ("parameter c = 0/0\npsi(l) = c*l", "not-a-constant"),
        ("parameter c in m^(0/0)\npsi(l) = c*l", "unknown-unit"),
        ("parameter c in rad^(1/0)\npsi(l) = c*l", "unknown-unit"),
        ("parameter c in kPa^200\npsi(l) = c*l", "unknown-unit"),
        ("parameter c in nm^60\npsi(l) = c*l", "unknown-unit"),
        ("domain l/L in (0/0, 1)\npsi(l) = l", "empty-domain"),
        ("domain l/L in (not inf, 1)\npsi(l) = l", "not-a-constant"),
    ] {
        assert_eq!(codes(&format!("potential p\n{text}")), [code], "{text}");
    }
    let roots = "sqrt(".repeat(4) + "l" + &")".repeat(4);
    let text = format!("potential p\nparameter c in m\ndimensions 2\npsi(l) = {roots}");
    assert_eq!(codes(&text), ["dimension-mismatch"]);
    let model = model("potential p\nparameter c in TPa\npsi(l) = 0*c*l^0");
    let set = [("c".to_string(), Setting::Number(1e300))];
    assert_eq!(model.values(3, &set, None).unwrap_err()[0].code, "not-a-number");
}

#[test]
fn exponents_of_quantities_are_known_numbers() {
    let file = |energy: &str| {
        format!("potential p\ndimensions 2\nparameter C in J/m^4\nparameter n\npsi(l) = C*{energy}")
    };
    assert_eq!(codes(&file("l^n/L^2")), ["dimension-mismatch"]);
    assert_eq!(codes(&file("l^2/L^2")), Vec::<&str>::new());
    assert_eq!(codes(&file("sqrt(l/L)")), Vec::<&str>::new());
    assert_eq!(codes(&file("sqrt(l)*sqrt(L)/L")), Vec::<&str>::new());
    assert_eq!(codes(&file("(l/L)^L")), ["dimension-mismatch"]);
}

#[test]
fn expansion_is_bounded() {
    // Each function doubles the work of the one before: 2^40 nodes if expanded blindly.
    let mut text = "potential p\nf0(x) = x + 1\n".to_string();
    for i in 1..40 {
        text.push_str(&format!("f{i}(x) = f{}(x + {i}) * f{}(x - {i})\n", i - 1, i - 1));
    }
    text.push_str("psi(l) = f39(l)\n");
    assert_eq!(codes(&text), ["too-large"]);
    // A chain of calls deeper than any stack.
    let mut text = "potential p\nf0(x) = x + 1\n".to_string();
    for i in 1..2000 {
        text.push_str(&format!("f{i}(x) = f{}(x) + 1\n", i - 1));
    }
    text.push_str("psi(l) = f1999(l)\n");
    assert_eq!(codes(&text), ["too-large"]);
}

#[test]
fn parameter_values_are_converted_and_checked() {
    let model = model(
        "potential p\ndimensions 3\nparameter E = 200 in GPa, E > 0\nparameter k = 2\n\
         psi(l) = k*E*l/L/L^3",
    );
    let values = |settings: &[(&str, Setting)]| {
        let settings: Vec<_> = settings.iter().map(|(n, s)| (n.to_string(), s.clone())).collect();
        model.values(3, &settings, None)
    };
    assert_eq!(values(&[]).unwrap().parameters, [200e9, 2.0]);
    assert_eq!(values(&[("E", Setting::Number(1.0))]).unwrap().parameters[0], 1e9);
    let megapascal = Setting::Text("500 MPa".into());
    assert_eq!(values(&[("E", megapascal)]).unwrap().parameters[0], 5e8);
    let code = |settings: &[(&str, Setting)]| values(settings).unwrap_err()[0].code;
    assert_eq!(code(&[("E", Setting::Text("3 m".into()))]), "dimension-mismatch");
    assert_eq!(code(&[("E", Setting::Number(-1.0))]), "constraint-violated");
    assert_eq!(code(&[("E", Setting::Number(f64::NAN))]), "not-a-number");
    assert_eq!(code(&[("E", Setting::Text("much".into()))]), "not-a-number");
    assert_eq!(code(&[("G", Setting::Number(1.0))]), "unknown-parameter");
    assert_eq!(model.values(2, &[], None).unwrap_err()[0].code, "wrong-dimensions");
}

#[test]
fn values_are_stated_in_units() {
    let text = "potential p\ndimensions 3\nparameter n = 2\nY0 = 250 in MPa\n\
                k = 3*n in kN/m^(d-1)\npsi(l) = (Y0 + k)/L^3*(l/L)\n";
    let model = model(text);
    let values = model.values(3, &[], None).unwrap();
    let energy = model.specialise_as(&values, crate::Form::Textbook).unwrap().energies[0].clone();
    let mut interpreter = crate::expression::interpret::Interpreter::<f64>::new();
    energy.run(&mut interpreter, &2.0, &1.0, &1.0);
    assert_eq!(interpreter.number(energy.roots[0]), 2.0 * (250e6 + 6e3));
    for (lines, code) in [
        ("Y0 = 250 in MPa\npsi(l) = Y0*l/L", "dimension-mismatch"),
        ("Y0 = L in m\npsi(l) = Y0*l/L", "dimension-mismatch"),
        ("Y0 = 1 in furlong\npsi(l) = Y0*l/L", "unknown-unit"),
        ("Y0 = 1 in m^k\npsi(l) = Y0*l/L", "unknown-name"),
        ("Y0 = 1 in MPa\nparameter C = 2*Y0\npsi(l) = Y0/L^3*C*l/L", "not-a-constant"),
        ("Y0 = 1 in MPa\nparameter C = 2 in MPa, C > Y0\npsi(l) = C/L^3*l/L", "dimension-mismatch"),
        ("Y0 = I in MPa\npsi(F) = tr(Y0)", "wrong-shape"),
    ] {
        assert_eq!(codes(&format!("potential p\ndimensions 3\n{lines}")), [code], "{lines}");
    }
    let found = check_text("potential p\nf(x) = x in MPa\npsi(l) = f(l)").unwrap_err();
    assert_eq!(found[0].code, "syntax");
    let found = check_text("potential p\nY0 = 250 MPa\npsi(l) = Y0*l").unwrap_err();
    assert!(found[0].helps[0].contains("`250 in MPa`"), "{found:?}");
}

#[test]
fn lines_that_cannot_be_read_hide_no_other_mistake() {
    let found = |text: &str| -> Vec<&str> {
        check_text(text).unwrap_err().iter().map(|finding| finding.code).collect()
    };
    let text =
        "potential p\nparamter λ in J/m^5\npsi(l) = lambda*l\npsi(l) = k*l\npsi(a) = exp(a, A)";
    assert_eq!(found(text), ["syntax", "unknown-name", "wrong-number-of-arguments"]);
    // What may be missing only because its line was not read is not called missing.
    assert_eq!(found("potential p\nS(x) = = x\npsi(l) = S(l)"), ["syntax"]);
    assert_eq!(found("potential p\npsi(l) = 1 +"), ["syntax"]);
    assert_eq!(found("potential p\ndimensions 2 3\npsi(l) = k*l"), ["syntax"]);
    assert_eq!(found("psi(l) = k*l"), ["missing-potential", "unknown-name"]);
    assert_eq!(found(&"#".repeat(piola_grammar::MAX_BYTES + 1)), ["file-too-large"]);
    assert_eq!(
        found(&format!("potential p\npsi(l) = {}l", "(".repeat(300)))[0],
        "nesting-too-deep"
    );
}

/// Of which kinds the states of a potential are, as `k: a`.
fn kinds(lines: &str) -> Vec<String> {
    let model = model(&format!("potential p\n{lines}"));
    let kind = |state: usize| model.kind_of_state(state).unwrap().symbol();
    model
        .states()
        .map(|state| format!("{}: {}", model.parameters()[state].name, kind(state)))
        .collect()
}

#[test]
fn states_are_of_the_kind_that_their_updates_hold() {
    let psi = "psi(l) = (l/L)^2\npsi(a) = (a/A)^2\npsi(v) = (v/V)^2";
    for (lines, expected) in [
        ("state k = 0\nupdate k = max(k, l/L - 1)", &["k: l"][..]),
        ("state k = 0\nupdate k = max(k, a/A - 1)", &["k: a"]),
        ("state k = 0\nupdate k = max(k, V)", &["k: v"]),
        // Through a definition, and through other states, in either order.
        ("state k = 0\ng = a/A - 1\nupdate k = max(k, g)", &["k: a"]),
        (
            "state k = 0\nstate p = 0\nupdate p = p + k*dt\nupdate k = max(k, a/A - 1)",
            &["k: a", "p: a"],
        ),
        (
            "state k = 0\nstate p = 0\nstate q = 0\nupdate q = p\nupdate p = k\nupdate k = v",
            &["k: v", "p: v", "q: v"],
        ),
        // By what holds them.
        ("state k = 0\nupdate k = k + dt\npsi(a) = k*(a/A)^2", &["k: a"]),
        ("state k = 0\nupdate k = k + dt\nbreak when k > 1 or v/V > 2", &["k: v"]),
        ("state k = 0\nstate p = 0\nupdate k = k + dt\nupdate p = max(p, k*a)", &["k: a", "p: a"]),
        ("state k = 0\nupdate k = k + dt\nbreak when k > 1", &["k: l"]),
        ("state k = 0\nbreak when k > 0.1\nupdate k = max(k, a/A - 1)", &["k: a"]),
    ] {
        assert_eq!(kinds(&format!("{lines}\n{psi}")), expected, "{lines}");
    }
    let psi = "m = integral(l)\npsi(F) = tr(E)^2\npsi(m) = m^2\npsi(l) = (l/L)^2";
    for (lines, expected) in [
        ("state k = 0\nupdate k = max(k, J - 1)", &["k: F"][..]),
        ("state k = 0\nstate p = 0\nupdate k = k + p*dt\nupdate p = max(p, J)", &["k: F", "p: F"]),
        ("state k = 0\nupdate k = k + dt\npsi(F) = k*tr(E)^2", &["k: F"]),
        ("state k = 0\nupdate k = k + dt\nbreak when k > 1 and J > 2", &["k: F"]),
        ("m2 = integral(l^2)\nstate k = 0\nupdate k = max(k, m2)", &["k: theta"]),
        ("m2 = integral(l^2)\nstate k = 0\nupdate k = k + dt\npsi(l, m2) = k*m2*l", &["k: theta"]),
        ("m2 = integral(l^2)\nstate k = 0\nupdate k = dt\nbreak when l > k*m2", &["k: theta"]),
    ] {
        assert_eq!(kinds(&format!("{lines}\n{psi}")), expected, "{lines}");
    }
    let of_families = |line: &str| {
        let text = "state k = 0\nstate p = 0\nupdate k = max(k, J)\nupdate p = max(p, m)";
        let all = format!("potential p\n{psi}\n{text}\n{line}");
        let model = model(&all);
        model.family_breaks().iter().map(|one| one.of).collect::<Vec<_>>()
    };
    assert_eq!(of_families("break when k > 1"), [OfFamily::Gradient]);
    assert_eq!(of_families("break when k > J"), [OfFamily::Gradient]);
    assert_eq!(of_families("break when p > 1"), [OfFamily::Points]);
    assert_eq!(of_families("break when l > p"), [OfFamily::Bonds]);
    let text = "state k = 0\nbreak when k > 0.1\nupdate k = max(k, a/A - 1)\npsi(a) = (a/A)^2";
    let model = model(&format!("potential p\n{text}"));
    assert_eq!(model.breaks()[0].of, Measure::Area);
}

#[test]
fn states_of_one_kind_are_refused_to_others() {
    let of_areas = "potential p\nstate k = 0\nupdate k = max(k, a/A - 1)\npsi(l) = (l/L)^2\n";
    for (line, what, label) in [
        ("psi(l) = k*l/L", "psi(l) cannot depend on what triangles remember", "holds `k`"),
        ("psi(v) = k*v/V", "psi(v) cannot depend on what triangles remember", "of triangles"),
        ("psi(F) = k*tr(E)^2", "psi(F) cannot depend on what triangles remember", "of triangles"),
        ("psi(a, l1) = k*a/A*l1", "cannot depend on what triangles remember", "of triangles"),
        ("dissipation(l) = k*rate(l)^2", "a dissipation cannot", "a state of triangles"),
        ("break when k > 1 and l/L > 1", "a condition is one of bonds", "what triangles remember"),
        ("state p = 0\nupdate p = k*l", "what bonds remember cannot", "a state of triangles"),
        ("state p = 0\nupdate p = a*l", "`p` would be a state of several", "`l` and `a`"),
        ("m = integral(l)\nstate p = 0\nupdate p = m*a", "a state is one of a measure", "gather"),
        ("m = integral(l)\nstate p = 0\nupdate p = m*l", "remembered by points", "gather"),
        (
            "m = integral(l)\nstate p = 0\nupdate p = m",
            "what points gather, and no energy does",
            "for energies",
        ),
        ("psi(F) = J\nstate p = 0\nupdate p = J*l", "a state is one of a measure", "gradient"),
        (
            "psi(F) = J\nstate p = 0\nupdate p = J*k",
            "what deformation gradients remember",
            "of triangles",
        ),
    ] {
        let found = errors(&format!("{of_areas}{line}"));
        let all: Vec<String> = found
            .iter()
            .map(|one| format!("{}: {}: {:?}", one.message, one.label, one.helps))
            .collect();
        assert!(all.iter().any(|one| one.contains(what) && one.contains(label)), "{line}: {all:?}");
        let is_helped = |one: &Diagnostic| !one.helps.is_empty();
        assert!(found.iter().all(is_helped), "{line}: {found:?}");
    }
    // What never changes is of bonds, as what varies from bond to bond.
    let found = errors("potential p\nstate k = 0\npsi(a) = k*(a/A)^2");
    assert_eq!(found[0].message, "psi(a) cannot depend on what bonds remember");
}

/// A name that may not be defined is told once, and not again where it is used.
#[test]
fn uses_of_refused_names_are_not_told() {
    for text in [
        "t = l/L\npsi(l) = (t - 1)^2*L",
        "A = 2\npsi(l) = A*(l - L)^2/L",
        "parameter a = 2\npsi(l) = a*(l - L)^2/L",
    ] {
        assert_eq!(codes(&format!("potential p\n{text}")), ["reserved-name"], "{text}");
    }
    for (text, other) in [("A = 2\npsi(l) = A*x*(l - L)^2/L", "x"), ("t = 2\npsi(l) = t*T*l", "T")]
    {
        let found = codes(&format!("potential p\n{text}"));
        assert_eq!(found, ["reserved-name", "unknown-name"], "{other}");
    }
}
