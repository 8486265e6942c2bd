//! The free part of a block matrix as compressed columns, the form in which faer factorises.

use faer::sparse::{SparseColMat, SparseColMatRef, SymbolicSparseColMat};
use piola_mechanics::matrix::{BlockMatrix, BlockPattern};
use rayon::prelude::*;

use super::LinearError;
use crate::constraint::Constraints;

/// Entries copied by one task.
const CHUNK: usize = 1 << 16;

/// The lower triangle of `K_ff`, its structure and the way from the blocks to its entries computed
/// once.
#[derive(Debug)]
pub(super) struct FreeTriangle {
    structure: SymbolicSparseColMat<usize>,
    /// Where each entry stands in [`BlockMatrix::values`].
    source: Vec<usize>,
    values: Vec<f64>,
}

impl FreeTriangle {
    pub(super) fn new(
        pattern: &BlockPattern,
        constraints: &Constraints,
    ) -> Result<FreeTriangle, LinearError> {
        let d = pattern.dimension;
        let free_index = free_indices(constraints);
        let mut column_start = vec![0];
        let mut rows = Vec::new();
        let mut source = Vec::new();
        // Row i of the upper triangle is column i of the lower: both are walked in their order.
        for &dof in constraints.free() {
            let (i, a) = (dof / d, dof % d);
            for block in pattern.row_start[i]..pattern.row_start[i + 1] {
                let j = pattern.columns[block] as usize;
                for b in if i == j { a..d } else { 0..d } {
                    if let Some(row) = free_index[j * d + b] {
                        rows.push(row);
                        source.push(block * d * d + a * d + b);
                    }
                }
            }
            column_start.push(rows.len());
        }
        let n = constraints.n_free();
        let values = vec![0.0; rows.len()];
        let structure = SymbolicSparseColMat::new_checked(n, n, column_start, None, rows);
        Ok(FreeTriangle { structure, source, values })
    }

    /// Copies the entries of `matrix`; the copies are independent, so threads change no bits.
    pub(super) fn update(&mut self, matrix: &BlockMatrix) {
        let copy = |(values, source): (&mut [f64], &[usize])| {
            for (value, &place) in values.iter_mut().zip(source) {
                *value = matrix.values[place];
            }
        };
        let (values, source) = (&mut self.values, &self.source);
        values.par_chunks_mut(CHUNK).zip(source.par_chunks(CHUNK)).for_each(copy);
    }

    /// The lower triangle.
    pub(super) fn matrix(&self) -> SparseColMatRef<'_, usize, f64> {
        SparseColMatRef::new(self.structure.as_ref(), &self.values)
    }

    /// Both triangles.
    pub(super) fn mirrored(&self) -> SparseColMat<usize, f64> {
        let n = self.structure.ncols();
        let (start, rows) = (self.structure.col_ptr(), self.structure.row_idx());
        let mut count = vec![0usize; n];
        for column in 0..n {
            for &row in &rows[start[column]..start[column + 1]] {
                count[column] += 1;
                if row != column {
                    count[row] += 1;
                }
            }
        }
        let mut next: Vec<usize> = vec![0; n + 1];
        for column in 0..n {
            next[column + 1] = next[column] + count[column];
        }
        let column_start = next.clone();
        let mut all_rows = vec![0usize; column_start[n]];
        let mut all_values = vec![0.0; column_start[n]];
        let mut put = |column: usize, row: usize, value: f64| {
            all_rows[next[column]] = row;
            all_values[next[column]] = value;
            next[column] += 1;
        };
        // Column by column, rows above the diagonal have come from earlier columns: each column
        // fills in ascending order.
        for column in 0..n {
            for entry in start[column]..start[column + 1] {
                put(column, rows[entry], self.values[entry]);
                if rows[entry] != column {
                    put(rows[entry], column, self.values[entry]);
                }
            }
        }
        let structure = SymbolicSparseColMat::new_checked(n, n, column_start, None, all_rows);
        SparseColMat::new(structure, all_values)
    }
}

/// Place of each degree of freedom among the free ones.
fn free_indices(constraints: &Constraints) -> Vec<Option<usize>> {
    let mut free_index = vec![None; constraints.n_dofs()];
    for (place, &dof) in constraints.free().iter().enumerate() {
        free_index[dof] = Some(place);
    }
    free_index
}
