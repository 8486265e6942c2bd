//! Gmsh's numbers of types of elements.

use crate::kind::{Kind, Shape};

/// Of first and second order.
pub(super) fn kind(number: i64) -> Option<Kind> {
    let (shape, nodes) = match number {
        1 => (Shape::Line, 2),
        2 => (Shape::Triangle, 3),
        3 => (Shape::Quadrilateral, 4),
        4 => (Shape::Tetrahedron, 4),
        5 => (Shape::Hexahedron, 8),
        6 => (Shape::Wedge, 6),
        7 => (Shape::Pyramid, 5),
        8 => (Shape::Line, 3),
        9 => (Shape::Triangle, 6),
        10 => (Shape::Quadrilateral, 9),
        11 => (Shape::Tetrahedron, 10),
        12 => (Shape::Hexahedron, 27),
        13 => (Shape::Wedge, 18),
        14 => (Shape::Pyramid, 14),
        15 => (Shape::Point, 1),
        16 => (Shape::Quadrilateral, 8),
        17 => (Shape::Hexahedron, 20),
        18 => (Shape::Wedge, 15),
        19 => (Shape::Pyramid, 13),
        _ => return None,
    };
    Some(Kind::new(shape, nodes))
}
