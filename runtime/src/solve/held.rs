//! The tangent that Newton's method holds: its matrix, or what products without a matrix need.

use super::linear::Tangent;
use crate::energy::{EnergyParts, NonFinite, TotalEnergy};
use crate::matrix::BlockMatrix;

enum Storage {
    Matrix(BlockMatrix),
    /// The diagonal blocks.
    Diagonal(Vec<f64>),
    /// What couples bonded points.
    Bonds(BlockMatrix),
}

/// A tangent and where it was evaluated.
pub(crate) struct HeldTangent {
    storage: Storage,
    at: Vec<f64>,
    is_valid: bool,
}

impl HeldTangent {
    /// Room for a tangent, stored or not.
    pub(crate) fn new(energy: &dyn TotalEnergy, stored: bool) -> HeldTangent {
        let n = energy.positions().len();
        let storage = match (stored, energy.bond_pattern()) {
            (true, _) => Storage::Matrix(BlockMatrix::zeros(energy.pattern())),
            (false, Some(pattern)) => Storage::Bonds(BlockMatrix::zeros(pattern)),
            (false, None) => Storage::Diagonal(vec![0.0; n * energy.dimension()]),
        };
        HeldTangent { storage, at: vec![0.0; n], is_valid: false }
    }

    /// Takes the tangent at `u`; also the energy and its gradient.
    pub(crate) fn evaluate(
        &mut self,
        energy: &dyn TotalEnergy,
        u: &[f64],
        gradient: &mut [f64],
    ) -> Result<EnergyParts, NonFinite> {
        self.is_valid = false;
        let parts = match &mut self.storage {
            Storage::Matrix(matrix) => energy.tangent(u, gradient, matrix)?,
            Storage::Diagonal(diagonal) => energy.tangent_diagonal(u, gradient, diagonal)?,
            Storage::Bonds(bonds) => {
                energy.bond_tangent(u, bonds);
                energy.gradient(u, gradient)?
            }
        };
        self.at.copy_from_slice(u);
        self.is_valid = true;
        Ok(parts)
    }

    /// Whether it is the tangent at `u`.
    pub(super) fn is_at(&self, u: &[f64]) -> bool {
        self.is_valid && self.at == u
    }

    /// As the linear solver takes it.
    pub(crate) fn tangent<'a>(&'a self, energy: &'a dyn TotalEnergy) -> Tangent<'a> {
        match &self.storage {
            Storage::Matrix(matrix) => Tangent::Stored(matrix),
            Storage::Diagonal(diagonal) => Tangent::MatrixFree { energy, u: &self.at, diagonal },
            Storage::Bonds(bonds) => Tangent::Bonds { energy, u: &self.at, bonds },
        }
    }

    /// Whether it is the tangent itself that is stored.
    pub(crate) fn is_stored(&self) -> bool {
        matches!(self.storage, Storage::Matrix(_))
    }

    /// What is stored of it, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        let numbers = match &self.storage {
            Storage::Matrix(matrix) | Storage::Bonds(matrix) => &matrix.values[..],
            Storage::Diagonal(diagonal) => diagonal,
        };
        size_of_val(numbers) as u64
    }
}
