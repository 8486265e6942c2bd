//! The tangent of a rank's own points, out of the symmetric one of all that it holds.

use std::ops::Range;

use piola_mechanics::matrix::{BlockMatrix, BlockPattern};
use piola_petsc::BlockRows;

/// Whole rows of the tangent, and where their blocks stand in a matrix that keeps those on and above the diagonal.
pub(super) struct OwnRows {
    pub(super) pattern: BlockRows,
    /// Of each block of the pattern.
    sources: Vec<Source>,
    d: usize,
}

/// Where a block comes from: its number, the point of its column among those held, and whether it is transposed.
#[derive(Clone, Copy)]
struct Source {
    block: usize,
    column: u32,
    transposed: bool,
}

impl OwnRows {
    /// The rows of points `own` among those held, of which `first` is the first by its number in the body.
    pub(super) fn new(symmetric: &BlockPattern, own: Range<usize>, first: usize) -> OwnRows {
        let is_own = |point: usize| own.contains(&point);
        let mut rows: Vec<Vec<Source>> = own.clone().map(|_| Vec::new()).collect();
        // Rows in their order: what stands above the diagonal comes behind what is transposed from earlier rows.
        for row in 0..symmetric.n_rows() {
            for (block, &column) in (symmetric.row_start[row]..).zip(symmetric.row(row)) {
                if is_own(row) {
                    rows[row - own.start].push(Source { block, column, transposed: false });
                }
                if column as usize != row && is_own(column as usize) {
                    let source = Source { block, column: row as u32, transposed: true };
                    rows[column as usize - own.start].push(source);
                }
            }
        }
        let mut starts = vec![0];
        starts.extend(rows.iter().scan(0, |end, row| {
            *end += row.len();
            Some(*end)
        }));
        let sources = rows.concat();
        let columns =
            sources.iter().map(|source| (first + source.column as usize) as u64).collect();
        OwnRows { pattern: BlockRows { starts, columns }, sources, d: symmetric.dimension }
    }

    /// Fills in the blocks, `d x d` each, row by row.
    pub(super) fn take(&self, matrix: &BlockMatrix, blocks: &mut [f64]) {
        let d = self.d;
        for (source, out) in self.sources.iter().zip(blocks.chunks_exact_mut(d * d)) {
            let block = &matrix.values[source.block * d * d..(source.block + 1) * d * d];
            for (place, x) in out.iter_mut().enumerate() {
                let (a, b) = (place / d, place % d);
                *x = if source.transposed { block[b * d + a] } else { block[place] };
            }
        }
    }

    /// `product` becomes the rows times `p`, which has `d` numbers for each point that is held.
    pub(super) fn multiply(&self, blocks: &[f64], p: &[f64], product: &mut [f64]) {
        let d = self.d;
        for (range, out) in self.pattern.starts.windows(2).zip(product.chunks_exact_mut(d)) {
            out.fill(0.0);
            for k in range[0]..range[1] {
                let column = self.sources[k].column as usize;
                for a in 0..d {
                    for b in 0..d {
                        out[a] += blocks[(k * d + a) * d + b] * p[column * d + b];
                    }
                }
            }
        }
    }

    /// Takes rows and columns of prescribed degrees of freedom out: what is left of them is their diagonal. `is_fixed`
    /// is of all that are held, of which rows are those from `first_own` on.
    pub(super) fn hold(&self, blocks: &mut [f64], is_fixed: &[bool], first_own: usize) {
        let d = self.d;
        for (row, range) in self.pattern.starts.windows(2).enumerate() {
            let row = first_own + row;
            for k in range[0]..range[1] {
                let column = self.sources[k].column as usize;
                for a in 0..d {
                    for b in 0..d {
                        let (r, c) = (row * d + a, column * d + b);
                        let x = &mut blocks[(k * d + a) * d + b];
                        if r == c && is_fixed[r] {
                            // As large as it is in the body, so that the matrix is no worse for it.
                            *x = if *x == 0.0 { 1.0 } else { x.abs() };
                        } else if is_fixed[r] || is_fixed[c] {
                            *x = 0.0;
                        }
                    }
                }
            }
        }
    }
}
