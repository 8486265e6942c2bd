//! An energy of the deformation gradient over arrays, and the choice between its two forms.

use num_dual::HyperDual64;

use super::domain::VolumeDomain;
use super::{GradientEnergyForms, GradientForm};
use crate::expression::graph;
use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::{ExprGraph, Input, NodeId, Operator};
use crate::jit::{Code, Listing, isa};
use crate::kernel::{Level, Mode};
use crate::model::Model;
use crate::program::Program;
use crate::specialise::{CompileError, Dropped, Form};
use crate::values::Values;

/// Below this `max |F - I|` the form in `F - I` is evaluated.
pub const NEAR: f64 = 0.25;

/// Places that are looked at together for the choice of the form.
const BLOCK: usize = 32;

/// Most components of a tensor.
const MOST: usize = 9;

/// Deformation gradients of `n` places, component by component: entry `k*n + p` of an array is
/// component `k`, row by row, at place `p`.
#[derive(Clone, Copy, Debug)]
pub struct GradientBatch<'a> {
    /// How many places there are.
    pub n: usize,
    /// `F`
    pub gradient: &'a [f64],
    /// `F - I`, as the runtime computes it from displacements.
    pub change: &'a [f64],
}

/// psi, P and dP of an energy of the deformation gradient.
#[derive(Debug)]
pub struct GradientKernel {
    dimension: usize,
    body: Body,
    domain: VolumeDomain,
}

#[derive(Debug)]
enum Body {
    /// Far from rest and near it.
    Forms(Box<Evaluator>, Option<Box<Evaluator>>),
    Dual(WrittenGradientEnergy),
}

/// One form: psi with P, and dP, compiled; or both interpreted.
#[derive(Debug)]
enum Evaluator {
    Code(Box<[Code; 2]>),
    Graph(GradientForm),
}

/// The inputs of the two programs of a form: `F` and `F - I`, and for products also the direction.
fn inputs(dimension: usize, with_direction: bool) -> Vec<Input> {
    let components = graph::components(dimension);
    let all = |input: fn(u8) -> Input| components.iter().copied().map(input);
    let direction = all(Input::Direction).filter(|_| with_direction);
    all(Input::Variable).chain(all(Input::VariableChange)).chain(direction).collect()
}

impl Evaluator {
    fn new(form: GradientForm, dimension: usize, mode: Mode) -> Result<Evaluator, CompileError> {
        let Mode::Jit(level) = mode else { return Ok(Evaluator::Graph(form)) };
        let code = |roots: &[NodeId], counts: &[usize], with_direction: bool, level: Level| {
            let inputs = inputs(dimension, with_direction);
            let (graph, roots) = form.graph.extract(roots);
            let program = Program { graph: &graph, inputs: &inputs, roots: &roots };
            Code::new(program, counts, level, isa(true)?)
        };
        let roots: Vec<NodeId> = [form.psi].iter().chain(&form.stress).copied().collect();
        let value = code(&roots, &[1, roots.len()], false, level)?;
        let product = code(&form.product, &[form.product.len()], true, level)?;
        Ok(Evaluator::Code(Box::new([value, product])))
    }

    /// psi and, unless there is no room for it, P.
    fn evaluate(&self, sources: &[&[f64]], psi: &mut [f64], stress: &mut [&mut [f64]]) {
        match self {
            Evaluator::Code(codes) => {
                let function = usize::from(!stress.is_empty());
                let mut outputs: Vec<&mut [f64]> = Vec::with_capacity(1 + MOST);
                outputs.push(psi);
                outputs.extend(stress.iter_mut().map(|array| &mut **array));
                codes[0].run(function, sources, &mut outputs);
            }
            Evaluator::Graph(form) => interpret(form, sources, |p, read| {
                psi[p] = read(form.psi);
                for (array, root) in stress.iter_mut().zip(&form.stress) {
                    array[p] = read(*root);
                }
            }),
        }
    }

    fn product(&self, sources: &[&[f64]], product: &mut [&mut [f64]]) {
        match self {
            Evaluator::Code(codes) => codes[1].run(0, sources, product),
            Evaluator::Graph(form) => interpret(form, sources, |p, read| {
                for (array, root) in product.iter_mut().zip(&form.product) {
                    array[p] = read(*root);
                }
            }),
        }
    }
}

/// Runs a form's graph at every place.
fn interpret(
    form: &GradientForm,
    sources: &[&[f64]],
    mut at: impl FnMut(usize, &dyn Fn(NodeId) -> f64),
) {
    let n_components = form.stress.len();
    let order = graph::components(if n_components == 4 { 2 } else { 3 });
    let place = |k: u8| order.iter().position(|known| *known == k).unwrap_or(0);
    let mut interpreter = Interpreter::<f64>::new();
    for p in 0..sources[0].len() {
        interpreter.run(&form.graph, |input| match input {
            Input::Variable(k) => sources[place(k)][p],
            Input::VariableChange(k) => sources[n_components + place(k)][p],
            Input::Direction(k) => {
                sources.get(2 * n_components + place(k)).map_or(f64::NAN, |array| array[p])
            }
            // Specialisation has put numbers in the place of all others.
            _ => f64::NAN,
        });
        at(p, &|root| interpreter.number(root));
    }
}

/// The intermediate form and the machine instructions of both programs of the form as written, and of
/// those near rest.
///
/// # Errors
/// What the code generator reports.
pub fn gradient_listing(
    forms: &GradientEnergyForms,
    level: Level,
) -> Result<Vec<Listing>, CompileError> {
    let mut listings = Vec::new();
    for form in [Some(&forms.far), forms.near.as_ref()].into_iter().flatten() {
        let value: Vec<NodeId> = [form.psi].iter().chain(&form.stress).copied().collect();
        for (roots, with_direction) in [(&value, false), (&form.product, true)] {
            let inputs = inputs(forms.dimension, with_direction);
            let (graph, roots) = form.graph.extract(roots);
            let program = Program { graph: &graph, inputs: &inputs, roots: &roots };
            listings.push(Code::listing(program, level)?);
        }
    }
    Ok(listings)
}

impl GradientKernel {
    /// Compiles an energy; for [`Mode::HyperDual`] see [`Model::compile_gradient`].
    ///
    /// # Errors
    /// What the code generator reports.
    pub fn new(forms: GradientEnergyForms, mode: Mode) -> Result<GradientKernel, CompileError> {
        let dimension = forms.dimension;
        let far = Evaluator::new(forms.far, dimension, mode)?;
        let near = forms.near.map(|near| Evaluator::new(near, dimension, mode)).transpose()?;
        let body = Body::Forms(Box::new(far), near.map(Box::new));
        Ok(GradientKernel { dimension, body, domain: VolumeDomain::default() })
    }

    /// 2 or 3.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Whether the declared domain holds a gradient, row by row.
    pub(crate) fn admits(&self, gradient: &[f64]) -> bool {
        self.domain.contains(gradient)
    }

    /// psi in J/m^3 and, unless `stress` is empty, P in Pa; psi is no number outside the declared
    /// domain.
    ///
    /// # Panics
    /// If an array does not have the length of its kind: a mistake of the caller, not of a user.
    pub fn evaluate(&self, at: GradientBatch<'_>, psi: &mut [f64], stress: &mut [f64]) {
        let n_components = self.dimension * self.dimension;
        let fits = |array: &[f64]| array.len() == n_components * at.n;
        assert!(fits(at.gradient) && fits(at.change) && psi.len() == at.n, "one entry per place");
        assert!(stress.is_empty() || fits(stress), "one stress per place");
        match &self.body {
            Body::Dual(energy) => energy.evaluate(at, psi, stress),
            Body::Forms(far, near) => {
                let mut stress = split(stress, at.n);
                let outputs =
                    [&mut *psi].into_iter().chain(stress.iter_mut().map(|array| &mut **array));
                let mut outputs: Vec<&mut [f64]> = outputs.collect();
                self.in_blocks(at, near.is_some(), None, &mut outputs, |is_near, sources, out| {
                    let (psi, stress) = out.split_first_mut().expect("psi is first");
                    pick(far, near, is_near).evaluate(sources, psi, stress);
                });
            }
        }
        self.domain.restrict(self.dimension, at, psi);
    }

    /// dP in Pa for directions dF.
    ///
    /// # Panics
    /// As for [`Self::evaluate`].
    pub fn product(&self, at: GradientBatch<'_>, direction: &[f64], product: &mut [f64]) {
        let n_components = self.dimension * self.dimension;
        let fits = |array: &[f64]| array.len() == n_components * at.n;
        assert!(fits(at.gradient) && fits(at.change), "one gradient per place");
        assert!(fits(direction) && fits(product), "one direction and one product per place");
        match &self.body {
            Body::Dual(energy) => energy.product(at, direction, product),
            Body::Forms(far, near) => {
                let mut outputs = split(product, at.n);
                let has_near = near.is_some();
                self.in_blocks(
                    at,
                    has_near,
                    Some(direction),
                    &mut outputs,
                    |is_near, sources, out| {
                        pick(far, near, is_near).product(sources, out);
                    },
                );
            }
        }
    }

    /// Evaluates block by block: one form where all places of a block ask for it, both where they
    /// differ. The result of a place never depends on the places beside it.
    fn in_blocks(
        &self,
        at: GradientBatch<'_>,
        has_near: bool,
        direction: Option<&[f64]>,
        outputs: &mut [&mut [f64]],
        evaluate: impl Fn(bool, &[&[f64]], &mut [&mut [f64]]),
    ) {
        let n_components = self.dimension * self.dimension;
        let arrays = [Some(at.gradient), Some(at.change), direction];
        let mut room = [[0.0; BLOCK]; 1 + MOST];
        for start in (0..at.n).step_by(BLOCK) {
            let block = start..at.n.min(start + BLOCK);
            let mut sources: Vec<&[f64]> = Vec::with_capacity(3 * MOST);
            for array in arrays.iter().flatten() {
                for k in 0..n_components {
                    sources.push(&array[k * at.n + block.start..k * at.n + block.end]);
                }
            }
            let near = block.clone().map(|p| {
                has_near && (0..n_components).all(|k| at.change[k * at.n + p].abs() < NEAR)
            });
            let near: Vec<bool> = near.collect();
            let some_near = near.contains(&true);
            let mut targets: Vec<&mut [f64]> =
                outputs.iter_mut().map(|array| &mut array[block.clone()]).collect();
            evaluate(some_near, &sources, &mut targets);
            if some_near && near.contains(&false) {
                let mut others: Vec<&mut [f64]> =
                    room[..targets.len()].iter_mut().map(|row| &mut row[..near.len()]).collect();
                evaluate(false, &sources, &mut others);
                for (target, other) in targets.iter_mut().zip(&others) {
                    for p in (0..near.len()).filter(|p| !near[*p]) {
                        target[p] = other[p];
                    }
                }
            }
        }
    }
}

fn pick<'a>(far: &'a Evaluator, near: &'a Option<Box<Evaluator>>, is_near: bool) -> &'a Evaluator {
    near.as_deref().filter(|_| is_near).unwrap_or(far)
}

/// The components of an array, one after the other.
fn split(array: &mut [f64], n: usize) -> Vec<&mut [f64]> {
    array.chunks_mut(n.max(1)).collect()
}

/// The energy of the deformation gradient exactly as written: not simplified, parameters not folded.
///
/// Independent of everything that happens after the check, and so the witness for it.
#[derive(Clone, Debug)]
pub struct WrittenGradientEnergy {
    graph: ExprGraph,
    roots: Vec<NodeId>,
    values: Values,
}

impl WrittenGradientEnergy {
    /// The energy over any number type; components by [`graph::component`].
    pub fn psi<N: Number>(&self, component: impl Fn(u8) -> N) -> N {
        let mut interpreter = Interpreter::new();
        interpreter.run(&self.graph, |input| match input {
            Input::Variable(k) => component(k),
            Input::Parameter(i) => N::constant(self.values.parameters[usize::from(i)]),
            Input::Horizon => N::constant(self.values.horizon),
            // The checker makes no other inputs for energies of the deformation gradient.
            _ => N::constant(f64::NAN),
        });
        let terms = self.roots.iter().map(|root| interpreter.number(*root));
        terms.reduce(|sum, term| N::binary(Operator::Add, sum, term)).unwrap_or(N::constant(0.0))
    }

    fn evaluate(&self, at: GradientBatch<'_>, psi: &mut [f64], stress: &mut [f64]) {
        if stress.is_empty() {
            let components = graph::components(self.values.dimension);
            for (p, psi) in psi.iter_mut().enumerate() {
                let place = |c| components.iter().position(|known| *known == c).unwrap_or(0);
                *psi = self.psi(|c| HyperDual64::from_re(at.gradient[place(c) * at.n + p])).re;
            }
            return;
        }
        self.every_place(at, None, |p, k, value| {
            psi[p] = value.re;
            stress[k * at.n + p] = value.eps1;
        });
    }

    fn product(&self, at: GradientBatch<'_>, direction: &[f64], product: &mut [f64]) {
        self.every_place(at, Some(direction), |p, k, value| {
            product[k * at.n + p] = value.eps1eps2;
        });
    }

    /// One evaluation over hyper-dual numbers for each component at each place: the first part varies
    /// the component, the second goes along the direction.
    fn every_place(
        &self,
        at: GradientBatch<'_>,
        direction: Option<&[f64]>,
        mut take: impl FnMut(usize, usize, HyperDual64),
    ) {
        let components = graph::components(self.values.dimension);
        for p in 0..at.n {
            for (k, &varied) in components.iter().enumerate() {
                let value = self.psi(|c| {
                    let place = components.iter().position(|known| *known == c).unwrap_or(0);
                    let along = direction.map_or(0.0, |direction| direction[place * at.n + p]);
                    let own = f64::from(u8::from(c == varied));
                    HyperDual64::new(at.gradient[place * at.n + p], own, along, 0.0)
                });
                take(p, k, value);
            }
        }
    }
}

impl Model {
    /// The energy of the deformation gradient for these values, if there is one and something is left
    /// of it; and what is left out. Hyper-dual numbers always take the energy as written.
    ///
    /// # Errors
    /// An energy that is too large, or a horizon that is needed and not given.
    pub fn compile_gradient(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<(Option<GradientKernel>, Vec<Dropped>), CompileError> {
        let (forms, dropped) = self.specialise_gradient(values, form)?;
        let Some(forms) = forms else { return Ok((None, dropped)) };
        let mut kernel = match mode {
            Mode::HyperDual => {
                let body = Body::Dual(self.written_gradient(values));
                let domain = VolumeDomain::default();
                GradientKernel { dimension: values.dimension, body, domain }
            }
            _ => GradientKernel::new(forms, mode)?,
        };
        kernel.domain = self.variant(values.dimension).map(VolumeDomain::of).unwrap_or_default();
        Ok((Some(kernel), dropped))
    }

    /// The energy of the deformation gradient as written, for these values; 0 where there is none.
    pub fn written_gradient(&self, values: &Values) -> WrittenGradientEnergy {
        let (graph, roots) = match self.variant(values.dimension) {
            Some(variant) => {
                let roots: Vec<NodeId> = variant.gradient_energies.iter().map(|e| e.root).collect();
                variant.graph.extract(&roots)
            }
            None => (ExprGraph::new(), Vec::new()),
        };
        WrittenGradientEnergy { graph, roots, values: values.clone() }
    }
}
