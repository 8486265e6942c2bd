//! The tangent that Newton's method holds: its matrix, or what products without a matrix need.

use std::cell::OnceCell;

use piola_mechanics::energy::{Energy, Hessian, NonFinite, Wanted};
use piola_mechanics::matrix::BlockMatrix;

use super::linear::{Tangent, absolute_of_diagonal};

enum Storage {
    Matrix(BlockMatrix),
    /// The diagonal blocks.
    Diagonal(Vec<f64>),
    /// What couples bonded points.
    Springs(BlockMatrix),
}

/// A tangent and where it was evaluated.
pub struct HeldTangent<'a> {
    energy: &'a dyn Energy,
    storage: Storage,
    /// What multiplies where the matrix is not stored, once it is asked for.
    hessian: OnceCell<Box<dyn Hessian + 'a>>,
    at: Vec<f64>,
    is_valid: bool,
}

impl<'a> HeldTangent<'a> {
    /// Room for a tangent, stored or not.
    pub fn new(energy: &'a dyn Energy, stored: bool) -> HeldTangent<'a> {
        let n = energy.positions().len();
        let storage = match (stored, energy.bond_pattern()) {
            (true, _) => Storage::Matrix(BlockMatrix::zeros(energy.pattern())),
            (false, Some(pattern)) => Storage::Springs(BlockMatrix::zeros(pattern)),
            (false, None) => Storage::Diagonal(vec![0.0; n * energy.dimension()]),
        };
        let hessian = OnceCell::new();
        HeldTangent { energy, storage, hessian, at: vec![0.0; n], is_valid: false }
    }

    /// Takes the tangent at `u`; also the parts of the energy and its gradient.
    pub fn evaluate(
        &mut self,
        u: &[f64],
        gradient: &mut [f64],
        parts: &mut [f64],
    ) -> Result<(), NonFinite> {
        self.is_valid = false;
        // The one before goes first: there is room for one.
        self.hessian = OnceCell::new();
        let wanted = match &mut self.storage {
            Storage::Matrix(matrix) => Wanted::Tangent(gradient, matrix),
            Storage::Diagonal(diagonal) => Wanted::Diagonal(gradient, diagonal),
            Storage::Springs(springs) => {
                self.energy.springs(u, springs);
                Wanted::Forces(gradient)
            }
        };
        self.energy.evaluate(u, wanted, parts)?;
        self.at.copy_from_slice(u);
        self.is_valid = true;
        Ok(())
    }

    /// Stores the tangent itself from now on, that of the same displacements first.
    pub(super) fn store(&mut self) -> Result<(), NonFinite> {
        self.hessian = OnceCell::new();
        let mut stored = HeldTangent::new(self.energy, true);
        let mut gradient = vec![0.0; self.at.len()];
        stored.evaluate(&self.at, &mut gradient, &mut vec![0.0; self.energy.parts().len()])?;
        *self = stored;
        Ok(())
    }

    /// What was taken is no tangent any more: the energy is another one.
    pub(super) fn forget(&mut self) {
        self.hessian = OnceCell::new();
        self.is_valid = false;
    }

    /// Whether it is the tangent at `u`.
    pub(super) fn is_at(&self, u: &[f64]) -> bool {
        self.is_valid && self.at == u
    }

    /// As the linear solver takes it.
    pub fn tangent(&self) -> Result<Tangent<'_>, NonFinite> {
        Ok(match &self.storage {
            Storage::Matrix(matrix) => {
                let is_quick = self.energy.has_quick_products();
                let quick = is_quick.then(|| self.hessian()).transpose()?;
                Tangent::Stored(matrix, quick)
            }
            Storage::Diagonal(diagonal) => {
                Tangent::MatrixFree { hessian: self.hessian()?, diagonal }
            }
            Storage::Springs(bonds) => Tangent::Bonds { hessian: self.hessian()?, bonds },
        })
    }

    fn hessian(&self) -> Result<&dyn Hessian, NonFinite> {
        if let Some(hessian) = self.hessian.get() {
            return Ok(&**hessian);
        }
        let made = self.energy.hessian(&self.at)?;
        Ok(&**self.hessian.get_or_init(|| made))
    }

    /// `product` becomes `K x` in N (`n x d`), for `x` in m.
    pub(super) fn multiply(&self, x: &[f64], product: &mut [f64]) -> Result<(), NonFinite> {
        match &self.storage {
            Storage::Matrix(matrix) => product.copy_from_slice(&matrix.multiply(x)),
            _ => self.hessian()?.multiply(x, product),
        }
        Ok(())
    }

    /// `|K| |x|` as [`Tangent::multiply_absolute`]: of what is stored, so that nothing need be made.
    pub(super) fn multiply_absolute(&self, x: &[f64]) -> Vec<f64> {
        match &self.storage {
            Storage::Matrix(matrix) | Storage::Springs(matrix) => matrix.multiply_absolute(x),
            Storage::Diagonal(diagonal) => absolute_of_diagonal(diagonal, x),
        }
    }

    /// Whether it is the tangent itself that is stored.
    pub fn is_stored(&self) -> bool {
        matches!(self.storage, Storage::Matrix(_))
    }

    /// What is stored of it, in bytes.
    pub fn bytes(&self) -> u64 {
        let numbers = match &self.storage {
            Storage::Matrix(matrix) | Storage::Springs(matrix) => &matrix.values[..],
            Storage::Diagonal(diagonal) => diagonal,
        };
        size_of_val(numbers) as u64
    }
}
