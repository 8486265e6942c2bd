//! Which triangles count as collinear and which tetrahedra as coplanar.

use pulp::Simd;

use crate::body::Body;
use crate::geometry::Scalar;
use crate::geometry::lanes::Lanes;

/// The relative tolerance of `A <= tol*h^2` and `V <= tol*h^3`, with `h` the longest edge and
/// `tol = max(1e-8, 64u x_max/h)`: below it, rounding of the coordinates decides the measure.
///
/// A test for exact zeros lets collinear lattice points through with `A ~ 1e-15 h^2`, and an energy
/// over `A` then gives a few of them 5e11 times the energy of all others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Degeneracy {
    /// `(64u x_max)^2` in m^2.
    rounding_squared: f64,
}

/// Square of the relative tolerance near the origin.
const TOLERANCE_SQUARED: f64 = 1e-16;

impl Degeneracy {
    /// Takes `x_max` from the body: its largest coordinate in absolute value.
    pub fn new(body: &Body) -> Degeneracy {
        let largest = body.positions().iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
        let rounding = 64.0 * (f64::EPSILON / 2.0) * largest;
        Degeneracy { rounding_squared: rounding * rounding }
    }

    /// Whether a triangle of measure `sqrt(area_squared)` and longest edge `sqrt(edge_squared)` is
    /// collinear.
    #[inline(always)]
    pub fn is_collinear(&self, area_squared: f64, edge_squared: f64) -> bool {
        let scale = (TOLERANCE_SQUARED * edge_squared).max(self.rounding_squared);
        area_squared <= scale * edge_squared
    }

    /// Whether a tetrahedron of measure `sqrt(volume_squared)` and longest edge
    /// `sqrt(edge_squared)` is coplanar.
    #[inline(always)]
    pub fn is_coplanar(&self, volume_squared: f64, edge_squared: f64) -> bool {
        let scale = (TOLERANCE_SQUARED * edge_squared).max(self.rounding_squared);
        volume_squared <= scale * edge_squared * edge_squared
    }
}

impl Degeneracy {
    /// 1 where [`Degeneracy::is_coplanar`], else 0.
    #[inline(always)]
    pub fn coplanar<S: Simd>(&self, volume_squared: Lanes<S>, edge_squared: Lanes<S>) -> Lanes<S> {
        let relative = edge_squared.alike(TOLERANCE_SQUARED) * edge_squared;
        let scale = relative.max(edge_squared.alike(self.rounding_squared));
        let (zero, one) = (edge_squared.alike(0.0), edge_squared.alike(1.0));
        (scale * edge_squared * edge_squared).where_less(volume_squared, zero, one)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tolerance_grows_with_the_distance_from_the_origin() {
        let at = |x: f64| Degeneracy::new(&Body::new(2, &[x, 0.0, 0.0, -x], &[1.0; 2], None));
        let near = at(1.0);
        assert!(near.is_collinear(0.9e-16 * 16.0, 4.0) && !near.is_collinear(1.1e-16 * 16.0, 4.0));
        assert!(near.is_coplanar(0.9e-16 * 64.0, 4.0) && !near.is_coplanar(1.1e-16 * 64.0, 4.0));
        let far = at(1e8);
        let tolerance = 64.0 * 1.1102230246251565e-16 * 1e8 / 2.0;
        let area = |factor: f64| factor * tolerance * 4.0;
        assert!(far.is_collinear(area(0.99) * area(0.99), 4.0));
        assert!(!far.is_collinear(area(1.01) * area(1.01), 4.0));
        let volume = |factor: f64| factor * tolerance * 8.0;
        assert!(far.is_coplanar(volume(0.99) * volume(0.99), 4.0));
        assert!(!far.is_coplanar(volume(1.01) * volume(1.01), 4.0));
    }
}
