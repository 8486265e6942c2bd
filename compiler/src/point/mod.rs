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
//! | `kernel` | both forms over arrays, and the choice between them |
//! | `domain` | declared bounds of `J` |
//! | `sample`, `truth` | gradients to try an energy at, and its values there to any precision |
//! | `verify` | against the interpreter, hyper-dual numbers and numbers of any precision |

pub(crate) mod adjoint;
mod domain;
mod kernel;
mod near;
pub(crate) mod sample;
pub(crate) mod truth;
mod verify;

pub use kernel::{GradientBatch, GradientKernel, NEAR, WrittenGradientEnergy, gradient_listing};
pub use verify::{BAR_FAR, BAR_NEAR, GradientVerification, verify_gradient};

use adjoint::Varied;

use crate::expression::graph::{self, MAX_NODES};
use crate::expression::{ExprGraph, Input, NodeId, TooManyNodes};
use crate::model::Model;
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
    fn new(graph: &Simplifier, psi: NodeId, variables: &[u8]) -> Result<Self, TooManyNodes> {
        // A graph of its own: derivatives of one form are no part of the other.
        let mut graph = graph.clone();
        let varied = Varied::Components(variables);
        let stress = adjoint::gradient(&mut graph, psi, varied)?;
        let product = adjoint::product(&mut graph, &stress, varied)?;
        let roots: Vec<NodeId> =
            [psi].into_iter().chain(stress.iter().copied()).chain(product).collect();
        let n = stress.len();
        let (graph, roots) = graph.graph().extract(&roots);
        let (stress, product) = (roots[1..=n].to_vec(), roots[n + 1..].to_vec());
        Ok(GradientForm { graph, psi: roots[0], stress, product })
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
        if no_horizon && variant.graph.depends_on(&roots, Input::Horizon) {
            return Err(CompileError::NoHorizon { argument, span });
        }
        let too_large = |limit| CompileError::TooLarge { argument, span, limit };
        let mut dropped = Vec::new();
        let variables = graph::components(dimension);
        let forms = sum(&variant.graph, &self.parameters, ("F", &roots), fold, &mut dropped)
            .and_then(|energy| {
                let Some((mut graph, psi)) = energy else { return Ok(None) };
                let near = match form {
                    Form::Accurate => near::near(&mut graph, psi, &variables)?,
                    Form::Textbook => None,
                };
                let far = GradientForm::new(&graph, psi, &variables)?;
                let near = near.map(|near| GradientForm::new(&graph, near, &variables));
                let near = near.transpose()?;
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

#[cfg(test)]
mod tests;
