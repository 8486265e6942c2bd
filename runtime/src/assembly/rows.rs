//! The rows of gradient and tangent that one slab may write to: its own and those of the next slab.

use crate::interaction::Slabs;
use crate::matrix::BlockPattern;

/// A square block, row by row.
pub(super) type Block<const D: usize> = [[f64; D]; D];

/// The rows of the points of one slab. Gradient or tangent may be empty, where it is not wanted.
#[derive(Default)]
pub(super) struct Part<'a> {
    first_point: usize,
    first_block: usize,
    gradient: &'a mut [f64],
    tangent: &'a mut [f64],
}

impl<'a> Part<'a> {
    /// Cuts all rows into those of the slabs.
    pub(super) fn of_slabs(
        slabs: &Slabs,
        pattern: &BlockPattern,
        mut gradient: &'a mut [f64],
        mut tangent: &'a mut [f64],
    ) -> Vec<Part<'a>> {
        let d = pattern.dimension;
        let part = |slab: usize| {
            let points = slabs.owners(slab);
            let blocks = pattern.row_start[points.start]..pattern.row_start[points.end];
            Part {
                first_point: points.start,
                first_block: blocks.start,
                gradient: cut(&mut gradient, points.len() * d),
                tangent: cut(&mut tangent, blocks.len() * d * d),
            }
        };
        (0..slabs.len()).map(part).collect()
    }

    fn borrow(&mut self) -> Part<'_> {
        Part { gradient: self.gradient, tangent: self.tangent, ..*self }
    }
}

/// The rows that a slab may write to.
pub(super) struct Rows<'a> {
    row_start: &'a [usize],
    own: Part<'a>,
    next: Part<'a>,
}

impl<'a> Rows<'a> {
    /// Those of a slab and of the next, if there is one.
    pub(super) fn new(
        pattern: &'a BlockPattern,
        own: &'a mut Part<'_>,
        next: Option<&'a mut Part<'_>>,
    ) -> Rows<'a> {
        // Without a next slab no point lies there.
        let nothing = Part { first_point: usize::MAX, ..Part::default() };
        let next = next.map_or(nothing, Part::borrow);
        Rows { row_start: &pattern.row_start, own: own.borrow(), next }
    }

    /// No rows.
    pub(super) fn none(pattern: &'a BlockPattern) -> Rows<'a> {
        Rows { row_start: &pattern.row_start, own: Part::default(), next: Part::default() }
    }

    /// Makes the tangent zero.
    pub(super) fn clear_tangent(&mut self) {
        self.own.tangent.fill(0.0);
        self.next.tangent.fill(0.0);
    }

    #[inline(always)]
    fn part_of(&mut self, point: usize) -> &mut Part<'a> {
        if point < self.next.first_point { &mut self.own } else { &mut self.next }
    }

    /// Adds to the gradient of a point.
    #[inline(always)]
    pub(super) fn add_gradient<const D: usize>(&mut self, point: usize, part: &[f64; D]) {
        let rows = self.part_of(point);
        let start = (point - rows.first_point) * D;
        let row = &mut rows.gradient[start..start + D];
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
        let first = self.row_start[point] + number;
        let rows = self.part_of(point);
        let start = (first - rows.first_block) * D * D;
        &mut rows.tangent[start..start + count * D * D]
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

/// Cuts up to `count` numbers off the front; an array that is not wanted has none.
fn cut<'a>(rest: &mut &'a mut [f64], count: usize) -> &'a mut [f64] {
    let whole = std::mem::take(rest);
    let (front, back) = whole.split_at_mut(count.min(whole.len()));
    *rest = back;
    front
}
