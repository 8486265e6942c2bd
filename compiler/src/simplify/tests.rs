//! One test per rule, named like it; each prints an energy before and after.

use crate::test_support::{model, values};
use crate::{Form, Measure, Mode};

/// The energy as `derive` prints it, parameters left as symbols.
fn simplified(energy: &str) -> String {
    let model = model(&format!("potential p\nparameter C\nparameter n\npsi(l) = {energy}"));
    let specialised = model.symbolic(3).unwrap();
    let text = crate::print::text(&model, &specialised.energies[0]);
    let line = text.lines().find(|line| line.starts_with("psi(l) = ")).unwrap();
    line["psi(l) = ".len()..].to_string()
}

fn becomes(energy: &str, expected: &str) {
    assert_eq!(simplified(energy), expected, "{energy}");
}

fn stays(energy: &str) {
    becomes(energy, energy);
}

#[test]
fn every_rule_has_a_test() {
    let source = include_str!("tests.rs");
    for rule in super::RULES {
        assert!(source.contains(&format!("fn {}()", rule.name)), "no test of rule {}", rule.name);
    }
}

#[test]
fn fold_constants() {
    becomes("l*(2 + 3^2)", "11*l");
    becomes("if 1 < 2 then l else L", "l");
    becomes("l + sqrt(4)", "2 + l");
}

#[test]
fn add_zero() {
    becomes("l + 0", "l");
    becomes("0 + l", "l");
}

#[test]
fn subtract_zero() {
    becomes("l - 0", "l");
}

#[test]
fn subtract_from_zero() {
    becomes("0 - l", "-l");
}

#[test]
fn add_negated() {
    becomes("l + (-C)", "l - C");
    becomes("-l + C", "C - l");
}

#[test]
fn subtract_negated() {
    becomes("l - (-C)", "l + C");
}

#[test]
fn subtract_self() {
    becomes("l - l + C*l", "l*C");
    stays("ln(l) - ln(l)");
}

#[test]
fn subtract_own_term() {
    becomes("1 + l^2 - 1", "l^2");
    stays("2 + l^2 - 1");
}

#[test]
fn negate_negated() {
    becomes("-(-l)", "l");
}

#[test]
fn multiply_one() {
    becomes("1*l", "l");
    becomes("l*1", "l");
}

#[test]
fn multiply_minus_one() {
    becomes("(-1)*l", "-l");
}

#[test]
fn multiply_zero() {
    becomes("0*l + C*l", "l*C");
    // ln(l) is not a number for l < 0, and 0*ln(l) must not hide that.
    stays("l + 0*ln(l)");
}

#[test]
fn multiply_negated() {
    becomes("(-l)*C", "-(l*C)");
}

#[test]
fn multiply_constants() {
    becomes("0.5*(2*l)", "l");
    becomes("4*(3*l)", "12*l");
    becomes("0.5*(2*l/C)", "l/C");
    // 3*0.1 rounds: the product is kept as it was written.
    stays("0.1*(3*l)");
}

#[test]
fn multiply_reciprocal() {
    becomes("l*(1/C)", "l/C");
}

#[test]
fn divide_one() {
    becomes("l/1", "l");
}

#[test]
fn divide_zero() {
    becomes("0/L + l", "l");
    stays("0/l");
    stays("l + 0/C");
}

#[test]
fn divide_self() {
    becomes("l*(L/L)", "l");
    becomes("l*(delta/delta)", "l");
    stays("l/l");
    stays("l*(C/C)");
}

#[test]
fn divide_negated() {
    becomes("(-l)/C", "-(l/C)");
    becomes("l/(-C)", "-(l/C)");
}

#[test]
fn cancel_reference() {
    becomes("(C*L)*(l/L)", "C*l");
}

#[test]
fn divide_by_reference() {
    becomes("(C*L)/L*l", "C*l");
    stays("C*l/C");
}

#[test]
fn divide_power_of_two() {
    becomes("l/4", "0.25*l");
    stays("l/3");
}

#[test]
fn divide_own_factor() {
    becomes("(3*l)/3", "l");
    stays("0*ln(l)/0");
}

#[test]
fn divide_by_quotient() {
    becomes("1/(L/l)", "l/L");
    stays("1/(C/l)");
}

#[test]
fn hyperbolic_quotient() {
    becomes("sinh(l)/cosh(l)", "tanh(l)");
    becomes("cosh(C*l)/sinh(C*l)", "1/tanh(C*l)");
    stays("cosh(l)/sinh(n)");
}

#[test]
fn reference_last() {
    becomes("(C/L)*l", "C*l/L");
    becomes("(C/L)/n", "C/n/L");
    // The stretch stays in one piece.
    stays("l/L*C");
}

#[test]
fn change_of_measure() {
    becomes("(l - L)/L", "l/L - 1");
    becomes("l - L", "L*(l/L - 1)");
    becomes("(L - l)/L", "-(l/L - 1)");
}

#[test]
fn change_of_stretch() {
    becomes("l/L - 1", "l/L - 1");
    becomes("1 - l/L", "-(l/L - 1)");
    becomes("-1 + l/L", "l/L - 1");
    stays("l/L - 2");
}

#[test]
fn constant_exponent() {
    becomes("l^(1 + 1)", "l^2");
    stays("l^n");
    stays("0^l");
}

#[test]
fn power_one() {
    becomes("l^1", "l");
    stays("l^0");
    stays("ln(l)^0");
}

#[test]
fn select_known() {
    becomes("if d == 3 then l else L", "l");
}

#[test]
fn select_same() {
    becomes("if C > 0 then l else l", "l");
}

#[test]
fn truth_known() {
    becomes("if 0 < 1 and C > 0 then l else L", "if C > 0 then l else L");
    becomes("if not (not (C > 0)) or 1 < 0 then l else L", "if C > 0 then l else L");
}

/// What is not a number in the energy as written is none in the kernel either.
#[test]
fn domains_are_not_widened() {
    for energy in ["0*ln(l) + l", "sqrt(l)^2", "l*ln(l)/ln(l)", "l + 0/(l + 1)"] {
        let model = model(&format!("potential p\npsi(l) = {energy}"));
        let values = values(&model, 3, &[]);
        let kernel = &model.compile(&values, Mode::Interpreter, Form::Accurate).unwrap().kernels[0];
        let l = if energy.contains("l + 1") { -1.0 } else { -2.0 };
        let batch =
            crate::Batch { measure: &[l], reference: &[1.0], change: &[l - 1.0], fields: &[] };
        let out = kernel.derivatives(batch);
        let (written, ..) = model.written(&values, Measure::Length).derivatives(l, 1.0);
        assert!(written.is_nan() && out.psi[0].is_nan(), "{energy}: {written} {}", out.psi[0]);
    }
}
