//! `piola audit`: how many digits of psi, psi' and psi'' are right, regime by regime.

use std::fmt::Write as _;
use std::path::Path;

use piola_compiler::audit::{Audit, Place, Regime, Settings, audit, functions, several};
use piola_compiler::{Argument, Form};
use piola_runtime::output::atomic::write_atomically;
use piola_runtime::output::decimal;
use piola_runtime::output::picture::{LogarithmicPanel, LogarithmicPlot};
use serde_json::{Value, json};

use super::Exit;
use super::derive::print_compile_error;
use crate::cli::{self, AuditFormat};
use crate::console;
use crate::potential;
use crate::render;

pub(super) fn execute(arguments: &cli::Audit) -> Exit {
    let Some(loaded) = potential::load(&arguments.file) else {
        return Exit::Input;
    };
    let (model, inputs) = (&loaded.model, &arguments.inputs);
    let Some(values) = potential::every_energy(model, arguments.dim, inputs, "audited") else {
        return Exit::Input;
    };
    let form = if arguments.textbook { Form::Textbook } else { Form::Accurate };
    let settings = Settings {
        form,
        level: arguments.level.into(),
        points: arguments.points,
        bar: arguments.bar,
    };
    let found = audit(model, &values, &settings).and_then(|(mut audits, dropped)| {
        audits.extend(several(model, &values, &settings)?);
        audits.extend(functions(model, &values, &settings)?);
        Ok((audits, dropped))
    });
    let audits = match found {
        Ok((audits, dropped)) => {
            dropped.iter().for_each(|dropped| console::note(&dropped.reason));
            audits
        }
        Err(error) => {
            print_compile_error(&loaded, &error);
            return Exit::Input;
        }
    };
    console::out(&match arguments.format {
        AuditFormat::Human => human(&audits, arguments.bar),
        AuditFormat::Csv => csv(&audits),
        AuditFormat::Json => json_lines(&loaded.name, values.dimension, &audits, arguments.bar),
    });
    if let Some(path) = &arguments.picture
        && let Err(message) = picture(path, &loaded.name, &audits)
    {
        render::error(&message, None);
        return Exit::Input;
    }
    let missed = audits.iter().any(|audit| !passes(&audit.worst(), arguments.bar));
    if missed { Exit::Findings } else { Exit::Done }
}

fn passes(worst: &[f64; 3], bar: f64) -> bool {
    worst.iter().all(|error| *error <= bar)
}

/// A table for people; where a bar is missed, the worst input.
fn human(audits: &[Audit], bar: f64) -> String {
    let mut out = String::new();
    for audit in audits {
        let (symbol, orders) = (audit.symbol(), audit.orders());
        let n = audit.n_orders();
        let is_of_measure =
            matches!(audit.argument, Some(Argument::Measure(_) | Argument::Square(_)));
        let of = if is_of_measure { "value" } else { "norm" };
        let width = audit.regimes.iter().map(|regime| regime.name.len()).fold(16, usize::max);
        if let Some(Argument::Square(measure)) = audit.argument {
            let m = measure.symbol();
            let _ =
                writeln!(out, "psi({m}) runs as a function of {symbol}, with derivatives by it:");
        }
        let _ = writeln!(
            out,
            "{}: largest errors, raw in u = 1.1e-16 of the {of};\n\
             left: what rounding the inputs does not excuse, bar {bar}",
            audit.title()
        );
        let columns = orders[..n].iter().map(|of| format!(" {of:>10} {:>8}", "left"));
        let columns = columns.collect::<String>();
        let _ = writeln!(out, "{:width$} {:>7}{columns}", "regime", "points");
        for regime in &audit.regimes {
            let _ = write!(out, "{:width$} {:>7}", regime.name, regime.n_points);
            for (raw, left) in regime.raw.into_iter().zip(regime.worst).take(n) {
                let _ = write!(out, " {:>10} {:>8}", units(raw), units(left));
            }
            out.push('\n');
            for order in (0..3).filter(|&order| regime.worst[order] > bar) {
                let _ =
                    writeln!(out, "  missed: {} at {}", orders[order], input(audit, regime, order));
            }
        }
        out.push('\n');
    }
    out
}

/// An error in `u`.
pub(super) fn units(error: f64) -> String {
    if error < 1e4 { format!("{error:.1}") } else { format!("{error:.1e}") }
}

/// Where the largest error is.
fn input(audit: &Audit, regime: &Regime, order: usize) -> String {
    match &regime.at[order] {
        Some(Place::Interaction(point)) => {
            let Some(Argument::Measure(measure) | Argument::Square(measure)) = audit.argument
            else {
                return String::new();
            };
            format!(
                "{} = {}, {} = {}",
                audit.symbol(),
                decimal(point.measure),
                measure.reference_symbol(),
                decimal(point.reference)
            )
        }
        Some(Place::Gradient { change, is_near: true, .. }) => {
            format!("F - I = ({})", listed(change, ", "))
        }
        Some(Place::Gradient { gradient, .. }) => format!("F = ({})", listed(gradient, ", ")),
        Some(place @ Place::Several { .. }) => numbers(place),
        None => String::new(),
    }
}

/// `I1 = 2, I2 = 3`
fn numbers(place: &Place) -> String {
    let one = |(name, x): (&str, f64)| format!("{name} = {}", decimal(x));
    place.numbers().map(one).collect::<Vec<_>>().join(", ")
}

fn listed(numbers: &[f64], separator: &str) -> String {
    numbers.iter().map(|x| decimal(*x)).collect::<Vec<_>>().join(separator)
}

/// The measure of an energy; of anything else what it is, in quotes.
fn measure(audit: &Audit) -> String {
    match audit.function {
        None => audit.symbol().to_string(),
        Some(_) => format!("\"{}\"", audit.title().replace('"', "\"\"")),
    }
}

/// The input and what it is at rest; of `F` all components, and `F - I`.
fn csv(audits: &[Audit]) -> String {
    let mut out = "measure,regime,points,order,raw,error,at,at_reference,at_change\n".to_string();
    for audit in audits {
        for regime in &audit.regimes {
            for order in 0..audit.n_orders() {
                let at = match &regime.at[order] {
                    Some(Place::Interaction(point)) => {
                        [point.measure, point.reference, point.change()].map(decimal)
                    }
                    Some(Place::Gradient { gradient, change, .. }) => {
                        [listed(gradient, " "), String::new(), listed(change, " ")]
                    }
                    Some(place @ Place::Several { .. }) => {
                        let numbers: Vec<f64> = place.numbers().map(|(_, x)| x).collect();
                        [listed(&numbers, " "), String::new(), String::new()]
                    }
                    None => [const { String::new() }; 3],
                };
                let _ = writeln!(
                    out,
                    "{},{},{},{order},{},{},{}",
                    measure(audit),
                    regime.name,
                    regime.n_points,
                    decimal(regime.raw[order]),
                    decimal(regime.worst[order]),
                    at.join(",")
                );
            }
        }
    }
    out
}

fn json_lines(file: &str, dimension: usize, audits: &[Audit], bar: f64) -> String {
    // JSON has no infinity: an error without end is null.
    let number = |x: f64| if x.is_finite() { json!(x) } else { Value::Null };
    let at = |place: &Option<Place>| match place {
        Some(Place::Interaction(point)) => json!([point.measure, point.reference]),
        Some(Place::Gradient { gradient, change, .. }) => json!({ "F": gradient, "F-I": change }),
        Some(place @ Place::Several { .. }) => {
            let number = |(name, x): (&str, f64)| (name.to_string(), json!(x));
            Value::Object(place.numbers().map(number).collect())
        }
        None => Value::Null,
    };
    let regime = |regime: &Regime| {
        json!({
            "regime": regime.name,
            "points": regime.n_points,
            "raw": regime.raw.map(number),
            "errors": regime.worst.map(number),
            "at": regime.at.each_ref().map(at),
        })
    };
    let mut out = String::new();
    for audit in audits {
        let line = json!({
            "file": file,
            "dimension": dimension,
            "measure": audit.symbol(),
            "subject": audit.title(),
            "bar": bar,
            "passed": passes(&audit.worst(), bar),
            "regimes": audit.regimes.iter().map(regime).collect::<Vec<_>>(),
        });
        let _ = writeln!(out, "{line}");
    }
    out
}

/// Relative error against strain, a panel for each energy.
fn picture(path: &Path, name: &str, audits: &[Audit]) -> Result<(), String> {
    let panel = |audit: &Audit| {
        let line = |order: usize| {
            let near = audit.regimes.iter().filter_map(|regime| {
                let error = regime.raw[order] * piola_compiler::verify::UNIT_ROUNDOFF;
                Some((regime.strain?, error))
            });
            (audit.orders()[order].to_string(), near.collect())
        };
        LogarithmicPanel {
            title: audit.title(),
            x: "strain",
            y: "largest relative error",
            lines: (0..audit.n_orders()).map(line).collect(),
        }
    };
    let plot = LogarithmicPlot {
        title: format!("{name}: error against strain"),
        panels: audits.iter().map(panel).collect(),
    };
    let svg = path.extension().is_some_and(|ending| ending == "svg");
    let bytes = if svg {
        plot.to_svg().into_bytes()
    } else {
        plot.to_png().map_err(|error| error.to_string())?
    };
    write_atomically(path, |file| file.write_all(&bytes)).map_err(|error| error.to_string())
}
