//! `piola audit`: how many digits of psi, psi' and psi'' are right, regime by regime.

use std::fmt::Write as _;
use std::path::Path;

use piola_compiler::Form;
use piola_compiler::audit::{Audit, Regime, Settings, audit};
use piola_runtime::output::atomic::write_atomically;
use piola_runtime::output::decimal;
use piola_runtime::output::picture::{LogarithmicPanel, LogarithmicPlot};
use serde_json::{Value, json};

use super::Exit;
use super::derive::print_compile_error;
use crate::cli::{self, AuditFormat};
use crate::potential;
use crate::render;

const ORDERS: [&str; 3] = ["psi", "psi'", "psi''"];

pub(super) fn execute(arguments: &cli::Audit) -> Exit {
    let Some(loaded) = potential::load(&arguments.file, cli::Format::Human) else {
        return Exit::Input;
    };
    let (model, inputs) = (&loaded.model, &arguments.inputs);
    let Some(values) = potential::every_energy(model, arguments.dim, inputs, "audited") else {
        return Exit::Input;
    };
    if model.has_gradient_energy() {
        eprintln!("note: psi(F) is not audited: `piola verify` counts its errors in u");
    }
    if model.has_gathered_energy() {
        eprintln!("note: energies of gathered values are not audited: see `piola verify`");
    }
    let form = if arguments.textbook { Form::Textbook } else { Form::Accurate };
    let settings = Settings {
        form,
        level: arguments.level.into(),
        points: arguments.points,
        bar: arguments.bar,
    };
    let audits = match audit(model, &values, &settings) {
        Ok((audits, dropped)) => {
            dropped.iter().for_each(|dropped| eprintln!("note: {}", dropped.reason));
            audits
        }
        Err(error) => {
            print_compile_error(&loaded, &error);
            return Exit::Input;
        }
    };
    render::out(&match arguments.format {
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
        let symbol = audit.measure.symbol();
        let _ = writeln!(
            out,
            "psi({symbol}): largest errors in u = 1.1e-16 of the value, bar {bar}\n\
             {:16} {:>7} {:>11} {:>11} {:>11}",
            "regime", "points", "psi", "psi'", "psi''"
        );
        for regime in &audit.regimes {
            let _ = write!(out, "{:16} {:>7}", regime.name, regime.n_points);
            for error in regime.worst {
                let _ = write!(out, " {:>11}", units(error));
            }
            out.push('\n');
            for order in (0..3).filter(|&order| regime.worst[order] > bar) {
                let _ = writeln!(out, "  missed: {}", worst_input(audit, regime, order));
            }
        }
        out.push('\n');
    }
    out
}

fn units(error: f64) -> String {
    if error < 1e4 { format!("{error:.1}") } else { format!("{error:.1e}") }
}

fn worst_input(audit: &Audit, regime: &Regime, order: usize) -> String {
    let point = regime.at[order];
    let (symbol, reference) = (audit.measure.symbol(), audit.measure.reference_symbol());
    format!(
        "{} at {symbol} = {}, {reference} = {}",
        ORDERS[order],
        decimal(point.measure),
        decimal(point.reference)
    )
}

fn csv(audits: &[Audit]) -> String {
    let mut out = "measure,regime,points,order,error,at,at_reference\n".to_string();
    for audit in audits {
        for regime in &audit.regimes {
            for order in 0..3 {
                let _ = writeln!(
                    out,
                    "{},{},{},{order},{},{},{}",
                    audit.measure.symbol(),
                    regime.name,
                    regime.n_points,
                    decimal(regime.worst[order]),
                    decimal(regime.at[order].measure),
                    decimal(regime.at[order].reference)
                );
            }
        }
    }
    out
}

fn json_lines(file: &str, dimension: usize, audits: &[Audit], bar: f64) -> String {
    // JSON has no infinity: an error without end is null.
    let number = |x: f64| if x.is_finite() { json!(x) } else { Value::Null };
    let regime = |regime: &Regime| {
        let at = |order: usize| json!([regime.at[order].measure, regime.at[order].reference]);
        json!({
            "regime": regime.name,
            "points": regime.n_points,
            "errors": regime.worst.map(number),
            "at": [at(0), at(1), at(2)],
        })
    };
    let mut out = String::new();
    for audit in audits {
        let line = json!({
            "file": file,
            "dimension": dimension,
            "measure": audit.measure.symbol(),
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
                let error = regime.worst[order] * piola_compiler::verify::UNIT_ROUNDOFF;
                Some((regime.strain?, error))
            });
            (ORDERS[order].to_string(), near.collect())
        };
        LogarithmicPanel {
            title: format!("psi({})", audit.measure.symbol()),
            x: "strain",
            y: "largest relative error",
            lines: (0..3).map(line).collect(),
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
