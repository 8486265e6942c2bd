//! Why a body has no deformation gradients.

use crate::assembly::AssemblyError;

/// Why a body has no correspondence energy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DeformationError {
    /// The body is empty, its neighbours cannot be found, or points have none.
    #[error(transparent)]
    Body(#[from] AssemblyError),
    /// The energy density has not the variables of a deformation gradient.
    #[error(
        "an energy density of {found} variables was given where psi(F) in {dimension} dimensions \
         has {}", dimension * dimension
    )]
    WrongLaw {
        /// How many variables it has.
        found: usize,
        /// Of the body.
        dimension: usize,
    },
    /// An influence function that is not finite somewhere.
    #[error("the influence function is {value} at a bond of length {length} m: it must be finite")]
    Influence {
        /// In m.
        length: f64,
        /// What it returned.
        value: f64,
    },
    /// More bonds than can be numbered.
    #[error("{bonds} bonds are too many: deformation gradients are limited to 2^31 bonds")]
    TooManyBonds {
        /// How many there are, each once.
        bonds: usize,
    },
    /// A point whose neighbours do not determine a deformation gradient.
    #[error(
        "the shape tensor of point {point} (counted from 0 in the order of the input) at {position:?} m \
         is singular: its condition number is {condition:.1e}, with {neighbors} neighbours for \
         {functions} functions, and {count} points have one above {limit:.0e}; enlarge the horizon, \
         use a lower order, or add points where the neighbours lie on a line or in a plane",
        limit = super::moments::MOST_CONDITION
    )]
    ShapeTensor {
        /// The worst, in the user's order.
        point: usize,
        /// Its position in m.
        position: Vec<f64>,
        /// How many neighbours it has.
        neighbors: usize,
        /// How many functions they must tell apart.
        functions: usize,
        /// Of lengths in horizons; infinite where the tensor is exactly singular.
        condition: f64,
        /// How many points have such a tensor.
        count: usize,
    },
    /// The weights of bonds around a point do not sum up to something positive.
    #[error(
        "the influence function sums up to {sum:e} around point {point} (counted from 0 in the order \
         of the input): {what} needs a positive sum"
    )]
    NoInfluence {
        /// In the user's order.
        point: usize,
        /// `sum_j V_j w_ij`.
        sum: f64,
        /// What needs it.
        what: &'static str,
    },
}
