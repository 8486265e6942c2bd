//! Energies of measures that follow what comes to be remembered, as load steps take them: psi, psi' there, and
//! the derivative of that psi' by the measure.
//!
//! The witness is one evaluation of the energy as written over hyper-dual numbers: the measure varies in both
//! parts, and the states are what the updates as written make of them, varying in the second part alone.
//! So its mixed part is `psi'' + sum dpsi'/dp dP/dm`. Digits are what the lines with held states are about;
//! here it is whether the chain rule is right. So values may be off by a billionth of themselves and of the
//! order below over the measure, and near rest by 64 times what they change by when the measure, or the states
//! that come of it, are rounded.

use num_dual::HyperDual64;

use super::{Columns, Miss, Subject, UNIT_ROUNDOFF, Verification, Witness, sample};
use crate::compile::Kind;
use crate::expression::{Input, NodeId};
use crate::kernel::{Kernel, Level, Mode, WrittenEnergy};
use crate::measure::Measure;
use crate::model::{Model, Update, Variant};
use crate::specialise::{CompileError, Form};
use crate::values::Values;
use sample::Point;

/// Largest error over what counts as one.
const BAR: f64 = 64.0;

/// What values may be off by, as a part of themselves and of the order below over the length.
const RELATIVE: f64 = 1e-9;

/// Verifies energies at about `2 n` points with the states of the values, a second after the last time: of the
/// measures whose energy depends on a state that is updated.
pub(super) fn verify(
    model: &Model,
    variant: &Variant,
    values: &Values,
    n: usize,
) -> Result<Vec<Verification>, CompileError> {
    let mut all = Vec::new();
    for measure in Measure::ALL {
        all.extend(verify_of((model, variant), measure, values, n)?);
    }
    Ok(all)
}

fn verify_of(
    (model, variant): (&Model, &Variant),
    measure: Measure,
    values: &Values,
    n: usize,
) -> Result<Option<Verification>, CompileError> {
    let own = variant.energies.iter().filter(|one| one.measure == measure);
    let roots: Vec<NodeId> = own.map(|energy| energy.root).collect();
    let depends = |update: &Update<Measure>| {
        variant.graph.depends_on(&roots, Input::Parameter(update.state as u16))
    };
    let (true, Some(dt)) = (variant.updates.iter().any(depends), model.number_of_time_step())
    else {
        return Ok(None);
    };
    let mut following = values.clone().following_states(model);
    following.parameters[usize::from(dt)] = 1.0;
    let kernel = |mode| -> Result<Option<Kernel>, CompileError> {
        let compiled = model.compile_only(&[Kind::Measures], &following, mode, Form::Accurate)?;
        Ok(compiled.kernels.into_iter().find(|kernel| kernel.measure() == measure))
    };
    let strict = kernel(Mode::Jit(Level::Strict))?;
    let (fast, interpreted) = (kernel(Mode::Jit(Level::Fast))?, kernel(Mode::Interpreter)?);
    let (Some(strict), Some(fast), Some(interpreted)) = (strict, fast, interpreted) else {
        return Ok(None);
    };
    let next = model.written_next_states(&following);
    let next = variant.updates.iter().zip(next).filter(|(update, _)| update.of == measure);
    let witness = Following {
        energy: model.written(&following, measure),
        next: next.map(|(update, next)| (update.state as u16, next)).collect(),
    };
    let points = sample::points(variant, measure, values, n);
    let found = Verification::new(Subject::Following(measure), &[(Witness::HyperDual, BAR)]);
    Ok(Some(compare(found, [&strict, &fast, &interpreted], &witness, &points)))
}

fn compare(
    mut found: Verification,
    kernels: [&Kernel; 3],
    witness: &Following,
    points: &[Point],
) -> Verification {
    let columns = Columns::new(points);
    let [strict, fast, interpreted] = kernels.map(|kernel| columns.derivatives(kernel));
    for (k, point) in points.iter().enumerate() {
        let [strict, fast, interpreted] =
            [&strict, &fast, &interpreted].map(|all| [all.psi[k], all.dpsi[k], all.d2psi[k]]);
        found.count(&strict, &interpreted);
        let (expected, units) = witness.with_units(*point);
        for compiled in [strict, fast] {
            for order in 0..3 {
                let (value, expected) = (compiled[order], expected[order]);
                let error = (value - expected).abs() / (units[order] + f64::MIN_POSITIVE);
                found.see(0, order, error, |bar| Miss {
                    place: vec![point.measure, point.reference],
                    order,
                    compiled: vec![value],
                    expected: vec![expected],
                    tolerance: bar * units[order],
                    is_wrong: Miss::is_far_off(value, expected),
                });
            }
        }
    }
    found
}

/// The energy and the updates as written.
struct Following {
    energy: WrittenEnergy,
    /// What becomes of each state, by its number.
    next: Vec<(u16, WrittenEnergy)>,
}

impl Following {
    /// psi and psi' at the next states, and the derivative of that psi' by the measure; the measure and the
    /// next states are off by so many parts of themselves.
    fn at(&self, point: Point, [of_measure, of_states]: [f64; 2]) -> [f64; 3] {
        let measure = point.measure * (1.0 + of_measure);
        let reference = || HyperDual64::from_re(point.reference);
        let next = |written: &WrittenEnergy| {
            let alone = written.evaluate(HyperDual64::new(measure, 0.0, 1.0, 0.0), reference());
            HyperDual64::new(alone.re * (1.0 + of_states), 0.0, alone.eps2, 0.0)
        };
        let states: Vec<(u16, HyperDual64)> =
            self.next.iter().map(|(state, written)| (*state, next(written))).collect();
        let state = |number: u16| states.iter().find(|one| one.0 == number).map(|one| one.1);
        let both = HyperDual64::new(measure, 1.0, 1.0, 0.0);
        let psi = self.energy.evaluate_at_states(both, reference(), state);
        [psi.re, psi.eps1, psi.eps1eps2]
    }

    /// The same, and what counts as an error of one of each.
    fn with_units(&self, point: Point) -> ([f64; 3], [f64; 3]) {
        let here = self.at(point, [0.0; 2]);
        let [psi, slope, curvature] = here.map(f64::abs);
        let scales = [psi, slope + psi / point.measure, curvature + slope / point.measure];
        let mut units = scales.map(|scale| RELATIVE / BAR * scale);
        for u in [-2.0 * UNIT_ROUNDOFF, 2.0 * UNIT_ROUNDOFF] {
            for off in [[u, 0.0], [0.0, u]] {
                let there = self.at(point, off);
                for order in 0..3 {
                    units[order] += (there[order] - here[order]).abs();
                }
            }
        }
        (here, units)
    }
}
