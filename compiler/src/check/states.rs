//! What bonds, triangles and tetrahedra remember: states, and what these become.
//!
//! A state is one of bonds, of triangles or of tetrahedra: that of the measure that its update holds. Where
//! this holds none, the states in it say so, or else the lines that hold the state.

use std::collections::HashMap;

use piola_grammar::ast::{Statement, Update as UpdateAst};
use piola_grammar::{Diagnostic, Span, print_expression};

use super::breaking::{ALL_MEASURES, measures_in};
use super::elaborate::Elaborator;
use super::statement::Builder;
use super::symbols::Symbol;
use super::value::{Quantity, Value};
use crate::expression::{Input, Node, NodeId};
use crate::measure::Measure;
use crate::model::{OfFamily, TIME_STEP, Update};

/// What to write where kinds meet.
const EACH_ITS_OWN: &str = "a state is one of bonds, of triangles or of tetrahedra: write one of its own for \
                            each, with its own `update`";

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

/// A line, with the measure that it says and the states that it holds.
struct Line {
    measure: Option<Measure>,
    states: Vec<usize>,
}

/// Where a state may stand.
struct Place {
    /// In words.
    what: String,
    /// Of which kind; nothing where no state may stand.
    measure: Option<Measure>,
    root: NodeId,
    span: Span,
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
        let Some(measure) = self.measure_of_update(update, value) else { return };
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
        if self.variant.updates.iter().any(|known| known.state == state) {
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
        self.said.push(measure);
        let measure = measure.unwrap_or(Measure::Length);
        self.variant.updates.push(Update { state, measure, root: value.node, span, text });
    }

    /// The measure that an update holds, if it holds one; nothing at all where it cannot be, which is
    /// reported.
    fn measure_of_update(&mut self, update: &UpdateAst, value: Value) -> Option<Option<Measure>> {
        let foreign = value.uses & !ALL_MEASURES;
        let held = measures_in(value.uses);
        let error = match held[..] {
            _ if foreign != 0 => {
                let message =
                    "bonds, triangles and tetrahedra remember by their own measures alone";
                self.not_of_bonds(update.body, foreign, message)
                    .help("write for instance `update k = max(k, l/L - 1)`")
            }
            [] => return Some(None),
            [measure] => return Some(Some(measure)),
            _ => {
                let span = self.ast.arena[update.body].span;
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
        let line = |measure: Option<Measure>, root: NodeId| Line {
            measure,
            states: self.elaborator.states_in(&[root]),
        };
        let variant = &self.variant;
        let said = self.said.iter().zip(&variant.updates);
        let mut updates: Vec<Line> = said.map(|(said, own)| line(*said, own.root)).collect();
        let conditions = breaks.iter().filter_map(|value| match measures_in(value.uses)[..] {
            [measure] => Some(line(Some(measure), value.node)),
            _ => None,
        });
        let energies = variant.energies.iter().map(|one| line(Some(one.measure), one.root));
        let dissipations = variant.dissipations.iter();
        let dissipations = dissipations.map(|one| line(Some(Measure::Length), one.root));
        let others: Vec<Line> = energies.chain(dissipations).chain(conditions).collect();
        let places: HashMap<usize, usize> =
            variant.updates.iter().enumerate().map(|(place, own)| (own.state, place)).collect();
        // Each round finds one at least, or is the last.
        loop {
            let found = updates.iter().zip(&variant.updates).map(|(own, update)| {
                let of = |state: &usize| updates[*places.get(state)?].measure;
                let holds = |line: &&Line| line.states.binary_search(&update.state).is_ok();
                let by_holders = || updates.iter().chain(&others).filter(holds);
                let held = || own.states.iter().find_map(of);
                own.measure.or_else(held).or_else(|| by_holders().find_map(|line| line.measure))
            });
            let found: Vec<Option<Measure>> = found.collect();
            let is_last = found.iter().zip(&updates).all(|(found, line)| *found == line.measure);
            updates.iter_mut().zip(found).for_each(|(line, found)| line.measure = found);
            if is_last {
                break;
            }
        }
        for (update, line) in self.variant.updates.iter_mut().zip(updates) {
            update.measure = line.measure.unwrap_or(Measure::Length);
            self.kinds.insert(update.state, update.measure);
        }
    }

    /// The kind of a state; one that never changes is of bonds.
    pub(super) fn kind(&self, state: usize) -> Measure {
        self.kinds.get(&state).copied().unwrap_or(Measure::Length)
    }

    /// The kinds of the states on which a node depends, each once.
    pub(super) fn kinds_in(&self, root: NodeId) -> Vec<Measure> {
        let states = self.elaborator.states_in(&[root]);
        let mut kinds: Vec<Measure> = states.into_iter().map(|state| self.kind(state)).collect();
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
            let Place { what, measure, root, span, knows_time_step } = place;
            let foreign = self.kinds_in(root).into_iter().find(|kind| Some(*kind) != measure);
            if let Some(kind) = foreign {
                let many = kind.interactions();
                let message = format!("{what} cannot depend on what {many} remember");
                let label = format!("holds `{}`, a state of {many}", self.state_in(root, kind));
                let help = match measure {
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
    fn places(&self) -> Vec<Place> {
        let place = |what: String, measure: Option<Measure>, root: NodeId, span: Span| Place {
            what,
            measure,
            root,
            span,
            knows_time_step: false,
        };
        let psi = |head: &str| format!("psi({head})");
        let variant = &self.variant;
        let energies = variant
            .energies
            .iter()
            .map(|one| place(psi(one.measure.symbol()), Some(one.measure), one.root, one.span));
        let gradients = variant.gradient_energies.iter();
        let gradients = gradients.map(|one| place(psi("F"), None, one.root, one.span));
        let gathered = variant.gathered_energies.iter();
        let gathered = gathered.map(|one| place(psi(&one.head), None, one.root, one.span));
        let coupled = variant.coupled_energies.iter();
        let coupled = coupled.map(|one| place(psi(&one.head), None, one.root, one.span));
        let integrals = variant.integrals.iter();
        let integrals = integrals.map(|one| place("an integral".into(), None, one.root, one.span));
        let breaks = variant.breaks.iter().map(|one| {
            let what = format!("a condition of {}", one.of.interactions());
            place(what, Some(one.of), one.root, one.span)
        });
        let dissipations = variant
            .dissipations
            .iter()
            .map(|one| place("a dissipation".into(), Some(Measure::Length), one.root, one.span));
        let updates = variant.updates.iter().map(|one| {
            let what = format!("what {} remember", one.measure.interactions());
            Place { knows_time_step: true, ..place(what, Some(one.measure), one.root, one.span) }
        });
        let by_families = variant.family_breaks.iter().map(|one| {
            let what = match one.of {
                OfFamily::Gradient => "a condition of F",
                OfFamily::Points | OfFamily::Bonds => "a condition of gathered values",
            };
            place(what.into(), None, one.root, one.span)
        });
        let of_interactions = energies.chain(breaks).chain(dissipations).chain(updates);
        let of_points = gradients.chain(gathered).chain(by_families);
        of_interactions.chain(of_points).chain(coupled).chain(integrals).collect()
    }

    /// The name of a state of this kind on which a node depends.
    fn state_in(&self, root: NodeId, kind: Measure) -> &str {
        let states = self.elaborator.states_in(&[root]);
        let state = states.into_iter().find(|state| self.kind(*state) == kind);
        let mut parameters = self.ast.statements.iter().filter_map(|statement| match statement {
            Statement::Parameter(parameter) => Some(parameter.name.name.as_str()),
            _ => None,
        });
        state.and_then(|state| parameters.nth(state)).unwrap_or_default()
    }
}
