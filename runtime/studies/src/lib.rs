//! What is asked of bodies: scenes and their runs, plans, moduli, accuracy against time.
//!
//! | part | modules |
//! |---|---|
//! | what is asked for | [`scene`], [`plan`] |
//! | a scene made ready | [`case`] |
//! | planned, solved and written down | [`simulation`] |
//! | the same over many processes | `simulation::ranks`, with the feature `petsc` |
//! | what accuracy costs | [`trade`]; an interaction alone: [`cost`] |
//! | which elastic moduli a body has | [`moduli`] |
//!
//! Only here does the runtime know potentials as texts. [`scene`] and [`piola_output`] translate
//! between the user's order of points and the body's.

// A library prints nothing; what its program prints goes through one module.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod case;
pub mod cost;
pub mod machine;
pub mod moduli;
pub mod plan;
pub mod scene;
pub mod simulation;
pub mod sweep;
pub mod trade;
mod written;
