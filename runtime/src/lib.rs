//! From compiled kernels to solved bodies.
//!
//! | part | modules |
//! |---|---|
//! | what is asked for | [`scene`], [`plan`] |
//! | bodies and who interacts | [`body`], [`lattice`], [`neighborhood`], [`interaction`], [`weights`] |
//! | one energy and its derivatives | [`kernel`], [`geometry`], [`element`], [`assembly`], [`correspondence`], [`states`], [`energy`] |
//! | equilibrium | [`matrix`], [`solve`] |
//! | what is left behind | [`output`] |
//! | all of it together | [`simulation`] |
//! | what accuracy costs | [`trade`] |
//! | which elastic moduli a body has | [`moduli`] |
//!
//! Per-point arrays are in the body's order inside, in the user's order at the edges
//! ([`scene`] and [`output`] translate).

// A library prints nothing; what its program prints goes through one module.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod assembly;
pub mod body;
pub mod correspondence;
pub mod element;
pub mod energy;
pub mod geometry;
pub mod interaction;
pub mod kernel;
pub mod lattice;
pub mod matrix;
pub mod moduli;
pub mod neighborhood;
pub mod output;
pub mod plan;
mod pool;
pub mod scene;
pub mod sheet;
pub mod simulation;
pub mod solve;
pub mod states;
pub mod trade;
pub mod weights;
pub mod words;
