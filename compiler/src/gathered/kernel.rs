//! An energy of gathered states over arrays.

use num_dual::HyperDual64;

use super::GatheredForm;
use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::{ExprGraph, Input, NodeId, Operator};
use crate::jit::{Code, isa};
use crate::kernel::{Level, Mode};
use crate::measure::Measure;
use crate::program::Program;
use crate::specialise::CompileError;
use crate::values::Values;

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
}

/// An energy of gathered states with its gradient and products with its second derivatives.
#[derive(Debug)]
pub struct GatheredKernel {
    of_bonds: bool,
    n_integrals: usize,
    body: Body,
}

#[derive(Debug)]
enum Body {
    Code(Box<[Code; 2]>),
    Graph(GatheredForm),
    Dual(WrittenGatheredEnergy),
}

/// The arrays of a program in their order.
fn inputs(of_bonds: bool, n_integrals: usize, with_direction: bool) -> Vec<Input> {
    let l = Measure::Length;
    let bond = [Input::Current(l), Input::Reference(l), Input::Change(l)];
    let n_variables = (n_integrals + usize::from(of_bonds)) as u8;
    let mut inputs: Vec<Input> = bond.into_iter().filter(|_| of_bonds).collect();
    inputs.extend((0..n_integrals as u8).map(Input::Integral));
    inputs.extend((0..n_variables).filter(|_| with_direction).map(Input::Direction));
    inputs
}

impl GatheredKernel {
    pub(super) fn new(
        form: GatheredForm,
        mode: Mode,
        written: impl FnOnce() -> WrittenGatheredEnergy,
    ) -> Result<GatheredKernel, CompileError> {
        let (of_bonds, n_integrals) = (form.of_bonds, form.n_integrals);
        let code = |roots: &[NodeId], counts: &[usize], with_direction: bool, level: Level| {
            let inputs = inputs(of_bonds, n_integrals, with_direction);
            let (graph, roots) = form.graph.extract(roots);
            let program = Program { graph: &graph, inputs: &inputs, roots: &roots };
            Code::new(program, counts, level, isa(true)?)
        };
        let body = match mode {
            Mode::Jit(level) => {
                let roots: Vec<NodeId> = [form.psi].iter().chain(&form.gradient).copied().collect();
                let value = code(&roots, &[1, roots.len()], false, level)?;
                let product = code(&form.product, &[form.product.len()], true, level)?;
                Body::Code(Box::new([value, product]))
            }
            Mode::Interpreter => Body::Graph(form),
            Mode::HyperDual => Body::Dual(written()),
        };
        Ok(GatheredKernel { of_bonds, n_integrals, body })
    }

    /// Whether it is an energy of bonds.
    pub fn of_bonds(&self) -> bool {
        self.of_bonds
    }

    /// The integrals and, of bonds, the length.
    pub fn n_variables(&self) -> usize {
        self.n_integrals + usize::from(self.of_bonds)
    }

    /// psi and, unless it is empty, its gradient.
    ///
    /// # Panics
    /// If an array has another length than the batch asks for.
    pub fn evaluate(&self, at: GatheredBatch<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        let sources = self.sources(at, None);
        assert!(gradient.is_empty() || gradient.len() == at.variables.len(), "one per variable");
        match &self.body {
            Body::Code(code) => {
                let function = usize::from(!gradient.is_empty());
                let mut outputs = vec![psi];
                outputs.extend(gradient.chunks_mut(at.n.max(1)));
                code[0].run(function, &sources, &mut outputs);
            }
            Body::Graph(form) => interpret(form, &sources, |p, read| {
                psi[p] = read(form.psi);
                for (array, root) in gradient.chunks_mut(at.n).zip(&form.gradient) {
                    array[p] = read(*root);
                }
            }),
            Body::Dual(energy) => energy.every_place(at, None, |p, k, value| {
                psi[p] = value.re;
                if !gradient.is_empty() {
                    gradient[k * at.n + p] = value.eps1;
                }
            }),
        }
    }

    /// What the gradient changes by in a direction.
    ///
    /// # Panics
    /// If an array has another length than the batch asks for.
    pub fn product(&self, at: GatheredBatch<'_>, direction: &[f64], product: &mut [f64]) {
        let sources = self.sources(at, Some(direction));
        assert!(product.len() == at.variables.len(), "one product per variable");
        match &self.body {
            Body::Code(code) => {
                let mut outputs: Vec<&mut [f64]> = product.chunks_mut(at.n.max(1)).collect();
                code[1].run(0, &sources, &mut outputs);
            }
            Body::Graph(form) => interpret(form, &sources, |p, read| {
                for (k, root) in form.product.iter().enumerate() {
                    product[k * at.n + p] = read(*root);
                }
            }),
            Body::Dual(energy) => energy.every_place(at, Some(direction), |p, k, value| {
                product[k * at.n + p] = value.eps1eps2;
            }),
        }
    }

    /// The arrays in the order of [`inputs`].
    fn sources<'a>(&self, at: GatheredBatch<'a>, direction: Option<&'a [f64]>) -> Vec<&'a [f64]> {
        let n = at.n;
        let given = if self.of_bonds { n } else { 0 };
        assert!(at.variables.len() == self.n_variables() * n, "all variables at each place");
        assert!(at.change.len() == given && at.reference.len() == given, "one per bond");
        assert!(direction.is_none_or(|d| d.len() == at.variables.len()), "one direction");
        let mut sources: Vec<&[f64]> = at.variables.chunks(n.max(1)).collect();
        if self.of_bonds {
            sources.splice(1..1, [at.reference, at.change]);
        }
        sources.extend(direction.iter().flat_map(|d| d.chunks(n.max(1))));
        sources
    }
}

/// Runs a form's graph at every place.
fn interpret(
    form: &GatheredForm,
    sources: &[&[f64]],
    mut at: impl FnMut(usize, &dyn Fn(NodeId) -> f64),
) {
    let inputs = inputs(form.of_bonds, form.n_integrals, true);
    let mut interpreter = Interpreter::<f64>::new();
    for p in 0..sources.first().map_or(0, |array| array.len()) {
        interpreter.run(&form.graph, |input| {
            // Specialisation has put numbers in the place of all others.
            let place = inputs.iter().position(|known| *known == input);
            place.and_then(|place| sources.get(place)).map_or(f64::NAN, |array| array[p])
        });
        at(p, &|root| interpreter.number(root));
    }
}

/// The energy of gathered states exactly as written: not simplified, parameters not folded.
///
/// Independent of everything that happens after the check, and so the witness for it.
#[derive(Clone, Debug)]
pub struct WrittenGatheredEnergy {
    pub(super) graph: ExprGraph,
    pub(super) roots: Vec<NodeId>,
    pub(super) values: Values,
    pub(super) of_bonds: bool,
    pub(super) n_integrals: usize,
}

impl WrittenGatheredEnergy {
    /// The energy over any number type; variables are numbered as in a [`GatheredBatch`].
    pub fn psi<N: Number>(&self, variable: impl Fn(usize) -> N, reference: N) -> N {
        let mut interpreter = Interpreter::new();
        let first = usize::from(self.of_bonds);
        interpreter.run(&self.graph, |input| match input {
            Input::Current(_) => variable(0),
            Input::Reference(_) => reference.clone(),
            Input::Integral(k) => variable(first + usize::from(k)),
            Input::Parameter(i) => N::constant(self.values.parameters[usize::from(i)]),
            Input::Horizon => N::constant(self.values.horizon),
            // The checker makes no other inputs for energies of gathered states.
            _ => N::constant(f64::NAN),
        });
        let terms = self.roots.iter().map(|root| interpreter.number(*root));
        terms.reduce(|sum, term| N::binary(Operator::Add, sum, term)).unwrap_or(N::constant(0.0))
    }

    /// One evaluation over hyper-dual numbers for each variable at each place: the first part varies
    /// the variable, the second goes along the direction.
    fn every_place(
        &self,
        at: GatheredBatch<'_>,
        direction: Option<&[f64]>,
        mut take: impl FnMut(usize, usize, HyperDual64),
    ) {
        let n_variables = self.n_integrals + usize::from(self.of_bonds);
        for p in 0..at.n {
            let reference = at.reference.get(p).copied().unwrap_or(f64::NAN);
            for varied in 0..n_variables {
                let variable = |k: usize| {
                    let along = direction.map_or(0.0, |direction| direction[k * at.n + p]);
                    let own = f64::from(u8::from(k == varied));
                    HyperDual64::new(at.variables[k * at.n + p], own, along, 0.0)
                };
                take(p, varied, self.psi(variable, HyperDual64::from_re(reference)));
            }
        }
    }
}
