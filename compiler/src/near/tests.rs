use super::beyond::beyond;
use super::exact::Number;
use super::side::{Side, varying};
use super::{COEFFICIENTS, is_measure, near_rest, vanishes_at_rest};
use crate::expression::interpret::Interpreter;
use crate::expression::number::Number as _;
use crate::expression::precise::Precise;
use crate::expression::{Function, Input};
use crate::kernel::{Batch, Mode};
use crate::measure::Measure;
use crate::simplify::Simplifier;
use crate::specialise::{Form, energy, known};
use crate::test_support::{model, values};
use crate::verify::UNIT_ROUNDOFF;

const L: Measure = Measure::Length;

/// `psi(l) = text` with all digits of its numbers.
fn exact(text: &str) -> (Simplifier, crate::expression::NodeId) {
    let model = model(&format!("potential p\npsi(l) = {text}"));
    let values = values(&model, 3, &[]);
    let variant = model.variant(3).unwrap();
    let made = energy(variant, model.parameters(), L, &known(&values), &mut Vec::new());
    let energy = made.unwrap().unwrap();
    (energy.graph, energy.psi)
}

/// `phi(d)` less its first terms, of as many digits as numbers have.
fn true_remainder(function: Function, d: f64, j: usize) -> f64 {
    type Many = crate::expression::real::Real<1024>;
    let d = Many::from(d);
    let fraction = |p: i32, q: i32| Many::from(p) / Many::from(q);
    let (value, terms) = match function {
        Function::Exp => (d.exp(), [1, 1, 2, 6, 24].map(|k| fraction(1, k))),
        Function::Ln => {
            (d.ln_1p(), [(0, 1), (1, 1), (-1, 2), (1, 3), (-1, 4)].map(|(p, q)| fraction(p, q)))
        }
        Function::Sqrt => {
            let root = (Many::from(1) + &d).sqrt();
            (root, [(1, 1), (1, 2), (-1, 8), (1, 16), (-5, 128)].map(|(p, q)| fraction(p, q)))
        }
        Function::Sin => {
            (d.sin(), [(0, 1), (1, 1), (0, 1), (-1, 6), (0, 1)].map(|(p, q)| fraction(p, q)))
        }
        Function::Sinh => {
            (d.sinh(), [(0, 1), (1, 1), (0, 1), (1, 6), (0, 1)].map(|(p, q)| fraction(p, q)))
        }
        Function::Cos => {
            (d.cos(), [(1, 1), (0, 1), (-1, 2), (0, 1), (1, 24)].map(|(p, q)| fraction(p, q)))
        }
        Function::Cosh => {
            (d.cosh(), [(1, 1), (0, 1), (1, 2), (0, 1), (1, 24)].map(|(p, q)| fraction(p, q)))
        }
        Function::Tanh => {
            (d.tanh(), [(0, 1), (1, 1), (0, 1), (-1, 3), (0, 1)].map(|(p, q)| fraction(p, q)))
        }
        Function::Atan => {
            (d.atan(), [(0, 1), (1, 1), (0, 1), (-1, 3), (0, 1)].map(|(p, q)| fraction(p, q)))
        }
        Function::Erf => {
            let slope = Many::from(0).error_slope();
            let terms = [(0, 1), (1, 1), (0, 1), (-1, 3), (0, 1)];
            (d.error_function(), terms.map(|(p, q)| &slope * fraction(p, q)))
        }
        _ => (d.asin(), [(0, 1), (1, 1), (0, 1), (1, 6), (0, 1)].map(|(p, q)| fraction(p, q))),
    };
    let (mut rest, mut power) = (value, Many::from(1));
    for term in terms.iter().take(j) {
        rest = rest - term * &power;
        power = power * &d;
    }
    rest.to_f64()
}

#[test]
fn remainders_of_functions_have_their_digits_at_every_argument() {
    let all = [
        (Function::Exp, 5, 30.0),
        (Function::Ln, 5, 30.0),
        (Function::Sqrt, 5, 30.0),
        (Function::Sin, 5, 6.0),
        (Function::Sinh, 5, 30.0),
        (Function::Cos, 4, 6.0),
        (Function::Cosh, 4, 30.0),
        (Function::Tanh, 5, 30.0),
        (Function::Atan, 5, 30.0),
        (Function::Asin, 5, 0.999),
        (Function::Erf, 5, 6.0),
    ];
    for (function, last, largest) in all {
        for j in 1..=last {
            let mut graph = Simplifier::new();
            let d = graph.input(Input::Change(L)).unwrap();
            let root = beyond(&mut graph, function, d, j).unwrap();
            let mut worst: f64 = 0.0;
            for k in 0..400 {
                // From 1e-9, so that the powers of what is left are no subnormal numbers.
                let size = largest * libm::pow(10.0, -f64::from(k) / 40.0);
                for at in [size, -size] {
                    if at <= -1.0 && matches!(function, Function::Ln | Function::Sqrt) {
                        continue;
                    }
                    let mut interpreter = Interpreter::<f64>::new();
                    interpreter.run(graph.graph(), |_| at);
                    let (found, expected) =
                        (interpreter.number(root), true_remainder(function, at, j));
                    worst = worst.max(((found - expected) / expected).abs() / UNIT_ROUNDOFF);
                }
            }
            // Beyond the edge of a polynomial a difference is left that loses a digit or so.
            assert!(worst < 24.0, "{function:?} beyond order {j}: {worst} u");
        }
    }
}

#[test]
fn coefficients_are_those_of_true_derivatives() {
    let laws = [
        "L*exp(sin(l/L))",
        "L*(l/L)^0.37*ln(2 + l/L)",
        "L*tanh(l/L)/(1 + atan(l/L))",
        "L*sqrt(1 + (l/L)^3)*cosh(l/L)",
        "L*erf(l/L/2)*erf(l/L + 1)",
        "L*atan2(l/L, 3 - l/L)",
        "L*atan2(l/L, 1 - l/L)*atan2(-1, -l/L)",
        "L*asin(l/L/3)^2",
        "L*acos(l/L/3)*cos(l/L)",
        "L*sinh(l/L)^(l/L)",
        "L*(2 - l/L)^-7 + L*(l/L)^20",
        "L*tan(l/L/2)*log1p(l/L)*expm1(l/L)",
        "L*max(exp(l/L), 2*l/L)*abs(l/L - 4)",
    ];
    for law in laws {
        let (graph, psi) = exact(law);
        let mut target = Simplifier::new();
        let varies = varying(graph.graph(), |node| is_measure(node, L));
        let needed = graph.graph().reachable(&[psi]);
        let mut side = Side::new(graph.graph(), &mut target, (L, 1), &varies, COEFFICIENTS[0]);
        side.lower(&needed).unwrap();
        let sum = side.sum_of(psi).unwrap();
        let id = side.id_of(&sum).unwrap();
        // At L = 1 a derivative by l is one by e.
        let mut interpreter = Interpreter::<Precise<256>>::new();
        interpreter.run(graph.graph(), |input| match input {
            Input::Current(_) => Precise::variable(1.0),
            Input::Reference(_) => Precise::constant(1.0),
            _ => Precise::line(0.0, 1.0, 0.0),
        });
        let found = interpreter.number(psi);
        for (k, expected) in found.parts().unwrap().iter().enumerate() {
            let [term] = side.nodes[id].series[k].as_slice() else { panic!("{law}: one term") };
            let factorial = Number::from([1, 1, 2][k]);
            let error = (&term.exact.value * &factorial - expected).size();
            let size = expected.magnitude().unwrap();
            let left = error.magnitude().map_or(-256, |own| own - size);
            assert!(left < -220, "{law}: coefficient {k} is off by 2^{left} of it");
        }
    }
}

#[test]
fn what_cancels_is_found_to_be_nothing() {
    for law in ["L*(exp(l/L) - exp(1))", "L*(1/3*(l/L)^3 - l/L + 2/3)", "L*ln(l/L)*exp(-L/delta)"] {
        let (graph, psi) = exact(law);
        assert!(vanishes_at_rest(graph.graph(), psi, L).unwrap(), "{law}");
    }
    let (graph, psi) = exact("L*(exp(l/L) - 2.718281828459045)");
    assert!(!vanishes_at_rest(graph.graph(), psi, L).unwrap(), "no double is e");
    let (graph, psi) = exact("L*exp(-300*l/L)");
    assert!(!vanishes_at_rest(graph.graph(), psi, L).unwrap(), "what is small is not nothing");
}

/// How many forms a law has near rest: none, one for both sides, or one for each.
fn n_forms(law: &str) -> usize {
    let (graph, psi) = exact(law);
    let mut target = Simplifier::new();
    let forms = near_rest(graph.graph(), &[psi], L, &mut target).unwrap();
    match &forms[0].sides {
        [Some(right), Some(left)] => 1 + usize::from(right.root != left.root),
        [None, None] => 0,
        _ => 1,
    }
}

#[test]
fn kinks_have_a_form_on_either_side() {
    assert_eq!(n_forms("L*(exp(l/L) - 1)"), 1);
    assert_eq!(n_forms("L*max(exp(l/L) - exp(1), 0)^2"), 2);
    assert_eq!(n_forms("L*abs(sin(l/L) - sin(1))^2.5"), 2);
    assert_eq!(n_forms("L*(erf(l/L) - erf(1))^2"), 1);
    assert_eq!(n_forms("L*(atan2(l, L) - atan2(1, 1))^2"), 1);
    // The cut begins at rest.
    assert_eq!(n_forms("L*atan2(1 - l/L, -1)"), 2);
    // The same root on both sides.
    assert_eq!(n_forms("L*sqrt((l/L - 1)^2 + (l/L - 1)^4)"), 1);
    // Infinite at rest.
    assert_eq!(n_forms("L/abs(l/L - 1)"), 0);
}

/// psi, psi' and psi'' at strains, of a bond of length 1.
fn found(text: &str, strains: &[f64]) -> [Vec<f64>; 3] {
    let model = model(&format!("potential p\npsi(l) = {text}"));
    let compiled = model.compile(&values(&model, 3, &[]), Mode::Interpreter, Form::Accurate);
    let current: Vec<f64> = strains.iter().map(|e| 1.0 + e).collect();
    let reference = vec![1.0; strains.len()];
    let batch = Batch { measure: &current, reference: &reference, change: strains, fields: &[] };
    let out = compiled.unwrap().kernels[0].derivatives(batch);
    [out.psi, out.dpsi, out.d2psi]
}

/// psi'' of `f(abs(e))` with `f'(0) = 0` is `f''(0)`, at rest and on both sides of it.
#[test]
fn stiffness_at_rest_is_that_beside_it() {
    let [_, force, stiffness] = found(
        "((0.012 + abs(ln(l/L)))^1.25 - 0.012^1.25)/1.25 - 0.012^0.25*abs(ln(l/L))",
        &[-1e-12, 0.0, 1e-12],
    );
    let expected = 0.25 * libm::pow(0.012, -0.75);
    assert!(stiffness.iter().all(|x| (x / expected - 1.0).abs() < 1e-8), "{stiffness:?}");
    assert_eq!(force[1], 0.0);
}

/// A product of factors whose first-order terms nearly cancel, in the buffered 14-7 potential.
#[test]
fn products_that_cancel_at_first_order_keep_their_digits() {
    let text = "(1.07/(l/L + 0.07))^7*(1.12/((l/L)^7 + 0.12) - 2) + 1";
    let strains = [1e-2, -1e-3, 3e-6, -1e-8, 1e-12];
    let [psi, ..] = found(text, &strains);
    let (source, root) = exact(text);
    for (psi, strain) in psi.iter().zip(strains) {
        let mut interpreter = Interpreter::<Precise<256>>::new();
        interpreter.run(source.graph(), |input| match input {
            Input::Current(_) => Precise::line(strain, 1.0, 1.0),
            Input::Change(_) => Precise::variable(strain),
            _ => Precise::variable(1.0),
        });
        let truth = interpreter.number(root).rounded()[0];
        let error = (psi / truth - 1.0).abs() / UNIT_ROUNDOFF;
        assert!(error < 64.0, "{error} u at {strain}");
    }
}
