//! Statements to a model, once per dimension.

use piola_grammar::ast::{
    Ast, Energy as EnergyAst, ExprKind, Parameter as ParameterAst, Statement,
};
use piola_grammar::{Diagnostic, Span, print_expression, suggest};

use super::dimension::Dimension;
use super::elaborate::Elaborator;
use super::names::{Symbols, parts};
use super::unit::{UnitValue, named_unit, unit_names};
use super::value::{Quantity, Value};
use crate::measure::Measure;
use crate::model::{Constraint, Energy, Interval, Model, Parameter, Variant};

/// Most parameters a potential may have: their numbers are 16 bits wide.
const MAX_PARAMETERS: usize = 1000;

/// Builds the model of a file whose names are resolved.
pub(crate) fn model(ast: &Ast, symbols: &Symbols<'_>) -> Result<Model, Vec<Diagnostic>> {
    let mut errors = Vec::new();
    let dimensions = dimensions(ast, &mut errors);
    let declared = parameters(ast);
    if declared.len() > MAX_PARAMETERS {
        let message = format!("a potential has at most {MAX_PARAMETERS} parameters");
        errors.push(Diagnostic::error("too-large", declared[MAX_PARAMETERS].name.span, message));
        return Err(errors);
    }
    let has_units = declared.iter().any(|p| p.unit.is_some());
    let mut variants = Vec::new();
    for &dimension in &dimensions {
        let mut builder = Builder::new(ast, symbols, dimension, has_units);
        builder.statements();
        merge(&mut errors, builder.elaborator.errors);
        variants.push(Variant { graph: builder.elaborator.graph, ..builder.variant });
    }
    let (constraint_graph, constraints) = constraints(ast, symbols, &declared, &mut errors);
    if !ast.statements.iter().any(|s| matches!(s, Statement::Energy(_))) {
        errors.push(
            Diagnostic::error("no-energy", ast.name.span, "the potential has no energy")
                .help("add a line such as `psi(l) = 1/2*C*L*(l/L - 1)^2`"),
        );
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    Ok(Model {
        name: ast.name.name.clone(),
        title: ast.title.as_ref().map(|t| t.text.clone()),
        sources: sources(ast),
        has_units,
        parameters: declared.iter().map(|p| parameter(ast, p)).collect(),
        constraints,
        constraint_graph,
        variants,
    })
}

/// Adds errors, each place and code once: what is wrong in 2D is mostly wrong in 3D too.
fn merge(errors: &mut Vec<Diagnostic>, more: Vec<Diagnostic>) {
    for error in more {
        if !errors.iter().any(|e| e.code == error.code && e.span == error.span) {
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

fn parameter(ast: &Ast, p: &ParameterAst) -> Parameter {
    let unit = p.unit.as_ref().map(|unit| piola_grammar::print_unit(&ast.arena, unit));
    Parameter {
        name: p.name.name.clone(),
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

/// Conditions on parameters hold for values in declared units and are not dimension-checked.
fn constraints(
    ast: &Ast,
    symbols: &Symbols<'_>,
    declared: &[&ParameterAst],
    errors: &mut Vec<Diagnostic>,
) -> (crate::expression::ExprGraph, Vec<Constraint>) {
    let mut elaborator = Elaborator::new(&ast.arena, Some(ast), symbols, 0, false);
    elaborator.parameter_quantities = vec![Quantity::Any; declared.len()];
    let mut constraints = Vec::new();
    let sound = |p: &ParameterAst| {
        ast.statements.iter().enumerate().any(|(number, statement)| {
            symbols.is_sound(number)
                && matches!(statement, Statement::Parameter(q) if std::ptr::eq(p, q))
        })
    };
    for (number, p) in declared.iter().enumerate() {
        for &id in p.constraints.iter().filter(|_| sound(p)) {
            let Some(value) = elaborator.expression(id) else { continue };
            if elaborator.truth(value, id).is_none() {
                continue;
            }
            if value.uses != 0 {
                let span = ast.arena[id].span;
                let message = "a condition on parameters cannot depend on the deformation";
                elaborator.report(Diagnostic::error("wrong-measure", span, message));
                continue;
            }
            let text = print_expression(&ast.arena, id);
            constraints.push(Constraint { parameter: number, text, root: value.node });
        }
    }
    merge(errors, elaborator.errors);
    (elaborator.graph, constraints)
}

/// Builds one variant.
struct Builder<'a> {
    ast: &'a Ast,
    has_units: bool,
    elaborator: Elaborator<'a>,
    variant: Variant,
}

impl<'a> Builder<'a> {
    fn new(ast: &'a Ast, symbols: &'a Symbols<'a>, dimension: usize, has_units: bool) -> Self {
        Builder {
            ast,
            has_units,
            elaborator: Elaborator::new(&ast.arena, Some(ast), symbols, dimension, has_units),
            variant: Variant {
                dimension,
                defaults: Vec::new(),
                units: Vec::new(),
                energies: Vec::new(),
                domains: Vec::new(),
                graph: crate::expression::ExprGraph::new(),
            },
        }
    }

    fn statements(&mut self) {
        let (ast, symbols) = (self.ast, self.elaborator.symbols);
        for (number, statement) in ast.statements.iter().enumerate() {
            match statement {
                Statement::Parameter(p) => self.parameter(p, symbols.is_sound(number)),
                _ if !symbols.is_sound(number) => {}
                Statement::Definition(d) if d.parameters.is_none() => {
                    self.elaborator.define_value(number, d.body);
                }
                Statement::Energy(energy) => self.energy(energy),
                Statement::Domain(domain) => self.domain(domain),
                Statement::Definition(_) | Statement::Source(_) | Statement::Dimensions(_) => {}
            }
        }
    }

    fn parameter(&mut self, p: &ParameterAst, sound: bool) {
        let none = UnitValue { dimension: Dimension::NONE, scale: 1.0 };
        if !sound {
            self.variant.defaults.push(None);
            self.variant.units.push(none);
            self.elaborator.parameter_quantities.push(Quantity::Any);
            return;
        }
        let errors = self.elaborator.errors.len();
        let unit = p.unit.as_ref().map_or(none, |unit| self.unit(unit));
        // A unit that is not understood must not cause further errors.
        let understood = self.elaborator.errors.len() == errors;
        let default = p.default.and_then(|default| self.elaborator.constant(default));
        self.variant.defaults.push(default);
        self.variant.units.push(unit);
        let known = self.has_units && understood;
        let quantity = if known { Quantity::Known(unit.dimension) } else { Quantity::Any };
        self.elaborator.parameter_quantities.push(quantity);
    }

    fn unit(&mut self, unit: &piola_grammar::ast::Unit) -> UnitValue {
        let mut dimension = Dimension::NONE;
        let mut scale = 1.0;
        for factor in &unit.factors {
            let name = &factor.name;
            let Some(base) = named_unit(&name.name) else {
                let error = unknown_unit(&name.name, name.span);
                self.elaborator.report(error);
                continue;
            };
            let exponent = match factor.exponent {
                Some(exponent) => self.elaborator.constant(exponent).unwrap_or(1.0),
                None => 1.0,
            };
            let exponent = if factor.divided { -exponent } else { exponent };
            match base.dimension.power(exponent) {
                Some(power) => dimension = dimension.times(power),
                None => {
                    let message =
                        format!("{} to the power {exponent} has no sensible unit", name.name);
                    let error = Diagnostic::error("unknown-unit", name.span, message);
                    self.elaborator.report(error);
                }
            }
            scale *= libm::pow(base.scale, exponent);
        }
        UnitValue { dimension, scale }
    }

    fn energy(&mut self, energy: &EnergyAst) {
        let Some(measure) = Measure::from_symbol(&energy.measure.name) else {
            let error = unknown_measure(energy);
            self.elaborator.report(error);
            return;
        };
        let Some(value) = self.elaborator.expression(energy.body) else { return };
        let Some(quantity) = self.elaborator.number(value, energy.body) else { return };
        if !self.only_measure(measure, value, energy) {
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

    fn wrong_energy_unit(
        &mut self,
        energy: &EnergyAst,
        measure: Measure,
        quantity: Quantity,
        wanted: Dimension,
    ) {
        let d = self.variant.dimension;
        let symbol = measure.symbol();
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

    /// Whether the energy depends on no other measure; reports the first place where it does.
    fn only_measure(&mut self, measure: Measure, value: Value, energy: &EnergyAst) -> bool {
        let others = value.uses & !(1 << (measure as u8));
        if others == 0 {
            return true;
        }
        let other = Measure::ALL
            .into_iter()
            .find(|m| others & (1 << (*m as u8)) != 0)
            .expect("a bit is set");
        let arena = &self.ast.arena;
        let is_other = |name: &str| name == other.symbol() || name == other.reference_symbol();
        let place = parts(arena, energy.body)
            .into_iter()
            .find(|id| matches!(&arena[*id].kind, ExprKind::Name(name) if is_other(name)));
        let span = arena[place.unwrap_or(energy.body)].span;
        let (own, foreign) = (measure.symbol(), other.symbol());
        let message = format!(
            "psi({own}) is the energy of a {} and cannot depend on `{foreign}`",
            measure.interaction()
        );
        self.elaborator.report(
            Diagnostic::error("wrong-measure", span, message)
                .label(format!("a measure of a {}", other.interaction()))
                .note(energy.head, format!("an energy of `{own}`"))
                .help(format!("write this part as an energy of its own: `psi({foreign}) = ..`"))
                .help(format!(
                    "or, if it is meant as a parameter, choose another name than `{foreign}`"
                )),
        );
        false
    }

    fn domain(&mut self, domain: &piola_grammar::ast::Domain) {
        let bounds = (self.bound(&domain.lower), self.bound(&domain.upper));
        let Some(value) = self.elaborator.expression(domain.quantity) else { return };
        if self.elaborator.number(value, domain.quantity).is_none() {
            return;
        }
        let (Some(lower), Some(upper)) = bounds else { return };
        let measures: Vec<Measure> =
            Measure::ALL.into_iter().filter(|m| value.uses & (1 << (*m as u8)) != 0).collect();
        let &[measure] = measures.as_slice() else {
            let span = self.ast.arena[domain.quantity].span;
            let message = "a domain bounds a quantity of one measure";
            self.elaborator.report(
                Diagnostic::error("wrong-measure", span, message)
                    .help("write for instance `domain l/L in (0, 10]`"),
            );
            return;
        };
        if lower.0 >= upper.0 {
            let message = format!("the domain is empty: {} is not below {}", lower.0, upper.0);
            self.elaborator.report(Diagnostic::error("empty-domain", domain.span, message));
            return;
        }
        let text = print_expression(&self.ast.arena, domain.quantity);
        self.variant.domains.push(Interval { measure, root: value.node, lower, upper, text });
    }

    fn bound(&mut self, bound: &piola_grammar::ast::Bound) -> Option<(f64, bool)> {
        let arena = &self.ast.arena;
        let infinite = |id| matches!(&arena[id].kind, ExprKind::Name(name) if name == "inf");
        let value = match &arena[bound.value].kind {
            ExprKind::Unary { operand, .. } if infinite(*operand) => f64::NEG_INFINITY,
            _ if infinite(bound.value) => f64::INFINITY,
            _ => self.elaborator.constant(bound.value)?,
        };
        Some((value, bound.inclusive))
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

/// The unit after the number in "200 GPa", or why it is none.
pub(crate) fn unknown_unit(name: &str, span: Span) -> Diagnostic {
    let error = Diagnostic::error("unknown-unit", span, format!("unknown unit `{name}`"))
        .label("not a unit");
    if let Some((first, second)) = product_of_units(name) {
        return error.help(format!("a product is written with `*`: `{first}*{second}`"));
    }
    match suggest(name, unit_names()) {
        Some(near) => error.help(format!("did you mean `{near}`?")),
        None => error.help("units are m, kg, s, K, N, J, Pa, W, Hz with prefixes n u m k M G"),
    }
}

/// The two units that a name such as `Nm` runs together.
fn product_of_units(name: &str) -> Option<(&str, &str)> {
    let cuts = name.char_indices().skip(1).map(|(at, _)| name.split_at(at));
    let mut products =
        cuts.filter(|(first, second)| named_unit(first).is_some() && named_unit(second).is_some());
    products.next()
}

fn unknown_measure(energy: &EnergyAst) -> Diagnostic {
    let name = &energy.measure.name;
    let error = Diagnostic::error(
        "unknown-measure",
        energy.measure.span,
        format!("`{name}` is not a measure of an interaction"),
    )
    .label("psi is a function of `l`, `a` or `v`");
    match name.as_str() {
        "L" | "A" | "V" => error
            .help(format!("`{name}` is the value at rest; write `psi({})`", name.to_lowercase())),
        _ => error.help("l: length of a bond, a: area of a triangle, v: volume of a tetrahedron"),
    }
}
