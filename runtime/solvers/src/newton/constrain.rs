//! Other fixed degrees of freedom on the way.

use super::{HeldTangent, Newton};
use crate::constraint::Constraints;
use crate::linear::{LinearError, LinearOptions, LinearSolver};

impl Newton<'_> {
    /// From now on these degrees of freedom are fixed: the linear solver begins anew.
    ///
    /// # Errors
    /// As [`Newton::new`].
    pub fn constrain(
        &mut self,
        constraints: &Constraints,
        options: LinearOptions,
    ) -> Result<(), LinearError> {
        let mut linear = LinearSolver::of_energy(self.energy, constraints, options)?;
        if self.energy.bond_pattern().is_some() {
            linear.may_store();
        }
        linear.watched(self.watch.clone());
        self.counters.factorizations += self.linear.n_factorizations();
        self.tangent = HeldTangent::new(self.energy, linear.stores_matrix());
        (self.linear, self.constraints) = (linear, constraints.clone());
        self.forget();
        Ok(())
    }
}
