//! The rows of gradient and tangent that one slab may write to.

use std::ops::Range;

use crate::matrix::BlockPattern;

/// A square block, row by row.
pub(super) type Block<const D: usize> = [[f64; D]; D];

/// Consecutive rows of the gradient and the tangent. Either may be empty, where it is not wanted.
pub(super) struct Rows<'a> {
    row_start: &'a [usize],
    dimension: usize,
    first_point: usize,
    first_block: usize,
    gradient: &'a mut [f64],
    tangent: &'a mut [f64],
}

impl<'a> Rows<'a> {
    /// All rows.
    pub(super) fn whole(
        pattern: &'a BlockPattern,
        gradient: &'a mut [f64],
        tangent: &'a mut [f64],
    ) -> Rows<'a> {
        Rows {
            row_start: &pattern.row_start,
            dimension: pattern.dimension,
            first_point: 0,
            first_block: 0,
            gradient,
            tangent,
        }
    }

    /// No rows.
    pub(super) fn none(pattern: &'a BlockPattern) -> Rows<'a> {
        Rows::whole(pattern, &mut [], &mut [])
    }

    /// Cuts off the rows of these points; rows before them are given up.
    pub(super) fn take(&mut self, points: Range<usize>) -> Rows<'a> {
        let blocks = self.row_start[points.start]..self.row_start[points.end];
        let (d, block) = (self.dimension, self.dimension * self.dimension);
        cut(&mut self.gradient, (points.start - self.first_point) * d);
        cut(&mut self.tangent, (blocks.start - self.first_block) * block);
        self.first_point = points.end;
        self.first_block = blocks.end;
        Rows {
            row_start: self.row_start,
            dimension: d,
            first_point: points.start,
            first_block: blocks.start,
            gradient: cut(&mut self.gradient, points.len() * d),
            tangent: cut(&mut self.tangent, blocks.len() * block),
        }
    }

    /// Adds to the gradient of a point.
    #[inline(always)]
    pub(super) fn add_gradient<const D: usize>(&mut self, point: usize, part: &[f64; D]) {
        let start = (point - self.first_point) * D;
        let row = &mut self.gradient[start..start + D];
        for axis in 0..D {
            row[axis] += part[axis];
        }
    }

    /// Where the diagonal block of a point starts.
    #[inline(always)]
    pub(super) fn diagonal<const D: usize>(&self, point: usize) -> usize {
        (self.row_start[point] - self.first_block) * D * D
    }

    /// Where the block of a point and its later neighbour at `place` starts.
    #[inline(always)]
    pub(super) fn coupling<const D: usize>(&self, point: usize, place: usize) -> usize {
        self.diagonal::<D>(point) + (1 + place) * D * D
    }

    /// The numbers of the block that starts there.
    #[inline(always)]
    pub(super) fn block<const D: usize>(&mut self, start: usize) -> &mut [f64] {
        &mut self.tangent[start..start + D * D]
    }

    /// The numbers of `count` blocks, the first of which starts there.
    #[inline(always)]
    pub(super) fn blocks<const D: usize>(&mut self, start: usize, count: usize) -> &mut [f64] {
        &mut self.tangent[start..start + count * D * D]
    }

    /// Makes the tangent zero.
    pub(super) fn clear_tangent(&mut self) {
        self.tangent.fill(0.0);
    }

    /// Adds to the block that starts there.
    #[inline(always)]
    pub(super) fn add_block<const D: usize>(&mut self, start: usize, part: &Block<D>) {
        let block = self.block::<D>(start);
        for row in 0..D {
            for column in 0..D {
                block[row * D + column] += part[row][column];
            }
        }
    }
}

/// Cuts up to `count` numbers off the front; an array that is not wanted has none.
fn cut<'a>(rest: &mut &'a mut [f64], count: usize) -> &'a mut [f64] {
    let whole = std::mem::take(rest);
    let (front, back) = whole.split_at_mut(count.min(whole.len()));
    *rest = back;
    front
}
