//! Cells between the points of a lattice, so that a body is seen as one and not as dots.

use std::collections::HashMap;

/// A point of a lattice is this near to its place, in spacings.
const NEAR: f64 = 1e-3;

/// Quadrilaterals of four or hexahedra of eight neighbours in a lattice, as VTK orders their corners,
/// one after the other: those whose corners are all there. `positions` are `n x d`, in m. Nothing where a
/// point is not one of a lattice with this spacing.
pub fn of_lattice(d: usize, positions: &[f64], spacing: f64) -> Vec<u32> {
    let low: Vec<f64> = (0..d)
        .map(|axis| positions.iter().skip(axis).step_by(d).copied().fold(f64::INFINITY, f64::min))
        .collect();
    let mut places = Vec::with_capacity(positions.len() / d);
    for x in positions.chunks_exact(d) {
        let mut place = [0i64; 3];
        for axis in 0..d {
            let along = (x[axis] - low[axis]) / spacing;
            let is_near = (along - along.round()).abs() < NEAR;
            if !is_near {
                return Vec::new();
            }
            place[axis] = along.round() as i64;
        }
        places.push(place);
    }
    let numbers: HashMap<[i64; 3], u32> =
        places.iter().enumerate().map(|(point, place)| (*place, point as u32)).collect();
    const CORNERS: [[i64; 3]; 8] =
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];
    let corners = &CORNERS[..if d == 2 { 4 } else { 8 }];
    let mut cells = Vec::new();
    for place in &places {
        let start = cells.len();
        for corner in corners {
            let at = [0, 1, 2].map(|axis| place[axis] + corner[axis]);
            match numbers.get(&at) {
                Some(point) => cells.push(*point),
                None => {
                    cells.truncate(start);
                    break;
                }
            }
        }
    }
    cells
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
