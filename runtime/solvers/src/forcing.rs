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

/// Full Newton steps, from the second residual on: where it fell to a part `f` of the one before, the
/// next falls to `f^2`. So much of that shows neither beside it nor, squared with it, in the digits of
/// those after it.
const FULL_BESIDE: f64 = 1e-4;

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
/// rounding. How small that will be full Newton sees from the last two residuals, of which the first is
/// that of the start's linear system; before, and with a tangent that is kept, a nearly linear
/// problem is expected. Inexact Newton takes choice 2 of
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

    /// The largest term for the linear system of a start, and that of the first.
    pub(super) fn start(variant: NewtonVariant) -> f64 {
        if variant == NewtonVariant::Inexact { START_INEXACT } else { FULL_MOST }
    }

    /// The term for the next start, where the last missed the equilibrium by a part of what it
    /// started from: a tenth of that. Where it missed by what was left of its own system the
    /// problem may be nearly linear, and solving better gains iterations.
    pub(super) fn next_start(variant: NewtonVariant, term: f64, missed: f64) -> f64 {
        // Not a number, of nothing that started from nothing, is not more.
        let next = if missed > 2.0 * term { 0.1 * missed } else { term * term };
        next.clamp(FULL_LEAST, Forcing::start(variant))
    }

    /// The residual of the linear system that led to the start was this.
    pub(super) fn started_from(&mut self, residual: f64) {
        if self.variant == NewtonVariant::Full {
            self.last = Some((residual, FULL_MOST));
        }
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
            let beside = match self.last {
                Some((before, _)) if self.variant == NewtonVariant::Full => {
                    let falls = residual / before;
                    FULL_BESIDE * falls * falls
                }
                _ => 0.0,
            };
            exact.max(beside).max(rounding / residual).clamp(FULL_LEAST, FULL_MOST)
        };
        self.last = Some((residual, term));
        term
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_of_linear_problems_are_soon_exact_and_others_as_exact_as_pays() {
        let next = |term, missed| Forcing::next_start(NewtonVariant::Full, term, missed);
        assert_eq!(
            [next(1e-3, 0.9e-3), next(1e-6, 1.1e-6), next(1e-9, 1e-9)],
            [1e-6, 1e-12, 1e-12]
        );
        assert_eq!([next(1e-3, 0.3), next(1e-6, 0.3)], [1e-3, 1e-3]);
        assert!((next(1e-6, 1e-4) / 1e-5 - 1.0).abs() < 1e-12);
        assert_eq!(Forcing::next_start(NewtonVariant::Inexact, 1e-2, 5.0), 0.1);
    }

    #[test]
    fn full_steps_are_solved_as_if_exactly() {
        let mut forcing = Forcing::new(NewtonVariant::Full, 1e-10);
        // Of the second residual 1e-2 squared is left, times 1e-4; at the end what rounding leaves.
        let terms = [(1.0, 1e-11), (1e-2, 1e-8), (1e-6, 1e-10), (1e-13, 1e-3)];
        for (residual, term) in terms {
            let found = forcing.next(residual, 1.0, 1e-16);
            assert!((found / term - 1.0).abs() < 1e-12, "{residual:e}: {found:e}");
        }
        let mut forcing = Forcing::new(NewtonVariant::Full, 1e-10);
        forcing.started_from(10.0);
        assert!((forcing.next(1.0, 1.0, 1e-16) / 1e-6 - 1.0).abs() < 1e-12);
        // With a tangent that is kept residuals do not fall quadratically.
        let mut forcing = Forcing::new(NewtonVariant::Modified, 1e-10);
        for (residual, term) in [(1.0, 1e-11), (1e-2, 1e-9), (1e-4, 1e-8), (1e-6, 1e-10)] {
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
