//! Machine code for the kernels: the only place with unsafe code.
//!
//! | module | what |
//! |---|---|
//! | `region` | which operations are worked out only where a choice needs them |
//! | `lower` | a graph to Cranelift's intermediate form, operation by operation, two entries at a time |
//! | `called` | the elementary functions that are called |
//! | `elementary`, `log_table` | the elementary functions that the fast level inlines |
//! | `powers` | which powers share their elementary functions |
//! | `lanes` | instructions on two numbers side by side |
//! | `code` | the owner of executable memory: any number of arrays in and out |
//! | `scalar` | the energy of one measure on top of it |

mod called;
mod code;
mod elementary;
mod lanes;
mod log_table;
mod lower;
mod powers;
mod region;
mod scalar;
#[cfg(test)]
mod tests;

pub(crate) use code::{Code, isa};
pub use code::{Listing, target};
pub use scalar::CompiledKernel;
