//! The discrete total energy as the solvers see it.

mod differences;
mod positions;

pub use differences::FiniteDifferences;
pub use positions::FromPositions;

use std::sync::Arc;

use crate::kernel::Measure;
use crate::matrix::{BlockMatrix, BlockPattern};

/// Total energy by kind of interaction, in J (per metre of thickness in two dimensions).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EnergyParts {
    /// One-neighbour interactions, `psi(l)`, also with gathered values, `psi(l, theta)`.
    pub bonds: f64,
    /// Two-neighbour interactions, `psi(a)`.
    pub triangles: f64,
    /// Three-neighbour interactions, `psi(v)`.
    pub tetrahedra: f64,
    /// Deformation gradients at points or, with bond quadrature, at bonds, `psi(F)`; gathered values at
    /// points, `psi(theta)`.
    pub deformation: f64,
    /// What the neighbours' displacements deviate from a point's deformation gradient, where that
    /// is stabilised.
    pub stabilisation: f64,
}

impl EnergyParts {
    /// The total energy.
    pub fn total(&self) -> f64 {
        self.values().iter().fold(0.0, |sum, part| sum + part)
    }

    /// The sum of the absolute values: the scale of the rounding error of the total.
    pub fn magnitude(&self) -> f64 {
        self.values().iter().fold(0.0, |sum, part| sum + part.abs())
    }

    fn values(&self) -> [f64; 5] {
        [self.bonds, self.triangles, self.tetrahedra, self.deformation, self.stabilisation]
    }
}

/// How products with the Hessian come about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Products {
    /// By the derivatives of the energy.
    #[default]
    Exact,
    /// By one-sided differences of forces, `(R(u + e v) - R(u))/e`.
    OneSided,
    /// By central differences of forces, `(R(u + e v) - R(u - e v))/(2 e)`: partmann2026 (3.73).
    Central,
}

impl Products {
    /// Their relative error for displacements that differ from point to point, to an order of
    /// magnitude; of smooth ones, where most of a product cancels, it is larger.
    pub fn error(self) -> f64 {
        let step = self.balanced(f64::EPSILON / 2.0);
        match self {
            Products::Exact => 0.0,
            Products::OneSided => step,
            Products::Central => step * step,
        }
    }

    /// The step, relative to what forces change over, by which rounding errors of this size over
    /// the step are the same as the errors of the order.
    pub(crate) fn balanced(self, rounding: f64) -> f64 {
        match self {
            Products::Exact => 0.0,
            Products::OneSided => rounding.sqrt(),
            Products::Central => libm::cbrt(rounding),
        }
    }
}

/// What an energy density depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Argument {
    /// The measure of an interaction.
    Measure(Measure),
    /// The deformation gradient at a point or at a bond.
    DeformationGradient,
    /// What is gathered over the family of a point.
    Gathered,
}

/// An interaction or a deformation gradient whose energy or derivatives are not finite numbers, or
/// that is turned inside out where its energy forbids that.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}", self.message())]
pub struct NonFinite {
    /// What the energy depends on.
    pub argument: Argument,
    /// Its points in the body's order: 2, 3 or 4 of an interaction, the point or the two ends of the
    /// bond of a deformation gradient, the point that gathers.
    pub points: Vec<usize>,
    /// Their displacements in m, one after the other.
    pub displacements: Vec<f64>,
    /// Current value of the measure; the determinant of a deformation gradient; the first
    /// integral of a point.
    pub value: f64,
    /// Reference value of the measure; 1 otherwise.
    pub reference: f64,
    /// Whether it is turned inside out where its energy forbids that.
    pub inverted: bool,
}

impl NonFinite {
    fn message(&self) -> String {
        let what = if self.inverted { "turned inside out" } else { "not finite" };
        let (points, value) = (&self.points, self.value);
        match (self.argument, &points[..]) {
            (Argument::Measure(measure), _) => format!(
                "the energy of the {} of points {points:?} is {what}: measure {value:e}, reference {:e}",
                measure.interaction(),
                self.reference
            ),
            (Argument::Gathered, _) => {
                format!("the energy of what is gathered around point {points:?} is {what}")
            }
            (Argument::DeformationGradient, [point]) => format!(
                "the energy of the deformation gradient at point {point} is {what}: determinant {value:e}"
            ),
            (Argument::DeformationGradient, _) => format!(
                "the energy of the deformation gradient at the bond of points {points:?} is {what}: \
                 determinant {value:e}"
            ),
        }
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

/// The Hessian of an energy at the displacements that it was made for, never stored as a matrix.
pub trait Hessian: Sync {
    /// `product` becomes `d2E/du2 p` in N (`n x d`), for `p` in m; NaN where second derivatives are not
    /// finite.
    fn multiply(&self, p: &[f64], product: &mut [f64]);
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

    /// Where [`TotalEnergy::bond_tangent`] has blocks, if there is one: for energies whose Hessian
    /// reaches so much further than their bonds that it is rather not stored.
    fn bond_pattern(&self) -> Option<&Arc<BlockPattern>> {
        None
    }

    /// Fills `tangent` with a positive semi-definite matrix like the Hessian at `u`, in N/m, that
    /// couples bonded points only: products with the Hessian are preconditioned by it.
    fn bond_tangent(&self, _u: &[f64], _tangent: &mut BlockMatrix) {}

    /// How products of [`TotalEnergy::hessian`] come about. Where they are not exact, they are all that
    /// solvers take of the Hessian, but for what they precondition by.
    fn products(&self) -> Products {
        Products::Exact
    }

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

    /// `d2E/du2` at `u`, for products: what they share is worked out now.
    fn hessian(&self, u: &[f64]) -> Result<Box<dyn Hessian + '_>, NonFinite>;

    /// What is turned inside out first on the straight way from `u` to `u + step`, among the
    /// interactions whose energies forbid it.
    fn first_inversion(&self, _u: &[f64], _step: &[f64]) -> Option<Inversion> {
        None
    }
}
