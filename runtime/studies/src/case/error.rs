//! What can be wrong with a scene and the files it names.

use std::io::Read as _;
use std::path::Path;

use piola_compiler::CompileError;
use piola_grammar::{Diagnostic, Span};
use piola_mechanics::assembly::AssemblyError;
use piola_mechanics::deformation::DeformationError;
use piola_mechanics::lattice::LatticeError;
use piola_mechanics::neighborhood::NeighborhoodError;
use piola_mechanics::states::StateError;
use piola_mechanics::vectors::VectorError;
use piola_meshes::MeshError;
use piola_output::read::TableError;
use piola_solvers::constraint::ConstraintError;
use piola_solvers::steps::StepError;

use crate::scene::boundary::NonFiniteCondition;
use crate::scene::{PotentialText, SceneReport};

/// The code of a file that cannot be read.
pub const UNREADABLE: &str = "unreadable-file";

/// Why a scene cannot be run.
#[derive(Clone, Debug, thiserror::Error)]
pub enum CaseError {
    /// A file cannot be read.
    #[error("cannot read {path}: {reason}")]
    Unreadable {
        /// The file.
        path: String,
        /// Why.
        reason: String,
    },
    /// Mistakes in the scene.
    #[error(transparent)]
    Scene(#[from] SceneReport),
    /// Mistakes in the potential, or in a table of points or displacements.
    #[error("{}", diagnostics.first().map_or("", |d| d.message.as_str()))]
    Text {
        /// The file or the name in the library.
        name: String,
        /// Its text.
        text: String,
        /// What is wrong.
        diagnostics: Vec<Diagnostic>,
    },
    /// A mistake in a file that is no text.
    #[error("{name}, {error}")]
    Binary {
        /// The file.
        name: String,
        /// What is wrong at which of its bytes.
        error: Box<MeshError>,
    },
    /// Points that a lattice cannot have.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// Points without neighbours, or at one place.
    #[error(transparent)]
    Neighborhood(#[from] NeighborhoodError),
    /// Interactions that cannot be assembled.
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    /// Families without deformation gradients.
    #[error(transparent)]
    Deformation(#[from] DeformationError),
    /// Families whose states cannot be gathered.
    #[error(transparent)]
    States(#[from] StateError),
    /// Families of which no vectors can be gathered.
    #[error(transparent)]
    Vectors(#[from] VectorError),
    /// Degrees of freedom that cannot be fixed.
    #[error(transparent)]
    Constraint(#[from] ConstraintError),
    /// A condition that is not finite.
    #[error(transparent)]
    Condition(#[from] NonFiniteCondition),
    /// Steps that cannot start.
    #[error(transparent)]
    Step(#[from] StepError),
    /// An energy that cannot be compiled, for no place in its text.
    #[error(transparent)]
    Compile(#[from] CompileError),
    /// What a scene asks for and its body cannot have.
    #[error("{message}")]
    Body {
        /// What is wrong, and what to do.
        message: String,
    },
}

impl CaseError {
    /// The error as a finding of no place, for those that have none in a text.
    pub fn unplaced(&self) -> Diagnostic {
        let code = match self {
            CaseError::Unreadable { .. } => UNREADABLE,
            CaseError::Binary { error, .. } => error.diagnostic.code,
            _ => "unusable-scene",
        };
        Diagnostic::error(code, Span::new(0, 0), self.to_string())
    }

    /// An energy that cannot be compiled, at its place in the potential.
    pub(crate) fn compile(potential: &PotentialText, error: &CompileError) -> CaseError {
        let (code, span) = match error {
            CompileError::TooLarge { span, .. } => ("too-large", *span),
            CompileError::NoHorizon { span, .. } => ("no-horizon", *span),
            CompileError::WrongDimension(_) | CompileError::Backend(_) => {
                return CaseError::Compile(error.clone());
            }
        };
        CaseError::Text {
            name: potential.place(),
            text: potential.text.clone(),
            diagnostics: vec![Diagnostic::error(code, span, error.to_string())],
        }
    }

    /// A mistake in a file of points or cells; shown at its place where that is text.
    pub(crate) fn mesh(path: &Path, bytes: &[u8], error: MeshError) -> CaseError {
        if !error.is_text {
            let name = path.display().to_string();
            return CaseError::Binary { name, error: Box::new(error) };
        }
        // Byte by byte, so that places stay what they are.
        let shown = bytes.iter().map(|byte| if byte.is_ascii() { *byte as char } else { '?' });
        CaseError::Text {
            name: path.display().to_string(),
            text: shown.collect(),
            diagnostics: vec![error.diagnostic],
        }
    }

    /// The mistakes in a table, each at its place.
    pub fn table(path: &Path, text: &str, errors: Vec<TableError>) -> CaseError {
        CaseError::Text {
            name: path.display().to_string(),
            text: text.to_string(),
            diagnostics: errors.into_iter().map(|error| error.diagnostic).collect(),
        }
    }
}

fn unreadable(path: &Path, reason: String) -> CaseError {
    CaseError::Unreadable { path: path.display().to_string(), reason }
}

/// A whole text file of at most `limit` bytes.
pub(crate) fn read_text(path: &Path, limit: u64) -> Result<String, CaseError> {
    as_text(path, read_bytes(path, limit)?)
}

/// What was read of a file, as text.
pub(super) fn as_text(path: &Path, bytes: Vec<u8>) -> Result<String, CaseError> {
    String::from_utf8(bytes).map_err(|_| unreadable(path, "it is not UTF-8 text".to_string()))
}

/// A whole file of at most `limit` bytes.
pub(crate) fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>, CaseError> {
    let mut bytes = Vec::new();
    let read =
        std::fs::File::open(path).and_then(|file| file.take(limit + 1).read_to_end(&mut bytes));
    read.map_err(|error| unreadable(path, error.to_string()))?;
    if bytes.len() as u64 > limit {
        return Err(unreadable(path, format!("it has more than {limit} bytes")));
    }
    Ok(bytes)
}
