//! Conditions of the deformation gradient under which bonds break, compiled: a margin is a function of `F` like
//! an energy, so it is made by the same code and keeps its digits near rest.

use super::kernel::{GradientKernel, WrittenGradientEnergy};
use super::{GradientEnergyForms, Subject};
use crate::breaking::FamilyCriterion;
use crate::kernel::Mode;
use crate::model::{Break, Model, OfFamily, Variant};
use crate::specialise::{CompileError, Form};
use crate::values::Values;

/// When bonds break by a deformation gradient: their own, or that of a point at one of their ends.
pub type GradientCriterion = FamilyCriterion<GradientKernel, WrittenGradientEnergy>;

/// A condition of the deformation gradient as a function of it, for those who print it.
#[derive(Clone, Debug)]
pub struct GradientCondition {
    /// Which of the conditions of the potential it is, from 1: those of measures come first.
    pub number: usize,
    /// Whether bonds break where the margin is 0, too.
    pub holds_at_zero: bool,
    /// As written, in canonical spelling.
    pub text: String,
    /// The margin in the place of psi.
    pub forms: GradientEnergyForms,
}

/// The conditions of a variant's deformation gradients.
fn of_gradients(variant: &Variant) -> impl Iterator<Item = &Break<OfFamily>> {
    variant.family_breaks.iter().filter(|one| one.of == OfFamily::Gradient)
}

impl Model {
    /// When bonds break by deformation gradients, for these values: any one of these conditions is enough.
    ///
    /// # Errors
    /// A condition that is too large, or the horizon where none is given.
    pub fn gradient_criteria(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Vec<GradientCriterion>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let criterion = |one: &Break<OfFamily>| {
            let subject = Subject { variant, roots: vec![one.root], span: one.span };
            let (Some(forms), _) = self.forms_of(subject, values, form)? else { return Ok(None) };
            let written = WrittenGradientEnergy::new(variant, &[one.root], values);
            let margin = GradientKernel::of(forms, values, mode, || written.clone())?;
            Ok(Some(GradientCriterion::new(one, margin, written)))
        };
        // One of which nothing is left holds nowhere.
        of_gradients(variant).map(criterion).filter_map(Result::transpose).collect()
    }

    /// The conditions of the deformation gradient as they are compiled for these values; with symbols for
    /// parameters where there are none.
    ///
    /// # Errors
    /// As [`Model::gradient_criteria`].
    pub fn gradient_conditions(
        &self,
        dimension: usize,
        values: Option<&Values>,
    ) -> Result<Vec<GradientCondition>, CompileError> {
        let variant = self.variant(dimension).ok_or(CompileError::WrongDimension(dimension))?;
        let condition = |(k, one): (usize, &Break<OfFamily>)| {
            let subject = Subject { variant, roots: vec![one.root], span: one.span };
            let (forms, _) = match values {
                Some(values) => self.forms_of(subject, values, Form::Accurate)?,
                None => self.gradient_forms(subject, (&[], false), Form::Textbook, &|_| None)?,
            };
            let (number, text) = (variant.breaks.len() + k + 1, one.text.clone());
            let holds_at_zero = one.holds_at_zero;
            Ok(forms.map(|forms| GradientCondition { number, holds_at_zero, text, forms }))
        };
        let all = of_gradients(variant).enumerate().map(condition);
        all.filter_map(Result::transpose).collect()
    }
}
