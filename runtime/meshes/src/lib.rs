//! Meshes, surfaces and clouds that other programs write, read into points.
//!
//! | what | read by |
//! |---|---|
//! | Gmsh's `.msh`, versions 2.2 and 4.1, as text or binary | [`gmsh`] |
//! | Abaqus's `.inp`: nodes, elements, sets, parts and instances | [`abaqus`] |
//! | `.stl`, as text or binary: a closed surface, [filled](Surface::fill) with a lattice | [`stl`] |
//! | clouds of PeriLab and Peridigm as tables that the reader of tables understands | [`cloud`] |
//!
//! Before: bytes of unknown quality. After: elements whose nodes exist, and of [`Mesh::points`] volumes that
//! are positive. Every mistake has its place in the file and a reason; no more is reserved than the file
//! is long, whatever it announces.

// A file has one mistake that is told: its size does not matter.
#![allow(clippy::result_large_err)]

pub mod abaqus;
pub mod cloud;
mod error;
pub mod gmsh;
mod kind;
mod mesh;
mod scan;
pub mod stl;

pub use error::MeshError;
pub use kind::{Kind, Shape};
pub use mesh::{Group, Mesh, MeshPoints, Place};
pub use stl::Surface;
