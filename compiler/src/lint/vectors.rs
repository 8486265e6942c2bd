//! What points gather of vectors: energies that a rotation of the whole body changes, and conditions in bodies that
//! are deformed evenly.

use piola_grammar::Span;

use super::Finding;
use super::subject::example;
use crate::gathered::{Slot, VectorCriterion, VectorKernels};
use crate::kernel::Mode;
use crate::measure::Measure;
use crate::model::Model;
use crate::remember::{neighbours, volume};
use crate::specialise::Form;
use crate::values::Values;
use crate::verify::sample::{Point, contains};
use crate::verify::vectors::{self, Place, Places, gathered, turned};

/// By which part of itself an energy must change to be told.
const TOLD: f64 = 1e-9;

/// The first energy of points, and of bonds, that is not objective.
pub(super) fn not_objective(model: &Model) -> Vec<(Span, Finding)> {
    if !model.gathers_vectors() {
        return Vec::new();
    }
    let mut found: Vec<(Span, Finding)> = Vec::new();
    for dimension in model.dimensions() {
        let (Some(values), Some(variant)) = (example(model, dimension), model.variant(dimension))
        else {
            continue;
        };
        let values = values.with_states(model).without_parameters_that_vary(model);
        let mut kernels = None;
        let how = (Mode::Interpreter, Form::Textbook);
        let compiled = model.compile_vectors(&values, how, &mut kernels);
        let (Ok(_), Some(kernels)) = (compiled, kernels) else { continue };
        let parts = turned(&kernels, (model, &values));
        for ([at_rest, turned], of_bonds) in parts.into_iter().zip([false, true]) {
            let size = at_rest.abs().max(turned.abs());
            let is_told = (at_rest - turned).abs() > TOLD * size;
            let mut own = variant.gathered_energies.iter().filter(|one| one.of_bonds == of_bonds);
            let Some(energy) = own.next().filter(|_| is_told) else { continue };
            if found.iter().any(|(span, _)| *span == energy.span) {
                continue;
            }
            let message = format!(
                "psi({}) is not objective: a body that is turned as a whole stores energy",
                energy.head
            );
            let help = "no rotation changes what is made of products of vectors that turn with the body, `G'*G` of \
                        a gathered gradient, `xi*xi`; `Xi` and given directions stay where they are";
            found.push((energy.span, Finding { message, help: help.into() }));
        }
    }
    found
}

/// A point of an evenly deformed body with its neighbours, which gather what it does.
pub(super) struct Family<'m> {
    model: &'m Model,
    values: Values,
    kernels: VectorKernels,
    /// When bonds break.
    pub(super) criteria: Vec<VectorCriterion>,
    /// Where neighbours are, from the point, at rest.
    neighbours: Vec<Vec<f64>>,
}

impl<'m> Family<'m> {
    /// With the conditions of a potential; nothing where it has none of what points gather of vectors, or they are
    /// too large to be compiled.
    pub(super) fn new(model: &'m Model, dimension: usize) -> Option<Family<'m>> {
        let (mode, form) = (Mode::Interpreter, Form::Textbook);
        let values = example(model, dimension)?;
        let values = values.with_states(model).without_parameters_that_vary(model);
        let criteria = model.vector_criteria(&values, mode, form).ok()?;
        if criteria.is_empty() {
            return None;
        }
        let mut kernels = None;
        model.compile_vectors(&values, (mode, form), &mut kernels).ok()?;
        let neighbours = neighbours(dimension, values.horizon);
        Some(Family { model, values, kernels: kernels?, criteria, neighbours })
    }

    /// Whether bonds break where the body is deformed by `F - I`, row by row.
    pub(super) fn breaks(&self, criterion: &VectorCriterion, change: &[f64]) -> bool {
        let nothing = vec![0.0; self.kernels.n_gathered];
        let bonds = self.bonds(change, &nothing);
        let volume = volume(self.values.dimension, self.values.horizon);
        let gathered = gathered(&self.kernels, &bonds, || volume);
        let margins = vectors::values(&criterion.margin, &self.bonds(change, &gathered));
        margins.into_iter().any(|margin| criterion.breaks(margin))
    }

    /// Whether the declared domain has all bonds of the body.
    pub(super) fn declares(&self, change: &[f64]) -> bool {
        let Some(variant) = self.model.variant(self.values.dimension) else { return false };
        self.neighbours.iter().all(|rest| {
            let bond = Place::new(rest, moved(change, rest), Vec::new());
            let (measure, reference) = (bond.length(), bond.slot(Slot::Length));
            let point = Point { measure, reference };
            contains(variant, Measure::Length, &self.values, point)
        })
    }

    fn bonds(&self, change: &[f64], gathered: &[f64]) -> Places<'_> {
        let bond = |rest: &Vec<f64>| Place::new(rest, moved(change, rest), gathered.to_vec());
        let all = self.neighbours.iter().map(bond).collect();
        Places::new(all, (self.model, &self.values))
    }
}

/// What a neighbour moves by that is at `rest`.
fn moved(change: &[f64], rest: &[f64]) -> Vec<f64> {
    let row = |row: &[f64]| row.iter().zip(rest).map(|(h, x)| h * x).sum();
    change.chunks(rest.len()).map(row).collect()
}
