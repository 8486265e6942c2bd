//! What bonds remember: states, and what these become.

use piola_grammar::ast::{Statement, Update as UpdateAst};
use piola_grammar::{Diagnostic, Span, print_expression};

use super::breaking::LENGTH;
use super::elaborate::Elaborator;
use super::statement::Builder;
use super::symbols::Symbol;
use super::value::Quantity;
use crate::expression::{Input, NodeId};
use crate::measure::Measure;
use crate::model::{TIME_STEP, Update};

impl Elaborator<'_> {
    /// Whether any of these nodes depends on a state.
    pub(super) fn depends_on_states(&self, roots: &[NodeId]) -> bool {
        let depends = |state: &usize| self.graph.depends_on(roots, Input::Parameter(*state as u16));
        self.symbols.states.iter().any(depends)
    }
}

impl Builder<'_> {
    /// `update NAME = NEXT`.
    pub(super) fn update(&mut self, update: &UpdateAst) {
        let arena = &self.ast.arena;
        let (name, span) = (&update.state, arena[update.body].span);
        let Some(value) = self.elaborator.expression(update.body) else { return };
        let Some(quantity) = self.elaborator.number(value, update.body) else { return };
        // A name that is no state was reported before.
        let Some(Symbol::Parameter(state)) = self.elaborator.symbols.get(&name.name) else {
            return;
        };
        let foreign = value.uses & !LENGTH;
        if foreign != 0 {
            let message = "bonds remember by their own length alone";
            let error = self.not_of_bonds(update.body, foreign, message);
            self.elaborator.report(error.help("write for instance `update k = max(k, l/L - 1)`"));
            return;
        }
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
        self.variant.updates.push(Update { state, root: value.node, span, text });
    }

    /// Refuses states of bonds where no bond is, and time steps where nothing is updated.
    pub(super) fn check_states(&mut self) {
        let variant = &self.variant;
        let mut of_others: Vec<(String, NodeId, Span)> = Vec::new();
        let mut of_bonds: Vec<(String, NodeId, Span)> = Vec::new();
        for energy in &variant.energies {
            let entry = (format!("psi({})", energy.measure.symbol()), energy.root, energy.span);
            let is_bond = energy.measure == Measure::Length;
            if is_bond { of_bonds.push(entry) } else { of_others.push(entry) }
        }
        let gradients = variant.gradient_energies.iter();
        of_others.extend(gradients.map(|one| ("psi(F)".to_string(), one.root, one.span)));
        let gathered = variant.gathered_energies.iter();
        of_others.extend(gathered.map(|one| (format!("psi({})", one.head), one.root, one.span)));
        let coupled = variant.coupled_energies.iter();
        of_others.extend(coupled.map(|one| (format!("psi({})", one.head), one.root, one.span)));
        let integrals = variant.integrals.iter();
        of_others.extend(integrals.map(|one| ("an integral".to_string(), one.root, one.span)));
        let breaks = variant.breaks.iter();
        of_bonds.extend(breaks.map(|one| ("a condition".to_string(), one.root, one.span)));
        let breaks = variant.gathered_breaks.iter().map(|one| (one.root, one.span));
        let what = "a condition of gathered values";
        of_others.extend(breaks.map(|(root, span)| (what.to_string(), root, span)));
        let breaks = variant.gradient_breaks.iter();
        of_others.extend(breaks.map(|one| ("a condition of F".to_string(), one.root, one.span)));
        let dissipations = variant.dissipations.iter();
        of_bonds.extend(dissipations.map(|one| ("a dissipation".to_string(), one.root, one.span)));
        for (what, root, span) in &of_others {
            if self.elaborator.depends_on_states(&[*root]) {
                let message = format!("{what} cannot depend on what bonds remember");
                let error = Diagnostic::error("wrong-measure", *span, message)
                    .label("holds a state")
                    .help("states belong to bonds: write this part as an energy `psi(l)`");
                self.elaborator.report(error);
            }
        }
        let Some(Symbol::TimeStep(number)) = self.elaborator.symbols.get(TIME_STEP) else { return };
        let time_step = Input::Parameter(number as u16);
        for (what, root, span) in of_others.iter().chain(&of_bonds) {
            if self.elaborator.graph.depends_on(&[*root], time_step) {
                let message = format!("{what} cannot depend on the time step `{TIME_STEP}`");
                let error = Diagnostic::error("wrong-measure", *span, message)
                    .help("updates alone know it: `update life = life - rate*dt`");
                self.elaborator.report(error);
            }
        }
    }
}
