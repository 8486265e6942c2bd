//! What bonds, triangles, tetrahedra and points remember: states, and what these become.
//!
//! A state is one of bonds, of triangles or of tetrahedra: that of the measure that its update holds; or one of
//! deformation gradients, or of points by what they gather. Where its update holds none of these, the states in
//! it say so, or else the lines that hold the state.

use std::collections::HashMap;

use piola_grammar::ast::{Statement, Update as UpdateAst};
use piola_grammar::{Diagnostic, Span, print_expression};

use super::breaking::{ALL_MEASURES, LENGTH, measures_in};
use super::elaborate::Elaborator;
use super::statement::Builder;
use super::symbols::Symbol;
use super::value::{GRADIENT, INTEGRAL, Quantity, Value};
use crate::expression::{Input, Node, NodeId};
use crate::measure::Measure;
use crate::model::{Of, OfFamily, TIME_STEP, Update};

/// What to write where kinds meet.
const EACH_ITS_OWN: &str = "a state is one of bonds, of triangles, of tetrahedra, of deformation gradients or of \
                            points by what they gather: write one of its own for each, with its own `update`";

impl Elaborator<'_> {
    /// Whether any of these nodes depends on a state.
    pub(super) fn depends_on_states(&self, roots: &[NodeId]) -> bool {
        !self.states_in(roots).is_empty()
    }

    /// The states on which any of these nodes depends, ascending.
    pub(super) fn states_in(&self, roots: &[NodeId]) -> Vec<usize> {
        if self.symbols.states.is_empty() {
            return Vec::new();
        }
        let needed = self.graph.reachable(roots);
        let nodes = self.graph.nodes().filter(|(id, _)| needed[id.0 as usize]);
        let mut states: Vec<usize> = nodes
            .filter_map(|(_, node)| match node {
                Node::Input(Input::Parameter(number)) => Some(usize::from(number)),
                _ => None,
            })
            .filter(|number| self.symbols.states.binary_search(number).is_ok())
            .collect();
        states.sort_unstable();
        states
    }
}

/// A line, with the kind that it says and the states that it holds.
struct Line {
    of: Option<Of>,
    states: Vec<usize>,
}

/// Where a state may stand.
pub(super) struct Place {
    /// In words.
    pub(super) what: String,
    /// Of which kind; nothing where no state may stand.
    of: Option<Of>,
    pub(super) root: NodeId,
    pub(super) span: Span,
    knows_time_step: bool,
}

impl Builder<'_> {
    /// `update NAME = NEXT`; of which kind the state is, is found later.
    pub(super) fn update(&mut self, update: &UpdateAst) {
        let arena = &self.ast.arena;
        let (name, span) = (&update.state, arena[update.body].span);
        let Some(value) = self.elaborator.expression(update.body) else { return };
        let Some(quantity) = self.elaborator.number(value, update.body) else { return };
        // A name that is no state was reported before.
        let Some(Symbol::Parameter(state)) = self.elaborator.symbols.get(&name.name) else {
            return;
        };
        let Some(of) = self.kind_of_update(update, value) else {
            self.states_of_no_kind.push(state);
            return;
        };
        let own = self.elaborator.parameter_quantities.get(state).copied();
        let own = own.unwrap_or(Quantity::Any);
        if self.has_units && own.unify(quantity).is_none() {
            let (of_state, found) = (own.describe(), quantity.describe());
            let message = format!("`{}` is {of_state} and cannot become {found}", name.name);
            let error = Diagnostic::error("dimension-mismatch", span, message).label(found);
            self.elaborator.report(
                error.help(match own {
                    Quantity::Known(unit) if unit.is_none() => {
                        "a state has a unit where its declaration names one: `state w = 0 in J/m^3`"
                            .to_string()
                    }
                    _ => format!("write an expression that is {of_state}"),
                }),
            );
            return;
        }
        if self.updates.iter().any(|known| known.state == state) {
            let first = self.ast.statements.iter().find_map(|statement| match statement {
                Statement::Update(known) if known.state.name == name.name => Some(known.state.span),
                _ => None,
            });
            let message = format!("`{}` is updated twice", name.name);
            let error = Diagnostic::error("duplicate-statement", name.span, message)
                .note(first.unwrap_or(name.span), "first updated here")
                .help("say in one line what it becomes: `if .. then .. else ..`, `max(.., ..)`");
            self.elaborator.report(error);
            return;
        }
        let text = print_expression(arena, update.body);
        self.updates.push(Update { state, of, root: value.node, span, text });
    }

    /// What an update holds by which its state is of a kind, if it holds anything; nothing at all where it
    /// cannot be, which is reported.
    fn kind_of_update(&mut self, update: &UpdateAst, value: Value) -> Option<Option<Of>> {
        match value.uses {
            GRADIENT => return Some(Some(Of::Family(OfFamily::Gradient))),
            INTEGRAL => return Some(Some(Of::Family(OfFamily::Points))),
            _ => {}
        }
        let foreign = value.uses & !ALL_MEASURES;
        let held = measures_in(value.uses);
        let span = self.ast.arena[update.body].span;
        let error = match held[..] {
            _ if foreign == INTEGRAL && value.uses == INTEGRAL | LENGTH => {
                let message = "what points gather is remembered by points, and lengths by bonds";
                self.not_of_bonds(update.body, foreign, message).help(
                    "write a state of points, `update p = max(p, theta)`, and one of bonds, \
                     `update k = max(k, l/L - 1)`",
                )
            }
            _ if foreign != 0 => {
                let message =
                    "a state is one of a measure, of deformation gradients, or of gathered values";
                self.not_of_bonds(update.body, foreign, message)
                    .help("write for instance `update k = max(k, l/L - 1)`")
            }
            [] => return Some(None),
            [measure] => return Some(Some(Of::Measure(measure))),
            _ => {
                let message = format!("`{}` would be a state of several kinds", update.state.name);
                let all: Vec<String> = held.iter().map(|m| format!("`{}`", m.symbol())).collect();
                Diagnostic::error("wrong-measure", span, message)
                    .label(format!("holds {}", all.join(" and ")))
                    .help(EACH_ITS_OWN)
            }
        };
        self.elaborator.report(error);
        None
    }

    /// Finds of which kind the states are; `breaks` has the conditions under which something breaks.
    pub(super) fn find_kinds(&mut self, breaks: &[Value]) {
        let line =
            |of: Option<Of>, root: NodeId| Line { of, states: self.elaborator.states_in(&[root]) };
        let variant = &self.variant;
        let mut updates: Vec<Line> =
            self.updates.iter().map(|own| line(own.of, own.root)).collect();
        let conditions =
            breaks.iter().filter_map(|value| Some(line(Some(kind_by(value.uses)?), value.node)));
        let energies = variant.energies.iter().map(|one| (Of::Measure(one.measure), one.root));
        let bonds = Of::Measure(Measure::Length);
        let dissipations = variant.dissipations.iter().map(|one| (bonds, one.root));
        let gradient = Of::Family(OfFamily::Gradient);
        let gradients = variant.gradient_energies.iter().map(|one| (gradient, one.root));
        let points = Of::Family(OfFamily::Points);
        let gathered = variant.gathered_energies.iter().map(|one| (points, one.root));
        let lines = energies.chain(dissipations).chain(gradients).chain(gathered);
        let lines = lines.map(|(of, root)| line(Some(of), root));
        let others: Vec<Line> = lines.chain(conditions).collect();
        let places: HashMap<usize, usize> =
            self.updates.iter().enumerate().map(|(place, own)| (own.state, place)).collect();
        // Each round finds one at least, or is the last.
        loop {
            let found = updates.iter().zip(&self.updates).map(|(own, update)| {
                let of = |state: &usize| updates[*places.get(state)?].of;
                let holds = |line: &&Line| line.states.binary_search(&update.state).is_ok();
                let by_holders = || updates.iter().chain(&others).filter(holds);
                let held = || own.states.iter().find_map(of);
                own.of.or_else(held).or_else(|| by_holders().find_map(|line| line.of))
            });
            let found: Vec<Option<Of>> = found.collect();
            let is_last = found.iter().zip(&updates).all(|(found, line)| *found == line.of);
            updates.iter_mut().zip(found).for_each(|(line, found)| line.of = found);
            if is_last {
                break;
            }
        }
        for (update, line) in std::mem::take(&mut self.updates).into_iter().zip(updates) {
            let of = line.of.unwrap_or(Of::Measure(Measure::Length));
            self.kinds.insert(update.state, of);
            match of {
                Of::Measure(of) => self.variant.updates.push(update.of(of)),
                Of::Family(of) => self.variant.family_updates.push(update.of(of)),
            }
        }
    }

    /// The kind of a state; one that never changes is of bonds.
    pub(super) fn kind(&self, state: usize) -> Of {
        self.kinds.get(&state).copied().unwrap_or(Of::Measure(Measure::Length))
    }

    /// The kinds of the states on which a node depends, each once.
    pub(super) fn kinds_in(&self, root: NodeId) -> Vec<Of> {
        let mut states = self.elaborator.states_in(&[root]);
        // What is wrong with these has been told.
        states.retain(|state| !self.states_of_no_kind.contains(state));
        let mut kinds: Vec<Of> = states.into_iter().map(|state| self.kind(state)).collect();
        kinds.sort_unstable();
        kinds.dedup();
        kinds
    }

    /// Refuses states where nothing remembers or where others do, and time steps where nothing is updated.
    pub(super) fn check_states(&mut self) {
        let time_step = match self.elaborator.symbols.get(TIME_STEP) {
            Some(Symbol::TimeStep(number)) => Some(Input::Parameter(number as u16)),
            _ => None,
        };
        for place in self.places() {
            let Place { what, of, root, span, knows_time_step } = place;
            let foreign = self.kinds_in(root).into_iter().find(|kind| Some(*kind) != of);
            if let Some(kind) = foreign {
                let many = kind.many();
                let message = format!("{what} cannot depend on what {many} remember");
                let label = format!("holds `{}`, a state of {many}", self.state_in(root, kind));
                let help = match of {
                    Some(_) => EACH_ITS_OWN.to_string(),
                    None => format!("write this part as an energy `psi({})`", kind.symbol()),
                };
                let error = Diagnostic::error("wrong-measure", span, message).label(label);
                self.elaborator.report(error.help(help));
            }
            let depends = |dt: Input| self.elaborator.graph.depends_on(&[root], dt);
            if !knows_time_step && time_step.is_some_and(depends) {
                let message = format!("{what} cannot depend on the time step `{TIME_STEP}`");
                let error = Diagnostic::error("wrong-measure", span, message)
                    .help("updates alone know it: `update life = life - rate*dt`");
                self.elaborator.report(error);
            }
        }
    }

    /// All where states might stand.
    pub(super) fn places(&self) -> Vec<Place> {
        let place = |what: String, of: Option<Of>, root: NodeId, span: Span| Place {
            what,
            of,
            root,
            span,
            knows_time_step: false,
        };
        let psi = |head: &str| format!("psi({head})");
        let variant = &self.variant;
        let energies = variant.energies.iter().map(|one| {
            let of = Of::Measure(one.measure);
            place(psi(of.symbol()), Some(of), one.root, one.span)
        });
        let gradients = variant.gradient_energies.iter();
        let of_gradient = Some(Of::Family(OfFamily::Gradient));
        let gradients = gradients.map(|one| place(psi("F"), of_gradient, one.root, one.span));
        let gathered = variant.gathered_energies.iter();
        let of_points = Some(Of::Family(OfFamily::Points));
        let gathered = gathered.map(|one| place(psi(&one.head), of_points, one.root, one.span));
        let coupled = variant.coupled_energies.iter();
        let coupled = coupled.map(|one| place(psi(&one.head), None, one.root, one.span));
        let integrals = variant.integrals.iter();
        let integrals = integrals.map(|one| place("an integral".into(), None, one.root, one.span));
        let breaks = variant.breaks.iter().map(|one| {
            let what = format!("a condition of {}", one.of.interactions());
            place(what, Some(Of::Measure(one.of)), one.root, one.span)
        });
        let of_bonds = Some(Of::Measure(Measure::Length));
        let dissipations = variant
            .dissipations
            .iter()
            .map(|one| place("a dissipation".into(), of_bonds, one.root, one.span));
        let next = |of: Of, root: NodeId, span: Span| {
            let what = format!("what {} remember", of.many());
            Place { knows_time_step: true, ..place(what, Some(of), root, span) }
        };
        let updates =
            variant.updates.iter().map(|one| next(Of::Measure(one.of), one.root, one.span));
        let family_updates = variant.family_updates.iter();
        let family_updates = family_updates.map(|one| next(Of::Family(one.of), one.root, one.span));
        let by_families = variant.family_breaks.iter().map(|one| {
            let (what, of) = match one.of {
                OfFamily::Gradient => ("a condition of F", of_gradient),
                OfFamily::Points | OfFamily::Bonds => ("a condition of gathered values", of_points),
            };
            place(what.into(), of, one.root, one.span)
        });
        let of_interactions = energies.chain(breaks).chain(dissipations).chain(updates);
        let of_points = gradients.chain(gathered).chain(by_families).chain(family_updates);
        of_interactions.chain(of_points).chain(coupled).chain(integrals).collect()
    }

    /// The name of a state of this kind on which a node depends.
    fn state_in(&self, root: NodeId, kind: Of) -> &str {
        let states = self.elaborator.states_in(&[root]);
        let state = states.into_iter().find(|state| self.kind(*state) == kind);
        let mut parameters = self.ast.statements.iter().filter_map(|statement| match statement {
            Statement::Parameter(parameter) => Some(parameter.name.name.as_str()),
            _ => None,
        });
        state.and_then(|state| parameters.nth(state)).unwrap_or_default()
    }
}

/// The kind that a condition says by what it holds, if it says one.
fn kind_by(uses: u8) -> Option<Of> {
    match (uses, &measures_in(uses)[..]) {
        (GRADIENT, _) => Some(Of::Family(OfFamily::Gradient)),
        (uses, _) if uses & !LENGTH == INTEGRAL => Some(Of::Family(OfFamily::Points)),
        (_, [measure]) => Some(Of::Measure(*measure)),
        _ => None,
    }
}
