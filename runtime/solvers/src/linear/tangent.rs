//! The matrix of a linear system, stored or not.

use std::borrow::Cow;

use piola_mechanics::energy::Hessian;
use piola_mechanics::matrix::BlockMatrix;

/// The tangent stiffness as it is given to the linear solver.
#[derive(Clone, Copy)]
pub enum Tangent<'a> {
    /// Its upper triangle; and what multiplies in less time, where there is such a thing.
    Stored(&'a BlockMatrix, Option<&'a dyn Hessian>),
    /// Products with it, and its diagonal blocks (`n x d x d`, N/m).
    MatrixFree {
        /// What multiplies.
        hessian: &'a dyn Hessian,
        /// As [`Energy::tangent_diagonal`](piola_mechanics::energy::Energy::tangent_diagonal) gives them.
        diagonal: &'a [f64],
    },
    /// Products with it, and a matrix like it.
    Bonds {
        /// What multiplies.
        hessian: &'a dyn Hessian,
        /// As [`Energy::springs`](piola_mechanics::energy::Energy::springs) gives it.
        bonds: &'a BlockMatrix,
    },
}

impl<'a> From<&'a BlockMatrix> for Tangent<'a> {
    fn from(matrix: &'a BlockMatrix) -> Tangent<'a> {
        Tangent::Stored(matrix, None)
    }
}

impl<'a> Tangent<'a> {
    /// The diagonal blocks, `d x d` row by row; of the matrix like it where that is at hand.
    pub(super) fn diagonal(self) -> Cow<'a, [f64]> {
        match self {
            Tangent::Stored(matrix, _) | Tangent::Bonds { bonds: matrix, .. } => {
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
            Tangent::Stored(matrix, _) | Tangent::Bonds { bonds: matrix, .. } => {
                matrix.values.iter().all(|x| x.is_finite())
            }
            Tangent::MatrixFree { diagonal, .. } => diagonal.iter().all(|x| x.is_finite()),
        }
    }

    /// `|K| |x|`, the scale of the rounding errors of `K x`; of a tangent that is not stored an
    /// estimate: that of the matrix like it, or from its diagonal blocks.
    pub fn multiply_absolute(self, x: &[f64]) -> Vec<f64> {
        match self {
            Tangent::Stored(matrix, _) | Tangent::Bonds { bonds: matrix, .. } => {
                matrix.multiply_absolute(x)
            }
            Tangent::MatrixFree { diagonal, .. } => absolute_of_diagonal(diagonal, x),
        }
    }
}

/// `|K| |x|` from the diagonal blocks (`n x d x d`): twice the same with them alone, since the others of a
/// row sum up to them, and displacements of neighbours are alike.
pub(crate) fn absolute_of_diagonal(diagonal: &[f64], x: &[f64]) -> Vec<f64> {
    let d = diagonal.len() / x.len().max(1);
    let rows = diagonal.chunks_exact(d.max(1)).enumerate();
    let row = |(dof, row): (usize, &[f64])| {
        let x = &x[dof / d * d..(dof / d + 1) * d];
        2.0 * row.iter().zip(x).fold(0.0, |sum, (k, x)| sum + (k * x).abs())
    };
    rows.map(row).collect()
}
