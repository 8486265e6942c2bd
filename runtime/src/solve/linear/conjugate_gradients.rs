//! Conjugate gradients (faer's) with a block-Jacobi preconditioner and our own matrix product.
//!
//! The product owns each row of blocks whole, so threads change no bits; faer's vector operations
//! run on one thread. Fixed degrees of freedom stay in the vectors, with the rows and columns of
//! the unit matrix: a right-hand side that is 0 there keeps them 0.

use std::sync::atomic::{AtomicBool, Ordering};

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::matrix_free::conjugate_gradient::{
    CgError, CgParams, conjugate_gradient, conjugate_gradient_scratch,
};
use faer::matrix_free::{LinOp, Precond};
use faer::{MatMut, MatRef, Par};
use nalgebra::{Cholesky, Const, SMatrix};
use rayon::prelude::*;

use super::LinearError;
use crate::matrix::{BlockMatrix, BlockPattern};
use crate::solve::constraint::Constraints;
use crate::solve::vector::{dot, norm_of};

/// Rows of blocks per task.
const ROWS: usize = 64;

/// How a solve by conjugate gradients ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum CgOutcome {
    Converged { iterations: usize },
    NegativeCurvature,
    NotConverged,
}

/// The matrix with both triangles and the inverses of its diagonal blocks.
#[derive(Debug)]
pub(super) struct ConjugateGradients {
    dimension: usize,
    row_start: Vec<usize>,
    columns: Vec<u32>,
    /// Block in the pattern, and whether it is read transposed.
    source: Vec<(u32, bool)>,
    is_fixed: Vec<bool>,
    blocks: Vec<f64>,
    inverses: Vec<f64>,
    relative_tolerance: f64,
    max_iterations: usize,
}

impl ConjugateGradients {
    pub(super) fn new(
        pattern: &BlockPattern,
        constraints: &Constraints,
        relative_tolerance: f64,
    ) -> ConjugateGradients {
        let n = pattern.n_rows();
        let mut rows: Vec<Vec<(u32, u32, bool)>> = vec![Vec::new(); n];
        for i in 0..n {
            for block in pattern.row_start[i]..pattern.row_start[i + 1] {
                let j = pattern.columns[block];
                rows[i].push((j, block as u32, false));
                if j as usize != i {
                    // Rows i are visited in order: the lower blocks of row j come sorted, and
                    // before its own.
                    rows[j as usize].push((i as u32, block as u32, true));
                }
            }
        }
        let mut row_start = vec![0];
        row_start.extend(rows.iter().scan(0, |total, row| {
            *total += row.len();
            Some(*total)
        }));
        let d = pattern.dimension;
        ConjugateGradients {
            dimension: d,
            columns: rows.iter().flatten().map(|entry| entry.0).collect(),
            source: rows.iter().flatten().map(|entry| (entry.1, entry.2)).collect(),
            is_fixed: (0..n * d).map(|dof| constraints.is_fixed(dof)).collect(),
            blocks: vec![0.0; row_start[n] * d * d],
            inverses: vec![0.0; n * d * d],
            row_start,
            relative_tolerance,
            // Twice the unknowns cover the loss of orthogonality of ill-conditioned systems.
            max_iterations: (2 * constraints.n_free()).clamp(1000, 20_000),
        }
    }

    /// Takes the entries of `matrix`; `false` if a diagonal block is not positive definite, hence
    /// the matrix neither.
    pub(super) fn update(&mut self, matrix: &BlockMatrix) -> bool {
        match self.dimension {
            2 => self.update_blocks::<2>(matrix),
            _ => self.update_blocks::<3>(matrix),
        }
    }

    fn update_blocks<const D: usize>(&mut self, matrix: &BlockMatrix) -> bool {
        let (row_start, columns) = (&self.row_start, &self.columns);
        let (source, is_fixed) = (&self.source, &self.is_fixed);
        let mut rows = Vec::with_capacity(row_start.len() - 1);
        let mut rest = self.blocks.as_mut_slice();
        for i in 0..row_start.len() - 1 {
            let (row, tail) = rest.split_at_mut((row_start[i + 1] - row_start[i]) * D * D);
            rows.push(row);
            rest = tail;
        }
        let copy_row = |(i, (row, inverse)): (usize, (&mut [f64], &mut [f64]))| {
            let mut diagonal = SMatrix::<f64, D, D>::identity();
            for (k, out) in row.chunks_exact_mut(D * D).enumerate() {
                let (block, transposed) = source[row_start[i] + k];
                let j = columns[row_start[i] + k] as usize;
                let values = &matrix.values[block as usize * D * D..][..D * D];
                for a in 0..D {
                    for b in 0..D {
                        let entry = if transposed { values[b * D + a] } else { values[a * D + b] };
                        let held = is_fixed[i * D + a] || is_fixed[j * D + b];
                        let unit = if i == j && a == b { 1.0 } else { 0.0 };
                        out[a * D + b] = if held { unit } else { entry };
                        if i == j {
                            diagonal[(a, b)] = out[a * D + b];
                        }
                    }
                }
            }
            match inverse_if_definite(diagonal) {
                Some(values) => {
                    inverse.copy_from_slice(values.as_slice());
                    true
                }
                None => false,
            }
        };
        let inverses = self.inverses.par_chunks_exact_mut(D * D);
        let definite = rows.into_par_iter().zip(inverses).enumerate().map(copy_row);
        definite.reduce(|| true, |a, b| a & b)
    }

    /// Solves `K x = rhs`; entries at fixed degrees of freedom are taken as 0 and become 0.
    pub(super) fn solve(
        &self,
        rhs: &[f64],
        solution: &mut [f64],
    ) -> Result<CgOutcome, LinearError> {
        let n = rhs.len();
        solution.fill(0.0);
        let mut scaled = rhs.to_vec();
        for (value, &fixed) in scaled.iter_mut().zip(&self.is_fixed) {
            *value = if fixed { 0.0 } else { *value };
        }
        // A right-hand side of norm 1: squares of tiny forces do not underflow.
        let scale = norm_of(&scaled);
        if scale == 0.0 {
            return Ok(CgOutcome::Converged { iterations: 0 });
        }
        scaled.iter_mut().for_each(|value| *value /= scale);
        let operator = Operator { matrix: self, negative_curvature: AtomicBool::new(false) };
        let preconditioner = BlockJacobi { matrix: self };
        let scratch = conjugate_gradient_scratch(&preconditioner, &operator, 1, Par::Seq);
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| LinearError::OutOfMemory)?;
        // faer leaves the residual unset for InitialGuessStatus::Zero; the default computes it.
        let params = CgParams {
            rel_tolerance: self.relative_tolerance,
            max_iters: self.max_iterations,
            ..Default::default()
        };
        let outcome = conjugate_gradient(
            MatMut::from_column_major_slice_mut(solution, n, 1),
            &preconditioner,
            &operator,
            MatRef::from_column_major_slice(&scaled, n, 1),
            params,
            |_| {},
            Par::Seq,
            MemStack::new(&mut memory),
        );
        solution.iter_mut().for_each(|value| *value *= scale);
        if operator.negative_curvature.load(Ordering::Relaxed) {
            return Ok(CgOutcome::NegativeCurvature);
        }
        Ok(match outcome {
            Ok(info) => CgOutcome::Converged { iterations: info.iter_count },
            Err(CgError::NonPositiveDefiniteOperator) => CgOutcome::NegativeCurvature,
            Err(_) => CgOutcome::NotConverged,
        })
    }

    fn multiply<const D: usize>(&self, x: &[f64], y: &mut [f64]) {
        y.par_chunks_mut(ROWS * D).enumerate().for_each(|(chunk, y)| {
            for (k, y) in y.chunks_exact_mut(D).enumerate() {
                let i = chunk * ROWS + k;
                let mut sum = [0.0; D];
                let columns = &self.columns[self.row_start[i]..self.row_start[i + 1]];
                let blocks = &self.blocks[self.row_start[i] * D * D..];
                for (&j, block) in columns.iter().zip(blocks.chunks_exact(D * D)) {
                    let x = &x[j as usize * D..][..D];
                    for a in 0..D {
                        for b in 0..D {
                            sum[a] += block[a * D + b] * x[b];
                        }
                    }
                }
                y.copy_from_slice(&sum);
            }
        });
    }

    fn precondition<const D: usize>(&self, x: &[f64], y: &mut [f64]) {
        let rows = y.chunks_exact_mut(D).zip(x.chunks_exact(D));
        for ((y, x), inverse) in rows.zip(self.inverses.chunks_exact(D * D)) {
            for a in 0..D {
                y[a] = (0..D).fold(0.0, |sum, b| sum + inverse[a * D + b] * x[b]);
            }
        }
    }
}

/// The inverse of a symmetric block; `None` when it is not positive definite.
fn inverse_if_definite<const D: usize>(block: SMatrix<f64, D, D>) -> Option<SMatrix<f64, D, D>> {
    // Unit diagonal first: the entries may be 1e100 or 1e-100.
    let scales = block.diagonal().map(f64::sqrt);
    if !scales.iter().all(|&s| s > 0.0 && s.is_finite()) {
        return None;
    }
    let scaled = SMatrix::<f64, D, D>::from_fn(|a, b| block[(a, b)] / scales[a] / scales[b]);
    let inverse = Cholesky::<f64, Const<D>>::new(scaled)?.inverse();
    Some(SMatrix::from_fn(|a, b| inverse[(a, b)] / scales[a] / scales[b]))
}

/// The matrix as faer sees it; remembers whether some direction had negative curvature.
#[derive(Debug)]
struct Operator<'a> {
    matrix: &'a ConjugateGradients,
    negative_curvature: AtomicBool,
}

/// The inverses of the diagonal blocks.
#[derive(Debug)]
struct BlockJacobi<'a> {
    matrix: &'a ConjugateGradients,
}

fn slice<'a>(vector: MatRef<'a, f64>) -> &'a [f64] {
    let column = vector.col(0).try_as_col_major();
    column.expect("faer stores single columns without gaps").as_slice()
}

fn slice_mut<'a>(vector: MatMut<'a, f64>) -> &'a mut [f64] {
    let column = vector.col_mut(0).try_as_col_major_mut();
    column.expect("faer stores single columns without gaps").as_slice_mut()
}

impl LinOp<f64> for Operator<'_> {
    fn apply_scratch(&self, _: usize, _: Par) -> StackReq {
        StackReq::EMPTY
    }

    fn nrows(&self) -> usize {
        self.matrix.is_fixed.len()
    }

    fn ncols(&self) -> usize {
        self.matrix.is_fixed.len()
    }

    fn apply(&self, out: MatMut<'_, f64>, rhs: MatRef<'_, f64>, _: Par, _: &mut MemStack) {
        let (x, y) = (slice(rhs), slice_mut(out));
        match self.matrix.dimension {
            2 => self.matrix.multiply::<2>(x, y),
            _ => self.matrix.multiply::<3>(x, y),
        }
        if dot(x, y) < 0.0 {
            self.negative_curvature.store(true, Ordering::Relaxed);
        }
    }

    fn conj_apply(&self, out: MatMut<'_, f64>, rhs: MatRef<'_, f64>, par: Par, s: &mut MemStack) {
        self.apply(out, rhs, par, s);
    }
}

impl LinOp<f64> for BlockJacobi<'_> {
    fn apply_scratch(&self, _: usize, _: Par) -> StackReq {
        StackReq::EMPTY
    }

    fn nrows(&self) -> usize {
        self.matrix.is_fixed.len()
    }

    fn ncols(&self) -> usize {
        self.matrix.is_fixed.len()
    }

    fn apply(&self, out: MatMut<'_, f64>, rhs: MatRef<'_, f64>, _: Par, _: &mut MemStack) {
        match self.matrix.dimension {
            2 => self.matrix.precondition::<2>(slice(rhs), slice_mut(out)),
            _ => self.matrix.precondition::<3>(slice(rhs), slice_mut(out)),
        }
    }

    fn conj_apply(&self, out: MatMut<'_, f64>, rhs: MatRef<'_, f64>, par: Par, s: &mut MemStack) {
        self.apply(out, rhs, par, s);
    }
}

impl Precond<f64> for BlockJacobi<'_> {}
