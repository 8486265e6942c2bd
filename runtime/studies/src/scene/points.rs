//! `[body]`: where points come from.

use piola_mechanics::lattice::Lattice;
use piola_mechanics::words::Words;

use super::{Expression, Located, Nodes};

/// `[body]`: where the points are.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyShape {
    /// 2 or 3.
    pub dimension: usize,
    /// Where the points come from.
    pub points: Points,
    /// Points where one of these conditions holds are left out.
    pub remove: Vec<Expression>,
    /// 2D: of the body in m, where the scene says it.
    pub thickness: Option<Located<f64>>,
}

/// Where the points of a body come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Points {
    /// A box filled with a lattice.
    Lattice(LatticeShape),
    /// A file of points.
    Cloud {
        /// Its path, relative to the scene's folder.
        path: Located<String>,
    },
    /// A file of cells, or of a surface.
    Mesh(MeshShape),
}

impl Points {
    /// Distance of neighbouring points in m, where they are those of a lattice.
    pub fn spacing(&self) -> Option<f64> {
        match self {
            Points::Lattice(lattice) => Some(lattice.spacing),
            Points::Mesh(mesh) => mesh.spacing,
            Points::Cloud { .. } => None,
        }
    }
}

/// A file of cells that become points, or of a closed surface that is filled with a lattice of them.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshShape {
    /// Its path, relative to the scene's folder.
    pub path: Located<String>,
    /// What kind of file it is.
    pub format: MeshFormat,
    /// One unit of length of the file in m.
    pub unit: f64,
    /// Where in the cells the points are, and what of a cell each has.
    pub nodes: MeshNodes,
    /// Of a surface: distance of the points in it, in m.
    pub spacing: Option<f64>,
}

/// Programs whose meshes are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// `.msh`
    Gmsh,
    /// `.inp`
    Abaqus,
    /// `.stl`: a surface.
    Stl,
}

impl MeshFormat {
    /// All of them, with the endings of their files.
    pub const ALL: [(&'static str, MeshFormat); 3] =
        [("msh", MeshFormat::Gmsh), ("inp", MeshFormat::Abaqus), ("stl", MeshFormat::Stl)];

    /// That of a file, by its ending.
    pub fn of(path: &str) -> Option<MeshFormat> {
        let ending = path.rsplit_once('.')?.1.to_ascii_lowercase();
        MeshFormat::ALL.into_iter().find(|(own, _)| *own == ending).map(|(_, format)| format)
    }
}

/// Where the points of a mesh sit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshNodes {
    /// At the centres of gravity of the cells, with their volumes.
    Cells,
    /// At the corners of the cells, whose volumes they share alike.
    Corners,
}

impl Words for MeshNodes {
    const WORDS: &'static [(&'static str, MeshNodes)] =
        &[("cells", MeshNodes::Cells), ("corners", MeshNodes::Corners)];
}

/// A box filled with a lattice of points.
#[derive(Clone, Debug, PartialEq)]
pub struct LatticeShape {
    /// The corner with the least coordinates, in m; one entry per dimension.
    pub low: Vec<f64>,
    /// The corner with the greatest coordinates, in m.
    pub high: Vec<f64>,
    /// Distance of neighbouring points in m; every extent is a whole multiple of it.
    pub spacing: f64,
    /// Where in the cells the points are, and what of a cell each has.
    pub nodes: Nodes,
}

impl LatticeShape {
    /// The box on its lattice, which may still be none.
    pub(crate) fn lattice(&self) -> Lattice {
        Lattice {
            lower: self.low.clone(),
            upper: self.high.clone(),
            spacing: self.spacing,
            nodes: self.nodes,
        }
    }

    /// How many cells lie along each axis.
    pub fn cells(&self) -> impl Iterator<Item = f64> {
        let sides = self.low.iter().zip(&self.high);
        sides.map(|(low, high)| ((high - low) / self.spacing).round())
    }

    /// How many points lie along each axis before any are removed.
    pub fn counts(&self) -> Vec<usize> {
        self.cells().map(|cells| self.nodes.along(cells) as usize).collect()
    }
}
