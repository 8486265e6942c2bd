//! Why a body gathers no vectors.

use crate::assembly::AssemblyError;

/// Why a body has no energy of what its points gather of vectors.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VectorError {
    /// The body is empty, its neighbours cannot be found, or points have none.
    #[error(transparent)]
    Body(#[from] AssemblyError),
    /// The neighbours of a point do not span space, and its law has functions of integrals, among which inverses
    /// of shape tensors are.
    #[error(
        "the {neighbors} neighbours of point {point} (counted from 0 in the order of the input) at {position:?} m \
         do not span space, and functions of what it gathers, inverses of shape tensors for one, have no value \
         there: enlarge the horizon, or add points where the neighbours lie on a line or in a plane"
    )]
    Flat {
        /// In the user's order.
        point: usize,
        /// Its position in m.
        position: Vec<f64>,
        /// How many neighbours it has.
        neighbors: usize,
    },
    /// More bonds than can be numbered.
    #[error("{bonds} bonds are too many: gathered vectors are limited to 2^31 bonds")]
    TooManyBonds {
        /// How many there are, each once.
        bonds: usize,
    },
}
