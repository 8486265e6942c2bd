//! `piola eval`: measures in, psi, psi', psi'' out, one row per row.

use std::io::Read as _;

use piola_compiler::{Batch, Derivatives, Measure, Mode};
use piola_runtime::output::decimal;

use super::Exit;
use super::derive::print_compile_error;
use crate::cli::{self, Eval, Format};
use crate::console;
use crate::potential;
use crate::render;
use crate::table;

/// Largest table that is read, in bytes.
const MAX_TABLE: usize = 1 << 30;

pub(super) fn execute(arguments: &Eval) -> Exit {
    let measure = match arguments.measure {
        cli::MeasureName::L => Some(Measure::Length),
        cli::MeasureName::A => Some(Measure::Area),
        cli::MeasureName::V => Some(Measure::Volume),
        cli::MeasureName::F => None,
    };
    let mode = match arguments.mode {
        cli::Mode::Jit => Mode::Jit(arguments.level.into()),
        cli::Mode::Interpreter => Mode::Interpreter,
        cli::Mode::Hyperdual => Mode::HyperDual,
    };
    let Some(loaded) = potential::load(&arguments.file, Format::Human) else { return Exit::Input };
    let Some(settings) = potential::settings(&arguments.inputs) else { return Exit::Input };
    let dimension = usize::from(arguments.dim);
    let delta = arguments.inputs.delta;
    let Some(values) = potential::values(&loaded.model, dimension, &settings, delta) else {
        return Exit::Input;
    };
    let symbol = measure.map_or("F", Measure::symbol);
    let arguments_of = loaded.model.arguments();
    if !arguments_of.contains(&symbol) {
        let message = format!("`{}` has no energy psi({symbol})", loaded.model.name());
        let known = arguments_of.iter().filter(|a| matches!(**a, "l" | "a" | "v" | "F"));
        let has: Vec<String> = known.map(|a| format!("--measure {a}")).collect();
        let help = match has.is_empty() {
            true => "energies of gathered values need a body: `piola energy SCENE`".to_string(),
            false => format!("use {}", has.join(" or ")),
        };
        render::error(&message, Some(help.as_str()));
        return Exit::Input;
    }
    let Some(measure) = measure else {
        return super::eval_gradient::execute(&loaded, &values, mode, &arguments.points);
    };
    let compiled = match loaded.model.compile(&values, mode) {
        Ok(compiled) => compiled,
        Err(error) => {
            print_compile_error(&loaded, &error);
            return Exit::Input;
        }
    };
    let Some(text) = read_table(&arguments.points) else { return Exit::Input };
    let columns = match parse(&text, measure) {
        Ok(columns) => columns,
        Err(mistakes) => {
            for mistake in mistakes {
                render::error(&format!("{}: {mistake}", arguments.points), None);
            }
            return Exit::Input;
        }
    };
    for dropped in compiled.dropped.iter().filter(|d| d.argument == measure.symbol()) {
        console::note(&dropped.reason);
    }
    let out = match compiled.kernels.iter().find(|kernel| kernel.measure() == measure) {
        Some(kernel) => {
            let change: Vec<f64> =
                columns.0.iter().zip(&columns.1).map(|(l, rest)| (l - rest) / rest).collect();
            let batch = Batch { measure: &columns.0, reference: &columns.1, change: &change };
            kernel.derivatives(batch)
        }
        // An energy with coefficient 0 is not modelled: it is 0 everywhere.
        None => Derivatives::zeros(columns.0.len()),
    };
    print_rows(measure, &columns, &out)
}

pub(super) fn read_table(path: &str) -> Option<String> {
    if path != "-" {
        return potential::read_limited(std::path::Path::new(path), MAX_TABLE);
    }
    let mut text = String::new();
    match std::io::stdin().lock().take(MAX_TABLE as u64).read_to_string(&mut text) {
        Ok(_) => Some(text),
        Err(error) => {
            render::error(&format!("cannot read the standard input: {error}"), None);
            None
        }
    }
}

/// The columns of the measure and of its reference.
fn parse(text: &str, measure: Measure) -> Result<(Vec<f64>, Vec<f64>), Vec<String>> {
    let names = [measure.symbol(), measure.reference_symbol()].map(str::to_string);
    let refusal = |row: &[f64]| {
        let reference = row[1];
        let is_one = reference.is_finite() && reference > 0.0;
        (!is_one).then(|| (1, format!("{reference}: a reference measure is finite and > 0")))
    };
    let rows = table::rows(text, &names, refusal)?;
    Ok(rows.iter().map(|row| (row[0], row[1])).unzip())
}

fn print_rows(measure: Measure, columns: &(Vec<f64>, Vec<f64>), out: &Derivatives) -> Exit {
    let mut text = format!("{},{},psi,dpsi,d2psi\n", measure.symbol(), measure.reference_symbol());
    let mut not_finite = Vec::new();
    for i in 0..columns.0.len() {
        let row = [columns.0[i], columns.1[i], out.psi[i], out.dpsi[i], out.d2psi[i]];
        text.push_str(&row.map(decimal).join(","));
        text.push('\n');
        if !row[2..].iter().all(|x| x.is_finite()) {
            not_finite.push(i);
        }
    }
    console::out(&text);
    let Some(&first) = not_finite.first() else { return Exit::Done };
    render::error(
        &format!(
            "{} of {} rows are not finite; the first is row {} ({} = {}, {} = {})",
            not_finite.len(),
            columns.0.len(),
            first + 1,
            measure.symbol(),
            columns.0[first],
            measure.reference_symbol(),
            columns.1[first]
        ),
        None,
    );
    Exit::Findings
}
