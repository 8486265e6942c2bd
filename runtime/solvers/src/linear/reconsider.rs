//! From products with a tangent that reaches beyond the bonds to a stored one and its factors.
//!
//! Storing such a tangent takes the time of ten to a hundred products and more, so that `auto` begins
//! with them: where springs precondition well, a system takes some twenty. How well they do is not known
//! before. Where a system takes as many products as a stored tangent and its factors are worth, or
//! where its tangent is indefinite, the stored one takes over, and stays.

use piola_mechanics::energy::Energy;

use super::choice::{may_be_ordered, products_before_stored, products_worth};
use super::estimate::estimate_factorization;
use super::{
    Choice, Circumstances, LinearError, LinearMethod, LinearSolver, matrix_bytes, most_iterations,
};
use crate::watch::Event;

/// Products that minimum residuals take for an indefinite tangent: 300 to 700 for a plate of 1,496 points.
const INDEFINITE: usize = 500;

impl LinearSolver {
    /// From now on a stored tangent may take over where `auto` began with products: systems that call
    /// for it end with [`LinearError::GivenUp`], which [`LinearSolver::reconsider`] answers.
    pub(crate) fn may_store(&mut self) {
        self.may_store = self.options.method == LinearMethod::Auto
            && self.method() == LinearMethod::MatrixFree
            && may_be_ordered(self.pattern.dimension, self.constraints.n_free());
        if self.may_store {
            self.limits.max_iterations = products_worth(0.0, 1);
        }
    }

    /// Whether the tangent is to be stored from now on, after a system was given up. If not, it is to
    /// be solved again: more iterations are allowed now.
    ///
    /// # Errors
    /// Memory for the ordering; whoever looks on wants an end, now that a stored tangent is to take over.
    pub(crate) fn reconsider(
        &mut self,
        energy: &dyn Energy,
        because: &str,
        iterations: Option<usize>,
    ) -> Result<bool, LinearError> {
        let pattern = energy.pattern();
        let estimate = match self.wide.take() {
            Some(estimate) => estimate,
            None => estimate_factorization(pattern, &self.constraints)?,
        };
        let stored = Circumstances {
            dimension: pattern.dimension,
            unknowns: self.constraints.n_free(),
            matrix_bytes: matrix_bytes(pattern),
            memory_limit: self.options.memory_limit,
        };
        let cost = (estimate.operations, estimate.bytes());
        let Some(worth) = products_before_stored(&stored, cost, self.pattern.n_blocks()) else {
            self.may_store = false;
            self.limits.max_iterations = most_iterations(&self.constraints);
            return Ok(false);
        };
        if iterations.unwrap_or(INDEFINITE) < worth {
            // Who meets an indefinite tangent once meets others, and iterates on.
            self.may_store = iterations.is_some();
            self.limits.max_iterations =
                if self.may_store { worth } else { most_iterations(&self.constraints) };
            self.wide = Some(estimate);
            return Ok(false);
        }
        let choice = Choice::new(LinearMethod::Cholesky, reason(because, iterations));
        self.watch.notice(Event::Stores(&choice));
        if self.watch.wants_end() {
            return Err(LinearError::Interrupted);
        }
        let made = (choice, Some(estimate));
        let stored =
            LinearSolver::made(pattern, &self.positions, &self.constraints, self.options, made);
        let (n_factorizations, watch) = (self.n_factorizations, self.watch.clone());
        *self = LinearSolver { n_factorizations, watch, ..stored };
        Ok(true)
    }
}

fn reason(because: &str, iterations: Option<usize>) -> String {
    match iterations {
        Some(_) => format!("{because}, the time of storing the tangent and of a factorisation"),
        None => because.to_string(),
    }
}
