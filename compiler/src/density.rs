//! Energies of several variables over arrays: components of a deformation gradient, integrals over a
//! family.
//!
//! Before: psi, its gradient and its product with a direction in one graph. After: two programs, psi
//! with the gradient, and the product, as machine code or interpreted.

use std::ops::Range;

use rustc_hash::FxHashMap;

use crate::expression::interpret::Interpreter;
use crate::expression::{ExprGraph, Input, NodeId};
use crate::jit::{Code, Listing, isa};
use crate::kernel::{Level, Mode};
use crate::point::axes;
use crate::program::Program;
use crate::specialise::CompileError;

/// psi, its gradient and its product with a direction in one graph.
#[derive(Clone, Debug)]
pub struct DensityForm {
    /// Only what the roots need.
    pub graph: ExprGraph,
    /// The energy density.
    pub psi: NodeId,
    /// Its derivative by each variable.
    pub gradient: Vec<NodeId>,
    /// What the gradient changes by in the direction.
    pub product: Vec<NodeId>,
    /// What the arrays of its programs hold, in their order; without a product no direction is given.
    inputs: Vec<Input>,
    /// How many fields there are among them, the last ones: all, or none where it depends on none.
    n_fields: usize,
}

/// One of the two programs of a form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// psi, then its gradient.
    Value,
    Product,
}

impl DensityForm {
    /// The roots of the graph are psi, its gradient and its product, one after the other. Of the fields it
    /// takes all or none.
    pub(crate) fn new(
        graph: ExprGraph,
        roots: &[NodeId],
        inputs: Vec<Input>,
        fields: &[u16],
    ) -> DensityForm {
        let n = roots.len() / 2;
        let (gradient, product) = (roots[1..=n].to_vec(), roots[n + 1..].to_vec());
        let form = DensityForm { graph, psi: roots[0], gradient, product, inputs, n_fields: 0 };
        let is_needed = |i: &u16| form.graph.depends_on(roots, Input::Parameter(*i));
        if fields.iter().any(is_needed) { form.with_fields(fields) } else { form }
    }

    /// The same with values of fields among its inputs.
    pub(crate) fn with_fields(mut self, fields: &[u16]) -> DensityForm {
        self.inputs.extend(fields.iter().map(|i| Input::Parameter(*i)));
        self.n_fields = fields.len();
        self
    }

    /// How many fields it takes.
    pub fn n_fields(&self) -> usize {
        self.n_fields
    }

    /// Whether principal stretches and axes are among its inputs.
    pub fn has_axes(&self) -> bool {
        self.inputs.iter().any(|input| axes::is_one(*input))
    }

    fn inputs(&self, part: Part) -> Vec<Input> {
        let is_given =
            |input: &Input| part == Part::Product || !matches!(input, Input::Direction(_));
        self.inputs.iter().copied().filter(is_given).collect()
    }

    fn roots(&self, part: Part) -> Vec<NodeId> {
        match part {
            Part::Value => [self.psi].iter().chain(&self.gradient).copied().collect(),
            Part::Product => self.product.clone(),
        }
    }

    /// Hands a program to the code generator.
    fn program<T>(&self, part: Part, make: impl FnOnce(Program<'_>) -> T) -> T {
        let (graph, roots) = self.graph.extract(&self.roots(part));
        make(Program { graph: &graph, inputs: &self.inputs(part), roots: &roots })
    }

    /// The intermediate form and the machine instructions of both programs.
    ///
    /// # Errors
    /// What the code generator reports.
    pub fn listings(&self, level: Level) -> Result<[Listing; 2], CompileError> {
        let listing = |part| self.program(part, |program| Code::listing(program, level));
        Ok([listing(Part::Value)?, listing(Part::Product)?])
    }
}

/// A form over arrays: entry `p` of each belongs to place `p`.
#[derive(Debug)]
pub(crate) enum Evaluator {
    /// psi with the gradient, and the product.
    Code(Box<[Code; 2]>),
    Graph(Box<DensityForm>),
}

impl Evaluator {
    /// Machine code in [`Mode::Jit`], else the graph, to be interpreted.
    pub(crate) fn new(form: DensityForm, mode: Mode) -> Result<Evaluator, CompileError> {
        let Mode::Jit(level) = mode else { return Ok(Evaluator::Graph(Box::new(form))) };
        let code = |part, roots: &[Range<usize>]| {
            form.program(part, |program| Code::new(program, roots, level, isa(true)?))
        };
        let n = form.gradient.len();
        let value = code(Part::Value, &[0..1, 0..n + 1])?;
        Ok(Evaluator::Code(Box::new([value, code(Part::Product, std::slice::from_ref(&(0..n)))?])))
    }

    /// psi alone into one array, or psi and the gradient, from the inputs of the form.
    pub(crate) fn evaluate(&self, inputs: &[&[f64]], outputs: &mut [&mut [f64]]) {
        match self {
            Evaluator::Code(codes) => codes[0].run(usize::from(outputs.len() > 1), inputs, outputs),
            Evaluator::Graph(form) => interpret(form, Part::Value, inputs, outputs),
        }
    }

    /// The product, from the inputs of the form and the direction.
    pub(crate) fn product(&self, inputs: &[&[f64]], outputs: &mut [&mut [f64]]) {
        match self {
            Evaluator::Code(codes) => codes[1].run(0, inputs, outputs),
            Evaluator::Graph(form) => interpret(form, Part::Product, inputs, outputs),
        }
    }
}

/// Lists items in room on the stack: there are never more than fit.
pub(crate) fn listed<T>(room: &mut [T], items: impl IntoIterator<Item = T>) -> &mut [T] {
    let mut items = items.into_iter();
    let n = room.iter_mut().zip(items.by_ref()).map(|(place, item)| *place = item).count();
    debug_assert!(items.next().is_none(), "all items found room");
    &mut room[..n]
}

/// Runs a form's graph at every place.
fn interpret(form: &DensityForm, part: Part, arrays: &[&[f64]], outputs: &mut [&mut [f64]]) {
    let inputs = form.inputs(part);
    let places: FxHashMap<Input, usize> =
        inputs.into_iter().enumerate().map(|(k, input)| (input, k)).collect();
    let roots = form.roots(part);
    let mut interpreter = Interpreter::<f64>::new();
    for p in 0..arrays.first().map_or(0, |array| array.len()) {
        // Specialisation has put numbers in the place of all others.
        interpreter.run(&form.graph, |input| {
            places.get(&input).map_or(f64::NAN, |place| arrays[*place][p])
        });
        for (array, root) in outputs.iter_mut().zip(&roots) {
            array[p] = interpreter.number(*root);
        }
    }
}
