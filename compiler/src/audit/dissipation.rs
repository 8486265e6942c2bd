//! What bonds dissipate: R, R' and R'' over rates of all sizes and both signs, at one length.

use super::measure::measure_errors;
use super::{Audit, Regime, Settings};
use crate::kernel::Mode;
use crate::measure::{Argument, Measure};
use crate::model::Model;
use crate::specialise::CompileError;
use crate::values::Values;
use crate::verify::sample::{Point, Random};
use crate::verify::{Columns, Subject};

/// Powers of ten of rates over lengths at rest, in 1/s.
const DECADES: std::ops::RangeInclusive<i32> = -15..=12;

/// Audits the sum of all that is dissipated, as it is compiled; nothing where nothing is.
///
/// # Errors
/// What cannot be compiled.
pub(super) fn audit(
    model: &Model,
    values: &Values,
    settings: &Settings,
) -> Result<Option<Audit>, CompileError> {
    let Some(kernel) = model.dissipation(values, Mode::Jit(settings.level))? else {
        return Ok(None);
    };
    let length = values.typical_length();
    let Some(written) = model.written_dissipation(values, length) else { return Ok(None) };
    let mut random = Random::new(0x7261_7465);
    let regime = |decade: i32| {
        let point = |k: usize| {
            let size = libm::pow(10.0, f64::from(decade) + random.uniform(-0.5, 0.5));
            let reference = length * random.uniform(0.5, 1.5);
            let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            Point { measure: sign * size * reference, reference }
        };
        let points: Vec<Point> = (0..settings.points).map(point).collect();
        let out = Columns::new(&points).derivatives(&kernel);
        let mut regime = Regime::new(format!("rate 1e{decade}"), None);
        for (i, &point) in points.iter().enumerate() {
            let found = [out.psi[i], out.dpsi[i], out.d2psi[i]];
            measure_errors(&mut regime, &written, point, &found, settings.bar);
        }
        regime
    };
    let regimes = DECADES.step_by(3).map(regime).collect();
    let all: Vec<String> = model.dissipations().iter().map(|one| one.text.clone()).collect();
    let function = Subject::Dissipation(all.join(" + "));
    Ok(Some(Audit::of(function, Some(Argument::Measure(Measure::Length)), regimes)))
}
