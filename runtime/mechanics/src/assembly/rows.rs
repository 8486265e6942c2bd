//! The rows of gradient and tangent that one slab may write to: its own and those of the next slab.

use crate::interaction::schedule::Touched;

/// A square block, row by row.
pub(super) type Block<const D: usize> = [[f64; D]; D];

/// The rows that a slab may write to. Gradient or tangent may be empty, where it is not wanted.
pub(super) struct Rows<'a> {
    /// Where the blocks of each point start.
    pub(super) row_start: &'a [usize],
    pub(super) gradient: Touched<'a, f64>,
    pub(super) tangent: Touched<'a, f64>,
}

impl Rows<'_> {
    /// Makes the tangent zero.
    pub(super) fn clear_tangent(&mut self) {
        self.tangent.fill(0.0);
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
        let first = (self.row_start[point] + number) * D * D;
        self.tangent.range(first..first + count * D * D)
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
        self.row_start[point + 1] - self.row_start[point]
    }
}
