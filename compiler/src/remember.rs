//! One bond, triangle or tetrahedron and what it remembers, from measure to measure, or an evenly deformed body with
//! what its families remember: for lints, verification and studies of single ones.

mod gathering;
mod gradient;
mod vectors;

use std::sync::Arc;

use crate::breaking::{Criterion, NextState};
use crate::kernel::{Batch, Kernel, Mode, Order, Outputs};
use crate::measure::Measure;
use crate::model::Model;
use crate::specialise::{CompileError, Form};
use crate::values::Values;
use crate::verify::sample::Point;
pub(crate) use gathering::RememberingPoint;
pub(crate) use gradient::RememberingGradient;
pub(crate) use vectors::RememberingFamily;

/// What families give in an evenly deformed body, with what it remembers: a deformation gradient, or what a point
/// gathers. The body is deformed by `F - I`, row by row.
pub(crate) trait History: Clone {
    /// Its energy, compiled.
    type Energy;
    /// A condition under which bonds break.
    type Criterion;

    /// What states become, `dt` s after the last time, in the order of the updates.
    fn next(&self, change: &[f64], dt: f64) -> Vec<f64>;
    /// Changes the states, all at once.
    fn advance(&mut self, change: &[f64], dt: f64);
    /// psi, with states as they are.
    fn energy(&self, energy: &Self::Energy, change: &[f64]) -> f64;
    /// Whether bonds break, with states as they are.
    fn breaks(&self, criterion: &Self::Criterion, change: &[f64]) -> bool;
}

/// An interaction with its history.
#[derive(Clone, Debug)]
pub struct Remembering {
    next: Arc<[NextState]>,
    /// The fields of the values, states among them, as they are now.
    fields: Vec<f64>,
}

impl Remembering {
    /// A bond, a triangle or a tetrahedron that begins with the states that the values say, in SI units.
    ///
    /// # Errors
    /// As [`Model::next_states`].
    pub fn new(
        model: &Model,
        measure: Measure,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Remembering, CompileError> {
        let next = model.next_states(values, mode, form)?;
        let next = next.into_iter().filter(|next| next.measure() == measure).collect();
        let fields = values.clone().with_states(model).typical().map(|(_, value)| value).collect();
        Ok(Remembering { next, fields })
    }

    /// The values of all fields, as kernels for values [with states](Values::with_states) take them.
    pub fn fields(&self) -> &[f64] {
        &self.fields
    }

    /// The next values at a measure, `dt` s after the last: of each state its number among the fields and
    /// what it becomes.
    pub fn next(&self, point: Point, dt: f64) -> Vec<(usize, f64)> {
        let value = |one: &NextState| (one.field, value(&one.next, point, &self.fields, Some(dt)));
        self.next.iter().map(value).collect()
    }

    /// Changes the states, all at once; whether any is another.
    pub fn advance(&mut self, point: Point, dt: f64) -> bool {
        let next = self.next(point, dt);
        let mut changes = false;
        for (field, value) in next {
            changes |= self.fields[field].to_bits() != value.to_bits();
            self.fields[field] = value;
        }
        changes
    }

    /// psi, psi' and psi'' of an energy at a measure, with states as they are.
    pub fn energy(&self, kernel: &Kernel, point: Point) -> [f64; 3] {
        derivatives(kernel, point, &self.fields, None)
    }

    /// Whether it breaks at a measure, with states as they are.
    pub fn breaks(&self, criterion: &Criterion, point: Point) -> bool {
        criterion.breaks(value(&criterion.margin, point, &self.fields, None))
    }
}

fn value(kernel: &Kernel, point: Point, fields: &[f64], dt: Option<f64>) -> f64 {
    derivatives(kernel, point, fields, dt)[0]
}

/// psi and its derivatives, with fields and, where the kernel takes it, one more behind them: the time step,
/// or the length beside its rate.
pub(crate) fn derivatives(
    kernel: &Kernel,
    point: Point,
    fields: &[f64],
    last: Option<f64>,
) -> [f64; 3] {
    let all: Vec<f64> = fields.iter().copied().chain(last).collect();
    let batch = Batch {
        measure: &[point.measure],
        reference: &[point.reference],
        change: &[point.change()],
        fields: &all[..kernel.fields().len()],
    };
    let [mut psi, mut dpsi, mut d2psi] = [[0.0]; 3];
    let out = Outputs { psi: &mut psi, dpsi: &mut dpsi, d2psi: &mut d2psi };
    kernel.evaluate(batch, Order::Tangent, out);
    [psi[0], dpsi[0], d2psi[0]]
}
