//! Functions of the vector of a bond and of what its ends gather, over arrays.
//!
//! Three of them make up what a potential of vectors is: the integrands with their multipliers, the functions
//! of integrals with theirs, and the energy of bonds. Each is one number with its derivatives by all that varies.
//! Of `sum_k A_k g_k` the derivatives by the multipliers `A_k` are the integrands themselves, and those by the
//! vector are what a bond pulls with where the energy changes by `A_k` with the integrals: gathering and its
//! transpose are one kernel.

use std::iter::once;

use num_dual::HyperDual64;

use crate::check::MAX_INTEGRALS;
use crate::clique::Part;
use crate::density::{DensityForm, Evaluator, listed};
use crate::expression::number::Number;
use crate::expression::{Function, Input, Operator};
use crate::kernel::Mode;
use crate::measure::Measure;
use crate::specialise::CompileError;
use crate::values::MAX_FIELDS;
use crate::written::{Dual, Written};

/// Most variables: a vector, and what both ends gather.
const VARIABLES: usize = 3 + 2 * MAX_INTEGRALS;

/// Most arrays of a program: variables, what is given, directions and fields.
const SOURCES: usize = 2 * VARIABLES + 1 + MAX_FIELDS;

/// What an array holds of a place: a bond that is seen from one of its ends, or a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// The length of the bond at rest, in m.
    Length,
    /// A component of `xi - Xi` in m: how far the other end has moved against this one.
    Moved(usize),
    /// What this end gathers, by its number.
    Own(usize),
    /// What the other end gathers.
    Neighbour(usize),
    /// A multiplier of what this end gathers.
    Multiplier(usize),
}

impl Slot {
    pub(super) fn input(self) -> Input {
        match self {
            Slot::Length => Input::Reference(Measure::Length),
            Slot::Moved(axis) => Input::Part(Part::Moved(axis as u8)),
            Slot::Own(k) => Input::Integral(k as u8),
            Slot::Neighbour(k) => Input::Neighbour(k as u8),
            Slot::Multiplier(k) => Input::Multiplier(k as u8),
        }
    }
}

/// What a kernel takes at `n` places, array by array: entry `k*n + p` is that of slot `k` at place `p`.
#[derive(Clone, Copy, Debug)]
pub struct FamilyBatch<'a> {
    /// How many places there are.
    pub n: usize,
    /// By [`FamilyKernel::variables`].
    pub variables: &'a [f64],
    /// By [`FamilyKernel::given`].
    pub given: &'a [f64],
    /// Parameters that are fields, among them the direction of bonds, in SI units ([`FamilyKernel::fields`]);
    /// nothing where the kernel takes none.
    pub fields: &'a [f64],
}

/// A function of the vector of a bond and of what its ends gather, with its derivatives.
#[derive(Debug)]
pub struct FamilyKernel {
    variables: Vec<Slot>,
    given: Vec<Slot>,
    /// Typical values of fields.
    fields: Vec<f64>,
    body: Body,
}

#[derive(Debug)]
enum Body {
    Form(Evaluator),
    Dual(WrittenFamily),
}

impl FamilyKernel {
    pub(super) fn new(
        form: DensityForm,
        mode: Mode,
        (variables, given): (Vec<Slot>, Vec<Slot>),
        written: WrittenFamily,
    ) -> Result<FamilyKernel, CompileError> {
        let has_fields = form.n_fields() > 0;
        let fields = if has_fields { written.terms.fields() } else { Vec::new() };
        let body = match mode {
            Mode::HyperDual => Body::Dual(written),
            _ => Body::Form(Evaluator::new(form, mode)?),
        };
        Ok(FamilyKernel { variables, given, fields, body })
    }

    /// What it is differentiated by, in the order of the arrays.
    pub fn variables(&self) -> &[Slot] {
        &self.variables
    }

    /// What it takes beside them.
    pub fn given(&self) -> &[Slot] {
        &self.given
    }

    /// Whether it is a function of bonds, which know their length at rest; else of points.
    pub fn of_bonds(&self) -> bool {
        self.given.contains(&Slot::Length)
    }

    /// Whether it holds what the other end of a bond gathers.
    pub fn has_neighbours(&self) -> bool {
        let mut slots = self.variables.iter().chain(&self.given);
        slots.any(|slot| matches!(slot, Slot::Neighbour(_)))
    }

    /// Typical values of the parameters that are fields, in the order of [`crate::Values::fields`].
    pub fn fields(&self) -> &[f64] {
        &self.fields
    }

    /// The value and, unless it is empty, its gradient by the variables.
    ///
    /// # Panics
    /// If an array has another length than the batch asks for.
    pub fn evaluate(&self, at: FamilyBatch<'_>, value: &mut [f64], gradient: &mut [f64]) {
        let mut room = [&[][..]; SOURCES];
        let sources = listed(&mut room, self.sources(at, &[]));
        assert!(gradient.is_empty() || gradient.len() == at.variables.len(), "one per variable");
        if at.n == 0 {
            return;
        }
        match &self.body {
            Body::Form(evaluator) => {
                let mut room: [&mut [f64]; 1 + VARIABLES] = std::array::from_fn(|_| &mut [][..]);
                let gradient = gradient.chunks_mut(at.n);
                evaluator.evaluate(sources, listed(&mut room, once(value).chain(gradient)));
            }
            Body::Dual(written) => written.dual(self.slots(), at).evaluate(value, gradient),
        }
    }

    /// What the gradient changes by in a direction.
    ///
    /// # Panics
    /// If an array has another length than the batch asks for.
    pub fn product(&self, at: FamilyBatch<'_>, direction: &[f64], product: &mut [f64]) {
        assert!(direction.len() == at.variables.len(), "one direction");
        assert!(product.len() == at.variables.len(), "one product per variable");
        let mut room = [&[][..]; SOURCES];
        let sources = listed(&mut room, self.sources(at, direction));
        if at.n == 0 {
            return;
        }
        match &self.body {
            Body::Form(evaluator) => {
                let mut room: [&mut [f64]; VARIABLES] = std::array::from_fn(|_| &mut [][..]);
                evaluator.product(sources, listed(&mut room, product.chunks_mut(at.n)));
            }
            Body::Dual(written) => written.dual(self.slots(), at).product(direction, product),
        }
    }

    fn slots(&self) -> [&[Slot]; 2] {
        [&self.variables, &self.given]
    }

    /// The arrays in the order of the form's inputs; without a direction there are none of it.
    fn sources<'a>(
        &self,
        at: FamilyBatch<'a>,
        direction: &'a [f64],
    ) -> impl Iterator<Item = &'a [f64]> + use<'a> {
        let n = at.n;
        assert!(at.variables.len() == self.variables.len() * n, "all variables at each place");
        assert!(at.given.len() == self.given.len() * n, "all that is given at each place");
        assert!(at.fields.len() == self.fields.len() * n, "fields at each place");
        let arrays = [at.variables, at.given, direction, at.fields];
        arrays.into_iter().flat_map(move |array| array.chunks(n.max(1)))
    }
}

/// The same function exactly as written: not simplified, parameters not folded.
///
/// Independent of everything that happens after the check, and so the witness for it.
#[derive(Clone, Debug)]
pub struct WrittenFamily {
    /// What is added up.
    pub(super) terms: Written,
    /// The number of the multiplier of each term; of terms without one nothing.
    pub(super) multipliers: Vec<Option<usize>>,
    /// The number that stands for the first component of the direction of a bond.
    pub(super) first_direction: u16,
    /// Functions of integrals that terms hold, with their numbers, each after those that it holds.
    pub(super) functions: Vec<(usize, Written)>,
}

impl WrittenFamily {
    /// Its value over any number type, from what slots hold and the values of fields, by their places among them; else
    /// these have typical ones.
    pub(crate) fn value<N: Number>(
        &self,
        slot: impl Fn(Slot) -> N,
        field: Option<&impl Fn(usize) -> f64>,
    ) -> N {
        let mut functions: Vec<(usize, N)> = Vec::new();
        for (number, written) in &self.functions {
            let value = written.sum(|input| self.input(written, input, &slot, &functions, field));
            functions.push((*number, value));
        }
        let terms =
            self.terms.terms(|input| self.input(&self.terms, input, &slot, &functions, field));
        let scaled =
            terms.into_iter().zip(&self.multipliers).map(|(term, multiplier)| match multiplier {
                Some(k) => N::binary(Operator::Multiply, slot(Slot::Multiplier(*k)), term),
                None => term,
            });
        let sum = |sum, term| N::binary(Operator::Add, sum, term);
        scaled.reduce(sum).unwrap_or(N::constant(0.0))
    }

    fn input<N: Number>(
        &self,
        of: &Written,
        input: Input,
        slot: &impl Fn(Slot) -> N,
        functions: &[(usize, N)],
        field: Option<&impl Fn(usize) -> f64>,
    ) -> N {
        match input {
            Input::Reference(_) => slot(Slot::Length),
            Input::Part(Part::Moved(axis)) => slot(Slot::Moved(usize::from(axis))),
            Input::Integral(k) => {
                let known = functions.iter().find(|(number, _)| *number == usize::from(k));
                known.map_or_else(|| slot(Slot::Own(usize::from(k))), |(_, value)| value.clone())
            }
            Input::Neighbour(k) => slot(Slot::Neighbour(usize::from(k))),
            // The length of the vector `Xi + (xi - Xi)`.
            Input::Current(_) => {
                let squares = (0..of.dimension()).map(|axis| {
                    let number = self.first_direction + axis as u16;
                    let unit: N = of.known(Input::Parameter(number), field);
                    let rest = N::binary(Operator::Multiply, unit, slot(Slot::Length));
                    let now = N::binary(Operator::Add, rest, slot(Slot::Moved(axis)));
                    N::binary(Operator::Multiply, now.clone(), now)
                });
                let sum = squares.reduce(|sum, term| N::binary(Operator::Add, sum, term));
                N::unary(Function::Sqrt, sum.unwrap_or(N::constant(0.0)))
            }
            _ => of.known(input, field),
        }
    }

    /// Its derivatives by hyper-dual numbers at every place.
    fn dual<'a>(
        &'a self,
        [variables, given]: [&'a [Slot]; 2],
        at: FamilyBatch<'a>,
    ) -> Dual<'a, impl Fn(usize, &dyn Fn(usize) -> HyperDual64) -> HyperDual64> {
        let psi = move |p: usize, variable: &dyn Fn(usize) -> HyperDual64| {
            let slot = |slot: Slot| {
                let place = |slots: &[Slot]| slots.iter().position(|own| *own == slot);
                match (place(variables), place(given)) {
                    (Some(k), _) => variable(k),
                    (None, Some(k)) => HyperDual64::from_re(at.given[k * at.n + p]),
                    // What nothing depends on.
                    (None, None) => HyperDual64::from_re(f64::NAN),
                }
            };
            let field = |k: usize| at.fields[k * at.n + p];
            self.value(slot, (!at.fields.is_empty()).then_some(&field))
        };
        Dual { n: at.n, variables: at.variables, psi }
    }
}
