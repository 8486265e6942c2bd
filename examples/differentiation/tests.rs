//! Measured errors, and the numbers they are measured with.

use piola_compiler::verify::sample::Point;

use crate::methods::{Energy, Method, complex, double, hyper_complex, hyper_dual};
use crate::study::{Line, panels};

/// Half the distance from 1 to the next number: medians below it are those of one rounding or two.
const U: f64 = f64::EPSILON / 2.0;

/// The error at the value nearest to this one.
fn error_at(line: &Line, value: f64) -> f64 {
    let distance = |x: f64| libm::log(x / value).abs();
    line.errors.iter().min_by(|p, q| distance(p.0).total_cmp(&distance(q.0))).unwrap().1
}

fn line<'a>(lines: &'a [Line], name: &str) -> &'a Line {
    lines.iter().find(|line| line.name == name).unwrap_or_else(|| panic!("no line {name}"))
}

/// What is expected may be missed by a factor 3: where errors are rounding they scatter so from one
/// step to the next. `None` stands for at most `1.5 u`.
fn expect(lines: &[Line], name: &str, best: Option<f64>, errors: &[(f64, Option<f64>)]) {
    let check = |what: String, found: f64, expected: Option<f64>| {
        let right = match expected {
            Some(error) => found <= 3.0 * error && found >= error / 3.0,
            None => found <= 1.5 * U,
        };
        assert!(right, "{name}, {what}: {found:e}, expected {expected:?}");
    };
    let line = line(lines, name);
    check("best".to_string(), line.best().0, best);
    for &(value, error) in errors {
        check(format!("at {value:e}"), error_at(line, value), error);
    }
}

#[test]
fn methods_err_as_much_as_their_kind_must() {
    let [first, second, of_gradient, strain] = panels().unwrap().map(|panel| panel.lines);

    let steps = [1e-2, 1e-4, 1e-8, 1e-12];
    let at = |errors: [Option<f64>; 4]| steps.into_iter().zip(errors).collect::<Vec<_>>();
    let truncated = |error: f64| at([Some(error), Some(error * 1e-4), None, None]);
    let forward = at([Some(3e-3), Some(3e-5), Some(1e-8), Some(8e-5)]);
    expect(&first, "forward differences", Some(8e-9), &forward);
    let central = at([Some(8e-6), Some(8e-10), Some(5e-9), Some(9e-5)]);
    expect(&first, "central differences", Some(9e-12), &central);
    expect(&first, "complex step", None, &truncated(8e-6));
    expect(&first, "double numbers", None, &truncated(8e-6));
    expect(&first, "hyper-complex", None, &truncated(3e-5));
    for exact in ["hyper-dual", "symbolic, no step"] {
        expect(&first, exact, None, &at([None; 4]));
    }

    let steps = [1e-2, 1e-4, 1e-6];
    let at = |errors: [f64; 3]| steps.into_iter().zip(errors.map(Some)).collect::<Vec<_>>();
    expect(&second, "forward differences", Some(9e-6), &at([1e-2, 1e-4, 5e-4]));
    expect(&second, "central differences", Some(1e-8), &at([1e-5, 2e-8, 9e-5]));
    expect(&second, "complex step", Some(2e-8), &at([1e-5, 2e-8, 2e-4]));
    expect(&second, "double numbers", Some(2e-8), &at([1e-5, 3e-8, 2e-4]));
    expect(&second, "hyper-complex, split", Some(1.5e-8), &[]);
    expect(&second, "hyper-complex", None, &at([5e-5, 5e-9, 5e-13]));
    expect(&second, "hyper-dual", None, &[1e-1, 1e-8, 1e-20, 1e-150].map(|h| (h, None)));
    // The square of the step is not a number of full precision any more, and then zero.
    for name in ["hyper-complex", "hyper-dual"] {
        expect(&second, name, None, &[(1e-150, None), (1e-160, Some(5e-4))]);
        assert_eq!(error_at(line(&second, name), 1e-170), f64::INFINITY);
    }
    let gradient = at([2.5e-5, 2.5e-9, 1e-10]);
    expect(&of_gradient, "central differences", Some(1.4e-11), &gradient);
    let gradient = at([2e-5, 2.5e-9, 2.5e-13]);
    expect(&of_gradient, "complex step", None, &gradient);
    expect(&of_gradient, "symbolic, no step", None, &[]);

    // Near rest exact derivatives of an energy that has lost its digits have lost them too.
    for name in ["hyper-dual, textbook psi", "symbolic, textbook form"] {
        for exponent in [2, 4, 6, 8, 10, 12] {
            let strain_here = libm::pow(10.0, -f64::from(exponent));
            let units = error_at(line(&strain, name), strain_here) * strain_here / U;
            assert!((0.2..20.0).contains(&units), "{name} at {strain_here:e}: {units} u/strain");
        }
    }
    for name in ["hyper-dual, rewritten psi", "symbolic, accurate form"] {
        for (strain, error) in &line(&strain, name).errors {
            assert!(*error <= 8.0 * U, "{name} at {strain:e}: {error:e}");
        }
    }
}

/// The functions that the energy of the study does not have.
#[test]
fn numbers_differentiate_powers_and_exponentials() {
    let psi = "-exp(-l/L)*sqrt(l/L) + (l/L)^(-3/2)/(2 - l/L) + ln(l/L)";
    let text = format!("potential mixed\nparameter C1 = 1\npsi(l) = C1*({psi})\n");
    let energy = Energy::new(&text, &[]).unwrap();
    let at = Point { measure: 1.3, reference: 0.9 };
    let [dpsi, ddpsi] = hyper_dual(&energy, at, 1.0);
    let methods: [(Method, bool); 3] = [(complex, false), (double, false), (hyper_complex, true)];
    for (method, has_second) in methods {
        let [first, second] = method(&energy, at, 1e-20);
        assert!((first - dpsi).abs() <= 1e-14 * dpsi.abs(), "{first} {dpsi}");
        assert!(!has_second || (second - ddpsi).abs() <= 1e-14 * ddpsi.abs(), "{second} {ddpsi}");
        let [_, second] = method(&energy, at, 1e-4);
        assert!((second - ddpsi).abs() <= 1e-5 * ddpsi.abs(), "{second} {ddpsi}");
    }
}
