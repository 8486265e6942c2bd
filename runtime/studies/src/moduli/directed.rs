//! Bonds whose energy depends on their direction, inside an endless lattice: vector by vector.

use nalgebra::DMatrix;
use piola_mechanics::kernel::{Batch, Law, Order, Outputs};

use super::Affine;
use super::fracture::half_space;

/// The energy per volume of `u = G X` to second order. `weight` is that of a bond by its length in spacings;
/// `lattice` the horizon over the spacing, and the spacing in m.
///
/// With the unit vector `n` and `g = n.G n` a bond has `dl/l = g` and `d2l/l = |G n|^2 - g^2`.
pub(super) fn of_bonds(
    law: &dyn Law,
    d: usize,
    (ratio, spacing): (f64, f64),
    weight: impl Fn(f64) -> f64,
) -> Affine {
    let mut sum = Affine::zero(d);
    for vector in half_space(d, ratio) {
        let size = vector.iter().map(|x| f64::from(x * x)).sum::<f64>().sqrt();
        let n: Vec<f64> = vector.iter().map(|x| f64::from(*x) / size).collect();
        let [first, second] = slopes(law, size * spacing, &n).map(|slope| slope * weight(size));
        let entry = |row: usize, column: usize| {
            let (a, i, b, j) = (row / d, row % d, column / d, column % d);
            let turned = if a == b { first * n[i] * n[j] } else { 0.0 };
            turned + (second - first) * n[a] * n[i] * n[b] * n[j]
        };
        let stress = (0..d * d).map(|k| first * n[k / d] * n[k % d]).collect();
        let rest = DMatrix::from_fn(d * d, d * d, entry);
        sum = sum.plus(&Affine { stress, volumetric: 0.0, rest });
    }
    sum
}

/// `L psi'` and `L^2 psi''` of a bond at rest.
fn slopes(law: &dyn Law, length: f64, direction: &[f64]) -> [f64; 2] {
    let [mut psi, mut dpsi, mut d2psi] = [[0.0]; 3];
    let at = [length];
    let batch = Batch { measure: &at, reference: &at, change: &[0.0], fields: direction };
    let out = Outputs { psi: &mut psi, dpsi: &mut dpsi, d2psi: &mut d2psi };
    law.evaluate(batch, Order::Tangent, out);
    [length * dpsi[0], length * (length * d2psi[0])]
}
