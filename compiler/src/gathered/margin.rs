//! Conditions of gathered values under which bonds break, compiled: a margin is a function of what energies of
//! points, or of bonds, are functions of.

use super::kernel::{GatheredKernel, WrittenGatheredEnergy};
use crate::kernel::Mode;
use crate::model::{GatheredBreak, Model};
use crate::specialise::{CompileError, Form, Named};
use crate::values::Values;
use crate::written::Written;

/// When bonds break by what points gather: by their lengths, too, or all bonds of a point.
#[derive(Debug)]
pub struct GatheredCriterion {
    /// The margin, in the place of psi: bonds break where it is above 0.
    pub margin: GatheredKernel,
    /// The same as written.
    pub written: WrittenGatheredEnergy,
    /// Whether they break where the margin is 0, too.
    pub holds_at_zero: bool,
    /// The condition as written, in canonical spelling.
    pub text: String,
    /// What it is, in the words of the file.
    pub reason: Option<String>,
}

impl GatheredCriterion {
    /// Whether something with this margin breaks.
    pub fn breaks(&self, margin: f64) -> bool {
        margin > 0.0 || self.holds_at_zero && margin == 0.0
    }
}

impl Model {
    /// When bonds break by what points gather, for these values: any one of these conditions is enough.
    ///
    /// # Errors
    /// A condition that is too large, or the horizon where none is given.
    pub fn gathered_criteria(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Vec<GatheredCriterion>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let criterion = |one: &GatheredBreak| {
            let argument = if one.of_bonds { "l" } else { "integral" };
            let named = Named { argument, span: one.span };
            let subject = (variant, one.of_bonds, &[one.root][..]);
            let (made, _) = self.gathered_form(subject, named, values, form)?;
            let Some(made) = made else { return Ok(None) };
            let energy = Written::new(&variant.graph, &[one.root], values);
            let (of_bonds, n_integrals) = (one.of_bonds, variant.integrals.len());
            let written = WrittenGatheredEnergy { energy, of_bonds, n_integrals };
            let margin = GatheredKernel::new(made, (mode, form), written.clone())?;
            let (text, reason) = (one.text.clone(), one.reason.clone());
            let holds_at_zero = one.holds_at_zero;
            Ok(Some(GatheredCriterion { margin, written, holds_at_zero, text, reason }))
        };
        // One of which nothing is left holds nowhere.
        variant.gathered_breaks.iter().map(criterion).filter_map(Result::transpose).collect()
    }
}
