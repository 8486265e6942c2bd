//! A preconditioner of two levels: block Jacobi for what is rough, a coarse system for what is
//! smooth.
//!
//! `M^-1 = J^-1 + P (P^T K P)^-1 P^T`, the columns of `P` being the linear displacement fields on
//! the pieces of the body ([`super::aggregates`]). Nonlocal stiffnesses average over the horizon, so
//! rough errors meet a well-conditioned matrix; what is left for the coarse system varies little
//! over a horizon. Uniform strains belong to it: rigid motions alone would let the pieces of a
//! nearly incompressible body do nothing but change its volume where they meet, and lock.
//!
//! Additive Schwarz methods of this form: Smith, Bjorstad, Gropp, Domain Decomposition, 1996.

use std::sync::Arc;

use piola_mechanics::matrix::{BlockMatrix, BlockPattern};
use rayon::prelude::*;

use super::LinearError;
use super::aggregates::Aggregates;
use super::direct::SymmetricFactors;
use super::estimate::estimate_factorization;
use super::extraction::FreeTriangle;
use super::preconditioner::{BlockJacobi, Preconditioner};
use crate::constraint::Constraints;

/// The coarse system of one pattern and one set of fixed degrees of freedom.
pub(super) struct CoarseSystem {
    aggregates: Aggregates,
    /// The blocks of `P^T K P`, one row per piece.
    matrix: BlockMatrix,
    constraints: Constraints,
    triangle: FreeTriangle,
    factors: SymmetricFactors,
    /// `P^T r`, and its free entries.
    restricted: Vec<f64>,
    /// Free entries.
    reduced: Vec<f64>,
}

/// The couplings of one piece with others: the sum over blocks `(i, j)`, `i` in the piece and
/// `j >= i`, of `P_i^T K_ij P_j`.
struct PieceRow {
    pieces: Vec<u32>,
    blocks: Vec<f64>,
}

impl CoarseSystem {
    /// Lays out and orders the coarse system; `None` if the body is too small to be cut.
    pub(super) fn new(
        pattern: &BlockPattern,
        positions: &[f64],
        constraints: &Constraints,
    ) -> Result<Option<CoarseSystem>, LinearError> {
        let Some(aggregates) = Aggregates::new(pattern, positions, constraints) else {
            return Ok(None);
        };
        let coarse = Arc::new(coarse_pattern(pattern, &aggregates));
        let n = coarse.n_rows() * coarse.dimension;
        let constraints =
            Constraints::new(n, &aggregates.dropped).expect("functions are dropped in order");
        let estimate = estimate_factorization(&coarse, &constraints)?;
        let triangle = FreeTriangle::new(&coarse, &constraints)?;
        let factors = SymmetricFactors::new(&triangle, &estimate, &constraints, coarse.dimension)?;
        Ok(Some(CoarseSystem {
            matrix: BlockMatrix::zeros(&coarse),
            aggregates,
            restricted: vec![0.0; n],
            reduced: vec![0.0; constraints.n_free()],
            constraints,
            triangle,
            factors,
        }))
    }

    /// Unknowns of the coarse system, and pieces of the body.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.constraints.n_free(), self.aggregates.members.len())
    }

    /// Takes a matrix; `false` when `P^T K P` is not positive definite, hence `K_ff` neither.
    pub(super) fn update(&mut self, matrix: &BlockMatrix) -> bool {
        let rows: Vec<PieceRow> = match matrix.pattern.dimension {
            2 => piece_rows::<2>(matrix, &self.aggregates),
            _ => piece_rows::<3>(matrix, &self.aggregates),
        };
        self.matrix.values.fill(0.0);
        for (piece, row) in rows.iter().enumerate() {
            let size = self.aggregates.per_piece();
            for (&other, block) in row.pieces.iter().zip(row.blocks.chunks_exact(size * size)) {
                self.add(piece, other as usize, block);
            }
        }
        self.triangle.update(&self.matrix);
        self.factors.cholesky(&self.triangle)
    }

    /// Adds a coupling to the upper triangle; within a piece its transpose, too.
    fn add(&mut self, piece: usize, other: usize, block: &[f64]) {
        let size = self.aggregates.per_piece();
        let pattern = &self.matrix.pattern;
        let (row, column) = (piece.min(other), piece.max(other));
        let (start, end) = (pattern.row_start[row], pattern.row_start[row + 1]);
        let place = pattern.columns[start..end].binary_search(&(column as u32));
        let place = start + place.expect("the pattern has all couplings");
        let sum = &mut self.matrix.values[place * size * size..(place + 1) * size * size];
        for p in 0..size {
            for q in 0..size {
                sum[p * size + q] += match piece.cmp(&other) {
                    std::cmp::Ordering::Less => block[p * size + q],
                    std::cmp::Ordering::Greater => block[q * size + p],
                    std::cmp::Ordering::Equal => block[p * size + q] + block[q * size + p],
                };
            }
        }
    }

    /// Adds `P (P^T K P)^-1 P^T r` to `z`.
    fn correct<const D: usize>(&mut self, r: &[f64], z: &mut [f64]) {
        let Aggregates { of_point, members, functions, .. } = &self.aggregates;
        let n_functions = D + 1;
        let size = D * n_functions;
        let restrict = |(out, points): (&mut [f64], &Vec<u32>)| {
            out.fill(0.0);
            for &point in points {
                let first = point as usize * D;
                let values = &functions[first * n_functions..(first + D) * n_functions];
                for a in 0..D {
                    for k in 0..n_functions {
                        let place = a * n_functions + k;
                        out[place] += values[place] * r[first + a];
                    }
                }
            }
        };
        self.restricted.par_chunks_exact_mut(size).zip(members).for_each(restrict);
        for (value, &place) in self.reduced.iter_mut().zip(self.constraints.free()) {
            *value = self.restricted[place];
        }
        self.factors.solve_in_place(&mut self.reduced);
        self.constraints.scatter_free(&self.reduced, &mut self.restricted);
        let coarse = &self.restricted;
        let prolong = |(point, z): (usize, &mut [f64])| {
            let values = &functions[point * size..(point + 1) * size];
            let coarse = &coarse[of_point[point] as usize * size..][..size];
            for a in 0..D {
                for k in a * n_functions..(a + 1) * n_functions {
                    z[a] += values[k] * coarse[k];
                }
            }
        };
        z.par_chunks_exact_mut(D).with_min_len(1024).enumerate().for_each(prolong);
    }
}

/// Which pieces are coupled: those that have coupled points.
fn coarse_pattern(pattern: &BlockPattern, aggregates: &Aggregates) -> BlockPattern {
    let mut rows: Vec<Vec<u32>> = (0..aggregates.members.len()).map(|p| vec![p as u32]).collect();
    for i in 0..pattern.n_rows() {
        let piece = aggregates.of_point[i];
        for &j in &pattern.columns[pattern.row_start[i]..pattern.row_start[i + 1]] {
            let other = aggregates.of_point[j as usize];
            let (row, column) = (&mut rows[piece.min(other) as usize], piece.max(other));
            if !row.contains(&column) {
                row.push(column);
            }
        }
    }
    let mut row_start = vec![0];
    for row in &mut rows {
        row.sort_unstable();
        row_start.push(row_start[row_start.len() - 1] + row.len());
    }
    BlockPattern { dimension: aggregates.per_piece(), row_start, columns: rows.concat() }
}

/// The couplings of all pieces, each summed by one task in the order of its points.
fn piece_rows<const D: usize>(matrix: &BlockMatrix, aggregates: &Aggregates) -> Vec<PieceRow> {
    let pieces = (0..aggregates.members.len()).into_par_iter();
    let new = || vec![u32::MAX; aggregates.members.len()];
    pieces.map_init(new, |slots, piece| piece_row::<D>(matrix, aggregates, piece, slots)).collect()
}

/// The couplings of a piece. `slots` has an entry for every piece, all of them `MAX`, and is left
/// so.
fn piece_row<const D: usize>(
    matrix: &BlockMatrix,
    aggregates: &Aggregates,
    piece: usize,
    slots: &mut [u32],
) -> PieceRow {
    let (n_functions, size) = (D + 1, D * (D + 1));
    let functions = |point: usize| &aggregates.functions[point * size..(point + 1) * size];
    let pattern = &matrix.pattern;
    let mut row = PieceRow { pieces: Vec::new(), blocks: Vec::new() };
    // For the present point `i` and each piece: the sum over its points `j` of `K_ij P_j`.
    let mut sums: Vec<f64> = Vec::new();
    for &i in &aggregates.members[piece] {
        let i = i as usize;
        sums.clear();
        sums.resize(row.pieces.len() * D * size, 0.0);
        for block in pattern.row_start[i]..pattern.row_start[i + 1] {
            let j = pattern.columns[block] as usize;
            let other = aggregates.of_point[j] as usize;
            if slots[other] == u32::MAX {
                slots[other] = row.pieces.len() as u32;
                row.pieces.push(other as u32);
                row.blocks.resize(row.pieces.len() * size * size, 0.0);
                sums.resize(row.pieces.len() * D * size, 0.0);
            }
            let start = slots[other] as usize * D * size;
            let sum = &mut sums[start..start + D * size];
            let values = &matrix.values[block * D * D..(block + 1) * D * D];
            // The transpose is added later: of a diagonal block that makes twice.
            let share = if i == j { 0.5 } else { 1.0 };
            let functions = functions(j);
            for a in 0..D {
                for b in 0..D {
                    let entry = share * values[a * D + b];
                    for k in b * n_functions..(b + 1) * n_functions {
                        sum[a * size + k] += entry * functions[k];
                    }
                }
            }
        }
        let own = functions(i);
        for (sum, block) in
            sums.chunks_exact(D * size).zip(row.blocks.chunks_exact_mut(size * size))
        {
            for a in 0..D {
                let sum = &sum[a * size..(a + 1) * size];
                for k in a * n_functions..(a + 1) * n_functions {
                    let line = &mut block[k * size..(k + 1) * size];
                    for (entry, sum) in line.iter_mut().zip(sum) {
                        *entry += own[k] * sum;
                    }
                }
            }
        }
    }
    row.pieces.iter().for_each(|&other| slots[other as usize] = u32::MAX);
    row
}

/// Block Jacobi and a coarse system.
pub(super) struct TwoLevel<'a> {
    pub(super) jacobi: &'a mut BlockJacobi,
    pub(super) coarse: &'a mut CoarseSystem,
}

impl Preconditioner for TwoLevel<'_> {
    fn apply(&mut self, r: &[f64], z: &mut [f64]) {
        self.jacobi.apply(r, z);
        match self.coarse.aggregates.dimension {
            2 => self.coarse.correct::<2>(r, z),
            _ => self.coarse.correct::<3>(r, z),
        }
    }
}
