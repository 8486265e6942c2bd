//! Pieces of a body, and on each the linear displacement fields.
//!
//! The body is cut into the cells of a box somewhat larger than the horizon. On each piece every
//! component of the displacement may be any linear function of the reference position: `d + 1`
//! functions, orthonormal over the points where the component is free. They hold the rigid motions,
//! rotations by any angle included, and the uniform strains.

use piola_mechanics::matrix::BlockPattern;

use crate::constraint::Constraints;

/// Side of a piece in horizons. Smaller pieces leave fewer iterations and a larger coarse system;
/// between 4/3 and 2 the time hardly changes (measured, see `benches/ratios/preconditioners.rs`).
const SIDE: f64 = 5.0 / 3.0;

/// More pieces than this are not made; larger bodies have larger ones, since the factorisation of
/// the coarse system grows with the square of their number.
const MOST_PIECES: f64 = 400.0;

/// Beyond so many pieces each holds [`LEAST_POINTS`] on average: where the horizon is short, a coarse
/// system of small pieces costs more than the products that it saves. 23 x 21 x 21 points with a
/// horizon of 2 spacings: 252 pieces leave 29 iterations, 80 leave 38 and take half the time.
const SMALL_PIECES: f64 = 64.0;

/// See [`SMALL_PIECES`].
const LEAST_POINTS: f64 = 100.0;

/// A function is dropped when this little of it is not in the span of those before.
const DEPENDENT: f64 = 1e-6;

/// The pieces of a body with their functions.
#[derive(Clone, Debug)]
pub(super) struct Aggregates {
    pub(super) dimension: usize,
    /// The piece of each point.
    pub(super) of_point: Vec<u32>,
    /// The points of each piece, ascending.
    pub(super) members: Vec<Vec<u32>>,
    /// Values of the functions: entry `(dof * (d + 1)) + k` is function `k` of that component on
    /// the point's piece. 0 at fixed degrees of freedom, and everywhere for a function dropped.
    pub(super) functions: Vec<f64>,
    /// Coarse unknowns `(piece * d + component) * (d + 1) + k` whose functions were dropped.
    pub(super) dropped: Vec<usize>,
}

impl Aggregates {
    /// Cuts a body; `None` if it is too small to be cut.
    ///
    /// `positions` are those at rest, `n x d`, in m.
    pub(super) fn new(
        pattern: &BlockPattern,
        positions: &[f64],
        constraints: &Constraints,
    ) -> Option<Aggregates> {
        let d = pattern.dimension;
        let horizon = horizon(pattern, positions);
        if horizon == 0.0 {
            return None;
        }
        let (of_point, n_pieces) = cut(d, positions, horizon);
        if n_pieces < 2 {
            return None;
        }
        let mut members = vec![Vec::new(); n_pieces];
        for (point, &piece) in of_point.iter().enumerate() {
            members[piece as usize].push(point as u32);
        }
        let mut aggregates = Aggregates {
            dimension: d,
            of_point,
            members,
            functions: vec![0.0; positions.len() * (d + 1)],
            dropped: Vec::new(),
        };
        for piece in 0..n_pieces {
            for component in 0..d {
                aggregates.orthonormalise(piece, component, positions, constraints);
            }
        }
        Some(aggregates)
    }

    /// Coarse unknowns per piece.
    pub(super) fn per_piece(&self) -> usize {
        self.dimension * (self.dimension + 1)
    }

    /// Gram-Schmidt, twice, of 1, X, Y, .. over the points of a piece where a component is free.
    fn orthonormalise(
        &mut self,
        piece: usize,
        component: usize,
        positions: &[f64],
        constraints: &Constraints,
    ) {
        let d = self.dimension;
        let points = &self.members[piece];
        let dofs: Vec<usize> = points
            .iter()
            .map(|&point| point as usize * d + component)
            .filter(|&dof| !constraints.is_fixed(dof))
            .collect();
        let mut basis: Vec<Vec<f64>> = Vec::with_capacity(d + 1);
        for k in 0..=d {
            let mut function: Vec<f64> = match k {
                0 => vec![1.0; dofs.len()],
                _ => dofs.iter().map(|dof| positions[dof / d * d + k - 1]).collect(),
            };
            if k > 0 {
                // Distances from the first point: an offset of the body costs no digits.
                let origin = function.first().copied().unwrap_or(0.0);
                function.iter_mut().for_each(|x| *x -= origin);
            }
            let size = norm(&function);
            for _ in 0..2 {
                for other in &basis {
                    let part = product(&function, other);
                    function.iter_mut().zip(other).for_each(|(x, other)| *x -= part * other);
                }
            }
            let left = norm(&function);
            if left > DEPENDENT * size {
                function.iter_mut().for_each(|x| *x /= left);
                for (&dof, &value) in dofs.iter().zip(&function) {
                    self.functions[dof * (d + 1) + k] = value;
                }
                basis.push(function);
            } else {
                self.dropped.push((piece * d + component) * (d + 1) + k);
            }
        }
    }
}

fn product(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).fold(0.0, |sum, (x, y)| sum + x * y)
}

fn norm(x: &[f64]) -> f64 {
    product(x, x).sqrt()
}

/// The longest distance of two coupled points.
fn horizon(pattern: &BlockPattern, positions: &[f64]) -> f64 {
    let d = pattern.dimension;
    let mut longest = 0.0f64;
    for i in 0..pattern.n_rows() {
        for &j in &pattern.columns[pattern.row_start[i]..pattern.row_start[i + 1]] {
            let distance = |a: usize| positions[i * d + a] - positions[j as usize * d + a];
            longest = longest.max((0..d).fold(0.0, |sum, a| sum + distance(a) * distance(a)));
        }
    }
    longest.sqrt()
}

/// The cell of each point, cells without points left out, and how many there are.
fn cut(d: usize, positions: &[f64], horizon: f64) -> (Vec<u32>, usize) {
    let column = |axis: usize| positions.iter().skip(axis).step_by(d).copied();
    let low: Vec<f64> = (0..d).map(|a| column(a).fold(f64::INFINITY, f64::min)).collect();
    let extent = |a: usize| column(a).fold(f64::NEG_INFINITY, f64::max) - low[a];
    let extents: Vec<f64> = (0..d).map(extent).collect();
    let longest = extents.iter().fold(0.0, |longest: f64, extent| longest.max(*extent));
    let mut side = (SIDE * horizon).max(longest / MOST_PIECES);
    let cells = |side: f64| -> Vec<f64> {
        extents.iter().map(|extent| (extent / side).round().clamp(1.0, 1e6)).collect()
    };
    let n_points = (positions.len() / d) as f64;
    let most = (n_points / LEAST_POINTS).clamp(SMALL_PIECES, MOST_PIECES);
    while cells(side).iter().product::<f64>() > most {
        side *= 1.05;
    }
    let counts = cells(side);
    let number = |point: &[f64]| {
        (0..d).fold(0usize, |number, a| {
            let part = if extents[a] > 0.0 { (point[a] - low[a]) / extents[a] } else { 0.0 };
            // A hair less than the whole, so that the last point lies in the last cell; and off
            // round numbers, where lattice points would fall to either side by rounding.
            let cell = (part * (1.0 - 1e-9) * counts[a] + 1e-12).floor().min(counts[a] - 1.0);
            number * counts[a] as usize + cell as usize
        })
    };
    let cell_of: Vec<usize> = positions.chunks_exact(d).map(number).collect();
    let mut piece_of_cell = vec![u32::MAX; counts.iter().product::<f64>() as usize];
    let mut n_pieces = 0;
    let piece = |cell: &usize| {
        let piece = &mut piece_of_cell[*cell];
        if *piece == u32::MAX {
            *piece = n_pieces as u32;
            n_pieces += 1;
        }
        *piece
    };
    let of_point = cell_of.iter().map(piece).collect();
    (of_point, n_pieces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use piola_mechanics::energy::Energy;
    use piola_mechanics::testing::{SpringNetwork, linear};

    #[test]
    fn functions_are_orthonormal_and_span_the_linear_fields() {
        let network = SpringNetwork::lattice(&[12, 7, 6], 2.0, linear);
        let n = network.positions.len();
        let mut fixed = network.dofs_where(|x| x[0] < 1.5);
        fixed.push(n - 2);
        let constraints = Constraints::new(n, &fixed).unwrap();
        let all = Aggregates::new(network.pattern(), &network.positions, &constraints).unwrap();
        assert!(all.members.len() >= 8, "{}", all.members.len());
        assert_eq!(all.members.iter().map(Vec::len).sum::<usize>(), n / 3);
        let value = |dof: usize, k: usize| all.functions[dof * 4 + k];
        for members in &all.members {
            for component in 0..3 {
                let dofs: Vec<usize> =
                    members.iter().map(|&p| p as usize * 3 + component).collect();
                let free = |dof: &&usize| !constraints.is_fixed(**dof);
                for k in 0..4 {
                    for l in 0..4 {
                        let sum: f64 = dofs.iter().map(|&dof| value(dof, k) * value(dof, l)).sum();
                        let one = if k == l { 1.0 } else { 0.0 };
                        let dropped = sum == 0.0 && k == l;
                        assert!((sum - one).abs() < 1e-13 || dropped, "{sum} {k} {l}");
                    }
                }
                // What is left of a linear field after its projection.
                let field = |dof: usize| {
                    let x = network.position(dof / 3);
                    3.0 + 0.5 * x[0] - 2.0 * x[1] + x[2]
                };
                let parts: Vec<f64> = (0..4)
                    .map(|k| dofs.iter().map(|&dof| value(dof, k) * field(dof)).sum())
                    .collect();
                for &dof in dofs.iter().filter(free) {
                    let projected: f64 = (0..4).map(|k| parts[k] * value(dof, k)).sum();
                    assert!((projected - field(dof)).abs() < 1e-11, "{projected}");
                }
            }
        }
    }

    #[test]
    fn dependent_functions_are_dropped() {
        // A straight row of points: only 1 and X are independent.
        let network = SpringNetwork::lattice(&[12, 1], 2.0, linear);
        let constraints = Constraints::new(24, &[0, 1]).unwrap();
        let all = Aggregates::new(network.pattern(), &network.positions, &constraints).unwrap();
        let pieces = all.members.len();
        assert!(pieces >= 2);
        let y: Vec<usize> = (0..2 * pieces).map(|row| row * 3 + 2).collect();
        assert_eq!(all.dropped, y);
        let tiny = SpringNetwork::lattice(&[3, 3], 2.0, linear);
        let constraints = Constraints::new(18, &[0, 1]).unwrap();
        assert!(Aggregates::new(tiny.pattern(), &tiny.positions, &constraints).is_none());
    }
}
