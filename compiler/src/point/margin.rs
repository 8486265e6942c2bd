//! Conditions of the deformation gradient under which bonds break, compiled: a margin is a function of `F` like
//! an energy, so it is made by the same code and keeps its digits near rest.

use super::Subject;
use super::kernel::{GradientKernel, WrittenGradientEnergy};
use crate::kernel::Mode;
use crate::model::{GradientBreak, Model};
use crate::specialise::{CompileError, Form};
use crate::values::Values;

/// When bonds break by a deformation gradient: their own, or that of a point at one of their ends.
#[derive(Debug)]
pub struct GradientCriterion {
    /// The margin, in the place of psi: bonds break where it is above 0.
    pub margin: GradientKernel,
    /// Whether they break where the margin is 0, too.
    pub holds_at_zero: bool,
    /// The condition as written, in canonical spelling.
    pub text: String,
    /// What it is, in the words of the file.
    pub reason: Option<String>,
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
            let written = || WrittenGradientEnergy::new(variant, &[one.root], values);
            let margin = GradientKernel::of(forms, values, mode, written)?;
            let (text, reason) = (one.text.clone(), one.reason.clone());
            Ok(Some(GradientCriterion { margin, holds_at_zero: one.holds_at_zero, text, reason }))
        };
        // One of which nothing is left holds nowhere.
        variant.gradient_breaks.iter().map(criterion).filter_map(Result::transpose).collect()
    }

    /// The margins as written, for these values.
    pub fn written_gradient_margins(&self, values: &Values) -> Vec<WrittenGradientEnergy> {
        let Some(variant) = self.variant(values.dimension) else { return Vec::new() };
        let written =
            |one: &GradientBreak| WrittenGradientEnergy::new(variant, &[one.root], values);
        variant.gradient_breaks.iter().map(written).collect()
    }
}
