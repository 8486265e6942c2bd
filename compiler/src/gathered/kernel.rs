//! An energy of gathered states over arrays.

use std::iter::once;

use num_dual::HyperDual64;

use crate::check::MAX_INTEGRALS;
use crate::density::{DensityForm, Evaluator, listed};
use crate::expression::Input;
use crate::expression::number::Number;
use crate::kernel::{Level, Mode};
use crate::measure::Measure;
use crate::specialise::{CompileError, Form};
use crate::values::MAX_FIELDS;
use crate::written::{Dual, Written};

/// Most variables: the length of a bond and all integrals.
const VARIABLES: usize = 1 + MAX_INTEGRALS;

/// As many as most energies have: clearing room for all takes a thirtieth of the time of a bond.
const FEW_VARIABLES: usize = 9;

/// Arrays of a program of so many variables: these, directions, fields and what else is known of a bond.
const fn sources(variables: usize) -> usize {
    2 * variables + 2 + MAX_FIELDS
}

/// Variables of `n` places, variable by variable: entry `k*n + p` is variable `k` at place `p`.
#[derive(Clone, Copy, Debug)]
pub struct GatheredBatch<'a> {
    /// How many places there are.
    pub n: usize,
    /// Of bonds the lengths `l` in m, then the integrals; of points the integrals.
    pub variables: &'a [f64],
    /// Of bonds `(l - L)/L`, computed from displacements; of points nothing.
    pub change: &'a [f64],
    /// Of bonds the lengths at rest `L > 0` in m; of points nothing.
    pub reference: &'a [f64],
    /// Parameters that are fields, laid out like variables, in SI units ([`GatheredKernel::fields`]);
    /// nothing where the kernel takes none.
    pub fields: &'a [f64],
}

/// An energy of gathered states with its gradient and products with its second derivatives.
#[derive(Debug)]
pub struct GatheredKernel {
    of_bonds: bool,
    n_integrals: usize,
    /// The integrals that an energy of bonds holds, where it is known to be affine beside them.
    affine_beside: Option<Vec<u8>>,
    /// Typical values of fields.
    fields: Vec<f64>,
    body: Body,
}

#[derive(Debug)]
enum Body {
    Form(Evaluator),
    Dual(WrittenGatheredEnergy),
}

/// What the arrays of programs hold, in their order.
pub(super) fn inputs(of_bonds: bool, n_integrals: usize) -> Vec<Input> {
    let l = Measure::Length;
    let bond = [Input::Current(l), Input::Reference(l), Input::Change(l)];
    let integrals = (0..n_integrals as u8).map(Input::Integral);
    let n_variables = (n_integrals + usize::from(of_bonds)) as u8;
    let given = bond.into_iter().filter(|_| of_bonds).chain(integrals);
    given.chain((0..n_variables).map(Input::Direction)).collect()
}

impl GatheredKernel {
    pub(super) fn new(
        form: DensityForm,
        (mode, which): (Mode, Form),
        written: WrittenGatheredEnergy,
    ) -> Result<GatheredKernel, CompileError> {
        let WrittenGatheredEnergy { of_bonds, n_integrals, .. } = written;
        let is_fast = mode == Mode::Jit(Level::Fast) && which == Form::Accurate;
        let has_fields = form.n_fields() > 0;
        let affine_beside = if is_fast && of_bonds { form.affine_beside() } else { None };
        let typical = written.energy.fields();
        let fields = if has_fields { typical } else { Vec::new() };
        let body = match mode {
            Mode::HyperDual => Body::Dual(written),
            _ => Body::Form(Evaluator::new(form, mode)?),
        };
        Ok(GatheredKernel { of_bonds, n_integrals, affine_beside, fields, body })
    }

    /// Typical values of the parameters that are fields, in the order of [`crate::Values::fields`]: the
    /// kernel takes the values of each at every place. Nothing where it depends on none.
    pub fn fields(&self) -> &[f64] {
        &self.fields
    }

    /// Whether it is an energy of bonds.
    pub fn of_bonds(&self) -> bool {
        self.of_bonds
    }

    /// The integrals and, of bonds, the length.
    pub fn n_variables(&self) -> usize {
        self.n_integrals + usize::from(self.of_bonds)
    }

    /// Whether it is an energy of bonds whose derivative by the length is affine in it, and of no other
    /// integrals than those that are fixed. Known at [`Level::Fast`] only: the other ways are followed to
    /// the bit.
    pub fn is_affine_beside(&self, is_fixed: impl Fn(usize) -> bool) -> bool {
        let held = self.affine_beside.as_ref();
        held.is_some_and(|held| held.iter().all(|k| is_fixed(usize::from(*k))))
    }

    /// psi and, unless it is empty, its gradient.
    ///
    /// # Panics
    /// If an array has another length than the batch asks for.
    pub fn evaluate(&self, at: GatheredBatch<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        match self.n_variables() <= FEW_VARIABLES {
            true => self.evaluate_in::<{ sources(FEW_VARIABLES) }, { 1 + FEW_VARIABLES }>(
                at, psi, gradient,
            ),
            false => {
                self.evaluate_in::<{ sources(VARIABLES) }, { 1 + VARIABLES }>(at, psi, gradient);
            }
        }
    }

    /// The same in room for so many arrays, and so many numbers that come out.
    #[inline(always)]
    fn evaluate_in<const SOURCES: usize, const OUTPUTS: usize>(
        &self,
        at: GatheredBatch<'_>,
        psi: &mut [f64],
        gradient: &mut [f64],
    ) {
        let mut room = [&[][..]; SOURCES];
        let sources = listed(&mut room, self.sources(at, &[]));
        assert!(gradient.is_empty() || gradient.len() == at.variables.len(), "one per variable");
        if at.n == 0 {
            return;
        }
        match &self.body {
            Body::Form(evaluator) => {
                let mut room: [&mut [f64]; OUTPUTS] = std::array::from_fn(|_| &mut [][..]);
                let gradient = gradient.chunks_mut(at.n);
                evaluator.evaluate(sources, listed(&mut room, once(psi).chain(gradient)));
            }
            Body::Dual(energy) => energy.dual(at).evaluate(psi, gradient),
        }
    }

    /// What the gradient changes by in a direction.
    ///
    /// # Panics
    /// If an array has another length than the batch asks for.
    pub fn product(&self, at: GatheredBatch<'_>, direction: &[f64], product: &mut [f64]) {
        match self.n_variables() <= FEW_VARIABLES {
            true => {
                self.product_in::<{ sources(FEW_VARIABLES) }, FEW_VARIABLES>(at, direction, product)
            }
            false => {
                self.product_in::<{ sources(VARIABLES) }, VARIABLES>(at, direction, product);
            }
        }
    }

    #[inline(always)]
    fn product_in<const SOURCES: usize, const OUTPUTS: usize>(
        &self,
        at: GatheredBatch<'_>,
        direction: &[f64],
        product: &mut [f64],
    ) {
        assert!(direction.len() == at.variables.len(), "one direction");
        let mut room = [&[][..]; SOURCES];
        let sources = listed(&mut room, self.sources(at, direction));
        assert!(product.len() == at.variables.len(), "one product per variable");
        if at.n == 0 {
            return;
        }
        match &self.body {
            Body::Form(evaluator) => {
                let mut room: [&mut [f64]; OUTPUTS] = std::array::from_fn(|_| &mut [][..]);
                evaluator.product(sources, listed(&mut room, product.chunks_mut(at.n)));
            }
            Body::Dual(energy) => energy.dual(at).product(direction, product),
        }
    }

    /// The arrays in the order of [`inputs`]; without a direction there are none of it.
    fn sources<'a>(
        &self,
        at: GatheredBatch<'a>,
        direction: &'a [f64],
    ) -> impl Iterator<Item = &'a [f64]> + use<'a> {
        let n = at.n;
        let given = if self.of_bonds { n } else { 0 };
        assert!(at.variables.len() == self.n_variables() * n, "all variables at each place");
        assert!(at.change.len() == given && at.reference.len() == given, "one per bond");
        assert!(at.fields.len() == self.fields.len() * n, "fields at each place");
        let (lengths, integrals) = at.variables.split_at(given);
        let of_bonds = [lengths, at.reference, at.change].into_iter().filter(move |_| given > 0);
        let all = of_bonds.chain(integrals.chunks(n.max(1))).chain(direction.chunks(n.max(1)));
        all.chain(at.fields.chunks(n.max(1)))
    }
}

/// The energy of gathered states exactly as written: not simplified, parameters not folded.
///
/// Independent of everything that happens after the check, and so the witness for it.
#[derive(Clone, Debug)]
pub struct WrittenGatheredEnergy {
    pub(super) energy: Written,
    pub(super) of_bonds: bool,
    pub(super) n_integrals: usize,
}

impl WrittenGatheredEnergy {
    /// The energy over any number type; variables are numbered as in a [`GatheredBatch`].
    pub fn psi<N: Number>(&self, variable: impl Fn(usize) -> N, reference: N) -> N {
        self.psi_with(variable, reference, None::<&fn(usize) -> f64>)
    }

    /// The same with the values of fields, by their places among them; else they have typical ones.
    fn psi_with<N: Number>(
        &self,
        variable: impl Fn(usize) -> N,
        reference: N,
        field: Option<&impl Fn(usize) -> f64>,
    ) -> N {
        let first = usize::from(self.of_bonds);
        self.energy.sum(|input| match input {
            Input::Current(_) => variable(0),
            Input::Reference(_) => reference.clone(),
            Input::Integral(k) => variable(first + usize::from(k)),
            _ => self.energy.known(input, field),
        })
    }

    /// Its derivatives by hyper-dual numbers at every place.
    fn dual<'a>(
        &'a self,
        at: GatheredBatch<'a>,
    ) -> Dual<'a, impl Fn(usize, &dyn Fn(usize) -> HyperDual64) -> HyperDual64> {
        let psi = move |p: usize, variable: &dyn Fn(usize) -> HyperDual64| {
            let reference = at.reference.get(p).copied().unwrap_or(f64::NAN);
            let field = |k: usize| at.fields[k * at.n + p];
            let field = (!at.fields.is_empty()).then_some(&field);
            self.psi_with(variable, HyperDual64::from_re(reference), field)
        };
        Dual { n: at.n, variables: at.variables, psi }
    }
}
