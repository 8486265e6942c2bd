//! The tangent as the iterative methods see it: something that multiplies vectors.
//!
//! Vectors are full, one entry per degree of freedom. The methods keep them 0 at fixed degrees of
//! freedom, so that the product with `K` and 0 written there is the product with `K_ff`.

use piola_mechanics::energy::Hessian;
use piola_mechanics::interaction::Slabs;
use piola_mechanics::matrix::{BlockMatrix, BlockPattern};
use rayon::prelude::*;

/// A matrix that multiplies.
pub(super) trait Operator: Sync {
    /// `y = K x`; both have one entry per degree of freedom.
    fn multiply(&self, x: &[f64], y: &mut [f64]);
}

/// Points that may be multiplied at once: rows of a slab reach no further than the next slab.
pub(super) fn slabs_of(pattern: &BlockPattern) -> Slabs {
    Slabs::reaching(pattern.n_rows(), |row| {
        pattern.columns[pattern.row_start[row + 1] - 1] as usize
    })
}

/// A stored upper triangle: each block is read once and serves its row and its column.
///
/// Even slabs of rows go at once, then the odd ones, as in the assembly: no two threads write to
/// one entry, and sums have one order for any number of threads.
pub(super) struct StoredMatrix<'a> {
    pub(super) matrix: &'a BlockMatrix,
    pub(super) slabs: &'a Slabs,
}

impl Operator for StoredMatrix<'_> {
    fn multiply(&self, x: &[f64], y: &mut [f64]) {
        match self.matrix.pattern.dimension {
            2 => self.multiply_blocks::<2>(x, y),
            _ => self.multiply_blocks::<3>(x, y),
        }
    }
}

impl StoredMatrix<'_> {
    fn multiply_blocks<const D: usize>(&self, x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for color in 0..2 {
            let mut tasks = Vec::with_capacity(self.slabs.len() / 2 + 1);
            let (mut rest, mut cut) = (&mut *y, 0);
            for slab in (color..self.slabs.len()).step_by(2) {
                let touched = self.slabs.touched(slab);
                let (_, tail) = rest.split_at_mut((touched.start - cut) * D);
                let (rows, tail) = tail.split_at_mut(touched.len() * D);
                (rest, cut) = (tail, touched.end);
                tasks.push((slab, rows));
            }
            tasks.into_par_iter().with_max_len(1).for_each(|(slab, y)| {
                self.multiply_slab::<D>(slab, x, y);
            });
        }
    }

    /// Adds the products of a slab's rows, and of the same blocks as columns, to the entries `y` of
    /// the points that it touches.
    fn multiply_slab<const D: usize>(&self, slab: usize, x: &[f64], y: &mut [f64]) {
        let pattern = &self.matrix.pattern;
        let first = self.slabs.touched(slab).start;
        for i in self.slabs.owners(slab) {
            let blocks = pattern.row_start[i]..pattern.row_start[i + 1];
            let values = &self.matrix.values[blocks.start * D * D..blocks.end * D * D];
            let own: [f64; D] = entries(x, i);
            // The products entry by entry; they are summed at the end of the row.
            let mut row = [[0.0; D]; D];
            for (block, &j) in values.chunks_exact(D * D).zip(&pattern.columns[blocks]) {
                let j = j as usize;
                let other: [f64; D] = entries(x, j);
                for a in 0..D {
                    for b in 0..D {
                        row[a][b] += block[a * D + b] * other[b];
                    }
                }
                if j != i {
                    let place = (j - first) * D;
                    let y = &mut y[place..place + D];
                    for b in 0..D {
                        let mut sum = block[b] * own[0];
                        for a in 1..D {
                            sum += block[a * D + b] * own[a];
                        }
                        y[b] += sum;
                    }
                }
            }
            let place = (i - first) * D;
            for (y, row) in y[place..place + D].iter_mut().zip(&row) {
                *y += row.iter().fold(0.0, |sum, x| sum + x);
            }
        }
    }
}

#[inline(always)]
fn entries<const D: usize>(x: &[f64], point: usize) -> [f64; D] {
    let mut out = [0.0; D];
    out.copy_from_slice(&x[point * D..point * D + D]);
    out
}

/// The tangent, multiplied by the energy's own kernels and never stored.
pub(super) struct MatrixFree<'a> {
    pub(super) hessian: &'a dyn Hessian,
}

impl Operator for MatrixFree<'_> {
    fn multiply(&self, x: &[f64], y: &mut [f64]) {
        // The methods stop at what is not a number.
        self.hessian.multiply(x, y);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use piola_mechanics::energy::Energy;
    use piola_mechanics::testing::{SpringNetwork, linear, pseudo_random};

    #[test]
    fn products_are_those_of_the_matrix_with_the_same_bits_for_any_threads() {
        for (counts, reach) in [(&[23, 9][..], 3.0), (&[9, 5, 6][..], 2.0), (&[2, 1][..], 1.0)] {
            let network = SpringNetwork::lattice(counts, reach, linear);
            let n = network.positions.len();
            // Numbers of no symmetry within a block: a transposed block shows.
            let size = network.pattern().n_blocks() * counts.len() * counts.len();
            let pattern = Arc::clone(network.pattern());
            let matrix = BlockMatrix { pattern, values: pseudo_random(size, 7) };
            let x = pseudo_random(n, 8);
            let slabs = slabs_of(&matrix.pattern);
            let stored = StoredMatrix { matrix: &matrix, slabs: &slabs };
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let mut y = vec![f64::NAN; n];
                pool.install(|| stored.multiply(&x, &mut y));
                y
            };
            let (y, expected) = (run(1), matrix.multiply(&x));
            for (y, expected) in y.iter().zip(&expected) {
                assert!((y - expected).abs() < 1e-13, "{y} {expected}");
            }
            assert!(y == run(2) && y == run(4));
        }
    }
}
