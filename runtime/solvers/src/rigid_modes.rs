//! Rigid motions that nothing holds, found before the first step.
//!
//! Points that share no interaction, not even through others, form separate components. Each has
//! the rigid motions of the plane (2 translations, 1 rotation) or of space (3 and 3). A motion that
//! moves a component while all its fixed degrees of freedom stay where they are costs no energy:
//! the tangent is singular and the displacement undetermined. Mechanisms other than rigid motions
//! depend on the energy; the factorisation meets them.

use nalgebra::{DMatrix, SymmetricEigen};
use piola_mechanics::matrix::BlockPattern;

use super::constraint::Constraints;

/// A motion counts as held when it moves the fixed degrees of freedom (2-norm, points scaled to
/// unit size) by more than this, squared. 1e-12 is 1e-6 of the component's size, far above the
/// rounding of the Gram matrix (1e-16) and far below two neighbours in a body of 1e4 spacings.
const HELD: f64 = 1e-12;

/// How many components a message lists.
const LISTED: usize = 5;

/// A component with rigid motions that nothing holds.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeComponent {
    /// How many points it has.
    pub n_points: usize,
    /// One of its points, in the body's order.
    pub example_point: usize,
    /// Reference position of that point in m.
    pub example_position: Vec<f64>,
    /// The free motions in words.
    pub motions: Vec<String>,
}

/// The body can move without any energy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}", self.message())]
pub struct UnderConstrained {
    /// The components that can move.
    pub components: Vec<FreeComponent>,
}

impl UnderConstrained {
    fn message(&self) -> String {
        let listed = self.components.iter().take(LISTED).map(|component| {
            let what = match component.n_points {
                1 => "the point".to_string(),
                n => format!("the part of {n} points with a point"),
            };
            let position = numbers(&component.example_position);
            format!("{what} at {position} is free to move: {}", component.motions.join(", "))
        });
        let mut message = listed.collect::<Vec<_>>().join("; ");
        if self.components.len() > LISTED {
            message += &format!("; and {} more parts", self.components.len() - LISTED);
        }
        message
    }
}

/// Checks that the fixed degrees of freedom hold every rigid motion of every component.
///
/// `positions` are `n x d`, in m.
pub fn check_rigid_motions(
    pattern: &BlockPattern,
    positions: &[f64],
    constraints: &Constraints,
) -> Result<(), UnderConstrained> {
    let d = pattern.dimension;
    let mut components = Vec::new();
    for points in connected_components(pattern) {
        let motions = free_motions(d, positions, &points, constraints);
        if !motions.is_empty() {
            let example = points[0];
            components.push(FreeComponent {
                n_points: points.len(),
                example_point: example,
                example_position: positions[example * d..(example + 1) * d].to_vec(),
                motions,
            });
        }
    }
    if components.is_empty() { Ok(()) } else { Err(UnderConstrained { components }) }
}

/// The points of each connected component of the pattern, ascending; components in the order of
/// their first points.
pub fn connected_components(pattern: &BlockPattern) -> Vec<Vec<usize>> {
    let n = pattern.n_rows();
    let mut parent: Vec<usize> = (0..n).collect();
    fn root(parent: &mut [usize], mut point: usize) -> usize {
        while parent[point] != point {
            parent[point] = parent[parent[point]];
            point = parent[point];
        }
        point
    }
    for i in 0..n {
        for &j in &pattern.columns[pattern.row_start[i]..pattern.row_start[i + 1]] {
            let (p, q) = (root(&mut parent, i), root(&mut parent, j as usize));
            parent[p.max(q)] = p.min(q);
        }
    }
    let mut component_of_root = vec![usize::MAX; n];
    let mut components: Vec<Vec<usize>> = Vec::new();
    for point in 0..n {
        let root = root(&mut parent, point);
        if component_of_root[root] == usize::MAX {
            component_of_root[root] = components.len();
            components.push(Vec::new());
        }
        components[component_of_root[root]].push(point);
    }
    components
}

/// Rigid motions as columns: translations along the axes, then rotations (z in the plane).
struct RigidMotions {
    dimension: usize,
    centre: Vec<f64>,
    size: f64,
}

impl RigidMotions {
    fn new(d: usize, positions: &[f64], points: &[usize]) -> RigidMotions {
        let mut centre = vec![0.0; d];
        for &p in points {
            for a in 0..d {
                centre[a] += positions[p * d + a] / points.len() as f64;
            }
        }
        let distance = |&p: &usize| {
            (0..d).map(|a| (positions[p * d + a] - centre[a]).abs()).fold(0.0, f64::max)
        };
        let size = points.iter().map(distance).fold(0.0, f64::max);
        RigidMotions { dimension: d, centre, size: if size > 0.0 { size } else { 1.0 } }
    }

    fn count(&self) -> usize {
        if self.dimension == 2 { 3 } else { 6 }
    }

    /// How each motion moves component `a` of a point at `position`.
    fn row(&self, position: &[f64], a: usize) -> Vec<f64> {
        let d = self.dimension;
        let x = |b: usize| (position[b] - self.centre[b]) / self.size;
        let mut row = vec![0.0; self.count()];
        row[a] = 1.0;
        if d == 2 {
            row[2] = if a == 0 { -x(1) } else { x(0) };
        } else {
            // (omega x r)_a = omega_b r_c - omega_c r_b with a, b, c cyclic.
            let (b, c) = ((a + 1) % 3, (a + 2) % 3);
            row[3 + b] = x(c);
            row[3 + c] = -x(b);
        }
        row
    }

    /// Mean over `rows` of the outer products of the rows.
    fn gram(&self, rows: impl Iterator<Item = Vec<f64>>) -> DMatrix<f64> {
        let mut gram = DMatrix::zeros(self.count(), self.count());
        for row in rows {
            for (i, a) in row.iter().enumerate() {
                for (j, b) in row.iter().enumerate() {
                    gram[(i, j)] += a * b;
                }
            }
        }
        gram
    }
}

/// The motions of one component that leave its fixed degrees of freedom alone, in words.
fn free_motions(
    d: usize,
    positions: &[f64],
    points: &[usize],
    constraints: &Constraints,
) -> Vec<String> {
    let motions = RigidMotions::new(d, positions, points);
    let free = motions.free(positions, points, constraints);
    simplest_basis(free).iter().map(|motion| motions.describe(motion)).collect()
}

/// The free motions of a part of a body at `positions` (`n x d`, in m) in words, and degrees of freedom that
/// hold it, as few as do: they carry nothing but loads. Both are empty where it is held.
pub(crate) fn holders(
    d: usize,
    positions: &[f64],
    points: &[usize],
    constraints: &Constraints,
) -> (Vec<String>, Vec<usize>) {
    let motions = RigidMotions::new(d, positions, points);
    let free = motions.free(positions, points, constraints);
    if free.ncols() == 0 {
        return (Vec::new(), Vec::new());
    }
    let dofs = points.iter().flat_map(|p| p * d..(p + 1) * d);
    let dofs = dofs.filter(|dof| !constraints.is_fixed(*dof));
    let mut left: Vec<(usize, Vec<f64>)> = dofs
        .map(|dof| {
            let row = motions.row(&positions[dof / d * d..(dof / d + 1) * d], dof % d);
            let along = |column: usize| (0..row.len()).map(|k| row[k] * free[(k, column)]).sum();
            (dof, (0..free.ncols()).map(along).collect())
        })
        .collect();
    let mut holders = Vec::new();
    for _ in 0..free.ncols() {
        // The one that the motions that are left move most; of equals the first.
        let size = |moved: &[f64]| moved.iter().map(|x| x * x).sum::<f64>();
        let most = left.iter().map(|(_, moved)| size(moved)).fold(0.0, f64::max);
        let chosen =
            left.iter().find(|(_, moved)| most > 0.0 && size(moved) >= most * (1.0 - 1e-9));
        let Some((dof, axis)) = chosen.cloned() else { break };
        holders.push(dof);
        for (_, moved) in &mut left {
            let share = moved.iter().zip(&axis).map(|(x, y)| x * y).sum::<f64>() / size(&axis);
            moved.iter_mut().zip(&axis).for_each(|(x, y)| *x -= share * y);
        }
        left.retain(|(other, _)| *other != dof);
    }
    let words = simplest_basis(free).iter().map(|motion| motions.describe(motion)).collect();
    (words, holders)
}

impl RigidMotions {
    /// The motions of these points that leave their fixed degrees of freedom alone, as columns.
    fn free(&self, positions: &[f64], points: &[usize], constraints: &Constraints) -> DMatrix<f64> {
        let (d, motions) = (self.dimension, self);
        let rows = |fixed_only: bool| {
            points.iter().flat_map(move |&p| {
                (0..d)
                    .filter(move |a| !fixed_only || constraints.is_fixed(p * d + a))
                    .map(move |a| motions.row(&positions[p * d..(p + 1) * d], a))
            })
        };
        // Motions that move some point at all: a single point has no rotations, a straight line of
        // points none about itself.
        let moving = eigenvectors(&motions.gram(rows(false)), points.len() as f64, false);
        let held = moving.transpose() * motions.gram(rows(true)) * &moving;
        &moving * eigenvectors(&held, 1.0, true)
    }
}

/// Eigenvectors (columns) whose eigenvalue is at most (or above) [`HELD`]` * scale`.
fn eigenvectors(gram: &DMatrix<f64>, scale: f64, null: bool) -> DMatrix<f64> {
    let eigen = SymmetricEigen::new(gram.clone());
    let chosen = |&k: &usize| (eigen.eigenvalues[k] <= HELD * scale) == null;
    let columns: Vec<_> =
        (0..gram.ncols()).filter(chosen).map(|k| eigen.eigenvectors.column(k)).collect();
    if columns.is_empty() {
        DMatrix::zeros(gram.nrows(), 0)
    } else {
        DMatrix::from_columns(&columns)
    }
}

/// A basis of the same space with as many zeros as Gauss-Jordan elimination finds, rotations first.
fn simplest_basis(columns: DMatrix<f64>) -> Vec<Vec<f64>> {
    let mut rows: Vec<Vec<f64>> =
        columns.column_iter().map(|c| c.iter().copied().collect()).collect();
    let width = columns.nrows();
    let d = if width == 3 { 2 } else { 3 };
    let mut done = 0;
    for column in (d..width).chain(0..d) {
        let pivot = (done..rows.len())
            .max_by(|&p, &q| rows[p][column].abs().total_cmp(&rows[q][column].abs()));
        let Some(pivot) = pivot.filter(|&p| rows[p][column].abs() > 1e-6) else { continue };
        rows.swap(done, pivot);
        let scale = rows[done][column];
        rows[done].iter_mut().for_each(|x| *x /= scale);
        let reference = rows[done].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|(place, _)| *place != done) {
            let factor = row[column];
            row.iter_mut().zip(&reference).for_each(|(x, r)| *x -= factor * r);
        }
        done += 1;
    }
    for x in rows.iter_mut().flatten().filter(|x| x.abs() < 1e-6) {
        *x = 0.0;
    }
    rows
}

impl RigidMotions {
    /// A motion in words: a translation, a rotation about an axis through a point, or a screw.
    fn describe(&self, motion: &[f64]) -> String {
        let d = self.dimension;
        let translation = &motion[..d];
        let rotation = &motion[d..];
        if rotation.iter().all(|&w| w == 0.0) {
            return format!("translation along {}", direction(translation));
        }
        if d == 2 {
            // t + omega x (x - c) = 0 at x - c = (-t_y, t_x) / omega.
            let [tx, ty, omega] = [motion[0], motion[1], motion[2]];
            let through = [-ty / omega, tx / omega];
            return format!("rotation about z through {}", self.place(&through));
        }
        let t = nalgebra::Vector3::from_column_slice(translation);
        let omega = nalgebra::Vector3::from_column_slice(rotation);
        let through = omega.cross(&t) / omega.norm_squared();
        let screw = omega.dot(&t) / omega.norm_squared();
        let along = if screw.abs() > 1e-6 { " with a translation along it" } else { "" };
        let axis = direction(rotation);
        format!("rotation about {axis} through {}{along}", self.place(through.as_slice()))
    }

    /// A place given in scaled coordinates from the centre, in m.
    fn place(&self, scaled: &[f64]) -> String {
        let at: Vec<f64> =
            scaled.iter().zip(&self.centre).map(|(x, c)| c + self.size * x).collect();
        // What is rounding compared with the body's size prints as 0.
        let clean = at.iter().map(|&x| if x.abs() < 1e-6 * self.size { 0.0 } else { x });
        numbers(&clean.collect::<Vec<_>>())
    }
}

/// `x`, `y`, `z`, or the unit vector.
fn direction(vector: &[f64]) -> String {
    let length = piola_mechanics::vector::norm_of(vector);
    let unit: Vec<f64> = vector.iter().map(|x| x / length).collect();
    for (axis, name) in ["x", "y", "z"].iter().enumerate().take(vector.len()) {
        if unit[axis].abs() > 1.0 - 1e-9 {
            return (*name).to_string();
        }
    }
    numbers(&unit)
}

/// `(0.5, 1, -0.25)` with four digits after the point at most.
fn numbers(values: &[f64]) -> String {
    let four = |x: &f64| {
        let size = x.abs();
        if size != 0.0 && !(1e-3..1e6).contains(&size) {
            return format!("{x:.3e}");
        }
        let text = format!("{x:.4}");
        text.trim_end_matches('0').trim_end_matches('.').to_string()
    };
    format!("({})", values.iter().map(four).collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
#[path = "rigid_modes_tests.rs"]
mod tests;
