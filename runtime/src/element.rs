//! Elements: what turns the shape of an interaction into energy, forces and stiffness.
//!
//! An [`Element`] takes a batch of interactions of one kind and returns weighted energies with
//! their compact derivatives (see [`crate::geometry`]). There are two: [`MeasureElement`]
//! differentiates the energy in its measure and the measure by hand-written geometry;
//! [`CoordinateElement`] differentiates the whole energy in the coordinates with hyper-dual
//! numbers, as in firooz2023.

mod batch;
mod coordinate;
mod measure;

pub use batch::{CAPACITY, Channel, Contributions, InteractionBatch, STRIDE};
pub use coordinate::{CoordinateElement, CoordinateEnergy};
pub use measure::MeasureElement;

use crate::kernel::Measure;

/// How many derivatives are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Order {
    /// The energy.
    Energy,
    /// And the gradient.
    Gradient,
    /// And the Hessian.
    Tangent,
}

/// The first interaction of a batch whose energy or derivatives are not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonFiniteLane {
    /// Its place in the batch.
    pub lane: usize,
    /// Current value of its measure.
    pub value: f64,
    /// Reference value of its measure.
    pub reference: f64,
}

/// Energy and compact derivatives of a batch of interactions.
pub trait Element: Send + Sync {
    /// The kind of interaction.
    fn measure(&self) -> Measure;

    /// 2 or 3.
    fn dimension(&self) -> usize;

    /// Fills `out` for the interactions of the batch: weight times energy, and for the orders that
    /// ask for it weight times gradient and Hessian.
    ///
    /// An energy or derivative that was asked for and is not finite is an error.
    fn evaluate(
        &self,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane>;
}
