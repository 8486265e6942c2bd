//! The mechanics of bodies against independent references and against physics.

mod broken;
mod broken_cliques;
mod common;
mod consistency;
mod coupled;
mod differences;
mod directions;
mod extremes;
mod extremes_solved;
mod fields;
mod lattice_counts;
mod materials;
mod matrix_free;
mod moduli;
mod refusals;
mod runs;
#[path = "../shared/differences.rs"]
mod shared;
mod small_clouds;
mod squares;
mod surface;
mod thin;
