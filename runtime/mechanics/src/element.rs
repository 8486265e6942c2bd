//! Elements: what turns the shape of an interaction into energy, forces and stiffness.
//!
//! An [`Element`] takes a batch of interactions of one kind and returns weighted energies with
//! their compact derivatives (see [`crate::geometry`]). [`MeasureElement`] differentiates the energy in its
//! measure and the measure by hand-written geometry; [`CoupledElement`] does so for several measures of one
//! interaction; [`CoordinateElement`] differentiates the whole energy in the coordinates with hyper-dual
//! numbers, as in firooz2023. A [`SumElement`] is two of them.

mod batch;
mod coordinate;
mod coupled;
mod measure;
mod sum;
mod vector;

pub(crate) use batch::WIDEST;
pub use batch::{CAPACITY, Channel, Contributions, InteractionBatch};
pub use coordinate::{CoordinateElement, CoordinateEnergy};
pub use coupled::CoupledElement;
pub use measure::MeasureElement;
pub(crate) use measure::THIN;
pub use sum::SumElement;
pub use vector::VectorElement;

use pulp::Arch;

pub use crate::kernel::Order;
use crate::kernel::{Law, Measure};

/// The first interaction of a batch whose energy or derivatives are not finite, or that is turned
/// inside out where the energy forbids it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonFiniteLane {
    /// Its place in the batch.
    pub lane: usize,
    /// Current value of its measure.
    pub value: f64,
    /// Reference value of its measure.
    pub reference: f64,
}

/// Whether an energy density is not finite at collapse or beyond, from its values at `m/M = 0` and
/// at `m/M = -1`. An energy may be finite beyond a collapse that is infinitely dear, as `M/m` is.
fn breaks_down(mut psi: impl FnMut(f64) -> f64) -> bool {
    !(psi(0.0).is_finite() && psi(-1.0).is_finite())
}

/// Energy and compact derivatives of a batch of interactions.
pub trait Element: Send + Sync {
    /// The kind of interaction.
    fn measure(&self) -> Measure;

    /// What its energy is a function of, as written in `psi(..)`.
    fn argument(&self) -> &str {
        self.measure().symbol()
    }

    /// 2 or 3.
    fn dimension(&self) -> usize;

    /// Whether the energy of a signed measure keeps it positive: interactions that have turned
    /// inside out are refused, and no step may turn one.
    fn forbids_inversion(&self) -> bool;

    /// The law of the measure and the registers to use, if the element is nothing but that law on the
    /// geometry of the measure: an assembly may then sum over the geometry in its own way.
    fn law(&self) -> Option<(&dyn Law, Arch)> {
        None
    }

    /// How many fields it takes of every interaction: see [`InteractionBatch::fields`].
    fn n_fields(&self) -> usize {
        0
    }

    /// Whether it is nothing but a law whose force is affine in the measure, or in its square; `by_direction` says
    /// that its fields are the direction of bonds at rest, and nothing else.
    fn has_affine_law(&self, by_direction: bool) -> bool {
        let is_affine = |law: &dyn Law| {
            let is_known = law.fields().is_empty() || by_direction || law.is_multiple_of_field();
            law.is_affine() && is_known
        };
        self.law().is_some_and(|(law, _)| is_affine(law) || law.squared().is_some_and(is_affine))
    }

    /// The smallest measure that is not refused.
    fn least(&self) -> f64 {
        if self.forbids_inversion() { f64::MIN_POSITIVE } else { f64::NEG_INFINITY }
    }

    /// Makes the work arrays of a pass, if it has any, for all threads: before the pass begins.
    fn provide(&self) {}

    /// Fills `out` for the interactions of the batch: weight times energy, and for the orders that
    /// ask for it weight times gradient and Hessian.
    ///
    /// An energy or derivative that was asked for and is not finite is an error, and so is an
    /// interaction turned inside out where [`Element::forbids_inversion`].
    fn evaluate(
        &self,
        batch: &InteractionBatch,
        order: Order,
        out: &mut Contributions,
    ) -> Result<(), NonFiniteLane>;
}
