//! Statements to a model, once per dimension.

use std::collections::HashMap;

use piola_grammar::ast::{
    Allow, Ast, Definition, Energy as EnergyAst, ExprId, ExprKind, Ident,
    Parameter as ParameterAst, Statement, Text,
};
use piola_grammar::{Diagnostic, Span, print_expression, suggest};

use super::MAX_FINDINGS;
use super::dimension::Dimension;
use super::elaborate::Elaborator;
use super::names::parts;
use super::symbols::{Symbol, Symbols, is_coupled, is_kinematic, is_of_vector};
use super::unit::UnitValue;
use super::value::{GRADIENT, IN_UNIT, PART, Quantity, Value};
use crate::expression::{ExprGraph, NodeId};
use crate::lint::LINTS;
use crate::measure::Measure;
use crate::model::{
    Conditions, Constraint, Energy, GradientEnergy, Model, Of, Parameter, Update, Variant,
};

/// Most parameters a potential may have: their numbers are 16 bits wide.
const MAX_PARAMETERS: usize = 1000;

/// Builds the model of a file whose names are looked up; what is wrong is added to `errors`.
pub(crate) fn model(
    ast: &Ast,
    symbols: &Symbols<'_>,
    errors: &mut Vec<Diagnostic>,
) -> Option<Model> {
    let dimensions = dimensions(ast, errors);
    let weighs_volumes = weighs_volumes(ast, errors);
    let allowed = allowed(ast, errors);
    let declared = parameters(ast);
    if declared.len() > MAX_PARAMETERS {
        let message = format!("a potential has at most {MAX_PARAMETERS} parameters");
        errors.push(Diagnostic::error("too-large", declared[MAX_PARAMETERS].name.span, message));
        return None;
    }
    let in_unit =
        |s: &Statement| matches!(s, Statement::Definition(Definition { unit: Some(_), .. }));
    let has_units = declared.iter().any(|p| p.unit.is_some()) || ast.statements.iter().any(in_unit);
    let mut variants = Vec::new();
    let mut stated = Vec::new();
    for &dimension in &dimensions {
        let mut builder = Builder::new(ast, symbols, dimension, has_units);
        builder.statements();
        builder.variant.integrals = builder.integrals();
        builder.variant.traces = builder.elaborator.traces.clone();
        builder.check_states();
        builder.check_directions();
        builder.check_vectors();
        builder.check_gathered();
        builder.check_rates();
        builder.variant.stated = std::mem::take(&mut builder.elaborator.stated.all);
        merge(errors, builder.elaborator.errors);
        let conditions;
        (stated, conditions) = constraints(ast, symbols, dimension, errors);
        let graph = builder.elaborator.graph;
        variants.push(Variant { graph, conditions, ..builder.variant });
    }
    if !ast.statements.iter().any(|s| matches!(s, Statement::Energy(_))) {
        errors.push(
            Diagnostic::error("no-energy", ast.name.span, "the potential has no energy")
                .help("add a line such as `psi(l) = 1/2*C*L*(l/L - 1)^2`"),
        );
    }
    if !errors.is_empty() {
        return None;
    }
    Some(Model {
        name: ast.name.name.clone(),
        title: ast.title.as_ref().map(|t| t.text.clone()),
        sources: sources(ast),
        allowed,
        has_units,
        weighs_volumes,
        parameters: declared.iter().map(|p| parameter(ast, p)).collect(),
        constraints: stated,
        variants,
    })
}

/// Adds errors, each place and code once: what is wrong in 2D is mostly wrong in 3D too.
fn merge(errors: &mut Vec<Diagnostic>, more: Vec<Diagnostic>) {
    for error in more {
        let known = errors.iter().any(|e| e.code == error.code && e.span == error.span);
        if !known && errors.len() < MAX_FINDINGS {
            errors.push(error);
        }
    }
}

fn parameters(ast: &Ast) -> Vec<&ParameterAst> {
    let mut declared = Vec::new();
    for statement in &ast.statements {
        if let Statement::Parameter(parameter) = statement {
            declared.push(parameter);
        }
    }
    declared
}

fn sources(ast: &Ast) -> Vec<String> {
    let of = |s: &Statement| match s {
        Statement::Source(text) => Some(text.text.clone()),
        _ => None,
    };
    ast.statements.iter().filter_map(of).collect()
}

/// Whether the file states `weights volumes`; reports a second line that does.
fn weighs_volumes(ast: &Ast, errors: &mut Vec<Diagnostic>) -> bool {
    let mut stated = ast.statements.iter().filter_map(|s| match s {
        Statement::Weights(span) => Some(*span),
        _ => None,
    });
    let Some(first) = stated.next() else { return false };
    if let Some(again) = stated.next() {
        errors.push(
            Diagnostic::error("duplicate-statement", again, "`weights` is stated twice")
                .note(first, "first stated here"),
        );
    }
    true
}

/// The codes of the lints that are not to be reported; reports those that are none.
fn allowed(ast: &Ast, errors: &mut Vec<Diagnostic>) -> Vec<String> {
    let mut codes = Vec::new();
    for statement in &ast.statements {
        let Statement::Allow(Allow { code, .. }) = statement else { continue };
        if LINTS.iter().any(|lint| lint.code == code.text) {
            codes.push(code.text.clone());
        } else if errors.len() < MAX_FINDINGS {
            errors.push(unknown_lint(code));
        }
    }
    codes
}

fn unknown_lint(code: &Text) -> Diagnostic {
    let known = || LINTS.iter().map(|lint| lint.code);
    let message = format!("there is no lint `{}`", code.text);
    let error = Diagnostic::error("unknown-lint", code.span, message);
    match suggest(&code.text, known()) {
        Some(near) => error.help(format!("did you mean `\"{near}\"`?")),
        None => error.help(format!("the lints are {}", known().collect::<Vec<_>>().join(", "))),
    }
}

fn parameter(ast: &Ast, p: &ParameterAst) -> Parameter {
    let unit = p.unit.as_ref().map(|unit| piola_grammar::print_unit(&ast.arena, unit));
    Parameter {
        name: p.name.name.clone(),
        is_state: p.is_state,
        description: p.description.as_ref().map(|t| t.text.clone()),
        unit,
        span: p.name.span,
    }
}

fn dimensions(ast: &Ast, errors: &mut Vec<Diagnostic>) -> Vec<usize> {
    let mut stated: Option<(Vec<usize>, Span)> = None;
    for statement in &ast.statements {
        let Statement::Dimensions(list) = statement else { continue };
        let place = list.first().map_or(ast.name.span, |(_, span)| *span);
        if let Some((_, first)) = &stated {
            errors.push(
                Diagnostic::error("duplicate-statement", place, "`dimensions` is stated twice")
                    .note(*first, "first stated here"),
            );
            continue;
        }
        let mut dimensions = Vec::new();
        for &(d, span) in list {
            if d != 2 && d != 3 {
                let message = format!("there are 2 or 3 dimensions, not {d}");
                errors.push(Diagnostic::error("wrong-dimensions", span, message));
            } else if !dimensions.contains(&usize::from(d)) {
                dimensions.push(usize::from(d));
            }
        }
        dimensions.sort_unstable();
        stated = Some((dimensions, place));
    }
    match stated {
        Some((dimensions, _)) if !dimensions.is_empty() => dimensions,
        _ => vec![2, 3],
    }
}

/// The conditions on parameters, with their roots in a graph. They hold for values in declared
/// units and are not dimension-checked, nor are definitions where conditions use them.
fn constraints(
    ast: &Ast,
    symbols: &Symbols<'_>,
    dimension: usize,
    errors: &mut Vec<Diagnostic>,
) -> (Vec<Constraint>, Conditions) {
    let mut elaborator = Elaborator::new(&ast.arena, Some(ast), symbols, dimension, false);
    let (mut stated, mut roots) = (Vec::new(), Vec::new());
    let mut n_parameters = 0;
    for (number, statement) in ast.statements.iter().enumerate() {
        match statement {
            Statement::Definition(d) if d.parameters.is_none() => {
                elaborator.define_value(number, d);
            }
            Statement::Parameter(p) => {
                for &id in &p.constraints {
                    if let Some(root) = condition(&mut elaborator, id) {
                        let text = print_expression(&ast.arena, id);
                        stated.push(Constraint { parameter: n_parameters, text });
                        roots.push(root);
                    }
                }
                n_parameters += 1;
            }
            _ => {}
        }
    }
    merge(errors, elaborator.errors);
    let (graph, roots) = elaborator.graph.extract(&roots);
    (stated, Conditions { graph, roots })
}

/// The node of a condition on parameters.
fn condition(elaborator: &mut Elaborator<'_>, id: ExprId) -> Option<NodeId> {
    let value = elaborator.expression(id)?;
    elaborator.truth(value, id)?;
    let span = elaborator.arena[id].span;
    if elaborator.depends_on_states(&[value.node]) {
        let message = "a condition on parameters cannot depend on a state";
        elaborator.report(Diagnostic::error("wrong-measure", span, message));
        return None;
    }
    if value.uses == 0 {
        return Some(value.node);
    }
    let error = if value.uses & !IN_UNIT == 0 {
        let message = "a condition on parameters holds a value that is stated in a unit";
        Diagnostic::error("dimension-mismatch", span, message)
            .label("parameters count in their own units here")
            .help("write the number that the value is in the unit of the parameter")
    } else {
        let message = "a condition on parameters cannot depend on the deformation";
        Diagnostic::error("wrong-measure", span, message)
    };
    elaborator.report(error);
    None
}

/// Builds one variant.
pub(super) struct Builder<'a> {
    pub(super) ast: &'a Ast,
    pub(super) has_units: bool,
    pub(super) elaborator: Elaborator<'a>,
    pub(super) variant: Variant,
    /// The updates, with the kinds that they say by what they hold.
    pub(super) updates: Vec<Update<Option<Of>>>,
    /// Of which kinds the states are that are updated, once it is known.
    pub(super) kinds: HashMap<usize, Of>,
    /// States whose updates say no kind that there is, which is reported.
    pub(super) states_of_no_kind: Vec<usize>,
}

impl<'a> Builder<'a> {
    fn new(ast: &'a Ast, symbols: &'a Symbols<'a>, dimension: usize, has_units: bool) -> Self {
        Builder {
            ast,
            has_units,
            updates: Vec::new(),
            kinds: HashMap::new(),
            states_of_no_kind: Vec::new(),
            elaborator: Elaborator::new(&ast.arena, Some(ast), symbols, dimension, has_units),
            variant: Variant {
                dimension,
                defaults: Vec::new(),
                units: Vec::new(),
                energies: Vec::new(),
                gradient_energies: Vec::new(),
                traces: Vec::new(),
                integrals: Vec::new(),
                gathered_energies: Vec::new(),
                coupled_energies: Vec::new(),
                domains: Vec::new(),
                breaks: Vec::new(),
                family_breaks: Vec::new(),
                dissipations: Vec::new(),
                updates: Vec::new(),
                family_updates: Vec::new(),
                sees_directions: false,
                gathers_vectors: false,
                stated: Vec::new(),
                graph: ExprGraph::new(),
                conditions: Conditions::default(),
            },
        }
    }

    fn statements(&mut self) {
        let ast = self.ast;
        let (mut breaks, mut conditions) = (Vec::new(), Vec::new());
        for (number, statement) in ast.statements.iter().enumerate() {
            match statement {
                Statement::Parameter(p) => self.parameter(p),
                Statement::Definition(d) if d.parameters.is_none() => {
                    self.elaborator.define_value(number, d);
                }
                Statement::Energy(energy) => self.energy(energy),
                Statement::Domain(domain) => self.domain(domain),
                Statement::Break(breaking) => {
                    if let Some(condition) = self.condition(breaking) {
                        breaks.push(breaking);
                        conditions.push(condition);
                    }
                }
                Statement::Dissipation(potential) => self.dissipation(potential),
                Statement::Update(update) => self.update(update),
                Statement::Definition(_)
                | Statement::Source(_)
                | Statement::Import(..)
                | Statement::Allow(_)
                | Statement::Dimensions(_)
                | Statement::Weights(_) => {}
            }
        }
        // What a condition of states alone breaks is known once all that remembers is.
        self.find_kinds(&conditions);
        for (breaking, condition) in breaks.into_iter().zip(conditions) {
            self.breaking(breaking, condition);
        }
    }

    fn parameter(&mut self, p: &ParameterAst) {
        let none = UnitValue { dimension: Dimension::NONE, scale: 1.0 };
        let unit = p.unit.as_ref().map_or(Some(none), |unit| self.elaborator.unit(unit));
        let default = p.defaults.first().and_then(|default| self.default_value(p, *default));
        self.variant.defaults.push(default);
        self.variant.units.push(unit.unwrap_or(none));
        let quantity = match unit {
            Some(unit) if self.has_units => Quantity::Known(unit.dimension),
            // A unit that is not understood must not cause further errors.
            _ => Quantity::Any,
        };
        self.elaborator.parameter_quantities.push(quantity);
    }

    fn default_value(&mut self, p: &ParameterAst, root: ExprId) -> Option<f64> {
        let value = self.elaborator.constant(root)?;
        if value.is_finite() {
            return Some(value);
        }
        let message = format!("the default of `{}` is {value}, not a finite number", p.name.name);
        let span = self.ast.arena[root].span;
        self.elaborator.report(Diagnostic::error("not-a-constant", span, message));
        None
    }

    fn energy(&mut self, energy: &EnergyAst) {
        if is_of_vector(self.ast, energy) && energy.gathered.is_empty() {
            self.vector_energy(energy);
            return;
        }
        if is_coupled(self.ast, energy) {
            self.coupled_energy(energy);
            return;
        }
        let is_defined = matches!(
            self.elaborator.symbols.get(&energy.measure.name),
            Some(Symbol::Value(_) | Symbol::Function(_) | Symbol::Parameter(_))
        );
        let of_bonds = energy.measure.name == "l" || is_of_vector(self.ast, energy);
        if is_defined || (of_bonds && !energy.gathered.is_empty()) {
            self.gathered_energy(energy);
            return;
        }
        if let Some(name) = energy.gathered.first() {
            let error = gathered_by_others(energy, name);
            self.elaborator.report(error);
            return;
        }
        if energy.measure.name == "F" {
            self.gradient_energy(energy);
            return;
        }
        let Some(measure) = Measure::from_symbol(&energy.measure.name) else {
            let error = unknown_measure(self.ast, energy);
            self.elaborator.report(error);
            return;
        };
        let Some(value) = self.elaborator.expression(energy.body) else { return };
        let Some(quantity) = self.elaborator.number(value, energy.body) else { return };
        if self.refuse_integrals(energy, value) {
            return;
        }
        if !self.depends_on_only(&Argument::of(measure), value, energy) {
            return;
        }
        let wanted = Dimension::energy_density(measure.points(), self.variant.dimension);
        if self.has_units && Quantity::Known(wanted).unify(quantity).is_none() {
            self.wrong_energy_unit(energy, measure, quantity, wanted);
            return;
        }
        self.variant.energies.push(Energy {
            measure,
            root: value.node,
            span: self.ast.arena[energy.body].span,
            text: print_expression(&self.ast.arena, energy.body),
        });
    }

    fn gradient_energy(&mut self, energy: &EnergyAst) {
        let Some(value) = self.elaborator.expression(energy.body) else { return };
        let Some(quantity) = self.elaborator.number(value, energy.body) else { return };
        if self.refuse_integrals(energy, value) {
            return;
        }
        if !self.depends_on_only(&Argument::GRADIENT, value, energy) {
            return;
        }
        let span = self.ast.arena[energy.body].span;
        let wanted = Dimension::of(1, -1, -2, 0);
        if self.has_units && Quantity::Known(wanted).unify(quantity).is_none() {
            let message = format!(
                "psi(F) must be an energy per volume in J/m^3, not {}",
                quantity.describe()
            );
            self.elaborator.report(
                Diagnostic::error("dimension-mismatch", span, message)
                    .label(quantity.describe())
                    .help("moduli are in Pa, which is J/m^3, in two dimensions too"),
            );
            return;
        }
        let text = print_expression(&self.ast.arena, energy.body);
        self.variant.gradient_energies.push(GradientEnergy { root: value.node, span, text });
    }

    pub(super) fn wrong_energy_unit(
        &mut self,
        energy: &EnergyAst,
        measure: Measure,
        quantity: Quantity,
        wanted: Dimension,
    ) {
        let d = self.variant.dimension;
        let symbol = energy.measure.name.as_str();
        let message = format!(
            "psi({symbol}) must be an energy density in {} (d = {d}), not {}",
            wanted.unit(),
            quantity.describe()
        );
        let mut error =
            Diagnostic::error("dimension-mismatch", self.ast.arena[energy.body].span, message)
                .label(quantity.describe());
        if let Quantity::Known(found) = quantity {
            error = error.help(missing_factor(measure, d, wanted, found));
        }
        let unit = format!("J/m^({}*d)", measure.points());
        error = error.help(format!(
            "weights of {}s are products of {} volumes, so psi({symbol}) is in {unit}",
            measure.interaction(),
            measure.points()
        ));
        self.elaborator.report(error);
    }

    /// Whether the energy depends on nothing else; reports the first place where it does.
    fn depends_on_only(&mut self, own: &Argument, value: Value, energy: &EnergyAst) -> bool {
        let Some(other) = Argument::all().find(|other| value.uses & !own.bit & other.bit != 0)
        else {
            return true;
        };
        let arena = &self.ast.arena;
        let place = parts(arena, energy.body).into_iter().find(
            |id| matches!(&arena[*id].kind, ExprKind::Name(name) if other.names.contains(&&**name)),
        );
        let span = arena[place.unwrap_or(energy.body)].span;
        let (symbol, mut foreign) = (own.names[0], other.names[0].to_string());
        if let (PART, Some(ExprKind::Name(name))) = (other.bit, place.map(|id| &arena[id].kind)) {
            foreign = name.to_lowercase();
        }
        let message =
            format!("psi({symbol}) is the energy of a {} and cannot depend on `{foreign}`", own.of);
        self.elaborator.report(
            Diagnostic::error("wrong-measure", span, message)
                .label(format!("a measure of a {}", other.of))
                .note(energy.head, format!("an energy of `{symbol}`"))
                .help(format!("write this part as an energy of its own: `psi({foreign}) = ..`"))
                .help(format!(
                    "or, if it is meant as a parameter, choose another name than `{foreign}`"
                )),
        );
        false
    }
}

/// What an energy may be a function of.
struct Argument {
    bit: u8,
    /// The names by which an energy depends on it.
    names: &'static [&'static str],
    /// Whose energy it is.
    of: &'static str,
}

impl Argument {
    const GRADIENT: Argument =
        Argument { bit: GRADIENT, names: &["F", "J", "C", "E", "U"], of: "point" };

    const PART: Argument = Argument {
        bit: PART,
        names: &[
            "l1", "l2", "l3", "l4", "l5", "l6", "a1", "a2", "a3", "a4", "angle", "L1", "L2", "L3",
            "L4", "L5", "L6", "A1", "A2", "A3", "A4", "Angle", "xi",
        ],
        of: "triangle or a tetrahedron, named in the head",
    };

    fn of(measure: Measure) -> Argument {
        let names: &[&str] = match measure {
            Measure::Length => &["l", "L"],
            Measure::Area => &["a", "A"],
            Measure::Volume => &["v", "V"],
        };
        Argument { bit: 1 << (measure as u8), names, of: measure.interaction() }
    }

    fn all() -> impl Iterator<Item = Argument> {
        Measure::ALL.into_iter().map(Argument::of).chain([Argument::GRADIENT, Argument::PART])
    }
}

/// How to bring an energy in `found` to the unit that is `wanted` in `d` dimensions.
fn missing_factor(measure: Measure, d: usize, wanted: Dimension, found: Dimension) -> String {
    let other = 5 - d;
    if found == Dimension::energy_density(measure.points(), other) {
        return format!(
            "this is right in {other} dimensions only: write `dimensions {other}`, or let the units \
             of the parameters depend on `d`"
        );
    }
    let missing = wanted.over(found);
    // What is missing in the unit of the measure is nearly always the measure at rest.
    if missing == Dimension::of(0, measure.length_exponent(), 0, 0) {
        let reference = measure.reference_symbol();
        return format!("a factor in {} is missing, such as `{reference}`", missing.unit());
    }
    format!("a factor in {} is missing", missing.unit())
}

fn gathered_by_others(energy: &EnergyAst, name: &Ident) -> Diagnostic {
    let measure = &energy.measure.name;
    if measure == "F" {
        let message =
            format!("an energy of `F` is one of `F` alone, not of `{}` beside it", name.name);
        return Diagnostic::error("wrong-measure", name.span, message)
            .label("one name too many")
            .help(format!("write `psi(F) = ..`; its right side may hold `{}`", name.name));
    }
    let message = format!("psi({measure}, {}) is no energy of bonds or points", name.name);
    Diagnostic::error("wrong-measure", energy.measure.span, message)
        .label("gathered values stand alone or behind `l`")
        .help(format!("write `psi(l, {0}) = ..` or `psi({0}) = ..`", name.name))
}

fn unknown_measure(ast: &Ast, energy: &EnergyAst) -> Diagnostic {
    let name = &energy.measure.name;
    let error = Diagnostic::error(
        "unknown-measure",
        energy.measure.span,
        format!("`{name}` is not a measure of an interaction"),
    )
    .label("psi is a function of `l`, `a`, `v` or `F`");
    if is_kinematic(ast, energy) {
        return error.help(format!(
            "write `psi(F) = ..`, with the deformation gradient `F`; its right side may hold `{name}`"
        ));
    }
    match name.as_str() {
        "L" | "A" | "V" => error
            .help(format!("`{name}` is the value at rest; write `psi({})`", name.to_lowercase())),
        _ => error.help(
            "`l` is the length of a bond, `a` twice the area of a triangle, `v` six times the volume \
             of a tetrahedron, `angle` that between two sides of a triangle, `F` the deformation \
             gradient; a value that points gather is \
             defined above, with `integral`",
        ),
    }
}
