//! Dimensions of results, and what is said where they do not fit.

use piola_grammar::ast::{ExprId, ExprKind};
use piola_grammar::{Diagnostic, Span};

use super::dimension::Dimension;
use super::elaborate::Elaborator;
use super::names::parts;
use super::value::{Constant, Quantity};
use crate::expression::{Function, Operator};
use crate::measure::Measure;

impl Elaborator<'_> {
    pub(super) fn quantity_of(
        &mut self,
        operator: Operator,
        (p, left): (Quantity, ExprId),
        (q, right): (Quantity, ExprId),
        exponent: Option<&Constant>,
        span: Span,
    ) -> Option<Quantity> {
        match operator {
            Operator::Multiply => Some(p.combine(q, Dimension::times)),
            Operator::Divide => Some(p.combine(q, Dimension::over)),
            Operator::Power => self.power_quantity((p, left), (q, right), exponent),
            Operator::Add
            | Operator::Subtract
            | Operator::Min
            | Operator::Max
            | Operator::Atan2 => {
                if let Some(common) = p.unify(q) {
                    let angle = operator == Operator::Atan2;
                    return Some(if angle { self.number_quantity() } else { common });
                }
                let message = match operator {
                    Operator::Add => {
                        format!("cannot add {} to {}", q.describe(), p.describe())
                    }
                    Operator::Subtract => {
                        format!("cannot subtract {} from {}", q.describe(), p.describe())
                    }
                    Operator::Atan2 => {
                        format!(
                            "no angle of {} against {}: `atan2` needs one unit",
                            p.describe(),
                            q.describe()
                        )
                    }
                    _ => format!("cannot compare {} with {}", p.describe(), q.describe()),
                };
                self.mismatch(span, message, (left, p), (right, q));
                None
            }
        }
    }

    fn power_quantity(
        &mut self,
        (base, base_at): (Quantity, ExprId),
        (exponent, exponent_at): (Quantity, ExprId),
        constant: Option<&Constant>,
    ) -> Option<Quantity> {
        if let Some(dimension) = exponent.with_unit() {
            let message = format!("an exponent must be a pure number, not {dimension}");
            let error =
                Diagnostic::error("dimension-mismatch", self.arena[exponent_at].span, message);
            self.report(error.label("this has a unit").help("divide it by a reference value"));
            return None;
        }
        let Some(dimension) = base.with_unit() else { return Some(base) };
        let Some(Constant::Number(c)) = constant else {
            let message = format!("cannot raise {dimension} to a power that is not a known number");
            let error = Diagnostic::error("dimension-mismatch", self.arena[base_at].span, message);
            let error = error
                .label("this has a unit")
                .note(self.arena[exponent_at].span, "the unit of the result would depend on this");
            self.report(error.help("divide the base by its reference value, as in `(l/L)^n`"));
            return None;
        };
        match dimension.power(*c) {
            Some(result) => Some(Quantity::Known(result)),
            None => {
                self.no_sensible_unit(dimension, *c, self.arena[exponent_at].span);
                None
            }
        }
    }

    fn no_sensible_unit(&mut self, dimension: Dimension, exponent: f64, span: Span) {
        let message = format!("{dimension} to the power {exponent} has no sensible unit");
        self.report(
            Diagnostic::error("dimension-mismatch", span, message)
                .help("exponents of quantities with units are fractions with a small denominator"),
        );
    }

    pub(super) fn builtin_quantity(
        &mut self,
        function: Function,
        quantity: Quantity,
        at: ExprId,
    ) -> Option<Quantity> {
        match function {
            Function::Negate | Function::Abs => Some(quantity),
            Function::Sign => Some(self.number_quantity()),
            Function::Sqrt => {
                let Quantity::Known(dimension) = quantity else { return Some(Quantity::Any) };
                match dimension.power(0.5) {
                    Some(root) => Some(Quantity::Known(root)),
                    None => {
                        self.no_sensible_unit(dimension, 0.5, self.arena[at].span);
                        None
                    }
                }
            }
            _ => {
                let Some(dimension) = quantity.with_unit() else {
                    return Some(self.number_quantity());
                };
                let name = function.name();
                let message = format!("`{name}` needs a pure number, not {dimension}");
                let error = Diagnostic::error("dimension-mismatch", self.arena[at].span, message)
                    .label("this has a unit");
                let help = self.stretch_help(at).or_else(|| self.measure_help(at));
                self.report(error.help(help.unwrap_or_else(|| {
                    "divide it by a reference value of the same unit".to_string()
                })));
                None
            }
        }
    }

    pub(super) fn mismatch(
        &mut self,
        span: Span,
        message: String,
        (left, p): (ExprId, Quantity),
        (right, q): (ExprId, Quantity),
    ) {
        let mut error = Diagnostic::error("dimension-mismatch", span, message)
            .note(self.arena[left].span, p.describe())
            .note(self.arena[right].span, q.describe());
        let help = self.stretch_help(left).or_else(|| self.stretch_help(right));
        error = error.help(help.unwrap_or_else(|| {
            "both sides need the same unit; give the parameters units that make them equal"
                .to_string()
        }));
        self.report(error);
    }

    /// Advice where a bare measure stands: its stretch is a pure number.
    fn stretch_help(&self, at: ExprId) -> Option<String> {
        let ExprKind::Name(name) = &self.arena[at].kind else { return None };
        let measure = Measure::from_symbol(name)?;
        let reference = measure.reference_symbol();
        Some(format!(
            "`{reference}` is the value of `{name}` at rest; for its stretch write `{name}/{reference}`"
        ))
    }

    /// Advice where an expression with a unit holds a measure: its value at rest has that unit.
    fn measure_help(&self, at: ExprId) -> Option<String> {
        let measure = parts(self.arena, at).into_iter().find_map(|id| {
            let ExprKind::Name(name) = &self.arena[id].kind else { return None };
            Measure::from_symbol(name)
        })?;
        let (now, rest) = (measure.symbol(), measure.reference_symbol());
        Some(format!(
            "`{now}` is the measure of a {}, in {}; `{now}/{rest}` is a pure number",
            measure.interaction(),
            Dimension::of(0, measure.length_exponent(), 0, 0).unit()
        ))
    }
}
