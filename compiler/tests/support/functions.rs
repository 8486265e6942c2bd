//! What holds for conditions under which something breaks and for what bonds remember: they are functions of
//! a measure like energies, and are held to the same.

use piola_compiler::verify::same_bits;
use piola_compiler::verify::sample::Point;
use piola_compiler::{
    Batch, BondFunction, BondFunctionKind, Form, Kernel, Level, Measure, Mode, Model, ScalarEnergy,
    Values, WrittenEnergy, print,
};

use super::held::{Held, OfMeasure, hold};
use super::{PLACES, POINTS, balanced, placed, potential_of, round_trip};
use piola_compiler::check;
use piola_grammar::parse;

/// Numbers that a bond may remember.
const REMEMBERED: [f64; 4] = [0.0, 0.3, -1.5, 1e8];

/// Follows margins and next states of a model as far as they can be compiled.
///
/// # Panics
/// Where something does not hold.
pub(super) fn follow(text: &str, model: &Model, values: &Values) -> Held {
    let mut held = Held::default();
    let dimension = values.dimension;
    if let Ok(symbolic) = placed(text, model.bond_functions(dimension, None)) {
        let (dissipation, symbolic) = apart(symbolic);
        symbolic.iter().for_each(|one| prints(model, &one.function, dimension));
        super::dissipation::follow(text, model, values, &dissipation);
    }
    let mut values = values.clone();
    // The time step stands behind the parameters.
    if let Some(dt) = values.parameters.get_mut(model.parameters().len()) {
        *dt = 0.5;
    }
    let Ok(functions) = placed(text, model.bond_functions(dimension, Some(&values))) else {
        return held;
    };
    let (dissipation, functions) = apart(functions);
    super::dissipation::follow(text, model, &values, &dissipation);
    let remembering = values.clone().with_states(model);
    let Some(of_levels) = Level::ALL
        .into_iter()
        .map(|level| kernels(text, model, &remembering, Mode::Jit(level)))
        .collect::<Option<Vec<_>>>()
    else {
        return held;
    };
    let interpreted = kernels(text, model, &remembering, Mode::Interpreter).unwrap_or_default();
    let written = [model.written_margins(&values), model.written_next_states(&values)].concat();
    assert_eq!([functions.len(), interpreted.len()], [written.len(); 2], "{text}");
    for (k, one) in functions.iter().enumerate() {
        prints(model, &one.function, dimension);
        if one.function.fields.is_empty() {
            round_trip(model, &one.function, dimension);
        }
        for (level, kernels) in Level::ALL.into_iter().zip(&of_levels) {
            if level == Level::Strict {
                same(&kernels[k], &interpreted[k], &one.text);
            }
            let is_margin = matches!(one.kind, BondFunctionKind::Margin { .. });
            let found = means(&kernels[k], &one.function, &written[k], dimension);
            held.add(found.unwrap_or_else(|what| {
                let kind = if is_margin { "break when" } else { "update to" };
                panic!("{kind} {} {what}, {level:?}", one.text)
            }));
        }
    }
    held
}

/// What is dissipated, and all else.
fn apart(functions: Vec<BondFunction>) -> (Vec<BondFunction>, Vec<BondFunction>) {
    functions.into_iter().partition(|one| one.kind == BondFunctionKind::Dissipation)
}

/// Kernels of margins, then of next states; nothing where one is too large.
fn kernels(text: &str, model: &Model, values: &Values, mode: Mode) -> Option<Vec<Kernel>> {
    let margins = placed(text, model.criteria(values, mode, Form::Accurate)).ok()?;
    let next = placed(text, model.next_states(values, mode, Form::Accurate)).ok()?;
    let margins = margins.into_iter().map(|one| one.margin);
    Some(margins.chain(next.into_iter().map(|one| one.next)).collect())
}

/// Printers come to an end, and what they print can be read.
fn prints(model: &Model, function: &ScalarEnergy, dimension: usize) {
    for root in 0..3 {
        let again = potential_of(model, function, dimension, root);
        let again = again.replacen('\n', "\nparameter dt\n", 1);
        let ast = parse(&again).unwrap_or_else(|e| panic!("{e:#?}\n{again}"));
        check(&ast).unwrap_or_else(|e| panic!("{e:#?}\n{again}"));
    }
    let latex = print::latex(model, function);
    assert!(balanced(&latex), "{latex}");
}

/// Machine code gives the interpreter's bits, at any point and whatever is remembered.
pub(super) fn same(code: &Kernel, graph: &Kernel, text: &str) {
    for shift in 0..REMEMBERED.len() {
        let fields: Vec<f64> = (0..code.fields().len() * POINTS.len())
            .map(|k| REMEMBERED[(k / POINTS.len() + shift) % REMEMBERED.len()])
            .collect();
        let run = |kernel: &Kernel| {
            let column = |k: usize| POINTS.iter().map(|p| p[k]).collect::<Vec<f64>>();
            let (measure, reference, change) = (column(0), column(1), column(2));
            let batch = Batch {
                measure: &measure,
                reference: &reference,
                change: &change,
                fields: &fields,
            };
            let out = kernel.derivatives(batch);
            [out.psi, out.dpsi, out.d2psi]
        };
        for (machine, reference) in run(code).iter().zip(run(graph)) {
            let is_same = machine.iter().zip(&reference).all(|(x, y)| same_bits(*x, *y));
            assert!(is_same, "{text}: {machine:?} {reference:?}");
        }
    }
}

/// Machine code gives what was written, with what is remembered at the start.
fn means(
    kernel: &Kernel,
    function: &ScalarEnergy,
    written: &WrittenEnergy,
    dimension: usize,
) -> Result<Held, String> {
    let mut held = Held::default();
    // Lengths are no negative numbers, and `min(0, l)` is compiled as 0.
    let is_signed = |measure: Measure| measure.is_signed(dimension);
    let places =
        PLACES.into_iter().filter(|[stretch, _]| *stretch >= 0.0 || is_signed(kernel.measure()));
    for [stretch, reference] in places {
        let point = Point { measure: stretch * reference, reference };
        let batch = Batch {
            measure: &[point.measure],
            reference: &[point.reference],
            change: &[point.change()],
            fields: kernel.fields(),
        };
        let out = kernel.derivatives(batch);
        let found = [out.psi[0], out.dpsi[0], out.d2psi[0]];
        let place = OfMeasure { energy: function, written, point };
        held.add(hold(&place, found, true).map_err(|what| format!("at {point:?}: {what}"))?);
    }
    Ok(held)
}
