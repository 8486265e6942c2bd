//! What deformation gradients, and points by what they gather, remember: states after some histories, and next
//! states against numbers of any precision.
//!
//! A next state may be off by 64 roundings of itself, and by what it changes by when one of its inputs is rounded
//! in the last place of their norm. What is off by more is wrong where the next state as written keeps its digits in
//! doubles that are rounded at random (`next_state`). What no double holds has no digits to lose: such places tell
//! nothing.

use super::gathered::{self, Place};
use super::sample::Random;
use super::vectors::{self, Places, Seen};
use super::{Miss, Subject, UNIT_ROUNDOFF, Verification, Witness, gradient, next_state};
use crate::expression::Operator;
use crate::expression::number::Number;
use crate::expression::random_rounding::RandomlyRounded;
use crate::gathered::{
    FamilyKernel, GatheredBatch, GatheredNextState, VectorKernels, WrittenFamily,
    WrittenGatheredEnergy,
};
use crate::kernel::{Level, Mode};
use crate::model::{Model, Of, OfFamily};
use crate::point::WrittenGradientEnergy;
use crate::point::sample::{self, Sample};
use crate::point::truth::norm;
use crate::remember::{History, RememberingFamily, RememberingGradient};
use crate::specialise::{CompileError, Form};
use crate::values::Values;

/// Largest error of a next state, in roundings.
const BAR: f64 = 64.0;

/// The states of families after a history of stretches, one way after the other: their numbers with their
/// values.
pub(super) fn after(
    model: &Model,
    values: &Values,
    stretches: &[f64],
) -> Result<Vec<(usize, f64)>, CompileError> {
    if model.family_updates().is_empty() {
        return Ok(Vec::new());
    }
    let (mode, form) = (Mode::Interpreter, Form::Accurate);
    let (mut gradient, _) = RememberingGradient::new(model, values, mode, form)?;
    let mut vectors = RememberingFamily::new(model, values, (mode, form))?;
    let values = a_second_later(model, values).with_states(model);
    let of_points = model.gathered_next_states(&values, mode, form)?;
    let mut fields: Vec<f64> = values.typical().map(|(_, value)| value).collect();
    for stretch in stretches {
        let change = stretched(values.dimension, stretch - 1.0);
        gradient.advance(&change, 1.0);
        vectors.iter_mut().for_each(|family| family.advance(&change, 1.0));
        let next: Vec<f64> =
            of_points.iter().map(|one| at_integrals(one, *stretch, &fields)).collect();
        of_points.iter().zip(next).for_each(|(one, value)| fields[one.field] = value);
    }
    let of_points = of_points.iter().map(|one| (one.state, fields[one.field]));
    let of_vectors = vectors.iter().flat_map(RememberingFamily::states);
    Ok(gradient.states().chain(of_points).chain(of_vectors).collect())
}

/// `F - I`, row by row, where a body is stretched along one axis, widened by a third of that, and sheared.
fn stretched(d: usize, size: f64) -> Vec<f64> {
    let component = |k: usize| match (k / d, k % d) {
        (0, 0) => size,
        (0, 1) => 0.2 * size,
        (r, c) if r == c => size / 3.0,
        _ => 0.0,
    };
    (0..d * d).map(component).collect()
}

/// What a state of a point becomes where all integrals are a number.
fn at_integrals(one: &GatheredNextState, number: f64, fields: &[f64]) -> f64 {
    let fields = if one.next.fields().is_empty() { &[] } else { fields };
    let variables = vec![number; one.next.n_variables()];
    let mut next = [0.0];
    let at = GatheredBatch { n: 1, variables: &variables, change: &[], reference: &[], fields };
    one.next.evaluate(at, &mut next, &mut []);
    next[0]
}

/// The values with a time step of one second.
pub(crate) fn a_second_later(model: &Model, values: &Values) -> Values {
    let mut values = values.clone();
    if let Some(dt) = model.number_of_time_step() {
        values.parameters[usize::from(dt)] = 1.0;
    }
    values
}

/// Verifies what every state of deformation gradients becomes at `2 n` gradients and at most 200, and of
/// points at `n` places, a second after the last time.
pub(super) fn verify(
    model: &Model,
    values: &Values,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let values = a_second_later(model, values).without_fields();
    let modes = [Mode::Jit(Level::Strict), Mode::Jit(Level::Fast), Mode::Interpreter];
    let found = |state: usize, text: &str, family| found(model, (state, text), family);
    let mut all = Vec::new();
    let samples = gradient::samples(values.dimension, n);
    let [strict, fast, interpreted] =
        modes.map(|mode| model.gradient_next_states(&values, mode, Form::Accurate));
    for ((strict, fast), interpreted) in strict?.iter().zip(&fast?).zip(&interpreted?) {
        let levels = [strict, fast, interpreted].map(|one| {
            let all = sample::evaluate(&one.next, &samples);
            all.iter().map(|place| place[0]).collect::<Vec<f64>>()
        });
        let mut one = found(strict.state, &strict.text, OfFamily::Gradient);
        compare(&mut one, levels, &samples, &strict.written);
        all.push(one);
    }
    let [strict, fast, interpreted] =
        modes.map(|mode| model.gathered_next_states(&values, mode, Form::Accurate));
    for ((strict, fast), interpreted) in strict?.iter().zip(&fast?).zip(&interpreted?) {
        let places = gathered::places(&strict.next, n);
        let levels = [strict, fast, interpreted].map(|one| {
            let mut next = vec![0.0; places.len()];
            gathered::batch(&one.next, &places, |at| one.next.evaluate(at, &mut next, &mut []));
            next
        });
        let mut one = found(strict.state, &strict.text, OfFamily::Points);
        compare(&mut one, levels, &places, &strict.written);
        all.push(one);
    }
    Ok(all)
}

fn found(model: &Model, (state, text): (usize, &str), family: OfFamily) -> Verification {
    let name = &model.parameters()[state].name;
    let subject = Subject::NextState(Of::Family(family), format!("{name} = {text}"));
    Verification::new(subject, &[(Witness::TruthFar, BAR)])
}

/// The same of points by what they gather of vectors, at `n` places.
pub(super) fn verify_vectors(
    (model, values): (&Model, &Values),
    kernels: &VectorKernels,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let values = &a_second_later(model, values);
    let modes = [Mode::Jit(Level::Strict), Mode::Jit(Level::Fast), Mode::Interpreter];
    let [strict, fast, interpreted] =
        modes.map(|mode| model.vector_next_states(values, mode, Form::Accurate));
    let mut random = Random::new(0x6e65_7874_7374);
    let mut all = Vec::new();
    for ((strict, fast), interpreted) in strict?.iter().zip(&fast?).zip(&interpreted?) {
        let kernel = &strict.next;
        let place = |_| {
            let place =
                vectors::bond(kernels, (model, values), (vectors::SIZES, false), &mut random);
            let given = kernel.variables().iter().map(|slot| place.slot(*slot)).collect();
            PointOfVectors { place, given, kernel, of: (model, values) }
        };
        let places: Vec<PointOfVectors<'_>> = (0..n).map(place).collect();
        let all_places = places.iter().map(|one| one.place.clone()).collect();
        let all_places = Places::new(all_places, (model, values));
        let levels = [strict, fast, interpreted].map(|one| vectors::values(&one.next, &all_places));
        let mut one = found(model, (strict.state, &strict.text), OfFamily::Points);
        compare(&mut one, levels, &places, &strict.written);
        all.push(one);
    }
    Ok(all)
}

/// A point with what it gathers of vectors, as a kernel takes it.
struct PointOfVectors<'a> {
    place: vectors::Place,
    given: Vec<f64>,
    kernel: &'a FamilyKernel,
    of: (&'a Model, &'a Values),
}

/// A place at which a function as written is known to many digits.
pub(super) trait Known<W> {
    /// What is true there, where it is a number.
    fn truth(&self, written: &W) -> Option<f64>;
    /// What is written in doubles that are rounded at random.
    fn rounded(&self, written: &W, seed: u64) -> f64;
    /// What is given there.
    fn given(&self) -> &[f64];
    /// The same where other numbers are given.
    fn moved(&self, given: Vec<f64>) -> Self;
}

impl Known<WrittenGradientEnergy> for Sample {
    fn truth(&self, written: &WrittenGradientEnergy) -> Option<f64> {
        super::gradient_margin::truth(written, self)
    }

    fn rounded(&self, written: &WrittenGradientEnergy, seed: u64) -> f64 {
        let sum = |given, rest| {
            let given = RandomlyRounded::given(given, seed);
            match rest == 0.0 {
                true => given,
                false => RandomlyRounded::binary(Operator::Add, given, Number::constant(rest)),
            }
        };
        super::gradient_margin::value(written, self, sum).value()
    }

    fn given(&self) -> &[f64] {
        Sample::given(self)
    }

    fn moved(&self, given: Vec<f64>) -> Sample {
        Sample::moved(self, given)
    }
}

impl Known<WrittenGatheredEnergy> for Place {
    fn truth(&self, written: &WrittenGatheredEnergy) -> Option<f64> {
        super::gathered_margin::truth(written, self)
    }

    fn rounded(&self, written: &WrittenGatheredEnergy, seed: u64) -> f64 {
        let given = |value| RandomlyRounded::given(value, seed);
        written.psi(|k| given(self.variables[k]), given(self.reference)).value()
    }

    fn given(&self) -> &[f64] {
        &self.variables
    }

    fn moved(&self, given: Vec<f64>) -> Place {
        Place::moved(self, given)
    }
}

impl Known<WrittenFamily> for PointOfVectors<'_> {
    fn truth(&self, written: &WrittenFamily) -> Option<f64> {
        let places = Places::new(vec![self.place.clone()], self.of);
        Seen { written, kernel: self.kernel, places: &places }.value(0)
    }

    fn rounded(&self, written: &WrittenFamily, seed: u64) -> f64 {
        let places = Places::new(vec![self.place.clone()], self.of);
        Seen { written, kernel: self.kernel, places: &places }.rounded(0, seed)
    }

    fn given(&self) -> &[f64] {
        &self.given
    }

    fn moved(&self, given: Vec<f64>) -> Self {
        PointOfVectors { place: self.place.moved(self.kernel, &given), given, ..*self }
    }
}

pub(super) fn compare<W, P: Known<W>>(
    found: &mut Verification,
    [strict, fast, interpreted]: [Vec<f64>; 3],
    places: &[P],
    written: &W,
) {
    for (k, place) in places.iter().enumerate() {
        found.count(&[strict[k]], &[interpreted[k]]);
        let Some(truth) = in_doubles(place, written) else { continue };
        let unit = UNIT_ROUNDOFF * truth.abs() + rounded_inputs(place, written, truth);
        for value in [strict[k], fast[k]] {
            let error = (value - truth).abs() / (unit + f64::MIN_POSITIVE);
            found.see(0, 0, error, |bar| Miss {
                place: place.given().to_vec(),
                order: 0,
                compiled: vec![value],
                expected: vec![truth],
                tolerance: bar * unit,
                is_wrong: next_state::is_wrong(value, truth, |seed| place.rounded(written, seed)),
            });
        }
    }
}

/// What is true at a place, where it is a number that a double holds.
fn in_doubles<W, P: Known<W>>(place: &P, written: &W) -> Option<f64> {
    place.truth(written).filter(|truth| truth.is_finite())
}

/// The most that a next state changes by where one of its inputs is rounded in the last place of their norm.
fn rounded_inputs<W, P: Known<W>>(place: &P, written: &W, truth: f64) -> f64 {
    let given = place.given();
    let step = f64::EPSILON * norm(given.iter().copied());
    let change = |k: usize, sign: f64| {
        let mut moved = given.to_vec();
        moved[k] += sign * step;
        in_doubles(&place.moved(moved), written).map_or(0.0, |there| (there - truth).abs())
    };
    let each = (0..given.len()).flat_map(|k| [change(k, 1.0), change(k, -1.0)]);
    each.fold(0.0, f64::max)
}
