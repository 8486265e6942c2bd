//! What bonds dissipate: potentials of the rates at which their lengths change.

use piola_grammar::ast::{Energy as EnergyAst, ExprId};
use piola_grammar::{Diagnostic, Span, print_expression};

use super::breaking::LENGTH;
use super::dimension::Dimension;
use super::elaborate::Elaborator;
use super::statement::Builder;
use super::value::{Quantity, RATE, Value};
use crate::expression::{Input, Node, NodeId};
use crate::measure::Measure;
use crate::model::Dissipation;

/// The name of what changes how fast.
pub(super) const NAME: &str = "rate";

const EXAMPLE: &str = "write for instance `dissipation(l) = 1/2*eta*rate(l)^2`";

impl Elaborator<'_> {
    /// `rate(l)`: what the length of a bond changes by in a second.
    pub(super) fn rate(&mut self, of: Value, at: ExprId, span: Span) -> Option<Value> {
        if self.graph[of.node] != Node::Input(Input::Current(Measure::Length)) || of.is_tensor() {
            let message = "`rate` is how fast the length of a bond changes";
            let error = Diagnostic::error("wrong-measure", self.arena[at].span, message);
            self.report(error.label("not the length `l`").help(
                "write `rate(l)`; what depends on `l` changes by the chain rule: the strain `l/L - 1` at \
                 the rate `rate(l)/L`",
            ));
            return None;
        }
        let kind = self.known(Dimension::of(0, 1, -1, 0));
        self.make(Node::Input(Input::Rate), kind, RATE, span)
    }
}

impl Builder<'_> {
    /// `dissipation(l) = EXPRESSION`.
    pub(super) fn dissipation(&mut self, potential: &EnergyAst) {
        let arena = &self.ast.arena;
        let span = arena[potential.body].span;
        let name = potential.measure.name.as_str();
        if name != "l" {
            self.elaborator.report(not_of_lengths(name, potential.head));
            return;
        }
        let Some(value) = self.elaborator.expression(potential.body) else { return };
        let Some(quantity) = self.elaborator.number(value, potential.body) else { return };
        let foreign = value.uses & !(LENGTH | RATE);
        if foreign != 0 {
            let message = "bonds dissipate by their own length and its rate alone";
            let error = self.not_of_bonds(potential.body, foreign, message);
            self.elaborator.report(error.help(EXAMPLE));
            return;
        }
        if !self.elaborator.graph.depends_on(&[value.node], Input::Rate) {
            let message = "this dissipation does not depend on how fast the bond's length changes";
            let error = Diagnostic::error("wrong-measure", span, message).label("no `rate(l)`");
            self.elaborator
                .report(error.help(format!("{EXAMPLE}; what bonds store is `psi(l) = ..`")));
            return;
        }
        let second = Dimension::of(0, 0, 1, 0);
        let wanted = Dimension::energy_density(2, self.variant.dimension).over(second);
        if self.has_units && Quantity::Known(wanted).unify(quantity).is_none() {
            let d = self.variant.dimension;
            let found = quantity.describe();
            let message = format!(
                "dissipation(l) must be the unit of psi(l) per second, W/m^{} (d = {d}), not {found}",
                2 * d
            );
            let mut error = Diagnostic::error("dimension-mismatch", span, message).label(found);
            if let Quantity::Known(found) = quantity {
                let missing = wanted.over(found).unit();
                error = error.help(format!("a factor in {missing} is missing"));
            }
            self.elaborator.report(error.help(
                "the viscosity of `1/2*eta*rate(l)^2` is in W*s^2/m^(2*d + 2), that of \
                 `1/2*eta*L*(rate(l)/L)^2` in W*s^2/m^(2*d + 1)",
            ));
            return;
        }
        let text = print_expression(arena, potential.body);
        self.variant.dissipations.push(Dissipation { root: value.node, span, text });
    }

    /// Refuses rates in energies.
    pub(super) fn check_rates(&mut self) {
        let variant = &self.variant;
        let energies = variant.energies.iter();
        let mut all: Vec<(String, NodeId, Span)> =
            energies.map(|one| (one.measure.symbol().to_string(), one.root, one.span)).collect();
        let gradients = variant.gradient_energies.iter();
        all.extend(gradients.map(|one| ("F".to_string(), one.root, one.span)));
        let gathered = variant.gathered_energies.iter();
        all.extend(gathered.map(|one| (one.head.clone(), one.root, one.span)));
        let coupled = variant.coupled_energies.iter();
        all.extend(coupled.map(|one| (one.head.clone(), one.root, one.span)));
        for (head, root, span) in all {
            if self.elaborator.graph.depends_on(&[root], Input::Rate) {
                let message = format!("psi({head}) is stored and cannot depend on a rate");
                let error = Diagnostic::error("wrong-measure", span, message)
                    .label("holds `rate(l)`")
                    .help("what is lost has a potential of its own: `dissipation(l) = 1/2*eta*rate(l)^2`");
                self.elaborator.report(error);
            }
        }
    }
}

/// A dissipation of something else, and what damps that.
fn not_of_lengths(name: &str, span: Span) -> Diagnostic {
    let message = format!("dissipation({name}) is not there: bonds alone dissipate");
    let error =
        Diagnostic::error("unknown-measure", span, message).label("expected `dissipation(l)`");
    let help = match name {
        "a" | "A" => {
            "triangles are damped by their edges: write `dissipation(l) = 1/2*eta*rate(l)^2`"
        }
        "v" | "V" => {
            "tetrahedra are damped by their edges: write `dissipation(l) = 1/2*eta*rate(l)^2`"
        }
        "F" | "J" | "C" | "E" | "U" => {
            "bodies with a psi(F) are damped by their bonds: write `dissipation(l) = \
             1/2*eta*rate(l)^2`"
        }
        _ => EXAMPLE,
    };
    error.help(help).help("or let a scene damp all that moves: `damping` in [motion]")
}
