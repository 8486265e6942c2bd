//! What energies of deformation gradients and of gathered states cost.
//!
//! Their tangent reaches two or three horizons. Products visit the bonds, and springs like the tangent
//! precondition them; where they are too many, or the scene says so, the tangent is stored.

use piola_mechanics::deformation::Discretisation;
use piola_solvers::linear::{Choice, LinearMethod, OPERATIONS_PER_BLOCK};

use super::time::{LU_WORK, Passes};
use super::{Extent, FactorEstimate, MemoryItem, Pace, TimeEstimate};

/// Iterations of conjugate gradients to 1e-10 with the factor of the springs: 16 to 52 for bars.
const FACTOR_ITERATIONS: f64 = 35.0;

/// The same with two levels of them.
const TWO_LEVEL_ITERATIONS: f64 = 65.0;

/// Finding one bond with its weights, in s.
const BOND_SETUP_SECONDS: f64 = 400e-9;

/// Solving with the factor of the springs, in s per number of it: once forward and once back.
const SOLVE_SECONDS: f64 = 1.2e-9;

/// What bonds cost, in s per bond on one core: measured on 40^2 points and 9^3 to 10^3, with horizons of two
/// and three spacings, neo-Hookean and of one to three integrals.
struct Seconds {
    forces: f64,
    /// What is worked out once for all products at the same displacements, springs among it.
    once: f64,
    /// One product with the tangent.
    product: f64,
    /// A stored tangent, for each pair of bonds of a family that couples points: a half of the square of its
    /// bonds.
    stored: f64,
}

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
    /// So many numbers of vectors; with what neighbours gather or without.
    Vectors(usize, bool),
}

impl From<Discretisation> for Families {
    fn from(choice: Discretisation) -> Families {
        match choice {
            Discretisation::Nodal => Families::Nodal,
            Discretisation::Stabilised(_) => Families::Stabilised,
            Discretisation::BondQuadrature => Families::BondQuadrature,
        }
    }
}

/// Whether springs like the tangent are factorised.
pub(super) fn is_factorised(factor: FactorEstimate, blocks: f64) -> bool {
    factor.flops <= OPERATIONS_PER_BLOCK * blocks
}

impl Families {
    /// Over how many bonds the tangent couples points.
    pub(super) fn reach(self) -> usize {
        match self {
            Families::BondQuadrature | Families::Vectors(_, true) => 3,
            _ => 2,
        }
    }

    fn seconds(self, dimension: usize) -> Seconds {
        let tensor = (dimension * dimension) as f64;
        let of_gradients = |forces: f64, product: f64, stored: f64| Seconds {
            forces,
            once: 14e-9 * tensor,
            product,
            stored: stored * tensor,
        };
        match self {
            Families::Nodal => of_gradients(22e-9, 22e-9, 3.4e-9),
            Families::Stabilised => of_gradients(45e-9, 45e-9, 12e-9),
            Families::BondQuadrature => of_gradients(85e-9, 14e-9 * tensor, 32e-9),
            Families::Vectors(numbers, has_neighbours) => {
                // Of eleven numbers in the plane and 24 in space, with energies of points alone, of bonds too,
                // and of what neighbours gather.
                let m = numbers as f64;
                let forces = (37e-9 + 4.3e-9 * m) * if has_neighbours { 2.2 } else { 1.6 };
                let stored = if has_neighbours { 2.2e-9 * m * m } else { 11e-9 * m };
                Seconds { forces, once: forces, product: 1.25 * forces, stored }
            }
            Families::States(integrals) => {
                let m = integrals as f64;
                Seconds {
                    forces: 32e-9 + 13e-9 * m,
                    once: 40e-9 + 40e-9 * m,
                    product: 2e-9 + 6e-9 * m,
                    stored: 10e-9 + 10e-9 * m,
                }
            }
        }
    }

    /// What is kept for families, in bytes.
    pub(super) fn memory(self, n: usize, d: usize, bonds: f64) -> Vec<(&'static str, f64)> {
        let directed = 2.0 * bonds;
        let tensor = (8 * n * d * d) as f64;
        // Of first order coefficients take a tensor, and so does the stress times them.
        let gradients = ("deformation gradients", 8.0 * directed + 6.5 * tensor);
        match self {
            Families::Nodal => vec![gradients],
            Families::Stabilised => vec![gradients, ("stabilisation", 8.0 * bonds + tensor)],
            Families::BondQuadrature => vec![gradients, ("bond quadrature", 8.0 * bonds)],
            // Passes keep nothing of bonds.
            Families::Vectors(numbers, _) => {
                vec![("gathered vectors", 8.0 * (4 * n * (numbers + 1)) as f64)]
            }
            Families::States(integrals) => {
                // Numbers per bond at the peak, while second derivatives are worked out: of one to
                // three integrals in two and three dimensions measured to 3 %.
                let numbers = d * (16 + 12 * integrals);
                let points = n * (d + (3 + integrals) * (2 + integrals));
                vec![("gathered states", 8.0 * (numbers as f64 * bonds + points as f64))]
            }
        }
    }
}

/// Over how many bonds the tangent of several energies couples points: 1 of interactions alone.
pub(crate) fn reach(all: &[Families]) -> usize {
    all.iter().map(|families| families.reach()).max().unwrap_or(1)
}

/// What terms of a sum need beside the sum: their patterns, and the blocks of one of them at a time. `bytes`
/// are those of blocks and of columns of a matrix that reaches so many bonds.
pub(super) fn terms(
    of_interactions: usize,
    families: &[Families],
    linear: &Choice,
    bytes: impl Fn(usize) -> (f64, f64),
) -> Option<MemoryItem> {
    // Springs reach as far as bonds.
    let reach = |families: &Families| if linear.stores_matrix { families.reach() } else { 1 };
    let mut reaches: Vec<usize> = families.iter().map(reach).collect();
    reaches.extend(std::iter::repeat_n(1, of_interactions));
    reaches.sort_unstable();
    // The one that reaches furthest fills the sum itself.
    reaches.pop();
    let largest = *reaches.last()?;
    let has_matrix = linear.stores_matrix || !families.is_empty();
    let blocks = if has_matrix { bytes(largest).0 } else { 0.0 };
    let columns: f64 = reaches.into_iter().map(|reach| bytes(reach).1).sum();
    Some(MemoryItem { item: "terms of the sum", bytes: (blocks + columns) as u64 })
}

/// Of energies of families, with the passes over interactions beside.
pub(super) fn time(
    all: &[Families],
    extent: &Extent,
    (bonds, passes): (f64, Passes),
    (blocks, factor): (f64, FactorEstimate),
    linear: &Choice,
    pace: Pace,
) -> TimeEstimate {
    let sum = |of: fn(&Seconds) -> f64| {
        all.iter().map(|families| of(&families.seconds(extent.dimension))).sum::<f64>()
    };
    let whole = |seconds: f64| seconds * bonds / pace.speed();
    let forces = whole(sum(|per_bond| per_bond.forces)) + passes.assembly() / pace.speed();
    let product = whole(sum(|per_bond| per_bond.product)) + passes.product() / pace.speed();
    let once = forces + whole(sum(|per_bond| per_bond.once));
    let factorisation = pace.factorisation(factor, extent.dimension);
    // A point has twice as many bonds as there are for each.
    let pairs_per_bond = 2.0 * bonds / extent.points.max(1) as f64;
    let stored = forces + whole(sum(|per_bond| per_bond.stored)) * pairs_per_bond;
    let (assembly, linear) = match linear.method {
        _ if !linear.stores_matrix && is_factorised(factor, blocks) => {
            let iteration = product + SOLVE_SECONDS * factor.entries;
            (once, factorisation + FACTOR_ITERATIONS * iteration)
        }
        _ if !linear.stores_matrix => (once, TWO_LEVEL_ITERATIONS * product),
        LinearMethod::Cholesky => (stored, factorisation),
        LinearMethod::Lu => (stored, LU_WORK * factorisation),
        _ => (stored, TWO_LEVEL_ITERATIONS * product),
    };
    TimeEstimate::per_iteration(bonds * BOND_SETUP_SECONDS, assembly, linear)
}
