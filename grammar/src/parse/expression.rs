//! From a flat row of operands and operators to a tree: precedence climbing with two explicit stacks
//! (Dijkstra's shunting yard), so that a row may be as long as the file.

use pest::iterators::Pair;

use super::Builder;
use super::parser::Rule;
use super::statement::take;
use crate::ast::{BinaryOperator, ExprId, ExprKind, UnaryOperator};
use crate::operator::Binding;
use crate::print::print_expression;
use crate::{Diagnostic, Span};

/// An expression and its place including the parentheses around it.
#[derive(Clone, Copy)]
pub(super) struct Operand {
    pub id: ExprId,
    pub outer: Span,
}

#[derive(Clone, Copy)]
enum Operator {
    Prefix(UnaryOperator),
    Infix(BinaryOperator),
}

impl Operator {
    fn binding(self) -> Binding {
        match self {
            Operator::Prefix(operator) => operator.binding(),
            Operator::Infix(operator) => operator.binding(),
        }
    }
}

/// The row read so far: operands that wait for operators, and operators that wait for operands.
#[derive(Default)]
struct Row {
    operands: Vec<Operand>,
    operators: Vec<(Operator, Span)>,
}

impl Builder {
    /// Builds the tree of an `expression`; `None` only if the grammar did not make the pair.
    pub(super) fn expression(&mut self, pair: Pair<'_, Rule>) -> Option<Operand> {
        let mut row = Row::default();
        for part in pair.into_inner() {
            let span = self.span(&part);
            match part.as_rule() {
                Rule::transpose => self.transpose(&mut row, span)?,
                Rule::prefix => self.prefix(&mut row, part.as_str(), span),
                Rule::infix => {
                    let operator = BinaryOperator::from_symbol(part.as_str())?;
                    self.infix(&mut row, operator, span)?;
                }
                _ => {
                    let operand = self.operand(part)?;
                    row.operands.push(operand);
                }
            }
        }
        while !row.operators.is_empty() {
            self.reduce(&mut row)?;
        }
        row.operands.pop()
    }

    fn prefix(&mut self, row: &mut Row, symbol: &str, span: Span) {
        let operator = if symbol == "-" { UnaryOperator::Negate } else { UnaryOperator::Not };
        if let Some(&(before, place)) = row.operators.last()
            && operator == UnaryOperator::Not
            && before.binding() > Binding::Not
        {
            let finding = Diagnostic::error("syntax", span, "`not` needs parentheses here")
                .label("binds weaker than the operator before it")
                .note(place, "this operator would take `not` alone")
                .help("write `(not ...)`");
            self.findings.push(finding);
        }
        row.operators.push((Operator::Prefix(operator), span));
    }

    /// Binds the operand before it, more tightly than any other operator.
    fn transpose(&mut self, row: &mut Row, mark: Span) -> Option<()> {
        let Operand { id: operand, outer } = row.operands.pop()?;
        let kind = ExprKind::Unary { operator: UnaryOperator::Transpose, operand };
        let outer = outer.to(mark);
        row.operands.push(Operand { id: self.arena.push(kind, outer), outer });
        Some(())
    }

    fn infix(&mut self, row: &mut Row, operator: BinaryOperator, span: Span) -> Option<()> {
        let binding = operator.binding();
        while let Some(&(before, _)) = row.operators.last() {
            let takes_operand = before.binding() > binding
                || before.binding() == binding && binding != Binding::Power;
            if !takes_operand {
                break;
            }
            self.reduce(row)?;
        }
        row.operators.push((Operator::Infix(operator), span));
        Some(())
    }

    /// Gives the last operator its operands.
    fn reduce(&mut self, row: &mut Row) -> Option<()> {
        let (operator, place) = row.operators.pop()?;
        let right = row.operands.pop()?;
        let (kind, span) = match operator {
            Operator::Prefix(operator) => {
                (ExprKind::Unary { operator, operand: right.id }, place.to(right.outer))
            }
            Operator::Infix(operator) => {
                let left = row.operands.pop()?;
                self.refuse_chain(operator, place, left, right);
                let kind = ExprKind::Binary { operator, left: left.id, right: right.id };
                (kind, left.outer.to(right.outer))
            }
        };
        let id = self.arena.push(kind, span);
        row.operands.push(Operand { id, outer: span });
        Some(())
    }

    /// `a < b < c` means nothing: a truth value is not compared with a number.
    fn refuse_chain(
        &mut self,
        operator: BinaryOperator,
        place: Span,
        left: Operand,
        right: Operand,
    ) {
        let inner = &self.arena[left.id];
        let bare = inner.span == left.outer;
        let ExprKind::Binary { operator: first, right: middle, .. } = inner.kind else { return };
        if !(operator.is_comparison() && first.is_comparison() && bare) {
            return;
        }
        let chain = left.outer.to(right.outer);
        let help = if chain.range().len() <= 60 {
            let text = |id| print_expression(&self.arena, id);
            let (left, middle, right) = (text(left.id), text(middle), text(right.id));
            format!("write `{left} and {middle} {} {right}`", operator.symbol())
        } else {
            "write `a < b and b < c`".to_string()
        };
        let finding = Diagnostic::error("chained-comparison", chain, "comparisons do not chain")
            .label(format!("`{}` compares a truth value", operator.symbol()))
            .note(place, "second comparison")
            .help(help);
        self.findings.push(finding);
    }

    pub(super) fn operand(&mut self, pair: Pair<'_, Rule>) -> Option<Operand> {
        let span = self.span(&pair);
        let kind = match pair.as_rule() {
            Rule::number => ExprKind::Number(self.number(pair.as_str(), span)),
            Rule::name => ExprKind::Name(self.ident(&pair).name),
            Rule::group => return self.group(pair),
            Rule::call => return self.call(pair),
            Rule::table => return self.table(pair),
            Rule::conditional => return self.conditional(pair),
            _ => return None,
        };
        Some(Operand { id: self.arena.push(kind, span), outer: span })
    }

    fn group(&mut self, pair: Pair<'_, Rule>) -> Option<Operand> {
        let outer = self.span(&pair);
        let inside = pair.into_inner().find(|part| part.as_rule() == Rule::expression)?;
        let inside = self.expression(inside)?;
        Some(Operand { outer, ..inside })
    }

    fn call(&mut self, pair: Pair<'_, Rule>) -> Option<Operand> {
        let span = self.span(&pair);
        let mut parts = pair.into_inner();
        let function = self.ident(&parts.next()?);
        let mut arguments = Vec::new();
        for part in parts.filter(|part| part.as_rule() == Rule::expression) {
            arguments.push(self.expression(part)?.id);
        }
        let id = self.arena.push(ExprKind::Call { function, arguments }, span);
        Some(Operand { id, outer: span })
    }

    fn table(&mut self, pair: Pair<'_, Rule>) -> Option<Operand> {
        let span = self.span(&pair);
        let mut parts = pair.into_inner();
        let file = self.text(&take(&mut parts, Rule::string)?);
        let argument = self.expression(take(&mut parts, Rule::expression)?)?.id;
        let id = self.arena.push(ExprKind::Table { file, argument }, span);
        Some(Operand { id, outer: span })
    }

    fn conditional(&mut self, pair: Pair<'_, Rule>) -> Option<Operand> {
        let start = self.span(&pair);
        let mut parts = pair.into_inner().filter(|part| part.as_rule() == Rule::expression);
        let condition = self.expression(parts.next()?)?.id;
        let then = self.expression(parts.next()?)?.id;
        let otherwise = self.expression(parts.next()?)?;
        // Not the pair's own end: that may include blanks and a comment.
        let span = Span { start: start.start, end: otherwise.outer.end };
        let kind = ExprKind::If { condition, then, otherwise: otherwise.id };
        Some(Operand { id: self.arena.push(kind, span), outer: span })
    }

    /// The value of a literal; what a 64-bit float cannot hold is reported.
    fn number(&mut self, text: &str, span: Span) -> f64 {
        let value: f64 = text.parse().unwrap_or(f64::NAN);
        let mantissa = text.split(['e', 'E']).next().unwrap_or(text);
        let vanished = value == 0.0 && mantissa.contains(|c: char| ('1'..='9').contains(&c));
        if value.is_finite() && !vanished {
            return value;
        }
        let size = if vanished { "small" } else { "large" };
        let finding = Diagnostic::error(
            "number-out-of-range",
            span,
            format!("this number is too {size} for a 64-bit float"),
        )
        .label("outside 4.9e-324 .. 1.8e308")
        .help("choose units in which the numbers are of moderate size");
        self.findings.push(finding);
        0.0
    }
}
