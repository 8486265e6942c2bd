//! What goes into the linear solver besides the matrix, and what comes out besides the solution.

use piola_mechanics::words::Words;

use super::lanczos::RitzValues;

/// How to solve linear systems.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LinearMethod {
    /// The method that suits the size, dimension and memory: see [`choose`](super::choose).
    #[default]
    Auto,
    /// Sparse Cholesky.
    Cholesky,
    /// Sparse LDLT with Bunch-Kaufman pivots within supernodes.
    Ldlt,
    /// Sparse LU.
    Lu,
    /// Preconditioned conjugate gradients.
    Cg,
    /// Conjugate gradients with a tangent that is never stored: each product visits every
    /// interaction.
    MatrixFree,
    /// Minimum residuals, the fallback of conjugate gradients where the tangent is indefinite and
    /// too large to be factorised.
    MinimumResidual,
    /// Restarted GMRES, on a stored tangent or, where there is none, without.
    Gmres,
}

impl Words for LinearMethod {
    const WORDS: &'static [(&'static str, LinearMethod)] = &[
        ("auto", LinearMethod::Auto),
        ("cholesky", LinearMethod::Cholesky),
        ("ldlt", LinearMethod::Ldlt),
        ("lu", LinearMethod::Lu),
        ("cg", LinearMethod::Cg),
        ("matrix-free", LinearMethod::MatrixFree),
        ("gmres", LinearMethod::Gmres),
    ];
}

impl LinearMethod {
    /// Whether it starts with iterations, those of conjugate gradients or GMRES.
    pub fn iterates(self) -> bool {
        matches!(self, LinearMethod::Cg | LinearMethod::MatrixFree | LinearMethod::Gmres)
    }

    /// The name in prose.
    pub fn name(self) -> &'static str {
        match self {
            LinearMethod::Auto => "auto",
            LinearMethod::Cholesky => "Cholesky",
            LinearMethod::Ldlt => "LDLT",
            LinearMethod::Lu => "LU",
            LinearMethod::Cg => "conjugate gradients",
            LinearMethod::MatrixFree => "matrix-free conjugate gradients",
            LinearMethod::MinimumResidual => "minimum residuals",
            LinearMethod::Gmres => "GMRES",
        }
    }
}

/// What makes conjugate gradients and GMRES converge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PreconditionerChoice {
    /// Two levels, where the tangent is stored and the body is large enough to be cut into pieces;
    /// else block Jacobi.
    #[default]
    Auto,
    /// The inverses of the diagonal blocks.
    BlockJacobi,
    /// Block Jacobi and a coarse system of linear displacement fields on pieces of the body.
    TwoLevel,
}

impl Words for PreconditionerChoice {
    const WORDS: &'static [(&'static str, PreconditionerChoice)] = &[
        ("auto", PreconditionerChoice::Auto),
        ("block-jacobi", PreconditionerChoice::BlockJacobi),
        ("two-level", PreconditionerChoice::TwoLevel),
    ];
}

/// Choices for the linear solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearOptions {
    /// The method to start with.
    pub method: LinearMethod,
    /// The preconditioner of conjugate gradients and GMRES.
    pub preconditioner: PreconditionerChoice,
    /// Iterative methods stop at this residual relative to the right-hand side (2-norms), unless
    /// [`set_tolerance`](super::LinearSolver::set_tolerance) says otherwise.
    pub cg_tolerance: f64,
    /// Factors that need more bytes than this are refused; `Auto` stores no matrix that does.
    pub memory_limit: f64,
}

impl Default for LinearOptions {
    fn default() -> Self {
        LinearOptions {
            method: LinearMethod::Auto,
            preconditioner: PreconditionerChoice::Auto,
            cg_tolerance: 1e-12,
            memory_limit: 8.0 * 1024.0 * 1024.0 * 1024.0,
        }
    }
}

/// How a linear system was solved.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearReport {
    /// The method that gave the solution.
    pub method: LinearMethod,
    /// Iterations of conjugate gradients, minimum residuals and GMRES, also when another method had to
    /// finish.
    pub iterations: usize,
    /// What conjugate gradients saw of the spectrum of the preconditioned matrix.
    pub ritz: Option<RitzValues>,
    /// `norm(K x - b)/norm(b)`, both 2-norms over the free degrees of freedom; 0 for `b = 0`.
    pub relative_residual: f64,
    /// Whether the matrix is positive definite, where the method tells: factorisations prove it,
    /// conjugate gradients have seen curvatures of one sign only.
    pub positive_definite: Option<bool>,
    /// How many eigenvalues are negative, where the method tells.
    pub negative_pivots: Option<usize>,
    /// Stored numbers of the factor, where there is one.
    pub factor_nonzeros: Option<usize>,
    /// Fallbacks and what caused them.
    pub notes: Vec<String>,
}

/// A linear system that could not be solved.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LinearError {
    /// No factorisation of the tangent gives an accurate solution.
    #[error(
        "the tangent stiffness is singular ({free} free degrees of freedom): the points can move without force, \
         as in a mechanism or at a limit point"
    )]
    Singular {
        /// How many degrees of freedom are free.
        free: usize,
    },
    /// The factor exceeds the memory limit.
    #[error(
        "{because}a factorisation needs {needed:.1e} bytes, more than the limit of {limit:.1e}"
    )]
    TooLarge {
        /// What made a factorisation necessary, if it was not the first choice; ends in a colon.
        because: String,
        /// Bytes of the factor.
        needed: f64,
        /// The limit.
        limit: f64,
    },
    /// Iterating reached no solution, and a factorisation is not to be had.
    #[error(
        "{because}: {iterations} iterations left a residual of {residual:.1e} of the right-hand side, and the \
         tangent is too large to be factorised"
    )]
    NotConverged {
        /// What happened.
        because: String,
        /// How many iterations were made.
        iterations: usize,
        /// 2-norm of the residual over that of the right-hand side.
        residual: f64,
    },
    /// Products with a tangent that is not stored cost more than storing and factorising it, as far
    /// as is known. Newton's method answers it.
    #[error("{because}")]
    GivenUp {
        /// What happened.
        because: String,
        /// How many iterations were made, if more of them would help.
        iterations: Option<usize>,
    },
    /// The method needs the tangent itself.
    #[error(
        "{method} needs a stored tangent, and products by finite differences are all there is: take GMRES or \
         matrix-free conjugate gradients"
    )]
    ProductsOnly {
        /// The method in prose.
        method: &'static str,
    },
    /// The machine refused memory for a factorisation.
    #[error("there is not enough memory for the factorisation")]
    OutOfMemory,
    /// Whoever looked on wanted an end.
    #[error("the solution was interrupted")]
    Interrupted,
    /// Entries of the matrix or of the right-hand side are not finite.
    #[error("the {what} of the linear system holds a number that is not finite")]
    NotFinite {
        /// "tangent stiffness" or "residual".
        what: &'static str,
    },
}

/// Whether the tangent is positive definite, and how that was seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Definiteness {
    /// `None`: unknown.
    pub positive_definite: Option<bool>,
    /// How many eigenvalues are negative, if known.
    pub negative_pivots: Option<usize>,
    /// The method, and what it found.
    pub method: String,
}
