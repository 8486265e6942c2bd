//! What drives a body in motion: the conditions of its scene, and parameters that change with time.

use std::sync::{Mutex, PoisonError};

use piola_solvers::motion::MotionDrive;

use crate::case::{FieldsInTime, WrongField};
use crate::scene::boundary::NonFiniteCondition;
use crate::scene::drive::MotionConditions;

/// Conditions, and parameters of the energies.
pub(in crate::simulation) struct Driven<'a> {
    conditions: MotionConditions<'a>,
    fields: &'a FieldsInTime<'a>,
    /// The first parameter that cannot be: the solver only sees that one cannot.
    wrong: Mutex<Option<WrongField>>,
}

impl<'a> Driven<'a> {
    pub(in crate::simulation) fn new(
        conditions: MotionConditions<'a>,
        fields: &'a FieldsInTime<'a>,
    ) -> Driven<'a> {
        Driven { conditions, fields, wrong: Mutex::new(None) }
    }

    /// The condition that was not finite when the solver asked for it.
    pub(in crate::simulation) fn problem(&self) -> Option<NonFiniteCondition> {
        self.conditions.problem()
    }

    /// The parameter that could not be when the solver asked for it.
    pub(in crate::simulation) fn wrong_parameter(&self) -> Option<WrongField> {
        self.wrong.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl MotionDrive for Driven<'_> {
    fn displaced(&self) -> &[usize] {
        self.conditions.displaced()
    }

    fn displacements(&self, t: f64, values: &mut [f64]) {
        self.conditions.displacements(t, values);
    }

    fn driven(&self) -> &[usize] {
        self.conditions.driven()
    }

    fn velocities(&self, t: f64, values: &mut [f64]) {
        self.conditions.velocities(t, values);
    }

    fn accelerated(&self) -> &[usize] {
        self.conditions.accelerated()
    }

    fn accelerations(&self, t: f64, values: &mut [f64]) {
        self.conditions.accelerations(t, values);
    }

    fn loads(&self, t: f64, loads: &mut [f64]) {
        self.conditions.loads(t, loads);
    }

    fn loads_change(&self) -> bool {
        self.conditions.loads_change()
    }

    fn parameters_change(&self) -> bool {
        self.fields.change()
    }

    fn set_parameters(&self, t: f64) -> bool {
        let wrong = self.fields.advance(t).err();
        let is_set = wrong.is_none();
        *self.wrong.lock().unwrap_or_else(PoisonError::into_inner) = wrong;
        is_set
    }
}
