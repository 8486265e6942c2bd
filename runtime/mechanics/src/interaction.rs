//! Interactions are the cliques of the neighbour graph: pairs, triples and quadruples of points
//! that are pairwise within the horizon, each visited once, from its lowest point, its *owner*.
//!
//! Nothing is stored: an owner's cliques are enumerated whenever they are needed, through bit sets
//! over its later neighbours. Cliques without area or volume at rest are dropped and counted.

mod census;
mod clique;
mod counts;
mod degenerate;
pub(crate) mod runs;
pub(crate) mod schedule;
mod slab;

pub use census::Census;
pub use clique::{Bits, ContributingPairs, Lost, OwnerCliques, Ranks, never_fails};
pub(crate) use clique::{Clique, CliqueRoom};
pub use counts::{Inverted, Report};
pub use degenerate::Degeneracy;
pub use slab::Slabs;

use crate::kernel::Measure;

/// How many neighbours an interaction has: its corners besides the owner.
pub fn n_neighbors(measure: Measure) -> usize {
    match measure {
        Measure::Length => 1,
        Measure::Area => 2,
        Measure::Volume => 3,
    }
}
