//! What energies of deformation gradients and of gathered states cost.
//!
//! Their tangent reaches two or three horizons. It is not stored unless the scene says so: products
//! visit the bonds, and springs like the tangent precondition them.

use super::{
    FACTOR_FLOPS_PER_SECOND, FactorEstimate, InteractionCount, LU_WORK, LinearMethod, TimeEstimate,
    speed,
};
use crate::energy::Products;
use crate::scene::{DiscretisationChoice, LinearChoice, Scene};
use crate::solve::linear::OPERATIONS_PER_BLOCK;

/// Iterations of conjugate gradients to 1e-10 with the factor of the springs: 16 to 52 for bars.
const FACTOR_ITERATIONS: f64 = 35.0;

/// The same with two levels of them.
const TWO_LEVEL_ITERATIONS: f64 = 65.0;

/// Finding one bond with its weights, in s.
const BOND_SETUP_SECONDS: f64 = 400e-9;

/// What points know of their families.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Families {
    /// A deformation gradient.
    Nodal,
    /// A deformation gradient, and what neighbours deviate from it.
    Stabilised,
    /// A deformation gradient, and one at each bond.
    BondQuadrature,
    /// So many integrals.
    States(usize),
}

impl From<DiscretisationChoice> for Families {
    fn from(choice: DiscretisationChoice) -> Families {
        match choice {
            DiscretisationChoice::Nodal => Families::Nodal,
            DiscretisationChoice::Stabilised => Families::Stabilised,
            DiscretisationChoice::BondQuadrature => Families::BondQuadrature,
        }
    }
}

/// The method and its reason where the tangent is not stored.
pub(super) fn method(families: Option<Families>, scene: &Scene) -> Option<(LinearMethod, String)> {
    let exact = scene.solver.products == Products::Exact;
    let (method, reason) = match (families?, scene.solver.linear) {
        (_, LinearChoice::Auto) if exact => {
            (LinearMethod::MatrixFree, "the tangent reaches further than the bonds")
        }
        (_, LinearChoice::MatrixFree) => (LinearMethod::MatrixFree, "the scene says so"),
        (_, LinearChoice::Gmres) => (LinearMethod::MatrixFreeGmres, "the scene says so"),
        _ => return None,
    };
    Some((method, reason.to_string()))
}

/// Whether springs like the tangent are factorised.
pub(super) fn is_factorised(factor: FactorEstimate, blocks: f64) -> bool {
    factor.flops <= OPERATIONS_PER_BLOCK * blocks
}

impl Families {
    /// Over how many bonds the tangent couples points.
    pub(super) fn reach(self) -> usize {
        if self == Families::BondQuadrature { 3 } else { 2 }
    }

    /// Forces and one product with the tangent, in s per bond on one core: measured on 20^3 points.
    fn seconds(self) -> [f64; 2] {
        match self {
            Families::Nodal => [29e-9, 37e-9],
            Families::Stabilised => [47e-9, 49e-9],
            Families::BondQuadrature => [106e-9, 119e-9],
            Families::States(integrals) => {
                [80e-9 + 60e-9 * integrals as f64, 200e-9 + 120e-9 * integrals as f64]
            }
        }
    }

    /// What is kept for families, in bytes.
    pub(super) fn memory(self, n: usize, d: usize, bonds: f64) -> Vec<(&'static str, f64)> {
        let directed = 2.0 * bonds;
        let tensor = (8 * n * d * d) as f64;
        let gradients = ("deformation gradients", directed * (8 * d + 4) as f64 + 4.0 * tensor);
        match self {
            Families::Nodal => vec![gradients],
            Families::Stabilised => vec![gradients, ("stabilisation", 8.0 * bonds + tensor)],
            Families::BondQuadrature => vec![gradients, ("bond quadrature", 8.0 * bonds)],
            Families::States(integrals) => {
                let kept = (4 + 3 * 8) as f64 * directed + (8 * 6 * n * (1 + integrals)) as f64;
                vec![("gathered states", kept)]
            }
        }
    }

    pub(super) fn time(
        self,
        interactions: &InteractionCount,
        blocks: f64,
        linear: LinearMethod,
        factor: FactorEstimate,
        threads: usize,
    ) -> TimeEstimate {
        let bonds = interactions.bonds as f64;
        let [forces, product] = self.seconds().map(|seconds| seconds * bonds / speed(threads));
        let factorisation = factor.flops / FACTOR_FLOPS_PER_SECOND;
        // The stored tangent is worked out entry by entry, over all that two points share.
        let stored = forces + blocks * product / bonds.max(1.0);
        let (assembly, linear) = match linear {
            method if method.is_matrix_free() && is_factorised(factor, blocks) => {
                (forces, factorisation + FACTOR_ITERATIONS * product)
            }
            LinearMethod::MatrixFree | LinearMethod::MatrixFreeGmres => {
                (forces, TWO_LEVEL_ITERATIONS * product)
            }
            LinearMethod::Cg | LinearMethod::Gmres => (stored, TWO_LEVEL_ITERATIONS * product),
            LinearMethod::Cholesky => (stored, factorisation),
            LinearMethod::Lu => (stored, LU_WORK * factorisation),
        };
        TimeEstimate { setup: bonds * BOND_SETUP_SECONDS, assembly, linear, total: 0.0 }
    }
}
