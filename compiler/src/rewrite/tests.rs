//! One test per rule, of the same name: where it applies, what it gains, where it does not apply.

use super::{Explanation, REWRITES, explain};
use crate::check::check_text;
use crate::kernel::{Batch, Mode, Order, Outputs};
use crate::model::Model;
use crate::specialise::Form;
use crate::values::Values;

/// Largest error in u that a rewritten expression may have, unless what was written has more: no
/// form of `exp(1e6)` is right to the last digit.
const BAR: f64 = 16.0;

fn model(energy: &str) -> (Model, Values) {
    let text = format!("potential p\nparameter n = 1\npsi(l) = {energy}\n");
    let (_, model) = check_text(&text).unwrap_or_else(|e| panic!("{e:#?}"));
    let values = model.values(3, &[], None).unwrap();
    (model, values)
}

/// What was done to an energy.
fn explanations(energy: &str) -> Vec<Explanation> {
    let (model, values) = model(energy);
    explain(&model, &values).unwrap()
}

/// The rule applies to the first energy, not to the others; the form it leads to is right to
/// [`BAR`], and better by `gain` than what was written.
#[track_caller]
fn rule(name: &str, energy: &str, gain: f64, others: &[&str]) {
    let found = explanations(energy);
    let used: Vec<&Explanation> = found.iter().filter(|e| e.rule.name == name).collect();
    assert!(!used.is_empty(), "{name} is not used for {energy}: {found:#?}");
    for e in &found {
        assert!(e.after.near <= BAR, "{e:#?}");
        assert!(e.after.far <= BAR.max(e.before.far), "{e:#?}");
    }
    let gained = used.iter().map(|e| e.before.near.max(e.before.far)).fold(0.0, f64::max);
    assert!(gained >= gain, "{gained} u before: {used:#?}");
    for other in others {
        let found = explanations(other);
        assert!(found.iter().all(|e| e.rule.name != name), "{other}: {found:#?}");
    }
}

#[test]
fn every_rule_has_a_test() {
    let tests = include_str!("tests.rs");
    for rule in REWRITES {
        assert!(tests.contains(&format!("fn {}()", rule.name)), "{}", rule.name);
    }
}

#[test]
fn rebuild_stretch() {
    // 1 + e has lost what is left of a bond that is compressed to 1e-6 of its length.
    rule("rebuild_stretch", "(1 + (l/L - 1))^2", 1e4, &["(2 + (l/L - 1))^2"]);
}

#[test]
fn difference_of_powers() {
    rule("difference_of_powers", "((l/L)^3 - 1)^2", 1e13, &["((l/L)^3 - 2)^2", "((l/L)^3 + 1)^2"]);
    rule("difference_of_powers", "(l^2 - L^2)^2", 1e13, &["(l^2 - 2*L^2)^2", "(l^3 - L^2)^2"]);
    rule("difference_of_powers", "((L/l)^6 - (L/l)^12)^2", 1e13, &[]);
    rule("difference_of_powers", "(2 - 2*(l/L)^0.37)^2", 1e13, &[]);
}

#[test]
fn difference_of_exponentials() {
    rule("difference_of_exponentials", "(exp(l/L - 1) - 1)^2", 1e13, &["exp(l/L - 1) - 2"]);
    rule("difference_of_exponentials", "(1 - exp(-2*(l/L - 1)))^2", 1e13, &["exp(l/L) + 1"]);
}

#[test]
fn perfect_square() {
    let morse = "exp(-2*(l/L - 1)) - 2*exp(-(l/L - 1)) + 1";
    rule("perfect_square", morse, 1e13, &["exp(-2*(l/L - 1)) - 2*exp(-(l/L - 1)) + 2"]);
    let lennard_jones = "(L/l)^12 - 2*(L/l)^6 + 1";
    rule("perfect_square", lennard_jones, 1e13, &["(L/l)^12 - 2*(L/l)^5 + 1"]);
    // Numbers go with powers of the stretch and with exponentials, which do not go with each other.
    let mixed = ["1 - 2*(l/L) + exp(2*(l/L - 1))", "1 - 2*(L/l) + exp(-2*(l/L - 1))"];
    rule("perfect_square", "exp(2*(l/L - 1)) - 2*exp(l/L - 1) + 1", 1e13, &mixed);
}

#[test]
fn logarithm_of_stretch() {
    rule("logarithm_of_stretch", "ln(l/L)^2", 1e11, &["ln((l/L)^2)^2", "ln(2*l/L)^2"]);
    rule("logarithm_of_stretch", "ln((l/L)^3)^2", 1e11, &["ln(l)^2"]);
}

#[test]
fn logarithm_of_sum() {
    rule("logarithm_of_sum", "ln(1 + (l/L - 1)^2)", 1e13, &["ln(2 + (l/L - 1)^2)"]);
}

#[test]
fn inverse_hyperbolic_sine() {
    // Below 0 in compression.
    let y = "(80*(l/L) - 60)";
    let others = [format!("ln({y} + sqrt({y}^2 - 1))"), format!("ln({y} + sqrt((2*{y})^2 + 1))")];
    let others = others.each_ref().map(String::as_str);
    rule("inverse_hyperbolic_sine", &format!("ln({y} + sqrt({y}^2 + 1))"), 50.0, &others);
    rule("inverse_hyperbolic_sine", &format!("ln(sqrt(0.3 + {y}*{y}) + {y})"), 200.0, &[]);
}

#[test]
fn logarithm_of_change() {
    // As they are typed: in compression the change has lost what is left of the length.
    rule("logarithm_of_change", "log1p(l/L - 1)^2", 1e4, &["log1p(2*(l/L - 1)^2)"]);
    rule("logarithm_of_change", "log1pmx(l/L - 1)", 1e3, &["log1pmx(2*(l/L - 1))"]);
}

#[test]
fn logarithm_of_square() {
    // Defined for l < 2 L: beyond, neither form has a value.
    rule("logarithm_of_square", "ln(1 - (l/L - 1)^2)", 1e4, &["ln(2 - (l/L - 1)^2)"]);
}

/// The function of the change, as it is typed, is the difference that it abbreviates: psi, psi' and psi''
/// have the same bits in compression, on both sides of the guards, where there is none, and beyond.
#[test]
fn logarithmic_barriers_are_one_form() {
    let guards = [0.7, 1.3].map(|x: f64| [x.next_down(), x, x.next_up()]);
    let measure = [&[-0.5, 0.0, 1e-300, 1e-12, 0.4, 1.0, 7.0][..], guards.as_flattened()].concat();
    let change: Vec<f64> = measure.iter().map(|l| l - 1.0).collect();
    let reference = vec![1.0; measure.len()];
    let bits = |energy: &str| {
        let (model, values) = model(energy);
        let batch =
            Batch { measure: &measure, reference: &reference, change: &change, fields: &[] };
        let out = model.compile(&values, Mode::Interpreter, Form::Accurate).unwrap().kernels[0]
            .derivatives(batch);
        [out.psi, out.dpsi, out.d2psi].map(|x| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>())
    };
    assert_eq!(bits("L*log1pmx(l/L - 1)"), bits("L*(ln(l/L) - (l/L - 1))"));
}

#[test]
fn difference_of_squares() {
    let energy = "(exp(l/L)^2 - 4)^2";
    let found = explanations(energy);
    assert!(found.iter().any(|e| e.rule.name == "difference_of_squares"), "{found:#?}");
    rule("difference_of_squares", "1 - (l/L - 1)^2", 1e4, &["3 - (l/L - 1)^2"]);
}

#[test]
fn difference_of_roots() {
    let energy = "sqrt(1 + (l/L - 1)^2) - 1";
    rule("difference_of_roots", energy, 1e13, &["sqrt(1 + (l/L - 1)^2) + 1"]);
}

#[test]
fn strain_of_whole_order() {
    for n in [-16, -7, -4, -3, -2, -1, 2, 3, 4, 5, 6, 8, 10, 12, 15] {
        let found = explanations(&format!("((l/L)^({n}) - 1)^2"));
        let whole = found.iter().find(|e| e.rule.name == "strain_of_whole_order").unwrap();
        let worst = whole.after.near.max(whole.after.far);
        assert!(worst <= 8.0 + f64::from(n).abs(), "n = {n}: {worst} u");
        assert_eq!(whole.after.calls, 0, "n = {n}");
    }
    rule("strain_of_whole_order", "((l/L)^(-3/2) - 1)^2", 1e13, &["((l/L)^0.37 - 1)^2"]);
}

#[test]
fn strain_of_any_order() {
    rule("strain_of_any_order", "((l/L)^0.37 - 1)^2", 1e13, &["((l/L)^2 - 1)^2"]);
    rule("strain_of_any_order", "((l/L)^1e-9 - 1)^2", 1e13, &[]);
    rule("strain_of_any_order", "(((l/L)^1e-300 - 1)/1e-300)^2", 0.0, &[]);
}

/// `exp(0*y)` is 1 where `y` is a number, and no number elsewhere: the difference from a power must not
/// forget it.
#[test]
fn no_rule_widens_the_domain() {
    let (model, values) = model("(exp(0*ln(2 - l/L))^2 - l/L)^2");
    let kernel =
        model.compile(&values, Mode::Interpreter, Form::Accurate).unwrap().kernels.remove(0);
    let at = |stretch: f64| {
        let mut psi = [0.0];
        let (reference, change) = ([1.0], [stretch - 1.0]);
        let batch =
            Batch { measure: &[stretch], reference: &reference, change: &change, fields: &[] };
        let out = Outputs { psi: &mut psi, dpsi: &mut [], d2psi: &mut [] };
        kernel.evaluate(batch, Order::Energy, out);
        psi[0]
    };
    assert_eq!(at(1.5), 0.25);
    assert!(at(3.0).is_nan());
}

/// What cancels at rest alone needs no rule of its own: the remainder serves near rest, and everywhere where
/// it holds everywhere.
#[test]
fn remainders_take_the_place_of_rules() {
    let others = ["cosh(l/L - 1) - 2", "2 - cos(l/L - 1)", "l/L - 2 - ln(l/L)"];
    let energies = [
        "(ln(l) - ln(L))^2",
        "l/L - 1 - ln(l/L)",
        "ln(l/L) - (l/L - 1)",
        "(l/L - 1)^2 - log1p((l/L - 1)^2)",
        "1/2*((l/L)^2 - 1) - ln(l/L)",
        "cosh(0.001*(l/L - 1)) - 1",
        "1 - cos(1e-6*(l/L - 1))",
    ];
    for energy in energies {
        rule("remainder_at_rest", energy, 1e11, &others);
    }
}

#[test]
fn remainder_at_rest() {
    let others = ["(l/L - 1)^2", "((l/L)^3 - 1)^2", "exp(l/L)"];
    rule("remainder_at_rest", "1 - (1 + (l/L - 1))*exp(-(l/L - 1))", 1e13, &others);
    rule("remainder_at_rest", "(atan(l/L) - atan(1))^2", 1e13, &others);
    rule("remainder_at_rest", "1/3*(l/L)^3 - l/L + 2/3", 1e13, &others);
    rule("remainder_at_rest", "max(exp(l/L) - exp(1), 0)^2", 1e13, &others);
}
