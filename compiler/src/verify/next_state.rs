//! Which next states are wrong, and which have lost digits to rounding.
//!
//! Hyper-dual numbers of an energy as written tell what it keeps in doubles: two derivatives beside a value are not
//! all near the truth by luck. A next state is one number, which may be. So it is evaluated as written several times,
//! rounded at random, and what lies farthest off the truth tells what rounding may make of it.

use super::{Miss, NEARER};

/// So many evaluations: of terms that cancel, one in four may keep digits by chance.
const SAMPLES: u64 = 16;

/// Whether a next state is far off the truth, and none of the samples is, which are rounded at random and numbered by
/// their seeds. Where a sample is no finite number, doubles keep nothing, and it is not wrong.
pub(super) fn is_wrong(compiled: f64, truth: f64, sample: impl Fn(u64) -> f64) -> bool {
    let error = |value: f64| match value.is_finite() {
        true => (value - truth).abs(),
        false => f64::INFINITY,
    };
    let scatter = || (0..SAMPLES).map(&sample).map(error).fold(0.0, f64::max);
    Miss::is_far_off(compiled, truth) && NEARER * scatter() < error(compiled)
}

#[cfg(test)]
mod tests {
    use super::super::{
        Miss, Outcome, Subject, Verification, Witness, families, gathered, gradient, remember,
    };
    use crate::measure::Measure;
    use crate::model::{Model, Of, OfFamily};
    use crate::point::sample as gradients;
    use crate::test_support::{model, values};
    use crate::values::Values;
    use crate::verify::{sample, verify};
    use crate::{Form, Level, Mode};

    const MODES: [Mode; 3] = [Mode::Jit(Level::Strict), Mode::Jit(Level::Fast), Mode::Interpreter];

    /// Energies that hold the state `k`.
    const OF_GRADIENTS: &str = "psi(F) = exp(-k)*(E : E)";
    const OF_TENSORS: &str = "K = integral(dyad(Xi, Xi))\nH = integral(dyad(xi - Xi, Xi))*inv(K)\n\
                              psi(H) = exp(-k)*((H + H') : (H + H'))";

    /// A potential with a state that becomes this, and more lines.
    fn remembering(next: &str, lines: &str) -> String {
        format!(
            "potential p\nparameter C = 1\nstate k = 0\nallow \"not-objective\"\n{lines}\nupdate k = {next}"
        )
    }

    /// What is left of `cosh - sinh` has no digits far from rest, as written or compiled: nothing is wrong there, and
    /// nothing that follows from it. Traces of functions of `U` are looked at, too.
    #[test]
    fn a_next_state_that_cancels_has_lost_its_digits() {
        let bonds = "psi(l) = L*(l/L - 1)^2/(1 + k)";
        let points = "e = integral(l/L - 1)\npsi(e) = exp(-k)*e^2";
        for (x, lines) in [
            ("80*(l/L - 1)", bonds),
            ("5*(F : F - 2)", OF_GRADIENTS),
            ("20*tr(ln(U)^2)", OF_GRADIENTS),
            ("20*e", points),
            ("40*tr(H)", OF_TENSORS),
        ] {
            let cancels = format!("cosh({x}) - sinh({x})");
            for next in [cancels.clone(), format!("max(k, {cancels})")] {
                let model = model(&remembering(&next, lines));
                let (found, _) = verify(&model, &values(&model, 2, &[]), 20).unwrap();
                let is_next = |one: &&Verification| matches!(one.subject, Subject::NextState(..));
                let own = found.iter().find(is_next).unwrap();
                assert_eq!(own.outcome(), Outcome::DigitsLost, "{next}: {:?}", own.errors);
                let far_off = |miss: &Miss| Miss::is_far_off(miss.compiled[0], miss.expected[0]);
                assert!(own.misses.iter().any(far_off), "{next}: {:?}", own.errors);
                for one in &found {
                    assert_ne!(one.outcome(), Outcome::Wrong, "{next}: {:?}", one.subject);
                }
            }
        }
    }

    /// Near rest a state is its value there and what it changes by, which cancel where it has fallen steeply.
    #[test]
    fn a_next_state_that_falls_steeply_is_not_wrong() {
        for (next, lines) in [
            ("exp(-300*(F : F - 2))", OF_GRADIENTS),
            ("1/exp(300*(F : F - 2))", OF_GRADIENTS),
            ("exp(300*(F : F - 2))/exp(299*(F : F - 2))", OF_GRADIENTS),
            ("exp(-300*e)", "e = integral(l/L - 1)\npsi(e) = exp(-k)*e^2"),
            ("exp(-300*tr(H))", OF_TENSORS),
            ("k/2 + exp(-1000*(H : H))", OF_TENSORS),
        ] {
            let model = model(&remembering(next, lines));
            for d in [2, 3] {
                let (found, _) = verify(&model, &values(&model, d, &[]), 50).unwrap();
                for one in found {
                    assert_ne!(one.outcome(), Outcome::Wrong, "{next}: {:?}", one.subject);
                }
            }
        }
    }

    /// Off by a thousandth: what is written has another coefficient than what is compiled. Large numbers on the way, and
    /// terms of which some digits cancel, hide nothing.
    #[test]
    fn a_wrong_next_state_is_found() {
        for (x, lines) in [
            ("l/L - 1", "psi(l) = L*(l/L - 1)^2/(1 + k)"),
            ("F : F - 2", "psi(F) = exp(-k)*(E : E)"),
            ("e", "e = integral(l/L - 1)\npsi(e) = exp(-k)*e^2"),
        ] {
            for next in [
                format!("max(k, C*({x}))"),
                format!("C*((1e150*({x}))^2/1e300)"),
                format!("C*(cosh(8*({x})) - sinh(8*({x})))"),
            ] {
                let model = model(&remembering(&next, lines));
                for (c, outcome) in [(1.001, true), (1.0, false)] {
                    let [wrong, right] = [c, 1.0].map(|c| values(&model, 2, &[("C", c)]));
                    let found = compare(&model, &wrong, &right);
                    let is_wrong = found.outcome() == Outcome::Wrong;
                    assert_eq!(is_wrong, outcome, "{next} with {c}: {:?}", found.errors);
                    assert_eq!(found.different_bits, 0);
                }
            }
        }
    }

    /// What a state becomes for some values, held against what is written for others.
    fn compare(model: &Model, wrong: &Values, right: &Values) -> Verification {
        let of = |values| families::a_second_later(model, values);
        let (wrong, right, form) = (of(wrong), of(right), Form::Accurate);
        let found = |of| {
            let subject = Subject::NextState(of, String::new());
            Verification::new(subject, &[(Witness::TruthFar, 64.0)])
        };
        let variant = model.variant(2).unwrap();
        if let [written] = &model.written_next_states(&right)[..] {
            let all = MODES.map(|mode| model.next_states(&wrong, mode, form).unwrap());
            let kernels = all.each_ref().map(|all| &all[0].next);
            let points = sample::points(variant, Measure::Length, &wrong, 100);
            return remember::compare(
                found(Of::Measure(Measure::Length)),
                kernels,
                written,
                &points,
            );
        }
        let all = MODES.map(|mode| model.gradient_next_states(&wrong, mode, form).unwrap());
        if !all[0].is_empty() {
            let written =
                model.gradient_next_states(&right, MODES[0], form).unwrap().remove(0).written;
            let samples = gradient::samples(2, 100);
            let levels = all.each_ref().map(|all| {
                let all = gradients::evaluate(&all[0].next, &samples);
                all.iter().map(|place| place[0]).collect()
            });
            let mut found = found(Of::Family(OfFamily::Gradient));
            families::compare(&mut found, levels, &samples, &written);
            return found;
        }
        let all = MODES.map(|mode| model.gathered_next_states(&wrong, mode, form).unwrap());
        let written = model.gathered_next_states(&right, MODES[0], form).unwrap().remove(0).written;
        let places = gathered::places(&all[0][0].next, 100);
        let levels = all.each_ref().map(|all| {
            let (kernel, mut next) = (&all[0].next, vec![0.0; places.len()]);
            gathered::batch(kernel, &places, |at| kernel.evaluate(at, &mut next, &mut []));
            next
        });
        let mut found = found(Of::Family(OfFamily::Points));
        families::compare(&mut found, levels, &places, &written);
        found
    }

    #[test]
    fn what_is_far_off_is_wrong_where_samples_are_near() {
        let samples = |most: f64| move |seed: u64| if seed == 5 { 1.0 + most } else { 1.0 };
        for (value, most, wrong) in [
            (1.001, 1e-8, true),
            (1.001, 1e-6, false),
            (1.001, f64::INFINITY, false),
            (1.001, f64::NAN, false),
            (1.0000001, 0.0, false),
            (f64::INFINITY, 0.0, false),
            (f64::NAN, 0.0, false),
        ] {
            assert_eq!(super::is_wrong(value, 1.0, samples(most)), wrong, "{value} {most}");
        }
        assert!(super::is_wrong(1e10, 0.0, |_| 0.0));
    }
}
