//! Conditions of gathered values under which bonds break, compiled: a margin is a function of what energies of
//! points, or of bonds, are functions of.

use super::kernel::{GatheredKernel, WrittenGatheredEnergy};
use crate::breaking::FamilyCriterion;
use crate::kernel::Mode;
use crate::model::{Break, Model, OfFamily};
use crate::specialise::{CompileError, Form, Named};
use crate::values::Values;
use crate::written::Written;

/// When bonds break by what points gather: by their lengths, too, or all bonds of a point.
pub type GatheredCriterion = FamilyCriterion<GatheredKernel, WrittenGatheredEnergy>;

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
        let criterion = |one: &Break<OfFamily>| {
            let (of_bonds, argument) = match one.of {
                OfFamily::Gradient => return Ok(None),
                OfFamily::Points => (false, "integral"),
                OfFamily::Bonds => (true, "l"),
            };
            let named = Named { argument, span: one.span };
            let subject = (variant, of_bonds, &[one.root][..]);
            let (made, _) = self.gathered_form(subject, named, values, form)?;
            let Some(made) = made else { return Ok(None) };
            let energy = Written::new(&variant.graph, &[one.root], values);
            let n_integrals = variant.integrals.len();
            let written = WrittenGatheredEnergy { energy, of_bonds, n_integrals };
            let margin = GatheredKernel::new(made, (mode, form), written.clone())?;
            Ok(Some(GatheredCriterion::new(one, margin, written)))
        };
        // One of which nothing is left holds nowhere.
        variant.family_breaks.iter().map(criterion).filter_map(Result::transpose).collect()
    }
}
