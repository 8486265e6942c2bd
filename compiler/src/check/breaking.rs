//! Conditions under which bonds, triangles and tetrahedra break, as margins: numbers that are above 0 where a
//! condition holds.
//!
//! A margin says more than a truth value: how far a bond is from breaking, and at which load it breaks
//! first. `x > y` becomes `x - y`, `and` the smaller of two margins, `or` the larger, `not` the negative.
//! What holds where its margin is 0 differs between `>` and `>=` alone, and is known of the whole.

use piola_grammar::ast::{Break as BreakAst, ExprId, ExprKind, Statement};
use piola_grammar::{Diagnostic, print_expression};

use super::names::parts;
use super::statement::Builder;
use super::value::{GRADIENT, INTEGRAL, PART, RATE, Value};
use crate::expression::{Comparison, ExprGraph, Function, Node, NodeId, Operator, TooManyNodes};
use crate::measure::Measure;
use crate::model::{Break, Of, OfFamily, Variant};

/// The bit of [`Value::uses`] for lengths of bonds.
pub(super) const LENGTH: u8 = bit(Measure::Length);

/// The bits of all measures.
pub(super) const ALL_MEASURES: u8 = LENGTH | bit(Measure::Area) | bit(Measure::Volume);

/// The bit of [`Value::uses`] for a measure.
const fn bit(measure: Measure) -> u8 {
    1 << (measure as u8)
}

/// The measures among what a value uses.
pub(super) fn measures_in(uses: u8) -> Vec<Measure> {
    Measure::ALL.into_iter().filter(|measure| uses & bit(*measure) != 0).collect()
}

impl Builder<'_> {
    /// The condition of `break when CONDITION "reason"`, where it is one.
    pub(super) fn condition(&mut self, breaking: &BreakAst) -> Option<Value> {
        let value = self.elaborator.expression(breaking.condition)?;
        self.elaborator.truth(value, breaking.condition)?;
        Some(value)
    }

    /// `break when CONDITION "reason"`, with what its condition is; states are of known kinds.
    pub(super) fn breaking(&mut self, breaking: &BreakAst, value: Value) {
        let arena = &self.ast.arena;
        let (condition, span) = (breaking.condition, arena[breaking.condition].span);
        let Some(subject) = self.subject_of(breaking, value) else { return };
        match margin(&mut self.elaborator.graph, value.node) {
            Ok(Some(Margin { root, inclusive })) => {
                let condition = Break {
                    of: (),
                    root,
                    holds_at_zero: inclusive.unwrap_or(false),
                    span,
                    text: print_expression(arena, condition),
                    reason: breaking.reason.as_ref().map(|text| text.text.clone()),
                };
                match subject {
                    Of::Measure(measure) => self.variant.breaks.push(condition.of(measure)),
                    Of::Family(family) => self.variant.family_breaks.push(condition.of(family)),
                }
            }
            Ok(None) => {
                let message = "this condition has no one threshold";
                self.elaborator.report(
                    Diagnostic::error("no-threshold", span, message)
                        .label("`>` or `<` beside `>=` or `<=`, or `==`")
                        .help(
                            "compare with `>` and `<` alone, or with `>=` and `<=` alone, and write \
                             several lines with `break when` for what should differ",
                        ),
                );
            }
            Err(TooManyNodes) => self.elaborator.out_of_room(span),
        }
    }

    /// What the condition is one of, as for `domain`: it holds one measure, or deformation gradients
    /// alone, or what points gather. Reports it if not.
    fn subject_of(&mut self, breaking: &BreakAst, value: Value) -> Option<Of> {
        let arena = &self.ast.arena;
        let span = arena[breaking.condition].span;
        let foreign = value.uses & !ALL_MEASURES;
        let remembering = self.kinds_in(value.node);
        let of_one = |family| remembering.iter().all(|kind| *kind == Of::Family(family));
        let remembers = !remembering.is_empty();
        if (value.uses == GRADIENT || value.uses == 0 && remembers) && of_one(OfFamily::Gradient) {
            return Some(Of::Family(OfFamily::Gradient));
        }
        let is_gathered = value.uses & !(LENGTH | PART) == INTEGRAL;
        let is_gathered = is_gathered && !self.elaborator.holds_parts(&[value.node]);
        if (is_gathered || value.uses & !LENGTH == 0 && remembers) && of_one(OfFamily::Points) {
            let of_bonds = value.uses & LENGTH != 0 || self.sees_bond(value.node);
            let family = if of_bonds { OfFamily::Bonds } else { OfFamily::Points };
            return Some(Of::Family(family));
        }
        let held = measures_in(value.uses).into_iter().map(Of::Measure);
        let mut held: Vec<Of> = held.chain(remembering.iter().copied()).collect();
        held.sort_unstable();
        held.dedup();
        let example = "write for instance `break when l/L - 1 > s0 \"critical stretch\"`";
        let error = match held[..] {
            _ if foreign & GRADIENT != 0 => {
                let message = "a condition is one of a measure or of the deformation gradient";
                self.not_of_bonds(breaking.condition, foreign, message).help(
                    "write a line with `break when` for each: any of them is enough to break a bond",
                )
            }
            _ if foreign != 0 => {
                let message = "bonds, triangles and tetrahedra break by their own measures alone";
                self.not_of_bonds(breaking.condition, foreign, message).help(example)
            }
            [Of::Measure(measure)] => return Some(Of::Measure(measure)),
            [] => Diagnostic::error("wrong-measure", span, "this condition says nothing of a bond")
                .label("the same for all bonds at all times")
                .help(example),
            _ => {
                let message = "a condition is one of bonds, of triangles or of tetrahedra";
                let whose = |one: &Of| match remembering.contains(one) {
                    true => format!("what {} remember", one.many()),
                    false => format!("`{}`", one.symbol()),
                };
                let all: Vec<String> = held.iter().map(whose).collect();
                Diagnostic::error("wrong-measure", span, message)
                    .label(format!("holds {}", all.join(" and ")))
                    .help("write a line with `break when` for each: any of them breaks its own")
            }
        };
        self.elaborator.report(error);
        None
    }

    /// Refuses conditions and states of gathered values where no energy gathers any.
    pub(super) fn check_gathered(&mut self) {
        // What is wrong with an energy is told there.
        let is_gathered = |one: &Statement| match one {
            Statement::Energy(one) => {
                let head = &one.measure.name;
                !one.gathered.is_empty() || Measure::from_symbol(head).is_none() && head != "F"
            }
            _ => false,
        };
        if self.ast.statements.iter().any(is_gathered) {
            return;
        }
        let Variant { family_breaks, family_updates, .. } = &self.variant;
        let breaks = family_breaks.iter().map(|one| ("condition", one.of, one.span));
        let updates = family_updates.iter().map(|one| ("next state", one.of, one.span));
        let mut all = breaks.chain(updates);
        let Some((what, _, span)) = all.find(|one| one.1 != OfFamily::Gradient) else { return };
        let message = format!("this {what} holds what points gather, and no energy does");
        let error = Diagnostic::error("wrong-measure", span, message)
            .label("points gather for energies")
            .help("add an energy of gathered values: `psi(theta) = ..`, `psi(l, theta) = ..`");
        self.elaborator.report(error);
    }

    /// An expression that depends on more than a bond, at the first place where it does.
    pub(super) fn not_of_bonds(&self, root: ExprId, foreign: u8, message: &str) -> Diagnostic {
        let arena = &self.ast.arena;
        let (what, names): (&str, &[&str]) = match foreign {
            uses if uses & GRADIENT != 0 => {
                ("the deformation gradient", &["F", "J", "C", "E", "U"])
            }
            uses if uses & INTEGRAL != 0 => ("what points gather", &[]),
            uses if uses & RATE != 0 => ("how fast its length changes", &[]),
            uses if uses == PART => ("the vector of the bond, and not its length", &["xi"]),
            _ => ("a measure of triangles or tetrahedra", &["a", "A", "v", "V"]),
        };
        let place = parts(arena, root).into_iter().find(
            |id| matches!(&arena[*id].kind, ExprKind::Name(name) if names.contains(&&**name)),
        );
        let span = arena[place.unwrap_or(root)].span;
        Diagnostic::error("wrong-measure", span, message).label(what)
    }
}

/// A number with the sign of a condition.
#[derive(Clone, Copy)]
struct Margin {
    root: NodeId,
    /// Whether the condition holds where it is 0; nothing where it is never 0.
    inclusive: Option<bool>,
}

impl Margin {
    /// Whether two conditions agree on what holds at 0, and what that is.
    fn agree(self, other: Margin) -> Option<Option<bool>> {
        match (self.inclusive, other.inclusive) {
            (Some(one), Some(other)) if one != other => None,
            (one, other) => Some(one.or(other)),
        }
    }
}

/// The margin of a truth value; nothing where there is no one threshold.
fn margin(graph: &mut ExprGraph, root: NodeId) -> Result<Option<Margin>, TooManyNodes> {
    let needed = graph.reachable(&[root]);
    let nodes: Vec<(NodeId, Node)> =
        graph.nodes().filter(|(id, _)| needed[id.0 as usize]).collect();
    let mut margins: Vec<Option<Margin>> = vec![None; needed.len()];
    for (id, node) in nodes {
        let of = |x: NodeId| margins[x.0 as usize];
        let made = match node {
            Node::Truth(holds) => {
                let root = graph.intern(Node::number(if holds { 1.0 } else { -1.0 }))?;
                Some(Margin { root, inclusive: None })
            }
            Node::Compare(comparison, x, y) => {
                let (x, y, inclusive) = match comparison {
                    Comparison::Greater => (x, y, false),
                    Comparison::GreaterEqual => (x, y, true),
                    Comparison::Less => (y, x, false),
                    Comparison::LessEqual => (y, x, true),
                    Comparison::Equal | Comparison::NotEqual => continue,
                };
                let root = graph.intern(Node::Binary(Operator::Subtract, x, y))?;
                Some(Margin { root, inclusive: Some(inclusive) })
            }
            Node::Not(x) => match of(x) {
                Some(Margin { root, inclusive }) => {
                    let root = graph.intern(Node::Unary(Function::Negate, root))?;
                    Some(Margin { root, inclusive: inclusive.map(|inclusive| !inclusive) })
                }
                None => None,
            },
            Node::And(x, y) | Node::Or(x, y) => {
                let operator =
                    if matches!(node, Node::And(..)) { Operator::Min } else { Operator::Max };
                joined(graph, of(x), of(y), |x, y| Node::Binary(operator, x, y))?
            }
            Node::Select(c, x, y) => joined(graph, of(x), of(y), |x, y| Node::Select(c, x, y))?,
            _ => None,
        };
        margins[id.0 as usize] = made;
    }
    Ok(margins[root.0 as usize])
}

fn joined(
    graph: &mut ExprGraph,
    x: Option<Margin>,
    y: Option<Margin>,
    node: impl Fn(NodeId, NodeId) -> Node,
) -> Result<Option<Margin>, TooManyNodes> {
    let (Some(x), Some(y)) = (x, y) else { return Ok(None) };
    let Some(inclusive) = x.agree(y) else { return Ok(None) };
    let root = graph.intern(node(x.root, y.root))?;
    Ok(Some(Margin { root, inclusive }))
}
