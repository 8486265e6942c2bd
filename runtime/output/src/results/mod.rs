//! What a run left, read back from its folder.

pub(crate) mod frame;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{OutputError, OutputFile, atomic};
use frame::ReadFrame;

/// Why nothing is made of what a run left.
#[derive(Debug, thiserror::Error)]
pub enum ResultsError {
    /// A folder without a run.
    #[error("{path} holds no run: there is no summary.json in it")]
    NoRun {
        /// The folder.
        path: PathBuf,
    },
    /// A file that cannot be read.
    #[error("cannot read {path}: {reason}")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A file that is not as piola writes it.
    #[error("{path} is not as piola writes it: it was cut or changed")]
    Broken {
        /// The file.
        path: PathBuf,
    },
    /// A place where nothing can stand.
    #[error("cannot write {path}: {reason}")]
    Unwritable {
        /// The place.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Something that the run has not.
    #[error("{path} has no {wanted}; it has {found}")]
    Missing {
        /// The folder or the file.
        path: PathBuf,
        /// What was asked for.
        wanted: String,
        /// What there is.
        found: String,
    },
    /// A file that cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// A frame among those of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Listed {
    /// Load parameter, or time in s.
    pub t: f64,
    /// Its file.
    pub file: PathBuf,
    /// The file of the cells, of a mesh whose cells are the points.
    pub cells: Option<PathBuf>,
}

/// The results of a run.
#[derive(Clone, Debug)]
pub struct Results {
    folder: PathBuf,
    summary: Value,
    frames: Vec<Listed>,
}

impl Results {
    /// What is in a folder.
    ///
    /// # Errors
    /// A folder without a run, files that cannot be read.
    pub fn open(folder: &Path) -> Result<Results, ResultsError> {
        let path = folder.join(OutputFile::Summary.name());
        let Some(summary) = text(&path)? else {
            return Err(ResultsError::NoRun { path: folder.to_owned() });
        };
        let summary = serde_json::from_str(&summary).map_err(|_| ResultsError::Broken { path })?;
        let list = text(&folder.join(OutputFile::Collection.name()))?.unwrap_or_default();
        Ok(Results { folder: folder.to_owned(), summary, frames: frames_of(&list, folder) })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// `summary.json`.
    pub fn summary(&self) -> &Value {
        &self.summary
    }

    /// The dimension of the body.
    pub fn dimension(&self) -> usize {
        if self.summary["dimension"].as_u64() == Some(2) { 2 } else { 3 }
    }

    /// The frames, in the order of their times.
    pub fn frames(&self) -> &[Listed] {
        &self.frames
    }

    /// A file of the folder as text, if it is there.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn text(&self, file: OutputFile) -> Result<Option<String>, ResultsError> {
        text(&self.folder.join(file.relative()))
    }
}

impl Listed {
    pub(crate) fn read(&self) -> Result<ReadFrame, ResultsError> {
        frame::read(&self.file)
    }
}

/// What is made of the bytes of a file.
pub(crate) fn decoded<T>(
    path: &Path,
    decode: impl Fn(&[u8]) -> Option<T>,
) -> Result<T, ResultsError> {
    let bytes = fs::read(path).map_err(|error| unreadable(path, &error))?;
    decode(&bytes).ok_or_else(|| ResultsError::Broken { path: path.to_owned() })
}

/// Writes a file that is made of results, anywhere: it takes the place of another, and not of a device or a
/// folder.
///
/// # Errors
/// A place that is no file, or cannot be written.
pub fn write(file: &Path, bytes: &[u8]) -> Result<(), ResultsError> {
    if fs::symlink_metadata(file).is_ok_and(|data| !data.is_file()) {
        let reason = "it is there, and no file".to_owned();
        return Err(ResultsError::Unwritable { path: file.to_owned(), reason });
    }
    Ok(atomic::write_atomically(file, |out| out.write_all(bytes))?)
}

fn unreadable(path: &Path, error: &io::Error) -> ResultsError {
    ResultsError::Unreadable { path: path.to_owned(), reason: error.to_string() }
}

fn text(path: &Path) -> Result<Option<String>, ResultsError> {
    match fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(unreadable(path, &error)),
    }
}

/// The entries of `run.pvd`; what stands there as a second part are the cells of the frame before.
fn frames_of(list: &str, folder: &Path) -> Vec<Listed> {
    let mut frames: Vec<Listed> = Vec::new();
    for entry in list.split("<DataSet ").skip(1) {
        let attribute = |name: &str| {
            let (_, rest) = entry.split_once(&format!("{name}=\""))?;
            Some(rest.split_once('"')?.0)
        };
        let Some(file) = attribute("file").map(|file| folder.join(file)) else { continue };
        let t = attribute("timestep").and_then(|t| t.parse().ok());
        match (attribute("part"), t, frames.last_mut()) {
            (Some("0"), Some(t), _) => frames.push(Listed { t, file, cells: None }),
            (Some("1"), _, Some(frame)) => frame.cells = Some(file),
            _ => {}
        }
    }
    frames
}
