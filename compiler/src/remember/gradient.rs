//! A deformation gradient and what it remembers, from one to the next.

use std::sync::Arc;

use super::History;
use crate::kernel::Mode;
use crate::model::Model;
use crate::point::sample::plus_identity;
use crate::point::{GradientBatch, GradientCriterion, GradientKernel, GradientNextState};
use crate::specialise::{CompileError, Form};
use crate::values::Values;

/// A deformation gradient with its history.
#[derive(Clone, Debug)]
pub(crate) struct RememberingGradient {
    next: Arc<[GradientNextState]>,
    /// The fields of the values, states and the time step among them, as they are now.
    fields: Vec<f64>,
    /// The number of the time step among them.
    time_step: Option<usize>,
}

impl RememberingGradient {
    /// One that begins with the states that the values say, and the values that kernels for it take: with states
    /// and the time step among the fields.
    pub(crate) fn new(
        model: &Model,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<(RememberingGradient, Values), CompileError> {
        let values = values.clone().with_states(model).following_states(model);
        let next = model.gradient_next_states(&values, mode, form)?.into();
        let fields = values.typical().map(|(_, value)| value).collect();
        let dt = model.number_of_time_step();
        let time_step = dt.and_then(|dt| values.fields.iter().position(|field| *field == dt));
        Ok((RememberingGradient { next, fields, time_step }, values))
    }

    /// The states by their numbers among the parameters.
    pub(crate) fn states(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.next.iter().map(|one| (one.state, self.fields[one.field]))
    }
}

impl History for RememberingGradient {
    type Energy = GradientKernel;
    type Criterion = GradientCriterion;

    fn next(&self, change: &[f64], dt: f64) -> Vec<f64> {
        let mut fields = self.fields.clone();
        if let Some(time_step) = self.time_step {
            fields[time_step] = dt;
        }
        self.next.iter().map(|one| value(&one.next, change, &fields)).collect()
    }

    fn advance(&mut self, change: &[f64], dt: f64) {
        let next = self.next(change, dt);
        for (one, value) in self.next.iter().zip(next) {
            self.fields[one.field] = value;
        }
    }

    fn energy(&self, kernel: &GradientKernel, change: &[f64]) -> f64 {
        value(kernel, change, &self.fields)
    }

    fn breaks(&self, criterion: &GradientCriterion, change: &[f64]) -> bool {
        criterion.breaks(value(&criterion.margin, change, &self.fields))
    }
}

fn value(kernel: &GradientKernel, change: &[f64], fields: &[f64]) -> f64 {
    let gradient = plus_identity(change, 1.0);
    let fields = if kernel.fields().is_empty() { &[] } else { fields };
    let mut found = [f64::NAN];
    kernel.evaluate(
        GradientBatch { n: 1, gradient: &gradient, change, fields },
        &mut found,
        &mut [],
    );
    found[0]
}
