//! Springs along the bonds in place of the tangent: sparse, positive semi-definite and like it, so that
//! conjugate gradients with products converge fast.

use std::sync::Arc;

use crate::body::Body;
use crate::fields::stored::Tensor;
use crate::interaction::Slabs;
use crate::interaction::schedule::{Layout, Part, Touched, visit};
use crate::matrix::BlockMatrix;
use crate::neighborhood::Neighborhood;

/// The least part of the stiffness along a bond that is left across: bodies without triangles hold.
const ACROSS: f64 = 1e-4;

/// Fills a matrix on [`crate::matrix::BlockPattern::of_bonds`] with springs along the bonds as they
/// are at `u`. `stiffness` is that of the bond of a number, from its owner to a later point, of this
/// offset at rest; in N/m.
pub(crate) fn fill<const D: usize>(
    body: &Body,
    (neighborhood, slabs): (&Neighborhood, &Slabs),
    u: &[f64],
    stiffness: impl Fn(usize, [usize; 2], &[f64; D]) -> f64 + Sync,
    matrix: &mut BlockMatrix,
) {
    let (positions, u) = (body.positions().as_chunks::<D>().0, u.as_chunks::<D>().0);
    let pattern = Arc::clone(&matrix.pattern);
    matrix.values.fill(0.0);
    let blocks = matrix.values.as_chunks_mut::<D>().0.as_chunks_mut::<D>().0;
    let blocks = Part::new(Layout::Rows(&pattern.row_start, 1), blocks);
    visit(slabs, blocks, (), |slab, [here, next], ()| {
        let mut blocks: Touched<'_, Tensor<D>> = Touched::new(here, next);
        for i in slabs.owners(slab) {
            for (k, (bond, j)) in neighborhood.bonds(i).zip(neighborhood.upper(i)).enumerate() {
                let j = j as usize;
                let dx: [f64; D] = std::array::from_fn(|c| positions[j][c] - positions[i][c]);
                let now: [f64; D] = std::array::from_fn(|c| dx[c] + (u[j][c] - u[i][c]));
                let spring = spring(stiffness(bond, [i, j], &dx), &dx, &now);
                let [row, of_i] = [pattern.row_start[i] + 1 + k, pattern.row_start[i]];
                blocks[row] = spring.map(|row| row.map(|x| -x));
                for end in [of_i, pattern.row_start[j]] {
                    let sums = blocks[end].as_flattened_mut().iter_mut();
                    sums.zip(spring.as_flattened()).for_each(|(sum, x)| *sum += x);
                }
            }
        }
    });
}

/// A spring of this stiffness along a bond as it is now, or at rest where that has no direction.
fn spring<const D: usize>(stiffness: f64, rest: &[f64; D], now: &[f64; D]) -> Tensor<D> {
    let square = |x: &[f64; D]| x.iter().fold(0.0, |sum, x| sum + x * x);
    let n = if square(now) > 0.0 { now } else { rest };
    let squared = square(n);
    std::array::from_fn(|r| {
        std::array::from_fn(|c| {
            let across = if r == c { ACROSS } else { 0.0 };
            stiffness * (n[r] * n[c] / squared + across)
        })
    })
}
