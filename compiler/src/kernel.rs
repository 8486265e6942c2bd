//! Kernels: what goes in, what comes out, and the ways to evaluate an energy.

use num_dual::HyperDual64;

use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::{ExprGraph, Input, NodeId, Operator};
use crate::jit::CompiledKernel;
use crate::measure::Measure;
use crate::model::Model;
use crate::specialise::{CompileError, Dropped, Form, ScalarEnergy};
use crate::values::Values;

/// Inputs of a kernel, one entry per interaction; the three slices have one length.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Current measures l, a or v in m, m^2, m^3.
    pub measure: &'a [f64],
    /// Reference measures L, A or V > 0.
    pub reference: &'a [f64],
    /// Relative changes `(l - L)/L`, computed from displacements.
    pub change: &'a [f64],
}

/// Outputs of a kernel, one entry per interaction.
#[derive(Clone, Debug, Default)]
pub struct Derivatives {
    /// The energy density.
    pub psi: Vec<f64>,
    /// Its derivative with respect to the measure.
    pub dpsi: Vec<f64>,
    /// Its second derivative with respect to the measure.
    pub d2psi: Vec<f64>,
}

impl Derivatives {
    /// Makes room for `n` interactions.
    pub fn resize(&mut self, n: usize) {
        self.psi.resize(n, 0.0);
        self.dpsi.resize(n, 0.0);
        self.d2psi.resize(n, 0.0);
    }
}

/// How psi, psi' and psi'' are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Machine code of the symbolic derivatives.
    #[default]
    Jit,
    /// The same graph, interpreted; the same bits as [`Mode::Jit`].
    Interpreter,
    /// The energy as written, over hyper-dual numbers of the measure.
    HyperDual,
}

/// An energy of one measure, ready to be evaluated over arrays.
#[derive(Debug)]
pub struct Kernel {
    measure: Measure,
    body: Body,
}

/// The calling convention of each mode; [`Kernel::evaluate`] hides it.
#[derive(Debug)]
enum Body {
    Code(Box<CompiledKernel>),
    Graph(ScalarEnergy),
    Dual(WrittenEnergy),
}

impl Kernel {
    /// What it is a function of.
    pub fn measure(&self) -> Measure {
        self.measure
    }

    /// psi, psi' and psi'' for every entry of the batch.
    ///
    /// # Panics
    /// If the slices of the batch differ in length.
    pub fn evaluate(&self, batch: Batch<'_>, out: &mut Derivatives) {
        match &self.body {
            Body::Code(code) => code.evaluate(batch, out),
            Body::Graph(energy) => interpret(energy, batch, out),
            Body::Dual(energy) => {
                out.resize(batch.measure.len());
                for i in 0..batch.measure.len() {
                    let psi = energy.derivatives(batch.measure[i], batch.reference[i]);
                    (out.psi[i], out.dpsi[i], out.d2psi[i]) = psi;
                }
            }
        }
    }
}

fn interpret(energy: &ScalarEnergy, batch: Batch<'_>, out: &mut Derivatives) {
    let n = batch.measure.len();
    assert!(batch.reference.len() == n && batch.change.len() == n, "one entry per interaction");
    out.resize(n);
    let mut interpreter = Interpreter::<f64>::new();
    for i in 0..n {
        let (measure, reference) = (&batch.measure[i], &batch.reference[i]);
        energy.run(&mut interpreter, measure, reference, &batch.change[i]);
        let [psi, dpsi, d2psi] = energy.roots.map(|root| interpreter.number(root));
        (out.psi[i], out.dpsi[i], out.d2psi[i]) = (psi, dpsi, d2psi);
    }
}

/// The energy of a measure exactly as written: not simplified, parameters not folded.
///
/// Independent of everything that happens after the check, and so the witness for it.
#[derive(Clone, Debug)]
pub struct WrittenEnergy {
    graph: ExprGraph,
    roots: Vec<NodeId>,
    values: Values,
}

impl WrittenEnergy {
    /// The energy over any number type, as a function of the measure and its reference.
    pub fn evaluate<N: Number>(&self, measure: N, reference: N) -> N {
        let mut interpreter = Interpreter::new();
        interpreter.run(&self.graph, |input| match input {
            Input::Current(_) => measure.clone(),
            Input::Reference(_) => reference.clone(),
            Input::Parameter(i) => N::constant(self.values.parameters[usize::from(i)]),
            Input::Horizon => N::constant(self.values.horizon),
            // The checker makes no such input; only the simplifier does.
            Input::Change(_) => N::constant(f64::NAN),
        });
        let terms = self.roots.iter().map(|root| interpreter.number(*root));
        terms.reduce(|sum, term| N::binary(Operator::Add, sum, term)).unwrap_or(N::constant(0.0))
    }

    /// psi, psi' and psi'' by one evaluation over hyper-dual numbers (firooz2023, eq. (27)).
    pub fn derivatives(&self, measure: f64, reference: f64) -> (f64, f64, f64) {
        let varied = HyperDual64::new(measure, 1.0, 1.0, 0.0);
        let psi = self.evaluate(varied, HyperDual64::from_re(reference));
        (psi.re, psi.eps1, psi.eps1eps2)
    }
}

/// All energies of a potential, ready to be evaluated.
#[derive(Debug, Default)]
pub struct CompiledPotential {
    /// At most one per measure, ascending.
    pub kernels: Vec<Kernel>,
    /// What is not modelled, and why.
    pub dropped: Vec<Dropped>,
}

impl Model {
    /// The energies for these values: specialised, differentiated and, in [`Mode::Jit`], compiled.
    ///
    /// # Errors
    /// An energy that is too large, or a horizon that is needed and not given.
    pub fn compile(&self, values: &Values, mode: Mode) -> Result<CompiledPotential, CompileError> {
        self.compile_as(values, mode, Form::Accurate)
    }

    /// The same in a chosen form; hyper-dual numbers always take the energy as written.
    ///
    /// # Errors
    /// As for [`Self::compile`].
    pub fn compile_as(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<CompiledPotential, CompileError> {
        let specialised = self.specialise_as(values, form)?;
        let mut kernels = Vec::new();
        for energy in specialised.energies {
            let measure = energy.measure;
            let body = match mode {
                Mode::Jit => Body::Code(Box::new(CompiledKernel::new(&energy)?)),
                Mode::Interpreter => Body::Graph(energy),
                Mode::HyperDual => Body::Dual(self.written(values, measure)),
            };
            kernels.push(Kernel { measure, body });
        }
        Ok(CompiledPotential { kernels, dropped: specialised.dropped })
    }

    /// The energy of a measure as written, for these values; 0 where there is none.
    pub fn written(&self, values: &Values, measure: Measure) -> WrittenEnergy {
        let (graph, roots) = match self.variant(values.dimension) {
            Some(variant) => {
                let energies = variant.energies.iter().filter(|e| e.measure == measure);
                let roots: Vec<NodeId> = energies.map(|e| e.root).collect();
                variant.graph.extract(&roots)
            }
            None => (ExprGraph::new(), Vec::new()),
        };
        WrittenEnergy { graph, roots, values: values.clone() }
    }
}
