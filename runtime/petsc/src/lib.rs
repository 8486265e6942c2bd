//! PETSc over MPI: halo exchange, linear solvers with algebraic multigrid, and Newton's method for bodies
//! that many processes share.
//!
//! | item | does |
//! |---|---|
//! | `Engine` | starts and ends MPI and PETSc; what ranks tell each other |
//! | `Halo` | brings the numbers of ghost points from their owners |
//! | `BlockRows` | the pattern of a tangent: rows of owned points, columns of all |
//! | `Newton` | solves a `Problem`, or one linear system |
//!
//! A *rank* is one of the processes that `mpirun` starts. It owns a contiguous range of the points of a
//! body; *ghosts* are points of other ranks that it needs. Functions marked *collective* return when all
//! ranks have called them, and a run in which one does not stands still: errors that one rank finds are
//! therefore made known to all (`Engine::agree`), here and by callers.
//!
//! An `EngineError` that comes from PETSc itself may be known to one rank alone, as when its memory ends.
//! Whoever gets one and cannot tell calls `Engine::abort`.
//!
//! Without the feature `petsc` the crate is empty, and needs neither PETSc nor MPI nor a C compiler.
#![cfg(feature = "petsc")]
// A library prints nothing; what its program prints goes through one module.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod engine;
mod error;
mod ffi;
mod halo;
mod newton;
mod rows;

pub use engine::Engine;
pub use error::{EngineError, Failure};
pub use halo::Halo;
pub use newton::{LinearOutcome, Newton, Outcome, Problem, Refusal};
pub use rows::BlockRows;
