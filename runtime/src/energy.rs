//! The discrete total energy as the solvers see it.

mod positions;

pub use positions::FromPositions;

use std::sync::Arc;

use crate::kernel::Measure;
use crate::matrix::{BlockMatrix, BlockPattern};

/// Total energy by kind of interaction, in J (per metre of thickness in two dimensions).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EnergyParts {
    /// One-neighbour interactions, `psi(l)`.
    pub bonds: f64,
    /// Two-neighbour interactions, `psi(a)`.
    pub triangles: f64,
    /// Three-neighbour interactions, `psi(v)`.
    pub tetrahedra: f64,
}

impl EnergyParts {
    /// The total energy.
    pub fn total(&self) -> f64 {
        self.bonds + self.triangles + self.tetrahedra
    }
}

/// An interaction whose energy or derivatives are not finite numbers, or that is turned inside out
/// where its energy forbids that.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}", self.message())]
pub struct NonFinite {
    /// Which measure.
    pub measure: Measure,
    /// Its points in the body's order: 2, 3 or 4.
    pub points: Vec<usize>,
    /// Their displacements in m, one after the other.
    pub displacements: Vec<f64>,
    /// Current value of the measure.
    pub value: f64,
    /// Reference value of the measure.
    pub reference: f64,
    /// Whether it is turned inside out where its energy forbids that.
    pub inverted: bool,
}

impl NonFinite {
    fn message(&self) -> String {
        let what = if self.inverted { "turned inside out" } else { "not finite" };
        format!(
            "the energy of the {} of points {:?} is {what}: measure {:e}, reference {:e}",
            self.measure.interaction(),
            self.points,
            self.value,
            self.reference
        )
    }
}

/// An interaction on its way to be turned inside out.
#[derive(Clone, Debug, PartialEq)]
pub struct Inversion {
    /// The part of the way, between 0 and 1, up to which no interaction is turned.
    pub part: f64,
    /// The interaction that is turned first, where it has collapsed.
    pub first: NonFinite,
}

/// `E(u)`, its gradient and its Hessian; all are exact derivatives of one energy.
///
/// Displacements `u` are `n x d` row by row, in m, in the body's order.
pub trait TotalEnergy: Sync {
    /// 2 or 3.
    fn dimension(&self) -> usize;

    /// Positions at rest, `n x d`, in m.
    fn positions(&self) -> &[f64];

    /// Where the Hessian has blocks.
    fn pattern(&self) -> &Arc<BlockPattern>;

    /// The energy alone.
    fn energy(&self, u: &[f64]) -> Result<EnergyParts, NonFinite>;

    /// The energy; `gradient` (`n x d`) becomes `dE/du` in N.
    fn gradient(&self, u: &[f64], gradient: &mut [f64]) -> Result<EnergyParts, NonFinite>;

    /// The energy; `gradient` becomes `dE/du` in N and `tangent` becomes `d2E/du2` in N/m.
    fn tangent(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        tangent: &mut BlockMatrix,
    ) -> Result<EnergyParts, NonFinite>;

    /// The energy; `gradient` becomes `dE/du` in N and `diagonal` (`n x d x d`) the diagonal blocks of
    /// `d2E/du2` in N/m, row by row.
    fn tangent_diagonal(
        &self,
        u: &[f64],
        gradient: &mut [f64],
        diagonal: &mut [f64],
    ) -> Result<EnergyParts, NonFinite>;

    /// `product` becomes `d2E/du2 p` in N, for `p` in m: the Hessian is never stored.
    fn tangent_product(&self, u: &[f64], p: &[f64], product: &mut [f64]) -> Result<(), NonFinite>;

    /// What is turned inside out first on the straight way from `u` to `u + step`, among the
    /// interactions whose energies forbid it.
    fn first_inversion(&self, _u: &[f64], _step: &[f64]) -> Option<Inversion> {
        None
    }
}
