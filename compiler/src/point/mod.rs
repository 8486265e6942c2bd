//! Energies of the deformation gradient, `psi(F)`.
//!
//! Before: a model with values. After: psi, the first Piola-Kirchhoff stress `P = dpsi/dF` and its
//! change `dP = d2psi/dF2 : dF`, each as machine code over arrays. There are two forms: one in `F`, as
//! written, and, where `max |F - I| < 0.25`, one in `H = F - I` that keeps its digits near rest; of
//! functions that are steep there, less far.
//!
//! | module | what |
//! |---|---|
//! | `invariants` | sums and products that are invariants or cofactors, in the form that keeps their digits; `modular` tells them |
//! | `near` | an energy as a function of `H` |
//! | `reach` | how far from rest that serves |
//! | `adjoint` | derivatives by several variables |
//! | `principal` | functions of the right stretch tensor |
//! | `kernel` | both forms over arrays, and the choice between them |
//! | `turned` | bodies that are turned further than they are strained, turned back |
//! | `functions` | conditions of `F` under which bonds break, and what is remembered next |
//! | `domain` | declared bounds of `J`, and of other quantities of `F` |
//! | `sample`, `truth` | gradients to try an energy at, and its values there to any precision |

pub(crate) mod adjoint;
mod domain;
mod functions;
mod invariants;
mod kernel;
mod modular;
pub(crate) mod near;
mod principal;
mod reach;
mod roundings;
pub(crate) mod sample;
pub(crate) mod truth;
mod turned;

pub use functions::{GradientCriterion, GradientFunction, GradientFunctionKind, GradientNextState};
pub use invariants::INVARIANTS;
pub use kernel::{GradientBatch, GradientKernel, NEAR, WrittenGradientEnergy, gradient_listing};
pub(crate) use principal::witness::Principal;

use adjoint::Varied;
pub(crate) use principal::axes;
use principal::{Open, StretchFunction};
use roundings::without_powers_of_roundings;

use piola_grammar::Span;

use crate::density::DensityForm;
use crate::expression::graph;
use crate::expression::{ExprGraph, Input, Node, NodeId, TooManyNodes};
use crate::model::{Model, Variant};
use crate::simplify::{Rule, Simplifier};
use crate::specialise::{CompileError, Dropped, Form, Named, folded, known, or_zero, sum_in};
use crate::values::Values;

/// Most components of a tensor.
const MOST: usize = 9;

/// An energy of the deformation gradient with values folded in: psi, the stress P as its gradient, dP as
/// its product, in the order of [`graph::components`].
#[derive(Clone, Debug)]
pub struct GradientEnergyForms {
    /// 2 or 3.
    pub dimension: usize,
    /// In `F`, as written.
    pub far: DensityForm,
    /// In `F - I`; none where textbook forms are asked for, or the energy is no number at rest.
    pub near: Option<DensityForm>,
    /// Below this `max |F - I|` it is evaluated: [`NEAR`], or less for functions that are steep at rest.
    pub reach: f64,
    /// Whether there are roots, or other powers, of what is 0 at rest in the form near it.
    pub has_roots: bool,
    /// The invariants that were recognised.
    pub recognised: Vec<&'static Rule>,
}

impl GradientEnergyForms {
    /// Whether the form near rest is evaluated where `F - I` is this, row by row.
    pub(crate) fn is_near(&self, change: &[f64]) -> bool {
        self.near.is_some() && change.iter().all(|h| h.abs() < self.reach)
    }
}

/// Functions of the deformation gradient that are added up.
struct Subject<'a> {
    variant: &'a Variant,
    roots: Vec<NodeId>,
    /// Where the first of them is written.
    span: Span,
    /// Whether there is one also where parameters leave nothing of it: 0.
    is_kept: bool,
}

impl<'a> Subject<'a> {
    /// A function that is no energy.
    fn of_function(variant: &'a Variant, root: NodeId, span: Span) -> Subject<'a> {
        Subject { variant, roots: vec![root], span, is_kept: true }
    }
}

/// The energies of a variant, if there are any.
fn of_energies(variant: &Variant) -> Option<Subject<'_>> {
    let span = variant.gradient_energies.first()?.span;
    let roots = variant.gradient_energies.iter().map(|e| e.root).collect();
    Some(Subject { variant, roots, span, is_kept: false })
}

/// psi, P and dP in one graph, far from rest or near it.
fn form(
    graph: &Simplifier,
    psi: NodeId,
    dimension: usize,
    (functions, near): (&[StretchFunction], bool),
    fields: &[u16],
) -> Result<DensityForm, TooManyNodes> {
    // A graph of its own: derivatives of one form are no part of the other.
    let mut graph = graph.clone();
    let components = graph::components(dimension);
    let varied = Varied::ComponentsAndTraces(&components, functions.len());
    let first = adjoint::gradient(&mut graph, psi, varied)?;
    let second = adjoint::product(&mut graph, &first, varied)?;
    let (graph, roots) = if !functions.is_empty() {
        let open = Open { psi, first, second };
        principal::closed(graph.graph(), &open, functions, (dimension, near))?
    } else {
        let roots = [psi].into_iter().chain(first).chain(second);
        (graph, roots.collect())
    };
    let (graph, roots) = graph.graph().extract(&roots);
    let is_of_axes = |(_, node)| matches!(node, Node::Input(input) if axes::is_one(input));
    let has_axes = graph.nodes().any(is_of_axes);
    let all = |input: fn(u8) -> Input| components.iter().copied().map(input);
    let axes = axes::inputs(dimension).filter(|_| has_axes);
    let inputs =
        all(Input::Variable).chain(all(Input::VariableChange)).chain(all(Input::Direction));
    Ok(DensityForm::new(graph, &roots, inputs.chain(axes).collect(), fields))
}

impl Model {
    /// The energy of the deformation gradient for these values, if there is one and something is left
    /// of it; and what is left out.
    ///
    /// # Errors
    /// As for [`Model::specialise`].
    pub fn specialise_gradient(
        &self,
        values: &Values,
        form: Form,
    ) -> Result<(Option<GradientEnergyForms>, Vec<Dropped>), CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let Some(subject) = of_energies(variant) else { return Ok((None, Vec::new())) };
        self.forms_of(subject, values, form)
    }

    /// The sum of some functions of the deformation gradient for these values.
    fn forms_of(
        &self,
        subject: Subject<'_>,
        values: &Values,
        form: Form,
    ) -> Result<(Option<GradientEnergyForms>, Vec<Dropped>), CompileError> {
        let lacks_horizon = values.horizon.is_nan();
        let written = WrittenGradientEnergy::new(subject.variant, &subject.roots, values);
        let fields = (&values.fields[..], lacks_horizon);
        let (mut forms, dropped) = self.gradient_forms(subject, fields, form, &known(values))?;
        if let Some(forms) = &mut forms {
            forms.reach = reach::reach(forms, &written, values)?;
        }
        Ok((forms, dropped))
    }

    /// The same with parameters left as symbols, as `derive` prints them.
    ///
    /// # Errors
    /// An energy that needs too many operations.
    pub fn symbolic_gradient(
        &self,
        dimension: usize,
    ) -> Result<Option<GradientEnergyForms>, CompileError> {
        let variant = self.variant(dimension).ok_or(CompileError::WrongDimension(dimension))?;
        let Some(subject) = of_energies(variant) else { return Ok(None) };
        Ok(self.gradient_forms(subject, (&[], false), Form::Textbook, &|_| None)?.0)
    }

    fn gradient_forms(
        &self,
        Subject { variant, roots, span, is_kept }: Subject<'_>,
        (fields, no_horizon): (&[u16], bool),
        which: Form,
        fold: &impl Fn(Input) -> Option<f64>,
    ) -> Result<(Option<GradientEnergyForms>, Vec<Dropped>), CompileError> {
        let dimension = variant.dimension;
        let named = Named { argument: "F", span };
        let all: Vec<NodeId> = roots.iter().chain(&variant.traces).copied().collect();
        named.has_horizon(&variant.graph, &all, no_horizon)?;
        let mut dropped = Vec::new();
        let variables = graph::components(dimension);
        let exact = Simplifier::exact();
        let subject = ("F", roots.as_slice());
        let forms = sum_in(exact, &variant.graph, &self.parameters, subject, fold, &mut dropped)
            .and_then(|energy| {
                let energy = if is_kept { Some(or_zero(energy)?) } else { energy };
                let Some((mut exact, mut written)) = energy else { return Ok(None) };
                let mut recognised = Vec::new();
                if which == Form::Accurate {
                    (exact, written, recognised) =
                        invariants::recognised(exact, written, dimension)?;
                }
                let (mut graph, place) = folded(exact.graph(), &[written])?;
                let psi = place[written.0 as usize];
                let functions = self.stretch_functions(variant, (graph.graph(), psi), fold)?;
                let at_rest: Vec<_> = functions.iter().map(|f| f.at_rest.as_ref()).collect();
                let mut has_roots = false;
                let near = match which {
                    Form::Accurate => {
                        let is_field = |input| matches!(input, Input::Parameter(_));
                        let subject = (&exact, written);
                        near::with_fields(&mut graph, subject, is_field, |graph, source, root| {
                            let near = near::near(graph, source, root, &variables, &at_rest)?;
                            has_roots |= near.is_some_and(|(_, are_there)| are_there);
                            Ok(near.map(|(near, _)| near))
                        })?
                    }
                    Form::Textbook => None,
                };
                let far = match which {
                    Form::Accurate => without_powers_of_roundings(&mut graph, psi)?,
                    Form::Textbook => psi,
                };
                let mut far = form(&graph, far, dimension, (&functions, false), fields)?;
                let mut near = near
                    .map(|near| form(&graph, near, dimension, (&functions, true), fields))
                    .transpose()?;
                // Both take fields where one does.
                let takes = |one: &DensityForm| one.n_fields() > 0;
                let some_takes = takes(&far) || near.as_ref().is_some_and(takes);
                for one in [Some(&mut far), near.as_mut()].into_iter().flatten() {
                    if some_takes && one.n_fields() == 0 {
                        *one = one.clone().with_fields(fields);
                    }
                }
                Ok(Some(GradientEnergyForms {
                    dimension,
                    far,
                    near,
                    reach: NEAR,
                    has_roots,
                    recognised,
                }))
            });
        let forms = named.made(forms)?;
        if let Some(forms) = &forms {
            named.fits(&forms.far.graph)?;
            forms.near.as_ref().map_or(Ok(()), |near| named.fits(&near.graph))?;
        }
        Ok((forms, dropped))
    }
}

impl Model {
    /// The functions of `U` whose traces the energies may hold, with values folded in; 0 where the
    /// energy `psi` of these values holds none.
    fn stretch_functions(
        &self,
        variant: &Variant,
        (graph, psi): (&ExprGraph, NodeId),
        fold: &impl Fn(Input) -> Option<f64>,
    ) -> Result<Vec<StretchFunction>, TooManyNodes> {
        let function = |(k, root): (usize, &NodeId)| {
            let held = graph.depends_on(&[psi], Input::Trace(k as u8)).then_some(*root);
            let roots = held.as_slice();
            let (exact, subject) = (Simplifier::exact(), ("F", roots));
            let parameters = &self.parameters;
            let made = sum_in(exact, &variant.graph, parameters, subject, fold, &mut Vec::new())?;
            let (graph, root) = or_zero(made)?;
            StretchFunction::new(&graph, root)
        };
        variant.traces.iter().enumerate().map(function).collect()
    }
}

#[cfg(test)]
mod tests;
