//! What a factorisation will cost, from the ordering of the points alone.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMat;
use faer::sparse::linalg::amd;
use piola_mechanics::matrix::BlockPattern;

use super::LinearError;
use crate::constraint::Constraints;

/// An ordering of the points that keeps the factor sparse, and the cost of the factorisation.
#[derive(Clone, Debug)]
pub struct FactorizationEstimate {
    /// Non-zeros of the factor (an upper bound).
    pub factor_nonzeros: f64,
    /// Multiplications and additions of one Cholesky factorisation.
    pub operations: f64,
    /// The points in the order of elimination; points without free components are left out.
    pub(super) order: Vec<usize>,
}

impl FactorizationEstimate {
    /// Bytes of the factor.
    pub fn bytes(&self) -> f64 {
        8.0 * self.factor_nonzeros
    }
}

/// Orders the points by approximate minimum degree and counts the fill.
///
/// Points carry whole blocks, so their graph has the fill of the matrix at a ninth (a quarter) of
/// the entries; each point counts with all its components even where some are fixed.
pub fn estimate_factorization(
    pattern: &BlockPattern,
    constraints: &Constraints,
) -> Result<FactorizationEstimate, LinearError> {
    let d = pattern.dimension;
    let is_free = |&p: &usize| (0..d).any(|a| !constraints.is_fixed(p * d + a));
    let points: Vec<usize> = (0..pattern.n_rows()).filter(is_free).collect();
    let mut place = vec![usize::MAX; pattern.n_rows()];
    for (k, &p) in points.iter().enumerate() {
        place[p] = k;
    }
    let mut column_start = vec![0];
    let mut rows = Vec::new();
    for &i in &points {
        let columns = &pattern.columns[pattern.row_start[i]..pattern.row_start[i + 1]];
        rows.extend(columns.iter().map(|&j| place[j as usize]).filter(|&k| k != usize::MAX));
        column_start.push(rows.len());
    }
    let (n, n_entries) = (points.len(), rows.len());
    let graph = SymbolicSparseColMat::new_checked(n, n, column_start, None, rows);
    let (mut forward, mut inverse) = (vec![0usize; n], vec![0usize; n]);
    let scratch = amd::order_scratch::<usize>(n, n_entries);
    let mut memory = MemBuffer::try_new(scratch).map_err(|_| LinearError::OutOfMemory)?;
    let stack = MemStack::new(&mut memory);
    let control = amd::Control::default();
    let count = amd::order(&mut forward, &mut inverse, graph.as_ref(), control, stack)
        .map_err(|_| LinearError::OutOfMemory)?;
    let block = (d * d) as f64;
    Ok(FactorizationEstimate {
        factor_nonzeros: block * count.n_div + (n * d * (d + 1) / 2) as f64,
        operations: 2.0 * block * d as f64 * (count.n_mult_subs_ldl + n as f64),
        order: forward.iter().map(|&k| points[k]).collect(),
    })
}
