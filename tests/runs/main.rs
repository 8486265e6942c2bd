//! The program from outside: what its commands read, write, say and return, also when they are
//! misused or killed.

#[path = "../support/mod.rs"]
mod support;

mod accuracy;
mod bench;
mod clique_states;
mod compile;
mod contract;
mod coupled;
mod dissipation;
mod editor;
mod explain_bond;
mod extreme_fracture;
mod extremes;
mod family_states;
mod fields;
mod findings;
mod fracture;
mod fracture_energy;
mod frame_fields;
mod gathered_tensors;
mod gradient_breaks;
#[cfg(unix)]
mod interrupted;
mod killed;
mod load_steps;
mod load_steps_of_cliques;
mod machine;
mod materials;
mod meshes;
mod moduli;
mod motion;
mod pages;
mod picture;
mod plans;
#[cfg(unix)]
mod recipes;
mod refusals;
mod report;
mod resumed;
mod scenes;
mod several;
mod singular;
mod solvers;
#[cfg(unix)]
mod streams;
mod surface;
mod sweep;
mod tracks;
mod trade;
