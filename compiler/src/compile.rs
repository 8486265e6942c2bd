//! From a model to what can be evaluated: all energies of a potential, compiled.
//!
//! Before: a model with values. After: kernels over arrays, one per energy that something is left of,
//! and a list of what is not modelled.

use crate::coupled::CoupledKernel;
use crate::gathered::{GatheredKernels, VectorKernels};
use crate::kernel::{Kernel, Mode};
use crate::model::Model;
use crate::point::GradientKernel;
use crate::specialise::{CompileError, Dropped, Form};
use crate::values::Values;

/// All energies of a potential, ready to be evaluated.
#[derive(Debug, Default)]
pub struct Compiled {
    /// Of measures: at most one each, ascending.
    pub kernels: Vec<Kernel>,
    /// Of the deformation gradient.
    pub gradient: Option<GradientKernel>,
    /// Of gathered values, with the integrals that gather them.
    pub gathered: Option<GatheredKernels>,
    /// Of what points gather of vectors, with what gathers it: in the place of [`Compiled::gathered`].
    pub vectors: Option<VectorKernels>,
    /// Of several measures of triangles or of tetrahedra: at most one each.
    pub coupled: Vec<CoupledKernel>,
    /// What is not modelled, and why.
    pub dropped: Vec<Dropped>,
}

/// The kinds of energies, by what they are functions of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Measures of interactions: `psi(l)`, `psi(a)`, `psi(v)`.
    Measures,
    /// The deformation gradient: `psi(F)`.
    Gradient,
    /// Values gathered over families: `psi(theta)`, `psi(l, m)`.
    Gathered,
    /// Several measures of one interaction: `psi(a, l1, l2)`, `psi(angle)`.
    Coupled,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Kind; 4] = [Kind::Measures, Kind::Gradient, Kind::Gathered, Kind::Coupled];
}

impl Model {
    /// The energies for these values: specialised, differentiated and, in [`Mode::Jit`], compiled.
    /// Hyper-dual numbers take the energies as written, in any form.
    ///
    /// # Errors
    /// An energy that is too large, or a horizon that is needed and not given.
    pub fn compile(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Compiled, CompileError> {
        self.compile_only(&Kind::ALL, values, mode, form)
    }

    /// The same for energies of some kinds: what is wrong with others does not matter.
    ///
    /// # Errors
    /// As for [`Self::compile`].
    pub fn compile_only(
        &self,
        kinds: &[Kind],
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Compiled, CompileError> {
        let mut compiled = Compiled::default();
        for kind in kinds {
            let dropped = match kind {
                Kind::Measures => self.compile_measures(values, mode, form, &mut compiled.kernels),
                Kind::Gradient => self.compile_gradient(values, mode, form, &mut compiled.gradient),
                Kind::Gathered if self.gathers_vectors() => {
                    self.compile_vectors(values, (mode, form), &mut compiled.vectors)
                }
                Kind::Gathered => self.compile_gathered(values, mode, form, &mut compiled.gathered),
                Kind::Coupled => self.compile_coupled(values, mode, form, &mut compiled.coupled),
            };
            compiled.dropped.extend(dropped?);
        }
        Ok(compiled)
    }
}
