//! Conditions of deformation gradients under which bonds break: whether gradients are judged as written, up to
//! some roundings of their norm around where the condition changes.

use super::{Subject, Verification, Witness, gradient, threshold};
use crate::expression::graph::{self, dimension};
use crate::expression::precise::Precise;
use crate::kernel::{Level, Mode};
use crate::measure::Argument;
use crate::model::Model;
use crate::point::Principal;
use crate::point::sample::{self, Sample};
use crate::point::truth::norm;
use crate::point::{GradientCriterion, WrittenGradientEnergy};
use crate::specialise::{CompileError, Form};
use crate::values::Values;

/// Around how many thresholds.
const THRESHOLDS: usize = 6;

/// Verifies every condition at `2 n` gradients and at most 200, and around thresholds between them.
pub(super) fn verify(
    model: &Model,
    values: &Values,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let criteria = |mode| model.gradient_criteria(values, mode, Form::Accurate);
    let strict = criteria(Mode::Jit(Level::Strict))?;
    let fast = criteria(Mode::Jit(Level::Fast))?;
    let interpreted = criteria(Mode::Interpreter)?;
    let samples = gradient::samples(values.dimension, n);
    let judged =
        |k: usize| judge([&strict[k], &fast[k], &interpreted[k]], &strict[k].written, &samples);
    Ok((0..strict.len()).map(judged).collect())
}

fn judge(
    kernels: [&GradientCriterion; 3],
    written: &WrittenGradientEnergy,
    samples: &[Sample],
) -> Verification {
    let subject = Subject::Margin(Some(Argument::Gradient), kernels[0].text.clone());
    let mut found = Verification::new(subject, &[(Witness::TruthFar, threshold::BAR)]);
    let mut all: Vec<(Sample, f64)> = samples.iter().map(|s| (s.clone(), f64::INFINITY)).collect();
    let holds = |sample: &Sample| truth(written, sample).map(|margin| margin > 0.0);
    let differ = |pair: &&[Sample]| match (holds(&pair[0]), holds(&pair[1])) {
        (Some(one), Some(other)) => one != other,
        _ => false,
    };
    for pair in samples.windows(2).filter(differ).take(THRESHOLDS) {
        all.extend(around(&holds, &pair[0], &pair[1]));
    }
    let places: Vec<Sample> = all.iter().map(|(sample, _)| sample.clone()).collect();
    let margins = kernels.map(|one| sample::evaluate(&one.margin, &places));
    let margins = margins.map(|all| all.iter().map(|place| place[0]).collect::<Vec<f64>>());
    let margins = margins.each_ref().map(|all| &all[..]);
    let numbers = |place: &Sample| place.gradient.clone();
    threshold::judge(&mut found, &all, margins, |place| truth(written, place), numbers);
    found
}

/// A margin, or another function, as written to many digits, where it is a number.
pub(super) fn truth(written: &WrittenGradientEnergy, sample: &Sample) -> Option<f64> {
    let margin = value(written, sample, |given, rest| Precise::<256>::line(given, 0.0, rest));
    margin.parts().map(|_| margin.rounded()[0])
}

/// The same over any number type, from what is given of each component and from what that is added to.
pub(super) fn value<N: Principal>(
    written: &WrittenGradientEnergy,
    sample: &Sample,
    sum: impl Fn(f64, f64) -> N,
) -> N {
    let (given, near) = (sample.given(), sample.is_near());
    let components = graph::components(dimension(given.len()));
    written.psi(|c| {
        let j = components.iter().position(|known| *known == c).unwrap_or(0);
        let rest = if near { f64::from(u8::from(c % 4 == 0)) } else { 0.0 };
        sum(given[j], rest)
    })
}

/// Gradients around the threshold on the line between two, with how far they are from it in units in the last
/// place of their norm.
fn around(
    holds: &impl Fn(&Sample) -> Option<bool>,
    from: &Sample,
    to: &Sample,
) -> Vec<(Sample, f64)> {
    let steps = || from.change.iter().zip(&to.change).map(|(x, y)| (x, y - x));
    let at = |t: f64| from.with_change(steps().map(|(x, step)| x + t * step).collect());
    let size = |place: &Sample| norm(place.given().iter().copied());
    threshold::on_a_way(at, holds, (norm(steps().map(|(_, step)| step)), size))
}
