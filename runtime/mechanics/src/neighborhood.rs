//! Which points are within the horizon of each other.
//!
//! Before: a body of finite coordinates. After: every point's neighbours in ascending order, no two
//! points at one place. Distances come from differences of coordinates, so that a body far from the
//! origin has the same neighbours as at the origin, up to the rounding of its coordinates.

mod gaps;
mod row;
mod search;

use std::ops::Range;

use rayon::prelude::*;

use crate::body::Body;
pub(crate) use gaps::Gaps;
pub(crate) use row::PlaceOfStep;
use row::Span;
pub use row::{Others, Row};
use search::{CellList, Rows};

/// A neighbour is within `horizon*(1 + HORIZON_TOLERANCE)`.
///
/// On a lattice with `horizon = 3*spacing` a bare `<=` keeps 92 to 116 of the 122 neighbours, by
/// rounding.
pub const HORIZON_TOLERANCE: f64 = 1e-6;

/// Points closer than `horizon*COINCIDENCE` are at one place: their bond has no direction.
pub const COINCIDENCE: f64 = 1e-9;

/// Shortest and longest horizon in m. Within these limits eighth powers of lengths are numbers with all
/// their digits, and 80 decades are left for energies and for lengths unlike the horizon: second
/// derivatives of an energy of areas in space divide it by four areas. Beyond, squares of areas vanish
/// or are infinite, and energies with them.
pub const HORIZONS: [f64; 2] = [1e-28, 1e28];

/// The neighbours of all points: symmetric, ascending, without the point itself.
///
/// A row is the steps in numbering to a point's neighbours, and points with the same steps share them: a lattice
/// needs some thirty bytes a point whatever its horizon, a cloud four for each neighbour.
#[derive(Clone, Debug)]
pub struct Neighborhood {
    horizon: f64,
    steps: Vec<u32>,
    spans: Vec<Span>,
    /// The span of every point.
    of: Vec<u32>,
    /// How many neighbours all points before a point have.
    row_start: Vec<usize>,
    /// The number of the first bond with a later point, for each point.
    bond_start: Vec<usize>,
    shell_bonds: usize,
    most_later: usize,
}

/// Why a body has no neighbourhoods.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NeighborhoodError {
    /// The horizon is not a positive number.
    #[error("the horizon is {horizon} m: it must be a positive finite length")]
    Horizon {
        /// What was given.
        horizon: f64,
    },
    /// The horizon is too short or too long for powers of it.
    #[error(
        "the horizon is {horizon:e} m: it must lie between {:e} and {:e} m, or powers of lengths \
         vanish or overflow; take another unit of length, in the parameters too",
        HORIZONS[0],
        HORIZONS[1]
    )]
    Scale {
        /// What was given.
        horizon: f64,
    },
    /// A coordinate is infinite or not a number.
    #[error(
        "point {point} (counted from 0 in the order of the input) lies at {position:?} m: coordinates must be finite"
    )]
    NonFinite {
        /// In the user's order.
        point: usize,
        /// As given.
        position: Vec<f64>,
    },
    /// Two points at one place.
    #[error(
        "points {first} and {second} (counted from 0 in the order of the input) coincide at {position:?} m: \
         they are {distance:e} m apart, less than 1e-9 of the horizon {horizon} m; remove one of them"
    )]
    Coincident {
        /// In the user's order.
        first: usize,
        /// In the user's order.
        second: usize,
        /// Of the first.
        position: Vec<f64>,
        /// Between them, in m.
        distance: f64,
        /// In m.
        horizon: f64,
    },
}

/// Refuses a horizon that is no length, or none that can be worked with.
pub fn check_horizon(horizon: f64) -> Result<(), NeighborhoodError> {
    if !(horizon > 0.0 && horizon.is_finite()) {
        return Err(NeighborhoodError::Horizon { horizon });
    }
    if !(HORIZONS[0]..=HORIZONS[1]).contains(&horizon) {
        return Err(NeighborhoodError::Scale { horizon });
    }
    Ok(())
}

/// Points whose rows are searched by one task; fixed, so that results do not depend on threads.
const CHUNK: usize = 1024;

impl Neighborhood {
    /// Finds all neighbours with a cell list.
    pub fn new(body: &Body, horizon: f64) -> Result<Neighborhood, NeighborhoodError> {
        check_horizon(horizon)?;
        if let Some(bad) = body.positions().iter().position(|x| !x.is_finite()) {
            let point = bad / body.dimension();
            let position = body.position(point).to_vec();
            return Err(NeighborhoodError::NonFinite { point: user(body, point), position });
        }
        let cells = CellList::new(body, horizon * (1.0 + HORIZON_TOLERANCE));
        Neighborhood::search(body, horizon, &cells, |_| true)
    }

    /// The neighbours of some points, and the neighbours of those that come later: all that the
    /// cliques of these points need. Rows of other points are empty. For estimates of large bodies.
    pub fn around(
        body: &Body,
        horizon: f64,
        owners: &[usize],
        with_cliques: bool,
    ) -> Result<Neighborhood, NeighborhoodError> {
        let cells = CellList::new(body, horizon * (1.0 + HORIZON_TOLERANCE));
        let mut wanted = vec![false; body.n_points()];
        owners.iter().for_each(|&owner| wanted[owner] = true);
        let own = Neighborhood::search(body, horizon, &cells, |point| wanted[point])?;
        if !with_cliques {
            return Ok(own);
        }
        for &owner in owners {
            own.upper(owner).iter().for_each(|point| wanted[point as usize] = true);
        }
        Neighborhood::search(body, horizon, &cells, |point| wanted[point])
    }

    /// The rows of the wanted points.
    fn search(
        body: &Body,
        horizon: f64,
        cells: &CellList,
        wanted: impl Fn(usize) -> bool + Sync,
    ) -> Result<Neighborhood, NeighborhoodError> {
        let n = body.n_points();
        let found: Vec<_> = (0..n.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let points = chunk * CHUNK..n.min((chunk + 1) * CHUNK);
                cells.search(body, horizon, points, &wanted)
            })
            .collect();
        if let Some((i, j)) = found.iter().find_map(|found| found.coincident) {
            return Err(coincident(body, horizon, i, j));
        }
        let shell_bonds = found.iter().map(|found| found.shell_bonds).sum();
        let mut all = Rows::with_capacity(n);
        for chunk in found {
            let numbers: Vec<u32> = (chunk.rows.spans.iter())
                .map(|span| all.number(&chunk.rows.steps[span.all()], span.later()))
                .collect();
            all.of.extend(chunk.rows.of.iter().map(|number| numbers[*number as usize]));
        }
        Ok(Neighborhood::of_rows(horizon, all, shell_bonds))
    }

    /// With the numbers of neighbours and bonds.
    fn of_rows(horizon: f64, rows: Rows, shell_bonds: usize) -> Neighborhood {
        let Rows { steps, spans, of, .. } = rows;
        let (row_start, bond_start) = (Vec::new(), Vec::new());
        let mut all = Neighborhood {
            horizon,
            steps,
            spans,
            of,
            row_start,
            bond_start,
            shell_bonds,
            most_later: 0,
        };
        all.count();
        all
    }

    /// Counts neighbours and bonds.
    fn count(&mut self) {
        let n = self.n_points();
        self.row_start.clear();
        self.bond_start.clear();
        self.row_start.reserve_exact(n + 1);
        self.bond_start.reserve_exact(n + 1);
        let (mut row, mut bond) = (0, 0);
        self.most_later = 0;
        for point in 0..n {
            self.row_start.push(row);
            self.bond_start.push(bond);
            let span = &self.spans[self.of[point] as usize];
            row += span.all().len();
            bond += span.later();
            self.most_later = self.most_later.max(span.later());
        }
        self.row_start.push(row);
        self.bond_start.push(bond);
    }

    /// The horizon in m, without its tolerance.
    pub fn horizon(&self) -> f64 {
        self.horizon
    }

    /// How many points there are.
    pub fn n_points(&self) -> usize {
        self.of.len()
    }

    /// How many bonds there are, each once.
    pub fn n_bonds(&self) -> usize {
        self.row_start[self.n_points()] / 2
    }

    /// How many bonds are as long as the horizon to within 1e-6 of it: these depend on rounding in
    /// programs without a tolerance.
    pub fn shell_bonds(&self) -> usize {
        self.shell_bonds
    }

    /// All neighbours of a point, ascending.
    #[inline]
    pub fn row(&self, point: usize) -> Row<'_> {
        Row::new(point, &self.steps[self.spans[self.of[point] as usize].all()])
    }

    /// Where a point's neighbours stand among those of all points, one row after the other.
    pub fn places(&self, point: usize) -> Range<usize> {
        self.row_start[point]..self.row_start[point + 1]
    }

    /// The neighbours `j > point`, ascending.
    #[inline]
    pub fn upper(&self, point: usize) -> Row<'_> {
        Row::new(point, &self.steps[self.spans[self.of[point] as usize].upper()])
    }

    /// The numbers of a point's bonds with later points: every bond has one, owner by owner.
    pub fn bonds(&self, point: usize) -> Range<usize> {
        self.bond_start[point]..self.bond_start[point + 1]
    }

    /// The number of the first bond of every owner, and how many bonds there are.
    pub fn bond_starts(&self) -> &[usize] {
        &self.bond_start
    }

    /// How many bonds some owners have.
    pub(crate) fn n_bonds_of(&self, owners: Range<usize>) -> usize {
        self.bond_start[owners.end] - self.bond_start[owners.start]
    }

    /// Some owners in pieces of whole owners with their bonds: of so many bonds, but for those of the last owner
    /// of a piece.
    pub(crate) fn pieces(
        &self,
        owners: Range<usize>,
        most: usize,
    ) -> impl Iterator<Item = (Range<usize>, Range<usize>)> + '_ {
        let (mut next, start) = (owners.start, self.bond_starts());
        std::iter::from_fn(move || {
            let first = next;
            while next < owners.end && (next == first || start[next] - start[first] < most) {
                next += 1;
            }
            let bonds = start[first]..start[next];
            (next > first).then_some((first..next, bonds))
        })
    }

    /// The points of a bond, by its number: its owner, and the later one.
    pub fn ends(&self, bond: usize) -> [usize; 2] {
        let owner = self.bond_start.partition_point(|first| *first <= bond) - 1;
        [owner, self.upper(owner).at(bond - self.bond_start[owner]) as usize]
    }

    /// The number of the bond between two points; nothing where there is none.
    pub fn bond_between(&self, ends: [usize; 2]) -> Option<usize> {
        let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
        let place = self.upper(low).place(high as u32)?;
        Some(self.bonds(low).start + place)
    }

    /// For the place of each neighbour `j` of a point `i` the place of `i` in the row of `j`.
    pub fn mirrored(&self) -> Vec<u32> {
        // Rows are symmetric and ascending: going through the points in order, each finds its place
        // in a neighbour's row right after the point before.
        let mut next: Vec<usize> = self.row_start[..self.n_points()].to_vec();
        let mut mirrored = Vec::with_capacity(self.row_start[self.n_points()]);
        for j in (0..self.n_points()).flat_map(|point| self.row(point)) {
            mirrored.push(next[j as usize] as u32);
            next[j as usize] += 1;
        }
        mirrored
    }

    /// The most later neighbours that any point has.
    pub fn most_later(&self) -> usize {
        self.most_later
    }

    /// Points without any neighbour, ascending.
    pub fn isolated(&self) -> Vec<usize> {
        (0..self.n_points()).filter(|&i| self.row(i).is_empty()).collect()
    }
}

fn user(body: &Body, point: usize) -> usize {
    body.user_index()[point] as usize
}

fn coincident(body: &Body, horizon: f64, i: usize, j: usize) -> NeighborhoodError {
    let (first, second) = (user(body, i), user(body, j));
    NeighborhoodError::Coincident {
        first: first.min(second),
        second: first.max(second),
        position: body.position(if first < second { i } else { j }).to_vec(),
        distance: distance_squared(body.position(i), body.position(j)).sqrt(),
        horizon,
    }
}

fn distance_squared(p: &[f64], q: &[f64]) -> f64 {
    p.iter().zip(q).map(|(p, q)| (q - p) * (q - p)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(dimension: usize, n: usize, offset: f64, stretch: f64) -> Body {
        // Golden-ratio lattice: scattered, never coincident.
        let ratios = [0.754877666246693, 0.569840290998053, 0.819172513396164];
        let mut positions = Vec::new();
        for i in 0..n {
            for axis in 0..dimension {
                let x = (i as f64 * ratios[axis]).fract();
                positions.push(offset + if axis == 0 { x * stretch } else { x });
            }
        }
        Body::new(dimension, &positions, &vec![1.0; n], None)
    }

    fn brute_force(body: &Body, horizon: f64) -> Vec<Vec<u32>> {
        let reach = horizon * (1.0 + HORIZON_TOLERANCE);
        let near = |i: usize, j: usize| {
            let squared = distance_squared(body.position(i), body.position(j));
            i != j && squared <= reach * reach
        };
        let n = body.n_points();
        (0..n).map(|i| (0..n).filter(|&j| near(i, j)).map(|j| j as u32).collect()).collect()
    }

    #[test]
    fn the_cell_list_finds_what_brute_force_finds() {
        for dimension in [2, 3] {
            for (offset, stretch) in [(0.0, 1.0), (1e6, 1.0), (-3.0, 1e7)] {
                let body = cloud(dimension, 1500, offset, stretch);
                let horizon = 0.2 * if stretch > 1.0 { 1e5 } else { 1.0 };
                let found = Neighborhood::new(&body, horizon).unwrap();
                let expected = brute_force(&body, horizon);
                for i in 0..body.n_points() {
                    assert_eq!(found.row(i).to_vec(), expected[i], "point {i}");
                    assert!(found.upper(i).iter().all(|j| j as usize > i));
                }
                let directed: usize = expected.iter().map(Vec::len).sum();
                assert_eq!(found.n_bonds() * 2, directed);
            }
        }
    }

    /// Whatever the lattice's size, rows differ by how far their points are from its faces.
    #[test]
    fn points_of_a_lattice_share_their_rows() {
        let cube = |n: usize| {
            let place = |k: usize| [k / (n * n), k / n % n, k % n].map(|x| x as f64);
            let positions: Vec<f64> = (0..n.pow(3)).flat_map(place).collect();
            Body::new(3, &positions, &vec![1.0; n.pow(3)], Some(1.0))
        };
        for n in [9, 14] {
            let body = cube(n);
            let found = Neighborhood::new(&body, 2.0).unwrap();
            assert_eq!((found.spans.len(), found.most_later()), (125, 16));
            for (i, row) in brute_force(&body, 2.0).iter().enumerate() {
                assert_eq!(&found.row(i).to_vec(), row, "point {i}");
                for (place, j) in row.iter().enumerate() {
                    assert_eq!((found.row(i).at(place), found.row(i).place(*j)), (*j, Some(place)));
                }
                assert_eq!(found.row(i).place(i as u32), None);
            }
        }
    }

    #[test]
    fn a_sparse_cloud_needs_little_memory() {
        let positions = [0.0, 0.0, 0.0, 1e12, 1e12, -1e12, 1e12, 0.0, -1e12 + 1.0];
        let body = Body::new(3, &positions, &[1.0; 3], None);
        let found = Neighborhood::new(&body, 1.5).unwrap();
        assert_eq!(found.isolated(), [0, 1, 2]);
    }

    #[test]
    fn the_shell_is_counted() {
        let body = Body::new(2, &[0.0, 0.0, 1.0, 0.0, 0.0, 0.5], &[1.0; 3], None);
        assert_eq!(Neighborhood::new(&body, 1.0 / (1.0 + 9e-7)).unwrap().shell_bonds(), 1);
        assert_eq!(Neighborhood::new(&body, 1.0).unwrap().shell_bonds(), 1);
        assert_eq!(Neighborhood::new(&body, 1.0 + 2e-6).unwrap().shell_bonds(), 0);
        assert_eq!(Neighborhood::new(&body, 1.0 - 2e-6).unwrap().n_bonds(), 1);
    }

    #[test]
    fn coincident_points_are_named_in_the_users_order() {
        let body = Body::new(2, &[5.0, 1.0, 2.0, 0.0, 5.0, 1.0 + 1e-11], &[1.0; 3], None);
        let error = Neighborhood::new(&body, 0.1).unwrap_err();
        assert!(matches!(error, NeighborhoodError::Coincident { first: 0, second: 2, .. }));
        assert!(error.to_string().contains("points 0 and 2"), "{error}");
    }

    #[test]
    fn bad_numbers_are_named() {
        let body = Body::new(2, &[0.0, 0.0, 1.0, f64::NAN], &[1.0; 2], None);
        let error = Neighborhood::new(&body, 0.1).unwrap_err();
        assert!(matches!(error, NeighborhoodError::NonFinite { point: 1, .. }), "{error}");
        for horizon in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = Neighborhood::new(&cloud(2, 5, 0.0, 1.0), horizon).unwrap_err();
            assert!(matches!(error, NeighborhoodError::Horizon { .. }));
        }
    }
}
