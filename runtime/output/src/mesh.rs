//! The cells of a mesh, so that a body that was made of one is seen as it.

use nalgebra::{Matrix3, Vector3};
use piola_meshes::Shape;

/// Directions in which the neighbours of a cell spread less than this part of the widest say nothing of its
/// gradient.
const THIN: f64 = 1e-6;

/// Where the points of a body are in its mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointsAre {
    /// The cells, in their order.
    Cells,
    /// The vertices, in their order.
    Vertices,
}

/// Cells between vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    dimension: usize,
    /// Reference positions, row by row, in m.
    vertices: Vec<f64>,
    shapes: Vec<Shape>,
    /// Corners of all cells, and where each begins and ends.
    corners: Vec<u32>,
    starts: Vec<usize>,
    points_are: PointsAre,
    /// The cells around each vertex, and where each begins and ends.
    around: Vec<u32>,
    around_starts: Vec<usize>,
}

impl Mesh {
    /// Cells with their corners, which are numbers of `vertices`, `n x d` in m, in Gmsh's order.
    pub fn new<'a>(
        dimension: usize,
        vertices: Vec<f64>,
        cells: impl Iterator<Item = (Shape, &'a [u32])>,
        points_are: PointsAre,
    ) -> Mesh {
        let (mut shapes, mut corners, mut starts) = (Vec::new(), Vec::new(), vec![0]);
        for (shape, own) in cells {
            shapes.push(shape);
            corners.extend_from_slice(own);
            starts.push(corners.len());
        }
        let n_vertices = vertices.len() / dimension;
        let mut around_starts = vec![0; n_vertices + 1];
        corners.iter().for_each(|vertex| around_starts[*vertex as usize + 1] += 1);
        (0..n_vertices).for_each(|vertex| around_starts[vertex + 1] += around_starts[vertex]);
        let mut next = around_starts.clone();
        let mut around = vec![0; corners.len()];
        for cell in 0..shapes.len() {
            for &vertex in &corners[starts[cell]..starts[cell + 1]] {
                around[next[vertex as usize]] = cell as u32;
                next[vertex as usize] += 1;
            }
        }
        Mesh { dimension, vertices, shapes, corners, starts, points_are, around, around_starts }
    }

    /// How many cells there are.
    pub fn n_cells(&self) -> usize {
        self.shapes.len()
    }

    /// Where the points of the body are.
    pub fn points_are(&self) -> PointsAre {
        self.points_are
    }

    pub(crate) fn vertices(&self) -> &[f64] {
        &self.vertices
    }

    pub(crate) fn shape(&self, cell: usize) -> Shape {
        self.shapes[cell]
    }

    pub(crate) fn corners(&self, cell: usize) -> &[u32] {
        &self.corners[self.starts[cell]..self.starts[cell + 1]]
    }

    fn around(&self, vertex: usize) -> &[u32] {
        &self.around[self.around_starts[vertex]..self.around_starts[vertex + 1]]
    }

    fn vertex(&self, vertex: usize) -> &[f64] {
        &self.vertices[vertex * self.dimension..(vertex + 1) * self.dimension]
    }

    /// Displacements of the vertices, of those of the points; `positions` and `displacement` are `n x d` in
    /// m, in the user's order.
    ///
    /// Where points are cells a vertex moves with the mean of what the cells around it say: their
    /// displacement, and its gradient by least squares over the cells that share a vertex with them. Linear
    /// fields are carried exactly. Of cells that are `held`, as [`crate::Points::held`] says, only those count
    /// where there are some.
    pub fn carried(&self, positions: &[f64], displacement: &[f64], held: &[bool]) -> Vec<f64> {
        if self.points_are == PointsAre::Vertices {
            return displacement.to_vec();
        }
        let d = self.dimension;
        let is_held = |cell: u32| held.get(cell as usize).is_some_and(|held| *held);
        let gradient = |cell: usize| match is_held(cell as u32) {
            false => self.gradient(cell, positions, displacement, |_| true).0,
            true => turned(self.gradient(cell, positions, displacement, is_held), d),
        };
        let gradients: Vec<Matrix3<f64>> = (0..self.n_cells()).map(gradient).collect();
        let mut out = vec![0.0; self.vertices.len()];
        for (vertex, sum) in out.chunks_exact_mut(d).enumerate() {
            let all = self.around(vertex);
            let any_held = all.iter().any(|cell| is_held(*cell));
            let around = || all.iter().filter(|cell| !any_held || is_held(**cell));
            for &cell in around() {
                let cell = cell as usize;
                for i in 0..d {
                    sum[i] += displacement[cell * d + i];
                    for j in 0..d {
                        let offset = self.vertex(vertex)[j] - positions[cell * d + j];
                        sum[i] += gradients[cell][(i, j)] * offset;
                    }
                }
            }
            sum.iter_mut().for_each(|x| *x /= around().count().max(1) as f64);
        }
        out
    }

    /// The gradient of the displacement at a cell, by those around it that count, and the directions in which
    /// these do not spread, along which it is 0.
    fn gradient(
        &self,
        cell: usize,
        positions: &[f64],
        displacement: &[f64],
        counts: impl Fn(u32) -> bool,
    ) -> (Matrix3<f64>, Vec<Vector3<f64>>) {
        let d = self.dimension;
        let (mut shape, mut moved) = (Matrix3::<f64>::zeros(), Matrix3::<f64>::zeros());
        for &vertex in self.corners(cell) {
            for &other in self.around(vertex as usize).iter().filter(|other| counts(**other)) {
                let other = other as usize;
                for i in 0..d {
                    let du = displacement[other * d + i] - displacement[cell * d + i];
                    let dx = positions[other * d + i] - positions[cell * d + i];
                    for j in 0..d {
                        let offset = positions[other * d + j] - positions[cell * d + j];
                        moved[(i, j)] += du * offset;
                        shape[(i, j)] += dx * offset;
                    }
                }
            }
        }
        if moved.iter().any(|x| !x.is_finite()) {
            return (Matrix3::zeros(), Vec::new());
        }
        // Rows of cells and single ones say nothing across: there the gradient is 0.
        let eigen = shape.symmetric_eigen();
        let widest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
        let inverse = |value: f64| if value > THIN * widest { 1.0 / value } else { 0.0 };
        let scaled = Matrix3::from_diagonal(&eigen.eigenvalues.map(inverse));
        let gradient = moved * eigen.eigenvectors * scaled * eigen.eigenvectors.transpose();
        let directions = eigen.eigenvectors.column_iter().zip(eigen.eigenvalues.iter());
        let thin = directions.filter(|(_, value)| **value <= THIN * widest);
        (gradient, thin.map(|(direction, _)| direction.into_owned()).collect())
    }
}

/// The gradient of a layer of cells, one thick, whose normal turns with it; as it is where more is not known.
fn turned((gradient, unknown): (Matrix3<f64>, Vec<Vector3<f64>>), d: usize) -> Matrix3<f64> {
    // In two dimensions nothing is known across the plane, and nothing happens there.
    let is_across = |n: &Vector3<f64>| d == 2 && n.z.abs() > 0.5;
    let missing: Vec<Vector3<f64>> = unknown.into_iter().filter(|n| !is_across(n)).collect();
    let [normal] = missing[..] else { return gradient };
    let one = if d == 2 { Vector3::z() } else { any_across(&normal) };
    let other = normal.cross(&one);
    let image = |direction: Vector3<f64>| direction + gradient * direction;
    match image(one).cross(&image(other)).try_normalize(0.0) {
        // One, other and normal turn right-handed: so do their images.
        Some(image) => gradient + (image - normal) * normal.transpose(),
        None => gradient,
    }
}

/// A unit vector across another.
fn any_across(normal: &Vector3<f64>) -> Vector3<f64> {
    let axis = if normal.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    normal.cross(&axis).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two by one squares of edge 1, the right one cut into triangles.
    fn three() -> Mesh {
        let vertices = vec![0.0, 0.0, 1.0, 0.0, 2.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 1.0];
        let cells: [(Shape, &[u32]); 3] = [
            (Shape::Quadrilateral, &[0, 1, 4, 3]),
            (Shape::Triangle, &[1, 2, 5]),
            (Shape::Triangle, &[1, 5, 4]),
        ];
        Mesh::new(2, vertices, cells.into_iter(), PointsAre::Cells)
    }

    #[test]
    fn linear_fields_are_carried_to_the_vertices() {
        let mesh = three();
        let centres = [0.5, 0.5, 5.0 / 3.0, 1.0 / 3.0, 4.0 / 3.0, 2.0 / 3.0];
        let field = |x: &[f64]| [0.1 + 0.2 * x[0] - 0.3 * x[1], 0.5 * x[0] + 0.7 * x[1]];
        let at = |places: &[f64]| -> Vec<f64> { places.chunks(2).flat_map(field).collect() };
        let carried = mesh.carried(&centres, &at(&centres), &[]);
        for (x, y) in carried.iter().zip(at(&mesh.vertices)) {
            assert!((x - y).abs() < 1e-14, "{x} {y}");
        }
        // A cell that is held says nothing of what is beside it, and its corners move as it does.
        let mut pulled = vec![0.0; 6];
        pulled[2..].fill(1.0);
        let carried = mesh.carried(&centres, &pulled, &[true, false, false]);
        for held in [0, 1, 3, 4] {
            assert_eq!(carried[2 * held..2 * held + 2], [0.0, 0.0], "{carried:?}");
        }
        assert!(carried[4] > 0.9, "{carried:?}");
        // What is not finite stays with the cells that have it.
        let mut lost = at(&centres);
        lost[4] = f64::NAN;
        let carried = mesh.carried(&centres, &lost, &[]);
        assert!(carried[0].is_finite() && carried[4].is_finite() && carried[2].is_nan());
    }

    #[test]
    fn points_at_vertices_carry_themselves() {
        let mesh = Mesh { points_are: PointsAre::Vertices, ..three() };
        let u: Vec<f64> = (0..12).map(f64::from).collect();
        assert_eq!(mesh.carried(&mesh.vertices, &u, &[]), u);
    }

    #[test]
    fn a_held_layer_turns_as_a_whole() {
        // A row of three squares that turns by a quarter, beside one that stays.
        let mut vertices = Vec::new();
        (0..3).for_each(|y| (0..4).for_each(|x| vertices.extend([f64::from(x), f64::from(y)])));
        let cells: Vec<[u32; 4]> =
            (0..2).flat_map(|y| (0..3).map(move |x| [0, 1, 5, 4].map(|k| k + x + 4 * y))).collect();
        let all = cells.iter().map(|cell| (Shape::Quadrilateral, &cell[..]));
        let mesh = Mesh::new(2, vertices, all, PointsAre::Cells);
        let centres: Vec<f64> = (0..2)
            .flat_map(|y| (0..3).flat_map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]))
            .collect();
        let turned = |x: &[f64]| [-x[1] - x[0], x[0] - x[1]];
        let mut displacement = vec![0.0; 12];
        for cell in 3..6 {
            displacement[2 * cell..2 * cell + 2]
                .copy_from_slice(&turned(&centres[2 * cell..2 * cell + 2]));
        }
        let held: Vec<bool> = (0..6).map(|cell| cell >= 3).collect();
        let carried = mesh.carried(&centres, &displacement, &held);
        for vertex in 4..12 {
            let expected = turned(&mesh.vertices[2 * vertex..2 * vertex + 2]);
            for (x, y) in carried[2 * vertex..2 * vertex + 2].iter().zip(expected) {
                assert!((x - y).abs() < 1e-14, "{vertex}: {carried:?}");
            }
        }
    }
}
