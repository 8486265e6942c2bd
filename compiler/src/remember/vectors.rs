//! A point of an evenly deformed body with what it gathers of vectors and what it remembers. All points gather the
//! same there, so that one with its neighbours is a body.

use std::sync::Arc;

use super::History;
use super::gathering::{neighbours, volume};
use crate::gathered::{FamilyKernel, Slot, VectorCriterion, VectorKernels, VectorNextState};
use crate::kernel::Mode;
use crate::measure::Measure;
use crate::model::Model;
use crate::specialise::{CompileError, Form};
use crate::values::Values;
use crate::verify::sample::{Point, contains};
use crate::verify::vectors::{self, Place, Places, gathered};

/// A point with its neighbours and its history.
#[derive(Clone)]
pub(crate) struct RememberingFamily<'m> {
    model: &'m Model,
    family: Arc<Family>,
    /// With states among the fields, as they are now.
    values: Values,
}

struct Family {
    kernels: VectorKernels,
    next: Vec<VectorNextState>,
    /// Where neighbours are, from the point, at rest.
    vectors: Vec<Vec<f64>>,
    /// The volume of a point, in m^d.
    volume: f64,
}

impl<'m> RememberingFamily<'m> {
    /// One that begins with the states that the values say; nothing where no energy is of what points gather of
    /// vectors.
    pub(crate) fn new(
        model: &'m Model,
        values: &Values,
        (mode, form): (Mode, Form),
    ) -> Result<Option<RememberingFamily<'m>>, CompileError> {
        if !model.gathers_vectors() {
            return Ok(None);
        }
        let dt = model.number_of_time_step().filter(|_| model.families_remember_time());
        let values = values.with_directions_alone(model).with_states(model);
        let values = dt.into_iter().fold(values, Values::with_field);
        let mut kernels = None;
        model.compile_vectors(&values, (mode, form), &mut kernels)?;
        let Some(kernels) = kernels else { return Ok(None) };
        let family = Family {
            kernels,
            next: model.vector_next_states(&values, mode, form)?,
            vectors: neighbours(values.dimension, values.horizon),
            volume: volume(values.dimension, values.horizon),
        };
        Ok(Some(RememberingFamily { model, family: Arc::new(family), values }))
    }

    /// What kernels for it take.
    pub(crate) fn values(&self) -> &Values {
        &self.values
    }

    /// The states by their numbers among the parameters.
    pub(crate) fn states(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.family.next.iter().map(|one| (one.state, self.values.parameters[one.state]))
    }

    /// Whether the declared domain has all of its bonds where the body is deformed by `F - I`, row by row.
    pub(crate) fn is_declared(&self, change: &[f64]) -> bool {
        let Some(variant) = self.model.variant(self.values.dimension) else { return false };
        self.bonds(change, &[]).iter().all(|bond| {
            let (measure, reference) = (bond.length(), bond.slot(Slot::Length));
            contains(variant, Measure::Length, &self.values, Point { measure, reference })
        })
    }

    fn bonds(&self, change: &[f64], gathered: &[f64]) -> Vec<Place> {
        let bond = |rest: &Vec<f64>| {
            let row = |row: &[f64]| row.iter().zip(rest).map(|(h, x)| h * x).sum();
            let moved = change.chunks(rest.len()).map(row).collect();
            Place::new(rest, moved, gathered.to_vec())
        };
        self.family.vectors.iter().map(bond).collect()
    }

    /// A function of what it gathers, or of this and each of its bonds.
    fn values_of(&self, kernel: &FamilyKernel, change: &[f64], values: &Values) -> Vec<f64> {
        let Family { kernels, volume, .. } = &*self.family;
        let at = |bonds: Vec<Place>| Places::new(bonds, (self.model, values));
        let bonds = at(self.bonds(change, &vec![0.0; kernels.n_gathered]));
        let gathered = gathered(kernels, &bonds, || *volume);
        let mut bonds = self.bonds(change, &gathered);
        if !kernel.of_bonds() {
            bonds.truncate(1);
        }
        vectors::values(kernel, &at(bonds))
    }
}

impl History for RememberingFamily<'_> {
    /// It has its energies.
    type Energy = ();
    type Criterion = VectorCriterion;

    fn next(&self, change: &[f64], dt: f64) -> Vec<f64> {
        let mut values = self.values.clone();
        if let Some(number) = self.model.number_of_time_step() {
            values.parameters[usize::from(number)] = dt;
        }
        self.family.next.iter().map(|one| self.values_of(&one.next, change, &values)[0]).collect()
    }

    fn advance(&mut self, change: &[f64], dt: f64) {
        let next = self.next(change, dt);
        for (one, value) in self.family.next.iter().zip(next) {
            self.values.parameters[one.state] = value;
        }
    }

    /// Per volume of the body, in J/m^3: `psi + 1/2 sum_j V_j phi`.
    fn energy(&self, _: &(), change: &[f64]) -> f64 {
        let Family { kernels, volume, .. } = &*self.family;
        let sum = |kernel: &Option<FamilyKernel>| -> f64 {
            kernel.iter().flat_map(|kernel| self.values_of(kernel, change, &self.values)).sum()
        };
        sum(&kernels.points) + 0.5 * volume * sum(&kernels.bonds)
    }

    fn breaks(&self, criterion: &VectorCriterion, change: &[f64]) -> bool {
        let margins = self.values_of(&criterion.margin, change, &self.values);
        margins.into_iter().any(|margin| criterion.breaks(margin))
    }
}
