//! A body as faces to fill and edges to draw: the cells of a lattice, or those of a mesh.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::cells::{Cells, Edge, Facet, cross, difference};
use super::motion::Motion;
use crate::mesh::{Mesh, PointsAre};

/// What is drawn of a body.
pub(super) struct Solid {
    /// Whole cells in two dimensions, exposed faces in three.
    pub(super) facets: Vec<Facet>,
    /// The edges of the cells in two dimensions.
    pub(super) edges: Vec<Edge>,
    /// Of every cell what its colour shows.
    pub(super) values: Vec<f64>,
    /// Bit `s` of a cell's number tells whether a point of set `s` is in it.
    pub(super) sets: Vec<u32>,
    /// How large a cell is, in m.
    pub(super) size: f64,
    /// So many points along each axis are drawn as one.
    pub(super) block: usize,
}

impl Solid {
    /// The cells of a lattice.
    pub(super) fn of_lattice(motion: &Motion, spacing: f64, most: usize) -> Solid {
        let cells = Cells::new(motion, spacing, most);
        Solid {
            facets: cells.facets(),
            edges: if motion.points.dimension == 2 { cells.edges() } else { Vec::new() },
            values: cells.cells.iter().map(|cell| cell.value).collect(),
            sets: cells.cells.iter().map(|cell| cell.sets).collect(),
            size: cells.size,
            block: cells.block,
        }
    }

    /// The cells of a mesh; nothing where there are more faces than `most` to draw.
    pub(super) fn of_mesh(motion: &Motion, mesh: &Mesh, most: usize) -> Option<Solid> {
        let d = motion.points.dimension;
        let sides = Sides::new(mesh);
        let n_facets = if d == 2 { mesh.n_cells() } else { sides.exposed().count() };
        if n_facets > 2 * most {
            return None;
        }
        let carried =
            mesh.carried(&motion.points.positions, motion.displacement, &motion.points.held);
        let reference = |vertex: u32| {
            let start = vertex as usize * d;
            let mut at = [0.0; 3];
            at[..d].copy_from_slice(&mesh.vertices()[start..start + d]);
            at
        };
        let current = |vertex: u32| {
            let mut at = reference(vertex);
            let u = &carried[vertex as usize * d..(vertex as usize + 1) * d];
            u.iter().zip(&mut at).for_each(|(u, at)| *at += motion.magnification * u);
            at
        };
        let is_finite = |facet: &Facet| facet.corners.iter().flatten().all(|x| x.is_finite());
        let four = |corners: &[u32]| {
            let last = corners.len() - 1;
            [0, 1, 2, 3].map(|k: usize| current(corners[k.min(last)]))
        };
        let mut facets: Vec<Facet> = Vec::new();
        let mut edges: Vec<Edge> = Vec::new();
        if d == 2 {
            let whole =
                |cell: usize| Facet { cell, corners: four(mesh.corners(cell)), outward: None };
            facets.extend((0..mesh.n_cells()).map(whole));
            edges.extend(sides.all().map(|(cell, beyond, ends)| Edge {
                cell,
                beyond,
                reference: [reference(ends[0]), reference(ends[1])],
                current: [current(ends[0]), current(ends[1])],
            }));
        } else {
            let centre = |cell: usize| {
                let corners = mesh.corners(cell);
                let mut sum = [0.0; 3];
                corners.iter().for_each(|c| (0..3).for_each(|k| sum[k] += current(*c)[k]));
                sum.map(|x| x / corners.len() as f64)
            };
            facets.extend(sides.exposed().map(|(cell, face)| {
                let corners = four(&face);
                let across =
                    cross(difference(corners[2], corners[0]), difference(corners[3], corners[1]));
                // Files have cells of both hands.
                let out = difference(corners[0], centre(cell));
                let sign = if super::motion::dot(across, out) < 0.0 { -1.0 } else { 1.0 };
                Facet { cell, corners, outward: Some(across.map(|x| sign * x)) }
            }));
        }
        facets.retain(is_finite);
        let (values, sets) = (0..mesh.n_cells()).map(|cell| of_cell(motion, mesh, cell)).unzip();
        let volume = motion.points.volumes.iter().sum::<f64>() / mesh.n_cells().max(1) as f64;
        let size = if d == 2 { volume.sqrt() } else { libm::cbrt(volume) };
        Some(Solid { facets, edges, values, sets, size, block: 1 })
    }
}

/// What the colour of a cell shows, and of which sets it is.
fn of_cell(motion: &Motion, mesh: &Mesh, cell: usize) -> (f64, u32) {
    if mesh.points_are() == PointsAre::Cells {
        return (motion.value(cell), motion.sets_of(cell));
    }
    let corners = mesh.corners(cell);
    let sum: f64 = corners.iter().map(|corner| motion.value(*corner as usize)).sum();
    let sets = corners.iter().fold(0, |sets, corner| sets | motion.sets_of(*corner as usize));
    (sum / corners.len() as f64, sets)
}

/// The faces of a mesh, in two dimensions its edges, with the cells on both sides.
struct Sides<'a> {
    mesh: &'a Mesh,
    /// By sorted corners: a cell, its face, and the cell beyond.
    faces: HashMap<[u32; 4], (usize, usize, Option<usize>)>,
}

impl<'a> Sides<'a> {
    fn new(mesh: &'a Mesh) -> Sides<'a> {
        let mut faces = HashMap::new();
        for cell in 0..mesh.n_cells() {
            for number in 0..mesh.shape(cell).faces().len() {
                let mut key = [u32::MAX; 4];
                for (slot, corner) in key.iter_mut().zip(corners(mesh, cell, number)) {
                    *slot = corner;
                }
                key.sort_unstable();
                match faces.entry(key) {
                    Entry::Vacant(first) => {
                        first.insert((cell, number, None));
                    }
                    Entry::Occupied(mut first) => first.get_mut().2 = Some(cell),
                }
            }
        }
        Sides { mesh, faces }
    }

    /// Faces with nothing beyond, in the order of the cells.
    fn exposed(&self) -> impl Iterator<Item = (usize, Vec<u32>)> + '_ {
        let mut exposed: Vec<(usize, usize)> = self
            .faces
            .values()
            .filter(|(.., beyond)| beyond.is_none())
            .map(|(cell, number, _)| (*cell, *number))
            .collect();
        exposed.sort_unstable();
        exposed.into_iter().map(|(cell, number)| (cell, corners(self.mesh, cell, number).collect()))
    }

    /// Every edge once from each of its cells, with what is beyond.
    fn all(&self) -> impl Iterator<Item = (usize, Option<usize>, Vec<u32>)> + '_ {
        let mut all: Vec<(usize, usize, Option<usize>)> = self.faces.values().copied().collect();
        all.sort_unstable();
        all.into_iter().flat_map(|(cell, number, beyond)| {
            let ends: Vec<u32> = corners(self.mesh, cell, number).collect();
            let back = beyond.map(|beyond| (beyond, Some(cell), ends.clone()));
            std::iter::once((cell, beyond, ends)).chain(back)
        })
    }
}

fn corners(mesh: &Mesh, cell: usize, face: usize) -> impl Iterator<Item = u32> + '_ {
    let own = mesh.corners(cell);
    mesh.shape(cell).faces()[face].iter().map(move |k| own[*k])
}
