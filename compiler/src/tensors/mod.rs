//! Energies of the deformation gradient in tensors, as papers write them.
//!
//! Before: a syntax tree that was checked. After: psi as a graph of numbers over invariants, such as
//! `J` and `tr(C)`; `P = dpsi/dF` and its change `A : H` in a direction `H` as sums of products of
//! tensors with numbers in front. Everything else computes with components: this form is for readers.
//!
//! | module | what |
//! |---|---|
//! | `read` | from the text to numbers and tensors |
//! | `algebra` | sums, products, inverses, traces, determinants |
//! | `monomial` | numbers as sums of products of powers |
//! | `calculus` | derivatives by `F`, changes in a direction |

pub(crate) mod algebra;
mod calculus;
pub(crate) mod monomial;
mod read;
#[cfg(test)]
pub(crate) mod tests;

pub(crate) use algebra::{Algebra, Factor, Invariant, Tensor, Term};

use piola_grammar::Ast;

use crate::expression::{Input, NodeId, TooManyNodes};
use crate::model::Model;
use crate::values::Values;

/// Most nodes of the graph of numbers: what is longer is no formula for a reader.
const MAX_NODES: usize = 4000;

/// Why an energy is not written in tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotInTensors {
    /// `inv(I + tr(C)*C)`
    #[error("an inverse or a determinant is taken of a sum with a number that depends on `F`")]
    VaryingSum,
    /// `dyad(J, 0, 0)`
    #[error("a vector of `dyad` depends on `F`")]
    VaryingVector,
    /// A choice between tensors.
    #[error("an `if` chooses between tensors")]
    Choice,
    /// `table("data.csv", J)`
    #[error("it is read off a table")]
    Table,
    /// Something that only other kinds of energies have.
    #[error("the energy holds what is no function of `F`")]
    Foreign,
    /// More terms than anyone would read.
    #[error("it would have too many terms")]
    TooLong,
}

impl From<TooManyNodes> for NotInTensors {
    fn from(_: TooManyNodes) -> Self {
        NotInTensors::TooLong
    }
}

/// An energy of the deformation gradient with its derivatives, in tensors.
#[derive(Clone, Debug)]
pub struct TensorForm {
    pub(crate) algebra: Algebra,
    pub(crate) psi: NodeId,
    pub(crate) stress: Tensor,
    /// What the stress changes by where `F` changes by `H`.
    pub(crate) product: Tensor,
    /// Numbers that the text gives a name, in its order.
    pub(crate) named: Vec<(NodeId, String)>,
    /// What those that vary change by.
    pub(crate) rates: Vec<(NodeId, String)>,
}

impl Model {
    /// The energy of the deformation gradient in tensors, with parameters as symbols unless they have
    /// values; `ast` is the tree of which this model was made. Nothing where there is no such energy.
    ///
    /// # Errors
    /// An energy that cannot be written so, and why.
    pub fn in_tensors(
        &self,
        ast: &Ast,
        dimension: usize,
        values: Option<&Values>,
    ) -> Result<Option<TensorForm>, NotInTensors> {
        if !self.has_gradient_energy() {
            return Ok(None);
        }
        let fold = |input| match (values, input) {
            (Some(values), Input::Parameter(i)) => values.parameters.get(usize::from(i)).copied(),
            (Some(values), Input::Horizon) => Some(values.horizon),
            _ => None,
        };
        let read::Read { mut algebra, psi, named } = read::energy(ast, dimension, &fold)?;
        let mut kept: Vec<NodeId> = named.iter().map(|(node, _)| *node).collect();
        let stress = algebra.stress(psi)?;
        // What cancels in a factor is not differentiated.
        let stress = algebra.tidied(stress, &kept)?;
        kept.extend(stress.iter().map(|term| term.coefficient));
        let mut rates = Vec::new();
        for (node, name) in &named {
            if let Some(rate) = algebra.rate_of_number(*node)?
                && algebra.graph.graph().as_number(rate).is_none()
            {
                rates.push((rate, name.clone()));
                kept.push(rate);
            }
        }
        let product = algebra.rate(&stress)?;
        let product = algebra.tidied(product, &kept)?;
        if algebra.graph.graph().len() > MAX_NODES {
            return Err(NotInTensors::TooLong);
        }
        Ok(Some(TensorForm { algebra, psi, stress, product, named, rates }))
    }
}
