//! The conditions under which bonds, triangles and tetrahedra break, and what they remember, compiled: a margin
//! and a next state are functions of one of them like an energy, so they are rewritten, differentiated and compiled by the same code,
//! and keep their digits near a threshold.

use crate::expression::NodeId;
use crate::kernel::{Kernel, Mode, WrittenEnergy};
use crate::measure::{Argument, Measure};
use crate::model::{Break, Model, Of, OfFamily, Update};
use crate::specialise::{
    CompileError, Derived, Form, MAX_OPERATIONS, Named, ScalarEnergy, function_of, of_measure,
    symbolic_of,
};
use crate::squares::square_of;
use crate::values::Values;
use crate::verify::Subject;

/// When a bond breaks, a triangle or a tetrahedron.
#[derive(Debug)]
pub struct Criterion {
    /// The margin, in the place of psi: what has its measure breaks where it is above 0.
    pub margin: Kernel,
    /// Whether it breaks where the margin is 0, too.
    pub holds_at_zero: bool,
    /// The condition as written, in canonical spelling.
    pub text: String,
    /// What it is, in the words of the file.
    pub reason: Option<String>,
}

impl Criterion {
    /// What it is a condition of: bonds, triangles or tetrahedra.
    pub fn measure(&self) -> Measure {
        self.margin.measure()
    }

    /// Whether one with this margin breaks.
    pub fn breaks(&self, margin: f64) -> bool {
        margin > 0.0 || self.holds_at_zero && margin == 0.0
    }
}

/// When bonds break by what families give: a kernel, and the same as written.
#[derive(Debug)]
pub struct FamilyCriterion<K, W> {
    /// The margin, in the place of psi: bonds break where it is above 0.
    pub margin: K,
    /// The same as written.
    pub written: W,
    /// Whether they break where the margin is 0, too.
    pub holds_at_zero: bool,
    /// The condition as written, in canonical spelling.
    pub text: String,
    /// What it is, in the words of the file.
    pub reason: Option<String>,
}

impl<K, W> FamilyCriterion<K, W> {
    pub(crate) fn new(condition: &Break<OfFamily>, margin: K, written: W) -> Self {
        let Break { holds_at_zero, text, reason, .. } = condition.clone();
        FamilyCriterion { margin, written, holds_at_zero, text, reason }
    }

    /// Whether something with this margin breaks.
    pub fn breaks(&self, margin: f64) -> bool {
        margin > 0.0 || self.holds_at_zero && margin == 0.0
    }
}

/// What a state becomes by what families give: a kernel, and the same as written.
#[derive(Debug)]
pub struct FamilyNextState<K, W> {
    /// The number of the state among the fields of the values ([`Values::fields`]).
    pub field: usize,
    /// The next value in SI units, in the place of psi.
    pub next: K,
    /// The same as written.
    pub written: W,
    /// The number of the state among the parameters.
    pub state: usize,
    /// The next value as written, in canonical spelling.
    pub text: String,
}

impl<K, W> FamilyNextState<K, W> {
    pub(crate) fn new(update: &Update<OfFamily>, values: &Values, next: K, written: W) -> Self {
        let field = values.fields.partition_point(|field| usize::from(*field) < update.state);
        FamilyNextState { field, next, written, state: update.state, text: update.text.clone() }
    }
}

/// A function of a bond, a triangle or a tetrahedron that is no energy: for those who print it.
#[derive(Clone, Debug)]
pub struct BondFunction {
    /// What it is.
    pub kind: BondFunctionKind,
    /// As written, in canonical spelling.
    pub text: String,
    /// The margin, the next value or what is dissipated in the place of psi.
    pub function: ScalarEnergy,
}

/// What a [`BondFunction`] says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BondFunctionKind {
    /// The margin of the condition of this number, from 1: the bond breaks where it is above 0, or also at
    /// 0.
    Margin {
        /// Which condition.
        number: usize,
        /// Whether the bond breaks at 0, too.
        holds_at_zero: bool,
    },
    /// What the state of this name becomes.
    Next(String),
    /// What bonds dissipate, with its derivatives by the rate.
    Dissipation,
}

/// What a state of a bond becomes, of a triangle or of a tetrahedron.
#[derive(Debug)]
pub struct NextState {
    /// The number of the state among the fields of the values ([`Values::fields`]).
    pub field: usize,
    /// The next value in SI units, in the place of psi. Its fields are those of the values, and behind them
    /// the time step in s where some update depends on it.
    pub next: Kernel,
    /// The next value as written, in canonical spelling.
    pub text: String,
}

impl NextState {
    /// Of which kind the state is: one of bonds, of triangles or of tetrahedra.
    pub fn measure(&self) -> Measure {
        self.next.measure()
    }
}

impl Model {
    /// Margins of conditions, what states become, then what is dissipated, as they are compiled for these
    /// values; with symbols for parameters where there are none.
    ///
    /// # Errors
    /// As [`Model::criteria`].
    pub fn bond_functions(
        &self,
        dimension: usize,
        values: Option<&Values>,
    ) -> Result<Vec<BondFunction>, CompileError> {
        let variant = self.variant(dimension).ok_or(CompileError::WrongDimension(dimension))?;
        let values = values.map(|own| own.clone().with_states(self));
        let in_time = values.clone().map(|own| own.with_time_step(self));
        let make = |(measure, root): (Measure, NodeId), span, values: &Option<Values>| {
            let named = Named { argument: measure.symbol(), span };
            let (graph, parameters) = (&variant.graph, self.parameters());
            named.made(match values {
                Some(values) => {
                    of_measure(graph, parameters, (measure, root), values, Form::Accurate)
                }
                None => symbolic_of(graph, parameters, (measure, root)),
            })
        };
        let margin = |(k, one): (usize, &Break<Measure>)| {
            let kind = BondFunctionKind::Margin { number: k + 1, holds_at_zero: one.holds_at_zero };
            let function = make((one.of, one.root), one.span, &values)?;
            Ok(BondFunction { kind, text: one.text.clone(), function })
        };
        let next = |one: &Update<Measure>| {
            let kind = BondFunctionKind::Next(self.input_name(one.state).to_string());
            let function = make((one.of, one.root), one.span, &in_time)?;
            Ok(BondFunction { kind, text: one.text.clone(), function })
        };
        let margins = variant.breaks.iter().enumerate().map(margin);
        let dissipation = self.dissipation_function(variant, values.as_ref()).transpose();
        margins.chain(variant.updates.iter().map(next)).chain(dissipation).collect()
    }

    /// When bonds, triangles and tetrahedra break, for these values: of each kind any one of these conditions
    /// is enough.
    ///
    /// # Errors
    /// A condition that is too large, or the horizon where none is given.
    pub fn criteria(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Vec<Criterion>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let criterion = |one: &Break<Measure>| {
            let (graph, root, subject) = (&variant.graph, one.root, (one.of, one.root));
            let named = Named { argument: one.of.symbol(), span: one.span };
            named.has_horizon(graph, &[root], values.horizon.is_nan())?;
            let made = named.made(of_measure(graph, self.parameters(), subject, values, form))?;
            named.fits(&made.graph)?;
            let written = || WrittenEnergy::of_root(graph, root, values);
            let mut margin = Kernel::new(made, (mode, form), written)?;
            if form == Form::Accurate && mode != Mode::HyperDual {
                let function = function_of(graph, self.parameters(), subject, values);
                let squared = function.and_then(|function| square_of(function, values)).ok();
                let squared = squared.flatten().filter(|made| made.graph.len() <= MAX_OPERATIONS);
                if let Some(squared) = squared {
                    margin = margin.with_squared(Kernel::new(squared, (mode, form), written)?);
                }
            }
            let (text, reason) = (one.text.clone(), one.reason.clone());
            Ok(Criterion { margin, holds_at_zero: one.holds_at_zero, text, reason })
        };
        variant.breaks.iter().map(criterion).collect()
    }

    /// What states become, for these values with states among the fields
    /// ([`Values::with_states`]). All of them are worked out from the states as they are, then they change
    /// at once.
    ///
    /// # Errors
    /// A next value that is too large, or the horizon where none is given.
    pub fn next_states(
        &self,
        values: &Values,
        mode: Mode,
        form: Form,
    ) -> Result<Vec<NextState>, CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let in_time = values.clone().with_states(self).with_time_step(self);
        let next = |one: &Update<Measure>| {
            let (graph, root) = (&variant.graph, one.root);
            let subject = (one.of, root);
            let named = Named { argument: subject.0.symbol(), span: one.span };
            named.has_horizon(graph, &[root], values.horizon.is_nan())?;
            let made = named.made(of_measure(graph, self.parameters(), subject, &in_time, form))?;
            named.fits(&made.graph)?;
            let written = || WrittenEnergy::of_root(graph, root, &in_time);
            let next = Kernel::new(made, (mode, form), written)?;
            let field = in_time.fields.partition_point(|field| usize::from(*field) < one.state);
            Ok(NextState { field, next, text: one.text.clone() })
        };
        variant.updates.iter().map(next).collect()
    }

    /// Hands over margins, then next states, with their derivatives in the graph they were made in, and as
    /// written: with everything held but the measure, states as the values say and the time step 1 s.
    pub(crate) fn derive_functions(
        &self,
        values: &Values,
        form: Form,
        mut take: impl FnMut(Subject, Derived, WrittenEnergy) -> Result<(), CompileError>,
    ) -> Result<(), CompileError> {
        let variant =
            self.variant(values.dimension).ok_or(CompileError::WrongDimension(values.dimension))?;
        let mut values = values.without_fields();
        if let Some(dt) = self.time_step() {
            values.parameters[usize::from(dt)] = 1.0;
        }
        let margin = |one: &Break<Measure>| {
            let subject = Subject::Margin(Some(Argument::Measure(one.of)), one.text.clone());
            (subject, (one.of, one.root), one.span)
        };
        let next = |one: &Update<Measure>| {
            let text = format!("{} = {}", self.input_name(one.state), one.text);
            (Subject::NextState(Of::Measure(one.of), text), (one.of, one.root), one.span)
        };
        let all = variant.breaks.iter().map(margin).chain(variant.updates.iter().map(next));
        for (subject, (measure, root), span) in all {
            // There are no tetrahedra in the plane.
            if measure.points() > values.dimension + 1 {
                continue;
            }
            let named = Named { argument: measure.symbol(), span };
            named.has_horizon(&variant.graph, &[root], values.horizon.is_nan())?;
            let function = function_of(&variant.graph, self.parameters(), (measure, root), &values);
            let derived = named.made(function.and_then(|function| function.derivatives(form)))?;
            named.fits(&derived.scalar_energy().graph)?;
            take(subject, derived, WrittenEnergy::of_root(&variant.graph, root, &values))?;
        }
        Ok(())
    }

    /// What states become as written, for these values, with the time step behind their fields.
    pub fn written_next_states(&self, values: &Values) -> Vec<WrittenEnergy> {
        let Some(variant) = self.variant(values.dimension) else { return Vec::new() };
        let in_time = values.clone().with_states(self).with_time_step(self);
        let next =
            |one: &Update<Measure>| WrittenEnergy::of_root(&variant.graph, one.root, &in_time);
        variant.updates.iter().map(next).collect()
    }

    /// The margins as written, for these values.
    pub fn written_margins(&self, values: &Values) -> Vec<WrittenEnergy> {
        let Some(variant) = self.variant(values.dimension) else { return Vec::new() };
        let margin =
            |one: &Break<Measure>| WrittenEnergy::of_root(&variant.graph, one.root, values);
        variant.breaks.iter().map(margin).collect()
    }
}
