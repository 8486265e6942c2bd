//! Over the declared domain: finite inside it, infinite where the interaction ends.

use super::Finding;
use super::subject::{Subject, short};
use crate::measure::Measure;

/// Beyond this a value is on its way to what a number cannot hold.
const OVERFLOW: f64 = 1e200;

/// The point nearest to rest at which psi, psi' or psi'' is not finite.
pub(super) fn singular(subject: &Subject<'_>) -> Option<Finding> {
    let (stretch, order, value) = not_finite(subject)?;
    let symbol = subject.symbol();
    let rest = subject.measure().reference_symbol();
    let name = format!("psi{}({symbol})", "'".repeat(order));
    let value = if value.is_nan() { "not a number".to_string() } else { short(value) };
    let help = if stretch <= 0.0 && subject.declares(0.5) {
        format!("if `{symbol}` stays positive, say so: `domain {symbol}/{rest} in (0, inf)`")
    } else {
        format!(
            "write the energy so that it has two derivatives there, or leave the point out of the \
             domain: `domain {symbol}/{rest} in (.., ..)`"
        )
    };
    let message = format!("{name} is {value} inside its domain, at {}", subject.place(stretch));
    Some(Finding { message, help })
}

/// That point with the order of the derivative and its value. What an exponential makes of a large
/// strain is not meant.
fn not_finite(subject: &Subject<'_>) -> Option<(f64, usize, f64)> {
    let stretches = &subject.stretches;
    let mut indices: Vec<usize> = (0..stretches.len()).collect();
    let distance = |i: usize| (stretches[i] - 1.0).abs();
    indices.sort_by(|i, j| distance(*i).total_cmp(&distance(*j)));
    indices.into_iter().find_map(|i| {
        let values = subject.at_stretch(stretches[i]);
        let order = values.iter().position(|value| !value.is_finite())?;
        let nearer = if stretches[i] > 1.0 { i.checked_sub(1) } else { Some(i + 1) };
        let nearer = nearer.and_then(|i| stretches.get(i)).map(|s| subject.at_stretch(*s));
        let overflows = |values: [f64; 3]| values.iter().any(|x| x.abs() > OVERFLOW);
        (!nearer.is_some_and(overflows)).then_some((stretches[i], order, values[order]))
    })
}

/// Whether an interaction can vanish at a finite price. Where the measure has a sign, as `v` and in
/// two dimensions `a`, that is an inversion.
pub(super) fn no_collapse_resistance(subject: &Subject<'_>) -> Option<Finding> {
    if has_sign(subject) || !subject.declares(1e-9) {
        return None;
    }
    let energy = subject.at_stretch(0.0)[0];
    let symbol = subject.symbol();
    energy.is_finite().then(|| Finding {
        message: format!(
            "psi({symbol}) does not resist the collapse of a {}: it is {} at {}",
            subject.measure().interaction(),
            short(energy),
            subject.place(0.0)
        ),
        help: barrier(subject),
    })
}

/// Whether an interaction can be turned inside out at a finite price.
pub(super) fn no_inversion_resistance(subject: &Subject<'_>) -> Option<Finding> {
    if !has_sign(subject) || !subject.declares(1e-9) {
        return None;
    }
    let [flat, inverted] = [0.0, -0.1].map(|stretch| subject.at_stretch(stretch)[0]);
    let symbol = subject.symbol();
    (flat.is_finite() && inverted.is_finite()).then(|| Finding {
        message: format!(
            "psi({symbol}) does not resist the inversion of a {}: it is {} at {}",
            subject.measure().interaction(),
            short(inverted),
            subject.place(-0.1)
        ),
        help: barrier(subject),
    })
}

fn has_sign(subject: &Subject<'_>) -> bool {
    match subject.measure() {
        Measure::Length => false,
        Measure::Area => subject.dimension() == 2,
        Measure::Volume => true,
    }
}

fn barrier(subject: &Subject<'_>) -> String {
    let (symbol, rest) = (subject.symbol(), subject.measure().reference_symbol());
    format!(
        "an energy of `ln({symbol}/{rest})` or `({symbol}/{rest})^-1` grows without bound there"
    )
}
