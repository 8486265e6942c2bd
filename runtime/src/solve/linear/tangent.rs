//! The matrix of a linear system, stored or not.

use std::borrow::Cow;

use crate::energy::TotalEnergy;
use crate::matrix::BlockMatrix;

/// The tangent stiffness as it is given to the linear solver.
#[derive(Clone, Copy)]
pub enum Tangent<'a> {
    /// Its upper triangle.
    Stored(&'a BlockMatrix),
    /// The energy that multiplies with it, at displacements `u` (`n x d`, m), and its diagonal
    /// blocks (`n x d x d`, N/m).
    MatrixFree {
        /// Whose tangent it is.
        energy: &'a dyn TotalEnergy,
        /// Where.
        u: &'a [f64],
        /// As [`TotalEnergy::tangent_diagonal`] gives them.
        diagonal: &'a [f64],
    },
    /// The energy that multiplies with it, at displacements `u` (`n x d`, m), and a matrix like it.
    Bonds {
        /// Whose tangent it is.
        energy: &'a dyn TotalEnergy,
        /// Where.
        u: &'a [f64],
        /// As [`TotalEnergy::bond_tangent`] gives it.
        bonds: &'a BlockMatrix,
    },
}

impl<'a> From<&'a BlockMatrix> for Tangent<'a> {
    fn from(matrix: &'a BlockMatrix) -> Tangent<'a> {
        Tangent::Stored(matrix)
    }
}

impl<'a> Tangent<'a> {
    /// The diagonal blocks, `d x d` row by row; of the matrix like it where that is at hand.
    pub(super) fn diagonal(self) -> Cow<'a, [f64]> {
        match self {
            Tangent::Stored(matrix) | Tangent::Bonds { bonds: matrix, .. } => {
                let pattern = &matrix.pattern;
                let block = pattern.dimension * pattern.dimension;
                let rows = pattern.row_start[..pattern.n_rows()].iter();
                let values = |&row: &usize| &matrix.values[row * block..(row + 1) * block];
                Cow::Owned(rows.flat_map(values).copied().collect())
            }
            Tangent::MatrixFree { diagonal, .. } => Cow::Borrowed(diagonal),
        }
    }

    /// Whether all numbers that are at hand are finite.
    pub(super) fn is_finite(self) -> bool {
        match self {
            Tangent::Stored(matrix) | Tangent::Bonds { bonds: matrix, .. } => {
                matrix.values.iter().all(|x| x.is_finite())
            }
            Tangent::MatrixFree { diagonal, .. } => diagonal.iter().all(|x| x.is_finite()),
        }
    }

    /// `|K| |x|`, the scale of the rounding errors of `K x`; of a tangent that is not stored an
    /// estimate: that of the matrix like it, or twice the same with the diagonal blocks alone, since
    /// the others of a row sum up to them, and displacements of neighbours are alike.
    pub fn multiply_absolute(self, x: &[f64]) -> Vec<f64> {
        match self {
            Tangent::Stored(matrix) | Tangent::Bonds { bonds: matrix, .. } => {
                matrix.multiply_absolute(x)
            }
            Tangent::MatrixFree { energy, diagonal, .. } => {
                let d = energy.dimension();
                let rows = diagonal.chunks_exact(d).enumerate();
                let row = |(dof, row): (usize, &[f64])| {
                    let x = &x[dof / d * d..(dof / d + 1) * d];
                    2.0 * row.iter().zip(x).fold(0.0, |sum, (k, x)| sum + (k * x).abs())
                };
                rows.map(row).collect()
            }
        }
    }
}
