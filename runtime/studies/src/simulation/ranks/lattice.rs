//! A lattice that is whole nowhere: each rank makes the layers that it holds.

use std::ops::Range;

use piola_grammar::Diagnostic;
use piola_mechanics::body::{Body, SlabCut};
use piola_mechanics::lattice::{Lattice, LatticePoints};
use piola_petsc::Engine;

use super::share::{MARGIN, Share};
use crate::case::{CaseError, size};
use crate::scene::selection::{kept_of, nothing_left};
use crate::scene::{LatticeShape, Scene};

/// A body differs in length along two axes where one is longer by this part, as [`Body::new`] has it.
const LONGER: f64 = 1.0 + 1e-9;

/// The layers of a lattice along each axis, with the points that are left in each.
pub(super) struct Layers<'a> {
    scene: &'a Scene,
    lattice: Lattice,
    counts: Vec<usize>,
    /// By axis and layer.
    left: Vec<Vec<usize>>,
    axis: usize,
    /// Along the axis, how many points there are before each layer, and at the end how many in all.
    before: Vec<usize>,
}

impl<'a> Layers<'a> {
    /// Those of a box; ranks count what is removed in parts. Collective.
    ///
    /// # Errors
    /// On all ranks: a box that is none; one of which nothing is left.
    pub(super) fn count(
        scene: &'a Scene,
        shape: &LatticeShape,
        engine: &Engine,
    ) -> Result<Layers<'a>, CaseError> {
        let lattice = shape.lattice();
        let counts = lattice.counts()?;
        let total: usize = counts.iter().product();
        let full = |count: &usize| vec![total / count; *count];
        let left = counts.iter().map(full).collect();
        let mut layers = Layers { scene, lattice, counts, left, axis: 0, before: Vec::new() };
        if !scene.body.remove.is_empty() {
            layers.left = layers.counted(engine);
        }
        if layers.left[0].iter().all(|left| *left == 0) {
            return Err(nothing_left(scene, &layers.ends()).into());
        }
        for axis in 1..layers.counts.len() {
            if layers.extent(axis) > layers.extent(layers.axis) * LONGER {
                layers.axis = axis;
            }
        }
        layers.before = layers.left[layers.axis].iter().fold(vec![0], |mut before, left| {
            before.push(before[before.len() - 1] + left);
            before
        });
        Ok(layers)
    }

    /// How many points are left in all.
    pub(super) fn n_points(&self) -> usize {
        self.before[self.before.len() - 1]
    }

    /// What is left in each layer along each axis, of which each rank looks at a part. Collective.
    fn counted(&self, engine: &Engine) -> Vec<Vec<usize>> {
        let (n, rank, ranks) = (self.n_rows(), engine.rank(), engine.ranks());
        let mut numbers: Vec<Vec<f64>> = self.counts.iter().map(|n| vec![0.0; *n]).collect();
        for row in n * rank / ranks..n * (rank + 1) / ranks {
            let (places, is_left) = self.row(row);
            for (point, is_left) in is_left.into_iter().enumerate() {
                for (axis, place) in places_of(point, &places).into_iter().enumerate() {
                    numbers[axis][place] += f64::from(is_left);
                }
            }
        }
        numbers.iter_mut().for_each(|numbers| engine.sum(numbers));
        let count = |numbers: Vec<f64>| numbers.into_iter().map(|n| n as usize).collect();
        numbers.into_iter().map(count).collect()
    }

    /// Two corners of the box, where its outermost points are.
    fn ends(&self) -> Vec<f64> {
        let d = self.counts.len();
        let end = |k: usize| {
            let (axis, last) = (k % d, self.counts[k % d] - 1);
            self.lattice.coordinate(axis, if k < d { 0 } else { last })
        };
        (0..2 * d).map(end).collect()
    }

    /// How many rows along the last axis the box has.
    fn n_rows(&self) -> usize {
        self.counts[..self.counts.len() - 1].iter().product()
    }

    /// Where a row is, in the user's order of rows, and which of its points are left.
    fn row(&self, row: usize) -> (Vec<Range<usize>>, Vec<bool>) {
        let last = self.counts.len() - 1;
        let rows: Vec<Range<usize>> = self.counts[..last].iter().map(|n| 0..*n).collect();
        let mut places: Vec<Range<usize>> =
            places_of(row, &rows).into_iter().map(|place| place..place + 1).collect();
        places.push(0..self.counts[last]);
        let is_left = self.is_left(&self.lattice.block(&self.counts, &places));
        (places, is_left)
    }

    /// Which points of a block are left.
    fn is_left(&self, block: &LatticePoints) -> Vec<bool> {
        let d = self.counts.len();
        let is_left = |x: &[f64]| !self.scene.body.remove.iter().any(|one| one.holds(x));
        block.positions.chunks_exact(d).map(is_left).collect()
    }

    fn coordinate(&self, layer: usize) -> f64 {
        self.lattice.coordinate(self.axis, layer)
    }

    /// Of the points that are left, along an axis.
    fn extent(&self, axis: usize) -> f64 {
        let ends = [
            self.left[axis].iter().position(|n| *n > 0),
            self.left[axis].iter().rposition(|n| *n > 0),
        ];
        let [first, last] = ends.map(|end| self.lattice.coordinate(axis, end.unwrap_or(0)));
        last - first
    }

    /// The layer of a point by its number in the body's order.
    fn layer_of(&self, point: usize) -> usize {
        self.before.partition_point(|before| *before <= point) - 1
    }

    /// What a rank has of the body, as [`Share::of`] does it of a body that is there, and the layers that it holds.
    pub(super) fn share(&self, reach: f64, (rank, ranks): (usize, usize)) -> (Share, Range<usize>) {
        let ranges = Share::ranges(self.n_points(), ranks);
        let own = ranges[rank] as usize..ranges[rank + 1] as usize;
        let [first, last] = [self.layer_of(own.start), self.layer_of(own.end - 1)];
        let reach = reach * (1.0 + MARGIN);
        let is_near = |a: usize, b: usize| self.coordinate(b) - self.coordinate(a) <= reach;
        let from = (0..=first).find(|layer| is_near(*layer, first)).unwrap_or(first);
        let to = (last..self.before.len() - 1).take_while(|layer| is_near(last, *layer)).last();
        let layers = from..to.unwrap_or(last) + 1;
        let held = self.before[layers.start]..self.before[layers.end];
        (Share { ranges, own, held }, layers)
    }

    /// The body of these layers, and what is said of them where points are removed.
    ///
    /// # Errors
    /// More points than the memory holds.
    pub(super) fn slab(
        &self,
        share: &Share,
        layers: Range<usize>,
        horizon: f64,
    ) -> Result<(Body, Vec<Diagnostic>), CaseError> {
        let (d, axis) = (self.counts.len(), self.axis);
        let mut places: Vec<Range<usize>> = self.counts.iter().map(|n| 0..*n).collect();
        places[axis] = layers.clone();
        // Those that are removed are looked at, too.
        let looked_at = places.iter().map(|places| places.len() as f64).product();
        size::check_points(looked_at, d, "of the layers of a rank")?;
        let block = self.lattice.block(&self.counts, &places);
        let spacing = Some(self.lattice.spacing);
        let positions = (&block.positions[..], &self.ends()[..]);
        let kept = kept_of(self.scene, positions, &block.volumes, spacing)?;
        let numbers = self.numbers(&places, &kept.keep);
        // Sorted by layers, in each in the user's order.
        let mut order: Vec<usize> =
            (0..kept.keep.len()).filter(|point| kept.keep[*point]).collect();
        if axis > 0 {
            order.sort_by_key(|point| places_of(*point, &places)[axis]);
        }
        let positions = order.iter().flat_map(|point| &block.positions[point * d..][..d]).copied();
        let volumes = order.iter().map(|point| block.volumes[*point]).collect();
        let user_index = order.iter().map(|point| numbers[*point]).collect();
        let left = |layer: &usize| self.left[axis][*layer] > 0;
        let cut = SlabCut {
            own: share.own_of_held(),
            before: (0..layers.start).rev().find(left).map(|layer| self.coordinate(layer)),
            behind: (layers.end..self.counts[axis]).find(left).map(|layer| self.coordinate(layer)),
            horizon,
        };
        let points = (positions.collect(), volumes);
        Ok((Body::slab((d, axis), points, spacing, user_index, cut), kept.warnings))
    }

    /// The numbers, in the user's order of the whole body, of the points of a block that are left.
    fn numbers(&self, places: &[Range<usize>], keep: &[bool]) -> Vec<u32> {
        let is_whole =
            self.left[self.axis].iter().sum::<usize>() == self.counts.iter().product::<usize>();
        if is_whole {
            let number = |point: usize| {
                let place = places_of(point, places).into_iter().zip(&self.counts);
                place.fold(0, |number, (place, count)| number * count + place) as u32
            };
            return (0..keep.len()).map(number).collect();
        }
        if self.axis == 0 {
            // The user's order is that of the body.
            let mut next = self.before[places[0].start] as u32;
            let numbered = keep.iter().map(|is_left| {
                next += u32::from(*is_left);
                next.wrapping_sub(1)
            });
            return numbered.collect();
        }
        // Of all that is before a point it must be known whether it is left: looked at row by row.
        let mut numbers = Vec::with_capacity(keep.len());
        let mut next = 0;
        for row in 0..self.n_rows() {
            let (all, is_left) = self.row(row);
            for (point, is_left) in is_left.into_iter().enumerate() {
                if places[self.axis].contains(&places_of(point, &all)[self.axis]) {
                    numbers.push(next);
                }
                next += u32::from(is_left);
            }
        }
        numbers
    }
}

/// The place along each axis of a point of a block, by its number there.
fn places_of(mut point: usize, places: &[Range<usize>]) -> Vec<usize> {
    let mut found: Vec<usize> = places
        .iter()
        .rev()
        .map(|places| {
            let place = places.start + point % places.len();
            point /= places.len();
            place
        })
        .collect();
    found.reverse();
    found
}
