//! Sparse factorisations by faer: Cholesky, LDLT with Bunch-Kaufman pivots, LU.
//!
//! The symbolic work is done once per free set. Everything runs on one thread: faer's
//! factorisations gain nothing from two (measured), and one thread makes the bits reproducible.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, IntranodeLbltRef, LltRef, SymbolicCholesky, SymbolicCholeskyRaw,
    SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::linalg::lu::{
    LuRef, LuSymbolicParams, NumericLu, SymbolicLu, factorize_symbolic_lu,
};
use faer::{Conj, MatMut, Par, Side};

use super::LinearError;
use super::estimate::FactorizationEstimate;
use super::extraction::FreeTriangle;
use crate::constraint::Constraints;

/// Signs of the pivots of an LDLT factorisation; by Sylvester's law also of the eigenvalues.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Inertia {
    pub(super) negative: usize,
    /// Pivots that are 0 or not numbers: the factor cannot be used.
    pub(super) zero: usize,
}

/// Cholesky or LDLT factors; both share one symbolic factorisation and one array of values.
pub(super) struct SymmetricFactors {
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
    /// Off-diagonals of the 2 x 2 pivots.
    subdiagonal: Vec<f64>,
    /// Pivoting within the supernodes.
    forward: Vec<usize>,
    inverse: Vec<usize>,
    is_cholesky: bool,
    memory: MemBuffer,
}

impl SymmetricFactors {
    pub(super) fn new(
        triangle: &FreeTriangle,
        estimate: &FactorizationEstimate,
        constraints: &Constraints,
        dimension: usize,
    ) -> Result<SymmetricFactors, LinearError> {
        let matrix = triangle.matrix();
        let n = matrix.ncols();
        let (forward, inverse) = dof_order(estimate, constraints, dimension);
        // Always by supernodes: they pivot within (the column-by-column variant does not), and one
        // path serves small and large systems.
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let order = PermRef::new_checked(&forward, &inverse, n);
        let symbolic = factorize_symbolic_cholesky(
            matrix.symbolic(),
            Side::Lower,
            SymmetricOrdering::Custom(order),
            params,
        )
        .map_err(|_| LinearError::OutOfMemory)?;
        let scratch = StackReq::any_of(&[
            symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default()),
            symbolic.factorize_numeric_intranode_lblt_scratch::<f64>(Par::Seq, Default::default()),
            symbolic.solve_in_place_scratch::<f64>(1, Par::Seq),
        ]);
        Ok(SymmetricFactors {
            values: zeros(symbolic.len_val())?,
            symbolic,
            subdiagonal: vec![0.0; n],
            forward,
            inverse,
            is_cholesky: false,
            memory: MemBuffer::try_new(scratch).map_err(|_| LinearError::OutOfMemory)?,
        })
    }

    /// Stored numbers of the factor.
    pub(super) fn n_values(&self) -> usize {
        self.values.len()
    }

    /// Factorises; `false` when a pivot is not positive.
    pub(super) fn cholesky(&mut self, triangle: &FreeTriangle) -> bool {
        self.is_cholesky = true;
        self.symbolic
            .factorize_numeric_llt(
                &mut self.values,
                triangle.matrix(),
                Side::Lower,
                Default::default(),
                Par::Seq,
                MemStack::new(&mut self.memory),
                Default::default(),
            )
            .is_ok()
    }

    /// Factorises an indefinite matrix.
    pub(super) fn ldlt(&mut self, triangle: &FreeTriangle) -> Inertia {
        self.is_cholesky = false;
        self.subdiagonal.fill(0.0);
        self.symbolic.factorize_numeric_intranode_lblt(
            &mut self.values,
            &mut self.subdiagonal,
            &mut self.forward,
            &mut self.inverse,
            triangle.matrix(),
            Side::Lower,
            Par::Seq,
            MemStack::new(&mut self.memory),
            Default::default(),
        );
        self.inertia()
    }

    /// Counts the signs of the 1 x 1 and 2 x 2 pivots, supernode by supernode.
    fn inertia(&self) -> Inertia {
        let mut inertia = Inertia::default();
        let SymbolicCholeskyRaw::Supernodal(supernodes) = self.symbolic.raw() else {
            unreachable!("the symbolic factorisation is asked for supernodes")
        };
        for s in 0..supernodes.n_supernodes() {
            let (start, end) = (supernodes.supernode_begin()[s], supernodes.supernode_end()[s]);
            let first = supernodes.col_ptr_for_val()[s];
            let n_rows = end - start + supernodes.supernode(s).pattern().len();
            let diagonal = |k: usize| self.values[first + k * n_rows + k];
            let mut k = 0;
            while k < end - start {
                let coupling = self.subdiagonal[start + k];
                if coupling == 0.0 {
                    inertia.count(diagonal(k));
                    k += 1;
                } else {
                    // Divided by the coupling squared: no overflow where the entries are extreme.
                    let (p, q) = (diagonal(k) / coupling, diagonal(k + 1) / coupling);
                    let determinant = p * q - 1.0;
                    if determinant < 0.0 {
                        inertia.negative += 1;
                    } else {
                        let trace_sign = diagonal(k) + diagonal(k + 1);
                        inertia.count(if determinant == 0.0 { 0.0 } else { trace_sign });
                        inertia.count(trace_sign);
                    }
                    k += 2;
                }
            }
        }
        inertia
    }

    /// Solves with the factors of the last factorisation.
    pub(super) fn solve_in_place(&mut self, rhs: &mut [f64]) {
        let n = rhs.len();
        let rhs = MatMut::from_column_major_slice_mut(rhs, n, 1);
        let stack = MemStack::new(&mut self.memory);
        if self.is_cholesky {
            LltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(
                Conj::No,
                rhs,
                Par::Seq,
                stack,
            );
        } else {
            let pivoting = PermRef::new_checked(&self.forward, &self.inverse, n);
            IntranodeLbltRef::new(&self.symbolic, &self.values, &self.subdiagonal, pivoting)
                .solve_in_place_with_conj(Conj::No, rhs, Par::Seq, stack);
        }
    }
}

impl Inertia {
    fn count(&mut self, pivot: f64) {
        if pivot == 0.0 || !pivot.is_finite() {
            self.zero += 1;
        } else if pivot < 0.0 {
            self.negative += 1;
        }
    }
}

/// The order of the free degrees of freedom that follows from the order of the points, and its
/// inverse.
fn dof_order(
    estimate: &FactorizationEstimate,
    constraints: &Constraints,
    dimension: usize,
) -> (Vec<usize>, Vec<usize>) {
    let mut place = vec![0; constraints.n_dofs()];
    for (k, &dof) in constraints.free().iter().enumerate() {
        place[dof] = k;
    }
    let dofs = estimate.order.iter().flat_map(|&p| p * dimension..(p + 1) * dimension);
    let forward: Vec<usize> =
        dofs.filter(|&dof| !constraints.is_fixed(dof)).map(|dof| place[dof]).collect();
    let mut inverse = vec![0; forward.len()];
    for (new, &old) in forward.iter().enumerate() {
        inverse[old] = new;
    }
    (forward, inverse)
}

fn zeros(n: usize) -> Result<Vec<f64>, LinearError> {
    let mut values = Vec::new();
    values.try_reserve_exact(n).map_err(|_| LinearError::OutOfMemory)?;
    values.resize(n, 0.0);
    Ok(values)
}

/// LU factors with partial pivoting: takes any regular matrix, at several times the cost.
#[derive(Debug)]
pub(super) struct LuFactors {
    symbolic: SymbolicLu<usize>,
    numeric: NumericLu<usize, f64>,
}

impl LuFactors {
    pub(super) fn new(triangle: &FreeTriangle) -> Result<LuFactors, LinearError> {
        let matrix = triangle.mirrored();
        let symbolic = factorize_symbolic_lu(matrix.symbolic(), LuSymbolicParams::default())
            .map_err(|_| LinearError::OutOfMemory)?;
        Ok(LuFactors { symbolic, numeric: NumericLu::new() })
    }

    /// Factorises; `false` when the matrix is found to be singular.
    pub(super) fn factorize(&mut self, triangle: &FreeTriangle) -> Result<bool, LinearError> {
        let scratch =
            self.symbolic.factorize_numeric_lu_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| LinearError::OutOfMemory)?;
        let factorized = self.symbolic.factorize_numeric_lu(
            &mut self.numeric,
            triangle.mirrored().as_ref(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        Ok(factorized.is_ok())
    }

    /// Solves with the factors of the last successful factorisation.
    pub(super) fn solve_in_place(&mut self, rhs: &mut [f64]) -> Result<(), LinearError> {
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(1, Par::Seq);
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| LinearError::OutOfMemory)?;
        let n = rhs.len();
        LuRef::new_unchecked(&self.symbolic, &self.numeric).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(rhs, n, 1),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        Ok(())
    }
}
