//! Words of `piola eval`.

use clap::{Args, ValueEnum};

use super::{Inputs, Level, Mode};

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "lower")]
pub(crate) enum MeasureName {
    /// Length of a bond
    L,
    /// Area measure of a triangle
    A,
    /// Volume measure of a tetrahedron
    V,
    /// Deformation gradient
    #[value(name = "F")]
    F,
    /// Vector of a bond
    Xi,
    /// What points gather, in an energy of points
    Points,
    /// What the ends of a bond gather, with its length or its vector
    Bonds,
    /// Several measures of a triangle
    Triangles,
    /// Several measures of a tetrahedron
    Tetrahedra,
}

#[derive(Debug, Args)]
pub(crate) struct Eval {
    /// A potential file (.piola), or a name of the library
    pub(crate) file: String,
    /// Which energy
    #[arg(long)]
    pub(crate) measure: MeasureName,
    /// Number of dimensions
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(2..=3))]
    pub(crate) dim: u8,
    #[command(flatten)]
    pub(crate) inputs: Inputs,
    /// CSV with the columns `l,L` (or `a,A`, `v,V`, `F11,F12,..`; of points `I1,I2,..`, of bonds `l,L,I1,..`, of vectors
    /// `Xi1,..,u1,..,I1,..` with `u = xi - Xi`, as `piola derive` numbers them; of triangles `a,l1,..,A,L1,..`); `-` is the standard input
    #[arg(long)]
    pub(crate) points: String,
    /// How it is computed
    #[arg(long, default_value = "jit")]
    pub(crate) mode: Mode,
    /// Level of the machine code
    #[arg(long, default_value = "fast")]
    pub(crate) level: Level,
}
