//! Expressions to graph nodes: `d` folds, types and dimensions are checked.
//!
//! Functions are expanded at their calls, with the arguments' dimensions; equal calls are expanded
//! once. A branch that a condition on `d` rules out is not looked at.

use rustc_hash::FxHashMap;

use piola_grammar::ast::{
    Arena, Ast, BinaryOperator, Definition, ExprId, ExprKind, Ident, UnaryOperator,
};
use piola_grammar::{Diagnostic, ExpressionAst, Span};

use super::MAX_FINDINGS;
use super::dimension::Dimension;
use super::gathered::Gathered;
use super::names::{self, parts};
use super::symbols::{Symbol, Symbols};
use super::texts::Texts;
use super::value::{Components, Constant, Kind, Quantity, TensorId, Value};
use crate::expression::graph::MAX_NODES;
use crate::expression::{Comparison, ExprGraph, Function, Input, Node, NodeId, Operator};
use crate::measure::Measure;

/// Most expressions that expanding all calls may visit; far above what [`MAX_NODES`] needs.
const MAX_VISITS: usize = 400_000;

/// Deepest chain of functions that call each other.
pub(super) const MAX_CALL_DEPTH: usize = 256;

/// Elaborates expressions of one file in one dimension.
pub(crate) struct Elaborator<'a> {
    pub(crate) arena: &'a Arena,
    pub(crate) ast: Option<&'a Ast>,
    pub(crate) symbols: &'a Symbols<'a>,
    pub(crate) dimension: usize,
    pub(crate) checked: bool,
    /// Of each parameter declared so far.
    pub(crate) parameter_quantities: Vec<Quantity>,
    pub(crate) graph: ExprGraph,
    pub(crate) errors: Vec<Diagnostic>,
    pub(super) tensors: Vec<Components>,
    pub(super) tensor_ids: FxHashMap<Components, TensorId>,
    pub(super) values: FxHashMap<usize, Option<Value>>,
    pub(super) calls: FxHashMap<(usize, Vec<Value>), Option<Value>>,
    pub(super) call_sites: Vec<(Span, String)>,
    /// What points gather, as far as it was met.
    pub(super) integrals: Vec<Gathered>,
    /// The functions of `U` of which traces were met so far.
    pub(super) traces: Vec<NodeId>,
    /// What stands where in the text.
    pub(super) stated: Texts,
    visits: usize,
    pub(super) exhausted: bool,
}

/// A function's formal parameters and what they stand for in one call.
pub(super) type Arguments<'b> = &'b [(&'b Ident, Value)];

impl<'a> Elaborator<'a> {
    pub(crate) fn new(
        arena: &'a Arena,
        ast: Option<&'a Ast>,
        symbols: &'a Symbols<'a>,
        dimension: usize,
        checked: bool,
    ) -> Self {
        Elaborator {
            arena,
            ast,
            symbols,
            dimension,
            checked,
            parameter_quantities: Vec::new(),
            graph: ExprGraph::new(),
            errors: Vec::new(),
            tensors: Vec::new(),
            tensor_ids: FxHashMap::default(),
            values: FxHashMap::default(),
            calls: FxHashMap::default(),
            call_sites: Vec::new(),
            integrals: Vec::new(),
            traces: Vec::new(),
            stated: Texts::default(),
            visits: 0,
            exhausted: false,
        }
    }

    /// Elaborates an expression; `None` if an error was reported.
    pub(crate) fn expression(&mut self, root: ExprId) -> Option<Value> {
        self.body(root, &[])
    }

    /// A number known before any parameter is, or an error.
    pub(crate) fn constant(&mut self, root: ExprId) -> Option<f64> {
        if !self.symbols.are_resolved(root) {
            return None;
        }
        let parts = parts(self.arena, root);
        if let Some(&Constant::Number(x)) = self.constants(&parts, &[]).get(&root) {
            return Some(x);
        }
        let error =
            Diagnostic::error("not-a-constant", self.arena[root].span, "a number is expected here");
        self.report(error.label("only numbers, `d` and `pi` may be used"));
        None
    }

    pub(super) fn body(&mut self, root: ExprId, arguments: Arguments<'_>) -> Option<Value> {
        // What is reported already is not looked at again.
        if self.exhausted || !self.symbols.are_resolved(root) {
            return None;
        }
        let parts = parts(self.arena, root);
        self.visits += parts.len();
        if self.visits > MAX_VISITS {
            self.out_of_room(self.arena[root].span);
            return None;
        }
        let constants = self.constants(&parts, arguments);
        let active = self.active(&parts, &constants);
        let mut values: FxHashMap<ExprId, Option<Value>> = FxHashMap::default();
        for &id in &parts {
            if self.exhausted {
                return None;
            }
            if active.contains(&id) {
                let mut value = self.node(id, &values, &constants, arguments);
                if let (Some(value), Some(Constant::Number(x))) = (&mut value, constants.get(&id)) {
                    value.constant = Some(x.to_bits());
                }
                if let Some(value) = value {
                    self.state(value, self.arena[id].span);
                }
                values.insert(id, value);
            }
        }
        values[&root]
    }

    fn node(
        &mut self,
        id: ExprId,
        values: &FxHashMap<ExprId, Option<Value>>,
        constants: &FxHashMap<ExprId, Constant>,
        arguments: Arguments<'_>,
    ) -> Option<Value> {
        let of = |x: &ExprId| values.get(x).copied().flatten();
        let span = self.arena[id].span;
        match &self.arena[id].kind {
            ExprKind::Number(x) => {
                let quantity = if *x == 0.0 { Quantity::Any } else { self.number_quantity() };
                self.make(Node::number(*x), Kind::Number(quantity), 0, span)
            }
            ExprKind::Name(name) => self.name(name, span, arguments),
            ExprKind::Unary { operator: UnaryOperator::Negate, operand } => {
                let x = of(operand)?;
                if let Kind::Tensor(id, _) = x.kind {
                    return self.negative(x, id, span);
                }
                if x.is_of_stretch() {
                    return self.make(Node::Unary(Function::Negate, x.node), x.kind, x.uses, span);
                }
                let quantity = self.number(x, *operand)?;
                let node = Node::Unary(Function::Negate, x.node);
                self.make(node, Kind::Number(quantity), x.uses, span)
            }
            ExprKind::Unary { operator: UnaryOperator::Not, operand } => {
                let x = of(operand)?;
                self.truth(x, *operand)?;
                self.make(Node::Not(x.node), Kind::Truth, x.uses, span)
            }
            ExprKind::Unary { operator: UnaryOperator::Transpose, operand } => {
                self.transpose(of(operand)?, *operand)
            }
            ExprKind::Binary { operator, left, right } => {
                let (x, y) = (of(left), of(right));
                self.binary(*operator, (x?, *left), (y?, *right), constants.get(right), span)
            }
            ExprKind::If { condition, then, otherwise } => {
                if let Some(branch) = taken_branch(&self.arena[id].kind, constants) {
                    return of(&branch);
                }
                let (c, x, y) = (of(condition), of(then), of(otherwise));
                self.choice((c?, *condition), (x?, *then), (y?, *otherwise), span)
            }
            ExprKind::Table { file, argument } => {
                self.table(file, (of(argument)?, *argument), span)
            }
            ExprKind::Call { function, arguments: given } => {
                let actual: Option<Vec<Value>> = given.iter().map(of).collect();
                self.call(function, given, actual?, span)
            }
        }
    }

    /// The quantity of plain numbers: checked files know them as pure numbers.
    pub(super) fn number_quantity(&self) -> Quantity {
        if self.checked { Quantity::NUMBER } else { Quantity::Any }
    }

    pub(super) fn known(&self, dimension: Dimension) -> Kind {
        Kind::Number(if self.checked { Quantity::Known(dimension) } else { Quantity::Any })
    }

    pub(super) fn name(
        &mut self,
        name: &str,
        span: Span,
        arguments: Arguments<'_>,
    ) -> Option<Value> {
        if let Some((_, value)) = arguments.iter().find(|(formal, _)| formal.name == name) {
            return Some(*value);
        }
        let bit = |m: Measure| 1 << (m as u8);
        let of = |m: Measure| Dimension::of(0, m.length_exponent(), 0, 0);
        match self.symbols.get(name)? {
            Symbol::Current(m) => {
                let kind = self.known(of(m));
                self.make(Node::Input(Input::Current(m)), kind, bit(m), span)
            }
            Symbol::Reference(m) => {
                let kind = self.known(of(m));
                self.make(Node::Input(Input::Reference(m)), kind, bit(m), span)
            }
            Symbol::Part(part) => self.part(part, Input::Part(part), span),
            Symbol::PartAtRest(part) => self.part(part, Input::PartAtRest(part), span),
            Symbol::Horizon => {
                let kind = self.known(Dimension::LENGTH);
                self.make(Node::Input(Input::Horizon), kind, 0, span)
            }
            Symbol::Dimension => {
                let kind = Kind::Number(self.number_quantity());
                self.make(Node::number(self.dimension as f64), kind, 0, span)
            }
            Symbol::Pi => {
                let kind = Kind::Number(self.number_quantity());
                self.make(Node::number(std::f64::consts::PI), kind, 0, span)
            }
            Symbol::Parameter(i) => {
                let quantity = self.parameter_quantities.get(i).copied().unwrap_or(Quantity::Any);
                let node = Node::Input(Input::Parameter(i as u16));
                self.make(node, Kind::Number(quantity), 0, span)
            }
            Symbol::TimeStep(i) => {
                let kind = self.known(Dimension::of(0, 0, 1, 0));
                self.make(Node::Input(Input::Parameter(i as u16)), kind, 0, span)
            }
            Symbol::Bond(first) => self.bond(first, span),
            Symbol::BondNow(first) => self.bond_now(first, span),
            Symbol::Kinematic(which) => self.kinematic(which, span),
            Symbol::Value(number) => self.values.get(&number).copied().flatten(),
            // `w` alone is `w(L)`.
            Symbol::Function(number) => {
                let rest = self.name("L", span, arguments)?;
                let function = Ident { name: name.to_string(), span };
                self.expand(number, &function, vec![rest], span)
            }
        }
    }

    /// Elaborates `k = ..` once; later uses read the result.
    pub(crate) fn define_value(&mut self, number: usize, definition: &Definition) {
        let mut value = self.body(definition.body, &[]);
        if let Some(unit) = &definition.unit {
            value = value.and_then(|value| self.in_unit(value, definition.body, unit));
        }
        value = value.and_then(|value| self.gathered_value(value, definition));
        self.values.insert(number, value);
    }

    fn binary(
        &mut self,
        operator: BinaryOperator,
        (x, left): (Value, ExprId),
        (y, right): (Value, ExprId),
        exponent: Option<&Constant>,
        span: Span,
    ) -> Option<Value> {
        let uses = x.uses | y.uses;
        match meaning(operator) {
            meaning @ (Meaning::And | Meaning::Or) => {
                let (left, right) = (self.truth(x, left), self.truth(y, right));
                left.and(right)?;
                let and = matches!(meaning, Meaning::And);
                let node = if and { Node::And(x.node, y.node) } else { Node::Or(x.node, y.node) };
                self.make(node, Kind::Truth, uses, span)
            }
            Meaning::Comparison(comparison) => {
                let (p, q) = (self.number(x, left), self.number(y, right));
                let (p, q) = (p?, q?);
                if p.unify(q).is_none() {
                    let message = format!("cannot compare {} with {}", p.describe(), q.describe());
                    self.mismatch(span, message, (left, p), (right, q));
                    return None;
                }
                self.make(Node::Compare(comparison, x.node, y.node), Kind::Truth, uses, span)
            }
            Meaning::Contraction => self.contract((x, left), (y, right), span),
            Meaning::Number(operator) if x.is_tensor() || y.is_tensor() => {
                self.tensor_binary(operator, (x, left), (y, right), exponent, span)
            }
            Meaning::Number(operator) => {
                let (p, q) = (self.number(x, left), self.number(y, right));
                let quantity =
                    self.quantity_of(operator, (p?, left), (q?, right), exponent, span)?;
                let kind = Kind::Number(quantity);
                if operator == Operator::Subtract
                    && let Some(node) = self.moved_component(x.node, y.node)
                {
                    return Some(Value { node, kind, uses, constant: None });
                }
                self.make(Node::Binary(operator, x.node, y.node), kind, uses, span)
            }
        }
    }

    fn choice(
        &mut self,
        (c, condition): (Value, ExprId),
        (x, then): (Value, ExprId),
        (y, otherwise): (Value, ExprId),
        span: Span,
    ) -> Option<Value> {
        self.truth(c, condition)?;
        let kind = match (x.kind, y.kind) {
            (Kind::Truth, Kind::Truth) => Kind::Truth,
            (Kind::Number(p), Kind::Number(q)) => match p.unify(q) {
                Some(common) => Kind::Number(common),
                None => {
                    let message = format!(
                        "the branches of `if` differ: {} and {}",
                        p.describe(),
                        q.describe()
                    );
                    self.mismatch(span, message, (then, p), (otherwise, q));
                    return None;
                }
            },
            (Kind::Tensor(..), Kind::Tensor(..)) if self.shape(x) == self.shape(y) => {
                return self.choose_tensor(c, (x, then), (y, otherwise), span);
            }
            (Kind::OfStretch(_), Kind::OfStretch(_)) => {
                self.no_choice_of_stretch(span);
                return None;
            }
            _ => {
                let (p, q) = (self.shape(x), self.shape(y));
                let message = format!("one branch of `if` is {p}, the other {q}");
                self.report(Diagnostic::error("type-mismatch", span, message));
                return None;
            }
        };
        let uses = c.uses | x.uses | y.uses;
        self.make(Node::Select(c.node, x.node, y.node), kind, uses, span)
    }

    /// The quantity of a number, or an error where a condition stands.
    pub(crate) fn number(&mut self, value: Value, at: ExprId) -> Option<Quantity> {
        match value.kind {
            Kind::Number(quantity) => Some(quantity),
            Kind::Tensor(..) | Kind::OfStretch(_) => {
                let shape = self.shape(value);
                let message = format!("a number is expected here, this is {shape}");
                let help = match self.known_vector(value) {
                    Some(_) => {
                        "numbers made of vectors are products, `n*m` and `n*C*n`, lengths, `norm(n)`, and \
                                components, `n(1)`"
                    }
                    None => "take an invariant: `tr(A)`, `det(A)` or `A : B`",
                };
                self.report(
                    Diagnostic::error("wrong-shape", self.arena[at].span, message)
                        .label(shape)
                        .help(help),
                );
                None
            }
            Kind::Truth => {
                let span = self.arena[at].span;
                let message = "a number is expected here, this is a condition";
                self.report(
                    Diagnostic::error("type-mismatch", span, message)
                        .label("a condition")
                        .help("choose between numbers with `if .. then .. else ..`"),
                );
                None
            }
        }
    }

    /// Reports an error where a number stands instead of a condition.
    pub(crate) fn truth(&mut self, value: Value, at: ExprId) -> Option<()> {
        match value.kind {
            Kind::Truth => Some(()),
            Kind::Number(_) | Kind::Tensor(..) | Kind::OfStretch(_) => {
                let span = self.arena[at].span;
                let shape = self.shape(value);
                let message = format!("a condition is expected here, this is {shape}");
                self.report(
                    Diagnostic::error("type-mismatch", span, message)
                        .label(shape)
                        .help("compare it with something, for instance `x > 0`"),
                );
                None
            }
        }
    }

    pub(super) fn make(&mut self, node: Node, kind: Kind, uses: u8, span: Span) -> Option<Value> {
        match self.graph.intern(node) {
            Ok(node) => Some(Value { node, kind, uses, constant: None }),
            Err(_) => {
                self.out_of_room(span);
                None
            }
        }
    }

    pub(super) fn out_of_room(&mut self, span: Span) {
        if !self.exhausted {
            self.exhausted = true;
            let message = format!("the file expands to more than {MAX_NODES} operations");
            self.report(
                Diagnostic::error("too-large", span, message)
                    .label("the limit is passed here")
                    .help("split the potential, or write repeated parts as definitions"),
            );
        }
    }

    /// Adds an error, with the calls that led to it.
    pub(crate) fn report(&mut self, mut error: Diagnostic) {
        if self.errors.len() >= MAX_FINDINGS {
            return;
        }
        for (span, text) in self.call_sites.iter().rev().take(3) {
            error = error.note(*span, text.clone());
        }
        self.errors.push(error);
    }
}

/// The branch that a known condition takes.
pub(super) fn taken_branch(
    kind: &ExprKind,
    constants: &FxHashMap<ExprId, Constant>,
) -> Option<ExprId> {
    let ExprKind::If { condition, then, otherwise } = kind else { return None };
    match constants.get(condition)? {
        Constant::Truth(true) => Some(*then),
        Constant::Truth(false) => Some(*otherwise),
        Constant::Number(_) => None,
    }
}

/// What an operator of the language does.
pub(crate) enum Meaning {
    Number(Operator),
    Comparison(Comparison),
    Contraction,
    And,
    Or,
}

pub(crate) fn meaning(operator: BinaryOperator) -> Meaning {
    match operator {
        BinaryOperator::Or => Meaning::Or,
        BinaryOperator::And => Meaning::And,
        BinaryOperator::Equal => Meaning::Comparison(Comparison::Equal),
        BinaryOperator::NotEqual => Meaning::Comparison(Comparison::NotEqual),
        BinaryOperator::Less => Meaning::Comparison(Comparison::Less),
        BinaryOperator::LessEqual => Meaning::Comparison(Comparison::LessEqual),
        BinaryOperator::Greater => Meaning::Comparison(Comparison::Greater),
        BinaryOperator::GreaterEqual => Meaning::Comparison(Comparison::GreaterEqual),
        BinaryOperator::Add => Meaning::Number(Operator::Add),
        BinaryOperator::Subtract => Meaning::Number(Operator::Subtract),
        BinaryOperator::Multiply => Meaning::Number(Operator::Multiply),
        BinaryOperator::Divide => Meaning::Number(Operator::Divide),
        BinaryOperator::Power => Meaning::Number(Operator::Power),
        BinaryOperator::Contract => Meaning::Contraction,
    }
}

/// Elaborates a formula of these variables; the flag says whether it is a condition.
pub(crate) fn elaborate_formula(
    ast: &ExpressionAst,
    variables: &[&str],
) -> Result<(ExprGraph, NodeId, bool), Vec<Diagnostic>> {
    let symbols = Symbols::with_variables(variables);
    names::check_formula(&ast.arena, ast.root, &symbols)?;
    let mut elaborator = Elaborator::new(&ast.arena, None, &symbols, 0, false);
    match elaborator.expression(ast.root) {
        Some(value) if elaborator.errors.is_empty() => {
            Ok((elaborator.graph, value.node, value.kind == Kind::Truth))
        }
        _ => Err(elaborator.errors),
    }
}
