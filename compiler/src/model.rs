//! A checked potential: names resolved, types and dimensions right, still exactly what was written.
//!
//! Only [`crate::check()`] makes a [`Model`]; later stages trust it. Its graphs are not simplified and
//! parameters are inputs, so a model evaluated over dual numbers is an independent witness for
//! everything the later stages do.

use std::fmt;
use std::ops::Range;

use piola_grammar::Span;

use crate::check::dimension::Dimension;
use crate::check::unit::UnitValue;
use crate::expression::{ExprGraph, Input, NodeId};
use crate::measure::{Argument, Measure};
use crate::verify::Stated;

/// The time step of a motion in what states become.
pub(crate) const TIME_STEP: &str = "dt";

/// How many inputs stand for the direction of a bond at rest, behind all parameters: its components, of which
/// the plane has no third.
pub(crate) const DIRECTIONS: usize = 3;

/// The components of that direction, as written.
const DIRECTION: [&str; DIRECTIONS] = ["(Xi(1)/L)", "(Xi(2)/L)", "(Xi(3)/L)"];

/// The number of the time step where there are so many parameters: behind the direction of a bond.
pub(crate) fn number_of_time_step(n_parameters: usize) -> usize {
    n_parameters + DIRECTIONS
}

/// A checked potential.
#[derive(Clone, Debug)]
pub struct Model {
    pub(crate) name: String,
    pub(crate) title: Option<String>,
    pub(crate) sources: Vec<String>,
    pub(crate) allowed: Vec<String>,
    pub(crate) has_units: bool,
    pub(crate) weighs_volumes: bool,
    pub(crate) parameters: Vec<Parameter>,
    pub(crate) constraints: Vec<Constraint>,
    pub(crate) variants: Vec<Variant>,
}

/// A parameter as declared.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// Whether it is a state: what an interaction remembers. Its default is what it begins with.
    pub is_state: bool,
    /// What it is.
    pub description: Option<String>,
    /// The unit as written.
    pub unit: Option<String>,
    /// Where it is declared.
    pub span: Span,
}

/// A condition on parameter values.
#[derive(Clone, Debug)]
pub struct Constraint {
    /// Whose declaration holds it.
    pub parameter: usize,
    /// As written.
    pub text: String,
}

/// The conditions on parameter values as a graph over values in declared units.
#[derive(Clone, Debug, Default)]
pub(crate) struct Conditions {
    pub(crate) graph: ExprGraph,
    /// One truth value per constraint of the model.
    pub(crate) roots: Vec<NodeId>,
}

/// The potential in two or in three dimensions.
#[derive(Clone, Debug)]
pub struct Variant {
    /// 2 or 3.
    pub dimension: usize,
    /// Default values in declared units.
    pub defaults: Vec<Option<f64>>,
    /// Declared units.
    pub units: Vec<UnitValue>,
    /// The energies as written.
    pub energies: Vec<Energy>,
    /// The energies of the deformation gradient as written.
    pub gradient_energies: Vec<GradientEnergy>,
    /// The functions of the right stretch tensor whose traces these hold, as functions of a principal
    /// stretch.
    pub traces: Vec<NodeId>,
    /// What is summed up over families, as written.
    pub integrals: Vec<Integral>,
    /// The energies of gathered values as written.
    pub gathered_energies: Vec<GatheredEnergy>,
    /// The energies of several measures of triangles and tetrahedra as written.
    pub coupled_energies: Vec<CoupledEnergy>,
    /// Declared intervals of use.
    pub domains: Vec<Interval>,
    /// When bonds, triangles and tetrahedra break.
    pub breaks: Vec<Break<Measure>>,
    /// When bonds break by what families give.
    pub family_breaks: Vec<Break<OfFamily>>,
    /// What bonds dissipate.
    pub dissipations: Vec<Dissipation>,
    /// What states of bonds, triangles and tetrahedra become, at most one for each.
    pub updates: Vec<Update<Measure>>,
    /// What states become of what families give, at most one for each.
    pub family_updates: Vec<Update<OfFamily>>,
    /// Whether anything depends on the direction that a bond has at rest.
    pub sees_directions: bool,
    /// Whether points gather vectors and tensors: an integrand or an energy of what is gathered holds `xi`, is
    /// another for `-Xi`, or holds what the other end of a bond gathers.
    pub gathers_vectors: bool,
    /// Numbers and components of tensors that depend on the deformation, and what they are in the text,
    /// the innermost expressions first.
    pub(crate) stated: Vec<(NodeId, Stated)>,
    /// Holds the roots of energies and intervals.
    pub graph: ExprGraph,
    pub(crate) conditions: Conditions,
}

/// One energy statement.
#[derive(Clone, Debug)]
pub struct Energy {
    /// What it is a function of.
    pub measure: Measure,
    /// The energy density in the variant's graph.
    pub root: NodeId,
    /// Place of the energy's expression.
    pub span: Span,
    /// The expression as written, in canonical spelling.
    pub text: String,
}

/// One energy statement `psi(F)`.
#[derive(Clone, Debug)]
pub struct GradientEnergy {
    /// The energy density in the variant's graph, in J/m^3.
    pub root: NodeId,
    /// Place of the energy's expression.
    pub span: Span,
    /// The expression as written, in canonical spelling.
    pub text: String,
}

/// One number that points gather: an integral over the family, `sum_j V_j g(xi_ij, Xi_ij)`, or a function of
/// such integrals.
#[derive(Clone, Debug)]
pub struct Integral {
    /// In the variant's graph: the integrand `g`, a function of `l`, `L`, `xi` and `Xi`; or the function of
    /// numbers before this one.
    pub root: NodeId,
    /// Whether it is a function of others: a component of a tensor that heads of energies name.
    pub is_function: bool,
    /// Its place.
    pub span: Span,
    /// The integrand as written, in canonical spelling.
    pub text: String,
}

/// One energy statement of gathered values, `psi(theta)` or `psi(l, m)`.
#[derive(Clone, Debug)]
pub struct GatheredEnergy {
    /// What stands in its head, e.g. `l, m`.
    pub head: String,
    /// Whether it is an energy of bonds, in J/m^(2d); else of points, in J/m^3.
    pub of_bonds: bool,
    /// The energy density in the variant's graph.
    pub root: NodeId,
    /// Place of the energy's expression.
    pub span: Span,
    /// The expression as written, in canonical spelling.
    pub text: String,
}

/// One condition under which something breaks, `break when l/L - 1 > s0`: with what it is a condition of.
#[derive(Clone, Debug)]
pub struct Break<T> {
    /// What it is a condition of: `l` of bonds, `a` of triangles, `v` of tetrahedra; or what families give.
    pub of: T,
    /// The margin in the variant's graph: above 0 where the condition holds.
    pub root: NodeId,
    /// Whether the condition holds where the margin is 0.
    pub holds_at_zero: bool,
    /// Place of the condition.
    pub span: Span,
    /// The condition as written, in canonical spelling.
    pub text: String,
    /// What it is, in the words of the file.
    pub reason: Option<String>,
}

impl Break<()> {
    /// The same with what it is a condition of.
    pub(crate) fn of<T>(self, of: T) -> Break<T> {
        let Break { of: (), root, holds_at_zero, span, text, reason } = self;
        Break { of, root, holds_at_zero, span, text, reason }
    }
}

/// What families give, by which bonds break, and with which something is remembered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum OfFamily {
    /// A deformation gradient, `break when J - 1 > h0`: where `psi(F)` is at bonds, a bond's own, where it is at
    /// points a point's, which breaks all of its bonds.
    Gradient,
    /// What a point gathers, `break when theta > t0`: all of its bonds break.
    Points,
    /// A bond's length with what either of its ends gathers, `break when l/L - 1 > s0 + theta`.
    Bonds,
}

/// What a condition is one of, or a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Of {
    /// Bonds, triangles or tetrahedra, by their measure.
    Measure(Measure),
    /// What families give.
    Family(OfFamily),
}

impl Of {
    /// Those that remember a state of this kind, in the plural.
    pub fn many(self) -> &'static str {
        match self {
            Of::Measure(measure) => measure.interactions(),
            Of::Family(OfFamily::Gradient) => "deformation gradients",
            Of::Family(OfFamily::Points | OfFamily::Bonds) => "points",
        }
    }

    /// What an energy of this kind is a function of, for instance.
    pub fn symbol(self) -> &'static str {
        match self {
            Of::Measure(measure) => measure.symbol(),
            Of::Family(OfFamily::Gradient) => "F",
            Of::Family(OfFamily::Points) => "theta",
            Of::Family(OfFamily::Bonds) => "l, theta",
        }
    }
}

/// One potential of how fast a bond's length changes, `dissipation(l) = 1/2*eta*rate(l)^2`.
#[derive(Clone, Debug)]
pub struct Dissipation {
    /// The potential in the variant's graph, in W/m^(2d), a function of `rate(l)`, `l`, `L` and states.
    pub root: NodeId,
    /// Its place.
    pub span: Span,
    /// The potential as written, in canonical spelling.
    pub text: String,
}

/// What a state becomes, `update k = max(k, l/L - 1)`, with what it is a state of.
#[derive(Clone, Debug)]
pub struct Update<T> {
    /// The number of the state among the parameters.
    pub state: usize,
    /// Of which kind it is: `l` of bonds, `a` of triangles, `v` of tetrahedra; or of what families give.
    pub of: T,
    /// Its next value in SI units in the variant's graph, a function of what it is a state of, of states of
    /// its kind as they are and of the time step.
    pub root: NodeId,
    /// Place of the next value.
    pub span: Span,
    /// The next value as written, in canonical spelling.
    pub text: String,
}

impl<T> Update<T> {
    /// The same as one of another kind.
    pub(crate) fn of<U>(self, of: U) -> Update<U> {
        let Update { state, root, span, text, .. } = self;
        Update { state, of, root, span, text }
    }
}

/// One energy statement of several measures, `psi(a, l1, l2)` or `psi(angle)`.
#[derive(Clone, Debug)]
pub struct CoupledEnergy {
    /// What stands in its head, e.g. `a, l1, l2`.
    pub head: String,
    /// The measure of the interaction: lengths of bonds, areas of triangles, volumes of tetrahedra.
    pub clique: Measure,
    /// The energy density in the variant's graph: the mean of `orders`.
    pub root: NodeId,
    /// What is written for each order of the points in which it is another expression; the first as it
    /// stands.
    pub orders: Vec<NodeId>,
    /// Place of the energy's expression.
    pub span: Span,
    /// The expression as written, in canonical spelling.
    pub text: String,
}

/// A declared interval of use: of a quantity of one measure, or of the deformation gradient.
#[derive(Clone, Debug)]
pub struct Interval {
    /// What the quantity depends on: a measure, or the deformation gradient.
    pub argument: Argument,
    /// The quantity in the variant's graph.
    pub root: NodeId,
    /// Lower end and whether it belongs to the interval.
    pub lower: (f64, bool),
    /// Upper end and whether it belongs to the interval.
    pub upper: (f64, bool),
    /// Whether the quantity is `J`, the determinant of the deformation gradient.
    pub of_volume_ratio: bool,
    /// Place of the statement.
    pub span: Span,
    /// The quantity as written.
    pub text: String,
}

impl Interval {
    /// Whether a value of the quantity lies in the interval.
    pub fn contains(&self, value: f64) -> bool {
        let above = value > self.lower.0 || (self.lower.1 && value == self.lower.0);
        let below = value < self.upper.0 || (self.upper.1 && value == self.upper.0);
        above && below
    }
}

impl fmt::Display for Interval {
    /// `l/L in (0, 10]`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (open, close) =
            (if self.lower.1 { '[' } else { '(' }, if self.upper.1 { ']' } else { ')' });
        write!(f, "{} in {open}{}, {}{close}", self.text, self.lower.0, self.upper.0)
    }
}

impl Model {
    /// The name after `potential`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The title after the name.
    pub fn title(&self) -> Option<&str> {
        self.title.as_deref()
    }

    /// The texts of `source` statements.
    pub fn sources(&self) -> &[String] {
        &self.sources
    }

    /// The parameters in the order of their declaration.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// The conditions on parameter values.
    pub fn constraints(&self) -> &[Constraint] {
        &self.constraints
    }

    /// The codes of the lints that are not to be reported.
    pub fn allowed(&self) -> &[String] {
        &self.allowed
    }

    /// Whether the energies are meant for weights that are products of point volumes:
    /// `weights volumes`.
    pub fn weighs_volumes(&self) -> bool {
        self.weighs_volumes
    }

    /// Whether any parameter states a unit, so that dimensions are checked.
    pub fn has_units(&self) -> bool {
        self.has_units
    }

    /// The dimensions in which the potential is defined, ascending.
    pub fn dimensions(&self) -> impl Iterator<Item = usize> {
        self.variants.iter().map(|v| v.dimension)
    }

    /// The potential in `dimension` dimensions, if it is defined there.
    pub fn variant(&self, dimension: usize) -> Option<&Variant> {
        self.variants.iter().find(|v| v.dimension == dimension)
    }

    /// The measures that have an energy, ascending.
    pub fn measures(&self) -> Vec<Measure> {
        let first = &self.variants[0];
        let has = |m: &Measure| first.energies.iter().any(|e| e.measure == *m);
        Measure::ALL.into_iter().filter(has).collect()
    }

    /// Whether there is an energy of the deformation gradient, `psi(F)`.
    pub fn has_gradient_energy(&self) -> bool {
        !self.variants[0].gradient_energies.is_empty()
    }

    /// Whether there is an energy of gathered values, such as `psi(theta)` or `psi(l, m)`.
    pub fn has_gathered_energy(&self) -> bool {
        !self.variants[0].gathered_energies.is_empty()
    }

    /// Whether points gather vectors and tensors, in some dimension.
    pub fn gathers_vectors(&self) -> bool {
        self.variants.iter().any(|variant| variant.gathers_vectors)
    }

    /// The conditions of measures under which bonds, triangles and tetrahedra break, as written.
    pub fn breaks(&self) -> &[Break<Measure>] {
        &self.variants[0].breaks
    }

    /// The conditions of what families give, as written.
    pub fn family_breaks(&self) -> &[Break<OfFamily>] {
        &self.variants[0].family_breaks
    }

    /// Whether any interaction can break.
    pub fn can_break(&self) -> bool {
        !self.breaks().is_empty() || !self.family_breaks().is_empty()
    }

    /// What bonds dissipate, as written.
    pub fn dissipations(&self) -> &[Dissipation] {
        &self.variants[0].dissipations
    }

    /// What states of bonds, triangles and tetrahedra become, as written.
    pub fn updates(&self) -> &[Update<Measure>] {
        &self.variants[0].updates
    }

    /// What states become of what families give, as written.
    pub fn family_updates(&self) -> &[Update<OfFamily>] {
        &self.variants[0].family_updates
    }

    /// Whether anything is remembered that changes.
    pub fn has_memory(&self) -> bool {
        !self.updates().is_empty() || !self.family_updates().is_empty()
    }

    /// Whether interactions of this measure remember anything that changes.
    pub fn remembers(&self, measure: Measure) -> bool {
        self.updates().iter().any(|update| update.of == measure)
    }

    /// Of which kind a state is that is updated; nothing of one that never changes.
    pub fn kind_of_state(&self, state: usize) -> Option<Of> {
        let own = self.updates().iter().find(|update| update.state == state);
        let of_families = || self.family_updates().iter().find(|update| update.state == state);
        own.map(|own| Of::Measure(own.of)).or_else(|| of_families().map(|own| Of::Family(own.of)))
    }

    /// The numbers of the parameters that are states, ascending.
    pub fn states(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.parameters.len()).filter(|number| self.parameters[*number].is_state)
    }

    /// Whether anything depends on the direction that a bond has at rest, in some dimension.
    pub fn sees_directions(&self) -> bool {
        self.variants.iter().any(|variant| variant.sees_directions)
    }

    /// The numbers that stand for the components of the direction that a bond has at rest, the unit vector
    /// `Xi/L`, in so many dimensions: behind all parameters, among the fields of all values. None where nothing
    /// depends on it.
    pub fn directions(&self, dimension: usize) -> Range<u16> {
        let first = self.parameters.len() as u16;
        first..first + if self.sees_directions() { dimension as u16 } else { 0 }
    }

    /// The number that stands for the length of a bond where its rate is the variable: behind that of the
    /// time step.
    pub(crate) fn number_of_length(&self) -> u16 {
        number_of_time_step(self.parameters.len()) as u16 + 1
    }

    /// The name of a parameter by its number, or of what stands behind them.
    pub(crate) fn input_name(&self, number: usize) -> &str {
        let behind = |n: usize| DIRECTION.get(number - n).copied().unwrap_or(TIME_STEP);
        let own = self.parameters.get(number).map(|parameter| parameter.name.as_str());
        own.unwrap_or_else(|| behind(self.parameters.len()))
    }

    /// The number of the time step, where there are updates.
    pub(crate) fn number_of_time_step(&self) -> Option<u16> {
        self.has_memory().then_some(number_of_time_step(self.parameters.len()) as u16)
    }

    /// Whether what is remembered changes with time, by itself.
    pub fn remembers_time(&self) -> bool {
        self.time_step().is_some() || self.families_remember_time()
    }

    /// Whether some update of what families give depends on the time step.
    pub fn families_remember_time(&self) -> bool {
        let updates =
            |variant: &Variant| variant.family_updates.iter().map(|one| one.root).collect();
        self.depend_on_time(updates)
    }

    /// Whether some of these nodes of a variant depend on the time step.
    fn depend_on_time(&self, roots: impl Fn(&Variant) -> Vec<NodeId>) -> bool {
        let dt = Input::Parameter(number_of_time_step(self.parameters.len()) as u16);
        let mut all = self.variants.iter();
        all.any(|variant| variant.graph.depends_on(&roots(variant), dt))
    }

    /// The number of the time step, where some update of a measure depends on it.
    pub(crate) fn time_step(&self) -> Option<u16> {
        let updates = |variant: &Variant| variant.updates.iter().map(|one| one.root).collect();
        self.depend_on_time(updates).then_some(number_of_time_step(self.parameters.len()) as u16)
    }

    /// The measures of the interactions that have an energy of several measures, ascending: areas for
    /// triangles, volumes for tetrahedra.
    pub fn coupled(&self) -> Vec<Measure> {
        let first = &self.variants[0];
        let has = |m: &Measure| first.coupled_energies.iter().any(|e| e.clique == *m);
        Measure::ALL.into_iter().filter(has).collect()
    }

    /// What energies of triangles (`clique` is the area) or tetrahedra are functions of, where one of them is
    /// of several measures.
    pub fn of_clique(&self, clique: Measure) -> Vec<&str> {
        let coupled = self.variants[0].coupled_energies.iter().filter(|e| e.clique == clique);
        let coupled: Vec<&str> = coupled.map(|energy| energy.head.as_str()).collect();
        let alone = !coupled.is_empty() && self.measures().contains(&clique);
        alone.then(|| clique.symbol()).into_iter().chain(coupled).collect()
    }

    /// What its energies are functions of, as written: `l`, `a`, `v`, `F`, `l, m`, `a, l1, l2`.
    pub fn arguments(&self) -> Vec<&str> {
        let measures = self.measures().into_iter().map(Measure::symbol);
        let mut arguments: Vec<&str> =
            measures.chain(self.has_gradient_energy().then_some("F")).collect();
        let gathered = self.variants[0].gathered_energies.iter().map(|energy| &energy.head);
        let coupled = self.variants[0].coupled_energies.iter().map(|energy| &energy.head);
        for head in gathered.chain(coupled) {
            if !arguments.contains(&head.as_str()) {
                arguments.push(head);
            }
        }
        arguments
    }

    /// The unit of an energy density of this measure, e.g. `J/m^4`.
    pub fn energy_unit(measure: Measure, dimension: usize) -> String {
        Dimension::energy_density(measure.points(), dimension).unit()
    }
}
