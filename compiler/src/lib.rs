//! From a syntax tree to machine code.

mod formula;
mod kernel;
mod measure;

pub use formula::Formula;
pub use kernel::{Batch, Derivatives};
pub use measure::Measure;
