//! How exactly conjugate gradients solve for a Newton step.

use super::newton::NewtonVariant;

/// Full Newton steps: no linear residual above this, so that convergence stays quadratic, and none
/// below the least, where rounding takes over.
const FULL_MOST: f64 = 1e-3;
const FULL_LEAST: f64 = 1e-12;

/// A linear residual below this part of what Newton's method is asked for gains nothing.
const FULL_ENOUGH: f64 = 0.1;
const INEXACT_ENOUGH: f64 = 0.5;

/// Inexact Newton: the first and largest term.
const INEXACT_MOST: f64 = 0.5;

/// Eisenstat and Walker's gamma of choice 2; alpha is 2.
const GAMMA: f64 = 0.9;

/// The safeguard of choice 2 holds back terms that follow a larger one than this.
const SAFEGUARD: f64 = 0.1;

/// The forcing terms of one solve: linear residual over Newton's residual, 2-norms.
///
/// Full and modified Newton solve to a tenth of the residual that is asked for in the end: further
/// digits would be lost in what the next residual is quadratic in. Inexact Newton takes choice 2 of
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

    /// The term for the present residual; `force` is what the tolerance is relative to.
    pub(super) fn next(&mut self, residual: f64, force: f64) -> f64 {
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
            (FULL_ENOUGH * asked).clamp(FULL_LEAST, FULL_MOST)
        };
        self.last = Some((residual, term));
        term
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_steps_are_solved_to_a_tenth_of_what_is_asked_for() {
        let mut forcing = Forcing::new(NewtonVariant::Full, 1e-10);
        let terms = [(1.0, 1e-11), (1e-2, 1e-9), (1e-6, 1e-5), (1e-9, 1e-3), (1e3, 1e-12)];
        for (residual, term) in terms {
            let found = forcing.next(residual, 1.0);
            assert!((found / term - 1.0).abs() < 1e-12, "{residual:e}: {found:e}");
        }
    }

    #[test]
    fn inexact_terms_follow_the_residual_squared() {
        let mut forcing = Forcing::new(NewtonVariant::Inexact, 1e-10);
        assert_eq!(forcing.next(1.0, 1.0), 0.5);
        // 0.9 * 0.1^2 is less than 0.9 * 0.5^2: held back.
        assert!((forcing.next(0.1, 1.0) - 0.225).abs() < 1e-15);
        assert!((forcing.next(0.01, 1.0) - 0.009).abs() < 1e-15);
        assert!((forcing.next(1e-4, 1.0) - 0.9e-4).abs() < 1e-15);
        // No more exactly than half of what is asked for.
        assert!((forcing.next(1e-7, 1.0) - 5e-4).abs() < 1e-15);
        assert!((forcing.next(2e-10, 1.0) - 0.25).abs() < 1e-12);
    }
}
