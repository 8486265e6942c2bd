//! `piola eval --measure F`: deformation gradients in, psi and P out, one row per row.

use piola_compiler::{Form, GradientBatch, Kind, Mode, Values};
use piola_runtime::output::decimal;

use super::Exit;
use super::derive::print_compile_error;
use crate::console;
use crate::potential::Loaded;
use crate::render;
use crate::table;

/// Evaluates every row of a table with the columns `F11,F12,..`.
pub(super) fn execute(loaded: &Loaded, values: &Values, mode: Mode, points: &str) -> Exit {
    let kinds = [Kind::Gradient];
    let compiled = match loaded.model.compile_only(&kinds, values, mode, Form::Accurate) {
        Ok(compiled) => compiled,
        Err(error) => {
            print_compile_error(loaded, &error);
            return Exit::Input;
        }
    };
    for dropped in &compiled.dropped {
        console::note(&dropped.reason);
    }
    let d = values.dimension;
    let names = names("F", d);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let Some(rows) = table::rows(points, &names, |_| None) else { return Exit::Input };
    let (n, n_components) = (rows.len(), d * d);
    let component = |k: usize| rows.iter().map(move |row| row[k]);
    let gradient: Vec<f64> = (0..n_components).flat_map(component).collect();
    let rest = |k: usize| if k / d == k % d { 1.0 } else { 0.0 };
    let change: Vec<f64> =
        (0..n_components).flat_map(|k| component(k).map(move |f| f - rest(k))).collect();
    let (mut psi, mut stress) = (vec![0.0; n], vec![0.0; n * n_components]);
    // An energy with coefficient 0 is not modelled: it is 0 everywhere.
    if let Some(kernel) = compiled.gradient {
        let at = GradientBatch { n, gradient: &gradient, change: &change, fields: &[] };
        kernel.evaluate(at, &mut psi, &mut stress);
    }
    print_rows(d, &rows, &psi, &stress)
}

/// `F11`, `F12`, .. of a tensor.
fn names(tensor: &str, d: usize) -> Vec<String> {
    (0..d * d).map(|k| format!("{tensor}{}{}", k / d + 1, k % d + 1)).collect()
}

fn print_rows(d: usize, rows: &[Vec<f64>], psi: &[f64], stress: &[f64]) -> Exit {
    let header = [names("F", d), vec!["psi".to_string()], names("P", d)].concat();
    let mut text = header.join(",") + "\n";
    let mut first = None;
    for (p, row) in rows.iter().enumerate() {
        let mut numbers = row.clone();
        numbers.push(psi[p]);
        numbers.extend((0..d * d).map(|k| stress[k * rows.len() + p]));
        if first.is_none() && !numbers[d * d..].iter().all(|x| x.is_finite()) {
            first = Some(p);
        }
        text.push_str(&numbers.into_iter().map(decimal).collect::<Vec<_>>().join(","));
        text.push('\n');
    }
    console::out(&text);
    let Some(first) = first else { return Exit::Done };
    render::error(&format!("psi or P is not finite in row {}", first + 1), None);
    Exit::Findings
}
