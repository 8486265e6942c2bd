//! `piola verify`: machine code against the interpreter and hyper-dual numbers.

use piola_compiler::Argument;
use piola_compiler::verify::{Miss, Subject, Verification, Witness, verify};
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
        let Some(loaded) = potential::load(file, Format::Human) else { return Exit::Input };
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
                    Format::Human => report(&place, verification),
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
        "different_bits": found.different_bits,
        "misses": found.misses.len(),
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

/// What was found for one energy, in words.
fn report(place: &str, found: &Verification) -> String {
    let (places, what, digits) = match &found.subject {
        Subject::Argument(Argument::Measure(_) | Argument::Square(_)) => {
            ("points", "largest error over tolerance against hyper-dual numbers", 2)
        }
        Subject::Argument(Argument::Gradient) => {
            ("gradients", "largest errors in u = 2^-53 of the norm", 0)
        }
        Subject::Gathered(_) => {
            ("points", "largest errors against hyper-dual numbers in u = 2^-53", 0)
        }
    };
    let verdict = if found.passed() { "passed" } else { "FAILED" };
    let bits = match found.different_bits {
        0 => "machine code = interpreter to the last bit".to_string(),
        n => format!("machine code differs from the interpreter at {n} {places}"),
    };
    let orders = found.subject.orders();
    let errors = found.errors.iter().map(|errors| {
        let of =
            orders.iter().zip(errors.largest).map(|(o, error)| format!("{o} {error:.digits$}"));
        let of = of.collect::<Vec<_>>().join(", ");
        if found.errors.len() > 1 { format!("{} {of}", words(errors.witness).0) } else { of }
    });
    let mut out = format!(
        "{verdict}  {place} psi({}): {} {places}; {bits}; {what}: {}\n",
        found.subject.symbol(),
        found.n_places,
        errors.collect::<Vec<_>>().join("; ")
    );
    for miss in found.misses.iter().take(5) {
        out.push_str(&describe(&found.subject, miss));
    }
    if found.misses.len() > 5 {
        out.push_str(&format!("        .. and {} more\n", found.misses.len() - 5));
    }
    out
}

fn describe(subject: &Subject, miss: &Miss) -> String {
    let numbers = |numbers: &[f64]| match numbers {
        [number] => format!("{number:e}"),
        _ => {
            let numbers: Vec<String> = numbers.iter().map(|x| format!("{x:e}")).collect();
            format!("({})", numbers.join(", "))
        }
    };
    let (order, symbol) = (subject.orders()[miss.order], subject.symbol());
    let place = match subject {
        Subject::Argument(Argument::Measure(measure) | Argument::Square(measure)) => {
            let (m, rest) = (miss.place[0], miss.place[1]);
            format!("{symbol} = {m:e}, {} = {rest:e}", measure.reference_symbol())
        }
        _ => format!("{symbol} = {}", numbers(&miss.place)),
    };
    format!(
        "        {order} at {place}: {}, expected {} within {:.1e}\n",
        numbers(&miss.compiled),
        numbers(&miss.expected),
        miss.tolerance
    )
}
