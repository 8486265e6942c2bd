//! Where an energy may be used: declared intervals of a measure, or of `J`.

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
        let is_jacobian = matches!(
            &self.ast.arena[domain.quantity].kind,
            ExprKind::Name(name)
                if self.elaborator.symbols.get(name) == Some(Symbol::Kinematic(Kinematic::Jacobian))
        );
        let argument = match (measures.as_slice(), value.uses & (GRADIENT | INTEGRAL | RATE)) {
            (&[measure], 0) => Argument::Measure(measure),
            ([], GRADIENT) if is_jacobian => Argument::Gradient,
            (_, others) => {
                let span = self.ast.arena[domain.quantity].span;
                let message = match others {
                    others if others & GRADIENT == 0 => "a domain bounds a quantity of one measure",
                    _ => "a domain of `F` bounds `J`",
                };
                self.elaborator.report(
                    Diagnostic::error("wrong-measure", span, message).help(
                        "write for instance `domain l/L in (0, 10]` or `domain J in (0, inf)`",
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
        self.variant.domains.push(Interval { argument, root: value.node, lower, upper, text });
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
