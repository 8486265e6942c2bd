//! The speed of Rayleigh waves of the discrete body: what cracks are compared with.

use super::inside::Inside;
use super::{Affine, Stiffness};
use crate::case::Case;

/// Halvings of the bracket: to the last bit.
const HALVINGS: usize = 200;

/// The speed in m/s of long Rayleigh waves along axis `along` of a free surface whose normal is axis `normal`,
/// of each material of a case in turn as if the body were of it alone; nothing where its density is not known
/// or its moduli are none of a stable body. Cracks of the body are taken for closed.
///
/// The moduli are those that [`super::moduli`] reads off the lattice, of an orthotropic body with the axes of the
/// scene. In three dimensions waves are in plane strain, also in thin plates. In two dimensions the moduli are
/// those of the plane, so that waves are in plane strain or plane stress as the body is.
pub fn rayleigh_speeds(case: &Case, along: usize, normal: usize) -> Vec<Option<f64>> {
    let of_material = |case: Case| {
        let density = case.scene.material().density?.value;
        let mut case = case.without_fields();
        case.scene.cracks.clear();
        let affine = Affine::with(&case, &Inside::new(&case)).ok()?;
        let squared = surface_stiffness(&Stiffness::new(&affine), along, normal)? / density;
        Some(squared.sqrt())
    };
    case.of_each_material().into_iter().map(|(_, case)| of_material(case)).collect()
}

/// Density times the square of the speed of Rayleigh waves, in Pa: the root of
/// `(c66 - x) (c22 (c11 - x) - c12^2)^2 = c22 c66 x^2 (c11 - x)` below `c66`, with 1 along the wave, 2 along
/// the normal and 6 their shear (Royer and Dieulesaint 1984). Of isotropic bodies it is Rayleigh's equation.
fn surface_stiffness(stiffness: &Stiffness, along: usize, normal: usize) -> Option<f64> {
    let shear = if stiffness.dimension() == 2 { 2 } else { 6 - along - normal };
    let entry = |row: usize, column: usize| stiffness.voigt()[(row, column)];
    let scale = entry(shear, shear);
    let of = |row: usize, column: usize| entry(row, column) / scale;
    let [c11, c22, c12] = [of(along, along), of(normal, normal), of(along, normal)];
    let is_stable = scale > 0.0 && c11 > 1.0 && c22 > 0.0 && c11 * c22 > c12 * c12;
    if !is_stable || !scale.is_finite() {
        return None;
    }
    let excess = |x: f64| {
        let across = c22 * (c11 - x) - c12 * c12;
        (1.0 - x) * across * across - c22 * x * x * (c11 - x)
    };
    // Above 0 where nothing moves, below at the speed of shear waves.
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if excess(middle) > 0.0 { low = middle } else { high = middle }
    }
    Some(scale * low)
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;

    /// An isotropic body of shear modulus 1.
    fn isotropic(lambda: f64, d: usize) -> Stiffness {
        let n = if d == 2 { 3 } else { 6 };
        let mut affine = Affine::zero(d);
        let number = |a: usize, b: usize| d * a + b;
        affine.rest = DMatrix::zeros(d * d, d * d);
        for a in 0..d {
            for b in 0..d {
                affine.rest[(number(a, a), number(b, b))] += lambda;
                affine.rest[(number(a, b), number(a, b))] += 1.0;
                affine.rest[(number(a, b), number(b, a))] += 1.0;
            }
        }
        let stiffness = Stiffness::new(&affine);
        assert_eq!(stiffness.voigt().nrows(), n);
        stiffness
    }

    #[test]
    fn isotropic_bodies_have_the_speed_of_the_textbook() {
        // Poisson's ratio of a solid: Rayleigh's equation for 0, 1/4 and 1/2 (nearly) in closed form and in tables.
        let quarter = (2.0 - 2.0 / 3.0_f64.sqrt()).sqrt();
        for (nu, known, error) in
            [(0.25, quarter, 1e-14), (0.0, 0.874_032_049, 1e-8), (0.499_999, 0.955_312, 1e-5)]
        {
            let lambda = 2.0 * nu / (1.0 - 2.0 * nu);
            for (d, along, normal) in [(3, 0, 1), (3, 2, 0), (2, 0, 1), (2, 1, 0)] {
                let found = surface_stiffness(&isotropic(lambda, d), along, normal).unwrap().sqrt();
                assert!((found - known).abs() < error, "{nu} {d}: {found} {known}");
            }
        }
        assert!(surface_stiffness(&isotropic(-1.5, 3), 0, 1).is_none());
    }
}
