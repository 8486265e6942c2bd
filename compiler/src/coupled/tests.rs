//! Energies of several measures: digits near rest, derivatives, what is dropped.

use super::*;
use crate::kernel::Level;
use crate::test_support::{model, values};
use crate::verify::{Outcome, Subject, verify};

/// Energies of triangles and of tetrahedra with all that there is.
const RICH: &str = "potential rich
parameter n = 3
S(x) = (x^n - 1)/n
psi(angle) = (angle - Angle)^2
psi(angle, l1, l2) = exp(-l1/L1 - l2/L2)*(angle/Angle - 1)^2
psi(a, l1, l2, l3) = (a/A - 1)*(l1/L1 + l2/L2 + l3/L3 - 3) + S(l1/L1)^2 + S(l2/L2)^2 + S(l3/L3)^2
psi(a, l1) = ln(a/A)*(l1 - L1) + (a/A - l1/L1)^2
psi(angle) = (2*cos(angle) - 2*cos(Angle))^2
psi(v, a1, a2, a3, a4) = (v/V - 1)*((a1 - A1) + (a2 - A2) + (a3 - A3) + (a4 - A4)) + (v/V - 1)^2
psi(v, a1, l1, l6) = S(l1/L1)*S(l6/L6) + ln(v/V)^2 + (l1/L1 - l6/L6)^2*(2*a1/A1 - v/V - 1)
";

#[test]
fn derivatives_are_true_near_rest_and_far_from_it() {
    let model = model(RICH);
    for (dimension, n) in [(2, 1), (3, 2)] {
        let found = verify(&model, &values(&model, dimension, &[]), 60).unwrap().0;
        assert_eq!(found.len(), n);
        for one in found {
            assert!(matches!(one.subject, Subject::Coupled(..)));
            assert_eq!(one.n_places, 60);
            assert_eq!(one.outcome(), Outcome::Passed, "{:#?}", one.misses.first());
        }
    }
}

/// Far from what the rules know, products of measures that cancel lose digits, and `verify` says so.
#[test]
fn digits_that_a_form_loses_are_told() {
    let model = model("potential p\npsi(l1, l2, l3) = (l1*l2/(L1*L2) - l3/L3)^2");
    let found = verify(&model, &values(&model, 3, &[]), 60).unwrap().0;
    assert_eq!(found[0].outcome(), Outcome::DigitsLost);
    assert!(found[0].misses.iter().all(|miss| !miss.is_wrong));
}

/// Psi, its gradient and all second derivatives of one place.
fn at(kernel: &CoupledKernel, variables: &[f64], reference: &[f64]) -> Vec<f64> {
    let n = variables.len();
    let change: Vec<f64> =
        variables.iter().zip(reference).map(|(m, rest)| m / rest - 1.0).collect();
    let batch = CoupledBatch { n: 1, variables, reference, change: &change, fields: &[] };
    let (mut psi, mut gradient, mut all) = (vec![0.0], vec![0.0; n], Vec::new());
    kernel.evaluate(batch, &mut psi, &mut gradient);
    for k in 0..n {
        let mut direction = vec![0.0; n];
        direction[k] = 1.0;
        let mut product = vec![0.0; n];
        kernel.product(batch, &direction, &mut product);
        all.extend(product);
    }
    [psi, gradient, all].concat()
}

/// `tan(angle) = 2 a/(l1^2 + l2^2 - l3^2)`: the angles of a triangle add up to pi, whatever its shape.
#[test]
fn angles_of_a_triangle_add_up() {
    let model = model("potential p\npsi(angle) = angle");
    let values = values(&model, 3, &[]);
    let modes = [Mode::Jit(Level::Fast), Mode::Interpreter, Mode::HyperDual];
    for mode in modes {
        let compiled = model.compile(&values, mode, Form::Accurate).unwrap();
        let kernel = &compiled.coupled[0];
        let symbols: Vec<&str> = kernel.variables().iter().map(Variable::symbol).collect();
        assert_eq!(symbols, ["a", "l1", "l2", "l3"]);
        // Sides 3, 4, 5 and 13, 14, 15: areas 6 and 84, of which the measure is twice.
        for triangle in [[12.0, 3.0, 4.0, 5.0], [168.0, 13.0, 14.0, 15.0]] {
            let psi = at(kernel, &triangle, &[12.0, 4.0, 3.0, 5.0])[0];
            assert!((psi - std::f64::consts::PI / 3.0).abs() < 1e-15, "{psi}");
        }
    }
}

/// What the simplifier leaves of an energy may be a change alone, or a number.
#[test]
fn variables_are_those_that_are_left() {
    for (energy, symbols, psi) in [
        ("psi(a, l1) = (a/A - 1)^2", &["a"][..], 0.25),
        ("psi(a, l1) = l1 - l1 + 3", &["a"], 3.0),
        ("psi(l1, l2) = (l1/L1 - 1)*(l2/L2 - 1)", &["l1", "l2", "l3"], 0.25),
        ("psi(v, a4) = (v/V - 1)^2*1", &["v"], 0.25),
    ] {
        let model = model(&format!("potential p\n{energy}"));
        let values = values(&model, 3, &[]);
        for mode in [Mode::Jit(Level::Fast), Mode::Interpreter, Mode::HyperDual] {
            let compiled = model.compile(&values, mode, Form::Accurate).unwrap();
            let kernel = &compiled.coupled[0];
            let found: Vec<&str> = kernel.variables().iter().map(Variable::symbol).collect();
            assert_eq!(found, symbols, "{energy}");
            let n = symbols.len();
            assert_eq!(at(kernel, &vec![1.5; n], &vec![1.0; n])[0], psi, "{energy}");
        }
    }
}

#[test]
fn what_parameters_make_zero_is_dropped() {
    let text = "potential p\nparameter c\nparameter k = 1\npsi(angle) = c*(angle - Angle)^2
psi(a, l1) = k*(a/A - l1/L1)^2";
    let model = model(text);
    let given = values(&model, 2, &[("c", 0.0)]);
    let compiled = model.compile(&given, Mode::Interpreter, Form::Accurate).unwrap();
    assert_eq!(compiled.dropped[0].reason, "psi(angle) is dropped: c = 0");
    assert_eq!(compiled.coupled[0].variables().len(), 4, "the area and, in turn, all sides");
    let nothing = values(&model, 2, &[("c", 0.0), ("k", 0.0)]);
    let compiled = model.compile(&nothing, Mode::Interpreter, Form::Accurate).unwrap();
    assert!(compiled.coupled.is_empty());
}
