//! Equilibrium and motion: constraints, linear systems, Newton's method, load steps, time steps.
//!
//! | module | does |
//! |---|---|
//! | [`constraint`] | says which degrees of freedom are fixed |
//! | [`rigid_modes`] | finds motions that nothing holds, before step 1 |
//! | [`linear`] | solves `K_ff x = b` by Cholesky, LDLT, LU or preconditioned conjugate gradients |
//! | [`newton`] | finds the stationary point of `E(u) - f.u` at fixed prescribed values |
//! | [`march`] | the way from state to state: what marches, and who looks on at every step |
//! | [`motion`] | goes through time, by explicit integration |
//! | [`singular`] | says what becomes of a run where breaking leaves families too small |
//! | [`steps`] | goes from `t = 0` to the end, with smaller increments where Newton's method fails |
//!
//! Everything works on any [`Energy`](piola_mechanics::energy::Energy). The bits of the results do
//! not depend on the number of threads.

// A library prints nothing; what its program prints goes through one module.
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

mod clock;
pub mod constraint;
mod forcing;
mod held;
mod increment;
mod line_search;
pub mod linear;
pub mod march;
pub mod motion;
pub mod newton;
mod newton_outcome;
pub mod rigid_modes;
pub mod singular;
pub mod steps;
mod watch;

pub use clock::{Counters, PhaseTimes};
pub use held::HeldTangent;
pub use watch::{Event, Observer, Watch};
