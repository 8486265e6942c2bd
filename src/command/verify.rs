//! `piola verify`: machine code against the interpreter and hyper-dual numbers.

use piola_compiler::Argument;
use piola_compiler::gathered::{BAR, GatheredVerification, verify_gathered};
use piola_compiler::point::{BAR_FAR, BAR_NEAR, GradientVerification, verify_gradient};
use piola_compiler::verify::{Miss, Verification, verify};
use serde_json::json;

use super::Exit;
use super::derive::print_compile_error;
use crate::cli::{Format, Verify};
use crate::console;
use crate::potential;

const ORDERS: [&str; 3] = ["psi", "psi'", "psi''"];

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
            match verify(&loaded.model, &values, arguments.points) {
                Ok((found, dropped)) => {
                    for d in &dropped {
                        console::note(&format!("{file}: {}", d.reason));
                    }
                    for verification in &found {
                        report(file, dimension, verification, arguments.format);
                        if !verification.passed() {
                            exit = Exit::Findings;
                        }
                    }
                }
                Err(error) => {
                    print_compile_error(&loaded, &error);
                    return Exit::Input;
                }
            }
            match verify_gathered(&loaded.model, &values, arguments.points) {
                Ok(found) => {
                    for verification in &found {
                        report_gathered(file, dimension, verification, arguments.format);
                        if !verification.passed() {
                            exit = Exit::Findings;
                        }
                    }
                }
                Err(error) => {
                    print_compile_error(&loaded, &error);
                    return Exit::Input;
                }
            }
            match verify_gradient(&loaded.model, &values, arguments.points) {
                Ok(None) => {}
                Ok(Some(found)) => {
                    report_gradient(file, dimension, &found, arguments.format);
                    if !found.passed() {
                        exit = Exit::Findings;
                    }
                }
                Err(error) => {
                    print_compile_error(&loaded, &error);
                    return Exit::Input;
                }
            }
        }
    }
    exit
}

fn report(file: &str, dimension: usize, found: &Verification, format: Format) {
    let symbol = found.argument.symbol();
    if format == Format::Json {
        let line = json!({
            "potential": file,
            "dimension": dimension,
            "measure": symbol,
            "points": found.n_points,
            "passed": found.passed(),
            "different_bits": found.different_bits.len(),
            "misses": found.misses.len(),
            "worst_error_over_tolerance": found.worst,
        });
        console::out(&format!("{line}\n"));
        return;
    }
    let verdict = if found.passed() { "passed" } else { "FAILED" };
    let bits = match found.different_bits.len() {
        0 => "machine code = interpreter to the last bit".to_string(),
        n => format!("machine code differs from the interpreter at {n} points"),
    };
    let worst: Vec<String> =
        ORDERS.iter().zip(found.worst).map(|(o, w)| format!("{o} {w:.2}")).collect();
    console::out(&format!(
        "{verdict}  {file} d = {dimension} psi({symbol}): {} points; {bits}; largest error over tolerance against hyper-dual numbers: {}\n",
        found.n_points,
        worst.join(", ")
    ));
    for miss in found.misses.iter().take(5) {
        console::out(&describe(found.argument, miss));
    }
    if found.misses.len() > 5 {
        console::out(&format!("        .. and {} more\n", found.misses.len() - 5));
    }
}

fn report_gradient(file: &str, dimension: usize, found: &GradientVerification, format: Format) {
    if format == Format::Json {
        let worst = [0, 1, 2].map(|k| (found.near[k] / BAR_NEAR).max(found.far[k] / BAR_FAR));
        let line = json!({
            "potential": file,
            "dimension": dimension,
            "measure": "F",
            "points": found.n_points,
            "passed": found.passed(),
            "different_bits": found.different_bits,
            "misses": found.misses.len(),
            "worst_error_over_tolerance": worst,
            "worst_near_in_u": found.near,
            "worst_far_in_u": found.far,
            "worst_against_hyper_dual_in_u": found.dual,
        });
        console::out(&format!("{line}\n"));
        return;
    }
    let verdict = if found.passed() { "passed" } else { "FAILED" };
    let bits = match found.different_bits {
        0 => "machine code = interpreter to the last bit".to_string(),
        n => format!("machine code differs from the interpreter at {n} gradients"),
    };
    let named = |worst: [f64; 3]| {
        let parts = ["psi", "P", "dP"].iter().zip(worst).map(|(name, w)| format!("{name} {w:.0}"));
        parts.collect::<Vec<_>>().join(", ")
    };
    console::out(&format!(
        "{verdict}  {file} d = {dimension} psi(F): {} gradients; {bits}; largest errors in u = 2^-53 \
         of the norm: near rest {}; far from it {}; against hyper-dual numbers {}\n",
        found.n_points,
        named(found.near),
        named(found.far),
        named(found.dual)
    ));
    for gradient in &found.misses {
        let numbers: Vec<String> = gradient.iter().map(|x| format!("{x:e}")).collect();
        console::out(&format!("        missed at F = ({})\n", numbers.join(", ")));
    }
}

fn report_gathered(file: &str, dimension: usize, found: &GatheredVerification, format: Format) {
    let argument = &found.argument;
    if format == Format::Json {
        let line = json!({
            "potential": file,
            "dimension": dimension,
            "measure": argument,
            "points": found.n_points,
            "passed": found.passed(),
            "different_bits": found.different_bits,
            "worst_error_over_tolerance": found.worst.map(|worst| worst / BAR),
        });
        console::out(&format!("{line}\n"));
        return;
    }
    let verdict = if found.passed() { "passed" } else { "FAILED" };
    let bits = match found.different_bits {
        0 => "machine code = interpreter to the last bit".to_string(),
        n => format!("machine code differs from the interpreter at {n} points"),
    };
    let [psi, gradient, product] = found.worst;
    console::out(&format!(
        "{verdict}  {file} d = {dimension} psi({argument}): {} points; {bits}; largest errors against \
         hyper-dual numbers in u = 2^-53: psi {psi:.0}, gradient {gradient:.0}, product {product:.0}\n",
        found.n_points
    ));
}

fn describe(argument: Argument, miss: &Miss) -> String {
    let symbol = argument.symbol();
    let rest = match argument {
        Argument::Measure(measure) | Argument::Square(measure) => measure.reference_symbol(),
        Argument::Gradient => "I",
    };
    format!(
        "        {} at {symbol} = {:e}, {rest} = {:e}: {:e}, expected {:e} within {:.1e}\n",
        ORDERS[miss.order],
        miss.point.measure,
        miss.point.reference,
        miss.compiled,
        miss.expected,
        miss.tolerance
    )
}
