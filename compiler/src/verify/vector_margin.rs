//! Conditions of what points gather of vectors under which bonds break: whether they are judged as written, up to
//! some roundings of vectors and of what is gathered around where the condition changes.

use super::vectors::{Place, Places, Seen, bond, values};
use super::{Subject, Verification, Witness, threshold};
use crate::gathered::{FamilyKernel, Slot, VectorCriterion, VectorKernels};
use crate::kernel::{Level, Mode};
use crate::model::Model;
use crate::point::truth::norm;
use crate::specialise::{CompileError, Form};
use crate::values::Values;
use crate::verify::sample::Random;

/// Around how many thresholds.
const THRESHOLDS: usize = 16;

/// How far families are deformed: from some of these places to others conditions change.
const SIZES: [[f64; 2]; 3] = [[0.05, 0.01], [0.25, 0.05], [1.0, 0.2]];

/// Verifies every condition at `n` places, and around thresholds between them.
pub(super) fn verify(
    (model, values): (&Model, &Values),
    kernels: &VectorKernels,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let criteria = |mode| model.vector_criteria(values, mode, Form::Accurate);
    let strict = criteria(Mode::Jit(Level::Strict))?;
    let fast = criteria(Mode::Jit(Level::Fast))?;
    let interpreted = criteria(Mode::Interpreter)?;
    let mut random = Random::new(0x6d61_7267_696e);
    let place = |k: usize| bond(kernels, (model, values), (SIZES[k % 3], false), &mut random);
    let samples: Vec<Place> =
        if strict.is_empty() { Vec::new() } else { (0..n).map(place).collect() };
    let judged =
        |k: usize| judge([&strict[k], &fast[k], &interpreted[k]], (model, values), &samples);
    Ok((0..strict.len()).map(judged).collect())
}

fn judge(kernels: [&VectorCriterion; 3], of: (&Model, &Values), samples: &[Place]) -> Verification {
    let subject = Subject::Margin(None, kernels[0].text.clone());
    let mut found = Verification::new(subject, &[(Witness::TruthFar, threshold::BAR)]);
    let kernel = &kernels[0].margin;
    let truth = |place: &Place| {
        let places = Places::new(vec![place.clone()], of);
        Seen { written: &kernels[0].written, kernel, places: &places }.value(0)
    };
    let holds = |place: &Place| truth(place).map(|margin| margin > 0.0);
    let differ = |pair: &&[Place]| match (holds(&pair[0]), holds(&pair[0].with(&pair[1], 1.0))) {
        (Some(one), Some(other)) => one != other,
        _ => false,
    };
    let mut all: Vec<(Place, f64)> = samples.iter().map(|p| (p.clone(), f64::INFINITY)).collect();
    for pair in samples.windows(2).filter(differ).take(THRESHOLDS) {
        all.extend(around(&holds, kernel, &pair[0], &pair[1]));
    }
    let places = Places::new(all.iter().map(|(place, _)| place.clone()).collect(), of);
    let margins = kernels.map(|one| values(&one.margin, &places));
    let margins = margins.each_ref().map(|all| &all[..]);
    threshold::judge(&mut found, &all, margins, truth, |place| numbers(place, kernel));
    found
}

/// What a condition depends on that comes rounded.
fn numbers(place: &Place, kernel: &FamilyKernel) -> Vec<f64> {
    kernel.variables().iter().map(|slot| place.slot(*slot)).collect()
}

/// Places around the threshold on the way from one to another, with how far they are from it in units in the
/// last place.
fn around(
    holds: &impl Fn(&Place) -> Option<bool>,
    kernel: &FamilyKernel,
    from: &Place,
    to: &Place,
) -> Vec<(Place, f64)> {
    let [start, end] = [from, &from.with(to, 1.0)].map(|place| numbers(place, kernel));
    let way = norm(start.iter().zip(&end).map(|(x, y)| y - x));
    // A condition that holds `xi` holds the whole vector, and not what has moved alone.
    let rest = |place: &Place| kernel.of_bonds().then(|| place.slot(Slot::Length));
    let size = |place: &Place| norm(numbers(place, kernel).into_iter().chain(rest(place)));
    threshold::on_a_way(|t| from.with(to, t), holds, (way, size))
}
