//! Energies of deformation gradients against independent references and against mechanics.

mod checkerboard;
mod common;
mod consistency;
mod exactness;
mod mechanics;
mod reference;
mod refusals;
mod traction;
mod traction_bar;
