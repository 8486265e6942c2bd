//! A body: points with volumes, in two or three dimensions.

use std::ops::Range;

/// Points with volumes.
///
/// Points are kept sorted along the body's longest axis (ties in the user's order), so that a
/// range of indices is a slab of the body; [`Body::user_index`] leads back to the user's order.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    dimension: usize,
    /// Reference positions, `n x d` row by row, in m.
    positions: Vec<f64>,
    /// Point volumes in m^d.
    volumes: Vec<f64>,
    /// Lattice spacing in m, if the points are a lattice.
    spacing: Option<f64>,
    /// Place of each point in the user's order.
    user_index: Vec<u32>,
    /// The axis along which the points are sorted.
    sorted_axis: usize,
    /// Where it is a slab of a body.
    slab: Option<Slab>,
}

/// What a slab knows of the body that it is of.
#[derive(Clone, Debug, PartialEq)]
struct Slab {
    /// The order of its points among themselves, as the user's.
    places: Vec<u32>,
    /// Those of its points that no other slab of the body has as its own.
    own: Range<usize>,
    /// Of each point, whether its family goes on beyond the slab.
    is_cut: Vec<bool>,
    /// The largest number of neighbours of a point of the whole body, where that is known.
    most_neighbors: Option<usize>,
}

/// Where a slab is cut out of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct SlabCut {
    /// Those of its points that count as its own, in its order.
    pub own: Range<usize>,
    /// Where the last point of the body before the slab is along the sorted axis, in m, if there is one.
    pub before: Option<f64>,
    /// Where the first point behind it is.
    pub behind: Option<f64>,
    /// How far families reach, in m: those of points as near to what is cut off may be of any kind.
    pub horizon: f64,
}

impl Body {
    /// Takes points in the user's order: `positions` is `n x d`, `volumes` has `n` entries.
    pub fn new(dimension: usize, positions: &[f64], volumes: &[f64], spacing: Option<f64>) -> Body {
        let n = volumes.len();
        assert_eq!(positions.len(), n * dimension, "positions are n x d");
        let extent = |axis: usize| {
            let column = || positions.iter().skip(axis).step_by(dimension).copied();
            column().fold(f64::NEG_INFINITY, f64::max) - column().fold(f64::INFINITY, f64::min)
        };
        let mut sorted_axis = 0;
        for axis in 1..dimension {
            if extent(axis) > extent(sorted_axis) * (1.0 + 1e-9) {
                sorted_axis = axis;
            }
        }
        let mut user_index: Vec<u32> = (0..n as u32).collect();
        let key = |p: &u32| positions[*p as usize * dimension + sorted_axis];
        user_index.sort_by(|p, q| key(p).total_cmp(&key(q)));
        let mut sorted = Vec::with_capacity(positions.len());
        for p in &user_index {
            sorted.extend_from_slice(&positions[*p as usize * dimension..][..dimension]);
        }
        Body {
            dimension,
            positions: sorted,
            volumes: user_index.iter().map(|p| volumes[*p as usize]).collect(),
            spacing,
            user_index,
            sorted_axis,
            slab: None,
        }
    }

    /// A slab of it as a body of its own: points `range` in the same order, with their places in the user's order of
    /// the whole body. Of these points `own` count as its own; others are there for what acts on them. Families reach
    /// as far as `horizon`, in m: those that the slab cuts may be of any kind.
    pub fn part(&self, range: Range<usize>, own: Range<usize>, horizon: f64) -> Body {
        assert!(range.start <= own.start && own.end <= range.end, "own points are of the slab");
        let d = self.dimension;
        let along = |point: usize| self.position(point)[self.sorted_axis];
        let cut = SlabCut {
            own: own.start - range.start..own.end - range.start,
            before: range.start.checked_sub(1).map(along),
            behind: (range.end < self.n_points()).then(|| along(range.end)),
            horizon,
        };
        let slab = Body {
            positions: self.positions[range.start * d..range.end * d].to_vec(),
            volumes: self.volumes[range.clone()].to_vec(),
            user_index: self.user_index[range].to_vec(),
            slab: None,
            ..*self
        };
        slab.cut(cut)
    }

    /// A slab of a body that is nowhere whole: `positions` are `n x d` in m, sorted along an axis (ties in the user's
    /// order), `user_index` are the places in the user's order of the whole body.
    pub fn slab(
        (dimension, sorted_axis): (usize, usize),
        (positions, volumes): (Vec<f64>, Vec<f64>),
        spacing: Option<f64>,
        user_index: Vec<u32>,
        cut: SlabCut,
    ) -> Body {
        assert_eq!(positions.len(), volumes.len() * dimension, "positions are n x d");
        let slab = None;
        Body { dimension, positions, volumes, spacing, user_index, sorted_axis, slab }.cut(cut)
    }

    fn cut(self, cut: SlabCut) -> Body {
        let user_index = &self.user_index;
        let mut order: Vec<u32> = (0..user_index.len() as u32).collect();
        order.sort_unstable_by_key(|point| user_index[*point as usize]);
        let mut places = vec![0; user_index.len()];
        (0..).zip(&order).for_each(|(place, point)| places[*point as usize] = place);
        let is_cut = |point: usize| {
            let x = self.position(point)[self.sorted_axis];
            cut.before.is_some_and(|before| x - before <= cut.horizon)
                || cut.behind.is_some_and(|behind| behind - x <= cut.horizon)
        };
        let is_cut = (0..self.n_points()).map(is_cut).collect();
        Body { slab: Some(Slab { places, own: cut.own, is_cut, most_neighbors: None }), ..self }
    }

    /// The same slab of a body of which no point has more neighbours than these.
    pub fn with_most_neighbors(mut self, most: usize) -> Body {
        if let Some(slab) = &mut self.slab {
            slab.most_neighbors = Some(most);
        }
        self
    }

    /// The largest number of neighbours of a point of the body that this is a slab of; nothing where it is whole.
    pub(crate) fn most_neighbors(&self) -> Option<usize> {
        self.slab.as_ref()?.most_neighbors
    }

    /// Whether the family of a point goes on beyond the slab that this is: what is asked of families is not asked of it.
    pub(crate) fn is_cut(&self, point: usize) -> bool {
        self.slab.as_ref().is_some_and(|slab| slab.is_cut[point])
    }

    /// Whether it is no slab of another body.
    pub fn is_whole(&self) -> bool {
        self.slab.is_none()
    }

    /// The points that count where energies and interactions are added up: all, but for a slab its own.
    pub fn counted(&self) -> Range<usize> {
        self.slab.as_ref().map_or(0..self.n_points(), |slab| slab.own.clone())
    }

    /// Which part of an interaction between these points counts: it is of all of them alike.
    pub(crate) fn counted_part(&self, points: impl Iterator<Item = usize> + Clone) -> f64 {
        let Some(slab) = &self.slab else { return 1.0 };
        let own = points.clone().filter(|point| slab.own.contains(point));
        own.count() as f64 / points.count() as f64
    }

    /// Where rows of each point stand in the user's order: of a slab in the order of the points that it has.
    pub fn places(&self) -> &[u32] {
        self.slab.as_ref().map_or(&self.user_index, |slab| &slab.places)
    }

    /// 2 or 3.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// How many points there are.
    pub fn n_points(&self) -> usize {
        self.volumes.len()
    }

    /// Reference position of a point, `d` numbers in m.
    pub fn position(&self, point: usize) -> &[f64] {
        &self.positions[point * self.dimension..(point + 1) * self.dimension]
    }

    /// Between two points at rest, in m.
    pub(crate) fn distance(&self, [i, j]: [usize; 2]) -> f64 {
        let ends = self.position(i).iter().zip(self.position(j));
        ends.fold(0.0, |sum, (x, y)| sum + (y - x) * (y - x)).sqrt()
    }

    /// All reference positions, `n x d` row by row, in m.
    pub fn positions(&self) -> &[f64] {
        &self.positions
    }

    /// Point volumes in m^d.
    pub fn volumes(&self) -> &[f64] {
        &self.volumes
    }

    /// Lattice spacing in m, if the points are a lattice.
    pub fn spacing(&self) -> Option<f64> {
        self.spacing
    }

    /// The axis along which the points are sorted.
    pub fn sorted_axis(&self) -> usize {
        self.sorted_axis
    }

    /// Place of each point in the order in which the user listed them.
    pub fn user_index(&self) -> &[u32] {
        &self.user_index
    }

    /// Rearranges per-point rows of `width` numbers from the body's order into the user's.
    pub fn to_user_order(&self, rows: &[f64], width: usize) -> Vec<f64> {
        let mut out = vec![0.0; rows.len()];
        for (row, &user) in rows.chunks_exact(width).zip(self.places()) {
            out[user as usize * width..(user as usize + 1) * width].copy_from_slice(row);
        }
        out
    }

    /// Rearranges per-point rows of `width` numbers from the user's order into the body's.
    pub fn from_user_order(&self, rows: &[f64], width: usize) -> Vec<f64> {
        let mut out = Vec::with_capacity(rows.len());
        for &user in self.places() {
            out.extend_from_slice(&rows[user as usize * width..(user as usize + 1) * width]);
        }
        out
    }
}
