//! Conditions and next states of what families give, as the mechanics takes them.

use piola_compiler::{CompileError, FamilyKernel, Form};
use piola_compiler::{
    GatheredCriterion, GatheredKernel, GatheredNextState, GradientCriterion, GradientNextState,
    Mode, Model, Values, VectorCriterion, VectorNextState,
};
use piola_mechanics::fracture::{FamilyCriterion, FamilyNextState};
use piola_mechanics::kernel::VariablesLaw;
use piola_mechanics::materials::Fields;

use super::model::{Numbered, by_material};

/// The functions of a potential of what families give that are no energies.
#[derive(Default)]
pub struct FamilyFunctions {
    /// Under which conditions of deformation gradients bonds break.
    pub gradient_criteria: Vec<GradientCriterion>,
    /// Under which conditions of gathered values they do.
    pub gathered_criteria: Vec<GatheredCriterion>,
    /// The same of what is gathered of vectors.
    pub vector_criteria: Vec<VectorCriterion>,
    /// What is remembered with deformation gradients, and what that becomes.
    pub gradient_next: Vec<GradientNextState>,
    /// The same of points with what they gather.
    pub gathered_next: Vec<GatheredNextState>,
    /// The same where these gather vectors.
    pub vector_next: Vec<VectorNextState>,
}

impl FamilyFunctions {
    /// Compiles those of a potential.
    pub(super) fn new(
        model: &Model,
        values: &Values,
        (mode, form): (Mode, Form),
    ) -> Result<FamilyFunctions, CompileError> {
        Ok(FamilyFunctions {
            gradient_criteria: model.gradient_criteria(values, mode, form)?,
            gathered_criteria: model.gathered_criteria(values, mode, form)?,
            vector_criteria: model.vector_criteria(values, mode, form)?,
            gradient_next: model.gradient_next_states(values, mode, form)?,
            gathered_next: model.gathered_next_states(values, mode, form)?,
            vector_next: model.vector_next_states(values, mode, form)?,
        })
    }

    /// Of what there are functions and no energy that would ask for them, where there are energies of gradients
    /// and of gathered values, or not.
    pub(super) fn without_energy(&self, [gradients, gathered]: [bool; 2]) -> Option<&'static str> {
        let of_gradients = !self.gradient_criteria.is_empty() || !self.gradient_next.is_empty();
        let of_gathered = !self.gathered_criteria.is_empty()
            || !self.vector_criteria.is_empty()
            || !self.gathered_next.is_empty()
            || !self.vector_next.is_empty();
        match (of_gradients && !gradients, of_gathered && !gathered) {
            (true, _) => Some("deformation gradients"),
            (_, true) => Some("gathered values"),
            _ => None,
        }
    }
}

/// A layer of energies with the laws of its materials.
#[derive(Clone, Copy)]
pub(super) struct OfLayer<'a> {
    pub(super) number: usize,
    pub(super) n_laws: usize,
    /// How many variables all materials have together, but for lengths of bonds.
    pub(super) n_variables: usize,
    pub(super) fields: Option<&'a Fields>,
}

impl OfLayer<'_> {
    /// A function of one of the laws.
    fn function(&self, law: usize, beside: usize, function: Numbered) -> Box<dyn VariablesLaw> {
        let mut laws: Vec<Option<Numbered>> = (0..self.n_laws).map(|_| None).collect();
        laws[law] = Some(function);
        by_material(self.n_variables + beside, laws, self.fields)
    }

    fn next(&self, law: usize, field: usize, next: Numbered) -> FamilyNextState {
        let next = self.function(law, 0, next);
        FamilyNextState { law: law as u8, field: self.field_of(law, field), next }
    }

    /// The number that a field of a law has among those of all.
    fn field_of(&self, law: usize, field: usize) -> usize {
        self.fields.map_or(0, |fields| fields.of_law(law).start) + field
    }

    /// The conditions of the gradients of a law.
    pub(super) fn by_gradients(
        self,
        law: usize,
        all: Vec<GradientCriterion>,
    ) -> impl Iterator<Item = FamilyCriterion> {
        all.into_iter().enumerate().map(move |(number, one)| FamilyCriterion {
            layer: self.number,
            law: law as u8,
            number,
            margin: self.function(law, 0, (Box::new(one.margin), None)),
            holds_at_zero: one.holds_at_zero,
        })
    }

    /// What is remembered with them.
    pub(super) fn next_by_gradients(
        self,
        law: usize,
        all: Vec<GradientNextState>,
    ) -> impl Iterator<Item = FamilyNextState> {
        all.into_iter().map(move |one| self.next(law, one.field, (Box::new(one.next), None)))
    }

    /// The conditions of the gathered values of a law behind `first` others; `numbers` says which of all
    /// integrals it has.
    pub(super) fn by_gathered(
        self,
        (law, first): (usize, usize),
        numbers: &[usize],
        all: Vec<GatheredCriterion>,
    ) -> impl Iterator<Item = FamilyCriterion> {
        (first..).zip(all).map(move |(number, one)| {
            let beside = usize::from(one.margin.of_bonds());
            FamilyCriterion {
                layer: self.number,
                law: law as u8,
                number,
                margin: self.function(law, beside, numbered(one.margin, numbers)),
                holds_at_zero: one.holds_at_zero,
            }
        })
    }

    /// The conditions of what points of a law gather of vectors, behind `first` others.
    pub(super) fn by_vectors(
        self,
        (law, first): (usize, usize),
        all: Vec<VectorCriterion>,
    ) -> impl Iterator<Item = FamilyCriterion<FamilyKernel>> {
        (first..).zip(all).map(move |(number, one)| FamilyCriterion {
            layer: self.number,
            law: law as u8,
            number,
            margin: one.margin,
            holds_at_zero: one.holds_at_zero,
        })
    }

    /// What points of a law remember of vectors.
    pub(super) fn next_by_vectors(
        self,
        law: usize,
        all: Vec<VectorNextState>,
    ) -> impl Iterator<Item = FamilyNextState<FamilyKernel>> {
        all.into_iter().map(move |one| FamilyNextState {
            law: law as u8,
            field: self.field_of(law, one.field),
            next: one.next,
        })
    }

    /// What points of a law remember.
    pub(super) fn next_by_gathered(
        self,
        law: usize,
        numbers: &[usize],
        all: Vec<GatheredNextState>,
    ) -> impl Iterator<Item = FamilyNextState> {
        all.into_iter().map(move |one| self.next(law, one.field, numbered(one.next, numbers)))
    }
}

/// A function of gathered values with the numbers of its variables: those of integrals stand behind the length
/// of a bond, if it is one of bonds.
fn numbered(function: GatheredKernel, numbers: &[usize]) -> Numbered {
    let beside = usize::from(function.of_bonds());
    let variables = (0..beside).chain(numbers.iter().map(|number| number + beside)).collect();
    (Box::new(function), Some(variables))
}
