//! Numbers of interactions.

use std::ops::Range;

use crate::neighborhood::Neighborhood;

/// What a body consists of. Kinds of interaction that are not modelled count 0. Of a slab of a body interactions count
/// whose owner does.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Points.
    pub n_points: usize,
    /// One-neighbour interactions.
    pub bonds: u64,
    /// Two-neighbour interactions.
    pub triangles: u64,
    /// Three-neighbour interactions.
    pub tetrahedra: u64,
    /// Collinear triples of points left out.
    pub dropped_triangles: u64,
    /// Coplanar quadruples of points left out.
    pub dropped_tetrahedra: u64,
    /// Pairs of points as far apart as the horizon to within 1e-6 of it.
    pub shell_bonds: usize,
    /// Blocks of the tangent on and above the diagonal, where it couples bonded points only.
    pub pattern_blocks: usize,
    /// How passes go over the body: interactions in `batches`, points with their `families`, and along
    /// the `rows` of a lattice what can go there; several ways of several energies.
    pub ways: Vec<&'static str>,
}

impl Report {
    /// Of a body with energies of families.
    pub(crate) fn of_families(neighborhood: &Neighborhood, counted: Range<usize>) -> Report {
        Report {
            n_points: neighborhood.n_points(),
            bonds: neighborhood.n_bonds_of(counted) as u64,
            shell_bonds: neighborhood.shell_bonds(),
            ways: vec!["families"],
            ..Report::default()
        }
    }

    /// What two energies of one body see of it together: they share their interactions.
    pub fn and(self, other: Report) -> Report {
        let mut ways = self.ways;
        ways.extend(other.ways);
        ways.sort_unstable();
        ways.dedup();
        Report {
            n_points: self.n_points.max(other.n_points),
            bonds: self.bonds.max(other.bonds),
            triangles: self.triangles.max(other.triangles),
            tetrahedra: self.tetrahedra.max(other.tetrahedra),
            dropped_triangles: self.dropped_triangles.max(other.dropped_triangles),
            dropped_tetrahedra: self.dropped_tetrahedra.max(other.dropped_tetrahedra),
            shell_bonds: self.shell_bonds.max(other.shell_bonds),
            pattern_blocks: self.pattern_blocks.max(other.pattern_blocks),
            ways,
        }
    }
}

/// Numbers of interactions turned inside out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Inverted {
    /// Triangles with `a < 0`; in the plane only.
    pub triangles: u64,
    /// Tetrahedra with `v < 0`.
    pub tetrahedra: u64,
}

impl Inverted {
    /// Those that two energies of one body see together.
    pub fn and(self, other: Inverted) -> Inverted {
        Inverted {
            triangles: self.triangles.max(other.triangles),
            tetrahedra: self.tetrahedra.max(other.tetrahedra),
        }
    }
}
