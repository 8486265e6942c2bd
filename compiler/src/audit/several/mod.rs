//! Functions of several numbers: measures of one interaction, what points gather, vectors of bonds.
//!
//! All numbers come rounded: what has moved, a length at rest, what was summed up over a family. So an error of psi,
//! of its gradient and of the product with a direction counts in `u` of the norm, and what is left of it in what
//! rounding every number once changes the norm by, where that is more: no form could do better.

mod coupled;
mod numbers;
mod vectors;

use super::tensor::tensor_in_units;
use super::{Audit, Lost, Place, Regime, Settings};
use crate::model::Model;
use crate::point::truth::{norm, parts};
use crate::specialise::CompileError;
use crate::values::Values;
use crate::verify::{Cause, Subject};

/// Regimes near rest: strains of 1e-1 to 1e-15.
const DECADES: std::ops::RangeInclusive<i32> = 1..=15;

/// Part of itself by which a number is changed to see what depends on it.
const STEP: i32 = -20;

/// Value, gradient and product of a kernel at a place.
type FoundAt<'a> = Box<dyn Fn(&[f64]) -> Vec<f64> + 'a>;

/// What is true for exactly these numbers; nothing where that is no finite number.
type TruthAt<'a> = Box<dyn Fn(&[f64]) -> Option<Vec<f64>> + 'a>;

/// Which subexpression loses digits of value, gradient or product there, where that is known.
type CauseAt<'a> = Box<dyn Fn(usize, &[f64]) -> Option<Cause> + 'a>;

/// A function of several numbers, compiled and as written.
struct Function<'a> {
    /// What the numbers are called, but for those of the direction, which come last.
    names: Vec<String>,
    /// How many it is differentiated by.
    n_variables: usize,
    found: FoundAt<'a>,
    truth: TruthAt<'a>,
    cause: CauseAt<'a>,
}

/// What a function of several numbers was found to lose, and by what.
pub(super) struct Found {
    pub(super) audit: Audit,
    pub(super) lost: Vec<Lost>,
}

/// A regime before it is judged: its name, the decade of its strain, the numbers of its places.
type Sampled = (String, Option<f64>, Vec<Vec<f64>>);

/// Audits energies of several measures and of gathered values for these values, and what is gathered where that are
/// vectors; margins and next states of gathered numbers are among [`super::functions`].
///
/// # Errors
/// What cannot be compiled.
pub fn several(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Audit>, CompileError> {
    Ok(found(model, values, settings)?.into_iter().map(|found| found.audit).collect())
}

/// What the same functions lose, each subexpression once, as [`super::lost`] says it.
pub(super) fn lost(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Lost>, CompileError> {
    Ok(found(model, values, settings)?.into_iter().flat_map(|found| found.lost).collect())
}

fn found(model: &Model, values: &Values, settings: &Settings) -> Result<Vec<Found>, CompileError> {
    let mut all = coupled::audit(model, &values.without_fields(), settings)?;
    all.extend(match model.gathers_vectors() {
        true => vectors::audit(model, values, settings)?,
        false => numbers::audit(model, &values.without_fields(), settings)?,
    });
    Ok(all)
}

/// Audits a function, and says by what it loses digits.
fn audited(
    function: &Function<'_>,
    sampled: Vec<Sampled>,
    (settings, n_orders): (&Settings, usize),
    subject: Subject,
) -> Found {
    let audit = Audit::of(subject, None, regimes(function, sampled, (settings, n_orders)));
    let mut lost = Vec::new();
    for regime in &audit.regimes {
        for order in (0..n_orders).filter(|&order| regime.worst[order] > settings.bar) {
            let Some(at @ Place::Several { given, .. }) = &regime.at[order] else { continue };
            let Some(cause) = (function.cause)(order, given) else { continue };
            let (function, error) = (audit.function.clone(), regime.worst[order]);
            lost.push(Lost { argument: None, function, cause, at: at.clone(), error });
        }
    }
    Found { audit, lost }
}

/// Margins of conditions of gathered values, then what states of points become, with states by the values.
///
/// # Errors
/// What cannot be compiled.
pub(super) fn functions(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Vec<Found>, CompileError> {
    match model.gathers_vectors() {
        true => vectors::functions(model, values, settings),
        false => numbers::functions(model, values, settings),
    }
}

/// Errors of a function in every regime: of so many of its value, gradient and product.
fn regimes(
    function: &Function<'_>,
    sampled: Vec<Sampled>,
    (settings, n_orders): (&Settings, usize),
) -> Vec<Regime> {
    let of = |(name, strain, places): Sampled| {
        let mut regime = Regime::new(name, strain);
        for given in &places {
            measure_errors(&mut regime, function, given, (settings.bar, n_orders));
        }
        regime
    };
    sampled.into_iter().map(of).collect()
}

fn measure_errors(
    regime: &mut Regime,
    function: &Function<'_>,
    given: &[f64],
    (bar, n_orders): (f64, usize),
) {
    let Some(truth) = (function.truth)(given) else { return };
    let found = (function.found)(given);
    regime.n_points += 1;
    let mut changes = None;
    for (order, part) in parts(function.n_variables).into_iter().take(n_orders).enumerate() {
        let size = norm(truth[part.clone()].iter().copied());
        let difference = norm(part.map(|k| found[k] - truth[k]));
        let raw = tensor_in_units(difference, size, size);
        let left = match raw > bar && difference.is_finite() {
            true => {
                let changes = changes.get_or_insert_with(|| changes_of(function, given));
                tensor_in_units(difference, size, size.max(changes[order]))
            }
            false => raw,
        };
        regime.see(order, [raw, left], || Place::Several {
            names: function.names.clone(),
            given: given.to_vec(),
        });
    }
}

/// How much the norms of value, gradient and product change when every number changes by its own size.
fn changes_of(function: &Function<'_>, given: &[f64]) -> [f64; 3] {
    let step = libm::ldexp(1.0, STEP);
    let mut changes = [0.0; 3];
    for k in (0..given.len()).filter(|&k| given[k] != 0.0) {
        let beside = |by: f64| {
            let mut moved = given.to_vec();
            moved[k] *= 1.0 + by;
            (function.truth)(&moved)
        };
        let [Some(right), Some(left)] = [step, -step].map(beside) else { continue };
        for (change, part) in changes.iter_mut().zip(parts(function.n_variables)) {
            *change += norm(part.map(|j| right[j] - left[j])) / (2.0 * step);
        }
    }
    changes
}

fn power_of_ten(exponent: i32) -> f64 {
    libm::pow(10.0, f64::from(exponent))
}

/// The strains near rest with their names.
fn strains() -> impl Iterator<Item = (String, f64)> {
    DECADES.map(|decade| (format!("strain 1e-{decade}"), power_of_ten(-decade)))
}
