//! Cells between the points of a lattice, so that a body is seen as one and not as dots.

/// A point of a lattice is this near to its place, in spacings.
const NEAR: f64 = 1e-3;

/// Most places of a lattice for each point that is there: a body that is sparser has no cells.
const SPARSE: usize = 64;

/// No point.
const NONE: u32 = u32::MAX;

/// Quadrilaterals of four or hexahedra of eight neighbours in a lattice, as VTK orders their corners,
/// one after the other: those whose corners are all there. `positions` are `n x d`, in m. Nothing where a
/// point is not one of a lattice with this spacing, and of lattices that are nearly empty.
pub fn of_lattice(d: usize, positions: &[f64], spacing: f64) -> Vec<u32> {
    let Some(grid) = Grid::new(d, positions, spacing) else { return Vec::new() };
    const CORNERS: [[usize; 3]; 8] =
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];
    let corners = &CORNERS[..if d == 2 { 4 } else { 8 }];
    let mut cells = Vec::new();
    for x in positions.chunks_exact(d) {
        let Some(place) = grid.place(x) else { return Vec::new() };
        let start = cells.len();
        for corner in corners {
            match grid.point([0, 1, 2].map(|axis| place[axis] + corner[axis])) {
                NONE => {
                    cells.truncate(start);
                    break;
                }
                point => cells.push(point),
            }
        }
    }
    cells
}

/// The points of a lattice by their places.
struct Grid {
    low: Vec<f64>,
    spacing: f64,
    counts: [usize; 3],
    /// Of every place, the last axis fastest.
    points: Vec<u32>,
}

impl Grid {
    fn new(d: usize, positions: &[f64], spacing: f64) -> Option<Grid> {
        let low = |axis: usize| {
            positions.iter().skip(axis).step_by(d).copied().fold(f64::INFINITY, f64::min)
        };
        let low: Vec<f64> = (0..d).map(low).collect();
        let mut grid = Grid { low, spacing, counts: [1; 3], points: Vec::new() };
        for x in positions.chunks_exact(d) {
            let place = grid.place(x)?;
            for (count, place) in grid.counts.iter_mut().zip(place) {
                *count = (*count).max(place.saturating_add(1));
            }
        }
        let ([a, b, c], n) = (grid.counts, positions.len() / d);
        let all = a.checked_mul(b)?.checked_mul(c)?;
        if all / SPARSE > n || n >= NONE as usize {
            return None;
        }
        grid.points = vec![NONE; all];
        for (point, x) in positions.chunks_exact(d).enumerate() {
            let index = grid.index(grid.place(x)?);
            grid.points[index] = point as u32;
        }
        Some(grid)
    }

    /// Where in the lattice a position is; nothing where it is not one of it.
    fn place(&self, x: &[f64]) -> Option<[usize; 3]> {
        let mut place = [0; 3];
        for (place, (x, low)) in place.iter_mut().zip(x.iter().zip(&self.low)) {
            let along = (x - low) / self.spacing;
            let is_near = (along - along.round()).abs() < NEAR;
            if !is_near {
                return None;
            }
            *place = along.round() as usize;
        }
        Some(place)
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * self.counts[1] + y) * self.counts[2] + z
    }

    fn point(&self, place: [usize; 3]) -> u32 {
        match (0..3).all(|axis| place[axis] < self.counts[axis]) {
            true => self.points[self.index(place)],
            false => NONE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_stand_where_all_corners_are() {
        // Three by two points, the last axis fastest, and the same without a corner.
        let whole = [0.0, 0.0, 0.0, 0.1, 0.1, 0.0, 0.1, 0.1, 0.2, 0.0, 0.2, 0.1];
        assert_eq!(of_lattice(2, &whole, 0.1), [0, 2, 3, 1, 2, 4, 5, 3]);
        assert_eq!(of_lattice(2, &whole[2..], 0.1), [1, 3, 4, 2]);
        assert!(of_lattice(2, &whole, 0.07).is_empty());
        let cube: Vec<f64> =
            (0..8).flat_map(|k| [k / 4, k / 2 % 2, k % 2].map(f64::from)).collect();
        assert_eq!(of_lattice(3, &cube, 1.0), [0, 4, 6, 2, 1, 5, 7, 3]);
    }
}
