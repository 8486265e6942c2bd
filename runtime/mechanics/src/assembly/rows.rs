//! The rows of gradient and tangent that one slab may write to: its own and those of the next slab. Of
//! the tangent these may be the diagonal blocks alone.

use crate::interaction::schedule::Touched;

/// A square block, row by row.
pub(super) type Block<const D: usize> = [[f64; D]; D];

/// The rows that a slab may write to. Gradient or blocks may be empty, where they are not wanted.
pub(super) struct Rows<'a> {
    /// Where the blocks of each point start; absent where each point has its diagonal block alone.
    pub(super) row_start: Option<&'a [usize]>,
    pub(super) gradient: Touched<'a, f64>,
    pub(super) blocks: Touched<'a, f64>,
}

impl Rows<'_> {
    /// Whether there are blocks beside the diagonal.
    #[inline(always)]
    pub(super) fn has_couplings(&self) -> bool {
        self.row_start.is_some()
    }

    /// Adds to the gradient of a point.
    #[inline(always)]
    pub(super) fn add_gradient<const D: usize>(&mut self, point: usize, part: &[f64; D]) {
        let row = self.gradient.range(point * D..(point + 1) * D);
        for axis in 0..D {
            row[axis] += part[axis];
        }
    }

    /// `count` blocks of a point from block `number` on: 0 is its diagonal block, `1 + place` that
    /// with its later neighbour at `place`.
    #[inline(always)]
    pub(super) fn blocks<const D: usize>(
        &mut self,
        point: usize,
        number: usize,
        count: usize,
    ) -> &mut [f64] {
        let start = self.row_start.map_or(point, |start| start[point]);
        let first = (start + number) * D * D;
        self.blocks.range(first..first + count * D * D)
    }

    /// Adds to block `number` of a point.
    #[inline(always)]
    pub(super) fn add_block<const D: usize>(
        &mut self,
        point: usize,
        number: usize,
        part: &Block<D>,
    ) {
        let block = self.blocks::<D>(point, number, 1);
        for row in 0..D {
            for column in 0..D {
                block[row * D + column] += part[row][column];
            }
        }
    }

    /// How many blocks a point has.
    #[inline(always)]
    pub(super) fn n_blocks(&self, point: usize) -> usize {
        self.row_start.map_or(1, |start| start[point + 1] - start[point])
    }
}
