//! Lattice bodies: boxes filled with equally spaced points, and what an endless lattice would count.

mod shells;

use std::ops::Range;

pub use shells::{Shell, shells};

use crate::kernel::Measure;
use crate::words::Words;

/// Where the points of a lattice sit in the cells of its box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nodes {
    /// At the centres of the cells: coordinate `lo + (i + 1/2)*spacing`. Each has a cell.
    Cells,
    /// At the corners of the cells: coordinate `lo + i*spacing`, the faces of the box included. Each
    /// has what of a cell around it lies in the box: on a face a half, on an edge a quarter (in two
    /// dimensions half and quarter on sides and corners), on a corner an eighth.
    Corners,
    /// At the corners of the cells, each with a whole cell, as the papers have them: the body is
    /// heavier than its box.
    CornersFull,
}

impl Words for Nodes {
    const WORDS: &'static [(&'static str, Nodes)] = &[
        ("cells", Nodes::Cells),
        ("corners", Nodes::Corners),
        ("corners-full", Nodes::CornersFull),
    ];
}

impl Nodes {
    /// How many points there are along an axis of so many cells.
    pub fn along(self, cells: f64) -> f64 {
        match self {
            Nodes::Cells => cells,
            Nodes::Corners | Nodes::CornersFull => cells + 1.0,
        }
    }

    /// Where the first point of an axis is, in cells.
    fn offset(self) -> f64 {
        match self {
            Nodes::Cells => 0.5,
            Nodes::Corners | Nodes::CornersFull => 0.0,
        }
    }

    /// How much of a cell the point at this place of an axis has.
    fn share(self, place: usize, count: usize) -> f64 {
        let at_end = place == 0 || place + 1 == count;
        if self == Nodes::Corners && at_end { 0.5 } else { 1.0 }
    }
}

/// A box on a lattice of equal cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    /// One corner of the box, `d` numbers in m.
    pub lower: Vec<f64>,
    /// The opposite corner, in m; each coordinate may be on either side of `lower`.
    pub upper: Vec<f64>,
    /// Edge of a cell in m; every extent is a whole number of cells to within 1e-6.
    pub spacing: f64,
    /// Where the points sit.
    pub nodes: Nodes,
}

/// The points of a lattice in the user's order: the last axis runs fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct LatticePoints {
    /// 2 or 3.
    pub dimension: usize,
    /// How many points there are along each axis.
    pub counts: Vec<usize>,
    /// Positions, `n x d` row by row, in m.
    pub positions: Vec<f64>,
    /// Volumes in m^d: `spacing^d` times the part of a cell that each point has.
    pub volumes: Vec<f64>,
}

/// Why a box is not a lattice.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LatticeError {
    /// The corners do not have two or three coordinates.
    #[error(
        "the corners of a box need two or three coordinates each, but have {lower} and {upper}: \
         write box = [[x, y], [x, y]] or [[x, y, z], [x, y, z]]"
    )]
    Dimension {
        /// Coordinates of the one corner.
        lower: usize,
        /// Coordinates of the other.
        upper: usize,
    },
    /// The spacing is not a positive number.
    #[error("the spacing is {spacing} m: it must be a positive finite length")]
    Spacing {
        /// What was given.
        spacing: f64,
    },
    /// The box has no extent, or an endless one.
    #[error(
        "the box reaches from {lower} m to {upper} m along {axis}: its corners must be finite and apart"
    )]
    Extent {
        /// `x`, `y` or `z`.
        axis: char,
        /// Coordinate of one corner.
        lower: f64,
        /// Coordinate of the other.
        upper: f64,
    },
    /// The extent is not a whole number of cells.
    #[error(
        "the extent {extent} m along {axis} is {cells} times the spacing {spacing} m: make it a whole \
         number of spacings, for example a spacing of {suggestion} m"
    )]
    Fraction {
        /// `x`, `y` or `z`.
        axis: char,
        /// Extent of the box in m.
        extent: f64,
        /// Spacing in m.
        spacing: f64,
        /// Their ratio.
        cells: f64,
        /// The nearest spacing that divides the extent.
        suggestion: f64,
    },
    /// More points than can be numbered.
    #[error(
        "the box holds {points:e} points, more than the {max} that can be numbered: take a larger spacing"
    )]
    TooMany {
        /// How many points there would be.
        points: f64,
        /// The most that can be numbered.
        max: u32,
    },
}

/// How far the ratio of extent to spacing may be from a whole number.
const WHOLE: f64 = 1e-6;

impl Lattice {
    /// How many points there are along each axis.
    pub fn counts(&self) -> Result<Vec<usize>, LatticeError> {
        let dimension = self.lower.len();
        if dimension != self.upper.len() || !(2..=3).contains(&dimension) {
            return Err(LatticeError::Dimension { lower: dimension, upper: self.upper.len() });
        }
        if !(self.spacing > 0.0 && self.spacing.is_finite()) {
            return Err(LatticeError::Spacing { spacing: self.spacing });
        }
        let mut total = 1.0;
        let mut counts = Vec::with_capacity(dimension);
        for axis in 0..dimension {
            let nodes = self.nodes.along(self.cells(axis)?);
            total *= nodes;
            // A product is checked before any number is narrowed.
            if total > f64::from(u32::MAX) {
                return Err(LatticeError::TooMany { points: total, max: u32::MAX });
            }
            counts.push(nodes as usize);
        }
        Ok(counts)
    }

    /// All points of the box, last axis fastest.
    pub fn points(&self) -> Result<LatticePoints, LatticeError> {
        let counts = self.counts()?;
        let all: Vec<Range<usize>> = counts.iter().map(|count| 0..*count).collect();
        Ok(self.block(&counts, &all))
    }

    /// Those points that are in these places along each axis, last axis fastest; `counts` are those of the box.
    pub fn block(&self, counts: &[usize], places: &[Range<usize>]) -> LatticePoints {
        let dimension = counts.len();
        let total: usize = places.iter().map(ExactSizeIterator::len).product();
        let cell = (0..dimension).fold(1.0, |product, _| product * self.spacing);
        let mut positions = Vec::with_capacity(total * dimension);
        let mut volumes = Vec::with_capacity(total);
        let mut index: Vec<usize> = places.iter().map(|places| places.start).collect();
        for _ in 0..total {
            let mut volume = cell;
            for axis in 0..dimension {
                positions.push(self.coordinate(axis, index[axis]));
                volume *= self.nodes.share(index[axis], counts[axis]);
            }
            volumes.push(volume);
            for axis in (0..dimension).rev() {
                index[axis] += 1;
                if index[axis] < places[axis].end {
                    break;
                }
                index[axis] = places[axis].start;
            }
        }
        let counts = places.iter().map(ExactSizeIterator::len).collect();
        LatticePoints { dimension, counts, positions, volumes }
    }

    /// Where the points with this place along an axis are on it, in m.
    pub fn coordinate(&self, axis: usize, place: usize) -> f64 {
        let lower = self.lower[axis].min(self.upper[axis]);
        lower + (place as f64 + self.nodes.offset()) * self.spacing
    }

    /// The whole number of cells along an axis.
    fn cells(&self, axis: usize) -> Result<f64, LatticeError> {
        let (lower, upper) = (self.lower[axis], self.upper[axis]);
        let extent = (upper - lower).abs();
        let name = ['x', 'y', 'z'][axis];
        if !(extent > 0.0 && extent.is_finite()) {
            return Err(LatticeError::Extent { axis: name, lower, upper });
        }
        let cells = extent / self.spacing;
        let whole = cells.round();
        if whole < 1.0 || (cells - whole).abs() > WHOLE {
            let (spacing, suggestion) = (self.spacing, extent / whole.max(1.0));
            return Err(LatticeError::Fraction { axis: name, extent, spacing, cells, suggestion });
        }
        Ok(whole)
    }
}

/// Ordered neighbours, pairs and triples of a point of an endless lattice, as the papers count
/// them: all members within the horizon of the point and of each other, collinear pairs and
/// coplanar triples left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BulkCounts {
    /// `#N1`: neighbours; each bond is counted by 2 points.
    pub neighbors: u64,
    /// `#N2`: ordered pairs; each triangle is counted 6 times.
    pub pairs: u64,
    /// `#N3`: ordered triples; each tetrahedron is counted 24 times.
    pub triples: u64,
}

/// Counts of the endless lattice with `horizon = ratio*spacing`, in exact integer arithmetic; the
/// horizon includes its shell as everywhere (see [`crate::neighborhood::HORIZON_TOLERANCE`]).
pub fn bulk_counts(dimension: usize, ratio: f64) -> BulkCounts {
    BulkCounts {
        neighbors: bulk_count(dimension, ratio, Measure::Length),
        pairs: bulk_count(dimension, ratio, Measure::Area),
        triples: bulk_count(dimension, ratio, Measure::Volume),
    }
}

/// One of them alone, without the work of the others.
pub(crate) fn bulk_count(dimension: usize, ratio: f64, measure: Measure) -> u64 {
    ordered(measure, &shells(dimension, ratio, measure))
}

/// How many ordered neighbours, pairs or triples of a point the cliques of these shells are.
pub fn ordered(measure: Measure, shells: &[Shell]) -> u64 {
    let orders: u64 = (1..=measure.points() as u64).product();
    orders * shells.iter().map(|shell| shell.count).sum::<u64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square_lattice(spacing: f64, nodes: Nodes) -> Lattice {
        Lattice { lower: vec![0.0, 0.0], upper: vec![1.0, 0.5], spacing, nodes }
    }

    #[test]
    fn corners_include_the_faces_and_the_last_axis_is_fastest() {
        let points = square_lattice(0.25, Nodes::Corners).points().unwrap();
        assert_eq!(points.counts, [5, 3]);
        assert_eq!(points.positions[..8], [0.0, 0.0, 0.0, 0.25, 0.0, 0.5, 0.25, 0.0]);
        assert_eq!(points.positions[28..], [1.0, 0.5]);
        // Five columns and three rows of cells of 1/16 m^2.
        let column = |part: f64| [part / 32.0, part / 16.0, part / 32.0];
        assert_eq!(points.volumes, [0.5, 1.0, 1.0, 1.0, 0.5].map(column).as_flattened());
        let full = square_lattice(0.25, Nodes::CornersFull).points().unwrap();
        assert_eq!(full.positions, points.positions);
        assert!(full.volumes.iter().all(|&v| v == 0.0625));
    }

    #[test]
    fn volumes_sum_to_the_box() {
        let upper = vec![1.0, 0.5, 0.75];
        for nodes in [Nodes::Cells, Nodes::Corners, Nodes::CornersFull] {
            let cube = Lattice { lower: vec![0.0; 3], upper: upper.clone(), spacing: 0.125, nodes };
            let points = cube.points().unwrap();
            let sum: f64 = points.volumes.iter().sum();
            // All numbers are multiples of 2^-12.
            let expected =
                if nodes == Nodes::CornersFull { 9.0 * 5.0 * 7.0 / 512.0 } else { 0.375 };
            assert_eq!(sum, expected, "{nodes:?}");
            let least = points.volumes.iter().copied().fold(1.0, f64::min) * 512.0;
            assert_eq!(least, if nodes == Nodes::Corners { 0.125 } else { 1.0 }, "{nodes:?}");
        }
    }

    #[test]
    fn cells_have_their_centres() {
        let points = square_lattice(0.25, Nodes::Cells).points().unwrap();
        assert_eq!(points.counts, [4, 2]);
        assert_eq!(points.positions[..4], [0.125, 0.125, 0.125, 0.375]);
        assert_eq!(points.volumes.len(), 8);
    }

    #[test]
    fn corners_may_be_given_in_any_order() {
        let swapped = Lattice {
            lower: vec![1.0, 0.0],
            upper: vec![0.0, 0.5],
            ..square_lattice(0.25, Nodes::Corners)
        };
        assert_eq!(swapped.points(), square_lattice(0.25, Nodes::Corners).points());
    }

    #[test]
    fn wrong_boxes_are_named() {
        let error = square_lattice(0.3, Nodes::Corners).points().unwrap_err();
        assert!(matches!(error, LatticeError::Fraction { axis: 'x', .. }));
        let text = error.to_string();
        assert!(text.contains("extent 1 m") && text.contains("spacing 0.3 m"), "{text}");
        for spacing in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = square_lattice(spacing, Nodes::Cells).points().unwrap_err();
            assert!(matches!(error, LatticeError::Spacing { .. }));
        }
        let flat = Lattice { upper: vec![1.0, 0.0], ..square_lattice(0.25, Nodes::Corners) };
        assert!(matches!(flat.points(), Err(LatticeError::Extent { axis: 'y', .. })));
        let line = Lattice { upper: vec![1.0], ..square_lattice(0.25, Nodes::Corners) };
        assert!(matches!(line.points(), Err(LatticeError::Dimension { lower: 2, upper: 1 })));
        let huge = square_lattice(1.0 / 131072.0, Nodes::Cells);
        assert!(matches!(huge.points(), Err(LatticeError::TooMany { .. })));
    }

    #[test]
    fn an_extent_may_miss_a_whole_number_by_a_millionth() {
        let nearly = Lattice { upper: vec![1.0 + 2e-7, 0.5], ..square_lattice(0.25, Nodes::Cells) };
        assert_eq!(nearly.counts().unwrap(), [4, 2]);
        let not = Lattice { upper: vec![1.0 + 3e-7, 0.5], ..square_lattice(0.25, Nodes::Cells) };
        assert!(not.counts().is_err());
    }
}
