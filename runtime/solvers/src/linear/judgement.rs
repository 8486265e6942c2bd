//! Whether a tangent is positive definite, and by which method that was seen.
//!
//! Factorisations prove it. Conjugate gradients prove the contrary where they meet negative
//! curvature; where they do not, all that is known is what they have seen: the Ritz values lie
//! within the spectrum, and the smallest comes close to its lower end when the solution for a
//! right-hand side that favours no direction converges. GMRES see no signs at all.

use super::conjugate_gradients::{CgLimits, CgOutcome};
use super::fallback::CHOLESKY_FAILED;
use super::{Definiteness, Factor, Inertia, LinearError, LinearSolver, Tangent};

/// To which the probe is solved: what is a millionth of the probe has been seen.
const PROBE_TOLERANCE: f64 = 1e-6;

impl LinearSolver {
    /// What the solver has found about the signs of the eigenvalues of the present tangent.
    pub fn definiteness(&self) -> Definiteness {
        let (positive_definite, negative_pivots, method) = match self.factor {
            Factor::Cholesky => (Some(true), Some(0), "Cholesky".to_string()),
            Factor::Nothing => (Some(true), Some(0), "nothing is free".to_string()),
            Factor::Ldlt(Inertia { negative, zero }) => {
                let singular = zero > 0 || (negative == 0 && self.cholesky_failed());
                let definite = negative == 0 && !singular;
                let found = if singular && negative == 0 {
                    "LDLT: singular to rounding".to_string()
                } else {
                    format!("LDLT: {negative} negative pivots")
                };
                (Some(definite), Some(negative), found)
            }
            Factor::Lu => (None, None, "LU: signs unknown".to_string()),
            Factor::Cg => match self.seen {
                Some((iterations, Some(ritz))) => {
                    let found = format!(
                        "conjugate gradients: {iterations} curvatures, all positive, Ritz values from {:.1e} to {:.1e}",
                        ritz.smallest, ritz.largest
                    );
                    (Some(true), None, found)
                }
                _ => (None, None, "conjugate gradients: nothing solved".to_string()),
            },
            Factor::Gmres => {
                let unknown = ["GMRES: signs unknown".to_string()];
                (None, None, [&unknown[..], &self.notes].concat().join(", "))
            }
            Factor::MinimumResidual => (Some(false), None, self.notes.join(", ")),
            Factor::None => (None, None, "no factorisation".to_string()),
        };
        Definiteness { positive_definite, negative_pivots, method }
    }

    /// Judges a tangent: by Cholesky and then the inertia of LDLT, or, where the solver iterates, by
    /// the curvatures that conjugate gradients see on the way to the solution for a probe. With GMRES
    /// the answer is that nothing is known.
    ///
    /// Factors and preconditioner serve the next [`LinearSolver::solve_factorized`] as well.
    pub fn judge<'a>(
        &mut self,
        tangent: impl Into<Tangent<'a>>,
    ) -> Result<Definiteness, LinearError> {
        let tangent = tangent.into();
        if !self.start(tangent)? {
            match tangent {
                Tangent::Stored(matrix, _) if !self.iterates() => {
                    self.factorize_cholesky_or_ldlt(matrix)?;
                }
                _ => self.judge_by_iterations(tangent)?,
            }
        }
        Ok(self.definiteness())
    }

    fn judge_by_iterations(&mut self, tangent: Tangent<'_>) -> Result<(), LinearError> {
        self.prepare_iterations(tangent)?;
        if self.factor != Factor::Cg {
            return Ok(());
        }
        let probe = probe(self.constraints.n_dofs());
        let mut solution = vec![0.0; probe.len()];
        let limits = self.limits;
        self.limits = CgLimits { tolerance: PROBE_TOLERANCE, ..limits };
        let solved = self.solve_cg(tangent, &probe, &mut solution);
        self.limits = limits;
        match solved {
            Ok(_) if self.factor == Factor::Cg => self.probe = Some((probe, solution)),
            Ok(_) => {}
            // The state is an equilibrium all the same; its stability remains unknown.
            Err(LinearError::NotConverged { .. } | LinearError::TooLarge { .. }) => {
                (self.factor, self.seen) = (Factor::Cg, None);
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// The solution for a right-hand side by the preconditioner at hand, to a percent or so.
    pub(super) fn solve_roughly(
        &mut self,
        tangent: Tangent<'_>,
        rhs: &[f64],
    ) -> Result<Option<Vec<f64>>, LinearError> {
        let limits = CgLimits { tolerance: ROUGH_TOLERANCE, ..self.limits };
        let Some(iterative) = &mut self.iterative else { return Ok(None) };
        let mut solution = vec![0.0; rhs.len()];
        let report = iterative.conjugate_gradients(tangent, rhs, limits, &mut solution)?;
        let converged = matches!(report.outcome, CgOutcome::Converged { .. });
        Ok(converged.then_some(solution))
    }

    fn cholesky_failed(&self) -> bool {
        self.notes.iter().any(|note| note == CHOLESKY_FAILED)
    }
}

/// Residual at which a rough solution is good enough.
const ROUGH_TOLERANCE: f64 = 1e-3;

/// Ones of either sign, without a pattern: SplitMix64 (Steele, Lea, Flood 2014) from a fixed seed.
fn probe(n: usize) -> Vec<f64> {
    let mut state = 0u64;
    let mut next = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        if (z ^ (z >> 31)) >> 63 == 0 { 1.0 } else { -1.0 }
    };
    (0..n).map(|_| next()).collect()
}
