//! What points gather of vectors, and energies of it, as kernels.
//!
//! Before: a model with values. After: integrands, functions of integrals and energies of bonds as functions of
//! `xi - Xi` and of what both ends gather. The length of a bond follows from its vector, so that one set of
//! variables is left; what it changes by keeps its digits.

use super::family::{FamilyKernel, Slot, WrittenFamily};
use super::{argument, energies};
use crate::clique::Part;
use crate::coupled::form::{accurate, substituted};
use crate::density::DensityForm;
use crate::expression::{ExprGraph, Function, Input, Node, NodeId, TooManyNodes};
use crate::kernel::Mode;
use crate::measure::Measure;
use crate::model::{Model, Variant};
use crate::point::adjoint::{self, Varied};
use crate::point::near::near_of_vanishing;
use crate::simplify::Simplifier;
use crate::specialise::{
    CompileError, Dropped, Form, Known, Named, folded, substituted_into, sum_in,
};
use crate::values::Values;
use crate::written::Written;

/// All that a potential gathers of vectors, and the energies of it, compiled.
#[derive(Debug)]
pub struct VectorKernels {
    /// How many numbers points gather, integrals and functions of them, in the order in which they are written.
    pub n_gathered: usize,
    /// `sum_k A_k g_k` of the integrands.
    pub integrands: FamilyKernel,
    /// `sum_k A_k s_k` of the functions of integrals.
    pub functions: Option<FamilyKernel>,
    /// The energy of points in J/m^3.
    pub points: Option<FamilyKernel>,
    /// The energy of bonds in J/m^(d+3): of each as its two ends see it.
    pub bonds: Option<FamilyKernel>,
}

impl VectorKernels {
    /// Whether energies couple what both ends of a bond gather, and so points over three horizons.
    pub fn has_neighbours(&self) -> bool {
        self.bonds.as_ref().is_some_and(FamilyKernel::has_neighbours)
    }
}

/// Which of the functions of a potential of vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Which {
    Integrands,
    Functions,
    Points,
    Bonds,
}

/// One number with its derivatives, before it is compiled.
pub(crate) struct Made {
    pub(crate) form: DensityForm,
    pub(crate) variables: Vec<Slot>,
    pub(crate) given: Vec<Slot>,
}

/// The numbers of the integrals, or of the functions of them.
fn numbers(variant: &Variant, functions: bool) -> Vec<usize> {
    let all = 0..variant.integrals.len();
    all.filter(|k| variant.integrals[*k].is_function == functions).collect()
}

/// Which of what points gather changes with displacements.
fn changing(variant: &Variant) -> Vec<bool> {
    let mut changes: Vec<bool> = Vec::new();
    for integral in &variant.integrals {
        let needed = variant.graph.reachable(&[integral.root]);
        let moves = |(id, node): (NodeId, Node)| {
            needed[id.0 as usize]
                && match node {
                    Node::Input(Input::Current(_) | Input::Part(_)) => true,
                    Node::Input(Input::Integral(k)) => changes[usize::from(k)],
                    _ => false,
                }
        };
        let is_changing = variant.graph.nodes().any(moves);
        changes.push(is_changing);
    }
    changes
}

impl Model {
    /// Compiles integrals of vectors and the energies of them, if something is left of these; gives back what is
    /// left out.
    pub(crate) fn compile_vectors(
        &self,
        values: &Values,
        (mode, form): (Mode, Form),
        kernels: &mut Option<VectorKernels>,
    ) -> Result<Vec<Dropped>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let (points, mut all_dropped) = self.specialise_vectors(values, Which::Points, form)?;
        let (bonds, dropped) = self.specialise_vectors(values, Which::Bonds, form)?;
        all_dropped.extend(dropped);
        if points.is_none() && bonds.is_none() {
            return Ok(all_dropped);
        }
        let compiled = |made: Made, which| {
            let written = self.written_vectors(values, which);
            FamilyKernel::new(made.form, mode, (made.variables, made.given), written)
        };
        let points = points.map(|made| compiled(made, Which::Points)).transpose()?;
        let bonds = bonds.map(|made| compiled(made, Which::Bonds)).transpose()?;
        let of = |which| match self.specialise_vectors(values, which, form)?.0 {
            Some(made) => compiled(made, which).map(Some),
            None => Ok(None),
        };
        if let (Some(integrands), functions) = (of(Which::Integrands)?, of(Which::Functions)?) {
            let n_gathered = variant.integrals.len();
            *kernels = Some(VectorKernels { n_gathered, integrands, functions, points, bonds });
        }
        Ok(all_dropped)
    }

    /// Energies of gathered values as those of the vectors of bonds, for whoever needs derivatives by these: where
    /// integrands see `Xi`, a displacement changes them by more than the lengths that it changes. Nothing where
    /// parameters leave none.
    ///
    /// # Errors
    /// As for [`Model::compile`].
    pub fn compile_as_vectors(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Option<VectorKernels>, CompileError> {
        let mut kernels = None;
        self.compile_vectors(values, (mode, form), &mut kernels)?;
        Ok(kernels)
    }

    /// One of the functions of a potential of vectors for these values, if something is left of it; and what is
    /// left out.
    fn specialise_vectors(
        &self,
        values: &Values,
        which: Which,
        form: Form,
    ) -> Result<(Option<Made>, Vec<Dropped>), CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        self.function_of_vectors((variant, which), Known(Some(values)), form)
    }

    /// Its form, if something is left of it.
    pub(crate) fn form_of_vectors(
        &self,
        (variant, which): (&Variant, Which),
        values: &Values,
        form: Form,
    ) -> Option<DensityForm> {
        let made = self.function_of_vectors((variant, which), Known(Some(values)), form);
        made.ok()?.0.map(|made| made.form)
    }

    /// The same of a variant, with parameters as symbols where there are no values.
    pub(super) fn function_of_vectors(
        &self,
        (variant, which): (&Variant, Which),
        known: Known<'_>,
        form: Form,
    ) -> Result<(Option<Made>, Vec<Dropped>), CompileError> {
        let of_energies = argument(variant, which == Which::Bonds);
        let (argument, span, roots) = match which {
            Which::Points | Which::Bonds => {
                let own = || energies(variant, which == Which::Bonds);
                let span = own().next().map(|energy| energy.span);
                (&*of_energies, span, own().map(|one| one.root).collect())
            }
            Which::Integrands | Which::Functions => {
                let own = numbers(variant, which == Which::Functions);
                let span = own.first().map(|k| variant.integrals[*k].span);
                let roots = own.iter().map(|k| variant.integrals[*k].root);
                ("integral", span, roots.collect::<Vec<NodeId>>())
            }
        };
        let Some(span) = span else { return Ok((None, Vec::new())) };
        let named = Named { argument, span };
        named.has_horizon(&variant.graph, &roots, known.lacks_horizon())?;
        let mut dropped = Vec::new();
        let made = match which {
            Which::Points | Which::Bonds => {
                let subject = (argument, &*roots);
                self.energy_of_vectors(variant, known, (which, subject), form, &mut dropped)
            }
            Which::Integrands | Which::Functions => {
                self.multiplied(variant, known, which, form).map(Some)
            }
        };
        let made = named.made(made)?;
        made.as_ref().map_or(Ok(()), |made| named.fits(&made.form.graph))?;
        Ok((made, dropped))
    }

    /// The energy of points, or of bonds.
    fn energy_of_vectors(
        &self,
        variant: &Variant,
        known: Known<'_>,
        (which, subject): (Which, (&str, &[NodeId])),
        form: Form,
        dropped: &mut Vec<Dropped>,
    ) -> Result<Option<Made>, TooManyNodes> {
        let (exact, fold) = (Simplifier::exact(), known.fold());
        let sum = sum_in(exact, &variant.graph, &self.parameters, subject, &fold, dropped)?;
        let is_of_bonds = which == Which::Bonds;
        sum.map(|sum| self.of_vectors((variant, is_of_bonds), known, sum, form)).transpose()
    }

    /// A function of what points gather, of bonds or of points, with its derivatives.
    pub(super) fn of_vectors(
        &self,
        (variant, is_of_bonds): (&Variant, bool),
        known: Known<'_>,
        (exact, root): (Simplifier, NodeId),
        form: Form,
    ) -> Result<Made, TooManyNodes> {
        let fold = known.fold();
        let (graph, place) = folded(exact.graph(), &[root])?;
        let roots = vec![place[root.0 as usize]];
        let (graph, roots) = self.digits((variant, &fold), graph, roots, form)?;
        let changes = changing(variant);
        let of = (variant.dimension, known);
        self.made((graph, roots[0]), of, is_of_bonds, |slot| match slot {
            Slot::Own(k) | Slot::Neighbour(k) => changes[k],
            _ => false,
        })
    }

    /// All integrands, or all functions of integrals, times their multipliers.
    fn multiplied(
        &self,
        variant: &Variant,
        known: Known<'_>,
        which: Which,
        form: Form,
    ) -> Result<Made, TooManyNodes> {
        let (mut graph, fold) = (Simplifier::new(), known.fold());
        let own = numbers(variant, which == Which::Functions);
        let mut roots: Vec<NodeId> = Vec::new();
        for k in &own {
            let subject = ("integral", std::slice::from_ref(&variant.integrals[*k].root));
            let (exact, mut nothing) = (Simplifier::exact(), Vec::new());
            let sum =
                sum_in(exact, &variant.graph, &self.parameters, subject, &fold, &mut nothing)?;
            // Functions hold others before them, written out.
            let before = |input: Input| {
                let own = own.iter().position(|k| Input::Integral(*k as u8) == input);
                own.and_then(|place| roots.get(place).copied())
            };
            let root = match sum {
                Some((exact, root)) => {
                    substituted_into(&mut graph, exact.graph(), &[root], before)?[root.0 as usize]
                }
                None => graph.number(0.0)?,
            };
            roots.push(root);
        }
        let (mut graph, roots) = self.digits((variant, &fold), graph, roots, form)?;
        let mut sum: Option<NodeId> = None;
        for (k, root) in own.iter().zip(roots) {
            let multiplier = graph.input(Input::Multiplier(*k as u8))?;
            let term = graph.multiply(multiplier, root)?;
            sum = Some(sum.map_or(Ok(term), |sum| graph.add(sum, term))?);
        }
        let sum = sum.map_or_else(|| graph.number(0.0), Ok)?;
        let changes = changing(variant);
        let is_of_bonds = which == Which::Integrands;
        self.made((graph, sum), (variant.dimension, known), is_of_bonds, |slot| match slot {
            Slot::Own(k) => changes[k],
            _ => true,
        })
    }

    /// The roots in the form that keeps digits, where that is wanted: first those of lengths, then of all that is 0 at
    /// rest, what has moved and what is gathered of that.
    fn digits(
        &self,
        (variant, fold): (&Variant, &impl Fn(Input) -> Option<f64>),
        graph: Simplifier,
        roots: Vec<NodeId>,
        form: Form,
    ) -> Result<(Simplifier, Vec<NodeId>), TooManyNodes> {
        if form == Form::Textbook {
            return Ok((graph, roots));
        }
        let (graph, roots) = accurate(graph, roots, Measure::Length, &[])?;
        let vanishing = self.vanishing(variant, fold)?;
        let moved = (0..variant.dimension as u8).map(|axis| Input::Part(Part::Moved(axis)));
        let of_neighbours = vanishing.iter().map(|input| match input {
            Input::Integral(k) => Input::Neighbour(*k),
            other => *other,
        });
        let own = vanishing.iter().copied().chain(of_neighbours);
        let all: Vec<Input> = moved.chain([Input::Change(Measure::Length)]).chain(own).collect();
        let mut target = Simplifier::new();
        let near = |root: NodeId| {
            near_of_vanishing(&mut target, graph.graph(), root, &all).map(|(root, _)| root)
        };
        let roots = roots.into_iter().map(near).collect::<Result<Vec<NodeId>, TooManyNodes>>()?;
        Ok((target, roots))
    }

    /// A root with its derivatives. Of bonds all components of the vector are variables.
    fn made(
        &self,
        (graph, root): (Simplifier, NodeId),
        (dimension, known): (usize, Known<'_>),
        is_of_bonds: bool,
        varies: impl Fn(Slot) -> bool,
    ) -> Result<Made, TooManyNodes> {
        let bond = Bond { first: self.parameters().len() as u16, dimension, known };
        let (mut graph, roots) = substituted(&graph, &[root], |graph, input| match input {
            Input::Current(Measure::Length) => bond.length(graph),
            Input::Change(Measure::Length) => bond.change(graph),
            other => graph.input(other),
        })?;
        let held = held(graph.graph(), roots[0]);
        let (varying, steady): (Vec<Slot>, Vec<Slot>) = held.into_iter().partition(|s| varies(*s));
        let moved = (0..dimension).filter(|_| is_of_bonds).map(Slot::Moved);
        let variables: Vec<Slot> = moved.chain(varying).collect();
        let length = is_of_bonds.then_some(Slot::Length);
        let mut given: Vec<Slot> = length.into_iter().chain(steady).collect();
        if variables.is_empty() && given.is_empty() {
            // A program has one array at least, which says how many places there are.
            given.push(Slot::Own(0));
        }
        let inputs: Vec<Input> = variables.iter().map(|slot| slot.input()).collect();
        let varied = Varied::Inputs(&inputs);
        let gradient = adjoint::gradient(&mut graph, roots[0], varied)?;
        let product = adjoint::product(&mut graph, &gradient, varied)?;
        let (graph, roots) = graph.graph().extract(&[roots, gradient, product].concat());
        let directions = (0..variables.len() as u8).map(Input::Direction);
        let given_inputs = given.iter().map(|slot| slot.input());
        let inputs = inputs.iter().copied().chain(given_inputs).chain(directions).collect();
        let form = DensityForm::new(graph, &roots, inputs, known.fields());
        Ok(Made { form, variables, given })
    }

    /// One of the functions of a potential of vectors as written.
    pub(crate) fn written_vectors(&self, values: &Values, which: Which) -> WrittenFamily {
        let first_direction = self.parameters().len() as u16;
        let nothing = || WrittenFamily {
            terms: Written::nothing(values),
            multipliers: Vec::new(),
            first_direction,
            functions: Vec::new(),
        };
        let Some(variant) = self.variant(values.dimension) else { return nothing() };
        let written = |roots: &[NodeId]| Written::new(&variant.graph, roots, values);
        let of = |numbers: &[usize]| -> Vec<NodeId> {
            numbers.iter().map(|k| variant.integrals[*k].root).collect()
        };
        match which {
            Which::Points | Which::Bonds => {
                let energies = energies(variant, which == Which::Bonds);
                let roots: Vec<NodeId> = energies.map(|one| one.root).collect();
                let multipliers = vec![None; roots.len()];
                WrittenFamily { terms: written(&roots), multipliers, ..nothing() }
            }
            Which::Integrands | Which::Functions => {
                let own = numbers(variant, which == Which::Functions);
                let multipliers = own.iter().map(|k| Some(*k)).collect();
                let functions = own.iter().filter(|_| which == Which::Functions);
                let functions = functions.map(|k| (*k, written(&of(&[*k])))).collect();
                WrittenFamily { terms: written(&of(&own)), multipliers, functions, ..nothing() }
            }
        }
    }
}

/// What a root holds of what ends gather and of multipliers, in their order.
fn held(graph: &ExprGraph, root: NodeId) -> Vec<Slot> {
    let needed = graph.reachable(&[root]);
    let mut inputs: Vec<Input> = graph
        .nodes()
        .filter(|(id, _)| needed[id.0 as usize])
        .filter_map(|(_, node)| match node {
            Node::Input(input) => Some(input),
            _ => None,
        })
        .collect();
    inputs.sort_unstable();
    let slot = |input: Input| match input {
        Input::Integral(k) => Some(Slot::Own(usize::from(k))),
        Input::Neighbour(k) => Some(Slot::Neighbour(usize::from(k))),
        Input::Multiplier(k) => Some(Slot::Multiplier(usize::from(k))),
        _ => None,
    };
    inputs.into_iter().filter_map(slot).collect()
}

/// The vector of a bond, by the number of the first component of its direction at rest.
struct Bond<'a> {
    first: u16,
    dimension: usize,
    known: Known<'a>,
}

impl Bond<'_> {
    /// Components of `Xi` and of `xi - Xi`.
    fn components(&self, graph: &mut Simplifier) -> Result<Vec<[NodeId; 2]>, TooManyNodes> {
        let length = graph.input(Input::Reference(Measure::Length))?;
        let component = |axis: usize| {
            let unit = Input::Parameter(self.first + axis as u16);
            let unit = match self.known.fold()(unit) {
                Some(value) => graph.number(value)?,
                None => graph.input(unit)?,
            };
            let rest = graph.multiply(unit, length)?;
            Ok([rest, graph.input(Input::Part(Part::Moved(axis as u8)))?])
        };
        (0..self.dimension).map(component).collect()
    }

    /// `l`, the root of the squares of `Xi + (xi - Xi)`.
    fn length(&self, graph: &mut Simplifier) -> Result<NodeId, TooManyNodes> {
        let mut sum: Option<NodeId> = None;
        for [rest, moved] in self.components(graph)? {
            let now = graph.add(rest, moved)?;
            let square = graph.multiply(now, now)?;
            sum = Some(sum.map_or(Ok(square), |sum| graph.add(sum, square))?);
        }
        let sum = sum.map_or_else(|| graph.number(0.0), Ok)?;
        graph.unary(Function::Sqrt, sum)
    }

    /// `(l - L)/L = (xi - Xi).(2 Xi + (xi - Xi))/(L (l + L))`
    fn change(&self, graph: &mut Simplifier) -> Result<NodeId, TooManyNodes> {
        let mut sum: Option<NodeId> = None;
        for [rest, moved] in self.components(graph)? {
            let two = graph.number(2.0)?;
            let twice = graph.multiply(two, rest)?;
            let both = graph.add(twice, moved)?;
            let term = graph.multiply(moved, both)?;
            sum = Some(sum.map_or(Ok(term), |sum| graph.add(sum, term))?);
        }
        let sum = sum.map_or_else(|| graph.number(0.0), Ok)?;
        let (now, rest) = (self.length(graph)?, graph.input(Input::Reference(Measure::Length))?);
        let lengths = graph.add(now, rest)?;
        let below = graph.multiply(rest, lengths)?;
        graph.divide(sum, below)
    }
}
