//! The method of minimum residuals for symmetric indefinite matrices (Paige, Saunders 1975), in
//! the form of Elman, Silvester, Wathen, Finite Elements and Fast Iterative Solvers, 2014,
//! algorithm 4.1: for tangents of states that are not stable, too large to be factorised.

use piola_mechanics::vector::{dot, norm_of};

use super::conjugate_gradients::CgLimits;
use super::operator::Operator;
use super::preconditioner::Preconditioner;

/// The norm of the residual that the method minimises is that of `M^-1`; the tolerance is in the
/// 2-norm. Where the true residual is still too large it starts again from there, at most so often.
const RESTARTS: usize = 20;

/// Solves `K x = rhs`, entries of `rhs` at fixed degrees of freedom being 0; so are those of `x`.
///
/// Returns the iterations and the true residual relative to the right-hand side, which may exceed
/// the tolerance when the iterations are used up.
pub(super) fn minimum_residual(
    operator: &dyn Operator,
    preconditioner: &mut dyn Preconditioner,
    is_free: &[bool],
    rhs: &[f64],
    limits: CgLimits,
    x: &mut [f64],
) -> (usize, f64) {
    x.fill(0.0);
    let scale = norm_of(rhs);
    if scale == 0.0 {
        return (0, 0.0);
    }
    let mut image = vec![0.0; x.len()];
    let multiply_free = |x: &[f64], y: &mut [f64]| {
        operator.multiply(x, y);
        y.iter_mut().zip(is_free).for_each(|(y, &free)| *y = if free { *y } else { 0.0 });
    };
    let mut residual: Vec<f64> = rhs.iter().map(|b| b / scale).collect();
    let mut iterations = 0;
    let mut reached = 1.0;
    for _ in 0..RESTARTS {
        // How far the minimised norm must fall for the residual to reach the tolerance.
        let target = 0.3 * limits.tolerance / reached;
        let left = limits.max_iterations - iterations;
        iterations += descend(&multiply_free, preconditioner, &residual, (target, left), x);
        multiply_free(x, &mut image);
        for (k, residual) in residual.iter_mut().enumerate() {
            *residual = rhs[k] / scale - image[k];
        }
        let before = reached;
        reached = norm_of(&residual);
        // Not a number ends it, too.
        let falls = reached <= 0.5 * before;
        if reached <= limits.tolerance || !falls || iterations >= limits.max_iterations {
            break;
        }
    }
    x.iter_mut().for_each(|x| *x *= scale);
    (iterations, reached)
}

/// Adds to `x` what lowers `residual` to the target; how many iterations that took.
fn descend(
    multiply: &dyn Fn(&[f64], &mut [f64]),
    preconditioner: &mut dyn Preconditioner,
    residual: &[f64],
    (target, most): (f64, usize),
    x: &mut [f64],
) -> usize {
    let n = residual.len();
    let mut z = vec![0.0; n];
    preconditioner.apply(residual, &mut z);
    let (mut v, mut v_before) = (residual.to_vec(), vec![0.0; n]);
    let (mut w, mut w_before) = (vec![0.0; n], vec![0.0; n]);
    let (mut image, mut z_next) = (vec![0.0; n], vec![0.0; n]);
    let (mut gamma, mut gamma_before) = (dot(&z, residual).sqrt(), 1.0);
    let mut eta = gamma;
    let start = gamma;
    let ((mut cos, mut cos_before), (mut sin, mut sin_before)) = ((1.0, 1.0), (0.0, 0.0));
    for iteration in 0..most {
        // The second holds for vectors that span an invariant subspace, and for not a number.
        if eta.abs() <= target * start || !(gamma > 0.0 && gamma.is_finite()) {
            return iteration;
        }
        z.iter_mut().for_each(|z| *z /= gamma);
        multiply(&z, &mut image);
        let delta = dot(&image, &z);
        for k in 0..n {
            let next = image[k] - delta / gamma * v[k] - gamma / gamma_before * v_before[k];
            (v_before[k], v[k]) = (v[k], next);
        }
        preconditioner.apply(&v, &mut z_next);
        let gamma_next = dot(&z_next, &v).max(0.0).sqrt();
        let a0 = cos * delta - cos_before * sin * gamma;
        let a1 = (a0 * a0 + gamma_next * gamma_next).sqrt();
        let a2 = sin * delta + cos_before * cos * gamma;
        let a3 = sin_before * gamma;
        if a1 == 0.0 {
            return iteration;
        }
        (cos_before, cos) = (cos, a0 / a1);
        (sin_before, sin) = (sin, gamma_next / a1);
        for k in 0..n {
            let next = (z[k] - a3 * w_before[k] - a2 * w[k]) / a1;
            (w_before[k], w[k]) = (w[k], next);
            x[k] += cos * eta * next;
        }
        eta *= -sin;
        (gamma_before, gamma) = (gamma, gamma_next);
        std::mem::swap(&mut z, &mut z_next);
    }
    most
}
