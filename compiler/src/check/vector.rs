//! Vectors of d components, dyads of them, and components of both.

use piola_grammar::ast::{ExprId, Ident};
use piola_grammar::{Diagnostic, Span};

use super::elaborate::Elaborator;
use super::names::not_a_function;
use super::tensor::Tensor;
use super::value::{Quantity, Value};
use crate::expression::{Function, Node, Operator};

impl Elaborator<'_> {
    pub(super) fn is_vector(&self, x: &Tensor) -> bool {
        x.components.len() == self.dimension
    }

    pub(super) fn are_vectors(&self, x: &Tensor, y: &Tensor) -> [bool; 2] {
        [self.is_vector(x), self.is_vector(y)]
    }

    /// The vector that a value is.
    pub(super) fn known_vector(&self, x: Value) -> Option<Tensor> {
        self.known_tensor(x).filter(|x| self.is_vector(x))
    }

    /// `vector(x, y, z)`
    pub(super) fn vector(
        &mut self,
        actual: &[Value],
        given: &[ExprId],
        span: Span,
    ) -> Option<Value> {
        let vector = self.of_components("vector", actual, given, span)?;
        Some(self.tensor(vector))
    }

    /// The vector of so many numbers as there are dimensions.
    fn of_components(
        &mut self,
        name: &str,
        actual: &[Value],
        given: &[ExprId],
        span: Span,
    ) -> Option<Tensor> {
        let d = self.dimension;
        if actual.len() != d {
            let message = format!("`{name}` takes the {d} components of a vector");
            self.report(
                Diagnostic::error("wrong-number-of-arguments", span, message)
                    .label(format!("{} given in {d} dimensions", actual.len()))
                    .help(format!(
                        "write `{name}({})`, or say for which dimensions the file is: `dimensions {}`",
                        ["x", "y", "z"][..d].join(", "),
                        5 - d
                    )),
            );
            return None;
        }
        let mut quantity = self.number(actual[0], given[0])?;
        for (value, at) in actual.iter().zip(given).skip(1) {
            let next = self.number(*value, *at)?;
            let both = ((quantity, given[0]), (next, *at));
            quantity = self.quantity_of(Operator::Add, both.0, both.1, None, span)?;
        }
        let components = actual.iter().map(|value| Some(value.node)).collect();
        let uses = actual.iter().fold(0, |uses, value| uses | value.uses);
        Some(Tensor { components, quantity, uses })
    }

    /// Whether one of these values is a tensor, and no vector; reports it if so.
    fn refuse_tensors(&mut self, name: &str, actual: &[Value], given: &[ExprId]) -> Option<()> {
        let is_other = |value: &&Value| value.is_tensor() && self.known_vector(**value).is_none();
        let Some(wrong) = actual.iter().position(|value| is_other(&value)) else { return Some(()) };
        let shape = self.shape(actual[wrong]);
        let message = format!("`{name}` is made of vectors, this is {shape}");
        self.report(
            Diagnostic::error("wrong-shape", self.arena[given[wrong]].span, message)
                .label(shape)
                .help("write `dyad(n, m)` with `n = vector(..)`; the product of tensors is `A*B`"),
        );
        None
    }

    /// `dyad(n, m)`, `dyad(n)`, or `dyad(x, y, z)` of the components of `n`.
    pub(super) fn dyad(&mut self, actual: &[Value], given: &[ExprId], span: Span) -> Option<Value> {
        let vectors: Option<Vec<Tensor>> =
            actual.iter().map(|value| self.known_vector(*value)).collect();
        let (x, y) = match vectors.as_deref() {
            Some([x]) => (x.clone(), x.clone()),
            Some([x, y]) => (x.clone(), y.clone()),
            _ => {
                self.refuse_tensors("dyad", actual, given)?;
                let x = self.of_components("dyad", actual, given, span)?;
                (x.clone(), x)
            }
        };
        let d = self.dimension;
        let mut components = Vec::with_capacity(d * d);
        let is_symmetric = x.components == y.components;
        for k in 0..d * d {
            if is_symmetric && k % d < k / d {
                components.push(components[k % d * d + k / d]);
                continue;
            }
            let factors = (x.components[k / d], y.components[k % d]);
            components.push(self.component(Operator::Multiply, factors.0, factors.1, span)?);
        }
        let quantity = x.quantity.combine(y.quantity, |p, q| p.times(q));
        Some(self.tensor(Tensor { components, quantity, uses: x.uses | y.uses }))
    }

    /// `A*n`
    pub(super) fn times_vector(&mut self, a: &Tensor, x: &Tensor, span: Span) -> Option<Tensor> {
        let mut components = Vec::with_capacity(self.dimension);
        for row in a.components.chunks_exact(self.dimension) {
            let mut sum = None;
            for (&a, &x) in row.iter().zip(&x.components) {
                let term = self.component(Operator::Multiply, a, x, span)?;
                sum = self.component(Operator::Add, sum, term, span)?;
            }
            components.push(sum);
        }
        let quantity = a.quantity.combine(x.quantity, |p, q| p.times(q));
        Some(Tensor { components, quantity, uses: a.uses | x.uses })
    }

    /// The sum of the products of all components: `n*m` of vectors, `A : B` of tensors.
    pub(super) fn dot(&mut self, x: &Tensor, y: &Tensor, span: Span) -> Option<Value> {
        if let Some(product) = self.dot_with_bond(x, y, span) {
            return Some(product);
        }
        if let Some(length) = self.length_of_bond(x, span)
            && x.components == y.components
        {
            return self.square(length, span);
        }
        let mut sum = None;
        for (&a, &b) in x.components.iter().zip(&y.components) {
            let term = self.component(Operator::Multiply, a, b, span)?;
            sum = self.component(Operator::Add, sum, term, span)?;
        }
        let quantity = x.quantity.combine(y.quantity, |p, q| p.times(q));
        self.scalar(sum, quantity, x.uses | y.uses, span)
    }

    /// `norm(n)`, of a vector or a tensor: the root of the sum of the squares of its components.
    pub(super) fn norm(&mut self, (x, at): (Value, ExprId), span: Span) -> Option<Value> {
        let Some(tensor) = self.known_tensor(x) else {
            let shape = self.shape(x);
            let message = format!("only a vector or a tensor has a `norm`; this is {shape}");
            self.report(
                Diagnostic::error("wrong-shape", self.arena[at].span, message)
                    .label(shape)
                    .help("the absolute value of a number is `abs`; of a function of `U` take `sqrt(tr(..))`"),
            );
            return None;
        };
        if let Some(length) = self.length_of_bond(&tensor, span) {
            return Some(length);
        }
        let square = self.dot(&tensor, &tensor, span)?;
        let node = self.operation(Node::Unary(Function::Sqrt, square.node), span)?;
        let kind = super::value::Kind::Number(tensor.quantity);
        Some(Value { node, kind, uses: tensor.uses, constant: None })
    }

    /// `F(1, 2)` of a tensor, `n(1)` of a vector: components count from 1.
    pub(super) fn component_of(
        &mut self,
        name: &Ident,
        given: &[ExprId],
        actual: &[Value],
        span: Span,
    ) -> Option<Value> {
        let value = self.name(&name.name, name.span, &[])?;
        let Some(tensor) = self.known_tensor(value) else {
            let mut error = not_a_function(name);
            if value.is_of_stretch() {
                let help = "functions of `U` have no components; those of tensors are `C(1, 2)`, `F(1, 2)`";
                error.helps = vec![help.into()];
            }
            self.report(error);
            return None;
        };
        let d = self.dimension;
        let order = if self.is_vector(&tensor) { 1 } else { 2 };
        if given.len() != order {
            let (example, shape) = (["(1)", "(1, 2)"][order - 1], self.shape(value));
            let message = format!("a component of `{0}` is `{0}{example}`", name.name);
            self.report(Diagnostic::error("wrong-number-of-arguments", span, message).label(shape));
            return None;
        }
        let mut place = 0;
        for (value, at) in actual.iter().zip(given) {
            let index = value
                .constant
                .map(f64::from_bits)
                .filter(|x| x.fract() == 0.0 && (1.0..=d as f64).contains(x));
            let Some(index) = index else {
                let message = format!("components of `{}` count from 1 to {d}", name.name);
                self.report(
                    Diagnostic::error("wrong-shape", self.arena[*at].span, message)
                        .label("a whole number is expected here"),
                );
                return None;
            };
            place = place * d + (index as usize - 1);
        }
        let quantity: Quantity = tensor.quantity;
        self.scalar(tensor.components[place], quantity, tensor.uses, span)
    }
}
