//! What the iterative methods keep from one matrix to the next, and their steps.

use piola_mechanics::interaction::Slabs;
use piola_mechanics::matrix::BlockPattern;

use super::LinearError;
use super::conjugate_gradients::{CgLimits, CgOutcome, CgReport, conjugate_gradients};
use super::factor_of_bonds::FactorOfBonds;
use super::gmres::{GmresReport, RESTART, gmres};
use super::minimum_residual::minimum_residual;
use super::operator::{MatrixFree, Operator, StoredMatrix};
use super::preconditioner::{BlockJacobi, Blocks, Preconditioner};
use super::report::{LinearOptions, PreconditionerChoice};
use super::tangent::Tangent;
use super::two_level::{CoarseSystem, TwoLevel};
use crate::constraint::Constraints;
use crate::watch::{Event, Watch};

/// The preconditioner of diagonal blocks alone, in words.
pub const BLOCK_JACOBI: &str = "block Jacobi";

/// How a matrix turned out while its preconditioner was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Prepared {
    Ready,
    /// A proof that the matrix is not positive definite.
    Indefinite(&'static str),
}

/// Preconditioners and work arrays of one pattern and one set of fixed degrees of freedom.
pub(super) struct Iterative {
    dimension: usize,
    is_free: Vec<bool>,
    constraints: Constraints,
    slabs: Slabs,
    /// The factors of a matrix like the tangent.
    factor: Option<FactorOfBonds>,
    /// Whether the matrix like the tangent could be factorised.
    has_factor: bool,
    coarse: Option<CoarseSystem>,
    jacobi: Option<BlockJacobi>,
    /// Block Jacobi with absolute values, where the matrix turned out to be indefinite.
    absolute: Option<BlockJacobi>,
    watch: Watch,
}

impl Iterative {
    pub(super) fn new(
        pattern: &BlockPattern,
        positions: &[f64],
        constraints: &Constraints,
        options: &LinearOptions,
        tangent: Tangent<'_>,
        watch: Watch,
    ) -> Result<Iterative, LinearError> {
        let choice = options.preconditioner;
        let factor = match tangent {
            Tangent::Bonds { .. } if choice == PreconditionerChoice::Auto => {
                FactorOfBonds::new(pattern, constraints, options.memory_limit)?
            }
            _ => None,
        };
        let two_levels = match tangent {
            Tangent::MatrixFree { .. } => false,
            _ => choice != PreconditionerChoice::BlockJacobi && factor.is_none(),
        };
        let coarse =
            if two_levels { CoarseSystem::new(pattern, positions, constraints)? } else { None };
        Ok(Iterative {
            dimension: pattern.dimension,
            is_free: (0..constraints.n_dofs()).map(|dof| !constraints.is_fixed(dof)).collect(),
            constraints: constraints.clone(),
            slabs: pattern.slabs(),
            factor,
            has_factor: false,
            coarse,
            jacobi: None,
            absolute: None,
            watch,
        })
    }

    /// The preconditioner in words.
    pub(super) fn preconditioner(&self) -> String {
        if self.has_factor {
            return "the factors of a bond-based body".to_string();
        }
        match &self.coarse {
            Some(coarse) => {
                let (unknowns, pieces) = coarse.size();
                format!(
                    "block Jacobi and a coarse system of {unknowns} unknowns on {pieces} pieces"
                )
            }
            None => BLOCK_JACOBI.to_string(),
        }
    }

    /// Makes the preconditioner of a matrix.
    pub(super) fn prepare(&mut self, tangent: Tangent<'_>) -> Prepared {
        self.absolute = None;
        if let (Some(factor), Tangent::Bonds { bonds, .. }) = (&mut self.factor, tangent) {
            self.has_factor = factor.update(bonds);
            if self.has_factor {
                return Prepared::Ready;
            }
        }
        let diagonal = tangent.diagonal();
        self.jacobi =
            BlockJacobi::new(self.dimension, &diagonal, &self.constraints, Blocks::AsTheyAre);
        if self.jacobi.is_none() {
            return Prepared::Indefinite(
                "a diagonal block of the tangent is not positive definite",
            );
        }
        let matrix = match tangent {
            Tangent::Stored(matrix, _) | Tangent::Bonds { bonds: matrix, .. } => Some(matrix),
            Tangent::MatrixFree { .. } => None,
        };
        if let (Some(coarse), Some(matrix)) = (&mut self.coarse, matrix)
            && !coarse.update(matrix)
        {
            return Prepared::Indefinite(
                "the tangent is not positive definite for linear displacements of pieces of the body",
            );
        }
        Prepared::Ready
    }

    /// Makes the preconditioner of a matrix that may be indefinite; `false` where a diagonal block
    /// is 0.
    pub(super) fn prepare_indefinite(&mut self, tangent: Tangent<'_>) -> bool {
        if self.has_factor {
            return true;
        }
        let diagonal = tangent.diagonal();
        self.absolute =
            BlockJacobi::new(self.dimension, &diagonal, &self.constraints, Blocks::Absolute);
        self.absolute.is_some()
    }

    /// Conjugate gradients with the matrix last prepared. Entries of `rhs` at fixed degrees of
    /// freedom are taken as 0.
    pub(super) fn conjugate_gradients(
        &mut self,
        tangent: Tangent<'_>,
        rhs: &[f64],
        limits: CgLimits,
        x: &mut [f64],
    ) -> Result<CgReport, LinearError> {
        let rhs = self.free(rhs);
        self.preconditioned(tangent, |operator, preconditioner, is_free| {
            conjugate_gradients(operator, preconditioner, is_free, &rhs, limits, x)
        })
    }

    /// Minimum residuals with the matrix last prepared as indefinite: iterations and the relative
    /// residual.
    pub(super) fn minimum_residual(
        &mut self,
        tangent: Tangent<'_>,
        rhs: &[f64],
        limits: CgLimits,
        x: &mut [f64],
    ) -> Result<(usize, f64), LinearError> {
        let rhs = self.free(rhs);
        self.preconditioned(tangent, |operator, preconditioner, is_free| {
            minimum_residual(operator, preconditioner, is_free, &rhs, limits, x)
        })
    }

    /// GMRES with the matrix last prepared, as indefinite or not.
    pub(super) fn gmres(
        &mut self,
        tangent: Tangent<'_>,
        rhs: &[f64],
        limits: CgLimits,
        x: &mut [f64],
    ) -> Result<GmresReport, LinearError> {
        let rhs = self.free(rhs);
        self.preconditioned(tangent, |operator, preconditioner, is_free| {
            gmres(operator, preconditioner, is_free, &rhs, (RESTART, limits), x)
        })
    }

    /// Works with the tangent and the preconditioner last made.
    ///
    /// # Errors
    /// Whoever looks on wants an end.
    fn preconditioned<T>(
        &mut self,
        tangent: Tangent<'_>,
        work: impl FnOnce(&dyn Operator, &mut dyn Preconditioner, &[bool]) -> T,
    ) -> Result<T, LinearError> {
        let mut two_level;
        let preconditioner: &mut dyn Preconditioner =
            match (&mut self.factor, &mut self.absolute, &mut self.coarse, &mut self.jacobi) {
                (Some(factor), ..) if self.has_factor => factor,
                (_, Some(absolute), ..) => absolute,
                (.., Some(coarse), Some(jacobi)) => {
                    two_level = TwoLevel { jacobi, coarse };
                    &mut two_level
                }
                (.., jacobi) => jacobi.as_mut().expect("prepared"),
            };
        let (is_free, watch) = (&self.is_free, &self.watch);
        let done = with_operator(tangent, &self.slabs, |operator| {
            work(&Watched { operator, watch }, preconditioner, is_free)
        });
        if watch.wants_end() { Err(LinearError::Interrupted) } else { Ok(done) }
    }

    fn free(&self, x: &[f64]) -> Vec<f64> {
        x.iter().zip(&self.is_free).map(|(&x, &free)| if free { x } else { 0.0 }).collect()
    }
}

/// An operator that tells of its products, and has none once an end is wanted: the methods stop at
/// what is not a number.
struct Watched<'a> {
    operator: &'a dyn Operator,
    watch: &'a Watch,
}

impl Operator for Watched<'_> {
    fn multiply(&self, x: &[f64], y: &mut [f64]) {
        if self.watch.wants_end() {
            y.fill(f64::NAN);
            return;
        }
        self.operator.multiply(x, y);
        self.watch.notice(Event::Product);
    }
}

fn with_operator<T>(
    tangent: Tangent<'_>,
    slabs: &Slabs,
    work: impl FnOnce(&dyn Operator) -> T,
) -> T {
    match tangent {
        Tangent::Stored(matrix, None) => work(&StoredMatrix { matrix, slabs }),
        Tangent::Stored(_, Some(hessian))
        | Tangent::MatrixFree { hessian, .. }
        | Tangent::Bonds { hessian, .. } => work(&MatrixFree { hessian }),
    }
}

/// The residual of a run that came to rest far above the tolerance.
pub(super) fn lost(report: &CgReport, limits: CgLimits) -> Option<f64> {
    match report.outcome {
        // Not a number is lost, too.
        CgOutcome::Converged { residual } if residual <= CG_LOST.max(2.0 * limits.tolerance) => {
            None
        }
        CgOutcome::Converged { residual } => Some(residual),
        _ => None,
    }
}

/// In ill-conditioned systems the true residual may come to rest above the tolerance; relative to
/// the right-hand side, one above this is of no use to Newton's method.
const CG_LOST: f64 = 1e-4;
