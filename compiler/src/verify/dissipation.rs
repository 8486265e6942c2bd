//! What bonds dissipate: machine code and interpreter against the potential as written, over hyper-dual numbers
//! of the rate, at rates of many sizes and a few lengths.

use super::sample::Point;
use super::{Columns, Subject, Verification, Witness, measure, same_bits};
use crate::kernel::{Kernel, Level, Mode};
use crate::model::{Model, Variant};
use crate::specialise::CompileError;
use crate::values::Values;

/// Lengths over those at rest.
const STRETCHES: [f64; 4] = [1.0, 0.8, 1.001, 1.7];

/// Rates over lengths at rest, in 1/s, go through these powers of ten, either way.
const DECADES: std::ops::RangeInclusive<i32> = -9..=6;

/// Verifies R, R' and R'' at a few lengths, at rates either way.
pub(super) fn verify(
    model: &Model,
    variant: &Variant,
    values: &Values,
) -> Result<Option<Verification>, CompileError> {
    let kernel = |mode| model.dissipation(values, mode);
    let (Some(strict), Some(fast), Some(interpreted)) = (
        kernel(Mode::Jit(Level::Strict))?,
        kernel(Mode::Jit(Level::Fast))?,
        kernel(Mode::Interpreter)?,
    ) else {
        return Ok(None);
    };
    let texts: Vec<&str> = variant.dissipations.iter().map(|one| one.text.as_str()).collect();
    let subject = Subject::Dissipation(texts.join(" + "));
    let mut found = Verification::new(subject, &[(Witness::HyperDual, 1.0)]);
    let horizon = Some(values.horizon).filter(|horizon| horizon.is_finite());
    let reference = 0.5 * horizon.unwrap_or(1.0);
    let rates = DECADES.flat_map(|k| [3.0, -7.0].map(|rate| rate * libm::pow(10.0, f64::from(k))));
    let point = |rate| Point { measure: rate * reference, reference };
    let points: Vec<Point> = rates.map(point).collect();
    for stretch in STRETCHES {
        let length = stretch * reference;
        let Some(written) = model.written_dissipation(values, length) else { continue };
        let known = values.clone().with_states(model);
        let typical: Vec<f64> = known.typical().map(|(_, value)| value).chain([length]).collect();
        let columns = Columns::new(&points);
        let at =
            |kernel: &Kernel| columns.derivatives_at(kernel, &typical[..kernel.fields().len()]);
        let [strict, fast, interpreted] = [&strict, &fast, &interpreted].map(at);
        for (i, &point) in points.iter().enumerate() {
            let [strict, fast, interpreted] =
                [&strict, &fast, &interpreted].map(|all| [all.psi[i], all.dpsi[i], all.d2psi[i]]);
            found.count(&strict, &interpreted);
            let expected: [f64; 3] = written.derivatives(point.measure, point.reference).into();
            measure::compare(&mut found, &written, point, strict, expected);
            if !fast.iter().zip(&strict).all(|(x, y)| same_bits(*x, *y)) {
                measure::compare(&mut found, &written, point, fast, expected);
            }
        }
    }
    Ok(Some(found))
}
