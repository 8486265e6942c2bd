//! What may be typed of writing potentials.

use clap::Args;

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
