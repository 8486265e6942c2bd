//! Functions of gathered values that are no energies, compiled: conditions under which bonds break, and what is
//! remembered next. They are functions of what energies of points, or of bonds, are functions of.

use piola_grammar::Span;

use super::kernel::{GatheredKernel, WrittenGatheredEnergy};
use crate::breaking::{FamilyCriterion, FamilyNextState};
use crate::expression::NodeId;
use crate::kernel::Mode;
use crate::model::{Break, Model, OfFamily, Update, Variant};
use crate::specialise::{CompileError, Form, Known};
use crate::values::Values;
use crate::written::Written;

/// When bonds break by what points gather: by their lengths, too, or all bonds of a point.
pub type GatheredCriterion = FamilyCriterion<GatheredKernel, WrittenGatheredEnergy>;

/// What a state of a point becomes by what it gathers.
pub type GatheredNextState = FamilyNextState<GatheredKernel, WrittenGatheredEnergy>;

impl Model {
    /// When bonds break by numbers that points gather, for these values: any one of these conditions is enough.
    /// Those of vectors: [`Model::vector_criteria`].
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
        if self.gathers_vectors() {
            return Ok(Vec::new());
        }
        let criterion = |one: &Break<OfFamily>| {
            let of_bonds = one.of == OfFamily::Bonds;
            let (margin, written) = self.gathered_function(
                (variant, of_bonds),
                (one.root, one.span),
                values,
                (mode, form),
            )?;
            Ok(GatheredCriterion::new(one, margin, written))
        };
        let is_gathered = |one: &&Break<OfFamily>| one.of != OfFamily::Gradient;
        variant.family_breaks.iter().filter(is_gathered).map(criterion).collect()
    }

    /// What states of points become by what they gather, for these values with states among the fields
    /// ([`Values::with_states`]), and with the time step where an update depends on it. All of them are worked
    /// out from the states as they are, then they change at once. Of vectors: [`Model::vector_next_states`].
    ///
    /// # Errors
    /// A next value that is too large, or the horizon where none is given.
    pub fn gathered_next_states(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Vec<GatheredNextState>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        if self.gathers_vectors() {
            return Ok(Vec::new());
        }
        let next = |one: &Update<OfFamily>| {
            let (next, written) = self.gathered_function(
                (variant, false),
                (one.root, one.span),
                values,
                (mode, form),
            )?;
            Ok(GatheredNextState::new(one, values, next, written))
        };
        let is_gathered = |one: &&Update<OfFamily>| one.of != OfFamily::Gradient;
        variant.family_updates.iter().filter(is_gathered).map(next).collect()
    }

    fn gathered_function(
        &self,
        (variant, of_bonds): (&Variant, bool),
        (root, span): (NodeId, Span),
        values: &Values,
        (mode, form): (Mode, Form),
    ) -> Result<(GatheredKernel, WrittenGatheredEnergy), CompileError> {
        let of = (variant, of_bonds);
        let made = self.margin_or_next(of, (root, span), Known(Some(values)), form)?;
        let energy = Written::new(&variant.graph, &[root], values);
        let n_integrals = variant.integrals.len();
        let written = WrittenGatheredEnergy { energy, of_bonds, n_integrals };
        Ok((GatheredKernel::new(made, (mode, form), written.clone())?, written))
    }
}
