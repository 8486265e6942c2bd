//! When which slab is visited, and what it may write to.
//!
//! A slab writes to its own rows and to those of the next. Even slabs share none and go at once; an
//! odd one waits for its two neighbours and for no other, so that threads are seldom idle, and is
//! visited by whoever has finished the second of them. Each row gets what its even slab has for it
//! before what its odd slab has: the same sums for any number of threads.
//!
//! Arrays are halved together with the slabs until one even slab and the odd one after it are left.
//! Where halves meet an odd slab waits on the stack of the halving: nothing is allocated.

use std::ops::{Index, IndexMut, Range};
use std::sync::Mutex;

use super::Slabs;
use crate::pool::lock;

/// What can be cut between slabs.
pub(crate) trait Cut: Send + Sized {
    /// What belongs to the slabs before `slab`, and to it and those after it.
    fn cut(self, slabs: &Slabs, slab: usize) -> (Self, Self);
}

macro_rules! cut_each {
    ($($name:ident),*) => {
        impl<$($name: Cut),*> Cut for ($($name,)*) {
            #[allow(non_snake_case, unused_variables)]
            fn cut(self, slabs: &Slabs, slab: usize) -> (Self, Self) {
                let ($($name,)*) = self;
                $(let $name = $name.cut(slabs, slab);)*
                (($($name.0,)*), ($($name.1,)*))
            }
        }
    };
}

cut_each!();
cut_each!(A, B);
cut_each!(A, B, C);
cut_each!(A, B, C, E, F);

/// How many entries of an array belong to the points of a slab.
#[derive(Clone, Copy)]
pub(crate) enum Layout<'a> {
    /// One in all.
    Slabs,
    /// So many for each point.
    Points(usize),
    /// The array says where the rows of points start, counted in pieces of so many entries.
    Rows(&'a [usize], usize),
}

/// The entries of an array that belong to some slabs. An array that is not wanted is empty.
pub(crate) struct Part<'a, T> {
    layout: Layout<'a>,
    /// The number of its first entry.
    first: usize,
    values: &'a mut [T],
}

impl<'a, T> Part<'a, T> {
    /// The entries of all slabs.
    pub(crate) fn new(layout: Layout<'a>, values: &'a mut [T]) -> Part<'a, T> {
        Part { layout, first: 0, values }
    }

    /// The entries.
    pub(crate) fn into_values(self) -> &'a mut [T] {
        self.values
    }
}

impl<T: Send> Cut for Part<'_, T> {
    fn cut(self, slabs: &Slabs, slab: usize) -> (Self, Self) {
        let Part { layout, first, values } = self;
        let point = slabs.start(slab);
        let start = match layout {
            Layout::Slabs => slab,
            Layout::Points(width) => point * width,
            Layout::Rows(start, width) => start[point] * width,
        };
        let (before, after) = values.split_at_mut((start - first).min(values.len()));
        (Part { layout, first, values: before }, Part { layout, first: start, values: after })
    }
}

/// The entries that a slab may write to, by their numbers in the whole array: its own and those of
/// the next slab.
pub(crate) struct Touched<'a, T> {
    first: usize,
    /// The number of the first entry of the next slab.
    middle: usize,
    own: &'a mut [T],
    next: &'a mut [T],
}

impl<'a, T> Touched<'a, T> {
    pub(crate) fn new(own: &'a mut Part<'_, T>, next: &'a mut Part<'_, T>) -> Touched<'a, T> {
        Touched { first: own.first, middle: next.first, own: own.values, next: next.values }
    }

    /// Whether the array is not wanted.
    pub(crate) fn is_empty(&self) -> bool {
        self.own.is_empty()
    }

    /// Some entries of one point.
    #[inline(always)]
    pub(crate) fn range(&mut self, entries: Range<usize>) -> &mut [T] {
        let (first, part) = self.part_of_mut(entries.start);
        &mut part[entries.start - first..entries.end - first]
    }

    /// The entries of the slab that has this one, and the number of the first of them. Addresses are
    /// chosen, not ways to go: no branch in inner loops.
    #[inline(always)]
    fn part_of_mut(&mut self, entry: usize) -> (usize, &mut [T]) {
        if entry < self.middle {
            (self.first, &mut *self.own)
        } else {
            (self.middle, &mut *self.next)
        }
    }
}

impl<T> Touched<'_, T> {
    /// An entry of the slab's own and a later one.
    #[inline(always)]
    pub(crate) fn pair(&mut self, own: usize, later: usize) -> [&mut T; 2] {
        if later < self.middle {
            let (before, after) = self.own.split_at_mut(later - self.first);
            [&mut before[own - self.first], &mut after[0]]
        } else {
            [&mut self.own[own - self.first], &mut self.next[later - self.middle]]
        }
    }
}

impl<T: Copy> Touched<'_, T> {
    /// Makes all entries the same.
    pub(crate) fn fill(&mut self, value: T) {
        self.own.fill(value);
        self.next.fill(value);
    }
}

impl<T> Index<usize> for Touched<'_, T> {
    type Output = T;

    #[inline(always)]
    fn index(&self, entry: usize) -> &T {
        if entry < self.middle {
            &self.own[entry - self.first]
        } else {
            &self.next[entry - self.middle]
        }
    }
}

impl<T> IndexMut<usize> for Touched<'_, T> {
    #[inline(always)]
    fn index_mut(&mut self, entry: usize) -> &mut T {
        let (first, part) = self.part_of_mut(entry);
        &mut part[entry - first]
    }
}

/// Visits all slabs, each odd one after its neighbours: with the parts of `shared` that belong to it
/// and to the next slab, and with its own part of `own`, which no other slab is given.
pub(crate) fn visit<P: Cut, B: Cut>(
    slabs: &Slabs,
    shared: P,
    own: B,
    run: impl Fn(usize, [&mut P; 2], B) + Sync,
) {
    if !slabs.is_empty() {
        Schedule { slabs, run }.all(0..slabs.len(), shared, own, [None, None]);
    }
}

struct Schedule<'a, F> {
    slabs: &'a Slabs,
    run: F,
}

/// An odd slab between its neighbours.
struct Gap<P, B>(Mutex<Waiting<P, B>>);

/// What an odd slab waits for.
struct Waiting<P, B> {
    /// From the neighbour before it: its own parts.
    own: Option<(P, B)>,
    /// From the neighbour after it: the part of that.
    next: Option<P>,
}

impl<F> Schedule<'_, F> {
    /// Visits slabs of which the first is even, and the odd ones beside them if their other
    /// neighbours are done.
    fn all<P: Cut, B: Cut>(
        &self,
        range: Range<usize>,
        shared: P,
        own: B,
        [before, after]: [Option<&Gap<P, B>>; 2],
    ) where
        F: Fn(usize, [&mut P; 2], B) + Sync,
    {
        let even = range.start;
        if range.len() > 2 {
            let middle = even + 2 * range.len().div_ceil(4);
            let (low, high) = shared.cut(self.slabs, middle);
            let (own_low, own_high) = own.cut(self.slabs, middle);
            let gap = Gap(Mutex::new(Waiting { own: None, next: None }));
            rayon::join(
                || self.all(even..middle, low, own_low, [before, Some(&gap)]),
                || self.all(middle..range.end, high, own_high, [Some(&gap), after]),
            );
            return;
        }
        let (mut here, mut next) = shared.cut(self.slabs, even + 1);
        let (own, of_odd) = own.cut(self.slabs, even + 1);
        (self.run)(even, [&mut here, &mut next], own);
        if let Some(gap) = before {
            lock(&gap.0).next = Some(here);
        }
        // The last slab has no other neighbour.
        let mut last = None;
        match after {
            Some(gap) => lock(&gap.0).own = Some((next, of_odd)),
            None => last = (range.len() == 2).then_some((next, of_odd)),
        }
        let fill = |gap: Option<&Gap<P, B>>, odd: usize| {
            if let Some(gap) = gap {
                self.fill(gap, odd);
            }
        };
        // Both may be ready now: a thread that waits takes one of them.
        rayon::join(
            || fill(before, even.saturating_sub(1)),
            || {
                fill(after, even + 1);
                if let Some((next, own)) = last {
                    let (mut here, mut nothing) = next.cut(self.slabs, even + 2);
                    (self.run)(even + 1, [&mut here, &mut nothing], own);
                }
            },
        );
    }

    /// Visits the odd slab of a gap if both its neighbours are done.
    fn fill<P, B>(&self, gap: &Gap<P, B>, odd: usize)
    where
        F: Fn(usize, [&mut P; 2], B) + Sync,
    {
        let mut waiting = lock(&gap.0);
        if waiting.own.is_none() || waiting.next.is_none() {
            return;
        }
        let (own, next) = (waiting.own.take(), waiting.next.take());
        drop(waiting);
        if let (Some((mut here, own)), Some(mut next)) = (own, next) {
            (self.run)(odd, [&mut here, &mut next], own);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_visited_once_and_odd_ones_after_their_neighbours() {
        for n in 0..12 {
            // Slabs of two points each.
            let last = |point: usize| if point == 0 { 1 } else { point / 2 * 2 + 3 };
            let slabs = Slabs::reaching(2 * n, |point| last(point).min(2 * n - 1));
            assert_eq!(slabs.len(), n);
            let order = Mutex::new(Vec::new());
            let (mut rows, mut numbers) = (vec![[0; 2]; 2 * n], vec![0; n]);
            let shared = Part::new(Layout::Points(1), &mut rows);
            let own = Part::new(Layout::Slabs, &mut numbers);
            visit(&slabs, shared, own, |slab, [here, next], own| {
                order.lock().unwrap().push(slab);
                let mut rows = Touched::new(here, next);
                for point in slabs.touched(slab) {
                    // The last to write, and how many have.
                    rows[point] = [slab, rows[point][1] + 1];
                }
                own.into_values()[0] = 10 * slab;
            });
            assert_eq!(numbers, (0..n).map(|slab| 10 * slab).collect::<Vec<_>>());
            let order = order.into_inner().unwrap();
            assert_eq!(order.len(), n);
            let at = |slab: usize| order.iter().position(|&other| other == slab);
            for odd in (1..n).step_by(2) {
                // Of a slab that there is not the place is `None`, less than any.
                assert!(at(odd - 1) < at(odd) && at(odd + 1) < at(odd), "{order:?}");
            }
            for (point, [last, count]) in rows.into_iter().enumerate() {
                let slab = point / 2;
                // Of a slab and the one before it the odd one.
                let odd = if slab % 2 == 1 { slab } else { slab.saturating_sub(1) };
                assert_eq!((last, count), (odd, if slab == 0 { 1 } else { 2 }));
            }
        }
    }
}
