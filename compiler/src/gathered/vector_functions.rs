//! Functions of what points gather of vectors that are no energies, compiled: conditions under which bonds break, and
//! what points remember next.

use piola_grammar::Span;

use super::family::{FamilyKernel, WrittenFamily};
use super::vectors::Made;
use crate::breaking::{FamilyCriterion, FamilyNextState};
use crate::expression::NodeId;
use crate::kernel::Mode;
use crate::model::{Break, Model, OfFamily, Update, Variant};
use crate::simplify::Simplifier;
use crate::specialise::{CompileError, Form, Known, Named, or_zero, sum_in};
use crate::values::Values;
use crate::written::Written;

/// When bonds break by what points gather of vectors: by the vector of a bond, too, or all bonds of a point.
pub type VectorCriterion = FamilyCriterion<FamilyKernel, WrittenFamily>;

/// What a state of a point becomes by what it gathers of vectors.
pub type VectorNextState = FamilyNextState<FamilyKernel, WrittenFamily>;

impl Model {
    /// The conditions of what points gather of vectors.
    pub(crate) fn conditions_of_vectors<'v>(
        &self,
        variant: &'v Variant,
    ) -> impl Iterator<Item = &'v Break<OfFamily>> + use<'v> {
        // Energies are of vectors where they are in any dimension.
        let gathers_vectors = self.gathers_vectors();
        let all = variant.family_breaks.iter().filter(move |_| gathers_vectors);
        all.filter(|one| one.of != OfFamily::Gradient)
    }

    /// What points remember of what they gather of vectors.
    pub(crate) fn updates_of_vectors<'v>(
        &self,
        variant: &'v Variant,
    ) -> impl Iterator<Item = &'v Update<OfFamily>> + use<'v> {
        let gathers_vectors = self.gathers_vectors();
        let all = variant.family_updates.iter().filter(move |_| gathers_vectors);
        all.filter(|one| one.of != OfFamily::Gradient)
    }

    /// When bonds break by what points gather of vectors, for these values: any one of these conditions is enough.
    /// Kernels of bonds take the length at rest, those of points do not.
    ///
    /// # Errors
    /// A condition that is too large, or the horizon where none is given.
    pub fn vector_criteria(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Vec<VectorCriterion>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let criterion = |one: &Break<OfFamily>| {
            let of = (variant, one.of == OfFamily::Bonds);
            let (margin, written) =
                self.vector_function(of, (one.root, one.span), values, (mode, form))?;
            Ok(VectorCriterion::new(one, margin, written))
        };
        self.conditions_of_vectors(variant).map(criterion).collect()
    }

    /// What states of points become by what they gather of vectors, as [`Model::gathered_next_states`] says it of
    /// numbers.
    ///
    /// # Errors
    /// A next value that is too large, or the horizon where none is given.
    pub fn vector_next_states(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Vec<VectorNextState>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let next = |one: &Update<OfFamily>| {
            let of = (variant, false);
            let (next, written) =
                self.vector_function(of, (one.root, one.span), values, (mode, form))?;
            Ok(VectorNextState::new(one, values, next, written))
        };
        self.updates_of_vectors(variant).map(next).collect()
    }

    fn vector_function(
        &self,
        (variant, of_bonds): (&Variant, bool),
        (root, span): (NodeId, Span),
        values: &Values,
        (mode, form): (Mode, Form),
    ) -> Result<(FamilyKernel, WrittenFamily), CompileError> {
        let of = (variant, of_bonds);
        let made = self.margin_or_next_of_vectors(of, (root, span), Known(Some(values)), form)?;
        let written = WrittenFamily {
            terms: Written::new(&variant.graph, &[root], values),
            multipliers: vec![None],
            first_direction: self.parameters().len() as u16,
            functions: Vec::new(),
        };
        let slots = (made.variables, made.given);
        Ok((FamilyKernel::new(made.form, mode, slots, written.clone())?, written))
    }

    /// A function of bonds or of points that is kept also where parameters leave nothing of it.
    pub(crate) fn margin_or_next_of_vectors(
        &self,
        of: (&Variant, bool),
        (root, span): (NodeId, Span),
        known: Known<'_>,
        form: Form,
    ) -> Result<Made, CompileError> {
        let graph = &of.0.graph;
        let named = Named { argument: "integral", span };
        named.has_horizon(graph, &[root], known.lacks_horizon())?;
        let subject = ("integral", &[root][..]);
        let (exact, mut dropped) = (Simplifier::exact(), Vec::new());
        let sum = sum_in(exact, graph, &self.parameters, subject, &known.fold(), &mut dropped);
        let made = sum.and_then(or_zero).and_then(|sum| self.of_vectors(of, known, sum, form));
        let made = named.made(made)?;
        named.fits(&made.form.graph)?;
        Ok(made)
    }
}
