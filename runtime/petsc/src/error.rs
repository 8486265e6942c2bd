//! What goes wrong.

use std::fmt;

/// An error of PETSc, of MPI or of what they were given, as one line for a user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EngineError {
    /// The function of PETSc that failed, what it says, and the kind of error; or words of this crate.
    pub message: String,
}

impl EngineError {
    pub(crate) fn new(message: impl Into<String>) -> EngineError {
        EngineError { message: message.into() }
    }
}

impl fmt::Display for EngineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for EngineError {}

/// What one rank failed with, as all ranks know it after [`Engine::agree`](crate::Engine::agree).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The first rank that failed, from 0.
    pub rank: usize,
    /// Its reason, in its own words.
    pub message: String,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "rank {}: {}", self.rank, self.message)
    }
}

impl std::error::Error for Failure {}

impl From<Failure> for EngineError {
    fn from(failure: Failure) -> EngineError {
        EngineError::new(failure.to_string())
    }
}
