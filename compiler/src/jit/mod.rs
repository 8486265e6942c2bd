//! Machine code for the kernels: the only place with unsafe code.
//!
//! | module | what |
//! |---|---|
//! | `lower` | a graph to Cranelift's intermediate form, operation by operation |
//! | `code` | the owner of executable memory |

mod code;
mod lower;

pub use code::{CompiledKernel, Listing};
