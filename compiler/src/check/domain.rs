//! Where an energy may be used: declared intervals of quantities of a measure, or of the deformation gradient.

use piola_grammar::ast::{Bound, Domain, ExprKind, UnaryOperator};
use piola_grammar::{Diagnostic, print_expression};

use super::statement::Builder;
use super::symbols::{Kinematic, Symbol};
use super::value::{GRADIENT, INTEGRAL, RATE};
use crate::measure::{Argument, Measure};
use crate::model::Interval;

impl Builder<'_> {
    pub(super) fn domain(&mut self, domain: &Domain) {
        let bounds = (self.bound(&domain.lower), self.bound(&domain.upper));
        let Some(value) = self.elaborator.expression(domain.quantity) else { return };
        if self.elaborator.number(value, domain.quantity).is_none() {
            return;
        }
        let (Some(lower), Some(upper)) = bounds else { return };
        let measures: Vec<Measure> =
            Measure::ALL.into_iter().filter(|m| value.uses & (1 << (*m as u8)) != 0).collect();
        let of_volume_ratio = matches!(
            &self.ast.arena[domain.quantity].kind,
            ExprKind::Name(name)
                if self.elaborator.symbols.get(name) == Some(Symbol::Kinematic(Kinematic::Jacobian))
        );
        let argument = match (measures.as_slice(), value.uses & (GRADIENT | INTEGRAL | RATE)) {
            (&[measure], 0) => Argument::Measure(measure),
            ([], GRADIENT) => Argument::Gradient,
            (_, others) => {
                let span = self.ast.arena[domain.quantity].span;
                let (message, label) = match others {
                    others if others & INTEGRAL != 0 => {
                        ("a domain bounds no quantity that points gather", "gathered")
                    }
                    0 if measures.is_empty() => {
                        ("a domain bounds a quantity of the deformation", "always the same")
                    }
                    _ => ("a domain bounds a quantity of one measure or of `F`", "of several"),
                };
                self.elaborator.report(
                    Diagnostic::error("wrong-measure", span, message).label(label).help(
                        "write for instance `domain l/L in (0, 10]`, `domain J in (0, inf)` or \
                         `domain tr(C) in (0, 33)`",
                    ),
                );
                return;
            }
        };
        // Ends that are no numbers make no domain either.
        if lower.0.partial_cmp(&upper.0) != Some(std::cmp::Ordering::Less) {
            let message = format!("the domain is empty: {} is not below {}", lower.0, upper.0);
            self.elaborator.report(Diagnostic::error("empty-domain", domain.span, message));
            return;
        }
        let text = print_expression(&self.ast.arena, domain.quantity);
        if self.elaborator.depends_on_states(&[value.node]) {
            let message = "a domain bounds a quantity of the deformation alone, without states";
            let error = Diagnostic::error("wrong-measure", domain.span, message);
            self.elaborator.report(error);
            return;
        }
        let (root, span) = (value.node, domain.span);
        let interval = Interval { argument, root, lower, upper, of_volume_ratio, span, text };
        self.variant.domains.push(interval);
    }

    fn bound(&mut self, bound: &Bound) -> Option<(f64, bool)> {
        let arena = &self.ast.arena;
        let infinite = |id| matches!(&arena[id].kind, ExprKind::Name(name) if name == "inf");
        let value = match &arena[bound.value].kind {
            ExprKind::Unary { operator: UnaryOperator::Negate, operand } if infinite(*operand) => {
                f64::NEG_INFINITY
            }
            _ if infinite(bound.value) => f64::INFINITY,
            _ => self.elaborator.constant(bound.value)?,
        };
        Some((value, bound.inclusive))
    }
}
