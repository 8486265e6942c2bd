//! What is done with a scene made ready ([`crate::case`]).
//!
//! | call | what |
//! |---|---|
//! | [`Case::plan`] | what will be modelled and what it costs |
//! | [`run()`] | load steps or a motion, with everything they leave in the output folder |
//! | [`cost()`] | time and memory of every phase up to the first linear system |
//! | [`solve()`] | load steps, and only the last equilibrium |
//!
//! [`Case::plan`]: crate::case::Case::plan

mod cost;
mod equilibrium;
mod forecast;
mod motion;
mod point_fields;
mod rehearsal;
mod run;
mod work;

pub use cost::{LinearCost, PassCost, SceneCost, cost};
pub use equilibrium::{Attempt, Equilibrium, NamedVector, solve};
pub use run::{Ending, Origin, RunError, RunOptions, run};
pub use work::Pass;
