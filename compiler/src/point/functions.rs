//! Functions of the deformation gradient that are no energies, compiled: conditions under which bonds break, and
//! what is remembered next. They are made by the same code as energies and keep their digits near rest.

use super::kernel::{GradientKernel, WrittenGradientEnergy};
use super::{GradientEnergyForms, Subject};
use crate::breaking::{FamilyCriterion, FamilyNextState};
use crate::kernel::Mode;
use crate::measure::Argument;
use crate::model::{Break, Model, Of, OfFamily, Update, Variant};
use crate::specialise::{CompileError, Form};
use crate::values::Values;
use crate::verify;
use crate::verify::families::a_second_later;

/// When bonds break by a deformation gradient: their own, or that of a point at one of their ends.
pub type GradientCriterion = FamilyCriterion<GradientKernel, WrittenGradientEnergy>;

/// What a state becomes at a deformation gradient.
pub type GradientNextState = FamilyNextState<GradientKernel, WrittenGradientEnergy>;

/// A function of the deformation gradient that is no energy, for those who print it.
#[derive(Clone, Debug)]
pub struct GradientFunction {
    /// What it is.
    pub kind: GradientFunctionKind,
    /// As written, in canonical spelling.
    pub text: String,
    /// The margin, or the next value, in the place of psi.
    pub forms: GradientEnergyForms,
}

/// What a [`GradientFunction`] says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GradientFunctionKind {
    /// The margin of a condition: bonds break where it is above 0.
    Margin {
        /// Which of the conditions of the potential it is, from 1: those of measures come first.
        number: usize,
        /// Whether bonds break where it is 0, too.
        holds_at_zero: bool,
    },
    /// What the state of this name becomes.
    Next(String),
}

/// The conditions of a variant's deformation gradients.
fn breaks_of_gradients(variant: &Variant) -> impl Iterator<Item = &Break<OfFamily>> {
    variant.family_breaks.iter().filter(|one| one.of == OfFamily::Gradient)
}

/// What their states become.
fn updates_of_gradients(variant: &Variant) -> impl Iterator<Item = &Update<OfFamily>> {
    variant.family_updates.iter().filter(|one| one.of == OfFamily::Gradient)
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
            let subject = Subject::of_function(variant, one.root, one.span);
            let (margin, written) = self.gradient_function(subject, values, mode, form)?;
            Ok(GradientCriterion::new(one, margin, written))
        };
        breaks_of_gradients(variant).map(criterion).collect()
    }

    /// What states of deformation gradients become, for these values with states among the fields
    /// ([`Values::with_states`]), and with the time step where an update depends on it. All of them are worked
    /// out from the states as they are, then they change at once.
    ///
    /// # Errors
    /// A next value that is too large, or the horizon where none is given.
    pub fn gradient_next_states(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Vec<GradientNextState>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let next = |one: &Update<OfFamily>| {
            let subject = Subject::of_function(variant, one.root, one.span);
            let (next, written) = self.gradient_function(subject, values, mode, form)?;
            Ok(GradientNextState::new(one, values, next, written))
        };
        updates_of_gradients(variant).map(next).collect()
    }

    pub(super) fn gradient_function(
        &self,
        subject: Subject<'_>,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<(GradientKernel, WrittenGradientEnergy), CompileError> {
        let written = WrittenGradientEnergy::new(subject.variant, &subject.roots, values);
        let nothing = CompileError::WrongDimension(values.dimension);
        let (forms, _) = self.forms_of(subject, values, form)?;
        let kernel = GradientKernel::of(forms.ok_or(nothing)?, values, mode, || written.clone())?;
        Ok((kernel, written))
    }

    /// Conditions of the deformation gradient, then what its states become, as they are compiled for these
    /// values; with symbols for parameters where there are none.
    ///
    /// # Errors
    /// As [`Model::gradient_criteria`].
    pub fn gradient_functions(
        &self,
        dimension: usize,
        values: Option<&Values>,
    ) -> Result<Vec<GradientFunction>, CompileError> {
        let values = values.map(|own| own.clone().with_states(self));
        let in_time = match self.families_remember_time() {
            true => values.clone().map(|own| own.following_states(self)),
            false => values.clone(),
        };
        self.functions_of_gradients(dimension, [values, in_time], Form::Accurate)
    }

    /// The same with everything held but the deformation gradient, states as the values say and the time step
    /// 1 s, each with what it is.
    pub(crate) fn gradient_functions_held(
        &self,
        values: &Values,
        form: Form,
    ) -> Result<Vec<(verify::Subject, GradientEnergyForms)>, CompileError> {
        let held = values.without_fields();
        let later = a_second_later(self, &held);
        let all = self.functions_of_gradients(values.dimension, [Some(held), Some(later)], form)?;
        let named = |GradientFunction { kind, text, forms }: GradientFunction| {
            let subject = match kind {
                GradientFunctionKind::Margin { .. } => {
                    verify::Subject::Margin(Some(Argument::Gradient), text)
                }
                GradientFunctionKind::Next(name) => {
                    let of = Of::Family(OfFamily::Gradient);
                    verify::Subject::NextState(of, format!("{name} = {text}"))
                }
            };
            (subject, forms)
        };
        Ok(all.into_iter().map(named).collect())
    }

    /// Conditions for the first values, then next states for the second.
    fn functions_of_gradients(
        &self,
        dimension: usize,
        [values, in_time]: [Option<Values>; 2],
        form: Form,
    ) -> Result<Vec<GradientFunction>, CompileError> {
        let variant = self.variant(dimension).ok_or(CompileError::WrongDimension(dimension))?;
        let forms = |root, span, values: Option<&Values>| {
            let subject = Subject::of_function(variant, root, span);
            let (forms, _) = match values {
                Some(values) => self.forms_of(subject, values, form)?,
                None => self.gradient_forms(subject, (&[], false), Form::Textbook, &|_| None)?,
            };
            forms.ok_or(CompileError::WrongDimension(dimension))
        };
        let margin = |(k, one): (usize, &Break<OfFamily>)| {
            let (number, holds_at_zero) = (variant.breaks.len() + k + 1, one.holds_at_zero);
            let kind = GradientFunctionKind::Margin { number, holds_at_zero };
            let forms = forms(one.root, one.span, values.as_ref())?;
            Ok(GradientFunction { kind, text: one.text.clone(), forms })
        };
        let next = |one: &Update<OfFamily>| {
            let kind = GradientFunctionKind::Next(self.input_name(one.state).to_string());
            let forms = forms(one.root, one.span, in_time.as_ref())?;
            Ok(GradientFunction { kind, text: one.text.clone(), forms })
        };
        let margins = breaks_of_gradients(variant).enumerate().map(margin);
        margins.chain(updates_of_gradients(variant).map(next)).collect()
    }
}
