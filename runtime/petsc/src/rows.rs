//! The pattern of a tangent.

use crate::engine::Engine;
use crate::halo::check_ranges;

/// Which blocks of a tangent are there: the rows of the points that a rank owns, in their order.
///
/// A row of `n` blocks, `d x d` each, is `d` lines of the matrix, one behind the other, in which blocks follow one
/// another as their columns do here: the number in line `a` and column `b` of block `k` is
/// `values[(a * n + k) * d + b]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockRows {
    /// Where the blocks of each row begin in `columns`, and at the end how many there are: a number for each
    /// owned point and one more.
    pub starts: Vec<usize>,
    /// The points of the columns by their number in the whole body, ascending in a row. The diagonal is
    /// there in every row: preconditioners need it, even where it is zero.
    pub columns: Vec<u64>,
}

impl BlockRows {
    /// Whether these are rows of the range of this rank.
    pub(crate) fn check(&self, engine: &Engine, ranges: &[u64], d: usize) -> Result<(), String> {
        check_ranges(engine, ranges, d)?;
        let (first, end) = (ranges[engine.rank()], ranges[engine.rank() + 1]);
        let own = (end - first) as usize;
        let (starts, columns) = (&self.starts, &self.columns);
        if starts.len() != own + 1 || starts[0] != 0 || starts[own] != columns.len() {
            return Err(format!("the starts of {own} rows are {} numbers from 0 up", own + 1));
        }
        if !starts.is_sorted() {
            return Err("the starts of rows do not ascend".to_string());
        }
        for (row, range) in (first..end).zip(starts.windows(2)) {
            let columns = &columns[range[0]..range[1]];
            let ascend = columns.is_sorted_by(|a, b| a < b);
            let inside = columns.last().is_some_and(|&last| last < ranges[engine.ranks()]);
            if !ascend || !inside || columns.binary_search(&row).is_err() {
                return Err(format!(
                    "the columns of row {row} are not points of the body, ascending, with its own"
                ));
            }
        }
        let most = engine.running().most();
        let entries = (columns.len() as u64).checked_mul((d * d) as u64);
        if entries.is_none_or(|entries| entries > most) {
            return Err(format!(
                "{} blocks of {d} x {d}, and this PETSc counts to {most}: take more ranks, or a PETSc \
                 built with 64-bit indices",
                columns.len()
            ));
        }
        Ok(())
    }
}
