//! What it takes to go along a way of equilibria on which the loads are free, too: two answers of the body
//! with one tangent.

use piola_mechanics::vector::norm;

use super::{Forcing, Newton, NewtonFailure, ROUNDING_MULTIPLE};
use crate::linear::LinearReport;

/// How far displacements are from an equilibrium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Distance {
    /// 2-norm of the free residual in N.
    pub(crate) residual: f64,
    /// What it is compared with: the larger of the 2-norms of reactions and loads, in N.
    pub(crate) force: f64,
    /// A residual below this is rounding, in N.
    pub(crate) floor: f64,
    /// Whether the residual is within the tolerance, or rounding.
    pub(crate) is_small: bool,
}

/// Two answers of the free points, in m, 0 on the fixed degrees of freedom.
pub(crate) struct Answers {
    /// To the residual that is left: the step of Newton's method.
    pub(crate) closer: Vec<f64>,
    /// To what drives the body.
    pub(crate) driven: Vec<f64>,
    /// Both linear systems as one.
    pub(crate) linear: LinearReport,
}

impl Newton<'_> {
    /// How far displacements `u` in m are from an equilibrium with `loads` in N (both `n x d`).
    ///
    /// # Errors
    /// Forces that are not finite.
    pub(crate) fn distance(&mut self, u: &[f64], loads: &[f64]) -> Result<Distance, NewtonFailure> {
        self.evaluate(u, true)?;
        let (residual, force) = (self.residual_norm(loads), self.force(loads));
        let floor = ROUNDING_MULTIPLE * self.rounding();
        let is_small = residual <= (self.settings.tolerance * force).max(floor);
        Ok(Distance { residual, force, floor, is_small })
    }

    /// How the free points answer, to first order, at displacements `u` in m: to the residual there with
    /// `loads` in N, and to a `jump` of the fixed points (0 elsewhere, in m) with a `change` of the loads in N.
    ///
    /// # Errors
    /// A tangent that is not finite or cannot be solved with.
    pub(crate) fn answers(
        &mut self,
        u: &[f64],
        loads: &[f64],
        (jump, change): (&[f64], &[f64]),
    ) -> Result<Answers, NewtonFailure> {
        self.evaluate(u, true)?;
        self.forcing = Forcing::new(self.settings.variant, self.settings.tolerance);
        let (closer, mut linear) = self.direction(loads)?;
        let mut forced = vec![0.0; u.len()];
        self.tangent.multiply(jump, &mut forced)?;
        let rhs: Vec<f64> = change.iter().zip(&forced).map(|(load, force)| load - force).collect();
        let size = norm(self.constraints.free().iter().map(|dof| rhs[*dof]));
        if size == 0.0 {
            return Ok(Answers { closer, driven: vec![0.0; u.len()], linear });
        }
        let (driven, second) = self.solve_linear(&rhs, self.settings.tolerance)?;
        linear.iterations += second.iterations;
        Ok(Answers { closer, driven, linear })
    }
}
