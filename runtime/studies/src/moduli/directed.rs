//! Bonds whose energy depends on their direction, or on their vector, inside an endless lattice: one after the
//! other.

use nalgebra::DMatrix;
use piola_mechanics::element::{Contributions, Element, InteractionBatch, Order};
use piola_mechanics::geometry::packed;
use piola_mechanics::kernel::Measure;

use super::Affine;
use super::fracture::half_space;
use crate::case::CaseError;

/// The energy per volume of `u = G X` to second order: one end of a bond moves by `G xi` against the other.
/// `weight` is that of a bond by its length in spacings; `ratio` the horizon over the spacing, which is in m.
///
/// # Errors
/// An energy that is not finite at rest.
pub(super) fn of_bonds(
    element: &dyn Element,
    (ratio, spacing): (f64, f64),
    weight: impl Fn(f64) -> f64,
) -> Result<Affine, CaseError> {
    let d = element.dimension();
    let mut batch = InteractionBatch::new(Measure::Length, d);
    let mut out = Contributions::new(Measure::Length, d);
    let mut sum = Affine::zero(d);
    for vector in half_space(d, ratio) {
        let size = vector.iter().map(|x| f64::from(x * x)).sum::<f64>().sqrt();
        let xi: Vec<f64> = vector.iter().map(|x| spacing * f64::from(*x)).collect();
        match d {
            2 => batch.fill(1, |_| ([xi[0], xi[1]], [0.0; 2], weight(size))),
            _ => batch.fill(1, |_| ([xi[0], xi[1], xi[2]], [0.0; 3], weight(size))),
        }
        batch.fields.clear();
        for x in xi.iter().take(element.n_fields()) {
            batch.fields.extend(std::iter::repeat_n(x / (spacing * size), batch.padded_len()));
        }
        let evaluated = element.evaluate(&batch, Order::Tangent, &mut out);
        evaluated.map_err(|lane| CaseError::Body {
            message: format!(
                "psi({}) or a derivative is not finite for a bond of {:e} m at rest",
                element.argument(),
                lane.reference
            ),
        })?;
        let hessian = |a: usize, b: usize| out.hessian[packed(d, a.min(b), a.max(b))][0];
        let entry =
            |row: usize, column: usize| hessian(row / d, column / d) * xi[row % d] * xi[column % d];
        let stress = (0..d * d).map(|k| out.gradient[k / d][0] * xi[k % d]).collect();
        let rest = DMatrix::from_fn(d * d, d * d, entry);
        sum = sum.plus(&Affine { stress, volumetric: 0.0, rest });
    }
    Ok(sum)
}
