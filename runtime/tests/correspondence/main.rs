//! Energies of deformation gradients against independent references and against mechanics.

mod as_text;
mod checkerboard;
mod common;
mod consistency;
mod differences;
mod exactness;
mod gathered_vectors;
mod mechanics;
mod pattern;
mod reference;
mod refusals;
mod rows;
#[path = "../shared/differences.rs"]
mod shared;
mod shared_neighbors;
mod traction;
mod traction_bar;
