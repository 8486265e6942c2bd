//! Functions of the right stretch tensor `U`: powers, roots, exponentials and logarithms of it.
//!
//! All of them have the principal axes of `U`, so each is a function of one number, the principal
//! stretch, and its node in the graph is that function. What leaves the check are their traces alone:
//! sums over the principal stretches.

use piola_grammar::ast::{ExprId, Ident};
use piola_grammar::{Diagnostic, Span};

use super::elaborate::Elaborator;
use super::symbols::TensorFunction;
use super::value::{Constant, GRADIENT, Kind, Quantity, Value};
use crate::expression::{Function, Input, Node, NodeId, Operator};

/// Most functions whose traces a potential holds.
const MAX_TRACES: usize = 16;

/// Functions of numbers that are functions of `U` as well.
const OF_STRETCH: [Function; 5] =
    [Function::Sqrt, Function::Exp, Function::Ln, Function::Log1p, Function::Expm1];

impl Elaborator<'_> {
    /// `U`
    pub(super) fn stretch(&mut self, span: Span) -> Option<Value> {
        let kind = Kind::OfStretch(self.number_quantity());
        self.make(Node::Input(Input::Stretch(0)), kind, GRADIENT, span)
    }

    /// The function of a principal stretch that a value is: a function of `U`, or a known multiple of
    /// the unit tensor.
    fn of_stretch(&self, x: Value) -> Option<(NodeId, Quantity)> {
        match x.kind {
            Kind::OfStretch(quantity) => Some((x.node, quantity)),
            Kind::Tensor(id, quantity) if x.uses == 0 => {
                let components = &self.tensors[id.0 as usize];
                let d = self.dimension;
                let first = components[0]?;
                let isotropic = components.iter().enumerate().all(|(k, component)| {
                    *component == if k / d == k % d { Some(first) } else { None }
                });
                isotropic.then_some((first, quantity))
            }
            _ => None,
        }
    }

    /// Sums, products, quotients and powers of which at least one operand is a function of `U`.
    pub(super) fn stretch_binary(
        &mut self,
        operator: Operator,
        (x, left): (Value, ExprId),
        (y, right): (Value, ExprId),
        exponent: Option<&Constant>,
        span: Span,
    ) -> Option<Value> {
        let as_number = |value: Value| match value.kind {
            Kind::Number(quantity) => Some((value.node, quantity)),
            _ => None,
        };
        let (p, q) = match operator {
            Operator::Add | Operator::Subtract => (self.of_stretch(x), self.of_stretch(y)),
            Operator::Multiply => {
                (self.of_stretch(x).or(as_number(x)), self.of_stretch(y).or(as_number(y)))
            }
            _ => (self.of_stretch(x), as_number(y)),
        };
        let (Some(p), Some(q)) = (p, q) else {
            self.cannot_combine(operator, x, y, span);
            return None;
        };
        for (value, at) in [(x, left), (y, right)] {
            if !value.is_tensor() && value.uses != 0 {
                self.must_stand_outside(at);
                return None;
            }
        }
        let quantity = self.quantity_of(operator, (p.1, left), (q.1, right), exponent, span)?;
        let kind = Kind::OfStretch(quantity);
        self.make(Node::Binary(operator, p.0, q.0), kind, x.uses | y.uses, span)
    }

    /// `tr`, `inv` and `sym` of a function of `U`.
    pub(super) fn stretch_call(
        &mut self,
        function: TensorFunction,
        (name, x): (&Ident, Value),
        span: Span,
    ) -> Option<Value> {
        let help = match function {
            TensorFunction::Trace => return self.trace_of_stretch(x, span),
            TensorFunction::Symmetric => return Some(x),
            TensorFunction::Inverse => {
                let Kind::OfStretch(quantity) = x.kind else { return None };
                let one = self.make(Node::number(1.0), Kind::Truth, 0, span)?.node;
                let quantity = self.quantity_power(quantity, -1.0)?;
                let node = Node::Binary(Operator::Divide, one, x.node);
                return self.make(node, Kind::OfStretch(quantity), x.uses, span);
            }
            TensorFunction::Determinant => "`det(U)` is `J`",
            TensorFunction::Dyad | TensorFunction::Vector | TensorFunction::Norm => {
                "take a trace: `sqrt(tr(U^2))` is the norm of `U`"
            }
            TensorFunction::Deviator => {
                "`tr(dev(A)^2)` is `tr(A^2) - tr(A)^2/d`, and `tr(ln(U))` is `ln(J)`"
            }
        };
        let message = format!("a function of `U` cannot be the argument of `{}`", name.name);
        self.report(Diagnostic::error("wrong-shape", span, message).help(help));
        None
    }

    /// The sum over the principal stretches; equal functions have one number.
    pub(super) fn trace_of_stretch(&mut self, x: Value, span: Span) -> Option<Value> {
        let Kind::OfStretch(quantity) = x.kind else { return None };
        let known = self.traces.iter().position(|root| *root == x.node);
        let number = known.unwrap_or(self.traces.len());
        if number >= MAX_TRACES {
            let message = format!(
                "a potential has traces of at most {MAX_TRACES} different functions of `U`"
            );
            self.report(Diagnostic::error("too-large", span, message));
            return None;
        }
        if known.is_none() {
            self.traces.push(x.node);
        }
        let node = Node::Input(Input::Trace(number as u8));
        self.make(node, Kind::Number(quantity), GRADIENT, span)
    }

    /// A function of numbers with a tensor as its argument.
    pub(super) fn function_of_tensor(
        &mut self,
        function: Function,
        x: Value,
        at: ExprId,
        span: Span,
    ) -> Option<Value> {
        let name = function.name();
        let listed = OF_STRETCH.map(|f| format!("`{}`", f.name())).join(", ");
        if !OF_STRETCH.contains(&function) {
            let shape = self.shape(x);
            let message = format!("`{name}` is a function of numbers, this is {shape}");
            self.report(
                Diagnostic::error("wrong-shape", self.arena[at].span, message).label(shape).help(
                    format!("take an invariant: `tr(A)`, `det(A)` or `A : B`; of `U` there are {listed} and powers"),
                ),
            );
            return None;
        }
        let Kind::OfStretch(quantity) = x.kind else {
            let shape = self.shape(x);
            let message = format!("`{name}` is a function of numbers and of `U`, this is {shape}");
            self.report(
                Diagnostic::error("wrong-shape", self.arena[at].span, message).label(shape).help(
                    "write it with `U`, of which `C` is the square: `ln(C)` is `2*ln(U)`; or take an \
                     invariant: `tr(A)`, `det(A)` or `A : B`",
                ),
            );
            return None;
        };
        let quantity = self.builtin_quantity(function, quantity, at)?;
        self.make(Node::Unary(function, x.node), Kind::OfStretch(quantity), x.uses, span)
    }

    /// Reports an `if` between functions of `U`.
    pub(super) fn no_choice_of_stretch(&mut self, span: Span) {
        let message = "functions of `U` cannot be the branches of `if`";
        self.report(
            Diagnostic::error("wrong-shape", span, message)
                .help("choose between their traces: `if .. then tr(A) else tr(B)`"),
        );
    }

    fn must_stand_outside(&mut self, at: ExprId) {
        let message = "what a function of `U` is made with cannot depend on the deformation";
        self.report(
            Diagnostic::error("wrong-shape", self.arena[at].span, message)
                .label("a number that depends on `F`")
                .help(
                    "let it stand outside the trace: `tr(x*A)` is `x*tr(A)`, `tr((x*A)^n)` is \
                     `x^n*tr(A^n)`",
                ),
        );
    }

    fn cannot_combine(&mut self, operator: Operator, x: Value, y: Value, span: Span) {
        let (p, q) = (self.shape(x), self.shape(y));
        let message = match operator {
            Operator::Power => format!("cannot raise {p} to a power that is {q}"),
            Operator::Divide => format!("cannot divide {p} by {q}"),
            Operator::Multiply => format!("cannot multiply {p} by {q}"),
            _ => format!("cannot combine {p} with {q} by `{}`", operator.name()),
        };
        self.report(Diagnostic::error("wrong-shape", span, message).help(
            "functions of `U` combine with each other and with multiples of `I`, numbers multiply \
             them, and `tr(..)` makes a number of them; `C` is `U^2`",
        ));
    }
}
