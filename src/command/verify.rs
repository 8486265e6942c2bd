//! `piola verify`: machine code against the interpreter and hyper-dual numbers.

use piola_compiler::verify::{
    Cause, Miss, Outcome, Part, Stated, Subject, Verification, Witness, verify,
};
use piola_compiler::{Argument, Of, OfFamily};
use serde_json::{Value, json};

use super::Exit;
use super::derive::print_compile_error;
use crate::cli::{Format, Verify};
use crate::console;
use crate::potential;

pub(super) fn execute(arguments: &Verify) -> Exit {
    let Some(settings) = potential::settings(&arguments.inputs) else { return Exit::Input };
    let mut exit = Exit::Done;
    for file in &arguments.files {
        let Some(loaded) = potential::load(file) else { return Exit::Input };
        let dimensions: Vec<usize> = match arguments.dim {
            Some(d) => vec![usize::from(d)],
            None => loaded.model.dimensions().collect(),
        };
        for (number, &dimension) in dimensions.iter().enumerate() {
            let mut settings = settings.clone();
            let filled = loaded.model.fill_with_one(dimension, &mut settings);
            if !filled.is_empty() && number == 0 {
                console::note(&format!("{file}: {} = 1, for want of a value", filled.join(" = ")));
            }
            let delta = arguments.inputs.delta.or(Some(1.0));
            let switched_on = loaded.model.switch_on(dimension, &mut settings, delta);
            if !switched_on.is_empty() {
                console::note(&format!(
                    "{file}: {} = 1, so that no energy is left out",
                    switched_on.join(" = ")
                ));
            }
            let Some(values) = potential::values(&loaded.model, dimension, &settings, delta) else {
                return Exit::Input;
            };
            let (found, dropped) = match verify(&loaded.model, &values, arguments.points) {
                Ok(found) => found,
                Err(error) => {
                    print_compile_error(&loaded, &error);
                    return Exit::Input;
                }
            };
            for dropped in &dropped {
                console::note(&format!("{file}: {}", dropped.reason));
            }
            for verification in &found {
                let place = format!("{file} d = {dimension}");
                console::out(&match arguments.format {
                    Format::Json => format!("{}\n", line(file, dimension, verification)),
                    Format::Human => report(&place, verification, &loaded.text),
                });
                if !verification.passed() {
                    exit = Exit::Findings;
                }
            }
        }
    }
    exit
}

/// What was found for one energy, as one object.
fn line(file: &str, dimension: usize, found: &Verification) -> Value {
    let mut line = json!({
        "potential": file,
        "dimension": dimension,
        "measure": found.subject.symbol(),
        "points": found.n_places,
        "passed": found.passed(),
        "outcome": found.outcome().name(),
        "different_bits": found.different_bits,
        "misses": found.misses.len(),
        "undecided_by_hyper_dual": found.undecided,
        "worst_error_over_tolerance": found.over_tolerance(),
    });
    if found.errors.len() > 1 {
        for errors in &found.errors {
            let (_, key) = words(errors.witness);
            line[key] = json!(errors.largest);
        }
    }
    line
}

/// Where and against what, for people, and the key of errors in units of 2^-53.
fn words(witness: Witness) -> (&'static str, &'static str) {
    match witness {
        Witness::TruthNear => ("near rest", "worst_near_in_u"),
        Witness::TruthFar => ("far from it", "worst_far_in_u"),
        Witness::HyperDual => ("against hyper-dual numbers", "worst_against_hyper_dual_in_u"),
    }
}

/// What came out, in a word or two.
fn verdict(found: &Verification) -> &'static str {
    match found.outcome() {
        Outcome::Passed => "passed",
        Outcome::DigitsLost => "DIGITS LOST",
        Outcome::Wrong => "WRONG",
    }
}

/// Whether machine code is what was compiled.
fn bits(found: &Verification, places: &str) -> String {
    match found.different_bits {
        0 => "machine code = interpreter to the last bit".to_string(),
        n => format!("machine code differs from the interpreter at {n} {places}"),
    }
}

/// What was found for one energy, in words.
fn report(place: &str, found: &Verification, text: &str) -> String {
    if let Subject::Margin(argument, condition) = &found.subject {
        return report_margin(place, (*argument, condition), found);
    }
    if let Subject::NextState(of, next) = &found.subject {
        return report_next_state(place, (*of, next), found);
    }
    let (places, what, digits) = match &found.subject {
        Subject::Argument(Argument::Measure(_) | Argument::Square(_)) | Subject::Dissipation(_) => {
            ("points", "largest error over tolerance against hyper-dual numbers", 2)
        }
        Subject::Argument(Argument::Gradient) => {
            ("gradients", "largest errors in u = 2^-53 of the norm", 0)
        }
        Subject::Gathered(_) => ("points", "largest errors in u = 2^-53", 0),
        Subject::Gathering(_) | Subject::Margin(..) | Subject::NextState(..) => {
            ("points", "largest errors against hyper-dual numbers in u = 2^-53", 0)
        }
        Subject::Coupled(..) => ("points", "largest errors in u = 2^-53 of the largest part", 0),
        Subject::Following(_) => {
            ("points", "largest errors, where 64 is a billionth of the value", 0)
        }
    };
    let place = match found.subject {
        Subject::Following(_) => format!("{place} load steps,"),
        _ => place.to_string(),
    };
    let (verdict, bits) = (verdict(found), bits(found, places));
    let head = match &found.subject {
        Subject::Dissipation(_) => "dissipation(l)".to_string(),
        Subject::Gathering(text) => text.clone(),
        subject => format!("psi({})", subject.symbol()),
    };
    let orders = found.subject.orders();
    let errors = found.errors.iter().map(|errors| {
        let of =
            orders.iter().zip(errors.largest).map(|(o, error)| format!("{o} {error:.digits$}"));
        let of = of.collect::<Vec<_>>().join(", ");
        if found.errors.len() > 1 { format!("{} {of}", words(errors.witness).0) } else { of }
    });
    let mut out = format!(
        "{verdict}  {place} {head}: {} {places}; {bits}; {what}: {}\n",
        found.n_places,
        errors.collect::<Vec<_>>().join("; ")
    );
    if found.undecided > 0 && !found.passed() {
        out.push_str(&format!(
            "        hyper-dual numbers overflow or lose digits at {} {places}: numbers of any precision \
             decide there\n",
            found.undecided
        ));
    }
    match found.outcome() {
        Outcome::Passed => {}
        Outcome::DigitsLost => out.push_str(&losses(found, text)),
        Outcome::Wrong => {
            out.push_str(
                "        this is a defect of piola, not of the potential; please report it\n",
            );
            let wrong = || found.misses.iter().filter(|miss| miss.is_wrong);
            for miss in wrong().take(5) {
                out.push_str(&describe(&found.subject, miss));
            }
            if wrong().count() > 5 {
                out.push_str(&format!("        .. and {} more\n", wrong().count() - 5));
            }
        }
    }
    out
}

/// The same of a condition under which bonds, triangles or tetrahedra break.
fn report_margin(
    place: &str,
    (argument, condition): (Option<Argument>, &str),
    found: &Verification,
) -> String {
    let (one, all, points, size) = match argument {
        None => ("place", "places", "places", "the norm"),
        Some(Argument::Gradient) => ("gradient", "gradients", "gradients", "the norm"),
        Some(Argument::Measure(measure) | Argument::Square(measure)) => {
            (measure.interaction(), measure.interactions(), "points", measure.symbol())
        }
    };
    let (verdict, bits) = (verdict(found), bits(found, points));
    let largest = found.errors.iter().fold(0.0, |most: f64, errors| most.max(errors.largest[0]));
    let judged = match largest {
        0.0 => format!("every {one} is judged as written"),
        _ => format!(
            "{all} are judged as written from {largest:.0} units in the last place of {size} around the \
             threshold on"
        ),
    };
    let n = found.n_places;
    let mut out =
        format!("{verdict}  {place} break when {condition}: {n} {points}; {bits}; {judged}\n");
    for miss in found.misses.iter().take(5) {
        out.push_str(&describe(&found.subject, miss));
    }
    out
}

/// The same of what a state becomes.
fn report_next_state(place: &str, (of, next): (Of, &str), found: &Verification) -> String {
    let (places, rounded) = match of {
        Of::Measure(_) => ("points", "of the change of the length"),
        Of::Family(OfFamily::Gradient) => ("gradients", "of what is given, in its norm"),
        Of::Family(_) => ("places", "of what is given, in its norm"),
    };
    let (verdict, bits) = (verdict(found), bits(found, places));
    let largest = found.errors.iter().fold(0.0, |most: f64, errors| most.max(errors.largest[0]));
    let points = found.n_places;
    let mut out = format!(
        "{verdict}  {place} update {next}: {points} {places}; {bits}; off by at most {largest:.1} roundings of \
         it or {rounded}\n"
    );
    for miss in found.misses.iter().take(5) {
        out.push_str(&describe(&found.subject, miss));
    }
    out
}

/// Which digits are lost, where, by what, what it means for a run and what to write instead.
fn losses(found: &Verification, text: &str) -> String {
    let mut out =
        "        the derivatives are right; rounding takes digits of their values:\n".to_string();
    let orders = found.subject.orders();
    for order in 0..3 {
        let misses = || found.misses.iter().filter(|miss| miss.order == order);
        let Some(worst) = found.worst(order) else { continue };
        let name = orders[order];
        out.push_str(&format!(
            "        {name} keeps {:.0} of 16 digits at {}{}\n",
            worst.digits(),
            place_of(&found.subject, worst),
            range(&found.subject, misses())
        ));
        let Some(cause) = found.causes.iter().find(|cause| cause.order == order) else { continue };
        out.push_str(&format!("          {}\n", advice(cause, text)));
    }
    out.push_str(&format!("        {}\n", cost(found)));
    out
}

/// What lost digits change in a run.
fn cost(found: &Verification) -> String {
    let largest = |order: usize| {
        let misses = found.misses.iter().filter(|miss| miss.order == order);
        misses.map(Miss::relative_error).fold(0.0, f64::max)
    };
    let off = |order: usize| match largest(order) {
        error if error.is_finite() => format!("off by up to {error:.0e} of itself there"),
        _ => "no finite number there".to_string(),
    };
    let [energy, force, tangent] = found.subject.orders();
    match [1, 2].map(|order| largest(order) > 0.0) {
        [true, _] => format!("in a run forces are off with it: {force} is {}", off(1)),
        [false, true] => format!(
            "in a run forces keep their digits; {tangent} is {}: Newton's method may take more steps, \
             and arrives at the same place",
            off(2)
        ),
        [false, false] => format!(
            "in a run forces keep their digits: bodies move as they should, and {energy} in the output \
             is {}",
            off(0)
        ),
    }
}

/// At how many other places, and at which strains or stretches, of a measure.
fn range<'a>(subject: &Subject, misses: impl Iterator<Item = &'a Miss>) -> String {
    let misses: Vec<&Miss> = misses.collect();
    let count = misses.len();
    let Subject::Argument(Argument::Measure(_) | Argument::Square(_)) = subject else {
        return if count > 1 {
            format!(", and fewer than it should at {count} places")
        } else {
            String::new()
        };
    };
    let stretches = || misses.iter().map(|miss| miss.place[0] / miss.place[1]);
    let ends = |numbers: &mut dyn Iterator<Item = f64>| {
        numbers.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
    };
    let [low, high] = ends(&mut stretches().map(|stretch| (stretch - 1.0).abs()));
    if count == 1 {
        String::new()
    } else if high < 0.5 {
        format!(", and too few at {count} points, strains of {low:.0e} to {high:.0e}")
    } else {
        let [low, high] = ends(&mut stretches());
        format!(", and too few at {count} points, stretches of {low:.2e} to {high:.2e}")
    }
}

/// What a subexpression of a text does to digits, and what to write instead.
pub(super) fn advice(cause: &Cause, text: &str) -> String {
    let expression = match cause.stated {
        None => format!("`{}`", shortened(&cause.expression)),
        Some(Stated { span, part }) => {
            let words = text[span.range()].split_whitespace().collect::<Vec<_>>().join(" ");
            match part {
                Part::Whole => format!("`{words}`"),
                Part::Component => format!("a component of `{words}`"),
                Part::Derivative => format!("the derivative of `{words}`"),
            }
        }
    };
    match cause.cancelled {
        _ if cause.overflows => format!(
            "{expression} is too large for a double there: narrow the `domain`, or write it so that \
             no part of it is larger than the whole"
        ),
        Some(digits) if digits >= 1.0 => format!(
            "{digits:.0} digits cancel in {expression}: write what its terms differ by as one expression"
        ),
        _ => format!(
            "{expression} magnifies the rounding of what it is made of: keep that small, or narrow \
             the `domain`"
        ),
    }
}

/// An expression in a line of text.
fn shortened(expression: &str) -> String {
    const LONGEST: usize = 160;
    match expression.char_indices().nth(LONGEST) {
        None => expression.to_string(),
        Some((end, _)) => format!("{} ..", &expression[..end]),
    }
}

fn describe(subject: &Subject, miss: &Miss) -> String {
    let (order, place) = (subject.orders()[miss.order], place_of(subject, miss));
    format!(
        "        {order} at {place}: {}, expected {} within {:.1e}\n",
        numbers(&miss.compiled),
        numbers(&miss.expected),
        miss.tolerance
    )
}

fn numbers(numbers: &[f64]) -> String {
    match numbers {
        [number] => format!("{number:e}"),
        _ => {
            let numbers: Vec<String> = numbers.iter().map(|x| format!("{x:e}")).collect();
            format!("({})", numbers.join(", "))
        }
    }
}

/// What the energy is given.
fn place_of(subject: &Subject, miss: &Miss) -> String {
    let symbol = subject.symbol();
    match subject {
        Subject::Argument(Argument::Measure(measure) | Argument::Square(measure)) => {
            let (m, rest) = (miss.place[0], miss.place[1]);
            format!("{symbol} = {m:e}, {} = {rest:e}", measure.reference_symbol())
        }
        Subject::Dissipation(_) => {
            format!("rate(l) = {:e}, L = {:e}", miss.place[0], miss.place[1])
        }
        Subject::Margin(Some(Argument::Measure(measure)), _)
        | Subject::NextState(Of::Measure(measure), _)
        | Subject::Following(measure) => {
            let (now, rest) = (measure.symbol(), measure.reference_symbol());
            format!("{now} = {:e}, {rest} = {:e}", miss.place[0], miss.place[1])
        }
        Subject::Coupled(_, symbols) => {
            let changes: Vec<String> = miss.place.iter().map(|x| format!("{x:.1e}")).collect();
            format!("changes of {} by ({}) of themselves", symbols.join(", "), changes.join(", "))
        }
        Subject::Margin(None, _) => format!("lengths and integrals = {}", numbers(&miss.place)),
        Subject::NextState(Of::Family(OfFamily::Points), _) => {
            format!("integrals = {}", numbers(&miss.place))
        }
        Subject::NextState(..) => format!("F, or F - I near rest, = {}", numbers(&miss.place)),
        Subject::Margin(..) => format!("F = {}", numbers(&miss.place)),
        _ => format!("{symbol} = {}", numbers(&miss.place)),
    }
}
