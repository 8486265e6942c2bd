//! From the parts of one statement, as the grammar found them, to the tree.

use pest::iterators::{Pair, Pairs};

use super::Builder;
use super::parser::Rule;
use crate::ast::{
    Allow, Bound, Break, Definition, Domain, Energy, ExprId, ExprKind, Ident, Parameter, Statement,
    Text, UnaryOperator, Unit, UnitFactor, Update,
};
use crate::names;
use crate::{Diagnostic, Span};

/// Measures and their values at rest: no gathered value has such a name.
const MEASURES: [&str; 7] = ["l", "L", "a", "A", "v", "V", "F"];

/// Most entries of a vector of parameters.
const MAX_ENTRIES: u32 = 100;

/// What a logical line holds.
pub(super) enum Line {
    /// `potential NAME ["title"]`
    Potential { name: crate::ast::Ident, title: Option<Text>, span: Span },
    /// Any other statement.
    Statement(Statement),
}

impl Builder {
    /// Builds a statement; `None` only if the grammar did not make the pair.
    pub(super) fn statement(&mut self, pair: Pair<'_, Rule>) -> Option<Line> {
        let rule = pair.as_rule();
        let span = self.span(&pair);
        let mut parts = pair.into_inner();
        let statement = match rule {
            Rule::potential => {
                let name = take(&mut parts, Rule::name)?;
                let name = self.ident(&name);
                let title = self.optional_text(&mut parts);
                return Some(Line::Potential { name, title, span });
            }
            Rule::source => Statement::Source(self.text(&take(&mut parts, Rule::string)?)),
            Rule::import => {
                let file = self.text(&take(&mut parts, Rule::string)?);
                let span = Span { start: span.start, end: file.span.end };
                Statement::Import(file, span)
            }
            Rule::allow => {
                let code = self.text(&take(&mut parts, Rule::string)?);
                Statement::Allow(Allow { code, reason: self.optional_text(&mut parts) })
            }
            Rule::dimensions => Statement::Dimensions(self.dimensions(parts)),
            Rule::weights => Statement::Weights(self.weights(&take(&mut parts, Rule::name)?)),
            Rule::parameter => Statement::Parameter(self.parameter(parts, false)?),
            Rule::state => Statement::Parameter(self.parameter(parts, true)?),
            Rule::update => Statement::Update(self.update(span, parts)?),
            Rule::domain => Statement::Domain(self.domain(span.start, parts)?),
            Rule::breaking => Statement::Break(self.breaking(span, parts)?),
            Rule::energy => Statement::Energy(self.energy(parts)?),
            Rule::dissipation => Statement::Dissipation(self.dissipation(parts)?),
            Rule::definition => Statement::Definition(self.definition(parts)?),
            _ => return None,
        };
        Some(Line::Statement(statement))
    }

    fn dimensions(&mut self, parts: Pairs<'_, Rule>) -> Vec<(u8, Span)> {
        let mut dimensions = Vec::new();
        for part in parts.filter(|part| part.as_rule() == Rule::dimension) {
            let span = self.span(&part);
            match part.as_str() {
                "2" => dimensions.push((2, span)),
                "3" => dimensions.push((3, span)),
                other => self.findings.push(
                    Diagnostic::error("syntax", span, format!("there is no dimension {other}"))
                        .help("write `dimensions 2`, `dimensions 3` or `dimensions 2, 3`"),
                ),
            }
        }
        dimensions
    }

    /// An energy of other weights has other units or other constants; scenes choose among those.
    fn weights(&mut self, word: &Pair<'_, Rule>) -> Span {
        let span = self.span(word);
        if word.as_str() != "volumes" {
            let message = format!("an energy cannot ask for weights `{}`", word.as_str());
            let finding = Diagnostic::error("syntax", span, message).label("expected `volumes`");
            self.findings.push(
                finding.help(
                    "write `weights volumes`, or leave the line out and let the scene choose",
                ),
            );
        }
        span
    }

    fn parameter(&mut self, mut parts: Pairs<'_, Rule>, is_state: bool) -> Option<Parameter> {
        let name = take(&mut parts, Rule::name)?;
        let name = self.ident(&name);
        self.refuse_psi(&name.name, name.span);
        let mut parameter = Parameter {
            is_state,
            name,
            size: None,
            defaults: Vec::new(),
            unit: None,
            constraints: Vec::new(),
            description: None,
        };
        let mut after_comma = false;
        for part in parts {
            match part.as_rule() {
                Rule::expression => {
                    let id = self.expression(part)?.id;
                    if after_comma {
                        parameter.constraints.push(id);
                    } else {
                        parameter.defaults.push(id);
                    }
                }
                Rule::size => parameter.size = Some(self.size(part)?),
                Rule::entries => {
                    for entry in part.into_inner().filter(|p| p.as_rule() == Rule::expression) {
                        parameter.defaults.push(self.expression(entry)?.id);
                    }
                }
                Rule::unit => parameter.unit = Some(self.unit(part)?),
                Rule::comma => after_comma = true,
                Rule::string => parameter.description = Some(self.text(&part)),
                _ => {}
            }
        }
        Some(parameter)
    }

    /// How many entries a vector has.
    fn size(&mut self, pair: Pair<'_, Rule>) -> Option<(u32, Span)> {
        let number = take(&mut pair.into_inner(), Rule::whole)?;
        let span = self.span(&number);
        let size = number.as_str().parse().unwrap_or(u32::MAX);
        if !(1..=MAX_ENTRIES).contains(&size) {
            let message = format!("a vector of parameters has 1 to {MAX_ENTRIES} entries");
            self.findings.push(Diagnostic::error("syntax", span, message));
        }
        Some((size, span))
    }

    fn definition(&mut self, mut parts: Pairs<'_, Rule>) -> Option<Definition> {
        let name = take(&mut parts, Rule::name)?;
        let name = self.ident(&name);
        self.refuse_psi(&name.name, name.span);
        let (mut parameters, mut body, mut unit) = (None, None, None);
        for part in parts {
            match part.as_rule() {
                Rule::formals => {
                    let names = part.into_inner().filter(|part| part.as_rule() == Rule::name);
                    parameters = Some(names.map(|name| self.ident(&name)).collect());
                }
                Rule::expression => body = Some(self.expression(part)?.id),
                Rule::unit => unit = Some(self.unit(part)?),
                _ => {}
            }
        }
        if let (Some(_), Some(Unit { span, .. })) = (&parameters, &unit) {
            let finding = Diagnostic::error("syntax", *span, "a function is not stated in a unit");
            self.findings.push(finding.label("the unit of what?").help(
                "a function has the unit of what stands on its right; name a value with a unit, as \
                 in `Y0 = 250 in MPa`, and multiply by it",
            ));
        }
        Some(Definition { name, parameters, body: body?, unit })
    }

    /// `psi` is what a potential defines; it is not free for anything else.
    fn refuse_psi(&mut self, name: &str, span: Span) {
        if name == "psi" {
            let finding = Diagnostic::error(
                "reserved-word",
                span,
                "`psi` is always the energy of one measure",
            )
            .label("expected the one measure of an energy")
            .help("write `psi(l) = ...`, `psi(a) = ...` or `psi(v) = ...`");
            self.findings.push(finding);
        }
    }

    fn energy(&mut self, mut parts: Pairs<'_, Rule>) -> Option<Energy> {
        let head = take(&mut parts, Rule::energy_head)?;
        let span = self.span(&head);
        let psi_length = if head.as_str().starts_with("psi") { 3 } else { "\u{03C8}".len() as u32 };
        let names = head.into_inner().filter(|part| part.as_rule() == Rule::name);
        let mut names = names.map(|name| self.ident(&name)).collect::<Vec<_>>().into_iter();
        let measure = names.next()?;
        let gathered: Vec<Ident> = names.collect();
        // An energy has one measure.
        let is_measure = |name: &Ident| MEASURES.contains(&name.name.as_str());
        if let Some(second) = gathered.iter().find(|name| is_measure(name)) {
            let place = Span { start: span.start, end: span.start + psi_length };
            let (first, second) = (&measure.name, &second.name);
            let help = match second.as_str() {
                "L" | "A" | "V" => {
                    format!("write `psi({first}) = ..`; its right side may hold `{second}`")
                }
                _ => format!(
                    "write two energies, `psi({first}) = ..` and `psi({second}) = ..`: a body has \
                     their sum"
                ),
            };
            let mut error =
                Diagnostic::error("reserved-word", place, "an energy is a function of one measure")
                    .label("expected the one measure of an energy")
                    .help(help);
            error.helps.extend(coupled(first, second));
            self.findings.push(error);
        }
        let body = self.expression(take(&mut parts, Rule::expression)?)?.id;
        Some(Energy { measure, gathered, body, head: span })
    }

    fn dissipation(&mut self, mut parts: Pairs<'_, Rule>) -> Option<Energy> {
        let head = take(&mut parts, Rule::dissipation_head)?;
        let span = self.span(&head);
        let names = head.into_inner().filter(|part| part.as_rule() == Rule::name);
        let mut names = names.map(|name| self.ident(&name)).collect::<Vec<_>>().into_iter();
        let measure = names.next()?;
        let gathered: Vec<Ident> = names.collect();
        if let Some(second) = gathered.first() {
            let message = "a dissipation is one of the length of a bond";
            let error = Diagnostic::error("syntax", second.span, message);
            self.findings.push(error.label("one name too many").help(
                "write `dissipation(l) = ..`; its right side may hold `rate(l)`, `l`, `L`, `delta` and \
                 parameters",
            ));
        }
        let body = self.expression(take(&mut parts, Rule::expression)?)?.id;
        Some(Energy { measure, gathered, body, head: span })
    }

    fn domain(&mut self, start: u32, mut parts: Pairs<'_, Rule>) -> Option<Domain> {
        let quantity = self.expression(take(&mut parts, Rule::expression)?)?.id;
        let opening = take(&mut parts, Rule::open_bound)?;
        let lower = self.expression(take(&mut parts, Rule::expression)?)?.id;
        let upper = self.expression(take(&mut parts, Rule::expression)?)?.id;
        let closing = take(&mut parts, Rule::close_bound)?;
        Some(Domain {
            quantity,
            lower: Bound { value: lower, inclusive: opening.as_str() == "[" },
            upper: Bound { value: upper, inclusive: closing.as_str() == "]" },
            span: Span { start, end: self.span(&closing).end },
        })
    }

    fn breaking(&mut self, span: Span, mut parts: Pairs<'_, Rule>) -> Option<Break> {
        let condition = self.expression(take(&mut parts, Rule::expression)?)?.id;
        Some(Break { condition, reason: self.optional_text(&mut parts), span })
    }

    fn update(&mut self, span: Span, mut parts: Pairs<'_, Rule>) -> Option<Update> {
        let state = take(&mut parts, Rule::name)?;
        let state = self.ident(&state);
        let mut parts = parts.peekable();
        let index = parts.next_if(|part| part.as_rule() == Rule::index);
        let index = index.and_then(|index| take(&mut index.into_inner(), Rule::name));
        let index = index.map(|name| self.ident(&name));
        let body = parts.find(|part| part.as_rule() == Rule::expression)?;
        let body = self.expression(body)?.id;
        Some(Update { state, index, body, span })
    }

    /// Builds a product of powers of units.
    pub(super) fn unit(&mut self, pair: Pair<'_, Rule>) -> Option<Unit> {
        let start = self.span(&pair);
        let mut span = Span { start: start.start, end: start.start };
        let mut factors = Vec::new();
        let mut divided = false;
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::unit_one => span = span.to(self.span(&part)),
                Rule::unit_operator => divided = part.as_str().starts_with('/'),
                Rule::unit_factor => {
                    let (factor, end) = self.unit_factor(part, divided)?;
                    span.end = end;
                    factors.push(factor);
                }
                _ => {}
            }
        }
        Some(Unit { factors, span })
    }

    /// One factor and where it ends.
    fn unit_factor(&mut self, pair: Pair<'_, Rule>, divided: bool) -> Option<(UnitFactor, u32)> {
        let mut parts = pair.into_inner();
        let unit = take(&mut parts, Rule::name)?;
        let mut name = self.ident(&unit);
        // In front of a unit the letter is the prefix micro: `µm` is `um`, not `mum`.
        if let Some(rest) = unit.as_str().strip_prefix(['μ', '\u{00B5}']) {
            name.name = format!("u{}", names::spell_out(rest));
        }
        let mut end = name.span.end;
        let mut exponent = None;
        if let Some(power) = parts.find(|part| part.as_rule() == Rule::exponent) {
            let (id, exponent_end) = self.exponent(power)?;
            exponent = Some(id);
            end = exponent_end;
        }
        Some((UnitFactor { name, exponent, divided }, end))
    }

    fn exponent(&mut self, pair: Pair<'_, Rule>) -> Option<(ExprId, u32)> {
        let mut sign = None;
        for part in pair.into_inner() {
            if part.as_rule() == Rule::minus {
                sign = Some(self.span(&part));
                continue;
            }
            let operand = self.operand(part)?;
            let end = operand.outer.end;
            let id = match sign {
                None => operand.id,
                Some(sign) => {
                    let operator = UnaryOperator::Negate;
                    let kind = ExprKind::Unary { operator, operand: operand.id };
                    self.arena.push(kind, sign.to(operand.outer))
                }
            };
            return Some((id, end));
        }
        None
    }

    fn optional_text(&self, parts: &mut Pairs<'_, Rule>) -> Option<Text> {
        take(parts, Rule::string).map(|pair| self.text(&pair))
    }

    pub(super) fn text(&self, pair: &Pair<'_, Rule>) -> Text {
        let quoted = pair.as_str();
        let text = quoted.get(1..quoted.len().saturating_sub(1)).unwrap_or_default().to_string();
        Text { text, span: self.span(pair) }
    }
}

/// The next part made by this rule.
pub(super) fn take<'t>(parts: &mut Pairs<'t, Rule>, rule: Rule) -> Option<Pair<'t, Rule>> {
    parts.find(|part| part.as_rule() == rule)
}

/// How a triangle or a tetrahedron is coupled to its parts, where a head names two measures for it.
fn coupled(first: &str, second: &str) -> Option<String> {
    let help = match (first, second) {
        ("a", "l") | ("l", "a") => "or, of a triangle and its sides, `psi(a, l1, l2, l3) = ..`",
        ("v", "a") | ("a", "v") => {
            "or, of a tetrahedron and its faces, `psi(v, a1, a2, a3, a4) = ..`"
        }
        ("v", "l") | ("l", "v") => {
            "or, of a tetrahedron and its edges, `psi(v, l1, l2, l3, l4, l5, l6) = ..`"
        }
        (part, "a" | "v") if !MEASURES.contains(&part) => {
            return Some(format!(
                "the measure of the whole stands first: `psi({second}, {part}) = ..`"
            ));
        }
        _ => return None,
    };
    Some(help.to_string())
}
