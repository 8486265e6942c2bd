//! How exactly conjugate gradients solve for a Newton step.

use super::newton::NewtonVariant;

/// Full Newton steps: bounds of the linear residual.
const FULL_MOST: f64 = 1e-3;
const FULL_LEAST: f64 = 1e-12;

/// Full Newton steps: so much of the residual squared, relative to the force, does not show beside
/// what the next residual is quadratic in; and so much of what is asked for in the end is enough
/// where the problem is nearly linear.
const FULL_QUADRATIC: f64 = 1e-4;
const FULL_ENOUGH: f64 = 0.1;

/// Inexact Newton: a linear residual below this part of what is asked for in the end gains nothing.
const INEXACT_ENOUGH: f64 = 0.5;

/// Inexact Newton: the first and largest term.
const INEXACT_MOST: f64 = 0.5;

/// Inexact Newton: a start is solved for to this residual. What the tangent misses is of that size in
/// increments that take a few iterations.
const START_INEXACT: f64 = 0.1;

/// Eisenstat and Walker's gamma of choice 2; alpha is 2.
const GAMMA: f64 = 0.9;

/// The safeguard of choice 2 holds back terms that follow a larger one than this.
const SAFEGUARD: f64 = 0.1;

/// The forcing terms of one solve: linear residual over Newton's residual, 2-norms.
///
/// Full and modified Newton solve as if exactly: what is left is lost in the next residual, or in its
/// rounding. Inexact Newton takes choice 2 of
/// S. Eisenstat, H. Walker, Choosing the forcing terms in an inexact Newton method, SIAM J. Sci.
/// Comput. 17 (1996), eq. (2.6) with its safeguard, and no less than half of what is asked for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Forcing {
    variant: NewtonVariant,
    tolerance: f64,
    /// Residual and term of the iteration before.
    last: Option<(f64, f64)>,
}

impl Forcing {
    pub(super) fn new(variant: NewtonVariant, tolerance: f64) -> Forcing {
        Forcing { variant, tolerance, last: None }
    }

    /// The term for the linear system of a start.
    pub(super) fn start(&self) -> f64 {
        if self.variant == NewtonVariant::Inexact { START_INEXACT } else { FULL_MOST }
    }

    /// The term for the present residual; `force` is what the tolerance is relative to, `rounding` the
    /// rounding error of residuals.
    pub(super) fn next(&mut self, residual: f64, force: f64, rounding: f64) -> f64 {
        let asked = self.tolerance * force / residual;
        let term = if self.variant == NewtonVariant::Inexact {
            let term = match self.last {
                None => INEXACT_MOST,
                Some((before, term)) => {
                    let falls = residual / before;
                    let held_back = GAMMA * term * term;
                    let term = GAMMA * falls * falls;
                    if held_back > SAFEGUARD { term.max(held_back) } else { term }
                }
            };
            term.max(INEXACT_ENOUGH * asked).clamp(FULL_LEAST, INEXACT_MOST)
        } else {
            let exact = (FULL_ENOUGH * asked).min(FULL_QUADRATIC * residual / force);
            exact.max(rounding / residual).clamp(FULL_LEAST, FULL_MOST)
        };
        self.last = Some((residual, term));
        term
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_steps_are_solved_as_if_exactly() {
        let mut forcing = Forcing::new(NewtonVariant::Full, 1e-10);
        let terms = [(1.0, 1e-11), (1e-2, 1e-9), (1e-4, 1e-8), (1e-6, 1e-10), (1e-9, 1e-7)];
        for (residual, term) in terms {
            let found = forcing.next(residual, 1.0, 1e-16);
            assert!((found / term - 1.0).abs() < 1e-12, "{residual:e}: {found:e}");
        }
    }

    #[test]
    fn inexact_terms_follow_the_residual_squared() {
        let mut forcing = Forcing::new(NewtonVariant::Inexact, 1e-10);
        assert_eq!(forcing.next(1.0, 1.0, 1e-16), 0.5);
        // 0.9 * 0.1^2 is less than 0.9 * 0.5^2: held back.
        assert!((forcing.next(0.1, 1.0, 1e-16) - 0.225).abs() < 1e-15);
        assert!((forcing.next(0.01, 1.0, 1e-16) - 0.009).abs() < 1e-15);
        assert!((forcing.next(1e-4, 1.0, 1e-16) - 0.9e-4).abs() < 1e-15);
        // No more exactly than half of what is asked for.
        assert!((forcing.next(1e-7, 1.0, 1e-16) - 5e-4).abs() < 1e-15);
        assert!((forcing.next(2e-10, 1.0, 1e-16) - 0.25).abs() < 1e-12);
    }
}
