//! What bonds remember: energies and conditions with what they remember after some histories, and next
//! states against numbers of any precision.
//!
//! A next state may be off by 64 roundings of itself, and by what it changes by when the change of the
//! measure, or the measure itself, is rounded: a return map takes the strain and hands on its rounding. What is off by
//! more is wrong where the next state as written keeps its digits in doubles that are rounded at random (`next_state`).
//! What no double holds has no digits to lose: such places tell nothing.

use super::{
    Columns, Miss, Subject, UNIT_ROUNDOFF, Verification, Witness, families, next_state, sample,
};
use crate::expression::number::Number as _;
use crate::expression::precise::Precise;
use crate::expression::random_rounding::RandomlyRounded;
use crate::kernel::{Kernel, Level, Mode, WrittenEnergy};
use crate::measure::Measure;
use crate::model::{Model, Of, Variant};
use crate::remember::Remembering;
use crate::specialise::{CompileError, Form};
use crate::values::Values;
use sample::Point;

/// Largest error of a next state, in roundings.
const BAR: f64 = 64.0;

/// Stretches through which bonds, triangles and tetrahedra have gone, one way after the other.
const HISTORIES: [&[f64]; 4] = [&[1.02], &[1.3, 1.1], &[0.9], &[1.005, 0.98, 1.6]];

/// The values as they are, and with what bonds remember after some histories, each once.
pub(crate) fn histories(model: &Model, values: &Values) -> Result<Vec<Values>, CompileError> {
    let mut all = vec![values.clone()];
    if !model.has_memory() {
        return Ok(all);
    }
    let fields = values.clone().with_states(model).fields;
    let horizon = if values.horizon.is_finite() { values.horizon } else { 1.0 };
    let mut of_kinds = Vec::new();
    for measure in Measure::ALL.into_iter().filter(|measure| model.remembers(*measure)) {
        let one = Remembering::new(model, measure, values, Mode::Interpreter, Form::Accurate)?;
        of_kinds.push((measure, one));
    }
    for stretches in HISTORIES {
        let mut after = values.clone();
        for (measure, mut one) in of_kinds.iter().cloned() {
            let reference = (1..measure.points()).fold(1.0, |power, _| power * 0.5 * horizon);
            for stretch in stretches {
                one.advance(Point { measure: stretch * reference, reference }, 1.0);
            }
            let own = |field: &u16| {
                model.kind_of_state(usize::from(*field)) == Some(Of::Measure(measure))
            };
            for (field, value) in fields.iter().zip(one.fields()).filter(|(field, _)| own(field)) {
                after.parameters[usize::from(*field)] = *value;
            }
        }
        for (state, value) in families::after(model, values, stretches)? {
            after.parameters[state] = value;
        }
        if after.parameters.iter().all(|x| x.is_finite()) && !all.contains(&after) {
            all.push(after);
        }
    }
    Ok(all)
}

/// Verifies what every state becomes at about `2 n` points, a second after the last time.
pub(super) fn verify(
    model: &Model,
    variant: &Variant,
    values: &Values,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let mut values = values.clone();
    if let Some(dt) = model.time_step() {
        values.parameters[usize::from(dt)] = 1.0;
    }
    let next = |mode| model.next_states(&values, mode, Form::Accurate);
    let strict = next(Mode::Jit(Level::Strict))?;
    let fast = next(Mode::Jit(Level::Fast))?;
    let interpreted = next(Mode::Interpreter)?;
    let written = model.written_next_states(&values);
    let of_state = |(k, written): (usize, &WrittenEnergy)| {
        let (name, measure) =
            (&model.parameters()[variant.updates[k].state].name, strict[k].measure());
        let points = sample::points(variant, measure, &values, n);
        let subject =
            Subject::NextState(Of::Measure(measure), format!("{name} = {}", strict[k].text));
        let verification = Verification::new(subject, &[(Witness::TruthFar, BAR)]);
        let kernels = [&strict[k].next, &fast[k].next, &interpreted[k].next];
        compare(verification, kernels, written, &points)
    };
    // There are no tetrahedra in the plane.
    let is_there =
        |(k, _): &(usize, &WrittenEnergy)| strict[*k].measure().points() <= variant.dimension + 1;
    Ok(written.iter().enumerate().filter(is_there).map(of_state).collect())
}

pub(super) fn compare(
    mut found: Verification,
    kernels: [&Kernel; 3],
    written: &WrittenEnergy,
    points: &[Point],
) -> Verification {
    let columns = Columns::new(points);
    let [strict, fast, interpreted] = kernels.map(|kernel| columns.derivatives(kernel).psi);
    for (k, point) in points.iter().enumerate() {
        found.count(&[strict[k]], &[interpreted[k]]);
        let Some(truth) = truth(written, *point, 0.0) else { continue };
        let unit = UNIT_ROUNDOFF * truth.abs() + rounded_inputs(written, *point, truth);
        for value in [strict[k], fast[k]] {
            let error = (value - truth).abs() / (unit + f64::MIN_POSITIVE);
            found.see(0, 0, error, |bar| Miss {
                place: vec![point.measure, point.reference],
                order: 0,
                compiled: vec![value],
                expected: vec![truth],
                tolerance: bar * unit,
                is_wrong: next_state::is_wrong(value, truth, |seed| rounded(written, *point, seed)),
            });
        }
    }
    found
}

/// How much a next state changes where the change of the measure is rounded, with the measure by so much.
fn rounded_inputs(written: &WrittenEnergy, point: Point, truth_here: f64) -> f64 {
    let size = point.measure - point.reference;
    let moved = [-UNIT_ROUNDOFF, UNIT_ROUNDOFF]
        .map(|u| truth(written, point, u * size).map_or(0.0, |there| (there - truth_here).abs()));
    moved[0].max(moved[1])
}

/// A next state as written in doubles that are rounded at random.
fn rounded(written: &WrittenEnergy, point: Point, seed: u64) -> f64 {
    let given = |value| RandomlyRounded::given(value, seed);
    written.evaluate(given(point.measure), given(point.reference)).value()
}

/// A next state as written to many digits, where it is a number that a double holds; the measure is larger by so
/// much, exactly.
pub(super) fn truth(written: &WrittenEnergy, point: Point, by: f64) -> Option<f64> {
    // In twice as many digits as margins have, a step by a rounding of a small change is not lost.
    let measure = Precise::<512>::line(point.measure, 1.0, by);
    let next = written.evaluate(measure, Precise::constant(point.reference)).value();
    next.is_finite().then_some(next)
}
