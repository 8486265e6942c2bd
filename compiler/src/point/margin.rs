//! Conditions of the deformation gradient under which bonds break, compiled: a margin is a function of `F` like
//! an energy, so it is made by the same code and keeps its digits near rest.

use super::kernel::{GradientKernel, WrittenGradientEnergy};
use super::{GradientEnergyForms, Subject};
use crate::kernel::Mode;
use crate::model::{GradientBreak, Model};
use crate::specialise::{CompileError, Form};
use crate::values::Values;

/// When bonds break by a deformation gradient: their own, or that of a point at one of their ends.
#[derive(Debug)]
pub struct GradientCriterion {
    /// The margin, in the place of psi: bonds break where it is above 0.
    pub margin: GradientKernel,
    /// The same as written.
    pub written: WrittenGradientEnergy,
    /// Whether they break where the margin is 0, too.
    pub holds_at_zero: bool,
    /// The condition as written, in canonical spelling.
    pub text: String,
    /// What it is, in the words of the file.
    pub reason: Option<String>,
}

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

impl GradientCriterion {
    /// Whether something with this margin breaks.
    pub fn breaks(&self, margin: f64) -> bool {
        margin > 0.0 || self.holds_at_zero && margin == 0.0
    }
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
        let criterion = |one: &GradientBreak| {
            let subject = Subject { variant, roots: vec![one.root], span: one.span };
            let (Some(forms), _) = self.forms_of(subject, values, form)? else { return Ok(None) };
            let written = WrittenGradientEnergy::new(variant, &[one.root], values);
            let margin = GradientKernel::of(forms, values, mode, || written.clone())?;
            let (text, reason) = (one.text.clone(), one.reason.clone());
            let holds_at_zero = one.holds_at_zero;
            Ok(Some(GradientCriterion { margin, written, holds_at_zero, text, reason }))
        };
        // One of which nothing is left holds nowhere.
        variant.gradient_breaks.iter().map(criterion).filter_map(Result::transpose).collect()
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
        let condition = |(k, one): (usize, &GradientBreak)| {
            let subject = Subject { variant, roots: vec![one.root], span: one.span };
            let (forms, _) = match values {
                Some(values) => self.forms_of(subject, values, Form::Accurate)?,
                None => self.gradient_forms(subject, (&[], false), Form::Textbook, &|_| None)?,
            };
            let (number, text) = (variant.breaks.len() + k + 1, one.text.clone());
            let holds_at_zero = one.holds_at_zero;
            Ok(forms.map(|forms| GradientCondition { number, holds_at_zero, text, forms }))
        };
        let all = variant.gradient_breaks.iter().enumerate().map(condition);
        all.filter_map(Result::transpose).collect()
    }
}
