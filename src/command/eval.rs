//! `piola eval`: measures in, psi, psi', psi'' out, one row per row.

use clap::ValueEnum as _;
use piola_compiler::{Batch, Derivatives, Form, Kind, Measure, Mode};
use piola_runtime::output::decimal;

use super::derive::print_compile_error;
use super::{Exit, eval_several};
use crate::cli::{self, Eval};
use crate::console;
use crate::potential;
use crate::render;
use crate::table;

pub(super) fn execute(arguments: &Eval) -> Exit {
    let measure = match arguments.measure {
        cli::MeasureName::L => Some(Measure::Length),
        cli::MeasureName::A => Some(Measure::Area),
        cli::MeasureName::V => Some(Measure::Volume),
        _ => None,
    };
    let of_several = eval_several::of_several(arguments.measure);
    let mode = match arguments.mode {
        cli::Mode::Jit => Mode::Jit(arguments.level.into()),
        cli::Mode::Interpreter => Mode::Interpreter,
        cli::Mode::Hyperdual => Mode::HyperDual,
    };
    let Some(loaded) = potential::load(&arguments.file) else { return Exit::Input };
    let Some(settings) = potential::settings(&arguments.inputs) else { return Exit::Input };
    let dimension = usize::from(arguments.dim);
    let delta = arguments.inputs.delta;
    let Some(values) = potential::values(&loaded.model, dimension, &settings, delta) else {
        return Exit::Input;
    };
    let symbol = measure.map_or("F", Measure::symbol);
    let arguments_of = loaded.model.arguments();
    let words = eval_several::words(&loaded.model);
    let is_there = match arguments.measure.to_possible_value() {
        Some(word) if of_several.is_some() => words.contains(&word.get_name()),
        _ => arguments_of.contains(&symbol),
    };
    if !is_there {
        let message = match of_several {
            Some(what) => format!("`{}` has no energy of {what}", loaded.model.name()),
            None => format!("`{}` has no energy psi({symbol})", loaded.model.name()),
        };
        let known = arguments_of.iter().filter(|a| matches!(**a, "l" | "a" | "v" | "F"));
        let known = known.copied().chain(words);
        let has: Vec<String> = known.map(|a| format!("--measure {a}")).collect();
        let help = format!("use {}", has.join(" or "));
        render::error(&message, (!has.is_empty()).then_some(help.as_str()));
        return Exit::Input;
    }
    if of_several.is_some() {
        let of = (arguments.measure, &*arguments.points);
        return eval_several::execute(&loaded, &values, mode, of);
    }
    let Some(measure) = measure else {
        return super::eval_gradient::execute(&loaded, &values, mode, &arguments.points);
    };
    let kinds = [Kind::Measures];
    let compiled = match loaded.model.compile_only(&kinds, &values, mode, Form::Accurate) {
        Ok(compiled) => compiled,
        Err(error) => {
            print_compile_error(&loaded, &error);
            return Exit::Input;
        }
    };
    let directed = measure == Measure::Length && loaded.model.sees_directions();
    let names = match directed {
        true => &["l", "Xi1", "Xi2", "Xi3"][..=dimension],
        false => &[measure.symbol(), measure.reference_symbol()][..],
    };
    let Some(rows) = table::rows(&arguments.points, names, not_a_reference) else {
        return Exit::Input;
    };
    let columns: (Vec<f64>, Vec<f64>) = rows.iter().map(|row| (row[0], length(&row[1..]))).unzip();
    for dropped in compiled.dropped.iter().filter(|d| d.argument == measure.symbol()) {
        console::note(&dropped.reason);
    }
    let out = match compiled.kernels.iter().find(|kernel| kernel.measure() == measure) {
        Some(kernel) => {
            let change: Vec<f64> =
                columns.0.iter().zip(&columns.1).map(|(l, rest)| (l - rest) / rest).collect();
            let axes = if kernel.fields().is_empty() { 0..0 } else { 1..1 + dimension };
            let component = |axis: usize| {
                rows.iter().zip(&columns.1).map(move |(row, length)| row[axis] / length)
            };
            let (measure, reference) = (&columns.0[..], &columns.1[..]);
            let fields: Vec<f64> = axes.flat_map(component).collect();
            let batch = Batch { measure, reference, change: &change, fields: &fields };
            kernel.derivatives(batch)
        }
        // An energy with coefficient 0 is not modelled: it is 0 everywhere.
        None => Derivatives::zeros(columns.0.len()),
    };
    print_rows(measure, &columns, &out)
}

/// The length of a vector at rest; a measure at rest, which may not be negative, as it stands.
fn length(rest: &[f64]) -> f64 {
    match rest {
        [alone] => *alone,
        vector => vector.iter().fold(0.0, |square, x| square + x * x).sqrt(),
    }
}

/// What is wrong with the numbers of a row behind the first as a measure at rest, or as the vector of a bond.
fn not_a_reference(row: &[f64]) -> Option<(usize, String)> {
    let rest = length(&row[1..]);
    let is_one = rest.is_finite() && rest > 0.0;
    (!is_one).then(|| (1, format!("a reference measure is finite and > 0, not {rest}")))
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
