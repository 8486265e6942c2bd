//! Accuracy against time: one scene solved in many ways, measured in one process.
//!
//! | stage | module |
//! |---|---|
//! | what can be varied | [`axes`]: a table of axes and a table of combinations |
//! | what is compared | [`quantity`]: energy, reactions, probes, displacements, residual |
//! | what is right | [`mod@reference`]: strict, direct, the tightest tolerance that converges; and how far equally exact runs differ |
//! | what the scene can see | [`resolution`]: the same scene on another lattice |
//! | how long it takes | [`statistics`]: interleaved repeats within a budget |
//! | who is beaten | [`front`]: by less time that noise does not explain, and no larger error |
//! | all of it | [`mod@study`], and [`verdict`], which picks a setting |
//! | what is written | [`report`] |
//!
//! Times are those of [`solve`](crate::simulation::solve()): compiling kernels, finding
//! interactions, all load steps; no reading of files, no output.

pub mod axes;
pub mod front;
pub mod outcome;
pub mod quantity;
pub mod reference;
pub mod report;
pub mod resolution;
pub mod statistics;
pub mod study;
pub mod verdict;

#[cfg(test)]
mod tests;

pub use axes::{AXES, Axis, Changes, Setting};
pub use quantity::Quantity;
pub use reference::Reference;
pub use resolution::Resolution;
pub use study::{Options, Study, study};

use crate::case::{Case, CaseError};

/// Unit roundoff of f64.
pub const ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// Reads the scene with further overrides (`solver.linear=cg`).
pub type ReadCase<'a> = dyn Fn(&[String]) -> Result<Case, CaseError> + 'a;

/// Why a study could not be made.
#[derive(Debug, thiserror::Error)]
pub enum TradeError {
    /// The scene.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// A quantity that the scene does not have.
    #[error("there is no quantity `{name}` in this scene")]
    UnknownQuantity {
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
    /// An axis that is not in the table, or that the scene does not have.
    #[error("there is no axis `{name}`")]
    UnknownAxis {
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
    /// Values to be tried that are not written as they must be.
    #[error("`{text}` names no values to be tried")]
    WrongVariation {
        /// What was asked for.
        text: String,
    },
    /// More settings than anyone waits for.
    #[error("these axes have {found} settings, more than {limit}")]
    TooManySettings {
        /// How many.
        found: usize,
        /// The limit.
        limit: usize,
    },
    /// No reference: nothing can be compared.
    #[error("no reference run reached the end of the scene: {reason}")]
    NoReference {
        /// What became of the last one tried.
        reason: String,
    },
}

impl TradeError {
    /// What the user can do about it, where we know.
    pub fn help(&self) -> Option<String> {
        match self {
            TradeError::UnknownQuantity { known, .. } => {
                Some(format!("it has {}", known.join(", ")))
            }
            TradeError::UnknownAxis { known, .. } => {
                Some(format!("there are {}", known.join(", ")))
            }
            TradeError::WrongVariation { .. } => Some(
                "write a key and its values, `material.potential=silling2000,miranda_modified_stretch`"
                    .to_string(),
            ),
            TradeError::TooManySettings { .. } => Some("name fewer axes".to_string()),
            TradeError::NoReference { .. } => {
                Some("give it a larger --budget, or make the scene smaller".to_string())
            }
            TradeError::Case(_) => None,
        }
    }
}
