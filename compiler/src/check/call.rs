//! Calls: built-in functions become nodes, a user's functions are expanded where they are called.

use piola_grammar::Span;
use piola_grammar::ast::{Ast, ExprId, Ident, Statement};

use super::dissipation;
use super::elaborate::{Elaborator, MAX_CALL_DEPTH};
use super::names::NEIGHBOUR;
use super::symbols::{Symbol, TensorFunction};
use super::value::{Kind, Value};
use crate::expression::{Function, Node, Operator};

impl<'a> Elaborator<'a> {
    pub(super) fn call(
        &mut self,
        function: &Ident,
        given: &[ExprId],
        actual: Vec<Value>,
        span: Span,
    ) -> Option<Value> {
        if let Some(Symbol::Function(number)) = self.symbols.get(&function.name) {
            return self.expand(number, function, actual, span);
        }
        if self.symbols.get(&function.name).is_some() {
            return self.component_of(function, given, &actual, span);
        }
        if let Some(builtin) = Function::named(&function.name) {
            if actual[0].is_tensor() {
                return self.function_of_tensor(builtin, actual[0], given[0], span);
            }
            let quantity = self.number(actual[0], given[0])?;
            let quantity = self.builtin_quantity(builtin, quantity, given[0])?;
            let node = Node::Unary(builtin, actual[0].node);
            return self.make(node, Kind::Number(quantity), actual[0].uses, span);
        }
        if let Some(tensor_function) = TensorFunction::named(&function.name) {
            match tensor_function {
                TensorFunction::Dyad => return self.dyad(&actual, given, span),
                TensorFunction::Vector => return self.vector(&actual, given, span),
                TensorFunction::Norm => return self.norm((actual[0], given[0]), span),
                _ => {}
            }
            return self.tensor_call(tensor_function, (function, actual[0], given[0]), span);
        }
        if function.name == dissipation::NAME {
            return self.rate(actual[0], given[0], span);
        }
        if function.name == NEIGHBOUR {
            return self.neighbour(actual[0], given[0], span);
        }
        let Some(operator) = Operator::named(&function.name) else {
            return self.integral(actual[0], given[0], span);
        };
        let mut result = (actual[0], self.number(actual[0], given[0])?);
        for (&value, &at) in actual.iter().zip(given).skip(1) {
            let quantity = self.number(value, at)?;
            let quantity =
                self.quantity_of(operator, (result.1, given[0]), (quantity, at), None, span)?;
            let node = Node::Binary(operator, result.0.node, value.node);
            let uses = result.0.uses | value.uses;
            result = (self.make(node, Kind::Number(quantity), uses, span)?, quantity);
        }
        Some(result.0)
    }

    pub(super) fn expand(
        &mut self,
        number: usize,
        function: &Ident,
        actual: Vec<Value>,
        span: Span,
    ) -> Option<Value> {
        let key = (number, actual);
        if let Some(&known) = self.calls.get(&key) {
            return known;
        }
        if self.call_sites.len() >= MAX_CALL_DEPTH {
            self.out_of_room(span);
            return None;
        }
        let ast: &'a Ast = self.ast?;
        let Statement::Definition(definition) = &ast.statements[number] else { return None };
        if self.exhausted || !self.symbols.are_resolved(definition.body) {
            return None;
        }
        let formals = definition.parameters.as_deref().unwrap_or(&[]);
        let arguments: Vec<(&Ident, Value)> = formals.iter().zip(key.1.iter().copied()).collect();
        let described: Vec<String> = arguments
            .iter()
            .map(|(formal, value)| match value.kind {
                Kind::Number(quantity) => format!("`{}` {}", formal.name, quantity.describe()),
                Kind::Truth | Kind::Tensor(..) | Kind::OfStretch(_) => {
                    format!("`{}` {}", formal.name, self.shape(*value))
                }
            })
            .collect();
        let site = format!("in this call of `{}`, with {}", function.name, described.join(", "));
        self.call_sites.push((span, site));
        let value = self.body(definition.body, &arguments);
        self.call_sites.pop();
        self.calls.insert(key, value);
        value
    }
}
