//! Restarted GMRES, for matrices that need not be symmetric (Saad, Schultz 1986; Saad, Iterative
//! Methods for Sparse Linear Systems, 2003, sections 6.5 and 9.3.2): products by differences of
//! forces are not.
//!
//! Preconditioned from the right, so that what is minimised is the residual itself. Vectors are made
//! orthogonal by modified Gram-Schmidt, once more where most of a vector cancels; Givens rotations
//! bring the small least squares problem up to date. The true residual is formed at each restart.

use piola_mechanics::vector::{dot, norm_of};

use super::conjugate_gradients::CgLimits;
use super::operator::Operator;
use super::preconditioner::Preconditioner;

/// Iterations of a cycle: so many vectors are kept. With factors of a bond-based body a Newton step
/// takes 20 to 60.
pub const RESTART: usize = 60;

/// A second pass where no more than this is left of a vector: it then is orthogonal to rounding
/// (Daniel, Gragg, Kaufman, Stewart 1976).
const CANCELS: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// What is left of a product, relative to it, when the vectors span an invariant subspace.
const INVARIANT: f64 = 8.0 * f64::EPSILON;

/// The residual that is carried along drifts from the true one by rounding, and by the errors of the
/// products. A true one of this multiple of the tolerance is small enough.
const DRIFTED: f64 = 2.0;

/// A cycle that ended at its target must leave at most this part of the true residual: else what is
/// left are errors of the products.
const FALLS: f64 = 0.5;

/// A whole cycle must leave at most this part of the residual: else restarts lead nowhere.
const CREEPS: f64 = 0.95;

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GmresOutcome {
    /// The true residual is small enough.
    Converged,
    /// The true residual falls no more.
    Stagnated,
    /// Too many iterations.
    NotConverged,
}

/// A solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GmresReport {
    pub(super) outcome: GmresOutcome,
    pub(super) iterations: usize,
    /// 2-norm of the true residual over that of the right-hand side.
    pub(super) residual: f64,
}

/// Solves `K x = rhs`, entries of `rhs` at fixed degrees of freedom being 0; so are those of `x`. A
/// cycle has `restart` iterations.
pub(super) fn gmres(
    operator: &dyn Operator,
    preconditioner: &mut dyn Preconditioner,
    is_free: &[bool],
    rhs: &[f64],
    (restart, limits): (usize, CgLimits),
    x: &mut [f64],
) -> GmresReport {
    x.fill(0.0);
    // A right-hand side of norm 1: squares of tiny forces do not underflow.
    let scale = norm_of(rhs);
    if scale == 0.0 {
        let outcome = GmresOutcome::Converged;
        return GmresReport { outcome, iterations: 0, residual: 0.0 };
    }
    let rhs: Vec<f64> = rhs.iter().map(|b| b / scale).collect();
    let n = x.len();
    let images = [vec![0.0; n], vec![0.0; n]];
    let basis = Vec::new();
    let mut run =
        Run { operator, preconditioner, is_free, restart, limits, basis, images, iterations: 0 };
    let (outcome, residual) = run.restart(&rhs, x);
    x.iter_mut().for_each(|x| *x *= scale);
    GmresReport { outcome, iterations: run.iterations, residual }
}

struct Run<'a> {
    operator: &'a dyn Operator,
    preconditioner: &'a mut dyn Preconditioner,
    is_free: &'a [bool],
    restart: usize,
    limits: CgLimits,
    /// Orthonormal vectors, made as they are needed.
    basis: Vec<Vec<f64>>,
    /// `M^-1 v` and `K M^-1 v`.
    images: [Vec<f64>; 2],
    iterations: usize,
}

impl Run<'_> {
    /// Cycles until the true residual is small, falls no more, or the iterations are used up; and
    /// that residual.
    fn restart(&mut self, rhs: &[f64], x: &mut [f64]) -> (GmresOutcome, f64) {
        let mut residual = rhs.to_vec();
        let mut reached = 1.0;
        loop {
            let (before, kept) = (reached, x.to_vec());
            let estimate = self.cycle(&residual, reached, x);
            self.multiply_free(x);
            for (residual, (b, kx)) in residual.iter_mut().zip(rhs.iter().zip(&self.images[1])) {
                *residual = b - kx;
            }
            reached = norm_of(&residual);
            if reached <= DRIFTED * self.limits.tolerance {
                return (GmresOutcome::Converged, reached);
            }
            let most = if estimate <= self.limits.tolerance { FALLS } else { CREEPS };
            // Not a number ends it, too.
            if reached > most * before || reached.is_nan() {
                if reached >= before || reached.is_nan() {
                    x.copy_from_slice(&kept);
                    reached = before;
                }
                return (GmresOutcome::Stagnated, reached);
            }
            if self.iterations >= self.limits.max_iterations {
                return (GmresOutcome::NotConverged, reached);
            }
        }
    }

    /// Adds to `x` what makes `residual`, of norm `size`, smallest in the subspace of a cycle; the
    /// norm that should be left.
    fn cycle(&mut self, residual: &[f64], size: f64, x: &mut [f64]) -> f64 {
        self.keep(0, residual, size);
        let mut triangle: Vec<Vec<f64>> = Vec::new();
        let mut rotations: Vec<(f64, f64)> = Vec::new();
        let (mut parts, mut left) = (Vec::new(), size);
        while f64::abs(left) > self.limits.tolerance
            && triangle.len() < self.restart
            && self.iterations < self.limits.max_iterations
        {
            let step = triangle.len();
            self.iterations += 1;
            self.multiply_preconditioned(step);
            let (mut column, next) = orthogonalise(&self.basis[..=step], &mut self.images[1]);
            if !next.is_finite() {
                left = f64::NAN;
                break;
            }
            for (k, (cos, sin)) in rotations.iter().enumerate() {
                let (a, b) = (column[k], column[k + 1]);
                (column[k], column[k + 1]) = (cos * a + sin * b, cos * b - sin * a);
            }
            let pivot = libm::hypot(column[step], next);
            // Nothing new, and nothing that lowers the residual: the matrix is singular.
            if pivot == 0.0 {
                break;
            }
            let (cos, sin) = (column[step] / pivot, next / pivot);
            column[step] = pivot;
            rotations.push((cos, sin));
            triangle.push(column);
            parts.push(cos * left);
            left *= -sin;
            if next > 0.0 {
                let new = std::mem::take(&mut self.images[1]);
                self.keep(step + 1, &new, next);
                self.images[1] = new;
            }
        }
        self.add_solution(&triangle, parts, x);
        left.abs()
    }

    /// `x += M^-1 V y` with `R y = parts`.
    fn add_solution(&mut self, triangle: &[Vec<f64>], parts: Vec<f64>, x: &mut [f64]) {
        let mut y = parts;
        for k in (0..y.len()).rev() {
            y[k] /= triangle[k][k];
            for row in 0..k {
                y[row] -= triangle[k][row] * y[k];
            }
        }
        let [step, sum] = &mut self.images;
        sum.fill(0.0);
        for (y, v) in y.iter().zip(&self.basis) {
            sum.iter_mut().zip(v).for_each(|(sum, v)| *sum += y * v);
        }
        self.preconditioner.apply(sum, step);
        x.iter_mut().zip(&*step).for_each(|(x, step)| *x += step);
    }

    /// Vector `k` becomes `v/size`.
    fn keep(&mut self, k: usize, v: &[f64], size: f64) {
        if self.basis.len() == k {
            self.basis.push(vec![0.0; v.len()]);
        }
        self.basis[k].iter_mut().zip(v).for_each(|(kept, v)| *kept = v / size);
    }

    /// `K M^-1 v` for vector `k`.
    fn multiply_preconditioned(&mut self, k: usize) {
        let mut z = std::mem::take(&mut self.images[0]);
        self.preconditioner.apply(&self.basis[k], &mut z);
        self.multiply_free(&z);
        self.images[0] = z;
    }

    fn multiply_free(&mut self, x: &[f64]) {
        self.operator.multiply(x, &mut self.images[1]);
        for (y, &free) in self.images[1].iter_mut().zip(self.is_free) {
            *y = if free { *y } else { 0.0 };
        }
    }
}

/// Takes from `w` its parts along orthonormal vectors; these parts, with room for one more, and the
/// norm of what is left: 0 where that is rounding.
fn orthogonalise(basis: &[Vec<f64>], w: &mut [f64]) -> (Vec<f64>, f64) {
    let mut parts = vec![0.0; basis.len()];
    let size = norm_of(w);
    let mut left = size;
    for _ in 0..2 {
        let before = left;
        for (sum, v) in parts.iter_mut().zip(basis) {
            let part = dot(w, v);
            w.iter_mut().zip(v).for_each(|(w, v)| *w -= part * v);
            *sum += part;
        }
        left = norm_of(w);
        if left > CANCELS * before {
            break;
        }
    }
    let next = if left <= INVARIANT * size { 0.0 } else { left };
    (parts, next)
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use piola_mechanics::testing::pseudo_random;

    struct Dense(DMatrix<f64>);

    impl Operator for Dense {
        fn multiply(&self, x: &[f64], y: &mut [f64]) {
            y.copy_from_slice((&self.0 * DVector::from_column_slice(x)).as_slice());
        }
    }

    /// Division by given numbers.
    struct Divide(Vec<f64>);

    impl Preconditioner for Divide {
        fn apply(&mut self, r: &[f64], z: &mut [f64]) {
            z.iter_mut().zip(r.iter().zip(&self.0)).for_each(|(z, (r, d))| *z = r / d);
        }
    }

    const LIMITS: CgLimits = CgLimits { tolerance: 1e-12, max_iterations: 2000 };

    fn solve(
        matrix: &DMatrix<f64>,
        divisors: Vec<f64>,
        rhs: &[f64],
        restart: usize,
    ) -> (GmresReport, Vec<f64>) {
        let mut x = vec![f64::NAN; rhs.len()];
        let free = vec![true; rhs.len()];
        let operator = Dense(matrix.clone());
        let mut preconditioner = Divide(divisors);
        let report = gmres(&operator, &mut preconditioner, &free, rhs, (restart, LIMITS), &mut x);
        (report, x)
    }

    fn random(n: usize, seed: u64) -> DMatrix<f64> {
        DMatrix::from_row_slice(n, n, &pseudo_random(n * n, seed))
    }

    /// Symmetric positive definite, symmetric indefinite, unsymmetric; all well conditioned.
    fn matrices(n: usize) -> [(&'static str, DMatrix<f64>); 3] {
        let noise = random(n, 3) / (n as f64).sqrt();
        let symmetric = 0.5 * (&noise + noise.transpose());
        let sign = |k: usize| if k.is_multiple_of(3) { -4.0 } else { 4.0 };
        let diagonal = DMatrix::from_fn(n, n, |r, c| if r == c { sign(r) } else { 0.0 });
        let definite = DMatrix::identity(n, n) * 4.0 + &symmetric;
        [
            ("definite", definite.clone()),
            ("indefinite", diagonal + symmetric),
            ("unsymmetric", definite + noise),
        ]
    }

    #[test]
    fn solutions_are_those_of_a_direct_solve() {
        let n = 80;
        let rhs = pseudo_random(n, 5);
        for (name, matrix) in matrices(n) {
            let b = DVector::from_column_slice(&rhs);
            let expected = matrix.clone().lu().solve(&b).unwrap();
            // A preconditioner is another way to the same solution, and so are short cycles.
            let divisors: Vec<f64> =
                (0..n).map(|k| matrix[(k, k)] * (1.0 + 0.01 * k as f64)).collect();
            for (divisors, restart) in
                [(vec![1.0; n], 100), (divisors.clone(), 100), (divisors, 12)]
            {
                let (report, x) = solve(&matrix, divisors, &rhs, restart);
                assert_eq!(report.outcome, GmresOutcome::Converged, "{name} {report:?}");
                assert!(report.residual <= 2e-12, "{name} {report:?}");
                assert!(report.iterations > 5 && report.iterations < 400, "{name} {report:?}");
                let b = &matrix * DVector::from_column_slice(&x) - b.clone();
                assert!((b.norm() / norm_of(&rhs) / report.residual - 1.0).abs() < 1e-3);
                let error = (DVector::from_column_slice(&x) - &expected).norm() / expected.norm();
                assert!(error < 1e-11, "{name} {restart}: {error:e}");
            }
        }
    }

    /// The unsymmetric matrix of a cyclic shift leaves the residual as it is for `n - 1` iterations:
    /// cycles that are shorter never lower it.
    #[test]
    fn restarts_that_lead_nowhere_are_reported() {
        let n = 12;
        let shift = DMatrix::from_fn(n, n, |r, c| if r == (c + 1) % n { 1.0 } else { 0.0 });
        let mut rhs = vec![0.0; n];
        rhs[0] = 1.0;
        let (report, x) = solve(&shift, vec![1.0; n], &rhs, 5);
        assert_eq!(report.outcome, GmresOutcome::Stagnated);
        assert_eq!((report.iterations, report.residual), (5, 1.0));
        assert_eq!(x, vec![0.0; n]);
        let (report, x) = solve(&shift, vec![1.0; n], &rhs, n);
        assert_eq!((report.outcome, report.iterations), (GmresOutcome::Converged, n));
        assert_eq!(x[n - 1], 1.0);
    }

    #[test]
    fn nothing_asked_is_nothing_done() {
        let (report, x) = solve(&random(7, 1), vec![1.0; 7], &[0.0; 7], 5);
        let expected =
            GmresReport { outcome: GmresOutcome::Converged, iterations: 0, residual: 0.0 };
        assert_eq!(report, expected);
        assert_eq!(x, [0.0; 7]);
    }

    #[test]
    fn iterations_are_limited_and_not_a_number_is_no_solution() {
        let n = 80;
        let rhs = pseudo_random(n, 5);
        let [_, (_, matrix), _] = matrices(n);
        let (mut x, free) = (vec![0.0; n], vec![true; n]);
        let mut one = Divide(vec![1.0; n]);
        let few = CgLimits { max_iterations: 9, ..LIMITS };
        let report = gmres(&Dense(matrix), &mut one, &free, &rhs, (60, few), &mut x);
        assert_eq!((report.outcome, report.iterations), (GmresOutcome::NotConverged, 9));
        assert!(report.residual < 1.0 && report.residual > 1e-6, "{report:?}");
        let (report, x) = solve(&DMatrix::from_element(n, n, f64::NAN), vec![1.0; n], &rhs, 60);
        assert_eq!((report.outcome, report.residual), (GmresOutcome::Stagnated, 1.0));
        assert_eq!(x, vec![0.0; n]);
    }

    /// Of a singular matrix, and a right-hand side within its range, a solution is found; without
    /// one the residual that must stay is.
    #[test]
    fn singular_matrices_end_the_run() {
        let zero_last =
            DMatrix::from_fn(4, 4, |r, c| if r == c && r < 3 { r as f64 + 1.0 } else { 0.0 });
        let (report, x) = solve(&zero_last, vec![1.0; 4], &[1.0, 2.0, 3.0, 0.0], 10);
        assert_eq!(report.outcome, GmresOutcome::Converged);
        assert!(x.iter().zip([1.0, 1.0, 1.0, 0.0]).all(|(x, e)| (x - e).abs() < 1e-14), "{x:?}");
        let (report, _) = solve(&zero_last, vec![1.0; 4], &[0.0, 0.0, 0.0, 1.0], 10);
        assert_eq!((report.outcome, report.residual), (GmresOutcome::Stagnated, 1.0));
    }

    #[test]
    fn nearly_parallel_vectors_become_orthogonal() {
        let n = 50;
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for k in 0..6 {
            // All but a millionth of each vector is that of the first.
            let other = pseudo_random(n, 10 + k);
            let mut w: Vec<f64> =
                pseudo_random(n, 1).iter().zip(other).map(|(x, y)| x + 1e-9 * y).collect();
            let (parts, next) = orthogonalise(&basis, &mut w);
            assert_eq!(parts.len(), basis.len());
            basis.push(w.iter().map(|w| w / next).collect());
        }
        for (k, v) in basis.iter().enumerate() {
            for other in &basis[..k] {
                assert!(dot(v, other).abs() < 1e-14, "{:e}", dot(v, other));
            }
        }
    }
}
