//! Parameter values folded in: what is known becomes a number, what is zero disappears.
//!
//! Before: a model. After: one simplified energy per measure, with psi' and psi'' beside it, whose
//! only inputs are the measure, its reference and their relative change.

mod modelled;

use piola_grammar::Span;

use crate::differentiate::differentiate;
use crate::expression::graph::MAX_NODES;
use crate::expression::interpret::Interpreter;
use crate::expression::number::Number;
use crate::expression::{ExprGraph, Input, Node, NodeId, TooManyNodes};
use crate::measure::Measure;
use crate::model::{Model, Parameter, Variant};
use crate::near;
use crate::rewrite::{Applied, expand, rewrite};
use crate::simplify::Simplifier;
use crate::values::Values;
use modelled::{Rebuild, reasons};

/// Most operations of a kernel: compile time grows faster than linearly beyond.
pub const MAX_OPERATIONS: usize = 4096;

/// psi, psi' and psi'' of one measure as one graph, whose inputs are the measure and, where parameters
/// are fields, those.
#[derive(Clone, Debug)]
pub struct ScalarEnergy {
    /// What it is a function of.
    pub measure: Measure,
    /// Only what the three roots need.
    pub graph: ExprGraph,
    /// psi, psi', psi''.
    pub roots: [NodeId; 3],
    /// The parameters that are fields, with typical values: all of [`Values::fields`], or none where the
    /// energy depends on none.
    pub fields: Vec<(u16, f64)>,
}

/// In which form an energy is evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Form {
    /// Rewritten so that it keeps its digits; see [`mod@crate::rewrite`].
    #[default]
    Accurate,
    /// Simplified and differentiated as it was written, to compare with.
    Textbook,
}

impl ScalarEnergy {
    /// Evaluates every node at a measure, its value at rest and the relative change between them, with the
    /// typical values of fields.
    pub fn run<N: Number>(
        &self,
        interpreter: &mut Interpreter<N>,
        measure: &N,
        reference: &N,
        change: &N,
    ) {
        let typical = |of: u16| self.fields.iter().find(|(field, _)| *field == of);
        self.run_with(interpreter, [measure, reference, change], |of| {
            typical(of).map_or(f64::NAN, |(_, value)| *value)
        });
    }

    /// The same with the values of fields, by the number of the parameter.
    pub(crate) fn run_with<N: Number>(
        &self,
        interpreter: &mut Interpreter<N>,
        [measure, reference, change]: [&N; 3],
        field: impl Fn(u16) -> f64,
    ) {
        interpreter.run(&self.graph, |input| match input {
            Input::Current(_) => measure.clone(),
            Input::Reference(_) => reference.clone(),
            Input::Change(_) => change.clone(),
            Input::Parameter(i) => N::constant(field(i)),
            // Specialisation has put numbers in the place of other parameters and the horizon; a measure
            // knows nothing of the deformation gradient, nor of families.
            _ => N::constant(f64::NAN),
        });
    }
}

/// A term of an energy that is left out because its coefficient is exactly zero.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dropped {
    /// What it is a function of: `l`, `a`, `v`, `F` or what is gathered, `theta`, `l, m`.
    pub argument: String,
    /// Why it is left out, in a sentence.
    pub reason: String,
}

/// An energy that cannot be compiled.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CompileError {
    /// The graph or the kernel would be too large.
    #[error("psi({argument}) needs more than {limit} operations")]
    TooLarge {
        /// Which energy: `l`, `a`, `v`, `F` or what is gathered.
        argument: String,
        /// Where it stands.
        span: Span,
        /// The limit that is passed.
        limit: usize,
    },
    /// The potential is not defined in this many dimensions.
    #[error("the potential is not defined in {0} dimensions")]
    WrongDimension(usize),
    /// The energy depends on the horizon, and none is given.
    #[error("psi({argument}) depends on the horizon `delta`, which has no value")]
    NoHorizon {
        /// Which energy: `l`, `a`, `v`, `F` or what is gathered.
        argument: String,
        /// Where it stands.
        span: Span,
    },
    /// Machine code could not be made.
    #[error("the code generator failed: {0}")]
    Backend(String),
}

/// Energies with values folded in, and what was left out.
#[derive(Clone, Debug, Default)]
pub struct Specialised {
    /// At most one per measure, ascending.
    pub energies: Vec<ScalarEnergy>,
    /// What is not modelled, and why.
    pub dropped: Vec<Dropped>,
}

impl Model {
    /// The energies for these values.
    ///
    /// # Errors
    /// An energy that needs too many operations, or the horizon where none is given.
    pub fn specialise(&self, values: &Values) -> Result<Specialised, CompileError> {
        self.specialise_as(values, Form::Accurate)
    }

    /// The same in a chosen form.
    ///
    /// # Errors
    /// As for [`Self::specialise`].
    pub fn specialise_as(&self, values: &Values, form: Form) -> Result<Specialised, CompileError> {
        let mut energies = Vec::new();
        let dropped = self.derive(values, form, |_, energy| energies.push(energy))?;
        Ok(Specialised { energies, dropped })
    }

    /// Hands over psi, psi' and psi'' of every measure, in the graph they were made in and alone; gives
    /// back what is left out.
    pub(crate) fn derive(
        &self,
        values: &Values,
        form: Form,
        mut take: impl FnMut(Derived, ScalarEnergy),
    ) -> Result<Vec<Dropped>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let fold = known(values);
        let mut all_dropped = Vec::new();
        for measure in self.measures() {
            if measure == Measure::Volume && values.dimension == 2 {
                all_dropped.push(Dropped {
                    argument: measure.symbol().to_string(),
                    reason: "psi(v) is dropped: there are no tetrahedra in two dimensions".into(),
                });
                continue;
            }
            let named = Named { argument: measure.symbol(), span: span_of(variant, measure) };
            let roots = roots_of(variant, measure);
            named.has_horizon(&variant.graph, &roots, values.horizon.is_nan())?;
            let mut dropped = Vec::new();
            let derived = energy(variant, &self.parameters, measure, &fold, &mut dropped).and_then(
                |energy| {
                    let derive = |energy: SimpleEnergy| energy.of(values).derivatives(form);
                    energy.map(derive).transpose()
                },
            );
            if let Some(derived) = named.made(derived)? {
                let energy = derived.scalar_energy();
                named.fits(&energy.graph)?;
                take(derived, energy);
            }
            all_dropped.extend(dropped);
        }
        Ok(all_dropped)
    }

    /// The energies with parameters left as symbols, as `derive` prints them.
    ///
    /// # Errors
    /// An energy that needs too many operations.
    pub fn symbolic(&self, dimension: usize) -> Result<Specialised, CompileError> {
        let variant = self.variant(dimension).ok_or(CompileError::WrongDimension(dimension))?;
        let mut result = Specialised::default();
        for measure in self.measures() {
            let named = Named { argument: measure.symbol(), span: span_of(variant, measure) };
            let energy = energy(variant, &self.parameters, measure, &|_| None, &mut result.dropped)
                .and_then(|energy| energy.map(|e| e.derivatives(Form::Textbook)).transpose());
            let energy = named.made(energy)?;
            result.energies.extend(energy.map(|derived| derived.scalar_energy()));
        }
        Ok(result)
    }
}

/// An energy as errors name it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Named<'a> {
    /// What it is a function of.
    pub(crate) argument: &'a str,
    /// Where it stands.
    pub(crate) span: Span,
}

impl Named<'_> {
    /// Refuses roots that depend on the horizon where that is missing.
    pub(crate) fn has_horizon(
        self,
        graph: &ExprGraph,
        roots: &[NodeId],
        is_missing: bool,
    ) -> Result<(), CompileError> {
        if is_missing && graph.depends_on(roots, Input::Horizon) {
            let argument = self.argument.to_string();
            return Err(CompileError::NoHorizon { argument, span: self.span });
        }
        Ok(())
    }

    /// What was made, unless it had too many nodes on the way.
    pub(crate) fn made<T>(self, made: Result<T, TooManyNodes>) -> Result<T, CompileError> {
        made.map_err(|TooManyNodes| self.too_large(MAX_NODES))
    }

    /// Refuses a graph with too many operations for a kernel.
    pub(crate) fn fits(self, graph: &ExprGraph) -> Result<(), CompileError> {
        if graph.len() > MAX_OPERATIONS { Err(self.too_large(MAX_OPERATIONS)) } else { Ok(()) }
    }

    fn too_large(self, limit: usize) -> CompileError {
        CompileError::TooLarge { argument: self.argument.to_string(), span: self.span, limit }
    }
}

/// What is known of the inputs once values are there: fields stay inputs.
pub(crate) fn known(values: &Values) -> impl Fn(Input) -> Option<f64> {
    |input| match input {
        Input::Parameter(i) if values.fields.contains(&i) => None,
        Input::Parameter(i) => values.parameter(i),
        Input::Horizon => Some(values.horizon),
        _ => None,
    }
}

/// Values, or none for whoever leaves parameters and the horizon as symbols.
#[derive(Clone, Copy)]
pub(crate) struct Known<'a>(pub(crate) Option<&'a Values>);

impl<'a> Known<'a> {
    /// What is known of inputs.
    pub(crate) fn fold(self) -> impl Fn(Input) -> Option<f64> + Copy + 'a {
        move |input| self.0.and_then(|values| known(values)(input))
    }

    /// Whether values are given, and no horizon among them.
    pub(crate) fn lacks_horizon(self) -> bool {
        self.0.is_some_and(|values| values.horizon.is_nan())
    }

    /// The numbers of what varies.
    pub(crate) fn fields(self) -> &'a [u16] {
        self.0.map_or(&[], |values| &values.fields)
    }
}

fn span_of(variant: &Variant, measure: Measure) -> Span {
    let energy = variant.energies.iter().find(|e| e.measure == measure);
    energy.map_or(Span::default(), |e| e.span)
}

pub(crate) fn roots_of(variant: &Variant, measure: Measure) -> Vec<NodeId> {
    variant.energies.iter().filter(|e| e.measure == measure).map(|e| e.root).collect()
}

/// The simplified energy of a measure, with all digits of its numbers: see [`Simplifier::exact`].
pub(crate) struct SimpleEnergy {
    pub(crate) measure: Measure,
    pub(crate) graph: Simplifier,
    pub(crate) psi: NodeId,
    /// A typical measure at rest, of few digits.
    reference: f64,
    /// Fields with typical values.
    fields: Vec<(u16, f64)>,
}

/// Some half of the horizon, or of 1 m where it is not known, to the power of the measure.
fn typical_reference(measure: Measure, fold: &impl Fn(Input) -> Option<f64>) -> f64 {
    let horizon = fold(Input::Horizon).filter(|horizon| horizon.is_normal() && *horizon > 0.0);
    let exponent = horizon.map_or(0, |horizon| i64::from(libm::ilogb(horizon)) - 1);
    let exponent = (exponent * measure.length_exponent()).clamp(-300, 300);
    libm::ldexp(0.625, exponent as i32)
}

/// psi, psi' and psi'' in one graph, with what led to their form.
pub(crate) struct Derived {
    pub(crate) measure: Measure,
    pub(crate) graph: Simplifier,
    pub(crate) roots: [NodeId; 3],
    pub(crate) applied: Vec<Applied>,
    /// The same as written, with all digits of its numbers; nothing in the textbook form.
    pub(crate) exact: Option<near::Energy>,
    /// Fields with typical values.
    fields: Vec<(u16, f64)>,
}

impl SimpleEnergy {
    /// The same with what these values say of fields.
    pub(crate) fn of(self, values: &Values) -> SimpleEnergy {
        SimpleEnergy { fields: values.typical().collect(), ..self }
    }

    pub(crate) fn derivatives(self, form: Form) -> Result<Derived, TooManyNodes> {
        let SimpleEnergy { measure, graph: exact, psi: written, reference, fields } = self;
        let (mut graph, place) = folded(exact.graph(), &[written])?;
        let plain = place[written.0 as usize];
        let mut psi = plain;
        let mut applied = Vec::new();
        if form == Form::Textbook {
            let dpsi = differentiate(&mut graph, psi, measure)?;
            let d2psi = differentiate(&mut graph, dpsi, measure)?;
            let roots = [psi, dpsi, d2psi];
            return Ok(Derived { measure, graph, roots, applied, exact: None, fields });
        }
        psi = rewrite(&mut graph, psi, measure, &mut applied)?;
        // A derivative may be a difference of its own: 1 - L/l of a logarithmic barrier.
        let dpsi = differentiate(&mut graph, psi, measure)?;
        let dpsi = rewrite(&mut graph, dpsi, measure, &mut applied)?;
        let d2psi = differentiate(&mut graph, dpsi, measure)?;
        let d2psi = rewrite(&mut graph, d2psi, measure, &mut applied)?;
        let roots = expand(&mut graph, &[psi, dpsi, d2psi], measure, &mut applied)?;
        let roots = [roots[0], roots[1], roots[2]];
        let Ok(exact) = near::Energy::new(exact, written, (measure, reference), &fields) else {
            return Ok(Derived { measure, graph, roots, applied, exact: None, fields });
        };
        // What has no room for a second form keeps the first.
        let roots = near::kept(&mut graph, roots, plain, &exact, &mut applied).unwrap_or(roots);
        Ok(Derived { measure, graph, roots, applied, exact: Some(exact), fields })
    }
}

/// The same graph with its numbers worked out, and the places of its nodes.
pub(crate) fn folded(
    exact: &ExprGraph,
    roots: &[NodeId],
) -> Result<(Simplifier, Vec<NodeId>), TooManyNodes> {
    let mut graph = Simplifier::new();
    let place = folded_into(&mut graph, exact, roots)?;
    Ok((graph, place))
}

/// The same in a graph that is given: the places of nodes there.
pub(crate) fn folded_into(
    graph: &mut Simplifier,
    exact: &ExprGraph,
    roots: &[NodeId],
) -> Result<Vec<NodeId>, TooManyNodes> {
    substituted_into(graph, exact, roots, |_| None)
}

/// The same with nodes of the graph that is given in the place of some inputs.
pub(crate) fn substituted_into(
    graph: &mut Simplifier,
    exact: &ExprGraph,
    roots: &[NodeId],
    instead: impl Fn(Input) -> Option<NodeId>,
) -> Result<Vec<NodeId>, TooManyNodes> {
    let needed = exact.reachable(roots);
    let mut place = vec![NodeId(0); exact.len()];
    for (id, node) in exact.nodes().filter(|(id, _)| needed[id.0 as usize]) {
        let other = match node {
            Node::Input(input) => instead(input),
            _ => None,
        };
        place[id.0 as usize] = match other {
            Some(other) => other,
            None => graph.make(node.map_operands(|x| place[x.0 as usize]))?,
        };
    }
    Ok(place)
}

impl Derived {
    pub(crate) fn scalar_energy(&self) -> ScalarEnergy {
        let (graph, roots) = self.graph.graph().extract(&self.roots);
        let roots = [roots[0], roots[1], roots[2]];
        let depends = |(i, _): &(u16, f64)| graph.depends_on(&roots, Input::Parameter(*i));
        let fields = if self.fields.iter().any(depends) { self.fields.clone() } else { Vec::new() };
        ScalarEnergy { measure: self.measure, graph, roots, fields }
    }
}

/// The sum of a measure's energies; `None` if nothing is left of it.
pub(crate) fn energy(
    variant: &Variant,
    parameters: &[Parameter],
    measure: Measure,
    fold: &impl Fn(Input) -> Option<f64>,
    dropped: &mut Vec<Dropped>,
) -> Result<Option<SimpleEnergy>, TooManyNodes> {
    let roots = roots_of(variant, measure);
    let subject = (measure.symbol(), roots.as_slice());
    let sum = sum_in(Simplifier::exact(), &variant.graph, parameters, subject, fold, dropped)?;
    let reference = typical_reference(measure, fold);
    let fields = Vec::new();
    Ok(sum.map(|(graph, psi)| SimpleEnergy { measure, graph, psi, reference, fields }))
}

/// A function of one interaction with its derivatives by the measure; what parameters make zero is 0.
pub(crate) fn of_measure(
    graph: &ExprGraph,
    parameters: &[Parameter],
    subject: (Measure, NodeId),
    values: &Values,
    form: Form,
) -> Result<ScalarEnergy, TooManyNodes> {
    let function = function_of(graph, parameters, subject, values)?;
    Ok(function.derivatives(form)?.scalar_energy())
}

/// The same with parameters as symbols, in the form as written.
pub(crate) fn symbolic_of(
    graph: &ExprGraph,
    parameters: &[Parameter],
    subject: (Measure, NodeId),
) -> Result<ScalarEnergy, TooManyNodes> {
    let function = made_of(graph, parameters, subject, &|_| None, Vec::new())?;
    Ok(function.derivatives(Form::Textbook)?.scalar_energy())
}

/// A function of one interaction in the place of an energy; what parameters make zero is 0.
pub(crate) fn function_of(
    graph: &ExprGraph,
    parameters: &[Parameter],
    (measure, root): (Measure, NodeId),
    values: &Values,
) -> Result<SimpleEnergy, TooManyNodes> {
    made_of(graph, parameters, (measure, root), &known(values), values.typical().collect())
}

fn made_of(
    graph: &ExprGraph,
    parameters: &[Parameter],
    (measure, root): (Measure, NodeId),
    fold: &impl Fn(Input) -> Option<f64>,
    fields: Vec<(u16, f64)>,
) -> Result<SimpleEnergy, TooManyNodes> {
    let subject = (measure.symbol(), std::slice::from_ref(&root));
    let made = sum_in(Simplifier::exact(), graph, parameters, subject, fold, &mut Vec::new())?;
    let (graph, psi) = or_zero(made)?;
    let reference = typical_reference(measure, fold);
    Ok(SimpleEnergy { measure, graph, psi, reference, fields })
}

/// A sum of which nothing may be left, as a function: then it is 0.
pub(crate) fn or_zero(
    made: Option<(Simplifier, NodeId)>,
) -> Result<(Simplifier, NodeId), TooManyNodes> {
    match made {
        Some(made) => Ok(made),
        None => {
            let mut graph = Simplifier::exact();
            let zero = graph.number(0.0)?;
            Ok((graph, zero))
        }
    }
}

/// The simplified sum of some energies of one argument, in a graph that is given; `None` if nothing is
/// left of it.
pub(crate) fn sum_in(
    target: Simplifier,
    graph: &ExprGraph,
    parameters: &[Parameter],
    (argument, roots): (&str, &[NodeId]),
    fold: &impl Fn(Input) -> Option<f64>,
    dropped: &mut Vec<Dropped>,
) -> Result<Option<(Simplifier, NodeId)>, TooManyNodes> {
    let mut rebuild = Rebuild::new(graph, fold, target);
    rebuild.nodes(roots)?;
    let mut total: Option<NodeId> = None;
    for &root in roots {
        if let Some(node) = rebuild.modelled(root)? {
            total = Some(match total {
                None => node,
                Some(sum) => rebuild.target.add(sum, node)?,
            });
        }
    }
    if !rebuild.dropped.is_empty() {
        let what = if total.is_some() { "a term of psi" } else { "psi" };
        let why = reasons(graph, parameters, &rebuild.dropped);
        let reason = format!("{what}({argument}) is dropped: {why}");
        dropped.push(Dropped { argument: argument.to_string(), reason });
    }
    Ok(total.map(|psi| (rebuild.target, psi)))
}
