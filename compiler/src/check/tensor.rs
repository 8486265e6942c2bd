//! Tensors of d x d components, and vectors of d: they exist only here and in `vector`. What comes out of the check are graphs of their
//! components, so that everything after it knows numbers alone.

use piola_grammar::ast::{ExprId, Ident};
use piola_grammar::{Diagnostic, Span};

use super::elaborate::Elaborator;
use super::symbols::{Kinematic, TensorFunction};
use super::value::{Component, Components, Constant, GRADIENT, Kind, Quantity, TensorId, Value};
use crate::expression::{Function, Input, Node, NodeId, Operator, graph};

/// Largest exponent of a power of a tensor.
const LARGEST_POWER: f64 = 8.0;

/// A tensor, or a vector, with what is known of it.
#[derive(Clone)]
pub(super) struct Tensor {
    pub(super) components: Components,
    pub(super) quantity: Quantity,
    pub(super) uses: u8,
}

impl Elaborator<'_> {
    /// The value of a name that a file with `psi(F)` knows.
    pub(super) fn kinematic(&mut self, which: Kinematic, span: Span) -> Option<Value> {
        let gradient = self.gradient(span)?;
        let tensor = match which {
            Kinematic::Gradient => gradient,
            Kinematic::Identity => self.identity(span)?,
            Kinematic::Jacobian => return self.determinant(&gradient, span),
            Kinematic::CauchyGreen => self.cauchy_green(&gradient, span)?,
            Kinematic::Stretch => return self.stretch(span),
            Kinematic::Strain => {
                let (c, identity) = (self.cauchy_green(&gradient, span)?, self.identity(span)?);
                let twice =
                    self.componentwise(Operator::Subtract, &c, &identity, c.quantity, span)?;
                let two = self.operation(Node::number(2.0), span)?;
                self.scaled(Operator::Divide, &twice, two, span)?
            }
        };
        Some(self.tensor(tensor))
    }

    fn gradient(&mut self, span: Span) -> Option<Tensor> {
        let mut components = Vec::new();
        for k in graph::components(self.dimension) {
            components.push(Some(self.operation(Node::Input(Input::Variable(k)), span)?));
        }
        Some(Tensor { components, quantity: self.number_quantity(), uses: GRADIENT })
    }

    fn identity(&mut self, span: Span) -> Option<Tensor> {
        let d = self.dimension;
        let one = self.operation(Node::number(1.0), span)?;
        let components = (0..d * d).map(|k| (k / d == k % d).then_some(one)).collect();
        Some(Tensor { components, quantity: self.number_quantity(), uses: 0 })
    }

    fn cauchy_green(&mut self, gradient: &Tensor, span: Span) -> Option<Tensor> {
        let transposed = self.transposed(gradient);
        self.matrix_product(&transposed, gradient, span)
    }

    /// `A'`
    pub(super) fn transpose(&mut self, x: Value, at: ExprId) -> Option<Value> {
        if x.is_of_stretch() {
            return Some(x);
        }
        let tensor = self.as_tensor(x, at, "has a transpose")?;
        let transposed = self.transposed(&tensor);
        Some(self.tensor(transposed))
    }

    /// `A : B`
    pub(super) fn contract(
        &mut self,
        (x, left): (Value, ExprId),
        (y, right): (Value, ExprId),
        span: Span,
    ) -> Option<Value> {
        if x.is_of_stretch() || y.is_of_stretch() {
            let product =
                self.stretch_binary(Operator::Multiply, (x, left), (y, right), None, span)?;
            return self.trace_of_stretch(product, span);
        }
        let (x, y) = (
            self.as_tensor(x, left, "has a double contraction"),
            self.as_tensor(y, right, "has a double contraction"),
        );
        self.dot(&x?, &y?, span)
    }

    /// `tr(A)`, `det(A)` and so on.
    pub(super) fn tensor_call(
        &mut self,
        function: TensorFunction,
        (name, x, at): (&Ident, Value, ExprId),
        span: Span,
    ) -> Option<Value> {
        if x.is_of_stretch() {
            return self.stretch_call(function, (name, x), span);
        }
        let tensor = self.as_tensor(x, at, &format!("can be the argument of `{}`", name.name))?;
        match function {
            TensorFunction::Trace => self.trace(&tensor, span),
            TensorFunction::Determinant => self.determinant(&tensor, span),
            TensorFunction::Inverse => {
                let inverse = self.inverse(&tensor, span)?;
                Some(self.tensor(inverse))
            }
            TensorFunction::Deviator => {
                let trace = self.trace(&tensor, span)?;
                let d = self.operation(Node::number(self.dimension as f64), span)?;
                let mean = self.operation(Node::Binary(Operator::Divide, trace.node, d), span)?;
                let identity = self.identity(span)?;
                let spherical = self.scaled(Operator::Multiply, &identity, mean, span)?;
                let quantity = tensor.quantity;
                let deviator =
                    self.componentwise(Operator::Subtract, &tensor, &spherical, quantity, span)?;
                Some(self.tensor(deviator))
            }
            // Handled where their arguments are.
            TensorFunction::Dyad | TensorFunction::Vector | TensorFunction::Norm => None,
            TensorFunction::Symmetric => {
                let transposed = self.transposed(&tensor);
                let quantity = tensor.quantity;
                let twice =
                    self.componentwise(Operator::Add, &tensor, &transposed, quantity, span)?;
                let two = self.operation(Node::number(2.0), span)?;
                let symmetric = self.scaled(Operator::Divide, &twice, two, span)?;
                Some(self.tensor(symmetric))
            }
        }
    }

    /// `-A`
    pub(super) fn negative(&mut self, x: Value, id: TensorId, span: Span) -> Option<Value> {
        let Kind::Tensor(_, quantity) = x.kind else { return None };
        let mut components = self.tensors[id.0 as usize].clone();
        for component in components.iter_mut().flatten() {
            *component = self.operation(Node::Unary(Function::Negate, *component), span)?;
        }
        Some(self.tensor(Tensor { components, quantity, uses: x.uses }))
    }

    /// Sums, products and quotients of which at least one operand is a tensor.
    pub(super) fn tensor_binary(
        &mut self,
        operator: Operator,
        (x, left): (Value, ExprId),
        (y, right): (Value, ExprId),
        exponent: Option<&Constant>,
        span: Span,
    ) -> Option<Value> {
        if x.is_of_stretch() || y.is_of_stretch() {
            return self.stretch_binary(operator, (x, left), (y, right), exponent, span);
        }
        let tensor = match (operator, self.known_tensor(x), self.known_tensor(y)) {
            (Operator::Subtract, Some(a), Some(b)) if self.moved(&a, &b).is_some() => {
                self.moved(&a, &b)?
            }
            (Operator::Add | Operator::Subtract, Some(a), Some(b))
                if a.components.len() == b.components.len() =>
            {
                let quantity = self.quantity_of(
                    operator,
                    (a.quantity, left),
                    (b.quantity, right),
                    None,
                    span,
                )?;
                self.componentwise(operator, &a, &b, quantity, span)?
            }
            (Operator::Multiply, Some(a), Some(b)) => match self.are_vectors(&a, &b) {
                [false, false] => self.matrix_product(&a, &b, span)?,
                [false, true] => self.times_vector(&a, &b, span)?,
                [true, false] => {
                    let transposed = self.transposed(&b);
                    self.times_vector(&transposed, &a, span)?
                }
                [true, true] => return self.dot(&a, &b, span),
            },
            (Operator::Multiply, Some(a), None) => self.times(&a, (y, right), span)?,
            (Operator::Multiply, None, Some(b)) => self.times(&b, (x, left), span)?,
            (Operator::Divide, Some(a), None)
                if self.is_length(y.node) && self.direction_in(&a).is_some() =>
            {
                self.direction(&a)?
            }
            (Operator::Divide, Some(a), None) => {
                let q = self.number(y, right)?;
                let quantity = a.quantity.combine(q, |p, q| p.over(q));
                let quotient = self.scaled(Operator::Divide, &a, y.node, span)?;
                Tensor { quantity, uses: a.uses | y.uses, ..quotient }
            }
            (Operator::Power, Some(a), None) if !self.is_vector(&a) => {
                let exponent = match exponent {
                    Some(Constant::Number(n)) => Some(*n),
                    _ => None,
                };
                self.tensor_power(&a, exponent, span)?
            }
            _ => {
                self.wrong_shapes(operator, x, y, span);
                return None;
            }
        };
        Some(self.tensor(tensor))
    }

    /// Branches of an `if` that are tensors.
    pub(super) fn choose_tensor(
        &mut self,
        c: Value,
        (x, then): (Value, ExprId),
        (y, otherwise): (Value, ExprId),
        span: Span,
    ) -> Option<Value> {
        let (a, b) = (self.known_tensor(x)?, self.known_tensor(y)?);
        let (p, q) = (a.quantity, b.quantity);
        let Some(quantity) = p.unify(q) else {
            let message =
                format!("the branches of `if` differ: {} and {}", p.describe(), q.describe());
            self.mismatch(span, message, (then, p), (otherwise, q));
            return None;
        };
        let zero = self.operation(Node::number(0.0), span)?;
        let mut components = Vec::with_capacity(a.components.len());
        for (&a, &b) in a.components.iter().zip(&b.components) {
            let node = Node::Select(c.node, a.unwrap_or(zero), b.unwrap_or(zero));
            components.push(Some(self.operation(node, span)?));
        }
        let uses = c.uses | a.uses | b.uses;
        Some(self.tensor(Tensor { components, quantity, uses }))
    }

    fn wrong_shapes(&mut self, operator: Operator, x: Value, y: Value, span: Span) {
        let (p, q) = (self.shape(x), self.shape(y));
        let has_vector = [x, y].into_iter().any(|value| self.known_vector(value).is_some());
        let of_vector = "sums of vectors are of vectors: `n + vector(..)`; `n*m` is a number, `dyad(n, m)` a tensor";
        let (what, help) = match operator {
            Operator::Add if has_vector => (format!("cannot add {q} to {p}"), of_vector),
            Operator::Subtract if has_vector => {
                (format!("cannot subtract {q} from {p}"), of_vector)
            }
            Operator::Add => {
                (format!("cannot add {q} to {p}"), "a number times the unit tensor is `x*I`")
            }
            Operator::Subtract => {
                (format!("cannot subtract {q} from {p}"), "a number times the unit tensor is `x*I`")
            }
            Operator::Divide => {
                (format!("cannot divide {p} by {q}"), "multiply by the inverse: `A*inv(B)`")
            }
            Operator::Power => (
                format!("cannot raise {p} to a power that is {q}"),
                "powers of tensors are products: `C*C`; the square of a vector is `n*n`",
            ),
            _ => (
                format!("cannot combine {p} with {q}"),
                "take an invariant: `tr(A)`, `det(A)` or `A : B`",
            ),
        };
        self.report(Diagnostic::error("wrong-shape", span, what).help(help));
    }

    fn tensor_power(&mut self, a: &Tensor, exponent: Option<f64>, span: Span) -> Option<Tensor> {
        let Some(n) = exponent.filter(|n| n.fract() == 0.0 && (1.0..=LARGEST_POWER).contains(n))
        else {
            let message =
                format!("the exponent of a tensor is a whole number between 1 and {LARGEST_POWER}");
            self.report(
                Diagnostic::error("wrong-shape", span, message)
                    .help("the inverse is `inv(A)`; other powers are those of the stretch tensor: `C^n` is `U^(2*n)`"),
            );
            return None;
        };
        let mut power = a.clone();
        for _ in 1..n as usize {
            power = self.matrix_product(&power, a, span)?;
        }
        Some(power)
    }

    fn times(&mut self, a: &Tensor, (x, at): (Value, ExprId), span: Span) -> Option<Tensor> {
        let q = self.number(x, at)?;
        let quantity = q.combine(a.quantity, |p, q| p.times(q));
        let product = self.scaled(Operator::Multiply, a, x.node, span)?;
        Some(Tensor { quantity, uses: a.uses | x.uses, ..product })
    }

    fn transposed(&self, a: &Tensor) -> Tensor {
        let d = self.dimension;
        let components = (0..d * d).map(|k| a.components[k % d * d + k / d]).collect();
        Tensor { components, ..*a }
    }

    fn matrix_product(&mut self, a: &Tensor, b: &Tensor, span: Span) -> Option<Tensor> {
        let d = self.dimension;
        let mut components = Vec::with_capacity(d * d);
        for row in 0..d {
            for column in 0..d {
                let mut sum = None;
                for k in 0..d {
                    let (x, y) = (a.components[row * d + k], b.components[k * d + column]);
                    let term = self.component(Operator::Multiply, x, y, span)?;
                    sum = self.component(Operator::Add, sum, term, span)?;
                }
                components.push(sum);
            }
        }
        let quantity = a.quantity.combine(b.quantity, |p, q| p.times(q));
        Some(Tensor { components, quantity, uses: a.uses | b.uses })
    }

    fn trace(&mut self, a: &Tensor, span: Span) -> Option<Value> {
        let d = self.dimension;
        let mut sum = None;
        for k in 0..d {
            sum = self.component(Operator::Add, sum, a.components[k * d + k], span)?;
        }
        self.scalar(sum, a.quantity, a.uses, span)
    }

    fn determinant(&mut self, a: &Tensor, span: Span) -> Option<Value> {
        let d = self.dimension;
        let mut sum = None;
        for column in 0..d {
            let minor = self.minor(a, (0, column), span)?;
            let term = self.component(Operator::Multiply, a.components[column], minor, span)?;
            let operator = if column % 2 == 0 { Operator::Add } else { Operator::Subtract };
            sum = self.component(operator, sum, term, span)?;
        }
        let quantity = self.quantity_power(a.quantity, d as f64)?;
        self.scalar(sum, quantity, a.uses, span)
    }

    /// The determinant without a row and a column.
    fn minor(
        &mut self,
        a: &Tensor,
        (row, column): (usize, usize),
        span: Span,
    ) -> Option<Component> {
        let d = self.dimension;
        let rest = |left_out: usize| (0..d).filter(move |k| *k != left_out).collect::<Vec<_>>();
        let (rows, columns) = (rest(row), rest(column));
        let at = |i: usize, j: usize| a.components[rows[i] * d + columns[j]];
        if d == 2 {
            return Some(at(0, 0));
        }
        let first = self.component(Operator::Multiply, at(0, 0), at(1, 1), span)?;
        let second = self.component(Operator::Multiply, at(0, 1), at(1, 0), span)?;
        self.component(Operator::Subtract, first, second, span)
    }

    /// Cofactors over the determinant.
    fn inverse(&mut self, a: &Tensor, span: Span) -> Option<Tensor> {
        let d = self.dimension;
        let determinant = self.determinant(a, span)?.node;
        let mut components = Vec::with_capacity(d * d);
        for row in 0..d {
            for column in 0..d {
                let mut cofactor = self.minor(a, (column, row), span)?;
                if (row + column) % 2 == 1 {
                    cofactor = self.component(Operator::Subtract, None, cofactor, span)?;
                }
                components.push(match cofactor {
                    Some(x) => {
                        Some(self.operation(Node::Binary(Operator::Divide, x, determinant), span)?)
                    }
                    None => None,
                });
            }
        }
        let quantity = self.quantity_power(a.quantity, -1.0)?;
        Some(Tensor { components, quantity, uses: a.uses })
    }

    pub(super) fn quantity_power(&self, quantity: Quantity, exponent: f64) -> Option<Quantity> {
        match quantity {
            Quantity::Known(dimension) => dimension.power(exponent).map(Quantity::Known),
            Quantity::Any => Some(Quantity::Any),
        }
    }

    fn componentwise(
        &mut self,
        operator: Operator,
        a: &Tensor,
        b: &Tensor,
        quantity: Quantity,
        span: Span,
    ) -> Option<Tensor> {
        let mut components = Vec::with_capacity(a.components.len());
        for (&x, &y) in a.components.iter().zip(&b.components) {
            components.push(self.component(operator, x, y, span)?);
        }
        Some(Tensor { components, quantity, uses: a.uses | b.uses })
    }

    /// Every component times, or over, a number.
    fn scaled(&mut self, operator: Operator, a: &Tensor, by: NodeId, span: Span) -> Option<Tensor> {
        let mut components = a.components.clone();
        for component in components.iter_mut().flatten() {
            let node = match operator {
                Operator::Divide => Node::Binary(operator, *component, by),
                _ => Node::Binary(operator, by, *component),
            };
            *component = self.operation(node, span)?;
        }
        Some(Tensor { components, ..*a })
    }

    /// A sum, difference or product of two components; the outer `None` if there is no more room.
    pub(super) fn component(
        &mut self,
        operator: Operator,
        x: Component,
        y: Component,
        span: Span,
    ) -> Option<Component> {
        let node = match (operator, x, y) {
            (Operator::Multiply, None, _) | (Operator::Multiply, _, None) => return Some(None),
            (_, x, None) => return Some(x),
            (Operator::Subtract, None, Some(y)) => Node::Unary(Function::Negate, y),
            (_, None, y) => return Some(y),
            (_, Some(x), Some(y)) => Node::Binary(operator, x, y),
        };
        self.operation(node, span).map(Some)
    }

    pub(super) fn operation(&mut self, node: Node, span: Span) -> Option<NodeId> {
        let value = self.make(node, Kind::Truth, 0, span)?;
        Some(value.node)
    }

    pub(super) fn scalar(
        &mut self,
        sum: Component,
        quantity: Quantity,
        uses: u8,
        span: Span,
    ) -> Option<Value> {
        let node = match sum {
            Some(node) => node,
            None => self.operation(Node::number(0.0), span)?,
        };
        Some(Value { node, kind: Kind::Number(quantity), uses, constant: None })
    }

    /// Keeps a tensor; equal ones get equal numbers, so that equal calls are expanded once.
    pub(super) fn tensor(&mut self, Tensor { components, quantity, uses }: Tensor) -> Value {
        let known = self.tensor_ids.get(&components).copied();
        let node = components.iter().flatten().next().copied().unwrap_or(NodeId(0));
        let id = known.unwrap_or_else(|| {
            let id = TensorId(self.tensors.len() as u32);
            self.tensors.push(components.clone());
            self.tensor_ids.insert(components, id);
            id
        });
        Value { node, kind: Kind::Tensor(id, quantity), uses, constant: None }
    }

    pub(super) fn known_tensor(&self, x: Value) -> Option<Tensor> {
        let Kind::Tensor(id, quantity) = x.kind else { return None };
        let components = self.tensors[id.0 as usize].clone();
        Some(Tensor { components, quantity, uses: x.uses })
    }

    /// The tensor a value is, or an error where it is none: only a tensor `can`.
    fn as_tensor(&mut self, x: Value, at: ExprId, can: &str) -> Option<Tensor> {
        if let Some(tensor) = self.known_tensor(x).filter(|tensor| !self.is_vector(tensor)) {
            return Some(tensor);
        }
        let shape = self.shape(x);
        let message = format!("only a tensor {can}; this is {shape}");
        self.report(
            Diagnostic::error("wrong-shape", self.arena[at].span, message)
                .label(shape)
                .help(match self.known_vector(x) {
                    Some(_) => {
                        "the product of two vectors is `n*m`, their tensor `dyad(n, m)`; a vector has no transpose"
                    }
                    None => "tensors are `F`, `C`, `E`, `I` and what is made of them",
                }),
        );
        None
    }

    /// In words.
    pub(super) fn shape(&self, x: Value) -> String {
        let d = self.dimension;
        match x.kind {
            Kind::Tensor(id, _) if self.tensors[id.0 as usize].len() == d => {
                format!("a vector of {d} components")
            }
            Kind::Tensor(..) => format!("a {d} x {d} tensor"),
            Kind::OfStretch(_) => "a function of `U`".into(),
            Kind::Number(_) => "a number".into(),
            Kind::Truth => "a condition".into(),
        }
    }
}
