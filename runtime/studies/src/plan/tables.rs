//! What triangles and tetrahedra need that go along the rows of a lattice.

use super::{Extent, InteractionCount, MemoryItem};

/// A triangle in a table, a tetrahedron, and what a bond of points abreast takes, in bytes.
const TABLED_TRIANGLE: u64 = 64;
const TABLED_TETRAHEDRON: u64 = 8;
const TABLED_BOND: u64 = 4;

/// Tables of triangles and tetrahedra that go along the rows of a lattice: those of one point once for forces and
/// three times for tangents; for tangents of triangles all bonds of points abreast.
pub(super) fn tables(
    extent: &Extent,
    interactions: &InteractionCount,
    [_, triangles, tetrahedra]: [bool; 3],
) -> Option<MemoryItem> {
    let of_a_point = |n: u64, bytes: u64| 4 * bytes * n / extent.points.max(1) as u64;
    let mut bytes = 0;
    if triangles && interactions.triangles > 0 {
        bytes += of_a_point(interactions.triangles, TABLED_TRIANGLE);
        bytes += TABLED_BOND * interactions.bonds;
    }
    if tetrahedra {
        bytes += of_a_point(interactions.tetrahedra, TABLED_TETRAHEDRON);
    }
    (bytes > 0).then_some(MemoryItem { item: "tables of cliques", bytes })
}
