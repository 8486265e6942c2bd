//! Conditions of gathered values under which bonds break: whether they are judged as written, up to some
//! roundings of lengths and integrals around where the condition changes.

use super::gathered::{Place, batch, places};
use super::{Subject, Verification, Witness, threshold};
use crate::expression::number::Number as _;
use crate::expression::precise::Precise;
use crate::gathered::{GatheredCriterion, WrittenGatheredEnergy};
use crate::kernel::{Level, Mode};
use crate::model::Model;
use crate::point::truth::norm;
use crate::specialise::{CompileError, Form};
use crate::values::Values;

/// Around how many thresholds.
const THRESHOLDS: usize = 16;

/// Verifies every condition at `n` places, and around thresholds between them.
pub(super) fn verify(
    model: &Model,
    values: &Values,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let criteria = |mode| model.gathered_criteria(values, mode, Form::Accurate);
    let strict = criteria(Mode::Jit(Level::Strict))?;
    let fast = criteria(Mode::Jit(Level::Fast))?;
    let interpreted = criteria(Mode::Interpreter)?;
    let judged = |k: usize| judge([&strict[k], &fast[k], &interpreted[k]], &strict[k].written, n);
    Ok((0..strict.len()).map(judged).collect())
}

fn judge(
    kernels: [&GatheredCriterion; 3],
    written: &WrittenGatheredEnergy,
    n: usize,
) -> Verification {
    let subject = Subject::Margin(None, kernels[0].text.clone());
    let mut found = Verification::new(subject, &[(Witness::TruthFar, threshold::BAR)]);
    let samples = places(&kernels[0].margin, n);
    let mut all: Vec<(Place, f64)> = samples.iter().map(|p| (p.clone(), f64::INFINITY)).collect();
    let holds = |place: &Place| truth(written, place).map(|margin| margin > 0.0);
    let differ = |pair: &&[Place]| match (holds(&pair[0]), holds(&pair[0].with(&pair[1], 1.0))) {
        (Some(one), Some(other)) => one != other,
        _ => false,
    };
    for pair in samples.windows(2).filter(differ).take(THRESHOLDS) {
        all.extend(around(&holds, &pair[0], &pair[1]));
    }
    let places: Vec<Place> = all.iter().map(|(place, _)| place.clone()).collect();
    let margins = kernels.map(|one| {
        let mut margins = vec![0.0; places.len()];
        batch(&one.margin, &places, |at| one.margin.evaluate(at, &mut margins, &mut []));
        margins
    });
    let margins = margins.each_ref().map(|all| &all[..]);
    let numbers = |place: &Place| place.variables.clone();
    threshold::judge(&mut found, &all, margins, |place| truth(written, place), numbers);
    found
}

/// A margin, or another function, as written to many digits, where it is a number.
pub(super) fn truth(written: &WrittenGatheredEnergy, place: &Place) -> Option<f64> {
    let variable = |k: usize| Precise::<256>::line(place.variables[k], 0.0, 0.0);
    let margin = written.psi(variable, Precise::constant(place.reference));
    margin.parts().map(|_| margin.rounded()[0])
}

/// Places around the threshold on the way from one to another, with how far they are from it in units in the
/// last place.
fn around(holds: &impl Fn(&Place) -> Option<bool>, from: &Place, to: &Place) -> Vec<(Place, f64)> {
    let end = from.with(to, 1.0);
    let way = norm(from.variables.iter().zip(&end.variables).map(|(x, y)| y - x));
    let size = |place: &Place| norm(place.variables.iter().copied());
    threshold::on_a_way(|t| from.with(to, t), holds, (way, size))
}
