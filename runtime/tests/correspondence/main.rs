//! Energies of deformation gradients against independent references and against mechanics.

mod common;
mod reference;
