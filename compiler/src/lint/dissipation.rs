//! What bonds dissipate: forces that drive what they should hold back.

use super::Finding;
use super::subject::{example, short};
use crate::kernel::Mode;
use crate::measure::Measure;
use crate::model::Model;
use crate::remember::derivatives;
use crate::verify::sample::{Point, contains};
use piola_grammar::Span;

/// Lengths over those at rest.
const STRETCHES: [f64; 7] = [1.0, 0.5, 0.9, 0.999, 1.001, 1.1, 2.0];

/// Rates over lengths at rest go through these powers of ten, in 1/s, either way.
const DECADES: std::ops::RangeInclusive<i32> = -9..=4;

/// A bond's length at rest, over the horizon.
const REFERENCE: f64 = 0.5;

/// By which part of the largest a force must drive to be told.
const TOLD: f64 = 1e-9;

/// What bonds dissipate, with values for everything it depends on.
pub(super) struct Dissipating {
    /// The first of what adds up.
    pub(super) span: Span,
    tried: Vec<Tried>,
}

/// A bond at a stretch whose length changes at a rate, in m/s, and the force of that.
struct Tried {
    stretch: f64,
    rate: f64,
    force: f64,
}

impl Dissipating {
    /// The dissipation of a model for some values; nothing where there is none, or no values are found.
    pub(super) fn examples(model: &Model, dimension: usize) -> Option<Dissipating> {
        let variant = model.variant(dimension)?;
        let span = variant.dissipations.first()?.span;
        let values = example(model, dimension)?.with_states(model);
        let kernel = model.dissipation(&values, Mode::Interpreter).ok()??;
        let fields: Vec<f64> = values.typical().map(|(_, value)| value).collect();
        let reference = REFERENCE * values.horizon;
        let is_inside = |stretch: &f64| {
            let point = Point { measure: stretch * reference, reference };
            contains(variant, Measure::Length, &values, point)
        };
        let mut tried = Vec::new();
        for stretch in STRETCHES.into_iter().filter(is_inside) {
            let rates =
                DECADES.flat_map(|k| [1.0, -1.0].map(|x| x * libm::pow(10.0, f64::from(k))));
            for rate in rates.map(|rate| rate * reference) {
                let point = Point { measure: rate, reference };
                let force = derivatives(&kernel, point, &fields, Some(stretch * reference))[1];
                tried.push(Tried { stretch, rate, force });
            }
        }
        Some(Dissipating { span, tried })
    }
}

/// A force along the rate, against which it should be: the body gains what it should lose.
pub(super) fn creates_energy(dissipating: &Dissipating) -> Option<Finding> {
    let forces = dissipating.tried.iter().map(|tried| tried.force.abs());
    let most = forces.filter(|force| force.is_finite()).fold(0.0, f64::max);
    let drives = |tried: &&Tried| tried.force * tried.rate.signum() < -TOLD * most;
    let found = dissipating.tried.iter().find(drives)?;
    Some(Finding {
        message: format!(
            "what should be dissipated is created: at rate(l) = {} m/s and l/L = {} the power of the bond, \
             rate*R', is {}",
            short(found.rate),
            short(found.stretch),
            short(found.rate * found.force)
        ),
        help:
            "let the dissipation grow with the rate, either way, and have no force at rate 0, as \
               `1/2*eta*rate(l)^2` with eta > 0 does"
                .into(),
    })
}
