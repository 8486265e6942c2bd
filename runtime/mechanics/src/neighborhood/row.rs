//! The neighbours of one point.
//!
//! They are kept as steps: the number of a neighbour less that of the point. On a lattice most points have the same
//! steps, and share them.

use std::ops::Range;

/// Where the steps of a row stand among all, those to later points last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Span {
    start: usize,
    len: u32,
    later: u32,
    /// Whether one point alone has the row.
    is_own: bool,
}

impl Span {
    /// `later` of the `len` steps from `start` on lead to later points.
    pub(super) fn new(start: usize, len: usize, later: usize) -> Span {
        Span { start, len: len as u32, later: later as u32, is_own: false }
    }

    pub(super) fn all(&self) -> Range<usize> {
        self.start..self.start + self.len as usize
    }

    pub(super) fn upper(&self) -> Range<usize> {
        let end = self.start + self.len as usize;
        end - self.later as usize..end
    }

    pub(super) fn later(&self) -> usize {
        self.later as usize
    }

    /// The row that is left of this one for one point alone, and where its steps stand: where they stood if this was
    /// that point's own, else behind the end of all.
    pub(super) fn left(&self, end: usize, len: usize, later: usize) -> Span {
        let start = if self.is_own { self.start } else { end };
        Span { is_own: true, ..Span::new(start, len, later) }
    }
}

/// Neighbours of a point, ascending.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    point: u32,
    /// Modulo 2^32.
    steps: &'a [u32],
}

impl<'a> Row<'a> {
    pub(super) fn new(point: usize, steps: &'a [u32]) -> Row<'a> {
        Row { point: point as u32, steps }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// The neighbour at a place of the row.
    ///
    /// # Panics
    /// If the row is shorter.
    #[inline(always)]
    pub fn at(&self, place: usize) -> u32 {
        self.point.wrapping_add(self.steps[place])
    }

    /// The last one.
    pub fn last(&self) -> Option<u32> {
        self.steps.last().map(|step| self.point.wrapping_add(*step))
    }

    /// One after the other.
    #[inline(always)]
    pub fn iter(&self) -> Others<'a> {
        Others { point: self.point, steps: self.steps.iter() }
    }

    /// Whether a point is among them.
    pub fn contains(&self, point: u32) -> bool {
        self.place(point).is_some()
    }

    /// How many come before a point, in numbers.
    pub fn before(&self, point: u32) -> usize {
        self.steps.partition_point(|step| self.point.wrapping_add(*step) < point)
    }

    /// At which place of the row a point is.
    pub fn place(&self, point: u32) -> Option<usize> {
        let place = self.before(point);
        (place < self.len() && self.at(place) == point).then_some(place)
    }

    /// Those up to a point, which is the last if it is among them.
    pub fn up_to(&self, point: u32) -> Row<'a> {
        let end = self.steps.partition_point(|step| self.point.wrapping_add(*step) <= point);
        Row { point: self.point, steps: &self.steps[..end] }
    }

    /// As a list.
    pub fn to_vec(&self) -> Vec<u32> {
        self.iter().collect()
    }
}

impl<'a> IntoIterator for Row<'a> {
    type Item = u32;
    type IntoIter = Others<'a>;

    #[inline(always)]
    fn into_iter(self) -> Others<'a> {
        self.iter()
    }
}

/// The place of one step in the rows of several points. Most points of a lattice share their steps with those beside
/// them, and a place is looked for where they do not.
#[derive(Default)]
pub(crate) struct PlaceOfStep<'a> {
    last: Option<(&'a [u32], usize)>,
}

impl<'a> PlaceOfStep<'a> {
    /// How many come before a point. All calls are for points as far from that of their row: the step.
    #[inline(always)]
    pub(crate) fn before(&mut self, row: Row<'a>, point: u32) -> usize {
        match self.last {
            Some((steps, place)) if std::ptr::eq(steps, row.steps) => {
                debug_assert_eq!(place, row.before(point));
                place
            }
            _ => {
                let place = row.before(point);
                self.last = Some((row.steps, place));
                place
            }
        }
    }
}

/// Neighbours one after the other.
#[derive(Clone, Debug)]
pub struct Others<'a> {
    point: u32,
    steps: std::slice::Iter<'a, u32>,
}

impl Iterator for Others<'_> {
    type Item = u32;

    #[inline(always)]
    fn next(&mut self) -> Option<u32> {
        self.steps.next().map(|step| self.point.wrapping_add(*step))
    }

    #[inline(always)]
    fn nth(&mut self, n: usize) -> Option<u32> {
        self.steps.nth(n).map(|step| self.point.wrapping_add(*step))
    }

    #[inline(always)]
    fn size_hint(&self) -> (usize, Option<usize>) {
        self.steps.size_hint()
    }
}

impl ExactSizeIterator for Others<'_> {}

impl DoubleEndedIterator for Others<'_> {
    #[inline(always)]
    fn next_back(&mut self) -> Option<u32> {
        self.steps.next_back().map(|step| self.point.wrapping_add(*step))
    }
}
