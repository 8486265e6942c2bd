//! The tangent of a rank's own points, out of the symmetric one of all that it holds.

use std::ops::Range;

use piola_mechanics::matrix::{BlockMatrix, BlockPattern};
use piola_petsc::BlockRows;

/// Whole rows of the tangent. Of a row the blocks on and above the diagonal follow one another in the symmetric
/// matrix; those below it stand in earlier rows, the other way round.
pub(super) struct OwnRows {
    pub(super) pattern: BlockRows,
    /// Of each own row the blocks below the diagonal, by their number in the symmetric matrix.
    below: Vec<usize>,
    /// Where those of each row begin, and one more.
    below_start: Vec<usize>,
    own: Range<usize>,
    /// The first point that is held, by its number in the body.
    first: usize,
}

impl OwnRows {
    /// The rows of points `own` among those held, of which `first` is the first by its number in the body.
    pub(super) fn new(symmetric: &BlockPattern, own: Range<usize>, first: usize) -> OwnRows {
        let mut rows = vec![Vec::new(); own.len()];
        for row in 0..own.end {
            // A diagonal block is the first of its row.
            for block in symmetric.row_start[row] + 1..symmetric.row_start[row + 1] {
                let column = symmetric.columns[block] as usize;
                if own.contains(&column) {
                    rows[column - own.start].push((row, block));
                }
            }
        }
        let (mut starts, mut below_start) = (vec![0], vec![0]);
        let (mut columns, mut below) = (Vec::new(), Vec::new());
        for (row, lower) in own.clone().zip(rows) {
            below.extend(lower.iter().map(|(_, block)| block));
            let upper = symmetric.row(row).iter().map(|&column| column as usize);
            let held = lower.into_iter().map(|(column, _)| column).chain(upper);
            columns.extend(held.map(|column| (first + column) as u64));
            starts.push(columns.len());
            below_start.push(below.len());
        }
        OwnRows { pattern: BlockRows { starts, columns }, below, below_start, own, first }
    }

    /// Writes an own row, as [`BlockRows`] has it, without the columns of prescribed degrees of freedom and without
    /// all of their rows but the diagonal, which is as large as it is in the body, so that the matrix is no worse for
    /// it. `is_fixed` is of all that are held.
    pub(super) fn write(
        &self,
        row: usize,
        matrix: &BlockMatrix,
        is_fixed: &[bool],
        values: &mut [f64],
    ) {
        match matrix.pattern.dimension {
            2 => self.write_of::<2>(row, matrix, is_fixed, values),
            _ => self.write_of::<3>(row, matrix, is_fixed, values),
        }
    }

    fn write_of<const D: usize>(
        &self,
        row: usize,
        matrix: &BlockMatrix,
        is_fixed: &[bool],
        values: &mut [f64],
    ) {
        let pattern = &matrix.pattern;
        let is_fixed = is_fixed.as_chunks::<D>().0;
        let blocks = matrix.values.as_chunks::<D>().0.as_chunks::<D>().0;
        let held = self.own.start + row;
        let below = &self.below[self.below_start[row]..self.below_start[row + 1]];
        let above = pattern.row_start[held]..pattern.row_start[held + 1];
        let mut lines = values.chunks_exact_mut((below.len() + above.len()) * D);
        let lines: [&mut [[f64; D]]; D] = std::array::from_fn(|_| {
            lines.next().map_or(&mut [][..], |line| line.as_chunks_mut().0)
        });
        let columns = self.pattern.columns[self.pattern.starts[row]..].iter();
        let columns = columns.map(|column| *column as usize - self.first);
        let others =
            below.iter().map(|block| (*block, true)).chain(above.map(|block| (block, false)));
        for (k, ((block, transposed), column)) in others.zip(columns).enumerate() {
            let (block, fixed) = (&blocks[block], &is_fixed[column]);
            for a in 0..D {
                for b in 0..D {
                    let x = if transposed { block[b][a] } else { block[a][b] };
                    lines[a][k][b] = if fixed[b] { 0.0 } else { x };
                }
            }
        }
        for a in (0..D).filter(|a| is_fixed[held][*a]) {
            let diagonal = blocks[pattern.row_start[held]][a][a].abs();
            lines[a].fill([0.0; D]);
            lines[a][below.len()][a] = if diagonal == 0.0 { 1.0 } else { diagonal };
        }
    }
}
