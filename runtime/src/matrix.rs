//! Symmetric sparse matrices of d x d blocks: one row and one column of blocks per point.

use std::sync::Arc;

/// The blocks of a symmetric matrix on and above the diagonal.
///
/// Row `i` holds first its diagonal block, then the columns `j > i` in ascending order.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockPattern {
    /// Block size, 2 or 3.
    pub dimension: usize,
    /// Row `i` owns the blocks `row_start[i]..row_start[i + 1]`.
    pub row_start: Vec<usize>,
    /// Column of each block.
    pub columns: Vec<u32>,
}

impl BlockPattern {
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
}
