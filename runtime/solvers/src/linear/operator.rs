//! The tangent as the iterative methods see it: something that multiplies vectors.
//!
//! Vectors are full, one entry per degree of freedom. The methods keep them 0 at fixed degrees of
//! freedom, so that the product with `K` and 0 written there is the product with `K_ff`.

use piola_mechanics::energy::Hessian;
use piola_mechanics::interaction::Slabs;
use piola_mechanics::matrix::BlockMatrix;

/// A matrix that multiplies.
pub(super) trait Operator: Sync {
    /// `y = K x`; both have one entry per degree of freedom.
    fn multiply(&self, x: &[f64], y: &mut [f64]);
}

/// A stored upper triangle, with the slabs of its pattern.
pub(super) struct StoredMatrix<'a> {
    pub(super) matrix: &'a BlockMatrix,
    pub(super) slabs: &'a Slabs,
}

impl Operator for StoredMatrix<'_> {
    fn multiply(&self, x: &[f64], y: &mut [f64]) {
        self.matrix.multiply_into(self.slabs, x, y);
    }
}

/// The tangent, multiplied by the energy's own kernels and never stored.
pub(super) struct MatrixFree<'a> {
    pub(super) hessian: &'a dyn Hessian,
}

impl Operator for MatrixFree<'_> {
    fn multiply(&self, x: &[f64], y: &mut [f64]) {
        // The methods stop at what is not a number.
        self.hessian.multiply(x, y);
    }
}
