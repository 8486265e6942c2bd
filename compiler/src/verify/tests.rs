//! Derivatives of the Seth-Hill family and of one energy per function, against hyper-dual numbers.

use super::{Miss, Outcome, verify};
use crate::expression::Function;
use crate::measure::Measure;
use crate::print::text;
use crate::test_support::{SETH_HILL, model, values};
use crate::{Batch, Form, Mode};

#[test]
fn seth_hill_over_its_exponents() {
    let model = model(SETH_HILL);
    for n in [-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 2.7, 4.0, 10.0] {
        for d in [2, 3] {
            let values = values(&model, d, &[("C1", 1.5), ("C2", 40.0), ("C3", 7.0), ("n", n)]);
            let (found, dropped) = verify(&model, &values, 200).unwrap();
            // Even energies are verified by squares as well.
            let squares = match ([-2.0, 2.0, 4.0, 10.0].contains(&n), d) {
                (false, _) => 0,
                (true, 2) => 1,
                (true, _) => 2,
            };
            assert_eq!(found.len(), squares + if d == 3 { 3 } else { 2 });
            assert_eq!(dropped.len(), if d == 3 { 0 } else { 1 });
            for v in found {
                assert!(v.n_places > 300, "{}", v.n_places);
                assert!(v.different_bits == 0, "n = {n}: {:?}", v.different_bits);
                let shown = &v.misses[..v.misses.len().min(3)];
                assert!(v.passed(), "n = {n}, {:?}: {:?} {shown:#?}", v.subject, v.errors);
            }
        }
    }
}

#[test]
fn every_function_has_the_right_derivatives() {
    for function in Function::all_named() {
        let argument = match function {
            Function::Asin | Function::Acos => "l/(l + L)",
            Function::Sign | Function::Abs => "l/L - 1.5",
            _ => "l/L",
        };
        let text = format!(
            "potential p\ndomain l/L in (0.1, 10)\npsi(l) = L*({}({argument}) + (l/L)^2)",
            function.name()
        );
        let model = model(&text);
        let (found, _) = verify(&model, &values(&model, 3, &[]), 200).unwrap();
        assert!(
            found[0].passed(),
            "{text}\n{:#?}",
            &found[0].misses[..found[0].misses.len().min(3)]
        );
    }
}

#[test]
fn conditions_extremes_and_powers_have_the_right_derivatives() {
    for energy in [
        "if l > L then (l/L - 1)^2 else (l/L - 1)^4",
        "min(l/L, 2)^3",
        "max(l/L, 0.5, L)^2",
        "(l/L)^(l/L)",
        "if l > L and not (l > 2*L) or l < L/2 then l^2 else l^3",
        "(l/L)^C",
        "abs(l/L)^2.5",
        "exp(-L)*(l - L)*L",
        "exp(-L/l)*(l - L)^2",
        "exp(-l/L)*(l/L - 1)",
        "(erf(l/L) - erf(1))^2",
        "erf(C*(l/L - 1))*(l/L)^2",
        "(atan2(l, L) - pi/4)^2",
        "atan2(l/L - 1, 0.3)^2 + atan2(-l, L - 2*l)",
        "atan2(0.3, l/L - 1)*l/L",
    ] {
        let text =
            format!("potential p\nparameter C = 1.5\ndomain l/L in (0.1, 10)\npsi(l) = {energy}");
        let model = model(&text);
        let (found, _) = verify(&model, &values(&model, 3, &[]), 200).unwrap();
        assert!(
            found[0].passed(),
            "{text}\n{:#?}",
            &found[0].misses[..found[0].misses.len().min(3)]
        );
    }
}

/// A wrong derivative must be found: here the energy as written differs from the compiled one.
#[test]
fn a_wrong_derivative_is_found() {
    let (right, wrong) = ("(l/L - 1)^2", "(l/L - 1)^2 + 1e-3*(l/L)^3");
    let model = model(&format!(
        "potential p\nparameter k = 0\npsi(l) = if k > 0 then {wrong} else {right}"
    ));
    let good = values(&model, 3, &[]);
    let bad = values(&model, 3, &[("k", 1.0)]);
    let kernel = &model
        .compile(&good, crate::Mode::Jit(crate::Level::Strict), Form::Accurate)
        .unwrap()
        .kernels[0];
    let point = super::sample::Point { measure: 1.5, reference: 1.0 };
    let out = kernel.derivatives(super::Columns::new(&[point]).batch());
    let subject = super::Subject::Argument(crate::Argument::Measure(crate::Measure::Length));
    let mut found = super::Verification::new(subject, &[(super::Witness::HyperDual, 1.0)]);
    let written = model.written(&bad, crate::Measure::Length);
    let expected = written.derivatives(1.5, 1.0);
    super::measure::compare(
        &mut found,
        &written,
        point,
        [out.psi[0], out.dpsi[0], out.d2psi[0]],
        expected.into(),
    );
    found.n_places = 1;
    assert_eq!(found.misses.len(), 3);
    assert_eq!(found.outcome(), Outcome::Wrong);
}

/// So small an error might be rounding as well: it does not pass, and is not called wrong.
#[test]
fn an_error_below_a_millionth_is_found_too() {
    let text = |psi: &str| format!("potential p\npsi(l) = {psi}");
    let right = model(&text("(l/L - 1)^2"));
    let wrong = model(&text("(l/L - 1)^2 + 1e-9*(l/L)^3"));
    let of = |model: &crate::Model| model.written(&values(model, 3, &[]), Measure::Length);
    let point = super::sample::Point { measure: 1.5, reference: 1.0 };
    let [compiled, expected] = [of(&right), of(&wrong)]
        .map(|written| <[f64; 3]>::from(written.derivatives(point.measure, point.reference)));
    let subject = super::Subject::Argument(crate::Argument::Measure(Measure::Length));
    let mut found = super::Verification::new(subject, &[(super::Witness::HyperDual, 1.0)]);
    found.n_places = 1;
    super::measure::compare(&mut found, &of(&wrong), point, compiled, expected);
    assert_eq!(found.misses.len(), 3);
    assert_eq!(found.outcome(), Outcome::DigitsLost);
}

/// Far from rest terms of psi'' cancel: hyper-dual numbers of the energy as written lose the same digits.
#[test]
fn digits_that_are_lost_are_no_wrong_derivative_and_their_cause_is_named() {
    let text = "potential p\npsi(l) = 0.85*L*(l/L - 1)^2/(1 + ((l/L - 1)/0.05)^2)\n\
                domain l/L in [0.2, 10]";
    let model = model(text);
    let (found, _) = verify(&model, &values(&model, 3, &[]), 500).unwrap();
    assert_eq!(found[0].outcome(), Outcome::DigitsLost, "{:?}", found[0].errors);
    let [cause] = &found[0].causes[..] else { panic!("{:?}", found[0].causes) };
    assert!(cause.order == 2 && cause.cancelled.unwrap() > 2.0, "{cause:?}");
    let fewest = found[0].misses.iter().map(|miss| miss.digits()).fold(16.0, f64::min);
    assert!((10.0..14.0).contains(&fewest), "{fewest}");
}

/// What the text states is named by its place there, for energies of F and of gathered values.
#[test]
fn causes_are_named_in_the_words_of_the_text() {
    let named = |text: &str, cause: &super::Cause| {
        let stated = cause.stated?;
        Some((stated.part, text[stated.span.range()].to_string()))
    };
    let lost = "(sqrt(tr(C)^2 + 1) - tr(C))";
    let text = format!("potential p\ndimensions 2\ns = {lost}\npsi(F) = 3*s");
    let model = model(&text);
    let values_2d = values(&model, 2, &[]);
    let settings = crate::audit::Settings {
        form: crate::Form::Accurate,
        level: crate::Level::Strict,
        points: 1,
        bar: 64.0,
    };
    let found = crate::audit::lost(&model, &values_2d, &settings).unwrap();
    let names: Vec<_> =
        found.iter().map(|lost| (lost.cause.order, named(&text, &lost.cause))).collect();
    let words = lost[1..lost.len() - 1].to_string();
    assert!(names.contains(&(0, Some((super::Part::Whole, words.clone())))), "{names:?}");
    assert!(names.contains(&(1, Some((super::Part::Derivative, words)))), "{names:?}");
    assert!(found.iter().all(|lost| lost.error > 64.0));

    let text = "potential p\ns = integral(l)\npsi(s) = 2*(sqrt(s^2 + 1) - s)";
    let model = crate::test_support::model(text);
    let values = values(&model, 3, &[]);
    let form = model.specialise_gathered(&values, false, crate::Form::Accurate).unwrap().0.unwrap();
    for (order, part) in [(0, super::Part::Whole), (1, super::Part::Derivative)] {
        let at = (&[1e6][..], &[1.0][..], None);
        let cause = super::stated::cause_of_gathered((&model, &values), &form, order, at).unwrap();
        assert_eq!(named(text, &cause), Some((part, "sqrt(s^2 + 1) - s".to_string())), "{cause:?}");
        assert!(cause.cancelled.unwrap() > 11.0, "{cause:?}");
    }
}

/// Margins and next states of gradients and of gathered numbers, too.
#[test]
fn causes_are_found_in_functions_of_families() {
    let lost = "sqrt(x^2 + 1) - x";
    let settings = crate::audit::Settings {
        form: crate::Form::Accurate,
        level: crate::Level::Strict,
        points: 1,
        bar: 64.0,
    };
    for (x, energy) in
        [("J", "psi(F) = exp(-k)*(E : E)"), ("e", "e = integral(l/L - 1)\npsi(e) = exp(-k)*e^2")]
    {
        let lost = lost.replace('x', x);
        let condition = format!("3*({lost}) > 1");
        let update = format!("max(k, {lost})");
        let text = format!(
            "potential p\nstate k = 0\n{energy}\nupdate k = {update}\nbreak when {condition}"
        );
        let model = model(&text);
        let found = crate::audit::lost(&model, &values(&model, 2, &[]), &settings).unwrap();
        for subject in [format!("the margin of `{condition}`"), format!("update k = {update}")] {
            let own: Vec<_> = found.iter().filter(|lost| lost.subject() == subject).collect();
            let [one] = own[..] else { panic!("{subject} in {found:#?}") };
            let stated = one.cause.stated.unwrap();
            assert_eq!(text[stated.span.range()], lost, "{one:?}");
            assert!(one.cause.cancelled.unwrap() > 1.0 && one.error > 64.0, "{one:?}");
        }
    }
}

/// `cosh` is infinite at 711, and so is what hyper-dual numbers make of it; the energy is not.
#[test]
fn where_the_witness_overflows_numbers_of_any_precision_decide() {
    let model = model("potential p\npsi(l) = L/cosh(20*(l/L - 1))\ndomain l/L in (0, 30)");
    let (found, _) = verify(&model, &values(&model, 3, &[]), 500).unwrap();
    assert!(found[0].undecided > 0, "{found:?}");
    assert_ne!(found[0].outcome(), Outcome::Wrong, "{:?}", found[0].errors);
}

#[test]
fn a_value_that_is_no_number_is_found() {
    for (x, y, found) in [
        (f64::INFINITY, 1.0, true),
        (1.0, f64::NAN, true),
        (f64::NAN, 1.0, true),
        (f64::INFINITY, f64::NAN, false),
        (1.0, 1.0, false),
    ] {
        assert_eq!(
            super::measure::error_over_tolerance(x, y, f64::INFINITY) > 1.0,
            found,
            "{x} {y}"
        );
    }
}

#[test]
fn what_overflows_has_no_digits_left_and_is_not_wrong() {
    let miss = |compiled: f64, expected: f64| Miss {
        place: vec![2.0, 1.0],
        order: 0,
        compiled: vec![compiled],
        expected: vec![expected],
        tolerance: 0.0,
        is_wrong: Miss::is_far_off(compiled, expected),
    };
    for [compiled, expected] in [[f64::INFINITY, 1e300], [f64::NAN, 1.0], [1e300, f64::INFINITY]] {
        let miss = miss(compiled, expected);
        assert!(!miss.is_wrong, "{compiled} for {expected}");
        assert_eq!((miss.relative_error(), miss.digits()), (f64::INFINITY, 0.0));
    }
    assert!(miss(1.00001, 1.0).is_wrong && miss(1.0, 0.0).is_wrong);
    assert!(!miss(1.0000001, 1.0).is_wrong);
}

/// Next states of bonds, of gradients and of points that pass the largest double, on the way to numbers beyond it:
/// nothing is expected there, and what follows from them is not wrong.
#[test]
fn a_next_state_beyond_doubles_decides_nothing() {
    let beyond = |x: &str| format!("update k = max(k, exp(800*({x})) - exp(799*({x})))");
    let of = |text: String| {
        let model = model(&format!("potential p\nstate k = 0\n{text}"));
        verify(&model, &values(&model, 2, &[]), 1000).unwrap().0
    };
    let lengths = format!("{}\npsi(l) = L*(l/L - 1)^2/(1 + k)", beyond("l/L - 1"));
    let gradients = format!("{}\npsi(F) = exp(-k)*(E : E)", beyond("F : F - 2"));
    let points = format!("e = integral(l/L - 1)\n{}\npsi(e) = exp(-k)*e^2", beyond("e^2"));
    for text in [lengths, gradients, points] {
        let found = of(text.clone());
        assert!(found.iter().any(|one| matches!(one.subject, super::Subject::NextState(..))));
        for one in found {
            assert_ne!(one.outcome(), Outcome::Wrong, "{text}: {one:?}");
            let told = |miss: &Miss| miss.expected[0].is_finite() && miss.tolerance.is_finite();
            assert!(one.misses.iter().all(told), "{text}: {one:?}");
        }
    }
}

/// Off by a thousandth: here the energy as written has another coefficient than the compiled one.
#[test]
fn a_wrong_load_step_is_found() {
    use super::consistent::{Following, compare, kernels};
    let model = model(
        "potential p\nparameter C\nstate k = 0\nupdate k = max(k, l/L - 1)\n\
         psi(l) = C*L*(l/L - 1)^2/(1 + k)",
    );
    let of = |c: f64| {
        let mut following = values(&model, 3, &[("C", c)]).following_states(&model);
        let dt = usize::from(model.number_of_time_step().unwrap());
        following.parameters[dt] = 1.0;
        following
    };
    let (right, wrong, measure) = (of(1.0), of(1.001), Measure::Length);
    let variant = model.variant(3).unwrap();
    let points = super::sample::points(variant, measure, &right, 50);
    let kernels = kernels(&model, measure, &wrong).unwrap().unwrap();
    let witness = Following::new((&model, variant), measure, &right, &points).unwrap();
    let bar = [(super::Witness::HyperDual, 64.0)];
    let found = super::Verification::new(super::Subject::Following(measure), &bar);
    let found = compare(found, &kernels, &witness, &points);
    assert_eq!(found.outcome(), Outcome::Wrong);
    let wrong = |order: usize| found.misses.iter().any(|miss| miss.order == order && miss.is_wrong);
    assert!((0..3).all(wrong), "{:?}", found.errors);
}

/// Hyper-dual numbers of a quotient by 1e200 have no psi', which it has: what is right passes there. Its tangent is
/// `2/(L*k) - 2*(l/L - 1)/k^2*dk/dl`, of which the second part may underflow.
#[test]
fn load_steps_are_held_against_numbers_of_any_precision_too() {
    let model = model(
        "potential p\nstate k = 0\nupdate k = max(k, 1e200*(l/L))\n\
         psi(l) = L*(l/L - 1)^2/(1 + k)\ndomain l/L in [0.5, 2]",
    );
    let (found, _) = verify(&model, &values(&model, 2, &[]), 200).unwrap();
    let is_followed =
        |one: &&super::Verification| matches!(one.subject, super::Subject::Following(_));
    let followed = found.iter().find(is_followed).unwrap();
    assert!(followed.undecided > 100, "{followed:?}");
    assert_ne!(followed.outcome(), Outcome::Wrong, "{followed:?}");
    for miss in &followed.misses {
        let (l, rest) = (miss.place[0], miss.place[1]);
        let tangent = 2e-200 * rest / (l * l);
        assert!(miss.order == 2 && (miss.expected[0] / tangent - 1.0).abs() < 1e-12, "{miss:?}");
    }
}

#[test]
fn derivatives_read_as_one_would_write_them() {
    let model = model(SETH_HILL);
    let values = values(&model, 2, &[("C1", 3.0)]);
    let specialised = model.specialise(&values).unwrap();
    assert_eq!(specialised.energies.len(), 1, "C2 = C3 = 0 leave the bonds alone");
    assert_eq!(
        text(&model, &specialised.energies[0]),
        "psi(l) = 1.5*L*(l/L - 1)^2\npsi'(l) = 3*(l/L - 1)\npsi''(l) = 3/L\n"
    );
    let text_of = |n: f64| {
        let values = crate::test_support::values(&model, 2, &[("C1", 1.0), ("n", n)]);
        text(&model, &model.specialise(&values).unwrap().energies[0])
    };
    assert_eq!(
        text_of(2.0),
        "t1 = 0.5*((l/L - 1)*(1 + l/L))\npsi(l) = 0.5*L*t1^2\npsi'(l) = l/L*t1\n\
         psi''(l) = (-0.5 + 1.5*(l/L)^2)/L\n"
    );
    assert_eq!(
        text_of(0.0),
        "t1 = if abs(l/L - 1) < 0.5 then log1p(l/L - 1) else ln(l/L)\npsi(l) = 0.5*L*t1^2\n\
         psi'(l) = (l/L)^-1*t1\npsi''(l) = (l/L)^-2*(1 - t1)/L\n"
    );
}

#[test]
fn rounding_that_the_energy_itself_magnifies_is_no_failure_and_errors_still_are() {
    let model = model("potential p\nparameter D = 1\npsi(l) = D*L*(1 - exp(-3*(l/L - 1)))^2");
    let values = values(&model, 3, &[]);
    // The default domain goes far out, to psi'' of 1e-76 and less.
    let (found, _) = verify(&model, &values, 1000).unwrap();
    assert!(found[0].passed(), "{:?}", found[0].errors);

    let written = model.written(&values, Measure::Length);
    let far = super::Point { measure: 60.0, reference: 1.0 };
    let expected: [f64; 3] = written.derivatives(far.measure, far.reference).into();
    for order in 0..3 {
        let mut compiled = expected;
        // Derivatives are held against their own size and that of the order below.
        let below = if order == 0 { 0.0 } else { expected[order - 1].abs() / far.measure };
        compiled[order] += 1e-11 * (expected[order].abs() + below);
        let mut found = found[0].clone();
        super::measure::compare(&mut found, &written, far, compiled, expected);
        assert_eq!(found.misses.len(), 1, "order {order}");
    }
}

#[test]
fn what_is_dropped_says_which_parameter_did_it() {
    let model = model(SETH_HILL);
    let reasons = |settings: &[(&str, f64)]| -> Vec<String> {
        let specialised = model.specialise(&values(&model, 3, settings)).unwrap();
        specialised.dropped.into_iter().map(|dropped| dropped.reason).collect()
    };
    let both = ["psi(a) is dropped: C2 = 0", "psi(v) is dropped: C3 = 0"];
    assert_eq!(reasons(&[("C1", 1.0)]), both);
    assert_eq!(reasons(&[("C1", 1.0), ("C2", 1.0)]), both[1..]);

    let two = crate::test_support::model(
        "potential p\nparameter k = 0\npsi(l) = l^2 + k*(l - L)^2\npsi(a) = (2*k)*a^2",
    );
    let dropped = two.specialise(&values(&two, 2, &[])).unwrap().dropped;
    assert_eq!(dropped[0].reason, "a term of psi(l) is dropped: k = 0");
    assert_eq!(dropped[1].reason, "psi(a) is dropped: k = 0");
}

/// Products of a power with a strain, for all small orders of both, and energies that rules take for
/// others of their kind when they look less closely: against hyper-dual numbers of what is written.
#[test]
fn rules_keep_the_values_of_what_is_written() {
    let mut energies: Vec<String> = [
        "L*((l/L - 1) + (l/L)^2)^2",
        "L*((l/L)^2 + (l/L - 1))^2",
        "L*ln(1 - (l/L - 1)^2)",
        "L*((l/L)^2 - 1 - 2*ln(l/L))",
        "L*(2*ln(l/L) - (l/L)^2 + 1)",
        "L*((l/L)^2 - 2*(l/L) + 1)",
        "L*((l/L)^2 + 2*(l/L) + 1)",
        "L*(exp(2*(l/L - 1)) + 2*exp(l/L - 1) + 1)",
    ]
    .map(str::to_string)
    .to_vec();
    for p in [-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0] {
        for a in [-2.0, -1.0, 0.5, 1.0, 2.0] {
            for k in [1.0, 2.0, 3.0] {
                energies.push(format!("L*(l/L)^({p:?})*((l/L)^({a:?}) - 1)^{k:?}"));
            }
        }
    }
    for energy in energies {
        let model = model(&format!("potential p\npsi(l) = {energy}\n"));
        let values = values(&model, 3, &[]);
        let written = model.written(&values, Measure::Length);
        let kernels = model.compile(&values, Mode::Interpreter, Form::Accurate).unwrap().kernels;
        for x in [0.3, 0.9, 1.001, 1.3, 1.8] {
            let reference = 0.5;
            let batch = Batch {
                measure: &[x * reference],
                reference: &[reference],
                change: &[x - 1.0],
                fields: &[],
            };
            let found = kernels[0].derivatives(batch);
            let expected = written.derivatives(x * reference, reference);
            let pairs = [
                (found.psi[0], expected.0),
                (found.dpsi[0], expected.1),
                (found.d2psi[0], expected.2),
            ];
            // What is written loses three digits at x - 1 = 1e-3, for each factor.
            let scale = pairs.iter().fold(0.0_f64, |most, (_, x)| most.max(x.abs()));
            for (found, expected) in pairs {
                let close = (found - expected).abs() <= 1e-9 * scale;
                assert!(close, "{energy} at {x}: {found} {expected}");
            }
        }
    }
}

/// Softening areas and yielding volumes: with states held after histories, what these become, and the energy
/// that follows them, all against numbers of the energy as written.
#[test]
fn what_triangles_and_tetrahedra_remember_is_verified() {
    use super::Subject;
    use crate::model::Of;
    let model = model(
        "potential memory\nstate k = 0\nstate p = 0\nstate q = 0\ng = a/A - 1\nh = v/V - 1\n\
         update k = max(k, g)\n\
         update p = if abs(h - p) > 0.05 then h - sign(h - p)*0.05 else p\n\
         update q = (q + dt*(l/L - 1))/(1 + dt)\n\
         left = if k <= 0.1 then 1 else 0.1/k*exp(-(k - 0.1)/0.2)\n\
         psi(l) = 1/2*L*(l/L - 1 - q)^2\npsi(a) = 1/2*A*left*g^2\npsi(v) = 1/2*V*(h - p)^2\n\
         break when k > 1",
    );
    for d in [2, 3] {
        let (found, dropped) = verify(&model, &values(&model, d, &[]), 100).unwrap();
        assert_eq!(dropped.len(), if d == 3 { 0 } else { 1 });
        let all = &Measure::ALL[..d];
        for measure in all {
            let of = |subject: &Subject| match subject {
                Subject::NextState(own, _) => *own == Of::Measure(*measure),
                Subject::Following(own) => own == measure,
                _ => false,
            };
            assert_eq!(found.iter().filter(|one| of(&one.subject)).count(), 2, "{measure:?}");
        }
        for one in found {
            let shown = &one.misses[..one.misses.len().min(3)];
            assert!(one.n_places > 100, "{:?}", one.subject);
            assert!(one.passed(), "{:?} in {d}: {:?} {shown:#?}", one.subject, one.errors);
        }
    }
}

/// Far from rest both of these have their digits; near it the quotient, which is 0/0 at rest, has none, and hyper-dual
/// numbers lose as many.
#[test]
fn gathered_values_are_looked_at_near_rest() {
    let of = |psi: &str| {
        let model = model(&format!("potential p\ns = integral(l/L - 1)\npsi({psi}"));
        let (found, _) = verify(&model, &values(&model, 3, &[]), 40).unwrap();
        (found[0].outcome(), found[0].errors[1])
    };
    for kept in ["s) = exp(s) - 1 - s", "l, s) = s*(l - L - L*ln(l/L))"] {
        let (outcome, near) = of(kept);
        assert_eq!(outcome, Outcome::Passed, "{kept}");
        assert!(near.largest.iter().all(|error| *error > 0.0 && *error < 16.0), "{near:?}");
    }
    for lost in ["s) = (exp(s) - 1)/s - 1 - s/2", "l, s) = L*((exp(s) - 1)/s - 1 - s/2)"] {
        let (outcome, near) = of(lost);
        assert_eq!(outcome, Outcome::DigitsLost, "{lost}");
        assert!(near.largest[0] > 1e6, "{near:?}");
    }
}

/// `tanh` is flat far out, `max(x, 0)^1.5` is 0 on one side with all derivatives, `abs(x)^2.5` is 0 at 0.
#[test]
fn what_is_nothing_somewhere_has_derivatives_there() {
    for psi in ["L*tanh(l/L - 1)^2", "L*max(l/L - 1, 0)^1.5", "L*abs(l/L - 1)^2.5"] {
        let model = model(&format!("potential p\npsi(l) = {psi}"));
        let values = values(&model, 3, &[]);
        let (found, _) = verify(&model, &values, 1000).unwrap();
        assert!(found.iter().all(super::Verification::passed), "{psi}: {:?}", found[0].errors);
        let kernel = &model.compile(&values, Mode::Interpreter, Form::Accurate).unwrap().kernels[0];
        let out = kernel.derivatives(Batch {
            measure: &[0.4, 0.9, 1.0, 2000.0],
            reference: &[1.0; 4],
            change: &[-0.6, -0.1, 0.0, 1999.0],
            fields: &[],
        });
        assert!(out.d2psi.iter().all(|x| x.is_finite()), "{psi}: {:?}", out.d2psi);
    }
}

/// Halves of an energy that are split by a sign add up to the whole at rest, too, in whatever order they are written.
#[test]
fn parts_of_tension_and_compression_have_the_stiffness_of_the_whole_at_rest() {
    let of = |psi: &str| {
        let model = model(&format!("potential p\npsi(F) = {psi}"));
        let values = values(&model, 3, &[]);
        let gradient = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let (direction, mut product) = (gradient, [0.0; 9]);
        for mode in [Mode::Interpreter, Mode::HyperDual] {
            let kernel = model.compile(&values, mode, Form::Accurate).unwrap().gradient.unwrap();
            let at =
                crate::GradientBatch { n: 1, gradient: &gradient, change: &[0.0; 9], fields: &[] };
            kernel.product(at, &direction, &mut product);
            assert!((product[0] - 6.0).abs() < 1e-14, "{psi}: {product:?}");
        }
    };
    for (larger, smaller) in
        [("J - 1, 0", "J - 1, 0"), ("0, J - 1", "J - 1, 0"), ("J - 1, 0", "0, J - 1")]
    {
        of(&format!("max({larger})^2 + min({smaller})^2"));
    }
}
