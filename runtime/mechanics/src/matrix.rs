//! Symmetric sparse matrices of d x d blocks: one row and one column of blocks per point.

mod product;

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use crate::neighborhood::Neighborhood;

/// The blocks of a symmetric matrix on and above the diagonal.
///
/// Row `i` holds first its diagonal block, then the columns `j > i` in ascending order.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockPattern {
    /// Block size: the dimension of the body; of coarse systems the functions per piece.
    pub dimension: usize,
    /// Row `i` owns the blocks `row_start[i]..row_start[i + 1]`.
    pub row_start: Vec<usize>,
    /// Column of each block.
    pub columns: Vec<u32>,
}

impl BlockPattern {
    /// Diagonal blocks and those of all bonds: members of a triangle or tetrahedron are neighbours.
    pub fn of_bonds(neighborhood: &Neighborhood, dimension: usize) -> BlockPattern {
        let n = neighborhood.n_points();
        let mut row_start = Vec::with_capacity(n + 1);
        let mut columns = Vec::with_capacity(n + neighborhood.n_bonds());
        row_start.push(0);
        for point in 0..n {
            columns.push(point as u32);
            columns.extend(neighborhood.upper(point));
            row_start.push(columns.len());
        }
        BlockPattern { dimension, row_start, columns }
    }

    /// Diagonal blocks and those of points that are reached over so many bonds.
    pub(crate) fn of_reach(
        neighborhood: &Neighborhood,
        dimension: usize,
        reach: usize,
    ) -> BlockPattern {
        let n = neighborhood.n_points();
        let row = |seen: &mut Vec<u32>, point: usize| {
            let mut found = vec![point as u32];
            seen[point] = point as u32;
            let mut ring = 0..1;
            for _ in 0..reach {
                for k in ring.clone() {
                    for j in neighborhood.row(found[k] as usize) {
                        if seen[j as usize] != point as u32 {
                            seen[j as usize] = point as u32;
                            found.push(j);
                        }
                    }
                }
                ring = ring.end..found.len();
            }
            found.retain(|&j| j as usize >= point);
            found.sort_unstable();
            found
        };
        let rows: Vec<Vec<u32>> =
            (0..n).into_par_iter().map_init(|| vec![u32::MAX; n], row).collect();
        let mut row_start = vec![0];
        row_start.extend(rows.iter().scan(0, |end, row| {
            *end += row.len();
            Some(*end)
        }));
        BlockPattern { dimension, row_start, columns: rows.concat() }
    }

    /// The pattern with the blocks of both, which have as many rows; this one where that is all.
    pub(crate) fn with(self: Arc<Self>, other: &BlockPattern) -> Arc<BlockPattern> {
        let n = self.n_rows();
        assert_eq!((n, self.dimension), (other.n_rows(), other.dimension), "patterns of one body");
        let (mut row_start, mut columns) = (vec![0], Vec::with_capacity(self.n_blocks()));
        for row in 0..n {
            let start = columns.len();
            columns.extend_from_slice(self.row(row));
            columns.extend_from_slice(other.row(row));
            columns[start..].sort_unstable();
            let mut kept = start;
            for place in start..columns.len() {
                if kept == start || columns[kept - 1] != columns[place] {
                    columns[kept] = columns[place];
                    kept += 1;
                }
            }
            columns.truncate(kept);
            row_start.push(kept);
        }
        if columns.len() == self.n_blocks() {
            return self;
        }
        Arc::new(BlockPattern { dimension: self.dimension, row_start, columns })
    }

    /// The columns of the blocks of a row.
    pub fn row(&self, row: usize) -> &[u32] {
        &self.columns[self.row_start[row]..self.row_start[row + 1]]
    }

    /// How many rows of blocks there are.
    pub fn n_rows(&self) -> usize {
        self.row_start.len() - 1
    }

    /// How many blocks are stored.
    pub fn n_blocks(&self) -> usize {
        self.columns.len()
    }
}

/// A symmetric matrix on a [`BlockPattern`].
#[derive(Clone, Debug)]
pub struct BlockMatrix {
    /// Where the blocks are.
    pub pattern: Arc<BlockPattern>,
    /// The blocks in the pattern's order, each `d x d` row by row; diagonal blocks are stored whole.
    pub values: Vec<f64>,
}

impl BlockMatrix {
    /// The zero matrix.
    pub fn zeros(pattern: &Arc<BlockPattern>) -> BlockMatrix {
        let size = pattern.n_blocks() * pattern.dimension * pattern.dimension;
        BlockMatrix { pattern: Arc::clone(pattern), values: vec![0.0; size] }
    }

    /// The blocks of each row, to be filled side by side.
    pub(crate) fn rows(&mut self) -> Vec<&mut [f64]> {
        let size = self.pattern.dimension * self.pattern.dimension;
        let mut rest = &mut self.values[..];
        let row = |ends: &[usize]| {
            let (row, tail) = std::mem::take(&mut rest).split_at_mut((ends[1] - ends[0]) * size);
            rest = tail;
            row
        };
        self.pattern.row_start.windows(2).map(row).collect()
    }

    /// A matrix of any values, in an array that is there.
    pub(crate) fn in_room(pattern: &Arc<BlockPattern>, mut room: Vec<f64>) -> BlockMatrix {
        room.resize(pattern.n_blocks() * pattern.dimension * pattern.dimension, 0.0);
        BlockMatrix { pattern: Arc::clone(pattern), values: room }
    }

    /// Adds a matrix whose blocks are all on this one's pattern.
    pub(crate) fn add(&mut self, other: &BlockMatrix) {
        add_rows(&self.pattern, 0..self.pattern.n_rows(), &mut self.values, other);
    }

    /// The product `K x`, summed block by block in the pattern's order: the same bits always.
    ///
    /// `x` has one entry per degree of freedom (`n_rows * dimension`).
    pub fn multiply(&self, x: &[f64]) -> Vec<f64> {
        self.product(x, |entry, x| entry * x)
    }

    /// The product `|K| |x|` of absolute values: the scale of the rounding errors of `K x`.
    pub fn multiply_absolute(&self, x: &[f64]) -> Vec<f64> {
        self.product(x, |entry, x| (entry * x).abs())
    }

    fn product(&self, x: &[f64], term: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        let d = self.pattern.dimension;
        assert_eq!(x.len(), self.pattern.n_rows() * d, "x has one entry per degree of freedom");
        let mut y = vec![0.0; x.len()];
        for i in 0..self.pattern.n_rows() {
            for block in self.pattern.row_start[i]..self.pattern.row_start[i + 1] {
                let j = self.pattern.columns[block] as usize;
                let values = &self.values[block * d * d..(block + 1) * d * d];
                for a in 0..d {
                    for b in 0..d {
                        let entry = values[a * d + b];
                        y[i * d + a] += term(entry, x[j * d + b]);
                        if i != j {
                            y[j * d + b] += term(entry, x[i * d + a]);
                        }
                    }
                }
            }
        }
        y
    }

    /// All entries of both triangles as `(row, column, value)`, rows and columns being
    /// `dimension * point + component`; each entry appears once, in no particular order.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let d = self.pattern.dimension;
        (0..self.pattern.n_rows())
            .flat_map(|i| {
                let blocks = self.pattern.row_start[i]..self.pattern.row_start[i + 1];
                blocks.map(move |block| (i, block))
            })
            .flat_map(move |(i, block)| {
                let j = self.pattern.columns[block] as usize;
                (0..d * d).flat_map(move |k| {
                    let (row, column) = (i * d + k / d, j * d + k % d);
                    let value = self.values[block * d * d + k];
                    let mirrored = (i != j).then_some((column, row, value));
                    std::iter::once((row, column, value)).chain(mirrored)
                })
            })
    }
}

/// Rows that one task adds to.
const ROWS: usize = 256;

/// Adds some rows of a matrix to `sums`, those on another pattern that has all its blocks. Halves
/// go side by side, without lists of rows.
fn add_rows(pattern: &BlockPattern, rows: Range<usize>, sums: &mut [f64], other: &BlockMatrix) {
    let size = pattern.dimension * pattern.dimension;
    let of_rows = |rows: &Range<usize>| pattern.row_start[rows.end] - pattern.row_start[rows.start];
    if rows.len() > ROWS {
        let middle = rows.start + rows.len() / 2;
        let (low, high) = (rows.start..middle, middle..rows.end);
        let (first, last) = sums.split_at_mut(of_rows(&low) * size);
        rayon::join(
            || add_rows(pattern, low, first, other),
            || add_rows(pattern, high, last, other),
        );
        return;
    }
    let add = |sums: &mut [f64], values: &[f64]| {
        sums.iter_mut().zip(values).for_each(|(sum, x)| *sum += x);
    };
    let mut rest = sums;
    for row in rows {
        let (all, some) = (pattern.row(row), other.pattern.row(row));
        let (sums, tail) = std::mem::take(&mut rest).split_at_mut(all.len() * size);
        rest = tail;
        let start = other.pattern.row_start[row] * size;
        let values = &other.values[start..start + some.len() * size];
        if all.len() == some.len() {
            add(sums, values);
            continue;
        }
        let mut place = 0;
        for (column, block) in some.iter().zip(values.chunks_exact(size)) {
            while all[place] < *column {
                place += 1;
            }
            assert_eq!(all[place], *column, "a block of both");
            add(&mut sums[place * size..(place + 1) * size], block);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows 0-1, 0-2 coupled, 1-2 not; entries distinct so that a transposed block shows.
    fn example() -> BlockMatrix {
        let pattern = Arc::new(BlockPattern {
            dimension: 2,
            row_start: vec![0, 3, 4, 5],
            columns: vec![0, 1, 2, 1, 2],
        });
        let values = vec![
            2.0, 1.0, 1.0, 3.0, // 0,0
            4.0, -5.0, 6.0, 7.0, // 0,1
            8.0, 9.0, -10.0, 11.0, // 0,2
            12.0, 0.5, 0.5, 13.0, // 1,1
            14.0, 0.0, 0.0, 15.0, // 2,2
        ];
        BlockMatrix { pattern, values }
    }

    fn dense(matrix: &BlockMatrix) -> nalgebra::DMatrix<f64> {
        let n = matrix.pattern.n_rows() * matrix.pattern.dimension;
        let mut dense = nalgebra::DMatrix::zeros(n, n);
        for (row, column, value) in matrix.entries() {
            dense[(row, column)] += value;
        }
        dense
    }

    #[test]
    fn entries_mirror_the_blocks_off_the_diagonal() {
        let k = dense(&example());
        assert_eq!(k, k.transpose());
        assert_eq!((k[(0, 3)], k[(1, 2)], k[(3, 0)]), (-5.0, 6.0, -5.0));
        assert_eq!(example().entries().count(), 3 * 4 + 2 * 2 * 4);
    }

    #[test]
    fn products_agree_with_the_dense_matrix() {
        let matrix = example();
        let x: Vec<f64> = (0..6).map(|i| f64::from(i) - 2.5).collect();
        let expected = dense(&matrix) * nalgebra::DVector::from_column_slice(&x);
        assert_eq!(matrix.multiply(&x), expected.as_slice());
        let expected = dense(&matrix).abs() * nalgebra::DVector::from_column_slice(&x).abs();
        assert_eq!(matrix.multiply_absolute(&x), expected.as_slice());
    }
}
