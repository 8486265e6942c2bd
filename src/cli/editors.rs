//! What may be typed of writing potentials and scenes.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

pub(super) const NEW_EXAMPLE: &str = "Example:
  piola new rubber --template bar && piola run rubber/scene.toml --out rubber/out";

pub(super) const FMT_EXAMPLE: &str = "Examples:
  piola fmt law.piola
  piola fmt --check potentials/*.piola
  piola fmt - < law.piola";

#[derive(Debug, Args)]
pub(crate) struct Fmt {
    /// Potential files, or `-` for stdin and stdout
    #[arg(required = true, value_name = "FILE")]
    pub(crate) files: Vec<String>,
    /// Write nothing; exit code 1 if a file is not as it would be written
    #[arg(long)]
    pub(crate) check: bool,
}

#[derive(Debug, Args)]
pub(crate) struct New {
    /// The folder; what is in it stays
    pub(crate) folder: PathBuf,
    /// What it is about
    #[arg(long, default_value = "plate")]
    pub(crate) template: Template,
}

/// What to begin with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Template {
    /// A sheet with a hole, by bonds and triangles
    Plate,
    /// A bar in space, by the deformation gradient
    Bar,
    /// A plate with a crack that runs
    Crack,
    /// A sheet with fibres
    Fibre,
    /// A law alone
    Law,
}
