//! An energy of the deformation gradient over arrays, and the choice between its two forms.

use num_dual::HyperDual64;
use rustc_hash::FxHashMap;

use super::domain::VolumeDomain;
use super::principal::axes::{self, Axes, LANES};
use super::principal::witness::{Principal, Products};
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

/// Most numbers that principal stretches and axes are.
const AXES: usize = 24;

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
    /// Whether principal stretches and axes are found before machine code runs.
    has_axes: bool,
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

/// The inputs of the two programs of a form: `F` and `F - I`, for products also the direction, and
/// principal stretches and axes if the form has them.
fn inputs(form: &GradientForm, with_direction: bool) -> Vec<Input> {
    let dimension = form.dimension();
    let components = graph::components(dimension);
    let all = |input: fn(u8) -> Input| components.iter().copied().map(input);
    let direction = all(Input::Direction).filter(|_| with_direction);
    let axes = axes::inputs(dimension).filter(|_| form.has_axes);
    all(Input::Variable).chain(all(Input::VariableChange)).chain(direction).chain(axes).collect()
}

impl Evaluator {
    fn new(form: GradientForm, mode: Mode) -> Result<Evaluator, CompileError> {
        let Mode::Jit(level) = mode else { return Ok(Evaluator::Graph(form)) };
        let code = |roots: &[NodeId], counts: &[usize], with_direction: bool, level: Level| {
            let inputs = inputs(&form, with_direction);
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
            Evaluator::Graph(form) => interpret(form, false, sources, |p, read| {
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
            Evaluator::Graph(form) => interpret(form, true, sources, |p, read| {
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
    with_direction: bool,
    sources: &[&[f64]],
    mut at: impl FnMut(usize, &dyn Fn(NodeId) -> f64),
) {
    let places: FxHashMap<Input, usize> =
        inputs(form, with_direction).into_iter().enumerate().map(|(k, input)| (input, k)).collect();
    let mut interpreter = Interpreter::<f64>::new();
    for p in 0..sources[0].len() {
        // Specialisation has put numbers in the place of all others.
        interpreter.run(&form.graph, |input| {
            places.get(&input).map_or(f64::NAN, |place| sources[*place][p])
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
            let inputs = inputs(form, with_direction);
            let (graph, roots) = form.graph.extract(roots);
            let program = Program { graph: &graph, inputs: &inputs, roots: &roots };
            listings.push(Code::listing(program, level)?);
        }
    }
    Ok(listings)
}

impl GradientKernel {
    /// Compiles an energy; for [`Mode::HyperDual`] see [`Model::compile`].
    ///
    /// # Errors
    /// What the code generator reports.
    pub fn new(forms: GradientEnergyForms, mode: Mode) -> Result<GradientKernel, CompileError> {
        let dimension = forms.dimension;
        let has_axes = forms.far.has_axes;
        let far = Evaluator::new(forms.far, mode)?;
        let near = forms.near.map(|near| Evaluator::new(near, mode)).transpose()?;
        let body = Body::Forms(Box::new(far), near.map(Box::new));
        Ok(GradientKernel { dimension, has_axes, body, domain: VolumeDomain::default() })
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
        self.domain.restrict(self.dimension, at.gradient, psi);
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
        let mut axes = [[0.0; BLOCK]; AXES];
        for start in (0..at.n).step_by(BLOCK) {
            let block = start..at.n.min(start + BLOCK);
            let near = block.clone().map(|p| {
                has_near && (0..n_components).all(|k| at.change[k * at.n + p].abs() < NEAR)
            });
            let near: Vec<bool> = near.collect();
            if self.has_axes {
                self.find_axes(at, start, &near, &mut axes);
            }
            let mut sources: Vec<&[f64]> = Vec::with_capacity(3 * MOST + AXES);
            for array in arrays.iter().flatten() {
                for k in 0..n_components {
                    sources.push(&array[k * at.n + block.start..k * at.n + block.end]);
                }
            }
            if self.has_axes {
                let n_arrays = axes::inputs(self.dimension).count();
                sources.extend(axes[..n_arrays].iter().map(|array| &array[..near.len()]));
            }
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

impl GradientKernel {
    /// Principal stretches and axes of the places of a block, each by the way of its form.
    fn find_axes(
        &self,
        at: GradientBatch<'_>,
        start: usize,
        near: &[bool],
        arrays: &mut [[f64; BLOCK]; AXES],
    ) {
        let d = self.dimension;
        for first in (0..near.len()).step_by(LANES) {
            let group = first..near.len().min(first + LANES);
            let read = |source: &[f64]| {
                let mut tensor = [[0.0; LANES]; MOST];
                for (k, component) in graph::components(d).into_iter().enumerate() {
                    let from = k * at.n + start;
                    tensor[usize::from(component)][..group.len()]
                        .copy_from_slice(&source[from + group.start..from + group.end]);
                }
                tensor
            };
            for way in [false, true].into_iter().filter(|way| near[group.clone()].contains(way)) {
                let found = match way {
                    true => Axes::near(d, &read(at.change)),
                    false => Axes::far(d, &read(at.gradient)),
                };
                let chosen: [bool; LANES] =
                    std::array::from_fn(|k| near.get(first + k).is_some_and(|near| *near == way));
                found.write(d, &chosen[..group.len()], first, arrays);
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
    /// The functions of a principal stretch whose traces it holds.
    traces: Vec<(ExprGraph, NodeId)>,
    values: Values,
}

impl WrittenGradientEnergy {
    /// The energy over any number type; components by [`graph::component`].
    pub fn psi<N: Principal>(&self, component: impl Fn(u8) -> N) -> N {
        let traces = self.traces(&component);
        let mut interpreter = Interpreter::new();
        interpreter.run(&self.graph, |input| match input {
            Input::Variable(k) => component(k),
            Input::Trace(k) => traces[usize::from(k)].clone(),
            _ => self.known(input),
        });
        let terms = self.roots.iter().map(|root| interpreter.number(*root));
        terms.reduce(|sum, term| N::binary(Operator::Add, sum, term)).unwrap_or(N::constant(0.0))
    }

    /// The traces of functions of `U`.
    fn traces<N: Principal>(&self, component: &impl Fn(u8) -> N) -> Vec<N> {
        if self.traces.is_empty() {
            return Vec::new();
        }
        let d = self.values.dimension;
        let mut gradient = vec![N::constant(0.0); MOST];
        for k in graph::components(d) {
            gradient[usize::from(k)] = component(k);
        }
        let products = Products::new(d, &gradient);
        let of = |(graph, root): &(ExprGraph, NodeId)| {
            products.trace(&|stretch: N| {
                let mut interpreter = Interpreter::new();
                interpreter.run(graph, |input| match input {
                    Input::Stretch(_) => stretch.clone(),
                    _ => self.known(input),
                });
                interpreter.number(*root)
            })
        };
        self.traces.iter().map(of).collect()
    }

    /// The checker makes no other inputs for energies of the deformation gradient.
    fn known<N: Number>(&self, input: Input) -> N {
        N::constant(match input {
            Input::Parameter(i) => self.values.parameters[usize::from(i)],
            Input::Horizon => self.values.horizon,
            _ => f64::NAN,
        })
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
    /// Compiles the energy of the deformation gradient, if there is one and something is left of it;
    /// gives back what is left out.
    pub(crate) fn compile_gradient(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
        kernel: &mut Option<GradientKernel>,
    ) -> Result<Vec<Dropped>, CompileError> {
        let (forms, dropped) = self.specialise_gradient(values, form)?;
        let Some(forms) = forms else { return Ok(dropped) };
        let mut made = match mode {
            Mode::HyperDual => {
                let body = Body::Dual(self.written_gradient(values));
                let domain = VolumeDomain::default();
                GradientKernel { dimension: values.dimension, has_axes: false, body, domain }
            }
            _ => GradientKernel::new(forms, mode)?,
        };
        made.domain = self.variant(values.dimension).map(VolumeDomain::of).unwrap_or_default();
        *kernel = Some(made);
        Ok(dropped)
    }

    /// The energy of the deformation gradient as written, for these values; 0 where there is none.
    pub fn written_gradient(&self, values: &Values) -> WrittenGradientEnergy {
        let Some(variant) = self.variant(values.dimension) else {
            let (graph, values) = (ExprGraph::new(), values.clone());
            return WrittenGradientEnergy { graph, roots: Vec::new(), traces: Vec::new(), values };
        };
        let roots: Vec<NodeId> = variant.gradient_energies.iter().map(|e| e.root).collect();
        let (graph, roots) = variant.graph.extract(&roots);
        let function = |root: &NodeId| {
            let (graph, roots) = variant.graph.extract(&[*root]);
            (graph, roots[0])
        };
        let traces = variant.traces.iter().map(function).collect();
        WrittenGradientEnergy { graph, roots, traces, values: values.clone() }
    }
}
