//! Products of a symmetric matrix with a vector: each block is read once and serves its row and its
//! column.
//!
//! Slabs of rows go as in the assembly, so that sums have one order for any number of threads.

use pulp::{Arch, Simd, WithSimd};

use super::{BlockMatrix, BlockPattern};
use crate::interaction::Slabs;
use crate::interaction::schedule::{Layout, Part, Touched, visit};

impl BlockPattern {
    /// Ranges of rows whose blocks reach no further than the next range.
    pub fn slabs(&self) -> Slabs {
        Slabs::reaching(self.n_rows(), |row| self.columns[self.row_start[row + 1] - 1] as usize)
    }
}

impl BlockMatrix {
    /// `y` becomes `K x`; both have one entry per degree of freedom. `slabs` are those of the pattern
    /// ([`BlockPattern::slabs`]).
    pub fn multiply_into(&self, slabs: &Slabs, x: &[f64], y: &mut [f64]) {
        let n = self.pattern.n_rows() * self.pattern.dimension;
        assert!(x.len() == n && y.len() == n, "vectors have one entry per degree of freedom");
        y.fill(0.0);
        match self.pattern.dimension {
            2 => self.over_slabs::<2>(slabs, x, y),
            _ => self.over_slabs::<3>(slabs, x, y),
        }
    }

    fn over_slabs<const D: usize>(&self, slabs: &Slabs, x: &[f64], y: &mut [f64]) {
        let (arch, x) = (Arch::new(), x.as_chunks::<D>().0);
        let rows = Part::new(Layout::Points(1), y.as_chunks_mut::<D>().0);
        visit(slabs, rows, (), |slab, [here, next], ()| {
            let rows = slabs.owners(slab);
            arch.dispatch(SlabProduct { matrix: self, rows, x, y: Touched::new(here, next) });
        });
    }
}

/// The rows of a slab on their way.
struct SlabProduct<'a, const D: usize> {
    matrix: &'a BlockMatrix,
    rows: std::ops::Range<usize>,
    x: &'a [[f64; D]],
    y: Touched<'a, [f64; D]>,
}

/// Numbers of a register that holds a row of a block; those beyond it mean nothing.
const WIDE: usize = 4;

impl<const D: usize> WithSimd for SlabProduct<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let SlabProduct { matrix: BlockMatrix { pattern, values }, rows, x, mut y } = self;
        for i in rows {
            let own = x[i];
            // The products entry by entry; they are summed at the end of the row.
            let mut sums = [[0.0; WIDE]; D];
            for block in pattern.row_start[i]..pattern.row_start[i + 1] {
                let j = pattern.columns[block] as usize;
                let block = rows_of::<D>(values, block * D * D);
                let mut other = [0.0; WIDE];
                other[..D].copy_from_slice(&x[j]);
                let mut column = [0.0; WIDE];
                for a in 0..D {
                    for b in 0..WIDE {
                        sums[a][b] += block[a][b] * other[b];
                        column[b] += block[a][b] * own[a];
                    }
                }
                if j != i {
                    let y = &mut y[j];
                    for b in 0..D {
                        y[b] += column[b];
                    }
                }
            }
            for a in 0..D {
                y[i][a] += sums[a][..D].iter().fold(0.0, |sum, x| sum + x);
            }
        }
    }
}

/// The rows of the block that starts at a place.
#[inline(always)]
fn rows_of<const D: usize>(values: &[f64], start: usize) -> [[f64; WIDE]; D] {
    let mut rows = [[0.0; WIDE]; D];
    // A row is read with what comes after it, but at the end of the matrix.
    if let Some(block) = values.get(start..start + D * (D - 1) + WIDE) {
        for a in 0..D {
            rows[a].copy_from_slice(&block[a * D..a * D + WIDE]);
        }
    } else {
        for a in 0..D {
            rows[a][..D].copy_from_slice(&values[start + a * D..start + (a + 1) * D]);
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::energy::Energy;
    use crate::testing::{SpringNetwork, linear, pseudo_random};

    #[test]
    fn products_are_those_of_the_entries_with_the_same_bits_for_any_threads() {
        for (counts, reach) in [(&[23, 9][..], 3.0), (&[9, 5, 6][..], 2.0), (&[2, 1][..], 1.0)] {
            let network = SpringNetwork::lattice(counts, reach, linear);
            let n = network.positions.len();
            // Numbers of no symmetry within a block: a transposed block shows.
            let size = network.pattern().n_blocks() * counts.len() * counts.len();
            let pattern = Arc::clone(network.pattern());
            let matrix = BlockMatrix { pattern, values: pseudo_random(size, 7) };
            let x = pseudo_random(n, 8);
            let slabs = matrix.pattern.slabs();
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let mut y = vec![f64::NAN; n];
                pool.install(|| matrix.multiply_into(&slabs, &x, &mut y));
                y
            };
            let (one, two) = (run(1), run(2));
            assert_eq!(one, two);
            let mut expected = vec![0.0; n];
            for (row, column, value) in matrix.entries() {
                expected[row] += value * x[column];
            }
            let sizes = matrix.multiply_absolute(&x);
            for ((found, expected), size) in one.iter().zip(&expected).zip(&sizes) {
                assert!((found - expected).abs() <= 1e-14 * size, "{found} {expected}");
            }
        }
    }
}
