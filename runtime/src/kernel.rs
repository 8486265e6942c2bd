//! The one door to the compiler: everything the runtime needs of an energy is a [`Law`].

pub use piola_compiler::{Batch, Derivatives, Measure};

/// An energy density of one measure with its first two derivatives, evaluated over arrays.
///
/// The runtime never sees an expression: compiled kernels, interpreters and the closures of tests
/// all stand behind this trait.
pub trait Law: Send + Sync {
    /// Fills `out` with psi, dpsi/dm and d2psi/dm2 for every entry of the batch.
    ///
    /// The unit of psi is J/m^(2d), J/m^(3d), J/m^(4d) for bonds, triangles, tetrahedra.
    fn evaluate(&self, batch: Batch<'_>, out: &mut Derivatives);
}

impl<F> Law for F
where
    F: Fn(Batch<'_>, &mut Derivatives) + Send + Sync,
{
    fn evaluate(&self, batch: Batch<'_>, out: &mut Derivatives) {
        self(batch, out);
    }
}

impl Law for piola_compiler::Kernel {
    fn evaluate(&self, batch: Batch<'_>, out: &mut Derivatives) {
        piola_compiler::Kernel::evaluate(self, batch, out);
    }
}
