//! `piola eval` of functions of several numbers: energies of several measures of a triangle or a tetrahedron, and
//! energies of points and of bonds of what points gather.

use piola_compiler::{
    CliquePart, Compiled, CoupledBatch, CoupledKernel, FamilyBatch, FamilyKernel, Form,
    GatheredBatch, GatheredKernel, Kind, Measure, Mode, Model, Slot, Values, Variable,
};
use piola_runtime::output::decimal;

use super::Exit;
use super::derive::print_compile_error;
use crate::cli::MeasureName;
use crate::console;
use crate::potential::Loaded;
use crate::render;
use crate::table;

/// What is evaluated: a kernel with the columns that it takes.
enum Subject<'a> {
    Coupled(&'a CoupledKernel),
    Vector(&'a CoupledKernel),
    Numbers(&'a GatheredKernel),
    Vectors(&'a FamilyKernel),
}

/// Whether it names an energy of several numbers; what it is an energy of.
pub(super) fn of_several(measure: MeasureName) -> Option<&'static str> {
    match measure {
        MeasureName::Points => Some("points, of what they gather"),
        MeasureName::Bonds => Some("bonds, of what their ends gather"),
        MeasureName::Xi => Some("the vector of a bond"),
        MeasureName::Triangles => Some("triangles, of several measures"),
        MeasureName::Tetrahedra => Some("tetrahedra, of several measures"),
        MeasureName::L | MeasureName::A | MeasureName::V | MeasureName::F => None,
    }
}

/// The words that `--measure` takes for the energies of several numbers of a potential.
pub(super) fn words(model: &Model) -> Vec<&'static str> {
    let coupled = model.coupled();
    let gathered = |of_bonds: bool| {
        let variants = model.dimensions().filter_map(|d| model.variant(d));
        variants.flat_map(|one| &one.gathered_energies).any(|one| one.of_bonds == of_bonds)
    };
    let all = [
        ("xi", coupled.contains(&Measure::Length)),
        ("points", gathered(false)),
        ("bonds", gathered(true)),
        ("triangles", coupled.contains(&Measure::Area)),
        ("tetrahedra", coupled.contains(&Measure::Volume)),
    ];
    all.into_iter().filter_map(|(word, is_there)| is_there.then_some(word)).collect()
}

/// Evaluates every row of a table with the columns of the energy.
pub(super) fn execute(
    loaded: &Loaded,
    values: &Values,
    mode: Mode,
    (measure, points): (MeasureName, &str),
) -> Exit {
    let kinds = [Kind::Coupled, Kind::Gathered];
    let compiled = match loaded.model.compile_only(&kinds, values, mode, Form::Accurate) {
        Ok(compiled) => compiled,
        Err(error) => {
            print_compile_error(loaded, &error);
            return Exit::Input;
        }
    };
    compiled.dropped.iter().for_each(|dropped| console::note(&dropped.reason));
    let Some(subject) = subject(&compiled, measure) else {
        render::error("the parameters leave nothing of this energy: it is 0 everywhere", None);
        return Exit::Input;
    };
    let (columns, by) = subject.columns(values.dimension);
    let names: Vec<&str> = columns.iter().map(String::as_str).collect();
    let refusal = |row: &[f64]| subject.not_a_reference(values.dimension, row);
    let Some(rows) = table::rows(points, &names, refusal) else { return Exit::Input };
    let (psi, gradient) = subject.evaluate(&rows, values);
    print_rows((&columns, &by), &rows, &psi, &gradient)
}

fn subject(compiled: &Compiled, measure: MeasureName) -> Option<Subject<'_>> {
    let coupled = |clique: Measure| compiled.coupled.iter().find(|own| own.clique() == clique);
    let (numbers, vectors) = (compiled.gathered.as_ref(), compiled.vectors.as_ref());
    match measure {
        MeasureName::Xi => coupled(Measure::Length).map(Subject::Vector),
        MeasureName::Triangles => coupled(Measure::Area).map(Subject::Coupled),
        MeasureName::Tetrahedra => coupled(Measure::Volume).map(Subject::Coupled),
        MeasureName::Points => {
            let of_numbers = numbers.and_then(|own| own.points.as_ref()).map(Subject::Numbers);
            of_numbers.or(vectors.and_then(|own| own.points.as_ref()).map(Subject::Vectors))
        }
        _ => {
            let of_numbers = numbers.and_then(|own| own.bonds.as_ref()).map(Subject::Numbers);
            of_numbers.or(vectors.and_then(|own| own.bonds.as_ref()).map(Subject::Vectors))
        }
    }
}

impl Subject<'_> {
    /// The columns of the table, and what the energy is differentiated by.
    fn columns(&self, d: usize) -> (Vec<String>, Vec<String>) {
        let axes = |stem: &'static str| (1..=d).map(move |axis| format!("{stem}{axis}"));
        match self {
            Subject::Coupled(kernel) => {
                let now = |variable: &Variable| variable.symbol().to_string();
                let now: Vec<String> = kernel.variables().iter().map(now).collect();
                let rest = now.iter().map(|symbol| at_rest(symbol));
                (now.iter().cloned().chain(rest).collect(), now)
            }
            Subject::Vector(_) => (axes("Xi").chain(axes("u")).collect(), axes("u").collect()),
            Subject::Numbers(kernel) => {
                let of_bonds = kernel.of_bonds();
                let n = kernel.n_variables() - usize::from(of_bonds);
                let integrals = (1..=n).map(|k| format!("I{k}"));
                let length = of_bonds.then(|| "l".to_string());
                let by = length.iter().cloned().chain(integrals.clone()).collect();
                let rest: Vec<String> = match kernel.fields().is_empty() {
                    true => of_bonds.then(|| "L".to_string()).into_iter().collect(),
                    false => axes("Xi").collect(),
                };
                (length.into_iter().chain(rest).chain(integrals).collect(), by)
            }
            Subject::Vectors(kernel) => {
                let slot = |slot: &Slot| match slot {
                    Slot::Length => "L".to_string(),
                    Slot::Moved(axis) => format!("u{}", axis + 1),
                    Slot::Own(k) => format!("I{}", k + 1),
                    Slot::Neighbour(k) => format!("neighbour_I{}", k + 1),
                    Slot::Multiplier(k) => format!("A{}", k + 1),
                };
                let by: Vec<String> = kernel.variables().iter().map(slot).collect();
                let of_bonds = kernel.given().contains(&Slot::Length);
                let rest = axes("Xi").filter(|_| of_bonds);
                let given = kernel.given().iter().filter(|slot| **slot != Slot::Length).map(slot);
                (rest.chain(by.iter().cloned()).chain(given).collect(), by)
            }
        }
    }

    /// Which column of a row holds a measure at rest, or begins the vector of a bond there, that is none, and why.
    fn not_a_reference(&self, d: usize, row: &[f64]) -> Option<(usize, String)> {
        let measures = match self {
            Subject::Coupled(kernel) => kernel.variables().len()..row.len(),
            Subject::Numbers(kernel) if kernel.of_bonds() && kernel.fields().is_empty() => 1..2,
            _ => 0..0,
        };
        let vector = match self {
            Subject::Vector(_) => 0..d,
            Subject::Numbers(kernel) if !kernel.fields().is_empty() => 1..1 + d,
            Subject::Vectors(kernel) if kernel.given().contains(&Slot::Length) => 0..d,
            _ => 0..0,
        };
        let length = |own: &[f64]| own.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
        let first = vector.start;
        let vector = (!vector.is_empty()).then(|| (first, length(&row[vector])));
        let all = measures.map(|k| (k, row[k])).chain(vector);
        let mut wrong = all.filter(|(_, rest)| !(rest.is_finite() && *rest > 0.0));
        wrong
            .next()
            .map(|(k, rest)| (k, format!("a reference measure is finite and > 0, not {rest}")))
    }

    /// psi and its derivatives, one array after the other.
    fn evaluate(&self, rows: &[Vec<f64>], values: &Values) -> (Vec<f64>, Vec<f64>) {
        let (n, d) = (rows.len(), values.dimension);
        let column = |k: usize| rows.iter().map(move |row| row[k]);
        let all = |columns: std::ops::Range<usize>| columns.flat_map(column).collect::<Vec<f64>>();
        let length_of = |first: usize| {
            let length = |row: &Vec<f64>| {
                row[first..first + d].iter().fold(0.0, |sum, x| sum + x * x).sqrt()
            };
            rows.iter().map(length).collect::<Vec<f64>>()
        };
        let unit = |first: usize, lengths: &[f64]| {
            let one = |axis: usize| {
                let lengths = lengths.to_vec();
                column(first + axis).zip(lengths).map(|(x, length)| x / length)
            };
            (0..d).flat_map(one).collect::<Vec<f64>>()
        };
        let mut psi = vec![0.0; n];
        match self {
            Subject::Coupled(kernel) => {
                let m = kernel.variables().len();
                let (variables, reference) = (all(0..m), all(m..2 * m));
                let pairs = variables.iter().zip(&reference);
                let change: Vec<f64> = pairs.map(|(now, rest)| (now - rest) / rest).collect();
                let mut gradient = vec![0.0; m * n];
                let (variables, reference, change) = (&variables, &reference, &change);
                let at = CoupledBatch { n, variables, reference, change, fields: &[] };
                kernel.evaluate(at, &mut psi, &mut gradient);
                (psi, gradient)
            }
            Subject::Vector(kernel) => {
                let gradients = rows.iter().map(|row| of_vector(kernel, row));
                let (values, by_row): (Vec<f64>, Vec<Vec<f64>>) = gradients.unzip();
                (values, (0..d).flat_map(|axis| by_row.iter().map(move |of| of[axis])).collect())
            }
            Subject::Numbers(kernel) => {
                let first = usize::from(kernel.of_bonds());
                let has_directions = !kernel.fields().is_empty();
                let (reference, behind) = match (has_directions, kernel.of_bonds()) {
                    (true, _) => (length_of(first), first + d),
                    (false, true) => (all(1..2), 2),
                    (false, false) => (Vec::new(), 0),
                };
                let m = kernel.n_variables() - first;
                let fields = if has_directions { unit(first, &reference) } else { Vec::new() };
                let variables = [all(0..first), all(behind..behind + m)].concat();
                let pairs = variables.iter().zip(&reference).filter(|_| kernel.of_bonds());
                let change: Vec<f64> = pairs.map(|(l, rest)| (l - rest) / rest).collect();
                let mut gradient = vec![0.0; kernel.n_variables() * n];
                let reference = if kernel.of_bonds() { &reference[..] } else { &[] };
                let (variables, change, fields) = (&variables, &change, &fields);
                let at = GatheredBatch { n, variables, change, reference, fields };
                kernel.evaluate(at, &mut psi, &mut gradient);
                (psi, gradient)
            }
            Subject::Vectors(kernel) => {
                let of_bonds = kernel.given().contains(&Slot::Length);
                let first = if of_bonds { d } else { 0 };
                let lengths = if of_bonds { length_of(0) } else { Vec::new() };
                let m = kernel.variables().len();
                let mut next = first + m;
                let mut given = Vec::new();
                for slot in kernel.given() {
                    if *slot == Slot::Length {
                        given.extend(&lengths);
                    } else {
                        given.extend(column(next));
                        next += 1;
                    }
                }
                let fields =
                    if kernel.fields().is_empty() { Vec::new() } else { unit(0, &lengths) };
                let mut gradient = vec![0.0; m * n];
                let variables = all(first..first + m);
                let at = FamilyBatch { n, variables: &variables, given: &given, fields: &fields };
                kernel.evaluate(at, &mut psi, &mut gradient);
                (psi, gradient)
            }
        }
    }
}

/// An energy of the vector of a bond with its derivatives by that, for a row of `Xi` and `xi - Xi`.
fn of_vector(kernel: &CoupledKernel, row: &[f64]) -> (f64, Vec<f64>) {
    let (rest, moved) = row.split_at(row.len() / 2);
    let now: Vec<f64> = rest.iter().zip(moved).map(|(x, u)| x + u).collect();
    let norm = |vector: &[f64]| vector.iter().fold(0.0, |square, x| square + x * x).sqrt();
    let (length, length_now) = (norm(rest), norm(&now));
    // l^2 - L^2 = (xi - Xi).(xi + Xi), which keeps its digits near rest.
    let grown: f64 = moved.iter().zip(rest).zip(&now).map(|((u, x), y)| u * (x + y)).sum();
    let change_of_length = grown / (length * (length + length_now));
    let of = |length: f64, component: &dyn Fn(usize) -> f64| -> Vec<f64> {
        let one = |variable: &Variable| variable.component().map_or(length, component);
        kernel.variables().iter().map(one).collect()
    };
    let variables = of(length_now, &|axis| moved[axis]);
    let (reference, change) = (of(length, &|_| length), of(change_of_length, &|axis| moved[axis]));
    let unit = rest.iter().map(|x| x / length).filter(|_| !kernel.fields().is_empty());
    let fields: Vec<f64> = unit.collect();
    let (mut psi, mut gradient) = ([0.0], vec![0.0; variables.len()]);
    let at = CoupledBatch {
        n: 1,
        variables: &variables,
        reference: &reference,
        change: &change,
        fields: &fields,
    };
    kernel.evaluate(at, &mut psi, &mut gradient);
    let mut by_vector = vec![0.0; rest.len()];
    for (variable, slope) in kernel.variables().iter().zip(gradient) {
        match variable.component() {
            Some(axis) => by_vector[axis] += slope,
            None => {
                by_vector.iter_mut().zip(&now).for_each(|(by, x)| *by += slope * x / length_now)
            }
        }
    }
    (psi[0], by_vector)
}

/// `A` of `a`, `L2` of `l2`, `Angle` of `angle`.
fn at_rest(symbol: &str) -> String {
    let part = CliquePart::from_symbol(symbol).map(|part| part.reference_symbol());
    let measure = Measure::ALL.into_iter().find(|measure| measure.symbol() == symbol);
    part.or(measure.map(Measure::reference_symbol)).unwrap_or(symbol).to_string()
}

fn print_rows(
    (columns, by): (&[String], &[String]),
    rows: &[Vec<f64>],
    psi: &[f64],
    gradient: &[f64],
) -> Exit {
    let derivatives = by.iter().map(|name| format!("dpsi_d{name}"));
    let header = columns.iter().cloned().chain(["psi".to_string()]).chain(derivatives);
    let mut text = header.collect::<Vec<_>>().join(",") + "\n";
    let mut first = None;
    for (p, row) in rows.iter().enumerate() {
        let of = (0..by.len()).map(|k| gradient[k * rows.len() + p]);
        let found: Vec<f64> = std::iter::once(psi[p]).chain(of).collect();
        if first.is_none() && !found.iter().all(|x| x.is_finite()) {
            first = Some(p);
        }
        let all = row.iter().chain(&found).map(|x| decimal(*x));
        text.push_str(&all.collect::<Vec<_>>().join(","));
        text.push('\n');
    }
    console::out(&text);
    let Some(first) = first else { return Exit::Done };
    render::error(&format!("psi or a derivative is not finite in row {}", first + 1), None);
    Exit::Findings
}
