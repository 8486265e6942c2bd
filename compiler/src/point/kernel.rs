//! An energy of the deformation gradient over arrays, and the choice between its two forms.

use std::iter::once;
use std::ops::Range;

use num_dual::HyperDual64;

use super::domain::Domain;
use super::principal::axes::{self, Axes, LANES};
use super::principal::witness::{Principal, Products};
use super::turned::{self, TurnedBack};
use super::{GradientEnergyForms, MOST};
use crate::density::{Evaluator, listed};
use crate::expression::{Input, NodeId, graph};
use crate::jit::Listing;
use crate::kernel::{Level, Mode};
use crate::model::{Model, Variant};
use crate::specialise::{CompileError, Dropped, Form};
use crate::values::{MAX_FIELDS, Values};
use crate::written::{Dual, Written};

/// Below this `max |F - I|` the form in `F - I` is evaluated, where it keeps its digits as far.
pub const NEAR: f64 = 0.25;

/// Places that are looked at together for the choice of the form.
pub(super) const BLOCK: usize = 32;

/// Most numbers that principal stretches and axes are.
const AXES: usize = 24;

/// Most arrays of a program: `F`, `F - I`, a direction, the axes and fields.
const SOURCES: usize = 3 * MOST + AXES + MAX_FIELDS;

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
    /// Parameters that are fields, laid out alike, in SI units ([`GradientKernel::fields`]); nothing
    /// where the kernel takes none.
    pub fields: &'a [f64],
}

/// psi, P and dP of an energy of the deformation gradient.
#[derive(Debug)]
pub struct GradientKernel {
    dimension: usize,
    /// How many arrays of principal stretches and axes are found before machine code runs.
    n_axes: usize,
    /// Typical values of fields.
    fields: Vec<f64>,
    body: Body,
    domain: Domain,
    /// Below this `max |F - I|` the form near rest is evaluated.
    reach: f64,
    /// Whether bodies that are turned are turned back: the energy sees no rotation, and has a form near rest.
    turns_back: bool,
    /// Whether they are for products as well, in which roots lose more than directions that are turned.
    turns_products: bool,
    /// Whether the energy itself depends on the fields, and not a bounded quantity alone.
    body_has_fields: bool,
}

#[derive(Debug)]
enum Body {
    /// Far from rest and near it.
    Forms(Box<Evaluator>, Option<Box<Evaluator>>),
    Dual(WrittenGradientEnergy),
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
        listings.extend(form.listings(level)?);
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
        let n_axes = if forms.far.has_axes() { axes::inputs(dimension).count() } else { 0 };
        let n_fields = forms.far.n_fields();
        let far = Evaluator::new(forms.far, mode)?;
        let near = forms.near.map(|near| Evaluator::new(near, mode)).transpose()?;
        let body = Body::Forms(Box::new(far), near.map(Box::new));
        let fields = vec![f64::NAN; n_fields];
        let made = GradientKernel::made(dimension, n_axes, fields, body);
        Ok(GradientKernel { reach: forms.reach, ..made })
    }

    /// The kernel of an energy without a declared domain.
    fn made(dimension: usize, n_axes: usize, fields: Vec<f64>, body: Body) -> GradientKernel {
        let (domain, body_has_fields) = (Domain::default(), !fields.is_empty());
        let (turns_back, turns_products) = (false, false);
        GradientKernel {
            dimension,
            n_axes,
            fields,
            body,
            domain,
            reach: NEAR,
            turns_back,
            turns_products,
            body_has_fields,
        }
    }

    /// The kernel of a function of these values, which as written is a witness.
    pub(super) fn of(
        forms: GradientEnergyForms,
        values: &Values,
        mode: Mode,
        written: impl FnOnce() -> WrittenGradientEnergy,
    ) -> Result<GradientKernel, CompileError> {
        let mut made = match mode {
            Mode::HyperDual => {
                let fields = vec![f64::NAN; forms.far.n_fields()];
                GradientKernel::made(values.dimension, 0, fields, Body::Dual(written()))
            }
            _ => {
                let (has_near, has_roots) = (forms.near.is_some(), forms.has_roots);
                let mut made = GradientKernel::new(forms, mode)?;
                made.turns_back = has_near && turned::is_blind(&written(), values.dimension);
                made.turns_products = made.turns_back && has_roots;
                made
            }
        };
        made.fields.iter_mut().zip(values.typical()).for_each(|(own, (_, value))| *own = value);
        Ok(made)
    }

    /// Typical values of the parameters that are fields, in the order of [`Values::fields`]: the kernel
    /// takes the values of each at every place. Nothing where it depends on none.
    pub fn fields(&self) -> &[f64] {
        &self.fields
    }

    /// 2 or 3.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Evaluates the form near rest below this `max |F - I|`.
    pub(super) fn set_reach(&mut self, reach: f64) {
        self.reach = reach;
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
        assert!(at.fields.len() == self.fields.len() * at.n, "fields at each place");
        assert!(stress.is_empty() || fits(stress), "one stress per place");
        let of_body = self.of_body(at);
        match &self.body {
            Body::Dual(energy) => energy.dual(of_body).evaluate(psi, stress),
            Body::Forms(far, near) => {
                let mut room: [&mut [f64]; 1 + MOST] = Default::default();
                let outputs = once(&mut *psi).chain(stress.chunks_mut(at.n.max(1)));
                let outputs = listed(&mut room, outputs);
                self.in_blocks(of_body, near.is_some(), &[], outputs, |is_near, sources, out| {
                    pick(far, near, is_near).evaluate(sources, out);
                });
            }
        }
        self.domain.restrict(self.dimension, at, psi);
    }

    /// What the energy itself takes of a batch.
    fn of_body<'a>(&self, at: GradientBatch<'a>) -> GradientBatch<'a> {
        GradientBatch { fields: if self.body_has_fields { at.fields } else { &[] }, ..at }
    }

    /// dP in Pa for directions dF.
    ///
    /// # Panics
    /// As for [`Self::evaluate`].
    pub fn product(&self, at: GradientBatch<'_>, direction: &[f64], product: &mut [f64]) {
        let n_components = self.dimension * self.dimension;
        let fits = |array: &[f64]| array.len() == n_components * at.n;
        assert!(fits(at.gradient) && fits(at.change), "one gradient per place");
        assert!(at.fields.len() == self.fields.len() * at.n, "fields at each place");
        assert!(fits(direction) && fits(product), "one direction and one product per place");
        let at = self.of_body(at);
        match &self.body {
            Body::Dual(energy) => energy.dual(at).product(direction, product),
            Body::Forms(far, near) => {
                let mut room: [&mut [f64]; MOST] = Default::default();
                let outputs = listed(&mut room, product.chunks_mut(at.n.max(1)));
                self.in_blocks(at, near.is_some(), direction, outputs, |is_near, sources, out| {
                    pick(far, near, is_near).product(sources, out);
                });
            }
        }
    }

    /// Evaluates block by block, bodies turned back where they gain by it. The result of a place
    /// never depends on the places beside it. The direction is empty where none is given.
    fn in_blocks(
        &self,
        at: GradientBatch<'_>,
        has_near: bool,
        direction: &[f64],
        outputs: &mut [&mut [f64]],
        evaluate: impl Fn(bool, &[&[f64]], &mut [&mut [f64]]),
    ) {
        let n_components = self.dimension * self.dimension;
        let (mut axes, mut back) = ([[0.0; BLOCK]; AXES], None::<Box<TurnedBack>>);
        for start in (0..at.n).step_by(BLOCK) {
            let block = start..at.n.min(start + BLOCK);
            let mut near = [false; BLOCK];
            let near = &mut near[..block.len()];
            near.fill(has_near);
            for component in in_block(at.change, at.n, &block) {
                near.iter_mut().zip(component).for_each(|(near, h)| *near &= h.abs() < self.reach);
            }
            let mut arrays: [&mut [f64]; 1 + MOST] = Default::default();
            let targets = outputs.iter_mut().map(|array| &mut array[block.clone()]);
            let targets = listed(&mut arrays, targets);
            let fields = in_block(at.fields, at.n, &block);
            let mut marks = [false; BLOCK];
            let marks = &mut marks[..block.len()];
            let turns = if direction.is_empty() { self.turns_back } else { self.turns_products };
            let some_turned = turns && turned::mark(self.dimension, at, start, marks);
            if !some_turned {
                let given = [at.gradient, at.change, direction].into_iter();
                let given = given.flat_map(|array| in_block(array, at.n, &block));
                let mut room = [&[][..]; 3 * MOST];
                let given = listed(&mut room, given);
                self.block(near, (given, fields), &mut axes, targets, &evaluate);
                continue;
            }
            let back =
                back.get_or_insert_with(|| Box::new(TurnedBack::new(self.dimension, self.reach)));
            back.take(at, start, marks, direction);
            near.iter_mut().zip(back.marked()).for_each(|(near, mark)| *near |= mark);
            let mut room = [&[][..]; 3 * MOST];
            let given = listed(&mut room, back.components(!direction.is_empty()));
            self.block(near, (given, fields), &mut axes, targets, &evaluate);
            if let Some(first) = targets.len().checked_sub(n_components) {
                back.turn(&mut targets[first..]);
            }
        }
    }

    /// Evaluates a block: one form where all its places ask for it, both where they differ. Given are `F`, `F - I` and
    /// the direction.
    fn block<'a>(
        &self,
        near: &[bool],
        (given, fields): (&[&'a [f64]], impl Iterator<Item = &'a [f64]>),
        axes: &'a mut [[f64; BLOCK]; AXES],
        targets: &mut [&mut [f64]],
        evaluate: impl Fn(bool, &[&[f64]], &mut [&mut [f64]]),
    ) {
        if self.n_axes > 0 {
            self.find_axes(given, near, axes);
        }
        let axes = axes[..self.n_axes].iter().map(|array| &array[..near.len()]);
        let mut arrays = [&[][..]; SOURCES];
        let sources = listed(&mut arrays, given.iter().copied().chain(axes).chain(fields));
        let some_near = near.contains(&true);
        evaluate(some_near, sources, targets);
        if some_near && near.contains(&false) {
            let mut room = [[0.0; BLOCK]; 1 + MOST];
            let mut arrays: [&mut [f64]; 1 + MOST] = Default::default();
            let others = room[..targets.len()].iter_mut().map(|row| &mut row[..near.len()]);
            let others = listed(&mut arrays, others);
            evaluate(false, sources, others);
            for (target, other) in targets.iter_mut().zip(&*others) {
                for p in (0..near.len()).filter(|p| !near[*p]) {
                    target[p] = other[p];
                }
            }
        }
    }
}

impl GradientKernel {
    /// Principal stretches and axes of the places of a block, each by the way of its form.
    fn find_axes(&self, given: &[&[f64]], near: &[bool], arrays: &mut [[f64; BLOCK]; AXES]) {
        let d = self.dimension;
        let (gradient, change) = given.split_at(d * d);
        for first in (0..near.len()).step_by(LANES) {
            let group = first..near.len().min(first + LANES);
            let read = |source: &[&[f64]]| {
                let mut tensor = [[0.0; LANES]; MOST];
                for k in 0..d * d {
                    let component = graph::component(k / d, k % d);
                    tensor[usize::from(component)][..group.len()]
                        .copy_from_slice(&source[k][group.clone()]);
                }
                tensor
            };
            for way in [false, true].into_iter().filter(|way| near[group.clone()].contains(way)) {
                let found = match way {
                    true => Axes::near(d, &read(change)),
                    false => Axes::far(d, &read(gradient)),
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

/// The components of an array at the places of a block, one after the other.
fn in_block<'a>(
    array: &'a [f64],
    n: usize,
    block: &Range<usize>,
) -> impl Iterator<Item = &'a [f64]> + use<'a> {
    let block = block.clone();
    array.chunks(n.max(1)).map(move |component| &component[block.clone()])
}

/// The energy of the deformation gradient exactly as written: not simplified, parameters not folded.
///
/// Independent of everything that happens after the check, and so the witness for it.
#[derive(Clone, Debug)]
pub struct WrittenGradientEnergy {
    energy: Written,
    /// The functions of a principal stretch whose traces it holds.
    traces: Vec<Written>,
}

impl WrittenGradientEnergy {
    /// The sum of functions of the deformation gradient, for these values.
    pub(super) fn new(variant: &Variant, roots: &[NodeId], values: &Values) -> Self {
        let written = |roots: &[NodeId]| Written::new(&variant.graph, roots, values);
        let traces = variant.traces.iter().map(|root| written(&[*root])).collect();
        WrittenGradientEnergy { energy: written(roots), traces }
    }

    /// The energy over any number type; components by [`graph::component`].
    pub fn psi<N: Principal>(&self, component: impl Fn(u8) -> N) -> N {
        self.psi_with(component, None::<&fn(usize) -> f64>)
    }

    /// The same with the values of fields, by their places among them; else they have typical ones.
    pub(super) fn psi_with<N: Principal>(
        &self,
        component: impl Fn(u8) -> N,
        field: Option<&impl Fn(usize) -> f64>,
    ) -> N {
        let traces = self.traces(&component, field);
        self.energy.sum(|input| match input {
            Input::Variable(k) => component(k),
            Input::Trace(k) => traces[usize::from(k)].clone(),
            _ => self.energy.known(input, field),
        })
    }

    /// The traces of functions of `U`.
    fn traces<N: Principal>(
        &self,
        component: &impl Fn(u8) -> N,
        field: Option<&impl Fn(usize) -> f64>,
    ) -> Vec<N> {
        if self.traces.is_empty() {
            return Vec::new();
        }
        let d = self.energy.dimension();
        let mut gradient = vec![N::constant(0.0); MOST];
        for k in graph::components(d) {
            gradient[usize::from(k)] = component(k);
        }
        let products = Products::new(d, &gradient);
        let of = |function: &Written| {
            products.trace(&|stretch: N| {
                function.sum(|input| match input {
                    Input::Stretch(_) => stretch.clone(),
                    _ => function.known(input, field),
                })
            })
        };
        self.traces.iter().map(of).collect()
    }

    /// Its derivatives by hyper-dual numbers at every place.
    fn dual<'a>(
        &'a self,
        at: GradientBatch<'a>,
    ) -> Dual<'a, impl Fn(usize, &dyn Fn(usize) -> HyperDual64) -> HyperDual64> {
        let components = graph::components(self.energy.dimension());
        let psi = move |p: usize, variable: &dyn Fn(usize) -> HyperDual64| {
            let place = |c| components.iter().position(|known| *known == c).unwrap_or(0);
            let field = |k: usize| at.fields[k * at.n + p];
            let field = (!at.fields.is_empty()).then_some(&field);
            self.psi_with(|c| variable(place(c)), field)
        };
        Dual { n: at.n, variables: at.gradient, psi }
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
        let mut made = GradientKernel::of(forms, values, mode, || self.written_gradient(values))?;
        if let Some(variant) = self.variant(values.dimension) {
            made.domain = Domain::of(self, variant, values, (mode, form))?;
            if made.fields.is_empty() {
                made.fields = made.domain.fields().to_vec();
            }
        }
        *kernel = Some(made);
        Ok(dropped)
    }

    /// The energy of the deformation gradient as written, for these values; 0 where there is none.
    pub fn written_gradient(&self, values: &Values) -> WrittenGradientEnergy {
        let Some(variant) = self.variant(values.dimension) else {
            return WrittenGradientEnergy { energy: Written::nothing(values), traces: Vec::new() };
        };
        let roots: Vec<NodeId> = variant.gradient_energies.iter().map(|e| e.root).collect();
        WrittenGradientEnergy::new(variant, &roots, values)
    }
}
