//! What is done with a scene made ready ([`crate::case`]).
//!
//! | call | what |
//! |---|---|
//! | [`Case::plan`] | what will be modelled and what it costs |
//! | [`run()`] | load steps or a motion, with everything they leave in the output folder |
//! | `ranks::run` | the same over many processes, with the feature `petsc` |
//! | [`cost()`] | time and memory of every phase, up to the first linear system or the steps of a motion |
//! | [`bond_history`] | the history of one bond: why it broke, or did not |
//! | [`solve()`] | load steps or a motion, and only what comparisons look at |
//!
//! [`Case::plan`]: crate::case::Case::plan

mod bond;
mod breaking;
mod cost;
mod course;
mod forecast;
mod motion;
mod point_fields;
#[cfg(feature = "petsc")]
pub mod ranks;
mod rehearsal;
mod run;
mod tracks;
mod work;

pub use bond::{
    BondBreak, BondCondition, BondEnd, BondHistory, BondRow, LargestMargin, Place, bond_history,
    points_of,
};
pub use cost::{LinearCost, MotionCost, PassCost, SceneCost, cost};
pub use course::{Attempt, Course, Failure, Moment, NamedVector, follow, solve, solve_watched};
pub use run::{Ending, Origin, RunError, RunOptions, run};
pub use work::Pass;
