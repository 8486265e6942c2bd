//! From compiled kernels to solved bodies.

pub mod assembly;
pub mod body;
pub mod element;
pub mod energy;
pub mod geometry;
pub mod interaction;
pub mod kernel;
pub mod lattice;
pub mod matrix;
pub mod solve;
pub mod plan;
pub mod scene;
pub mod neighborhood;
pub mod weights;
pub mod output;
