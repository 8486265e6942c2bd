//! Energies of measures that follow what comes to be remembered, as load steps take them: psi, psi' there, and
//! the derivative of that psi' by the measure.
//!
//! The witness is one evaluation of the energy as written over hyper-dual numbers: the measure varies in both
//! parts, and the states are what the updates as written make of them, varying in the second part alone.
//! So its mixed part is `psi'' + sum dpsi'/dp dP/dm`. Digits are what the lines with held states are about;
//! here it is whether the chain rule is right. So values may be off by a billionth of themselves and of the
//! order below over the measure, and near rest by 64 times what they change by when the measure, or the states
//! that come of it, are rounded. Where that is missed numbers of many digits decide, in the same way.
//!
//! What follows from a next state that no double holds has no digits at all, and what follows from one that has
//! lost its own has none that could be right: neither is wrong.

use num_dual::HyperDual64;

use super::measure::error_over_tolerance;
use super::{Columns, Miss, Subject, UNIT_ROUNDOFF, Verification, Witness, remember, sample};
use crate::compile::Kind;
use crate::expression::number::Number;
use crate::expression::precise::Precise;
use crate::expression::{Input, NodeId, Operator};
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
    let is_followed = variant.updates.iter().any(|update| is_needed(variant, measure, update));
    let (true, Some(dt)) = (is_followed, model.number_of_time_step()) else {
        return Ok(None);
    };
    let mut following = values.clone().following_states(model);
    following.parameters[usize::from(dt)] = 1.0;
    let Some(kernels) = kernels(model, measure, &following)? else { return Ok(None) };
    let points = sample::points(variant, measure, values, n);
    let witness = Following::new((model, variant), measure, &following, &points)?;
    let found = Verification::new(Subject::Following(measure), &[(Witness::HyperDual, BAR)]);
    Ok(Some(compare(found, &kernels, &witness, &points)))
}

/// Whether the energy of a measure depends on a state that is updated.
fn is_needed(variant: &Variant, measure: Measure, update: &Update<Measure>) -> bool {
    let own = variant.energies.iter().filter(|one| one.measure == measure);
    let roots: Vec<NodeId> = own.map(|energy| energy.root).collect();
    variant.graph.depends_on(&roots, Input::Parameter(update.state as u16))
}

/// The energy of a measure for values that follow states, at both levels and interpreted.
pub(super) fn kernels(
    model: &Model,
    measure: Measure,
    following: &Values,
) -> Result<Option<[Kernel; 3]>, CompileError> {
    let kernel = |mode| -> Result<Option<Kernel>, CompileError> {
        let compiled = model.compile_only(&[Kind::Measures], following, mode, Form::Accurate)?;
        Ok(compiled.kernels.into_iter().find(|kernel| kernel.measure() == measure))
    };
    let strict = kernel(Mode::Jit(Level::Strict))?;
    let (fast, interpreted) = (kernel(Mode::Jit(Level::Fast))?, kernel(Mode::Interpreter)?);
    let (Some(strict), Some(fast), Some(interpreted)) = (strict, fast, interpreted) else {
        return Ok(None);
    };
    Ok(Some([strict, fast, interpreted]))
}

pub(super) fn compare(
    mut found: Verification,
    kernels: &[Kernel; 3],
    witness: &Following,
    points: &[Point],
) -> Verification {
    let columns = Columns::new(points);
    let [strict, fast, interpreted] = kernels.each_ref().map(|kernel| columns.derivatives(kernel));
    for (k, point) in points.iter().enumerate() {
        let [strict, fast, interpreted] =
            [&strict, &fast, &interpreted].map(|all| [all.psi[k], all.dpsi[k], all.d2psi[k]]);
        found.count(&strict, &interpreted);
        let (dual, truth) = witness.expected(*point, [strict, fast]);
        let is_decided =
            |truth: &Expected| dual.as_ref().is_none_or(|dual| !truth.is_near(&dual.values));
        found.undecided += usize::from(truth.as_ref().is_some_and(is_decided));
        // Or nobody can say.
        let Some(expected) = truth.as_ref().or(dual.as_ref()) else { continue };
        let has_digits = || witness.next.iter().all(|next| next.has_digits(k, *point));
        for compiled in [strict, fast] {
            for order in 0..3 {
                let (value, truth) = (compiled[order], expected.values[order]);
                let relative = |x: f64| (x - truth).abs() / (truth.abs() + f64::MIN_POSITIVE);
                let of_dual =
                    dual.as_ref().map_or(f64::INFINITY, |dual| relative(dual.values[order]));
                found.see(0, order, expected.error(order, value), |bar| Miss {
                    place: vec![point.measure, point.reference],
                    order,
                    compiled: vec![value],
                    expected: vec![truth],
                    tolerance: bar * expected.units[order],
                    is_wrong: Miss::is_wrong(relative(value), of_dual) && has_digits(),
                });
            }
        }
    }
    found
}

/// What a witness says at a point: psi, psi' and the derivative of that psi' by the measure.
struct Expected {
    values: [f64; 3],
    /// What counts as an error of one of each.
    units: [f64; 3],
}

impl Expected {
    /// What a witness says, and would where the measure and the next states are off by so many parts of themselves;
    /// nothing where no doubles hold it.
    fn new(at: impl Fn([f64; 2]) -> Option<[f64; 3]>, point: Point) -> Option<Expected> {
        let known = |off| at(off).filter(|all| all.iter().all(|x| x.is_finite()));
        let values = known([0.0; 2])?;
        let [psi, slope, curvature] = values.map(f64::abs);
        let scales = [psi, slope + psi / point.measure, curvature + slope / point.measure];
        let mut units = scales.map(|scale| RELATIVE / BAR * scale);
        for u in [-2.0 * UNIT_ROUNDOFF, 2.0 * UNIT_ROUNDOFF] {
            for there in [[u, 0.0], [0.0, u]].into_iter().filter_map(known) {
                for order in 0..3 {
                    units[order] += (there[order] - values[order]).abs();
                }
            }
        }
        Some(Expected { values, units })
    }

    /// How far off a value is, in units.
    fn error(&self, order: usize, value: f64) -> f64 {
        error_over_tolerance(value, self.values[order], self.units[order] + f64::MIN_POSITIVE)
    }

    /// Whether values are within the bar.
    fn is_near(&self, values: &[f64; 3]) -> bool {
        (0..3).all(|order| self.error(order, values[order]) <= BAR)
    }
}

/// The energy and the updates as written.
pub(super) struct Following {
    energy: WrittenEnergy,
    next: Vec<Next>,
}

/// What becomes of a state.
struct Next {
    /// Its number.
    state: u16,
    written: WrittenEnergy,
    /// At every point, at the strict level and at the fast one.
    compiled: [Vec<f64>; 2],
}

impl Next {
    /// Whether it is a number at the point of this number, and right to more than a few digits as far as is known.
    fn has_digits(&self, k: usize, point: Point) -> bool {
        let truth = remember::truth(&self.written, point, 0.0);
        let is_right = |value: f64| truth.is_none_or(|truth| !Miss::is_far_off(value, truth));
        self.compiled.iter().all(|all| all[k].is_finite() && is_right(all[k]))
    }
}

impl Following {
    /// Those of a measure for values that follow states, at these points.
    pub(super) fn new(
        (model, variant): (&Model, &Variant),
        measure: Measure,
        following: &Values,
        points: &[Point],
    ) -> Result<Following, CompileError> {
        let columns = Columns::new(points);
        let compiled = |mode| -> Result<Vec<Vec<f64>>, CompileError> {
            let all = model.next_states(following, mode, Form::Accurate)?;
            Ok(all.iter().map(|one| columns.derivatives(&one.next).psi).collect())
        };
        let [strict, fast] = [Level::Strict, Level::Fast].map(|level| compiled(Mode::Jit(level)));
        let compiled = strict?.into_iter().zip(fast?);
        let all = variant.updates.iter().zip(model.written_next_states(following)).zip(compiled);
        let next = all.map(|((update, written), compiled)| {
            let next = Next { state: update.state as u16, written, compiled: compiled.into() };
            (update, next)
        });
        let is_own =
            |update: &Update<Measure>| update.of == measure && is_needed(variant, measure, update);
        let next = next.filter(|(update, _)| is_own(update)).map(|(_, next)| next).collect();
        Ok(Following { energy: model.written(following, measure), next })
    }

    /// What hyper-dual numbers say and, where a compiled value misses that, numbers of many digits.
    fn expected(
        &self,
        point: Point,
        compiled: [[f64; 3]; 2],
    ) -> (Option<Expected>, Option<Expected>) {
        let dual = Expected::new(|off| self.by_hyper_dual(point, off), point);
        let agrees = |dual: &Expected| compiled.iter().all(|values| dual.is_near(values));
        let truth = match dual.as_ref().is_some_and(agrees) {
            true => None,
            false => Expected::new(|off| self.exactly(point, off), point),
        };
        (dual, truth)
    }

    /// psi and psi' at the next states, and the derivative of that psi' by the measure; the measure and the
    /// next states are off by so many parts of themselves.
    fn by_hyper_dual(&self, point: Point, [of_measure, of_states]: [f64; 2]) -> Option<[f64; 3]> {
        let measure = point.measure * (1.0 + of_measure);
        let reference = || HyperDual64::from_re(point.reference);
        let states = self.states(|written| {
            let alone = written.evaluate(HyperDual64::new(measure, 0.0, 1.0, 0.0), reference());
            HyperDual64::new(alone.re * (1.0 + of_states), 0.0, alone.eps2, 0.0)
        })?;
        let both = HyperDual64::new(measure, 1.0, 1.0, 0.0);
        let psi = self.psi([both, reference()], &states);
        Some([psi.re, psi.eps1, psi.eps1eps2])
    }

    /// The same in numbers of many digits, each rounded once. These have two derivatives along one line: where the
    /// measure moves by `a`, and the states as they do where it moves by 1/2, the second is
    /// `a^2 psi'' + a sum dpsi'/dp dP/dm` and what does not depend on `a`. What `a = 1` has over `a = 0` is it.
    fn exactly(&self, point: Point, [of_measure, of_states]: [f64; 2]) -> Option<[f64; 3]> {
        let measure =
            |slope| Precise::<512>::line(point.measure, slope, of_measure * point.measure);
        let reference = || Precise::constant(point.reference);
        let states = self.states(|written| {
            let next = written.evaluate(measure(0.5), reference());
            Precise::binary(Operator::Multiply, next, Precise::constant(1.0 + of_states))
        })?;
        let along = |slope| self.psi([measure(slope), reference()], &states);
        let (moving, held) = (along(1.0), along(0.0));
        let psi = moving.value();
        let [_, slope, tangent] = Precise::binary(Operator::Subtract, moving, held).rounded();
        Some([psi, slope, tangent])
    }

    /// What becomes of every state, by its number; nothing where no double holds one of them.
    fn states<N: Number>(&self, next: impl Fn(&WrittenEnergy) -> N) -> Option<Vec<(u16, N)>> {
        let all = self.next.iter().map(|one| (one.state, next(&one.written)));
        all.map(|one| one.1.value().is_finite().then_some(one)).collect()
    }

    /// The energy as written at these states.
    fn psi<N: Number>(&self, [measure, reference]: [N; 2], states: &[(u16, N)]) -> N {
        let own = |number: u16| states.iter().find(|one| one.0 == number);
        let state = |number: u16| own(number).map(|one| one.1.clone());
        self.energy.evaluate_at_states(measure, reference, state)
    }
}
