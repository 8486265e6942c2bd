//! What a pass over a body moves and computes at least, counted from its interactions.
//!
//! Bytes are those of the arrays that a pass cannot do without, each counted once for every energy of the
//! body that goes over it: positions, displacements and volumes of points, the number of each neighbour,
//! what families keep for each, forces, the blocks of the tangent. Multiply-adds are the products of the
//! geometry, with the addition that goes beside each: what the energy density takes only its compiler
//! knows. Neither is what was really moved or computed, and never more.

use piola_mechanics::energy::Energy;
use piola_mechanics::interaction::Report;
use piola_mechanics::kernel::Measure;
use serde::Serialize;

use super::forecast::{energies, layers};
use crate::case::{Case, Compiled};
use crate::plan::Families;

/// A pass over all interactions of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Pass {
    /// The energy alone.
    Energy,
    /// The energy and forces.
    Gradient,
    /// Energy, forces and the tangent, or where that is not stored what preconditions it.
    Tangent,
    /// A product with the tangent, where that is not stored.
    Product,
    /// Forces alone, as steps in time take them.
    Forces,
    /// Loads that depend on time.
    Loads,
    /// A step in time: forces, loads, velocities, displacements and the account of energy.
    Step,
    /// The same with a row of the account behind it: energies and momenta.
    Row,
}

impl Pass {
    /// Those of equilibria.
    pub const OF_EQUILIBRIA: [Pass; 4] =
        [Pass::Energy, Pass::Gradient, Pass::Tangent, Pass::Product];

    /// What JSON calls it.
    pub fn name(self) -> &'static str {
        match self {
            Pass::Energy => "energy",
            Pass::Gradient => "gradient",
            Pass::Tangent => "tangent",
            Pass::Product => "product",
            Pass::Forces => "forces",
            Pass::Loads => "loads",
            Pass::Step => "step",
            Pass::Row => "row",
        }
    }
}

/// What a pass moves and computes at least.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Work {
    pub(super) bytes: f64,
    pub(super) multiply_adds: f64,
}

/// The energies of a case.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Terms {
    /// How many sums over interactions there are.
    of_interactions: usize,
    /// How many energies of bonds, triangles and tetrahedra.
    energies: [usize; 3],
    families: Vec<Families>,
}

impl Terms {
    pub(super) fn of(case: &Case, compiled: &[Compiled]) -> Terms {
        Terms {
            of_interactions: layers(compiled, Compiled::has_interactions),
            energies: energies(compiled),
            families: case.families(compiled),
        }
    }

    /// Of one pass; `matrix_bytes` are those of the blocks that it fills.
    pub(super) fn work(
        &self,
        pass: Pass,
        energy: &dyn Energy,
        report: &Report,
        matrix_bytes: u64,
    ) -> Work {
        let (n, d) = (report.n_points as f64, energy.dimension());
        // Diagonal blocks aside, a block for each pair of neighbours.
        let pairs = energy.bonds().n_blocks() as f64 - n;
        let vector = 8.0 * n * d as f64;
        let (vectors, matrix) = match pass {
            Pass::Energy => (2.0, 0.0),
            Pass::Gradient => (3.0, 0.0),
            Pass::Tangent => (3.0, matrix_bytes as f64),
            Pass::Product => (4.0, 0.0),
            Pass::Forces => (3.0, 0.0),
            Pass::Loads => return Work { bytes: vector, multiply_adds: 0.0 },
            // Displacements and velocities with what rounding leaves behind are read and written.
            Pass::Step | Pass::Row => (3.0 + 10.0, 0.0),
        };
        let each = vectors * vector + 8.0 * n + 4.0 * pairs;
        let terms = (self.of_interactions + self.families.len()) as f64;
        let kept = self.families.iter().map(|families| kept(*families)).sum::<f64>() * pairs;
        let counts = [report.bonds, report.triangles, report.tetrahedra];
        let measures = [Measure::Length, Measure::Area, Measure::Volume];
        let of_interactions = counts.iter().zip(measures).zip(self.energies);
        let of_interactions = of_interactions.map(|((count, measure), energies)| {
            if energies == 0 {
                0.0
            } else {
                *count as f64 * energies as f64 * products(measure, d, pass)
            }
        });
        let of_families = self.families.iter().map(|families| gathered(*families, d, pass));
        let multiply_adds = of_interactions.sum::<f64>() + pairs * of_families.sum::<f64>();
        Work { bytes: terms * each + kept + matrix, multiply_adds }
    }
}

/// Bytes that families keep for each bond: coefficients at its ends, its length at rest.
fn kept(families: Families) -> f64 {
    match families {
        Families::States(_) => 8.0,
        Families::Vectors(..) => 0.0,
        _ => 16.0,
    }
}

/// Multiply-adds of an interaction: products, quotients and roots of [`piola_mechanics::geometry`] as it is
/// written, for the measure with its change; its gradient times psi'; its Hessian; and for products with
/// that, which hold as many numbers as the other corners have components, their square.
fn products(measure: Measure, dimension: usize, pass: Pass) -> f64 {
    let [measured, gradient, hessian] = match (measure, dimension) {
        (Measure::Length, 2) => [10, 2, 5],
        (Measure::Length, _) => [13, 3, 9],
        (Measure::Area, 2) => [11, 4, 14],
        (Measure::Area, _) => [37, 24, 72],
        (Measure::Volume, _) if pass == Pass::Product => [39, 27, 63],
        // Volumes share the normals of their bases, and are summed as moments of three numbers for forces
        // and six more for the tangent, on three pairs of corners.
        (Measure::Volume, _) => [16, 3 * 3, 3 * 6],
    };
    let unknowns = (measure.points() - 1) * dimension;
    let count = match pass {
        Pass::Loads => 0,
        Pass::Energy => measured,
        Pass::Gradient | Pass::Forces | Pass::Step | Pass::Row => measured + gradient,
        Pass::Tangent => measured + gradient + hessian,
        Pass::Product => measured + gradient + hessian + unknowns * unknowns,
    };
    count as f64
}

/// Multiply-adds of a bond of families: at both ends what is gathered, and with forces or a product what
/// goes back.
fn gathered(families: Families, dimension: usize, pass: Pass) -> f64 {
    let once = match families {
        Families::States(integrals) | Families::Vectors(integrals, _) => dimension + 2 * integrals,
        _ => 2 * dimension * dimension,
    };
    (if pass == Pass::Energy { once } else { 2 * once }) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_pass_takes_less_than_the_one_before() {
        let kinds = [
            (Measure::Length, 2),
            (Measure::Length, 3),
            (Measure::Area, 2),
            (Measure::Area, 3),
            (Measure::Volume, 3),
        ];
        for (measure, d) in kinds {
            let of = Pass::OF_EQUILIBRIA.map(|pass| products(measure, d, pass));
            assert!(of.is_sorted_by(|less, more| less < more), "{measure:?}: {of:?}");
        }
        for families in [Families::Nodal, Families::BondQuadrature, Families::States(2)] {
            let of = Pass::OF_EQUILIBRIA.map(|pass| gathered(families, 3, pass));
            assert!(of.is_sorted() && of[0] > 0.0, "{families:?}: {of:?}");
        }
    }
}
