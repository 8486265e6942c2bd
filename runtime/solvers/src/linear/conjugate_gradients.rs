//! Preconditioned conjugate gradients (Hestenes, Stiefel 1952), with what they see on the way.
//!
//! Written here and not taken from faer because the step lengths are wanted (see
//! [`super::lanczos`]), because a residual that has drifted from the true one is replaced, and
//! because a direction of negative curvature ends the run at once.

use piola_mechanics::vector::{dot, norm_of};

use super::lanczos::{Lanczos, RitzValues};
use super::operator::Operator;
use super::preconditioner::Preconditioner;

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum CgOutcome {
    /// The true residual relative to the right-hand side is `residual`.
    Converged { residual: f64 },
    /// A direction along which the matrix curves downwards: it is not positive definite.
    NegativeCurvature,
    /// Too many iterations.
    NotConverged,
}

/// A solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CgReport {
    pub(super) outcome: CgOutcome,
    pub(super) iterations: usize,
    /// What was seen of the preconditioned matrix before the first replacement of the residual.
    pub(super) ritz: Option<RitzValues>,
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CgLimits {
    /// 2-norm of the residual over that of the right-hand side.
    pub(super) tolerance: f64,
    pub(super) max_iterations: usize,
}

/// The residual that is carried along drifts from the true one in ill-conditioned systems. Where
/// the true one is larger than this multiple of the tolerance the method starts again from there.
const DRIFTED: f64 = 2.0;

/// Solves `K x = rhs`, entries of `rhs` at fixed degrees of freedom being 0; so are those of `x`.
pub(super) fn conjugate_gradients(
    operator: &dyn Operator,
    preconditioner: &mut dyn Preconditioner,
    is_free: &[bool],
    rhs: &[f64],
    limits: CgLimits,
    x: &mut [f64],
) -> CgReport {
    x.fill(0.0);
    // A right-hand side of norm 1: squares of tiny forces do not underflow.
    let scale = norm_of(rhs);
    if scale == 0.0 {
        let outcome = CgOutcome::Converged { residual: 0.0 };
        return CgReport { outcome, iterations: 0, ritz: None };
    }
    let mut run = Run {
        operator,
        preconditioner,
        is_free,
        limits,
        residual: rhs.iter().map(|b| b / scale).collect(),
        image: vec![0.0; x.len()],
        iterations: 0,
        ritz: None,
    };
    let outcome = run.replace_residuals(rhs, scale, x);
    x.iter_mut().for_each(|x| *x *= scale);
    CgReport { outcome, iterations: run.iterations, ritz: run.ritz }
}

struct Run<'a> {
    operator: &'a dyn Operator,
    preconditioner: &'a mut dyn Preconditioner,
    is_free: &'a [bool],
    limits: CgLimits,
    residual: Vec<f64>,
    /// `K p`, 0 at fixed degrees of freedom.
    image: Vec<f64>,
    iterations: usize,
    ritz: Option<RitzValues>,
}

impl Run<'_> {
    /// Iterates until the true residual is small, or falls no more.
    fn replace_residuals(&mut self, rhs: &[f64], scale: f64, x: &mut [f64]) -> CgOutcome {
        let mut before = f64::INFINITY;
        loop {
            if let Some(failure) = self.iterate(x) {
                return failure;
            }
            self.multiply_free(x);
            for (k, residual) in self.residual.iter_mut().enumerate() {
                *residual = rhs[k] / scale - self.image[k];
            }
            let residual = norm_of(&self.residual);
            // Not a number ends it, too.
            let falls = residual <= 0.5 * before;
            if residual <= DRIFTED * self.limits.tolerance || !falls {
                return CgOutcome::Converged { residual };
            }
            before = residual;
        }
    }

    /// One run from the present residual; `None` when the residual carried along is small enough.
    fn iterate(&mut self, x: &mut [f64]) -> Option<CgOutcome> {
        let mut lanczos = Lanczos::default();
        let mut z = vec![0.0; x.len()];
        self.preconditioner.apply(&self.residual, &mut z);
        let mut direction = z.clone();
        let mut rz = dot(&self.residual, &z);
        let mut failure = None;
        while dot(&self.residual, &self.residual).sqrt() > self.limits.tolerance {
            if self.iterations == self.limits.max_iterations {
                failure = Some(CgOutcome::NotConverged);
                break;
            }
            self.iterations += 1;
            self.multiply_free(&direction);
            let curvature = dot(&direction, &self.image);
            if !curvature.is_finite() || !rz.is_finite() {
                failure = Some(CgOutcome::NotConverged);
                break;
            }
            if curvature <= 0.0 {
                failure = Some(CgOutcome::NegativeCurvature);
                break;
            }
            let alpha = rz / curvature;
            for (x, p) in x.iter_mut().zip(&direction) {
                *x += alpha * p;
            }
            for (r, q) in self.residual.iter_mut().zip(&self.image) {
                *r -= alpha * q;
            }
            self.preconditioner.apply(&self.residual, &mut z);
            let next = dot(&self.residual, &z);
            let beta = next / rz;
            lanczos.push(alpha, beta);
            rz = next;
            for (p, z) in direction.iter_mut().zip(&z) {
                *p = z + beta * *p;
            }
        }
        self.ritz = self.ritz.or_else(|| lanczos.extremes());
        failure
    }

    fn multiply_free(&mut self, x: &[f64]) {
        self.operator.multiply(x, &mut self.image);
        for (y, &free) in self.image.iter_mut().zip(self.is_free) {
            *y = if free { *y } else { 0.0 };
        }
    }
}
