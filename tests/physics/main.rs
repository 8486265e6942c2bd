//! Does the program compute the right thing? Published numbers, independent references, and the
//! laws that every discrete energy obeys, through the program itself or the crates' public doors.

#[path = "../support/mod.rs"]
mod support;

mod assembly;
mod beams;
mod convergence;
mod directions;
mod examples;
mod extension;
mod floor;
mod fracture;
mod gradients;
mod impact;
mod moduli;
mod nodes;
mod same_bits;
mod small_clouds;
mod spinning_disc;
mod subjects;
mod sums;
mod table6;
mod wave;
mod witness;
