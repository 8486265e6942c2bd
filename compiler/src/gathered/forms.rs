//! What a potential gathers and what depends on it before it is compiled: for those who print it.

use piola_grammar::Span;

use super::vectors::{Made, Which};
use super::{Subject, argument};
use crate::density::DensityForm;
use crate::expression::{Input, NodeId};
use crate::measure::Measure;
use crate::model::{Break, Integral, Model, OfFamily, Update, Variant};
use crate::specialise::{
    CompileError, Dropped, Form, Known, Named, ScalarEnergy, of_measure, symbolic_of,
};
use crate::values::Values;

/// What points gather, and all functions of it.
#[derive(Clone, Debug, Default)]
pub struct GatheredForms {
    /// What is gathered, by number: `integral(w*L^2)`; a component of a tensor that heads name, `H(1, 1)`.
    pub gathered: Vec<String>,
    /// The integrands with two derivatives by the length; nothing where vectors are gathered, whose integrands
    /// are among the functions.
    pub integrands: Vec<ScalarEnergy>,
    /// Energies, conditions under which bonds break, what is remembered next.
    pub functions: Vec<GatheredFunction>,
    /// Terms that parameters make zero.
    pub dropped: Vec<Dropped>,
}

/// A function of what is gathered.
#[derive(Clone, Debug)]
pub struct GatheredFunction {
    /// What it is.
    pub kind: GatheredFunctionKind,
    /// An energy's head, `l, m`; a condition or a next value as written.
    pub text: String,
    /// Its value in the place of psi, with its derivatives.
    pub form: DensityForm,
    /// What it is differentiated by, in the order of the gradient.
    pub variables: Vec<Input>,
    /// What it takes beside them and beside parameters.
    pub given: Vec<Input>,
}

/// What a [`GatheredFunction`] says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GatheredFunctionKind {
    /// `sum_k A_k f_k` of the integrands `f_k` of vectors, with the multipliers `A_k` among its variables.
    Integrands,
    /// The same of the functions of integrals.
    Functions,
    /// The energy of points in J/m^3, or that of bonds in J/m^(2d), of vectors in J/m^(d+3).
    Energy {
        /// Whether it is that of bonds.
        of_bonds: bool,
    },
    /// The margin of the condition of this number, from 1: bonds break where it is above 0, or also at 0.
    Margin {
        /// Which condition.
        number: usize,
        /// Whether they break at 0, too.
        holds_at_zero: bool,
    },
    /// What the state of this name becomes.
    Next(String),
}

impl Model {
    /// What points gather and what depends on it, as it is compiled for these values; with parameters as symbols,
    /// and as written, where there are none.
    ///
    /// # Errors
    /// As for [`Model::compile`].
    pub fn gathered_forms(
        &self,
        dimension: usize,
        values: Option<&Values>,
    ) -> Result<GatheredForms, CompileError> {
        let variant = self.variant(dimension).ok_or(CompileError::WrongDimension(dimension))?;
        let mut found = GatheredForms::default();
        if variant.gathered_energies.is_empty() {
            return Ok(found);
        }
        let gathered = |one: &Integral| match one.is_function {
            true => one.text.clone(),
            false => format!("integral({})", one.text),
        };
        found.gathered = variant.integrals.iter().map(gathered).collect();
        match self.gathers_vectors() {
            true => self.forms_of_vectors(variant, values, &mut found)?,
            false => self.forms_of_numbers(variant, values, &mut found)?,
        }
        Ok(found)
    }

    /// How many terms of energies of gathered values these values make zero.
    pub(crate) fn dropped_of_gathered(&self, values: &Values) -> Result<usize, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let known = Known(Some(values));
        let dropped = |of_bonds: bool| match self.gathers_vectors() {
            true => {
                let which = if of_bonds { Which::Bonds } else { Which::Points };
                Ok(self.function_of_vectors((variant, which), known, Form::Textbook)?.1.len())
            }
            false => {
                let of = (variant, of_bonds);
                Ok(self.energies_of_gathered(of, known, Form::Textbook)?.1.len())
            }
        };
        Ok(dropped(false)? + dropped(true)?)
    }

    fn forms_of_vectors(
        &self,
        variant: &Variant,
        values: Option<&Values>,
        found: &mut GatheredForms,
    ) -> Result<(), CompileError> {
        let all = [
            (Which::Integrands, GatheredFunctionKind::Integrands),
            (Which::Functions, GatheredFunctionKind::Functions),
            (Which::Points, GatheredFunctionKind::Energy { of_bonds: false }),
            (Which::Bonds, GatheredFunctionKind::Energy { of_bonds: true }),
        ];
        for (which, kind) in all {
            let (made, dropped) =
                self.function_of_vectors((variant, which), Known(values), form(values))?;
            found.dropped.extend(dropped);
            let Some(made) = made else { continue };
            let text = match kind {
                GatheredFunctionKind::Energy { of_bonds } => argument(variant, of_bonds),
                _ => String::new(),
            };
            found.functions.push(function_of_vectors(kind, &text, made));
        }
        let first = first_of_gathered(variant);
        for (k, one) in self.conditions_of_vectors(variant).enumerate() {
            let of = (variant, one.of == OfFamily::Bonds);
            let place = (one.root, one.span);
            let made = self.margin_or_next_of_vectors(of, place, Known(values), form(values))?;
            let (number, holds_at_zero) = (first + k, one.holds_at_zero);
            let kind = GatheredFunctionKind::Margin { number, holds_at_zero };
            found.functions.push(function_of_vectors(kind, &one.text, made));
        }
        let in_time = self.in_time(values);
        for one in self.updates_of_vectors(variant) {
            let (place, known) = ((one.root, one.span), Known(in_time.as_ref()));
            let of = (variant, false);
            let made = self.margin_or_next_of_vectors(of, place, known, form(values))?;
            let kind = GatheredFunctionKind::Next(self.input_name(one.state).to_string());
            found.functions.push(function_of_vectors(kind, &one.text, made));
        }
        Ok(())
    }

    /// The values with the time step behind the states, where families remember by it.
    fn in_time(&self, values: Option<&Values>) -> Option<Values> {
        match self.families_remember_time() {
            true => values.map(|own| own.clone().following_states(self)),
            false => values.cloned(),
        }
    }

    fn forms_of_numbers(
        &self,
        variant: &Variant,
        values: Option<&Values>,
        found: &mut GatheredForms,
    ) -> Result<(), CompileError> {
        for one in &variant.integrals {
            let named = Named { argument: "l", span: one.span };
            named.has_horizon(&variant.graph, &[one.root], Known(values).lacks_horizon())?;
            let subject = (Measure::Length, one.root);
            let (graph, parameters) = (&variant.graph, &self.parameters);
            let made = match values {
                Some(values) => of_measure(graph, parameters, subject, values, Form::Accurate),
                None => symbolic_of(graph, parameters, subject),
            };
            found.integrands.push(named.made(made)?);
        }
        for of_bonds in [false, true] {
            let (made, dropped) =
                self.energies_of_gathered((variant, of_bonds), Known(values), form(values))?;
            found.dropped.extend(dropped);
            let Some(form) = made else { continue };
            let (kind, text) =
                (GatheredFunctionKind::Energy { of_bonds }, argument(variant, of_bonds));
            found.functions.push(function((variant, of_bonds), (kind, text), form));
        }
        let first = first_of_gathered(variant);
        let gathered = variant.family_breaks.iter().filter(|one| one.of != OfFamily::Gradient);
        for (k, Break { of, root, holds_at_zero, span, text, .. }) in gathered.enumerate() {
            let (number, holds_at_zero) = (first + k, *holds_at_zero);
            let kind = GatheredFunctionKind::Margin { number, holds_at_zero };
            let of = (variant, *of == OfFamily::Bonds);
            let form = self.margin_or_next(of, (*root, *span), Known(values), form(values))?;
            found.functions.push(function(of, (kind, text.clone()), form));
        }
        let in_time = self.in_time(values);
        let gathered = variant.family_updates.iter().filter(|one| one.of != OfFamily::Gradient);
        for Update { state, root, span, text, .. } in gathered {
            let kind = GatheredFunctionKind::Next(self.input_name(*state).to_string());
            let of = (variant, false);
            let known = Known(in_time.as_ref());
            let form = self.margin_or_next(of, (*root, *span), known, form(values))?;
            found.functions.push(function(of, (kind, text.clone()), form));
        }
        Ok(())
    }

    /// A function that is kept also where parameters leave nothing of it.
    pub(crate) fn margin_or_next(
        &self,
        (variant, of_bonds): (&Variant, bool),
        (root, span): (NodeId, Span),
        known: Known<'_>,
        which: Form,
    ) -> Result<DensityForm, CompileError> {
        let named = Named { argument: if of_bonds { "l" } else { "integral" }, span };
        let subject = Subject { variant, of_bonds, roots: &[root], is_kept: true };
        let (made, _) = self.gathered_form(subject, named, known, which)?;
        made.ok_or(CompileError::WrongDimension(variant.dimension))
    }
}

/// The number of the first condition of gathered values: those of gradients come first, as
/// `Model::gradient_functions` numbers them.
fn first_of_gathered(variant: &Variant) -> usize {
    let gradients = variant.family_breaks.iter().filter(|one| one.of == OfFamily::Gradient);
    variant.breaks.len() + gradients.count() + 1
}

/// As it is compiled, or as it is written.
fn form(values: Option<&Values>) -> Form {
    if values.is_some() { Form::Accurate } else { Form::Textbook }
}

/// A function of what points gather of vectors, and of bonds or not.
fn function_of_vectors(kind: GatheredFunctionKind, text: &str, made: Made) -> GatheredFunction {
    let [variables, given] = [made.variables, made.given]
        .map(|slots| slots.into_iter().map(|slot| slot.input()).collect());
    GatheredFunction { kind, text: text.to_string(), form: made.form, variables, given }
}

/// A function of numbers that points gather, and of lengths or not.
fn function(
    (variant, of_bonds): (&Variant, bool),
    (kind, text): (GatheredFunctionKind, String),
    form: DensityForm,
) -> GatheredFunction {
    let length = Measure::Length;
    let integrals = (0..variant.integrals.len() as u8).map(Input::Integral);
    let own = of_bonds.then_some(Input::Current(length)).into_iter();
    let given = [Input::Reference(length), Input::Change(length)];
    let given = given.into_iter().filter(|_| of_bonds).collect();
    GatheredFunction { kind, text, form, variables: own.chain(integrals).collect(), given }
}
