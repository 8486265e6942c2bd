//! From compiled kernels to solved bodies.

pub mod body;
pub mod energy;
pub mod kernel;
pub mod matrix;
pub mod solve;
pub mod plan;
pub mod scene;
