//! Kinds of elements: their corners, faces and shape functions, and volume and centre of one.
//!
//! Nodes are in Gmsh's order ("Node ordering" of its reference manual): corners, then the middles of
//! edges, then those of faces, then that of the inside. An element is the image of its reference under the
//! interpolation of its nodes, so that curved ones have the volume that a finite-element program gives
//! them.

use nalgebra::DMatrix;

/// The form of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shape {
    /// One node.
    Point,
    /// Two corners.
    Line,
    /// Three corners.
    Triangle,
    /// Four corners in a plane of the reference.
    Quadrilateral,
    /// Four corners in space.
    Tetrahedron,
    /// Eight corners.
    Hexahedron,
    /// Six corners: a triangle times a line.
    Wedge,
    /// Five corners: a quadrilateral and an apex.
    Pyramid,
}

impl Shape {
    /// 0 to 3.
    pub fn dimension(self) -> usize {
        match self {
            Shape::Point => 0,
            Shape::Line => 1,
            Shape::Triangle | Shape::Quadrilateral => 2,
            Shape::Tetrahedron | Shape::Hexahedron | Shape::Wedge | Shape::Pyramid => 3,
        }
    }

    /// How many corners there are.
    pub fn n_corners(self) -> usize {
        self.corners().len()
    }

    /// Corners of each face; edges in two dimensions.
    pub fn faces(self) -> &'static [&'static [usize]] {
        match self {
            Shape::Point => &[],
            Shape::Line => &[&[0], &[1]],
            Shape::Triangle => &[&[0, 1], &[1, 2], &[2, 0]],
            Shape::Quadrilateral => &[&[0, 1], &[1, 2], &[2, 3], &[3, 0]],
            Shape::Tetrahedron => &[&[0, 2, 1], &[0, 1, 3], &[0, 3, 2], &[1, 2, 3]],
            Shape::Hexahedron => &[
                &[0, 3, 2, 1],
                &[0, 1, 5, 4],
                &[0, 4, 7, 3],
                &[1, 2, 6, 5],
                &[2, 3, 7, 6],
                &[4, 5, 6, 7],
            ],
            Shape::Wedge => &[&[0, 2, 1], &[3, 4, 5], &[0, 1, 4, 3], &[0, 3, 5, 2], &[1, 2, 5, 4]],
            Shape::Pyramid => &[&[0, 3, 2, 1], &[0, 1, 4], &[0, 4, 3], &[1, 2, 4], &[2, 3, 4]],
        }
    }

    /// Where the corners of the reference are. That of the pyramid is a cube whose upper face is the apex.
    fn corners(self) -> &'static [[f64; 3]] {
        match self {
            Shape::Point => &[[0.0; 3]],
            Shape::Line => &[[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
            Shape::Triangle => &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            Shape::Quadrilateral => {
                &[[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]
            }
            Shape::Tetrahedron => {
                &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
            }
            Shape::Hexahedron => &[
                [-1.0, -1.0, -1.0],
                [1.0, -1.0, -1.0],
                [1.0, 1.0, -1.0],
                [-1.0, 1.0, -1.0],
                [-1.0, -1.0, 1.0],
                [1.0, -1.0, 1.0],
                [1.0, 1.0, 1.0],
                [-1.0, 1.0, 1.0],
            ],
            Shape::Wedge => &[
                [0.0, 0.0, -1.0],
                [1.0, 0.0, -1.0],
                [0.0, 1.0, -1.0],
                [0.0, 0.0, 1.0],
                [1.0, 0.0, 1.0],
                [0.0, 1.0, 1.0],
            ],
            Shape::Pyramid => &[
                [-1.0, -1.0, 0.0],
                [1.0, -1.0, 0.0],
                [1.0, 1.0, 0.0],
                [-1.0, 1.0, 0.0],
                [0.0, 0.0, 1.0],
            ],
        }
    }

    /// Between which corners the other nodes are, in their order.
    fn middles(self) -> &'static [&'static [usize]] {
        match self {
            Shape::Point => &[],
            Shape::Line => &[&[0, 1]],
            Shape::Triangle => &[&[0, 1], &[1, 2], &[2, 0]],
            Shape::Quadrilateral => &[&[0, 1], &[1, 2], &[2, 3], &[3, 0], &[0, 1, 2, 3]],
            Shape::Tetrahedron => &[&[0, 1], &[1, 2], &[2, 0], &[0, 3], &[2, 3], &[1, 3]],
            Shape::Hexahedron => &[
                &[0, 1],
                &[0, 3],
                &[0, 4],
                &[1, 2],
                &[1, 5],
                &[2, 3],
                &[2, 6],
                &[3, 7],
                &[4, 5],
                &[4, 7],
                &[5, 6],
                &[6, 7],
                &[0, 3, 2, 1],
                &[0, 1, 5, 4],
                &[0, 4, 7, 3],
                &[1, 2, 6, 5],
                &[2, 3, 7, 6],
                &[4, 5, 6, 7],
                &[0, 1, 2, 3, 4, 5, 6, 7],
            ],
            Shape::Wedge => &[
                &[0, 1],
                &[0, 2],
                &[0, 3],
                &[1, 2],
                &[1, 4],
                &[2, 5],
                &[3, 4],
                &[3, 5],
                &[4, 5],
                &[0, 1, 4, 3],
                &[0, 3, 5, 2],
                &[1, 2, 5, 4],
            ],
            Shape::Pyramid => &[
                &[0, 1],
                &[0, 3],
                &[0, 4],
                &[1, 2],
                &[1, 4],
                &[2, 3],
                &[2, 4],
                &[3, 4],
                &[0, 1, 2, 3],
            ],
        }
    }
}

/// A form with so many nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Kind {
    /// Its form.
    pub shape: Shape,
    /// How many nodes it has.
    pub nodes: usize,
}

impl Kind {
    pub(crate) const fn new(shape: Shape, nodes: usize) -> Kind {
        Kind { shape, nodes }
    }

    /// Where the nodes are in the reference.
    fn reference(self) -> Vec<[f64; 3]> {
        let corners = self.shape.corners();
        let middle = |of: &&[usize]| {
            let mut sum = [0.0; 3];
            of.iter().for_each(|&k| (0..3).for_each(|axis| sum[axis] += corners[k][axis]));
            let [x, y, z] = sum.map(|x| x / of.len() as f64);
            // From the pyramid to the cube.
            let along = if self.shape == Shape::Pyramid { 1.0 - z } else { 1.0 };
            [x / along, y / along, z]
        };
        let all = corners.iter().copied().chain(self.shape.middles().iter().map(middle));
        all.take(self.nodes).collect()
    }

    /// Exponents of the terms that the shape functions consist of: `x^i y^j z^k (1 - z)^m`, the last factor
    /// of pyramids alone.
    fn terms(self) -> Vec<[i32; 4]> {
        let order = if self.nodes == self.shape.n_corners() { 1 } else { 2 };
        let squares = |exponents: [i32; 3]| exponents.iter().filter(|e| **e == 2).count();
        let has = |[i, j, k]: [i32; 3]| match (self.shape, self.nodes) {
            (Shape::Point, _) => i + j + k == 0,
            (Shape::Line, _) => j + k == 0,
            (Shape::Triangle, _) => k == 0 && i + j <= order,
            (Shape::Quadrilateral, 8) => k == 0 && squares([i, j, k]) <= 1,
            (Shape::Quadrilateral, _) => k == 0,
            (Shape::Tetrahedron, _) => i + j + k <= order,
            (Shape::Hexahedron, 20) => squares([i, j, k]) <= 1,
            (Shape::Hexahedron, _) => true,
            (Shape::Wedge, 15) => i + j + (k - 1).max(0) <= 2,
            (Shape::Wedge, _) => i + j <= order,
            (Shape::Pyramid, 13) => i.max(j) + k <= 2 && squares([i, j, 0]) <= 1,
            (Shape::Pyramid, _) => i.max(j) + k <= order,
        };
        let mut terms = Vec::new();
        for i in 0..=order {
            for j in 0..=order {
                for k in 0..=order {
                    if has([i, j, k]) {
                        let m = if self.shape == Shape::Pyramid { i.max(j) } else { 0 };
                        terms.push([i, j, k, m]);
                    }
                }
            }
        }
        terms
    }
}

/// How an integral over elements of a kind is taken: values and gradients of the shape functions at the
/// points of a quadrature that is exact for volumes and centres.
pub(crate) struct Rule {
    dimension: usize,
    /// Of each quadrature point its weight, and of each node value and derivatives.
    points: Vec<(f64, Vec<[f64; 4]>)>,
}

/// Why an element has no volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Degenerate {
    /// It is flat.
    Empty,
    /// It is turned inside out somewhere.
    Folded,
}

impl Rule {
    pub(crate) fn new(kind: Kind) -> Rule {
        let terms = kind.terms();
        let reference = kind.reference();
        debug_assert_eq!(terms.len(), kind.nodes);
        let vandermonde = DMatrix::from_fn(kind.nodes, kind.nodes, |node, term| {
            value(terms[term], reference[node])
        });
        // Its columns are the shape functions' coefficients; the nodes of every kind determine them.
        let inverse = vandermonde.try_inverse().unwrap_or(DMatrix::zeros(kind.nodes, kind.nodes));
        let n = if kind.nodes == kind.shape.n_corners() { 2 } else { 4 };
        let of_nodes = |at: [f64; 3]| -> Vec<[f64; 4]> {
            let mut functions = vec![[0.0; 4]; kind.nodes];
            for (term, exponents) in terms.iter().enumerate() {
                let [dx, dy, dz] = gradient(*exponents, at);
                let own = [value(*exponents, at), dx, dy, dz];
                for (node, function) in functions.iter_mut().enumerate() {
                    (0..4).for_each(|k| function[k] += inverse[(term, node)] * own[k]);
                }
            }
            functions
        };
        let points = quadrature(kind.shape, n).into_iter();
        let points = points.map(|(weight, at)| (weight, of_nodes(at))).collect();
        Rule { dimension: kind.shape.dimension(), points }
    }

    /// Volume (area in two dimensions) and centre of gravity of the element with these nodes.
    pub(crate) fn measure(&self, nodes: &[[f64; 3]]) -> Result<(f64, [f64; 3]), Degenerate> {
        let origin = nodes[0];
        let (mut volume, mut moment) = (0.0, [0.0; 3]);
        let mut signs = [false; 2];
        let mut size = 0.0_f64;
        for (weight, functions) in &self.points {
            let mut at = [0.0; 3];
            let mut jacobian = [[0.0; 3]; 3];
            for (node, function) in nodes.iter().zip(functions) {
                for axis in 0..3 {
                    let x = node[axis] - origin[axis];
                    at[axis] += function[0] * x;
                    (0..3).for_each(|k| jacobian[k][axis] += function[1 + k] * x);
                }
            }
            let determinant = determinant(&jacobian, self.dimension);
            signs[usize::from(determinant < 0.0)] |= determinant != 0.0;
            let lengths = jacobian[..self.dimension].iter();
            let bound = lengths.map(|row| row.iter().map(|x| x * x).sum::<f64>().sqrt());
            size = size.max(bound.product::<f64>() * weight);
            volume += weight * determinant;
            (0..3).for_each(|axis| moment[axis] += weight * determinant * at[axis]);
        }
        if signs == [true, true] {
            return Err(Degenerate::Folded);
        }
        // What rounding leaves of a flat element, or less than numbers hold.
        let is_empty = volume.abs() <= 64.0 * f64::EPSILON * size || !volume.is_normal();
        if is_empty {
            return Err(Degenerate::Empty);
        }
        let centre = [0, 1, 2].map(|axis| origin[axis] + moment[axis] / volume);
        Ok((volume.abs(), centre))
    }
}

fn determinant(j: &[[f64; 3]; 3], dimension: usize) -> f64 {
    if dimension == 2 {
        return j[0][0] * j[1][1] - j[0][1] * j[1][0];
    }
    j[0][0] * (j[1][1] * j[2][2] - j[1][2] * j[2][1])
        - j[0][1] * (j[1][0] * j[2][2] - j[1][2] * j[2][0])
        + j[0][2] * (j[1][0] * j[2][1] - j[1][1] * j[2][0])
}

fn value([i, j, k, m]: [i32; 4], [x, y, z]: [f64; 3]) -> f64 {
    power(x, i) * power(y, j) * power(z, k) * power(1.0 - z, m)
}

/// To a power of 0, 1 or 2.
fn power(x: f64, n: i32) -> f64 {
    match n {
        0 => 1.0,
        1 => x,
        _ => x * x,
    }
}

fn gradient([i, j, k, m]: [i32; 4], [x, y, z]: [f64; 3]) -> [f64; 3] {
    let slope = |x: f64, n: i32| if n == 0 { 0.0 } else { f64::from(n) * power(x, n - 1) };
    let (u, v) = (power(z, k), power(1.0 - z, m));
    let plane = power(x, i) * power(y, j);
    [
        slope(x, i) * power(y, j) * u * v,
        power(x, i) * slope(y, j) * u * v,
        plane * (slope(z, k) * v - u * slope(1.0 - z, m)),
    ]
}

/// Weights and places, `n` along each axis: Gauss's, on forms that are no cubes collapsed from one.
fn quadrature(shape: Shape, n: usize) -> Vec<(f64, [f64; 3])> {
    let line = gauss(n);
    let unit: Vec<(f64, f64)> = line.iter().map(|(w, x)| (0.5 * w, 0.5 * (1.0 + x))).collect();
    let one = [(1.0, 0.0)];
    let axes: [&[(f64, f64)]; 3] = match shape {
        Shape::Point => [&one, &one, &one],
        Shape::Line => [&line, &one, &one],
        Shape::Triangle => [&unit, &unit, &one],
        Shape::Quadrilateral => [&line, &line, &one],
        Shape::Tetrahedron => [&unit, &unit, &unit],
        Shape::Hexahedron => [&line, &line, &line],
        Shape::Wedge => [&unit, &unit, &line],
        Shape::Pyramid => [&line, &line, &unit],
    };
    let mut points = Vec::new();
    for (a, x) in axes[0] {
        for (b, y) in axes[1] {
            for (c, z) in axes[2] {
                let weight = a * b * c;
                points.push(match shape {
                    Shape::Triangle | Shape::Wedge => (weight * (1.0 - x), [*x, y * (1.0 - x), *z]),
                    Shape::Tetrahedron => {
                        let (u, v) = (1.0 - x, 1.0 - y);
                        (weight * u * u * v, [*x, y * u, z * u * v])
                    }
                    _ => (weight, [*x, *y, *z]),
                });
            }
        }
    }
    points
}

/// Weights and places of Gauss's quadrature on (-1, 1).
fn gauss(n: usize) -> Vec<(f64, f64)> {
    if n == 2 {
        let x = (1.0_f64 / 3.0).sqrt();
        return vec![(1.0, -x), (1.0, x)];
    }
    let root = (6.0_f64 / 5.0).sqrt();
    let (inner, outer) =
        ((3.0 / 7.0 - 2.0 / 7.0 * root).sqrt(), (3.0 / 7.0 + 2.0 / 7.0 * root).sqrt());
    let thirty = 30.0_f64.sqrt();
    let (heavy, light) = ((18.0 + thirty) / 36.0, (18.0 - thirty) / 36.0);
    vec![(light, -outer), (heavy, -inner), (heavy, inner), (light, outer)]
}
