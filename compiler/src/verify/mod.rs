//! Compiled energies against independent witnesses, over the declared domain.
//!
//! Machine code at the strict level must equal the interpreter bit for bit. At every level it must
//! agree with the energy as written: over hyper-dual numbers and, where these lose the digits, over
//! numbers of any precision. What misses its tolerance is told apart ([`Outcome`]): a derivative that is
//! wrong, and digits that rounding takes.
//!
//! | module | what |
//! |---|---|
//! | `measure` | energies of measures, and of their squares |
//! | `gradient` | energies of the deformation gradient |
//! | `gathered` | energies of gathered values |
//! | `vectors` | what points gather of vectors, and energies of it |
//! | `margin`, `gradient_margin`, `gathered_margin`, `vector_margin` | conditions under which bonds break (`threshold`) |
//! | `remember` | what interactions remember, and all of the above with it |
//! | `next_state` | which next states are wrong |
//! | `dissipation` | what bonds dissipate |
//! | `consistent` | energies of measures at what interactions come to remember, with the tangent of load steps |
//! | `coupled` | energies of several measures of one interaction |
//! | `cause`, `stated` | which subexpression loses digits, and what it is in the text |
//! | [`sample`], [`truth`] | points to try energies of measures at, and their values there to any precision |

pub(crate) mod cause;
mod consistent;
pub(crate) mod coupled;
mod dissipation;
pub(crate) mod families;
mod gathered;
mod gathered_margin;
pub(crate) mod gathered_near;
mod gradient;
mod gradient_margin;
mod margin;
mod measure;
mod next_state;
pub(crate) mod remember;
pub mod sample;
pub(crate) mod stated;
mod threshold;
pub mod truth;
mod vector_margin;
pub(crate) mod vectors;

use crate::compile::{Compiled, Kind};
use crate::kernel::{Batch, Derivatives, Kernel, Level, Mode};
use crate::measure::{Argument, Measure};
use crate::model::{Model, Of};
use crate::point::truth::parts;
use crate::specialise::{CompileError, Dropped, Form};
use crate::values::Values;
pub use cause::{Cause, Part, Stated};
use sample::Point;

/// Half the distance from 1 to the next number.
pub const UNIT_ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// A value that is farther off than this part of itself is wrong, where the energy as written keeps its
/// digits in doubles: rounding takes so many from what subtracts nearly equal numbers, and there the
/// energy as written loses them as well.
const WRONG: f64 = 1e-6;

/// The energy as written keeps its digits where it is nearer to the truth by this factor.
const NEARER: f64 = 1e4;

/// What is off by less than so many units of the largest value of its kind is rounded, and not wrong.
const ROUNDED: f64 = 64.0;

/// What came out for one energy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Everything agrees.
    Passed,
    /// The derivatives are right, and rounding takes digits of their values.
    DigitsLost,
    /// A value is wrong, or machine code is not what was compiled: a defect of the compiler.
    Wrong,
}

impl Outcome {
    /// As it stands in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Outcome::Passed => "passed",
            Outcome::DigitsLost => "digits-lost",
            Outcome::Wrong => "wrong",
        }
    }
}

/// What was found for one energy.
#[derive(Clone, Debug)]
pub struct Verification {
    /// What it is a function of.
    pub subject: Subject,
    /// At how many places it was tried.
    pub n_places: usize,
    /// At how many of them machine code at the strict level and interpreter differ in some bit.
    pub different_bits: usize,
    /// Where psi or a derivative misses its tolerance, at the strict level or the fast one.
    pub misses: Vec<Miss>,
    /// The largest errors, against each witness.
    pub errors: Vec<Errors>,
    /// At how many places hyper-dual numbers of the energy as written overflow or have lost their digits,
    /// so that numbers of any precision decide.
    pub undecided: usize,
    /// Which subexpressions lose the digits, at most one for each order.
    pub causes: Vec<Cause>,
}

/// What a verified energy is a function of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Subject {
    /// A measure, the square of one, or the deformation gradient.
    Argument(Argument),
    /// Gathered values, as written: `theta`; `l, m`.
    Gathered(String),
    /// No energy, but what points gather, each number times a multiplier: `integral(..)`; functions of integrals,
    /// as heads name them: `H`.
    Gathering(String),
    /// No energy, but a condition under which bonds, triangles or tetrahedra break, as written, with what it is
    /// a condition of: their measure, deformation gradients; nothing of one of gathered values.
    Margin(Option<Argument>, String),
    /// No energy, but what a state becomes: `p = max(p, l/L - 1)`, with what it is a state of.
    NextState(Of, String),
    /// No energy, but what bonds dissipate, a function of their rate: `1/2*eta*rate(l)^2`.
    Dissipation(String),
    /// The energy of a measure at the states that interactions come to, and how its force changes with the
    /// measure.
    Following(Measure),
    /// Several measures of one interaction: as written, `angle`, and what that follows from, `a`, `l1` ..
    Coupled(String, Vec<&'static str>),
}

/// What an energy is held against, and where.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Witness {
    /// Hyper-dual numbers of the energy as written.
    HyperDual,
    /// Numbers of any precision, near rest.
    TruthNear,
    /// Numbers of any precision, far from rest.
    TruthFar,
}

/// The largest errors of psi and its two derivatives, as [`Subject::orders`] names them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Against what.
    pub witness: Witness,
    /// For measures over the tolerance of the point; else in [`UNIT_ROUNDOFF`] of the size of the
    /// value: the norm of a tensor, the largest of the derivatives by gathered values.
    pub largest: [f64; 3],
    /// What they may be.
    pub bar: f64,
}

/// A value outside its tolerance: one number, or one for each variable.
#[derive(Clone, Debug, PartialEq)]
pub struct Miss {
    /// What the energy is given: a measure and its value at rest; `F`, row by row; variables; of several
    /// measures what they change by, in parts of themselves.
    pub place: Vec<f64>,
    /// 0 for psi, 1 and 2 for its derivatives.
    pub order: usize,
    /// The compiled value.
    pub compiled: Vec<f64>,
    /// The value of the witness.
    pub expected: Vec<f64>,
    /// Largest size of the difference allowed.
    pub tolerance: f64,
    /// Whether it is wrong, and not a value that has lost digits.
    pub is_wrong: bool,
}

impl Miss {
    /// Whether a value is wrong: off by [`WRONG`] of its size, and hyper-dual numbers are not. Errors are
    /// parts of the size.
    fn is_wrong(compiled: f64, dual: f64) -> bool {
        compiled.is_finite() && compiled > WRONG && NEARER * dual < compiled
    }

    /// Whether a value is off by [`WRONG`] of its size. What is no number has overflowed, and lost all digits by that.
    fn is_far_off(compiled: f64, truth: f64) -> bool {
        let error = (compiled - truth).abs();
        error.is_finite() && error > WRONG * truth.abs()
    }

    /// The difference over the size, by the largest components; infinite where a value is no number.
    pub fn relative_error(&self) -> f64 {
        let size = |numbers: &[f64]| numbers.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let error = size(&difference(&self.compiled, &self.expected)) / size(&self.expected);
        let is_known = self.compiled.iter().chain(&self.expected).all(|x| x.is_finite());
        if is_known { error } else { f64::INFINITY }
    }

    /// How many decimal digits are right, of 16.
    pub fn digits(&self) -> f64 {
        let digits = -libm::log10(self.relative_error());
        if digits > 0.0 { digits.min(16.0) } else { 0.0 }
    }
}

impl Subject {
    /// As written in `psi(..)`; a square as made of the measure.
    pub fn symbol(&self) -> &str {
        match self {
            Subject::Argument(argument) => argument.symbol(),
            Subject::Gathered(text)
            | Subject::Gathering(text)
            | Subject::Margin(_, text)
            | Subject::NextState(_, text)
            | Subject::Dissipation(text)
            | Subject::Coupled(text, _) => text,
            Subject::Following(measure) => measure.symbol(),
        }
    }

    /// The energy and what it is differentiated to.
    pub fn orders(&self) -> [&'static str; 3] {
        match self {
            Subject::Argument(argument) => argument.orders(),
            Subject::Gathered(_) | Subject::Coupled(..) => ["psi", "gradient", "product"],
            Subject::Gathering(_) => ["sum", "gradient", "product"],
            Subject::Margin(..) => ["margin", "margin'", "margin''"],
            Subject::NextState(..) => ["next", "next'", "next''"],
            Subject::Dissipation(_) => ["R", "R'", "R''"],
            Subject::Following(Measure::Length) => ["psi", "psi'", "dpsi'/dl"],
            Subject::Following(Measure::Area) => ["psi", "psi'", "dpsi'/da"],
            Subject::Following(Measure::Volume) => ["psi", "psi'", "dpsi'/dv"],
        }
    }
}

impl Verification {
    fn new(subject: Subject, witnesses: &[(Witness, f64)]) -> Verification {
        let errors = |&(witness, bar): &(Witness, f64)| Errors { witness, largest: [0.0; 3], bar };
        let errors = witnesses.iter().map(errors).collect();
        Verification {
            subject,
            n_places: 0,
            different_bits: 0,
            misses: Vec::new(),
            errors,
            undecided: 0,
            causes: Vec::new(),
        }
    }

    /// What came out. Where no place was tried nothing is known to be right.
    pub fn outcome(&self) -> Outcome {
        let is_wrong = self.misses.iter().any(|miss| miss.is_wrong);
        if self.n_places == 0 || self.different_bits > 0 || is_wrong {
            Outcome::Wrong
        } else if self.misses.is_empty() {
            Outcome::Passed
        } else {
            Outcome::DigitsLost
        }
    }

    /// Whether nothing was found.
    pub fn passed(&self) -> bool {
        self.outcome() == Outcome::Passed
    }

    /// The miss of psi or a derivative that keeps the fewest digits.
    pub fn worst(&self, order: usize) -> Option<&Miss> {
        let misses = self.misses.iter().filter(|miss| miss.order == order);
        misses.min_by(|x, y| x.digits().total_cmp(&y.digits()))
    }

    /// The largest errors in parts of what they may be; at most 1 where nothing misses.
    pub fn over_tolerance(&self) -> [f64; 3] {
        let largest = |order: usize| self.errors.iter().map(move |e| e.largest[order] / e.bar);
        [0, 1, 2].map(|order| largest(order).fold(0.0, f64::max))
    }

    /// Takes in what was found for the same energy elsewhere.
    fn join(&mut self, other: Verification) {
        self.n_places += other.n_places;
        self.different_bits += other.different_bits;
        self.misses.extend(other.misses);
        for (own, of_other) in self.errors.iter_mut().zip(other.errors) {
            own.largest = std::array::from_fn(|k| own.largest[k].max(of_other.largest[k]));
        }
        self.undecided += other.undecided;
        let is_new = |cause: &Cause| self.causes.iter().all(|own| own.order != cause.order);
        let causes: Vec<Cause> = other.causes.into_iter().filter(is_new).collect();
        self.causes.extend(causes);
    }

    /// Counts a place, and whether machine code and interpreter differ there.
    fn count(&mut self, strict: &[f64], interpreted: &[f64]) {
        self.n_places += 1;
        let same = strict.iter().zip(interpreted).all(|(x, y)| same_bits(*x, *y));
        self.different_bits += usize::from(!same);
    }

    /// Takes note of an error against one of the witnesses.
    fn see(&mut self, witness: usize, order: usize, error: f64, miss: impl FnOnce(f64) -> Miss) {
        let errors = &mut self.errors[witness];
        let error = if error.is_nan() { f64::INFINITY } else { error };
        errors.largest[order] = errors.largest[order].max(error);
        if error > errors.bar {
            let bar = errors.bar;
            self.misses.push(miss(bar));
        }
    }

    /// Holds psi, its gradient and its product with a direction, one after the other, against those of
    /// a witness. Each counts by its size, the norm or the largest component. Hyper-dual numbers tell what
    /// the energy as written keeps in doubles.
    fn compare(
        &mut self,
        witness: usize,
        place: &[f64],
        [compiled, expected, dual]: [&[f64]; 3],
        size: fn(&[f64]) -> f64,
    ) {
        for (order, part) in parts(place.len()).into_iter().enumerate() {
            let [compiled, expected, dual] = [compiled, expected, dual].map(|x| &x[part.clone()]);
            let unit = UNIT_ROUNDOFF * size(expected) + f64::MIN_POSITIVE;
            let error = |found: &[f64]| size(&difference(found, expected)) / unit;
            let found = error(compiled);
            self.see(witness, order, found, |bar| Miss {
                place: place.to_vec(),
                order,
                compiled: compiled.to_vec(),
                expected: expected.to_vec(),
                tolerance: bar * unit,
                is_wrong: Miss::is_wrong(UNIT_ROUNDOFF * found, UNIT_ROUNDOFF * error(dual)),
            });
        }
    }

    /// Takes back that values are wrong which are off by what rounding makes of the largest ones of their kind: they
    /// have lost digits, as the tail of an exponential that is added to 1.
    fn forgive(&mut self, largest: [f64; 3]) {
        for miss in &mut self.misses {
            let error = gathered::largest(&difference(&miss.compiled, &miss.expected));
            miss.is_wrong &= error > ROUNDED * UNIT_ROUNDOFF * largest[miss.order];
        }
    }

    /// Holds what was found at all places at both levels and by the interpreter against hyper-dual numbers; where a
    /// level misses a bar against these, against the truth. Places are told by their variables; where neither is finite
    /// there is nothing to hold them against.
    fn judge(
        &mut self,
        [strict, fast, interpreted, dual]: [&[Vec<f64>]; 4],
        bar: f64,
        size: fn(&[f64]) -> f64,
        (variables, truth): (impl Fn(usize) -> Vec<f64>, impl Fn(usize) -> Option<Vec<f64>>),
    ) {
        for (p, dual) in dual.iter().enumerate() {
            let variables = variables(p);
            self.count(&strict[p], &interpreted[p]);
            let agrees = |found: &Vec<f64>| is_within(bar, variables.len(), [found, dual], size);
            let truth = match [&strict[p], &fast[p]].into_iter().all(agrees) {
                true => None,
                false => truth(p),
            };
            if truth.is_none() && !dual.iter().all(|x| x.is_finite()) {
                continue;
            }
            if let Some(truth) = &truth {
                let decides = !is_within(bar, variables.len(), [dual, truth], size);
                self.undecided += usize::from(decides);
            }
            let expected = truth.as_ref().unwrap_or(dual);
            for level in [strict, fast] {
                self.compare(0, &variables, [&level[p], expected, dual], size);
            }
        }
    }
}

/// Component by component.
fn difference(x: &[f64], y: &[f64]) -> Vec<f64> {
    x.iter().zip(y).map(|(x, y)| x - y).collect()
}

/// Whether psi, gradient and product are each within a bar, in [`UNIT_ROUNDOFF`] of the size of the true
/// ones, and finite.
fn is_within(bar: f64, n: usize, [found, truth]: [&[f64]; 2], size: fn(&[f64]) -> f64) -> bool {
    parts(n).into_iter().all(|part| {
        let (found, truth) = (&found[part.clone()], &truth[part]);
        size(&difference(found, truth)) <= bar * UNIT_ROUNDOFF * size(truth) + f64::MIN_POSITIVE
    })
}

/// A model compiled in each of the ways that are held against each other.
struct Ways {
    strict: Compiled,
    fast: Compiled,
    interpreted: Compiled,
    dual: Compiled,
}

/// Verifies every energy of a model for these values, and once more where it has a kernel for the
/// squared measure: at about `2 n` points of measures, at `2 n` gradients and at most 200, at `n`
/// places of gathered values. Where interactions remember, with what they remember at the start and after some
/// histories, and what they remember next; what bonds dissipate by how fast they change.
///
/// # Errors
/// Energies that cannot be compiled.
pub fn verify(
    model: &Model,
    values: &Values,
    n: usize,
) -> Result<(Vec<Verification>, Vec<Dropped>), CompileError> {
    let mut all = (Vec::<Verification>::new(), Vec::new());
    let mut cases = Vec::new();
    for direction in directions(model, values.dimension) {
        let held = values.clone().with_direction(model, &direction).without_fields();
        cases.extend(remember::histories(model, &held)?);
    }
    for (k, values) in cases.iter().enumerate() {
        let (found, dropped) = verify_at(model, values, n)?;
        join(&mut all.0, found, k);
        if k == 0 {
            all.1 = dropped;
        }
    }
    if model.gathers_vectors() {
        // What sees bonds from many sides at once is verified on its own.
        let histories = remember::histories(model, values)?;
        for (k, values) in histories.iter().enumerate() {
            join(&mut all.0, vectors::verify(model, values, n)?, k);
        }
    }
    // Once more as bodies run it: the direction is an input.
    for one in measure::verify_directed(model, values, n)? {
        if let Some(known) = all.0.iter_mut().find(|known| known.subject == one.subject) {
            known.join(one);
        }
    }
    Ok(all)
}

/// Takes in what was found in the case of this number: from the second on of subjects that are there.
fn join(all: &mut Vec<Verification>, found: Vec<Verification>, case: usize) {
    for one in found {
        match all.iter_mut().find(|known| known.subject == one.subject) {
            Some(known) if case > 0 => known.join(one),
            _ => all.push(one),
        }
    }
}

/// Directions of bonds at rest to verify at: one that no symmetry singles out, and others along the axes and
/// between them; a single empty one where nothing depends on it.
fn directions(model: &Model, dimension: usize) -> Vec<Vec<f64>> {
    let all: &[&[f64]] = match dimension {
        _ if model.directions(dimension).is_empty() => &[&[]],
        2 => &[&[0.6, 0.8], &[1.0, 0.0], &[0.0, -1.0], &[-0.28, 0.96]],
        _ => &[
            &[0.48, 0.6, 0.64],
            &[1.0, 0.0, 0.0],
            &[0.0, -1.0, 0.0],
            &[0.0, 0.0, 1.0],
            &[-0.6, 0.8, 0.0],
        ],
    };
    all.iter().map(|direction| direction.to_vec()).collect()
}

/// The same with what is remembered by the values.
fn verify_at(
    model: &Model,
    values: &Values,
    n: usize,
) -> Result<(Vec<Verification>, Vec<Dropped>), CompileError> {
    let variant =
        model.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
    let is_own = |kind: &Kind| *kind != Kind::Gathered || !model.gathers_vectors();
    let kinds: Vec<Kind> = Kind::ALL.into_iter().filter(is_own).collect();
    let compiled = |mode| model.compile_only(&kinds, values, mode, Form::Accurate);
    let ways = Ways {
        strict: compiled(Mode::Jit(Level::Strict))?,
        fast: compiled(Mode::Jit(Level::Fast))?,
        interpreted: compiled(Mode::Interpreter)?,
        dual: compiled(Mode::HyperDual)?,
    };
    let mut found = measure::verify(model, variant, values, &ways, n)?;
    found.extend(gathered::verify((model, variant), values, &ways, n));
    found.extend(gradient::verify(model, values, &ways, n));
    found.extend(margin::verify(model, variant, values, n)?);
    found.extend(gradient_margin::verify(model, values, n)?);
    found.extend(gathered_margin::verify(model, values, n)?);
    found.extend(remember::verify(model, variant, values, n)?);
    found.extend(families::verify(model, values, n)?);
    found.extend(dissipation::verify(model, variant, values)?);
    found.extend(consistent::verify(model, variant, values, n)?);
    found.extend(coupled::verify((model, variant), values, &ways, n));
    Ok((found, ways.interpreted.dropped))
}

/// Equal to the last bit, or both not a number.
pub fn same_bits(x: f64, y: f64) -> bool {
    x.to_bits() == y.to_bits() || (x.is_nan() && y.is_nan())
}

/// Points as the columns a kernel reads.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    measure: Vec<f64>,
    reference: Vec<f64>,
    change: Vec<f64>,
}

impl Columns {
    /// The columns of these points.
    pub fn new(points: &[Point]) -> Columns {
        Columns {
            measure: points.iter().map(|p| p.measure).collect(),
            reference: points.iter().map(|p| p.reference).collect(),
            change: points.iter().map(|p| p.change()).collect(),
        }
    }

    /// As the input of a kernel.
    pub fn batch(&self) -> Batch<'_> {
        Batch {
            measure: &self.measure,
            reference: &self.reference,
            change: &self.change,
            fields: &[],
        }
    }

    /// What a kernel finds there, with typical values of fields at every point.
    pub fn derivatives(&self, kernel: &Kernel) -> Derivatives {
        self.derivatives_at(kernel, kernel.fields())
    }

    /// The same with these values of its fields at every point.
    pub fn derivatives_at(&self, kernel: &Kernel, fields: &[f64]) -> Derivatives {
        let n = self.measure.len();
        let fields: Vec<f64> =
            fields.iter().flat_map(|value| std::iter::repeat_n(*value, n)).collect();
        kernel.derivatives(Batch { fields: &fields, ..self.batch() })
    }
}

#[cfg(test)]
mod tests;
