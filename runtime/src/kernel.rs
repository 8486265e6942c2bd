//! The one door to the compiler: everything the runtime needs of an energy is a [`Law`].

pub use piola_compiler::{Batch, Level, Measure, Order, Outputs};

/// An energy density of one measure with its first two derivatives, evaluated over arrays.
///
/// The runtime never sees an expression: compiled kernels, interpreters and the closures of tests
/// all stand behind this trait.
pub trait Law: Send + Sync {
    /// Fills `out` with psi and, as the order asks, dpsi/dm and d2psi/dm2 for every entry of the batch.
    ///
    /// The unit of psi is J/m^(2d), J/m^(3d), J/m^(4d) for bonds, triangles, tetrahedra.
    fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>);
}

impl<F> Law for F
where
    F: Fn(Batch<'_>, Order, Outputs<'_>) + Send + Sync,
{
    fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>) {
        self(batch, order, out);
    }
}

impl Law for piola_compiler::Kernel {
    fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>) {
        piola_compiler::Kernel::evaluate(self, batch, order, out);
    }
}
