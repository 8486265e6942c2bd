//! Expressions to graph nodes: `d` folds, types and dimensions are checked.
//!
//! Functions are expanded at their calls, with the arguments' dimensions; equal calls are expanded
//! once. A branch that a condition on `d` rules out is not looked at.

use std::collections::HashMap;

use piola_grammar::ast::{
    Arena, Ast, BinaryOperator, ExprId, ExprKind, Ident, Statement, UnaryOperator,
};
use piola_grammar::{Diagnostic, ExpressionAst, Span};

use super::dimension::Dimension;
use super::names::{self, Symbol, Symbols, parts};
use super::value::{Constant, Kind, Quantity, Value};
use crate::expression::graph::MAX_NODES;
use crate::expression::number::Number;
use crate::expression::{Comparison, ExprGraph, Function, Input, Node, NodeId, Operator};
use crate::measure::Measure;

/// Most expressions that expanding all calls may visit; far above what [`MAX_NODES`] needs.
const MAX_VISITS: usize = 400_000;

/// Deepest chain of functions that call each other.
const MAX_CALL_DEPTH: usize = 256;

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
    values: HashMap<usize, Option<Value>>,
    calls: HashMap<(usize, Vec<Value>), Option<Value>>,
    call_sites: Vec<(Span, String)>,
    visits: usize,
    exhausted: bool,
}

/// A function's formal parameters and what they stand for in one call.
type Arguments<'b> = &'b [(&'b Ident, Value)];

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
            values: HashMap::new(),
            calls: HashMap::new(),
            call_sites: Vec::new(),
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
        let parts = parts(self.arena, root);
        if let Some(&Constant::Number(x)) = self.constants(&parts, &[]).get(&root) {
            return Some(x);
        }
        let error =
            Diagnostic::error("not-a-constant", self.arena[root].span, "a number is expected here");
        self.report(error.label("only numbers, `d` and `pi` may be used"));
        None
    }

    fn body(&mut self, root: ExprId, arguments: Arguments<'_>) -> Option<Value> {
        let parts = parts(self.arena, root);
        self.visits += parts.len();
        if self.visits > MAX_VISITS {
            self.out_of_room(self.arena[root].span);
            return None;
        }
        let constants = self.constants(&parts, arguments);
        let active = self.active(&parts, &constants);
        let mut values: HashMap<ExprId, Option<Value>> = HashMap::with_capacity(parts.len());
        for &id in &parts {
            if active.contains(&id) {
                let mut value = self.node(id, &values, &constants, arguments);
                if let (Some(value), Some(Constant::Number(x))) = (&mut value, constants.get(&id)) {
                    value.constant = Some(x.to_bits());
                }
                values.insert(id, value);
            }
        }
        values[&root]
    }

    /// What is known of the parts before any parameter has a value.
    fn constants(
        &mut self,
        parts: &[ExprId],
        arguments: Arguments<'_>,
    ) -> HashMap<ExprId, Constant> {
        let mut known = HashMap::new();
        for &id in parts {
            if let Some(constant) = self.constant_of(id, &known, arguments) {
                known.insert(id, constant);
            }
        }
        known
    }

    fn constant_of(
        &mut self,
        id: ExprId,
        known: &HashMap<ExprId, Constant>,
        arguments: Arguments<'_>,
    ) -> Option<Constant> {
        use Constant::{Number as Num, Truth};
        match &self.arena[id].kind {
            ExprKind::Number(x) => Some(Num(*x)),
            ExprKind::Name(name) => {
                if let Some((_, value)) = arguments.iter().find(|(formal, _)| formal.name == *name)
                {
                    return value.constant.map(|bits| Num(f64::from_bits(bits)));
                }
                match self.symbols.get(name)? {
                    Symbol::Dimension => Some(Num(self.dimension as f64)),
                    Symbol::Pi => Some(Num(std::f64::consts::PI)),
                    Symbol::Value(number) => {
                        let value = self.values.get(&number).copied().flatten()?;
                        value.constant.map(|bits| Num(f64::from_bits(bits)))
                    }
                    _ => None,
                }
            }
            ExprKind::Call { .. } => None,
            ExprKind::Unary { operator, operand } => match (operator, known.get(operand)?) {
                (UnaryOperator::Negate, Num(x)) => Some(Num(-x)),
                (UnaryOperator::Not, Truth(c)) => Some(Truth(!c)),
                _ => None,
            },
            ExprKind::Binary { operator, left, right } => {
                match (known.get(left)?, known.get(right)?, meaning(*operator)) {
                    (Num(x), Num(y), Meaning::Number(o)) => Some(Num(f64::binary(o, *x, *y))),
                    (Num(x), Num(y), Meaning::Comparison(c)) => Some(Truth(c.holds(*x, *y))),
                    (Truth(x), Truth(y), Meaning::And) => Some(Truth(*x && *y)),
                    (Truth(x), Truth(y), Meaning::Or) => Some(Truth(*x || *y)),
                    _ => None,
                }
            }
            ExprKind::If { condition, then, otherwise } => match known.get(condition)? {
                Truth(true) => known.get(then).copied(),
                Truth(false) => known.get(otherwise).copied(),
                Num(_) => None,
            },
        }
    }

    /// The parts that no condition on `d` rules out.
    fn active(
        &self,
        parts: &[ExprId],
        constants: &HashMap<ExprId, Constant>,
    ) -> std::collections::HashSet<ExprId> {
        let mut active = std::collections::HashSet::with_capacity(parts.len());
        active.extend(parts.last());
        for &id in parts.iter().rev() {
            if !active.contains(&id) {
                continue;
            }
            match taken_branch(&self.arena[id].kind, constants) {
                Some(branch) => active.extend([branch]),
                None => active.extend(names::children(&self.arena[id].kind)),
            }
        }
        active
    }

    fn node(
        &mut self,
        id: ExprId,
        values: &HashMap<ExprId, Option<Value>>,
        constants: &HashMap<ExprId, Constant>,
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
                let quantity = self.number(x, *operand)?;
                let node = Node::Unary(Function::Negate, x.node);
                self.make(node, Kind::Number(quantity), x.uses, span)
            }
            ExprKind::Unary { operator: UnaryOperator::Not, operand } => {
                let x = of(operand)?;
                self.truth(x, *operand)?;
                self.make(Node::Not(x.node), Kind::Truth, x.uses, span)
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
            ExprKind::Call { function, arguments: given } => {
                let actual: Option<Vec<Value>> = given.iter().map(of).collect();
                self.call(function, given, actual?, span)
            }
        }
    }

    /// The quantity of plain numbers: checked files know them as pure numbers.
    fn number_quantity(&self) -> Quantity {
        if self.checked { Quantity::NUMBER } else { Quantity::Any }
    }

    fn known(&self, dimension: Dimension) -> Kind {
        Kind::Number(if self.checked { Quantity::Known(dimension) } else { Quantity::Any })
    }

    fn name(&mut self, name: &str, span: Span, arguments: Arguments<'_>) -> Option<Value> {
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
            Symbol::Value(number) => self.values.get(&number).copied().flatten(),
            Symbol::Function(_) => None,
        }
    }

    /// Elaborates `k = ..` once; later uses read the result.
    pub(crate) fn define_value(&mut self, number: usize, body: ExprId) {
        let value = self.body(body, &[]);
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
            Meaning::Number(operator) => {
                let (p, q) = (self.number(x, left), self.number(y, right));
                let quantity =
                    self.quantity_of(operator, (p?, left), (q?, right), exponent, span)?;
                let node = Node::Binary(operator, x.node, y.node);
                self.make(node, Kind::Number(quantity), uses, span)
            }
        }
    }

    fn quantity_of(
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
            Operator::Add | Operator::Subtract | Operator::Min | Operator::Max => {
                if let Some(common) = p.unify(q) {
                    return Some(common);
                }
                let message = match operator {
                    Operator::Add => {
                        format!("cannot add {} to {}", q.describe(), p.describe())
                    }
                    Operator::Subtract => {
                        format!("cannot subtract {} from {}", q.describe(), p.describe())
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
                let message = format!("{dimension} to the power {c} has no sensible unit");
                let span = self.arena[exponent_at].span;
                self.report(Diagnostic::error("dimension-mismatch", span, message).help(
                    "exponents of quantities with units are fractions with a small denominator",
                ));
                None
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
            _ => {
                let message = "one branch of `if` is a number, the other a condition";
                self.report(Diagnostic::error("type-mismatch", span, message));
                return None;
            }
        };
        let uses = c.uses | x.uses | y.uses;
        self.make(Node::Select(c.node, x.node, y.node), kind, uses, span)
    }

    fn call(
        &mut self,
        function: &Ident,
        given: &[ExprId],
        actual: Vec<Value>,
        span: Span,
    ) -> Option<Value> {
        if let Some(Symbol::Function(number)) = self.symbols.get(&function.name) {
            if !self.symbols.is_sound(number) {
                return None;
            }
            return self.expand(number, function, actual, span);
        }
        if let Some(builtin) = Function::named(&function.name) {
            let quantity = self.number(actual[0], given[0])?;
            let quantity = self.builtin_quantity(builtin, quantity, given[0])?;
            let node = Node::Unary(builtin, actual[0].node);
            return self.make(node, Kind::Number(quantity), actual[0].uses, span);
        }
        let operator = if function.name == "min" { Operator::Min } else { Operator::Max };
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

    fn expand(
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
        let formals = definition.parameters.as_deref().unwrap_or(&[]);
        let arguments: Vec<(&Ident, Value)> = formals.iter().zip(key.1.iter().copied()).collect();
        let described: Vec<String> = arguments
            .iter()
            .map(|(formal, value)| match value.kind {
                Kind::Number(quantity) => format!("`{}` {}", formal.name, quantity.describe()),
                Kind::Truth => format!("`{}` a condition", formal.name),
            })
            .collect();
        let site = format!("in this call of `{}`, with {}", function.name, described.join(", "));
        self.call_sites.push((span, site));
        let value = self.body(definition.body, &arguments);
        self.call_sites.pop();
        self.calls.insert(key, value);
        value
    }

    fn builtin_quantity(
        &mut self,
        function: Function,
        quantity: Quantity,
        at: ExprId,
    ) -> Option<Quantity> {
        match function {
            Function::Negate | Function::Abs => Some(quantity),
            Function::Sign => Some(self.number_quantity()),
            Function::Sqrt => match quantity {
                Quantity::Known(dimension) => Some(Quantity::Known(dimension.power(0.5)?)),
                Quantity::Any => Some(Quantity::Any),
            },
            _ => {
                let Some(dimension) = quantity.with_unit() else {
                    return Some(self.number_quantity());
                };
                let name = function.name();
                let message = format!("`{name}` needs a pure number, not {dimension}");
                let error = Diagnostic::error("dimension-mismatch", self.arena[at].span, message)
                    .label("this has a unit");
                let help = self.stretch_help(at).unwrap_or_else(|| {
                    "divide it by a reference value of the same unit".to_string()
                });
                self.report(error.help(help));
                None
            }
        }
    }

    /// The quantity of a number, or an error where a condition stands.
    pub(crate) fn number(&mut self, value: Value, at: ExprId) -> Option<Quantity> {
        match value.kind {
            Kind::Number(quantity) => Some(quantity),
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
            Kind::Number(_) => {
                let span = self.arena[at].span;
                let message = "a condition is expected here, this is a number";
                self.report(
                    Diagnostic::error("type-mismatch", span, message)
                        .label("a number")
                        .help("compare it with something, for instance `x > 0`"),
                );
                None
            }
        }
    }

    fn mismatch(
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

    fn make(&mut self, node: Node, kind: Kind, uses: u8, span: Span) -> Option<Value> {
        match self.graph.intern(node) {
            Ok(node) => Some(Value { node, kind, uses, constant: None }),
            Err(_) => {
                self.out_of_room(span);
                None
            }
        }
    }

    fn out_of_room(&mut self, span: Span) {
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
        for (span, text) in self.call_sites.iter().rev().take(3) {
            error = error.note(*span, text.clone());
        }
        self.errors.push(error);
    }
}

/// The branch that a known condition takes.
fn taken_branch(kind: &ExprKind, constants: &HashMap<ExprId, Constant>) -> Option<ExprId> {
    let ExprKind::If { condition, then, otherwise } = kind else { return None };
    match constants.get(condition)? {
        Constant::Truth(true) => Some(*then),
        Constant::Truth(false) => Some(*otherwise),
        Constant::Number(_) => None,
    }
}

enum Meaning {
    Number(Operator),
    Comparison(Comparison),
    And,
    Or,
}

fn meaning(operator: BinaryOperator) -> Meaning {
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
