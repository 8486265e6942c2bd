//! Energies of the deformation gradient, `psi(F)`.
//!
//! Before: a model with values. After: psi, the first Piola-Kirchhoff stress `P = dpsi/dF` and its
//! change `dP = d2psi/dF2 : dF`, each as machine code over arrays. There are two forms: one in `F`, as
//! written, and, where `max |F - I| < 0.25`, one in `H = F - I` that keeps its digits near rest.
//!
//! | module | what |
//! |---|---|
//! | `near` | an energy as a function of `H` |
//! | `adjoint` | derivatives by several variables |
//! | `principal` | functions of the right stretch tensor |
//! | `kernel` | both forms over arrays, and the choice between them |
//! | `domain` | declared bounds of `J` |
//! | `sample`, `truth` | gradients to try an energy at, and its values there to any precision |

pub(crate) mod adjoint;
mod domain;
mod kernel;
mod near;
mod principal;
pub(crate) mod sample;
pub(crate) mod truth;

pub use kernel::{GradientBatch, GradientKernel, NEAR, WrittenGradientEnergy, gradient_listing};

use adjoint::Varied;
pub(crate) use principal::axes;
use principal::{Open, StretchFunction};

use crate::expression::graph::{self, MAX_NODES};
use crate::expression::{ExprGraph, Input, Node, NodeId, TooManyNodes};
use crate::model::{Model, Variant};
use crate::simplify::Simplifier;
use crate::specialise::{CompileError, Dropped, Form, MAX_OPERATIONS, sum};
use crate::values::Values;

/// psi, P and dP in one graph. Components are in the order of [`graph::components`].
#[derive(Clone, Debug)]
pub struct GradientForm {
    /// Only what the roots need.
    pub graph: ExprGraph,
    /// The energy density.
    pub psi: NodeId,
    /// `dpsi/dF`, row by row.
    pub stress: Vec<NodeId>,
    /// `d2psi/dF2 : dF`, row by row.
    pub product: Vec<NodeId>,
    /// Whether principal stretches and axes are among its inputs.
    pub has_axes: bool,
}

/// An energy of the deformation gradient with values folded in.
#[derive(Clone, Debug)]
pub struct GradientEnergyForms {
    /// 2 or 3.
    pub dimension: usize,
    /// In `F`, as written.
    pub far: GradientForm,
    /// In `F - I`; none where textbook forms are asked for, or the energy is no number at rest.
    pub near: Option<GradientForm>,
}

impl GradientForm {
    /// 2 or 3.
    pub fn dimension(&self) -> usize {
        graph::dimension(self.stress.len())
    }

    fn new(
        graph: &Simplifier,
        psi: NodeId,
        dimension: usize,
        (functions, near): (&[StretchFunction], bool),
    ) -> Result<Self, TooManyNodes> {
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
        let n = components.len();
        let (graph, roots) = graph.graph().extract(&roots);
        let (stress, product) = (roots[1..=n].to_vec(), roots[n + 1..].to_vec());
        let is_of_axes = |(_, node)| matches!(node, Node::Input(input) if axes::is_one(input));
        let has_axes = graph.nodes().any(is_of_axes);
        Ok(GradientForm { graph, psi: roots[0], stress, product, has_axes })
    }
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
        let fold = |input| match input {
            Input::Parameter(i) => Some(values.parameters[usize::from(i)]),
            Input::Horizon => Some(values.horizon),
            _ => None,
        };
        self.gradient_forms(values.dimension, values.horizon.is_nan(), form, &fold)
    }

    /// The same with parameters left as symbols, as `derive` prints them.
    ///
    /// # Errors
    /// An energy that needs too many operations.
    pub fn symbolic_gradient(
        &self,
        dimension: usize,
    ) -> Result<Option<GradientEnergyForms>, CompileError> {
        Ok(self.gradient_forms(dimension, false, Form::Textbook, &|_| None)?.0)
    }

    fn gradient_forms(
        &self,
        dimension: usize,
        no_horizon: bool,
        form: Form,
        fold: &impl Fn(Input) -> Option<f64>,
    ) -> Result<(Option<GradientEnergyForms>, Vec<Dropped>), CompileError> {
        let variant = self.variant(dimension).ok_or(CompileError::WrongDimension(dimension))?;
        let roots: Vec<NodeId> = variant.gradient_energies.iter().map(|e| e.root).collect();
        let Some(first) = variant.gradient_energies.first() else { return Ok((None, Vec::new())) };
        let (argument, span) = ("F", first.span);
        let all: Vec<NodeId> = roots.iter().chain(&variant.traces).copied().collect();
        if no_horizon && variant.graph.depends_on(&all, Input::Horizon) {
            return Err(CompileError::NoHorizon { argument: argument.to_string(), span });
        }
        let too_large =
            |limit| CompileError::TooLarge { argument: argument.to_string(), span, limit };
        let mut dropped = Vec::new();
        let variables = graph::components(dimension);
        let forms = sum(&variant.graph, &self.parameters, ("F", &roots), fold, &mut dropped)
            .and_then(|energy| {
                let Some((mut graph, psi)) = energy else { return Ok(None) };
                let functions = self.stretch_functions(variant, (graph.graph(), psi), fold)?;
                let at_rest: Vec<_> = functions.iter().map(|f| f.at_rest.as_ref()).collect();
                let near = match form {
                    Form::Accurate => near::near(&mut graph, psi, &variables, &at_rest)?,
                    Form::Textbook => None,
                };
                let far = GradientForm::new(&graph, psi, dimension, (&functions, false))?;
                let near = near
                    .map(|near| GradientForm::new(&graph, near, dimension, (&functions, true)))
                    .transpose()?;
                Ok(Some(GradientEnergyForms { dimension, far, near }))
            })
            .map_err(|TooManyNodes| too_large(MAX_NODES))?;
        if let Some(forms) = &forms {
            let largest = |form: &GradientForm| form.graph.len() > MAX_OPERATIONS;
            if largest(&forms.far) || forms.near.as_ref().is_some_and(largest) {
                return Err(too_large(MAX_OPERATIONS));
            }
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
            let made = sum(&variant.graph, &self.parameters, ("F", roots), fold, &mut Vec::new())?;
            let (graph, root) = match made {
                Some(made) => made,
                None => {
                    let mut graph = Simplifier::new();
                    let zero = graph.number(0.0)?;
                    (graph, zero)
                }
            };
            StretchFunction::new(graph, root)
        };
        variant.traces.iter().enumerate().map(function).collect()
    }
}

#[cfg(test)]
mod tests;
