//! An energy of several measures over arrays.

use std::iter::once;

use num_dual::HyperDual64;

use super::{CoupledForm, MAX_VARIABLES};
use crate::clique::{Part, Variable};
use crate::density::{Evaluator, listed};
use crate::expression::number::Number;
use crate::expression::{Input, Operator};
use crate::kernel::Mode;
use crate::measure::Measure;
use crate::specialise::CompileError;
use crate::values::MAX_FIELDS;
use crate::written::{Dual, Written};

/// Most arrays of a program: variables now, at rest, their changes and directions, and fields.
const SOURCES: usize = 4 * MAX_VARIABLES + MAX_FIELDS;

/// Measures of `n` interactions, variable by variable: entry `k*n + p` is variable `k` of interaction `p`.
#[derive(Clone, Copy, Debug)]
pub struct CoupledBatch<'a> {
    /// How many interactions there are.
    pub n: usize,
    /// The measures, in m, m^2, m^3.
    pub variables: &'a [f64],
    /// The same at rest, > 0.
    pub reference: &'a [f64],
    /// `(l - L)/L` and the like, computed from displacements.
    pub change: &'a [f64],
    /// Parameters that are fields, laid out alike, in SI units ([`CoupledKernel::fields`]); nothing where
    /// the kernel takes none.
    pub fields: &'a [f64],
}

/// An energy of several measures with its gradient and products with its second derivatives.
#[derive(Debug)]
pub struct CoupledKernel {
    clique: Measure,
    variables: Vec<Variable>,
    argument: String,
    /// Typical values of fields.
    fields: Vec<f64>,
    body: Body,
}

#[derive(Debug)]
enum Body {
    Form(Evaluator),
    Dual(WrittenCoupledEnergy),
}

impl CoupledKernel {
    pub(super) fn new(
        form: CoupledForm,
        (clique, mode): (Measure, Mode),
        written: WrittenCoupledEnergy,
    ) -> Result<CoupledKernel, CompileError> {
        let CoupledForm { density, variables } = form;
        let has_fields = density.n_fields() > 0;
        let fields = if has_fields { written.energy.fields() } else { Vec::new() };
        let argument = written.argument.clone();
        let body = match mode {
            Mode::HyperDual => Body::Dual(written),
            _ => Body::Form(Evaluator::new(density, mode)?),
        };
        Ok(CoupledKernel { clique, variables, argument, fields, body })
    }

    /// The measure of the interaction: lengths for bonds, areas for triangles, volumes for tetrahedra.
    pub fn clique(&self) -> Measure {
        self.clique
    }

    /// What it is a function of, in the order of [`CoupledBatch::variables`].
    pub fn variables(&self) -> &[Variable] {
        &self.variables
    }

    /// The same as written: `a, l1, l2`; `a, l1) + psi(angle`.
    pub fn argument(&self) -> &str {
        &self.argument
    }

    /// Typical values of the parameters that are fields, in the order of [`crate::Values::fields`].
    pub fn fields(&self) -> &[f64] {
        &self.fields
    }

    /// psi and, unless it is empty, its gradient.
    ///
    /// # Panics
    /// If an array has another length than the batch asks for.
    pub fn evaluate(&self, at: CoupledBatch<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        let mut room = [&[][..]; SOURCES];
        let sources = listed(&mut room, self.sources(at, &[]));
        assert!(gradient.is_empty() || gradient.len() == at.variables.len(), "one per variable");
        if at.n == 0 {
            return;
        }
        match &self.body {
            Body::Form(evaluator) => {
                let mut room: [&mut [f64]; 1 + MAX_VARIABLES] = Default::default();
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
    pub fn product(&self, at: CoupledBatch<'_>, direction: &[f64], product: &mut [f64]) {
        assert!(direction.len() == at.variables.len(), "one direction");
        let mut room = [&[][..]; SOURCES];
        let sources = listed(&mut room, self.sources(at, direction));
        assert!(product.len() == at.variables.len(), "one product per variable");
        if at.n == 0 {
            return;
        }
        match &self.body {
            Body::Form(evaluator) => {
                let mut room: [&mut [f64]; MAX_VARIABLES] = Default::default();
                evaluator.product(sources, listed(&mut room, product.chunks_mut(at.n)));
            }
            Body::Dual(energy) => energy.dual(at).product(direction, product),
        }
    }

    /// The arrays in the order of the form's inputs; without a direction there are none of it.
    fn sources<'a>(
        &self,
        at: CoupledBatch<'a>,
        direction: &'a [f64],
    ) -> impl Iterator<Item = &'a [f64]> + use<'a> {
        let CoupledBatch { n, variables, reference, change, fields } = at;
        let all = self.variables.len() * n;
        assert!([variables, reference, change].iter().all(|array| array.len() == all));
        assert!(fields.len() == self.fields.len() * n, "fields at each place");
        let arrays = [variables, reference, change, direction, fields];
        arrays.into_iter().flat_map(move |array| array.chunks(n.max(1)))
    }
}

/// The energies of several measures exactly as written: not simplified, parameters not folded.
///
/// Independent of everything that happens after the check, and so the witness for it.
#[derive(Clone, Debug)]
pub struct WrittenCoupledEnergy {
    pub(super) energy: Written,
    pub(super) argument: String,
    pub(super) variables: Vec<Variable>,
}

impl WrittenCoupledEnergy {
    /// The energy over any number type; variables and their values at rest are numbered as in a
    /// [`CoupledBatch`].
    pub fn psi<N: Number>(&self, variable: impl Fn(usize) -> N, rest: impl Fn(usize) -> N) -> N {
        self.psi_with(variable, rest, None::<&fn(usize) -> f64>)
    }

    /// The same with the values of fields, by their places among them; else they have typical ones.
    fn psi_with<N: Number>(
        &self,
        variable: impl Fn(usize) -> N,
        rest: impl Fn(usize) -> N,
        field: Option<&impl Fn(usize) -> f64>,
    ) -> N {
        let place = |own: Input| {
            let is_own = |variable: &Variable| variable.inputs[..2].contains(&own);
            self.variables.iter().position(is_own)
        };
        // What is no variable has cancelled, or a coefficient that is 0: any number will do.
        let now = |own: Input| place(own).map_or(N::constant(1.0), &variable);
        let before = |own: Input| place(own).map_or(N::constant(1.0), &rest);
        self.energy.sum(|input| match input {
            Input::Part(Part::Angle(k)) => angle(
                now(Input::Current(Measure::Area)),
                Part::sides(k).map(|s| now(Input::Part(s))),
            ),
            Input::PartAtRest(Part::Angle(k)) => angle(
                before(Input::Reference(Measure::Area)),
                Part::sides(k).map(|s| before(Input::PartAtRest(s))),
            ),
            Input::Part(_) | Input::Current(_) => now(input),
            Input::PartAtRest(_) | Input::Reference(_) => before(input),
            _ => self.energy.known(input, field),
        })
    }

    /// Its derivatives by hyper-dual numbers at every place.
    fn dual<'a>(
        &'a self,
        at: CoupledBatch<'a>,
    ) -> Dual<'a, impl Fn(usize, &dyn Fn(usize) -> HyperDual64) -> HyperDual64> {
        let psi = move |p: usize, variable: &dyn Fn(usize) -> HyperDual64| {
            let rest = |k: usize| HyperDual64::from_re(at.reference[k * at.n + p]);
            let field = |k: usize| at.fields[k * at.n + p];
            let field = (!at.fields.is_empty()).then_some(&field);
            self.psi_with(variable, rest, field)
        };
        Dual { n: at.n, variables: at.variables, psi }
    }
}

/// The angle between two sides of a triangle, from its area measure, them and the side across.
fn angle<N: Number>(area: N, sides: [N; 3]) -> N {
    let [first, second, across] = sides.map(|side| N::power_constant(side, 2.0));
    let sum = N::binary(Operator::Add, first, second);
    let twice = N::binary(Operator::Subtract, sum, across);
    let product = N::binary(Operator::Multiply, N::constant(0.5), twice);
    N::binary(Operator::Atan2, area, product)
}
