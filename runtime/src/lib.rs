//! From compiled kernels to solved bodies: the four crates of this folder under one name.
//!
//! | crate | part | modules |
//! |---|---|---|
//! | [`piola_mechanics`] | bodies and who interacts | [`body`], [`lattice`], [`neighborhood`], [`interaction`], [`weights`], [`surface`] |
//! | | one energy and its derivatives | [`kernel`], [`geometry`], [`element`], [`assembly`], [`deformation`], [`states`], [`energy`], [`matrix`] |
//! | | bonds that break, bonds that dissipate | [`fracture`], [`dissipation`] |
//! | [`piola_solvers`] | equilibrium | [`solve`] |
//! | [`piola_output`] | what is left behind | [`output`] |
//! | [`piola_studies`] | what is asked for | [`scene`], [`plan`] |
//! | | all of it together | [`case`], [`simulation`] |
//! | | what accuracy costs | [`trade`] |
//! | | what parameters change | [`sweep`] |
//! | | which elastic moduli a body has | [`moduli`] |
//!
//! Per-point arrays are in the body's order inside, in the user's order at the edges
//! ([`scene`] and [`output`] translate).

pub use piola_mechanics::{
    assembly, body, deformation, dissipation, energy, fracture, geometry, interaction, kernel,
    lattice, materials, matrix, neighborhood, sheet, states, surface, vectors, weights, words,
};
pub use piola_output as output;
pub use piola_solvers as solve;
pub use piola_studies::{case, machine, moduli, plan, scene, simulation, sweep, trade};

/// Elements, and what they cost.
pub mod element {
    pub use piola_mechanics::element::*;
    pub use piola_studies::cost;
}
